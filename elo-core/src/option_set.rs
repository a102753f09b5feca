//! The artefact that users keep: a folder with `options.safetensors` and `manifest.json`.
//!
//! Tensors of option `i` are named `i.<tensor>`; the manifest says which format reads them. Reading one runs no code and
//! is bounded: sizes are checked before anything is allocated, numbers that are not finite are refused, and so are tensors
//! whose hash is not the manifest's. Sets of format 1 have no hash; they are read all the same.

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
pub const OPTION_SET_FORMAT: u32 = 2;

/// The first format whose manifests have a hash of the tensors. Sets of those before are read without.
const HASHED_FORMAT: u32 = 2;

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
    /// BLAKE3 of `options.safetensors` in hexadecimal digits. It is there in files alone: added when they are written, compared
    /// and taken out when they are read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tensors_blake3: Option<String>,
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
    /// The first number that no set can have, by its place in the file.
    fn fault(&self) -> Option<String> {
        let SimulatorSpec { observation_size, action_low, action_high, control_step, .. } = &self.spec;
        let Horizon { steps, discount, .. } = self.horizon;
        let ordered = |(low, high): (&f32, &f32)| low <= high;
        if *observation_size == 0 {
            Some("`spec.observation_size`: expected at least 1, got 0".to_owned())
        } else if action_low.is_empty() || action_low.len() != action_high.len() {
            let (low, high) = (action_low.len(), action_high.len());
            Some(format!(
                "`spec.action_low` and `spec.action_high`: expected as many numbers, at least 1, got {low} and {high}"
            ))
        } else if let Some(i) = action_low.iter().zip(action_high).position(|bounds| !ordered(bounds)) {
            let (low, high) = (action_low[i], action_high[i]);
            Some(format!(
                "`spec.action_low[{i}]`: expected at most `spec.action_high[{i}]`, {high}, got {low}"
            ))
        } else if !(control_step.is_finite() && *control_step > 0.0) {
            Some(format!("`spec.control_step`: expected a number above 0, got {control_step}"))
        } else if steps == 0 {
            Some("`horizon.steps`: expected at least 1, got 0".to_owned())
        } else if !(discount > 0.0 && discount <= 1.0) {
            Some(format!("`horizon.discount`: expected a number above 0 and at most 1, got {discount}"))
        } else {
            None
        }
    }

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
        let tensors = tensors.encode();
        let mut manifest = self.manifest.clone();
        manifest.tensors_blake3 = (manifest.format >= HASHED_FORMAT).then(|| hash(&tensors));
        let mut manifest = serde_json::to_vec_pretty(&manifest).expect("a manifest is plain data");
        manifest.push(b'\n');
        [("manifest.json", manifest), ("options.safetensors", tensors)]
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
        if !path.exists() {
            return Err(OptionSetError::Invalid { path: folder.to_owned(), reason: no_set(folder) });
        }
        let text = read_capped(&path, MAX_MANIFEST_BYTES)?;
        let invalid = |path: &Path, reason: String| OptionSetError::Invalid { path: path.to_owned(), reason };
        let value: serde_json::Value =
            serde_json::from_slice(&text).map_err(|error| invalid(&path, format!("not JSON: {error}")))?;
        let format = value.get("format").and_then(serde_json::Value::as_u64);
        if !format.is_some_and(|format| (1..=u64::from(OPTION_SET_FORMAT)).contains(&format)) {
            let got = format.map_or("none".to_owned(), |number| number.to_string());
            let reason =
                format!("option-set format {got}, this program reads formats 1 to {OPTION_SET_FORMAT}");
            return Err(invalid(&path, reason));
        }
        let mut manifest: Manifest =
            serde_json::from_value(value).map_err(|error| invalid(&path, error.to_string()))?;
        if let Some(fault) = manifest.fault() {
            return Err(invalid(&path, fault));
        }
        if manifest.options.is_empty() || manifest.options.len() > MAX_OPTIONS {
            let reason = format!("{} options, expected 1 to {MAX_OPTIONS}", manifest.options.len());
            return Err(invalid(&path, reason));
        }
        let stored = manifest.tensors_blake3.take();
        if stored.is_none() && manifest.format >= HASHED_FORMAT {
            let reason = format!("`tensors_blake3` is missing, which format {} has", manifest.format);
            return Err(invalid(&path, reason));
        }
        let path = folder.join("options.safetensors");
        let bytes = read_capped(&path, Tensors::MAX_BYTES as u64)?;
        let tensors = Tensors::decode(&bytes).map_err(|error| invalid(&path, error.to_string()))?;
        if let Some(stored) = stored.filter(|stored| *stored != hash(&bytes)) {
            let reason = format!(
                "its BLAKE3 is {}, in the manifest it is {stored}: one of both files is damaged or of another set; copy both again",
                hash(&bytes)
            );
            return Err(invalid(&path, reason));
        }
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

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Why a folder without a manifest is no option set, with those that lie in it or beside it.
fn no_set(folder: &Path) -> String {
    let sets = |place: &Path| -> Vec<String> {
        let folders = fs::read_dir(place).into_iter().flatten().flatten().map(|entry| entry.path());
        let sets = folders.filter(|path| path.join("manifest.json").is_file());
        let mut sets: Vec<String> = sets.map(|path| path.display().to_string()).collect();
        sets.sort();
        sets
    };
    let mut near = sets(folder);
    near.extend(folder.parent().map(sets).unwrap_or_default());
    let hint = if near.is_empty() {
        "`elo discover` writes option sets to RUN/results/option_sets/METRIC".to_owned()
    } else {
        format!("there is {}", near.join(", "))
    };
    format!("is no option set: it has no manifest.json; {hint}")
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
            tensors_blake3: None,
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
        let (here, beside) = (folder.path().join("here"), folder.path().join("minimum_mean"));
        fs::create_dir(&here).unwrap();
        write(&here, &sample().files());
        for missing in [&beside, folder.path()] {
            let text = OptionSet::read(missing).unwrap_err().to_string();
            let near = format!("is no option set: it has no manifest.json; there is {}", here.display());
            assert!(text.contains(&near), "{text}");
        }

        let mut later = sample();
        later.manifest.format = 3;
        write(folder.path(), &later.files());
        let text = OptionSet::read(folder.path()).unwrap_err().to_string();
        assert!(text.contains("option-set format 3, this program reads formats 1 to 2"), "{text}");

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

    #[test]
    fn a_bit_that_flipped_anywhere_in_the_tensors_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let [manifest, (name, tensors)] = sample().files();
        for bit in 0..8 * tensors.len() {
            let mut damaged = tensors.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            write(folder.path(), &[manifest.clone(), (name, damaged)]);
            let read = OptionSet::read(folder.path());
            assert!(read.is_err_and(|error| error.to_string().contains("options.safetensors")), "{bit}");
        }
        // A set of the first format has no hash; one of this format must have it.
        let without = |format: u32| {
            let mut manifest = sample().manifest;
            manifest.format = format;
            let manifest = ("manifest.json", serde_json::to_vec(&manifest).unwrap());
            write(folder.path(), &[manifest, (name, tensors.clone())]);
            OptionSet::read(folder.path()).map(|set| set.options)
        };
        assert_eq!(without(1).unwrap(), sample().options);
        let text = without(2).unwrap_err().to_string();
        assert!(text.contains("manifest.json: `tensors_blake3` is missing, which format 2 has"), "{text}");
    }

    #[test]
    fn numbers_that_no_set_can_have_are_refused_with_their_place() {
        let folder = tempfile::tempdir().unwrap();
        type Change = fn(&mut Manifest);
        let changes: [(Change, &str); 8] = [
            (
                |m| m.spec.action_low[0] = 2.0,
                "`spec.action_low[0]`: expected at most `spec.action_high[0]`, 1, got 2",
            ),
            (|m| m.spec.action_low.push(0.0), "expected as many numbers, at least 1, got 2 and 1"),
            (|m| m.spec.action_high.clear(), "got 1 and 0"),
            (|m| m.spec.control_step = -1.0, "`spec.control_step`: expected a number above 0, got -1"),
            (|m| m.spec.observation_size = 0, "`spec.observation_size`: expected at least 1, got 0"),
            (|m| m.horizon.steps = 0, "`horizon.steps`: expected at least 1, got 0"),
            (
                |m| m.horizon.discount = 0.0,
                "`horizon.discount`: expected a number above 0 and at most 1, got 0",
            ),
            (|m| m.horizon.discount = 1.5, "got 1.5"),
        ];
        for (change, said) in changes {
            let mut set = sample();
            change(&mut set.manifest);
            write(folder.path(), &set.files());
            let text = OptionSet::read(folder.path()).unwrap_err().to_string();
            assert!(text.contains("manifest.json: ") && text.contains(said), "{said}: {text}");
        }
    }
}
