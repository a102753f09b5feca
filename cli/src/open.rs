//! A run directory with a crew at work in it: what all commands that measure have in common.

use std::path::Path;

use elo_core::crew::{Crew, Staff};
use elo_core::experiment::Experiment;
use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use elo_core::run_dir::RunDir;

use crate::exit::Exit;
use crate::hosts::Programs;
use crate::interrupt;
use crate::progress::Progress;
use crate::worker::formats;

/// Opens `folder` as a run directory and lets a crew do `work` in it, with workers as the `experiment` says.
pub fn with_crew<T>(
    folder: &Path,
    experiment: &Experiment,
    staff: Staff,
    work: impl FnOnce(&Crew<'_>) -> Result<T, Exit>,
) -> Result<T, Exit> {
    let run_dir = RunDir::open(folder)?;
    let stop =
        interrupt::watch().map_err(|error| Exit::Failed(format!("cannot watch for signals: {error}")))?;
    let (progress, programs) = (Progress::new(), Programs::of(experiment));
    work(&Crew::new(staff, &run_dir, &programs, &progress, &stop))
}

/// As many workers as `--workers` asks for, or as there are processors.
pub fn staff(workers: Option<usize>, plugins: &[&[Plugin]]) -> Result<Staff, Exit> {
    let workers = match workers {
        Some(0) => return Err(Exit::BadInput("`--workers`: expected at least 1, got 0".to_owned())),
        Some(count) => count,
        None => std::thread::available_parallelism().map_or(1, usize::from),
    };
    Ok(Staff { workers, formats: formats(plugins), program: fingerprint() })
}

/// Refuses to begin what a missing engine would stop later.
pub fn ready_to_run(experiment: &Experiment) -> Result<(), Exit> {
    match experiment.simulator.hosted() {
        Some(hosted) => Programs::of(experiment).find(&hosted.worker()).map(|_| ()).map_err(Exit::BadInput),
        None => experiment.simulator.build().map(|_| ()).map_err(|error| Exit::BadInput(error.to_string())),
    }
}
