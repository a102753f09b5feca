//! `elo compare`: the sets of two runs on common contexts.

use std::path::Path;

use elo_core::compare::{compare, incomparable};
use elo_core::discover::Run;
use elo_core::option_set::OptionSet;
use elo_core::plugin::Plugin;
use elo_core::policy::PolicyFormat;
use elo_core::report::Report;
use elo_core::results::folder_name;
use elo_core::spec::SimulatorSpec;

use crate::arguments::Compare;
use crate::exit::Exit;
use crate::open::{ready_to_run, staff, with_crew};
use crate::output::{print, print_json};
use crate::{load, table};

/// Measures the sets of both runs and prints the paired differences.
pub fn run(arguments: &Compare, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let experiment = load::of_run(&arguments.first, plugins)?;
    load::of_run(&arguments.second, plugins)?;
    let staff = staff(arguments.workers, plugins)?;
    let spec = experiment.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
    let first = sets(&arguments.first, &spec, &staff.formats)?;
    let second = sets(&arguments.second, &spec, &staff.formats)?;
    if let Some(why) = incomparable(&experiment.discover.horizon(), first.iter().chain(&second)) {
        return Err(Exit::BadInput(format!("{}: {why}", arguments.second.display())));
    }
    ready_to_run(&experiment)?;
    let found = with_crew(&arguments.first, &experiment, staff, |crew| {
        Ok(compare(&Run::new(&experiment, crew)?, &first, &second)?)
    })?;
    if arguments.json {
        print_json(&found)
    } else {
        let names = [&arguments.first, &arguments.second].map(|path| path.display().to_string());
        print(&table::compared(&found, &names))
    }
}

/// The option sets of a finished run, in the order of its report.
fn sets(folder: &Path, spec: &SimulatorSpec, formats: &[PolicyFormat]) -> Result<Vec<OptionSet>, Exit> {
    let path = folder.join("results/report.json");
    let bad = |error: String| Exit::BadInput(format!("{}: {error}", path.display()));
    let text = std::fs::read(&path).map_err(|error| bad(error.to_string()))?;
    let report: Report = serde_json::from_slice(&text).map_err(|error| bad(error.to_string()))?;
    let read = |metric: &str| {
        let folder = folder.join("results/option_sets").join(folder_name(metric));
        let set = OptionSet::read(&folder).map_err(|error| Exit::BadInput(error.to_string()))?;
        let fits = set.policies(spec, formats);
        fits.map_err(|error| Exit::BadInput(format!("{}: {error}", folder.display())))?;
        Ok(set)
    };
    report.sets.iter().map(|set| read(&set.metric)).collect()
}
