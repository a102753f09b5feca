//! `elo experiments`: the figures and tables of the paper for a finished run.

use elo_core::discover::{Discovery, Run, discover};
use elo_core::experiments::{self, experiments};
use elo_core::plugin::Plugin;
use elo_core::report::{HeldOut, report};

use crate::arguments::Experiments;
use crate::exit::Exit;
use crate::open::{ready_to_run, staff, with_crew};
use crate::output::{print, print_json};
use crate::{experiments_table, load, paper};

/// Measures what is missing and prints it.
pub fn run(arguments: &Experiments, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let experiment = load::of_run(&arguments.run, plugins)?;
    ready_to_run(&experiment)?;
    let staff = staff(arguments.workers, plugins)?;
    let found = with_crew(&arguments.run, &experiment, staff, |crew| {
        let run = Run::new(&experiment, crew)?;
        let discovery = discover(&experiment, crew)?;
        let held_out = report(&run, &discovery)?;
        run_in(&run, &discovery, &held_out)
    })?;
    if arguments.json {
        print_json(&found)
    } else {
        let confidence = experiment.report.confidence;
        let beside = paper::beside(std::slice::from_ref(&found), confidence);
        print(&(experiments_table::experiments(&found, confidence) + &experiments_table::beside(&beside)))
    }
}

/// Takes up the experiments of a run in its crew's run directory, and writes their results.
pub fn run_in(
    run: &Run<'_>,
    discovery: &Discovery,
    held_out: &HeldOut,
) -> Result<experiments::Experiments, Exit> {
    let found = experiments(run, discovery, held_out)?;
    experiments::write(run.crew.run_dir, &found)?;
    Ok(found)
}
