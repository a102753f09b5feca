//! The artefact that users keep: a folder with `options.safetensors` and `manifest.json`.
//!
//! Tensors of option `i` are named `i.<tensor>`; the manifest says which format reads them. Reading one runs no code and
//! is bounded: sizes are checked before anything is allocated, numbers that are not finite are refused.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::metric::Reference;
use crate::policy::{OptionPolicy, PolicyFormat, PolicyRecord};
use crate::returns::Scale;
use crate::rollout::Horizon;
use crate::spec::SimulatorSpec;
use crate::tensors::Tensors;

/// The format number of [`Manifest`]; raised with every change that a reader must know of.
pub const OPTION_SET_FORMAT: u32 = 1;

/// The greatest manifest that is read: 16 MiB.
const MAX_MANIFEST_BYTES: u64 = 16 << 20;

/// The most options of a set.
const MAX_OPTIONS: usize = 10_000;

/// What a set is, without its numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`OPTION_SET_FORMAT`].
    pub format: u32,
    /// The label of the metric that selected it.
    pub metric: String,
    /// The robot for which it was made; others are refused.
    pub spec: SimulatorSpec,
    /// How long an option lasts and how its returns were summed.
    pub horizon: Horizon,
    /// The normalisation of returns.
    pub scale: Scale,
    /// `(μ*, σ*)`, in normalised returns.
    pub reference: Reference,
    /// The options, best first.
    pub options: Vec<OptionEntry>,
    /// The whole config of the run that made it, as JSON: `elo evaluate` takes simulator, tasks and `d0` from it.
    pub experiment: serde_json::Value,
}

impl Manifest {
    /// The candidates that the set consists of: their numbers, and which of the options each has.
    pub fn candidates(&self) -> Vec<(usize, Range<usize>)> {
        let mut first = 0;
        let groups = self.options.chunk_by(|a, b| a.number == b.number);
        groups
            .map(|group| {
                let range = first..first + group.len();
                first = range.end;
                (group[0].number, range)
            })
            .collect()
    }
}

/// One option of a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OptionEntry {
    /// The number of its candidate in the run. Options of one number were learned together as a set.
    pub number: usize,
    /// The policy format that reads its tensors.
    pub policy: String,
    /// The candidate's score by the metric, from the returns that selected it: the option's own, or that of the set that it
    /// was learned with.
    pub selection_score: f64,
}

/// A set: manifest and numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct OptionSet {
    /// What it is.
    pub manifest: Manifest,
    /// The options, in the manifest's order.
    pub options: Vec<PolicyRecord>,
}

