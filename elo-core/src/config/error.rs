//! Why a config was refused, as lines for a terminal.

use std::fmt;
use std::path::PathBuf;

use crate::fault::Fault;

/// All faults of one config.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    file: PathBuf,
    findings: Vec<Finding>,
}

/// One fault and where it came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Where the field was written.
    pub place: Place,
    /// What is wrong with it.
    pub fault: Fault,
}

/// Where a field was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// Nowhere in particular: the file as a whole.
    File,
    /// A line of the file, counted from 1.
    Line(usize),
    /// A character of the file, where it is no TOML.
    Character {
        /// Counted from 1.
        line: usize,
        /// Counted from 1, in characters.
        column: usize,
    },
    /// An override of the command line, as it was given.
    Override(String),
}

impl ConfigError {
    pub(super) fn new(file: PathBuf, findings: Vec<Finding>) -> Self {
        Self { file, findings }
    }

    /// The same without line numbers, for a text that no file holds as it was read.
    #[must_use]
    pub fn without_lines(mut self) -> Self {
        for finding in &mut self.findings {
            if matches!(finding.place, Place::Line(_) | Place::Character { .. }) {
                finding.place = Place::File;
            }
        }
        self
    }

    /// What was found, in the order of the file; never empty.
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }
}

impl fmt::Display for ConfigError {
    /// One line a fault, as in ``examples/ant.toml:12: `metrics[1].k`: expected …, got …``.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = self.file.display();
        for (i, Finding { place, fault }) in self.findings.iter().enumerate() {
            if i > 0 {
                f.write_str("\n")?;
            }
            match place {
                Place::File => write!(f, "{file}: {fault}")?,
                Place::Line(line) => write!(f, "{file}:{line}: {fault}")?,
                Place::Character { line, column } => write!(f, "{file}:{line}:{column}: {fault}")?,
                Place::Override(given) => write!(f, "--set {given}: {fault}")?,
            }
        }
        Ok(())
    }
}

impl std::error::Error for ConfigError {}
