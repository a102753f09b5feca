//! Which programs do work outside this process, and within which limits: `[workers]` of a config.
//!
//! Nothing here enters a unit's key: where a program lies and how patient its caller is change no result.

use std::path::Path;
use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fault::Faults;
use crate::worker::Limits;

/// The variable of its environment that tells a worker [`Workers::step_seconds`].
pub const STEP_SECONDS: &str = "ELO_STEP_SECONDS";

/// See the [module](self).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Workers {
    /// Python for what is written in Python: a virtual environment's folder, an interpreter's path (both relative to the
    /// config file), or the name of one that the shell finds. The package `elo` must be installed in it.
    pub python: String,
    /// Folders, relative to the config file, from which it imports modules before its own.
    pub python_path: Vec<String>,
    /// Seconds that one step or reset of an environment in Python may take, one reading of its state, or one action of a teacher.
    /// Then the worker ends itself, and its unit is tried again. Imports, constructors and metrics may take as long as
    /// `silence_seconds` allow. Engines of this program's own are not watched.
    #[schemars(range(min = 0.001))]
    pub step_seconds: f64,
    /// Seconds without a word of progress (a rollout, a start that is drawn, a step of PPO) after which a worker is killed and
    /// its unit tried again.
    #[schemars(range(min = 0.1))]
    pub silence_seconds: f64,
    /// Address space of one worker in GiB, on systems that can limit it.
    #[schemars(range(min = 0.1))]
    pub memory_gib: f64,
}

impl Default for Workers {
    fn default() -> Self {
        Self {
            python: "python3".to_owned(),
            python_path: Vec::new(),
            step_seconds: 60.0,
            silence_seconds: 600.0,
            memory_gib: 16.0,
        }
    }
}

impl Workers {
    /// Makes paths absolute: they are relative to `folder`, the config's. A folder is a virtual environment.
    pub fn resolve(&mut self, folder: &Path) {
        let absolute = |path: &str| {
            let joined = folder.join(path);
            std::path::absolute(&joined).unwrap_or(joined)
        };
        let there = absolute(&self.python);
        if there.is_dir() {
            self.python = there.join("bin").join("python").to_string_lossy().into_owned();
        } else if self.python.contains('/') {
            self.python = there.to_string_lossy().into_owned();
        }
        for path in &mut self.python_path {
            *path = absolute(path).to_string_lossy().into_owned();
        }
    }

    /// Finds faults that the schema's ranges do not show.
    pub fn validate(&self, faults: &mut Faults) {
        for (field, value) in [
            ("step_seconds", self.step_seconds),
            ("silence_seconds", self.silence_seconds),
            ("memory_gib", self.memory_gib),
        ] {
            faults.check(value.is_finite() && value > 0.0 && value < 1e9, field, || {
                format!("expected a positive number below 1e9, got {value}")
            });
        }
        faults.check(!self.python.is_empty(), "python", || {
            "expected an interpreter or a virtual environment, got \"\"".to_owned()
        });
    }

    /// Finds folders of `python_path` from which nothing can be imported. To be asked where an interpreter is needed: a run that was
    /// done elsewhere can be read without them.
    pub fn check_folders(&self, faults: &mut Faults) {
        for (i, path) in self.python_path.iter().enumerate() {
            let field = format!("python_path[{i}]");
            faults.check(Path::new(path).exists(), &field, || {
                format!("there is no {path}; expected a folder with modules, relative to the config file")
            });
            faults.check(std::env::join_paths([path]).is_ok(), &field, || {
                format!("{path} has the character in it that separates folders in PYTHONPATH; rename or move the folder")
            });
        }
    }

    /// What a worker process may take.
    pub fn limits(&self) -> Limits {
        Limits {
            greeting: Duration::from_secs(60),
            silence: Some(Duration::from_secs_f64(self.silence_seconds)),
            memory_bytes: Some((self.memory_gib * f64::from(1 << 30)) as u64),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn paths_are_relative_to_the_config_and_names_are_left_to_the_shell() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("venv")).unwrap();
        let resolved = |python: &str| {
            let mut workers = Workers { python: python.to_owned(), ..Workers::default() };
            workers.python_path = vec!["envs".to_owned(), "/opt/envs".to_owned()];
            workers.resolve(folder.path());
            assert_eq!(workers.python_path, [folder.path().join("envs").to_str().unwrap(), "/opt/envs"]);
            workers.python
        };
        assert_eq!(resolved("python3"), "python3");
        assert_eq!(resolved("venv"), folder.path().join("venv/bin/python").to_str().unwrap());
        assert_eq!(resolved("other/bin/python"), folder.path().join("other/bin/python").to_str().unwrap());
        assert_eq!(resolved("/usr/bin/python3"), "/usr/bin/python3");
    }

    #[cfg(unix)]
    #[test]
    fn folders_from_which_nothing_can_be_imported_are_faults() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("a:b")).unwrap();
        let python_path = ["", "a:b", "gone"].map(str::to_owned).to_vec();
        let mut workers = Workers { python_path, ..Workers::default() };
        workers.resolve(folder.path());
        let mut faults = Faults::new();
        workers.check_folders(&mut faults);
        let found: Vec<String> = faults.into_found().iter().map(ToString::to_string).collect();
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(
            found[0].starts_with("`python_path[1]`: ") && found[0].contains("a:b has the character"),
            "{found:?}"
        );
        assert!(
            found[1].starts_with("`python_path[2]`: there is no ") && found[1].contains("gone; "),
            "{found:?}"
        );
    }
}
