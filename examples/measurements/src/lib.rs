//! What the programs of this package share. Each measures something of the robots through the library and prints CSV.

use std::error::Error;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use elo_cli::hosts::Programs;
use elo_core::crew::{Crew, Staff, Watcher};
use elo_core::experiment::Experiment;
use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use elo_core::run_dir::RunDir;
use elo_core::simulator::SimulatorConfig;
use serde_json::{Value, json};

/// What configs may name.
pub const PLUGINS: [&[Plugin]; 3] = [elo_core::plugin::PLUGINS, elo_backends::PLUGINS, elo_learners::PLUGINS];

/// Whatever stops a measurement.
pub type Failure = Box<dyn Error + Send + Sync>;

/// Lets `work` have a crew for `experiment`, as many workers as there are cores, with its results in `folder`. Programs of
/// workers (`elo-mujoco`) are those beside this one.
///
/// # Errors
/// A folder that is no run directory, and those of `work`.
pub fn with_crew<T>(
    experiment: &Experiment,
    folder: &Path,
    watcher: &dyn Watcher,
    work: impl FnOnce(&Crew<'_>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let run_dir = RunDir::open(folder)?;
    let (stop, hosts) = (AtomicBool::new(false), Programs::of(experiment));
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    let staff = Staff { workers, formats: elo_cli::formats(&PLUGINS), program: fingerprint() };
    work(&Crew::new(staff, &run_dir, &hosts, watcher, &stop))
}

/// A plugin's config: its kind and its other fields.
///
/// # Errors
/// An unknown kind or field, or a value of another type.
pub fn plugin<T: serde::de::DeserializeOwned>(kind: &str, fields: &[(&str, Value)]) -> Result<T, Failure> {
    // Plugins are found by their kind, so their crates must be linked.
    let _linked = PLUGINS;
    let mut table = json!({ "kind": kind });
    for (field, value) in fields {
        table[*field] = value.clone();
    }
    Ok(serde_json::from_value(table)?)
}

/// A robot of ours in an engine.
///
/// # Errors
/// See [`plugin`].
pub fn robot(engine: &str, robot: &str) -> Result<Box<dyn SimulatorConfig>, Failure> {
    plugin(engine, &[("robot", robot.into())])
}
