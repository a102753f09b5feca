//! Plugins whose code runs in a worker program and not in the caller's process.

use std::fmt;

use crate::simulator::BuildError;

/// What a plugin whose code runs elsewhere says about that; see e.g. [`crate::simulator::SimulatorConfig::hosted`].
pub trait Hosted {
    /// The program that runs its code.
    fn worker(&self) -> WorkerProgram;

    /// Whether only the worker knows what the plugin is, as interpreters alone know users' code. Then the worker is asked
    /// when a config is read, before it is validated, and [`Self::accept_description`] gets what [`Self::describe`] gave
    /// there.
    fn needs_description(&self) -> bool {
        self.worker().is_interpreter()
    }

    /// What the worker says of the plugin. Called in the worker.
    ///
    /// # Errors
    /// Code that cannot be found or run.
    fn describe(&self) -> Result<Vec<u8>, BuildError> {
        Ok(Vec::new())
    }

    /// Takes up what the worker said. It becomes part of the config, and so of the keys of all results.
    ///
    /// # Errors
    /// A description that makes no sense.
    fn accept_description(&mut self, _description: &[u8]) -> Result<(), String> {
        Ok(())
    }
}

/// A program that does units of work in its own process; see [`crate::worker`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorkerProgram {
    /// The program of this name that lies beside the caller's own.
    Beside(&'static str),
    /// The interpreter of this language that the config's `[workers]` names. It can run every plugin, so a unit in which
    /// one plugin asks for it runs there with all others.
    Interpreter(&'static str),
}

impl WorkerProgram {
    /// Whether it is an interpreter, in which every plugin can run, code of users among them.
    pub fn is_interpreter(&self) -> bool {
        matches!(self, Self::Interpreter(_))
    }
}

impl fmt::Display for WorkerProgram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Beside(name) => f.write_str(name),
            Self::Interpreter(language) => write!(f, "the {language} worker"),
        }
    }
}