/// Why a set could not be read.
#[derive(Debug, thiserror::Error)]
pub enum OptionSetError {
    /// A file cannot be read.
    #[error("{path}: {source}")]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file is not what it should be.
    #[error("{path}: {reason}")]
    Invalid {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The set was made for something else.
    #[error("the option set does not fit this simulator: {0}")]
    Mismatch(String),
}

impl OptionSet {
    /// The files of the set: names and bytes. The same set gives the same bytes.
    pub fn files(&self) -> [(&'static str, Vec<u8>); 2] {
        let mut tensors = Tensors::new();
        for (index, option) in self.options.iter().enumerate() {
            tensors.extend_prefixed(&format!("{index}."), &option.tensors);
        }
        let mut manifest = serde_json::to_vec_pretty(&self.manifest).expect("a manifest is plain data");
        manifest.push(b'\n');
        [("manifest.json", manifest), ("options.safetensors", tensors.encode())]
    }

    /// Reads the set in `folder`.
    ///
    /// # Errors
    /// See [`OptionSetError`]; the message names the file and what is wrong with it.
    pub fn read(folder: &Path) -> Result<Self, OptionSetError> {
        let sets = folder.join("results").join("option_sets");
        if sets.is_dir() {
            let reason = format!("is a run directory; its option sets are the folders in {}", sets.display());
            return Err(OptionSetError::Invalid { path: folder.to_owned(), reason });
        }
        let path = folder.join("manifest.json");
        let text = read_capped(&path, MAX_MANIFEST_BYTES)?;
        let invalid = |path: &Path, reason: String| OptionSetError::Invalid { path: path.to_owned(), reason };
        let value: serde_json::Value =
            serde_json::from_slice(&text).map_err(|error| invalid(&path, format!("not JSON: {error}")))?;
        let format = value.get("format").and_then(serde_json::Value::as_u64);
        if format != Some(u64::from(OPTION_SET_FORMAT)) {
            let got = format.map_or("none".to_owned(), |number| number.to_string());
            let reason = format!("option-set format {got}, this program reads format {OPTION_SET_FORMAT}");
            return Err(invalid(&path, reason));
        }
        let manifest: Manifest =
            serde_json::from_value(value).map_err(|error| invalid(&path, error.to_string()))?;
        if manifest.options.is_empty() || manifest.options.len() > MAX_OPTIONS {
            let reason = format!("{} options, expected 1 to {MAX_OPTIONS}", manifest.options.len());
            return Err(invalid(&path, reason));
        }
        let path = folder.join("options.safetensors");
        let bytes = read_capped(&path, Tensors::MAX_BYTES as u64)?;
        let tensors = Tensors::decode(&bytes).map_err(|error| invalid(&path, error.to_string()))?;
        let record = |(index, entry): (usize, &OptionEntry)| PolicyRecord {
            format: entry.policy.clone(),
            tensors: tensors.with_prefix(&format!("{index}.")),
        };
        let options = manifest.options.iter().enumerate().map(record).collect();
        Ok(Self { manifest, options })
    }

    /// The running policies for a simulator of this spec.
    ///
    /// # Errors
    /// [`OptionSetError::Mismatch`] naming both sides; a format that no plugin reads; tensors of another shape.
    pub fn policies(
        &self,
        spec: &SimulatorSpec,
        formats: &[PolicyFormat],
    ) -> Result<Vec<Box<dyn OptionPolicy>>, OptionSetError> {
        if let Some(difference) = self.manifest.spec.interface().difference(&spec.interface()) {
            return Err(OptionSetError::Mismatch(format!("{difference} (set against simulator)")));
        }
        let policy = |(index, record): (usize, &PolicyRecord)| {
            let fault = |error| OptionSetError::Mismatch(format!("option {index}: {error}"));
            record.policy(spec, formats).map_err(fault)
        };
        self.options.iter().enumerate().map(policy).collect()
    }
}

fn read_capped(path: &Path, cap: u64) -> Result<Vec<u8>, OptionSetError> {
    let fault = |source| OptionSetError::Read { path: path.to_owned(), source };
    let metadata = fs::metadata(path).map_err(fault)?;
    if !metadata.is_file() || metadata.len() > cap {
        let reason = format!("expected a regular file of at most {cap} bytes, got {} bytes", metadata.len());
        return Err(OptionSetError::Invalid { path: path.to_owned(), reason });
    }
    fs::read(path).map_err(fault)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::conformance::point_mass::PointMassConfig;

    fn sample() -> OptionSet {
        let mut tensors = Tensors::new();
        tensors.insert("actions", &[2, 1], vec![0.5, -0.5]);
        let record = PolicyRecord { format: "open_loop".to_owned(), tensors };
        let entry = |number| OptionEntry { number, policy: "open_loop".to_owned(), selection_score: 0.25 };
        let manifest = Manifest {
            format: OPTION_SET_FORMAT,
            metric: "maximum_mean".to_owned(),
            spec: PointMassConfig::default().description(),
            horizon: Horizon { steps: 2, discount: 1.0, stop_at_fall: true },
            scale: Scale { offset: -1.0, scale: 3.0 },
            reference: Reference { mean: 0.5, standard_deviation: 0.1 },
            options: vec![entry(3), entry(11)],
            experiment: serde_json::json!({"seed": 1}),
        };
        OptionSet { manifest, options: vec![record.clone(), record] }
    }

    fn write(folder: &Path, files: &[(&str, Vec<u8>)]) {
        for (name, bytes) in files {
            fs::write(folder.join(name), bytes).unwrap();
        }
    }

    #[test]
    fn a_folder_gives_back_the_set_that_was_written() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &sample().files());
        assert_eq!(OptionSet::read(folder.path()).unwrap(), sample());
    }

    #[test]
    fn sets_of_other_formats_robots_and_damaged_files_are_refused_with_both_sides_named() {
        let folder = tempfile::tempdir().unwrap();
        assert!(OptionSet::read(folder.path()).unwrap_err().to_string().contains("manifest.json"));

        let mut later = sample();
        later.manifest.format = 2;
        write(folder.path(), &later.files());
        let text = OptionSet::read(folder.path()).unwrap_err().to_string();
        assert!(text.contains("option-set format 2, this program reads format 1"), "{text}");

        let [(_, manifest), (_, tensors)] = sample().files();
        let torn = tensors[..tensors.len() - 1].to_vec();
        write(folder.path(), &[("manifest.json", manifest), ("options.safetensors", torn)]);
        assert!(OptionSet::read(folder.path()).unwrap_err().to_string().contains("options.safetensors"));

        let mut ant = PointMassConfig::default().description();
        ant.robot = "ant".to_owned();
        let text = sample().policies(&ant, &[]).unwrap_err().to_string();
        assert!(text.contains("robot point-mass against ant"), "{text}");
        let text = sample().policies(&PointMassConfig::default().description(), &[]).unwrap_err().to_string();
        assert!(text.contains("no plugin reads policies of format `open_loop`"), "{text}");
    }
}
