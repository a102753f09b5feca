//! `elo crosscheck`: a finished run's options in the same contexts on other engines.

use elo_core::crosscheck::crosscheck;
use elo_core::discover::{Run, discover};
use elo_core::plugin::Plugin;

use crate::arguments::Crosscheck;
use crate::engines::{others, with_runs};
use crate::exit::Exit;
use crate::open::{ready_to_run, staff, with_crew};
use crate::output::{print, print_json};
use crate::{load, table};

/// Measures the candidates of a run on each engine and prints how far the engines agree.
pub fn run(arguments: &Crosscheck, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let experiment = load::of_run(&arguments.run, plugins)?;
    if arguments.contexts < 2 {
        return Err(Exit::BadInput(format!("`--contexts`: expected at least 2, got {}", arguments.contexts)));
    }
    let others = others(&arguments.run, &experiment, &arguments.simulators, plugins)?;
    ready_to_run(&experiment)?;

    let staff = staff(arguments.workers, plugins)?;
    let found = with_crew(&arguments.run, &experiment, staff, |crew| {
        let discovery = discover(&experiment, crew)?;
        let own = Run::new(&experiment, crew)?;
        let found =
            with_runs(&others, crew, |others| crosscheck(&own, &discovery, others, arguments.contexts))?;
        crew.run_dir.write_json("results/crosscheck.json", &found)?;
        Ok(found)
    })?;
    if arguments.json { print_json(&found) } else { print(&table::crosscheck(&found)) }
}
