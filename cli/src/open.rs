//! A run directory with a crew at work in it: what all commands that measure have in common.

use std::path::Path;

use elo_core::crew::{Crew, Staff};
use elo_core::discover::duplicate;
use elo_core::experiment::Experiment;
use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use elo_core::policy::Unwatched;
use elo_core::run_dir::RunDir;
use elo_core::units::Work;
use elo_core::units::rehearse::{Rehearse, Rehearsed};
use elo_core::workforce::{Job, TRIES, Workforce};

use crate::exit::Exit;
use crate::hosts::Programs;
use crate::interrupt;
use crate::output::print_error;
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

/// Refuses to begin what a missing engine, or a fault in a user's environment, would stop later.
pub fn ready_to_run(experiment: &Experiment) -> Result<(), Exit> {
    match experiment.simulator.hosted() {
        Some(hosted) => Programs::of(experiment).find(&hosted.worker()).map(drop).map_err(Exit::BadInput)?,
        None => experiment.simulator.build().map(drop).map_err(|error| Exit::BadInput(error.to_string()))?,
    }
    rehearse(experiment)
}

/// Tries an environment of the user in a short episode. Engines of this project have been through more than that.
pub fn rehearse(experiment: &Experiment) -> Result<(), Exit> {
    let Some(hosted) = experiment.simulator.hosted().filter(|hosted| hosted.needs_description()) else {
        return Ok(());
    };
    let programs = Programs::of(experiment);
    let work = Work::from(Rehearse(duplicate(&experiment.simulator)));
    let work = serde_json::to_vec(&work).expect("descriptions are plain data");
    let job = Job { program: hosted.worker(), work: &work, inputs: &[], workers: TRIES };
    let play = || -> Result<Rehearsed, String> {
        let done = Workforce::new(&programs).run(job, &mut Unwatched, &mut |_| ());
        Rehearsed::decode(&done.map_err(|error| error.to_string())?).map_err(|error| error.to_string())
    };
    // Units are done by several processes.
    let (here, there) = std::thread::scope(|scope| {
        let there = scope.spawn(play);
        (play(), there.join().unwrap_or_else(|_| Err("its thread panicked".to_owned())))
    });
    let bad = |why: String| {
        Exit::BadInput(format!("`simulator`: a short trial before any work failed: {why}\n{ALL_RULES}"))
    };
    let (here, there) = (here.map_err(bad)?, there.map_err(bad)?);
    let within = here.differed_at.or(there.differed_at).map(|step| (step, ""));
    let between = here.parting_from(&there).map(|step| (step, " in another process"));
    if let Some((step, whereabouts)) = within.or(between) {
        let place = if step == 0 { "its reset".to_owned() } else { format!("step {step}") };
        print_error(&format!(
            "warning: `simulator`: the same seed and actions gave another episode{whereabouts}, from {place} on. Results cannot be \
             repeated, and contexts that are called the same are not.\n{ALL_RULES}"
        ));
    }
    Ok(())
}

/// What to do about it.
const ALL_RULES: &str = "`elo.conformance.simulator`, in Python, tries all rules of an environment.";
