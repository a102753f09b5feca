//! `elo experiments`: the figures and tables of the paper for a finished run.

use elo_core::crew::Crew;
use elo_core::discover::{Run, discover};
use elo_core::experiment::Experiment;
use elo_core::experiments::{self, experiments};
use elo_core::plugin::Plugin;
use elo_core::report::report;

use crate::arguments::Experiments;
use crate::exit::Exit;
use crate::open::{ready_to_run, staff, with_crew};
use crate::output::print;
use crate::{experiments_table, load, paper};

/// Measures what is missing and prints it.
pub fn run(arguments: &Experiments, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let experiment = load::of_run(&arguments.run, plugins)?;
    ready_to_run(&experiment)?;
    let staff = staff(arguments.workers, plugins)?;
    let found = with_crew(&arguments.run, &experiment, staff, |crew| run_in(&experiment, crew))?;
    if arguments.json {
        let text = serde_json::to_string_pretty(&found).expect("figures are plain data");
        print(&format!("{text}\n"))
    } else {
        let confidence = experiment.report.confidence;
        let beside = paper::beside(std::slice::from_ref(&found), confidence);
        print(&(experiments_table::experiments(&found, confidence) + &experiments_table::beside(&beside)))
    }
}

/// Takes up the experiments of a run in the crew's run directory, and writes their results.
pub fn run_in(experiment: &Experiment, crew: &Crew<'_>) -> Result<experiments::Experiments, Exit> {
    let discovery = discover(experiment, crew)?;
    let run = Run::new(experiment, crew)?;
    let held_out = report(&run, &discovery)?;
    let found = experiments(&run, &discovery, &held_out)?;
    experiments::write(crew.run_dir, &found)?;
    Ok(found)
}
