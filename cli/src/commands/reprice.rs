//! `elo reprice`: a finished run under another range of tasks.

use elo_core::discover::{Run, discover};
use elo_core::fault::Faults;
use elo_core::plugin::Plugin;
use elo_core::report::report;
use elo_core::reprice::{refusal, reprice};
use elo_core::task::{Range, TaskDistribution};

use crate::arguments::Reprice;
use crate::exit::Exit;
use crate::open::{staff, with_crew};
use crate::output::{print, print_json};
use crate::{load, table};

/// Prices the run's rollouts anew and prints what came of it.
pub fn run(arguments: &Reprice, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let experiment = load::of_run(&arguments.run, plugins)?;
    let ranges = arguments.tasks.iter().map(|text| range(text)).collect::<Result<Vec<_>, _>>()?;
    let twice = ranges.iter().enumerate().find(|(i, (name, _))| ranges[..*i].iter().any(|(n, _)| n == name));
    if let Some((_, (name, _))) = twice {
        return Err(Exit::BadInput(format!("--tasks {name}: is given twice")));
    }
    let tasks = TaskDistribution::new(ranges).over(&experiment.tasks);
    let spec = experiment.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
    let mut faults = Faults::new();
    tasks.validate(&spec, &mut faults);
    if let Some(fault) = faults.found().first() {
        return Err(Exit::BadInput(format!("--tasks {}: {}", fault.path, fault.message)));
    }
    if let Some(why) = refusal(&spec, &experiment.tasks, &tasks) {
        return Err(Exit::BadInput(format!("--tasks: {why}")));
    }
    let found = with_crew(&arguments.run, &experiment, staff(None, plugins)?, |crew| {
        let discovery = discover(&experiment, crew)?;
        let run = Run::new(&experiment, crew)?;
        let held_out = report(&run, &discovery)?;
        Ok(reprice(&run, &discovery, &held_out, &tasks)?)
    })?;
    if arguments.json { print_json(&found) } else { print(&table::repriced(&found)) }
}

fn range(text: &str) -> Result<(&str, Range), Exit> {
    let parsed = text.split_once('=').and_then(|(name, range)| {
        let (low, high) = range.split_once("..")?;
        Some((name.trim(), Range { low: low.trim().parse().ok()?, high: high.trim().parse().ok()? }))
    });
    parsed.ok_or_else(|| {
        Exit::BadInput(format!(
            "`--tasks`: expected NAME=LOW..HIGH, e.g. electricity_cost=-4..-3, got {text}"
        ))
    })
}
