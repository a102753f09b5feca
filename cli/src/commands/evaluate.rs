//! `elo evaluate`: an option set on fresh contexts, on any simulator of its robot.

use elo_core::discover::Run;
use elo_core::evaluate::evaluate;
use elo_core::experiment::Experiment;
use elo_core::option_set::OptionSet;
use elo_core::plugin::Plugin;
use serde_json::Value;

use crate::arguments::Evaluate;
use crate::exit::Exit;
use crate::open::{ready_to_run, staff, with_crew};
use crate::output::{print, print_json};
use crate::{load, table};

/// Measures the set and prints its figures.
pub fn run(arguments: &Evaluate, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let set = OptionSet::read(&arguments.option_set).map_err(|error| Exit::BadInput(error.to_string()))?;
    let experiment = experiment(&set, arguments, plugins)?;
    let staff = staff(arguments.workers, plugins)?;
    let spec = experiment.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
    set.policies(&spec, &staff.formats).map_err(|error| {
        Exit::BadInput(format!("{}: {error}", arguments.option_set.join("manifest.json").display()))
    })?;
    ready_to_run(&experiment)?;

    let temporary =
        tempfile::tempdir().map_err(|error| Exit::Failed(format!("no temporary folder: {error}")))?;
    let folder = arguments.out.as_deref().unwrap_or(temporary.path());
    let evaluation =
        with_crew(folder, &experiment, staff, |crew| Ok(evaluate(&Run::new(&experiment, crew)?, &set)?))?;
    if arguments.json { print_json(&evaluation) } else { print(&table::evaluation(&evaluation)) }
}

/// The experiment that made the set, with another seed and the user's changes.
fn experiment(set: &OptionSet, arguments: &Evaluate, plugins: &[&[Plugin]]) -> Result<Experiment, Exit> {
    let manifest = arguments.option_set.join("manifest.json");
    let unreadable =
        |error: String| Exit::BadInput(format!("{}: its experiment: {error}", manifest.display()));
    let text = toml::to_string(&without_nulls(&set.manifest.experiment))
        .map_err(|error| unreadable(error.to_string()))?;
    let made_with = set.manifest.experiment.get("seed").and_then(Value::as_u64).unwrap_or(0);
    let mut overrides = vec![format!("seed={}", arguments.seed.unwrap_or(made_with.wrapping_add(1)))];
    overrides.push(format!("discover.steps={}", set.manifest.horizon.steps));
    overrides.extend(arguments.overrides.iter().cloned());
    load::embedded(&text, &manifest, &overrides, plugins)
}

/// TOML has no null: a field that is `None` is left out.
fn without_nulls(value: &Value) -> Value {
    match value {
        Value::Object(fields) => {
            let kept = fields.iter().filter(|(_, field)| !field.is_null());
            Value::Object(kept.map(|(name, field)| (name.clone(), without_nulls(field))).collect())
        }
        Value::Array(items) => Value::Array(items.iter().map(without_nulls).collect()),
        scalar => scalar.clone(),
    }
}
