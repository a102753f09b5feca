//! A finished run on other simulators than its own.

use std::path::Path;

use elo_core::config;
use elo_core::crew::{Crew, RunError};
use elo_core::discover::Run;
use elo_core::experiment::Experiment;
use elo_core::fault::meant;
use elo_core::plugin::{Plugin, Role};
use elo_core::results;
use toml::{Table, Value};

use crate::exit::Exit;
use crate::hosts::Programs;
use crate::load;
use crate::open::ready_to_run;

/// The experiment of the run in `folder` on each simulator that the user named, all of them ready to run.
pub fn others(
    folder: &Path,
    experiment: &Experiment,
    simulators: &[String],
    plugins: &[&[Plugin]],
) -> Result<Vec<Experiment>, Exit> {
    let own = experiment.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
    let config = folder.join(results::CONFIG);
    let twice = simulators.iter().enumerate().find(|(i, given)| simulators[..*i].contains(given));
    if let Some((_, given)) = twice {
        return Err(Exit::BadInput(format!("--simulator {given}: is given twice")));
    }
    let read = |given: &String| {
        let other = on_simulator(&config, given, plugins)?;
        let spec = other.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
        if let Some(why) = own.incomparable(&spec) {
            return Err(Exit::BadInput(format!("--simulator {given}: {why}")));
        }
        ready_to_run(&other)?;
        Ok(other)
    };
    simulators.iter().map(read).collect()
}

/// Lets `work` have a run of each of `others` in the run directory of `crew`, done by workers as its own `[workers]` says.
pub fn with_runs<T>(
    others: &[Experiment],
    crew: &Crew<'_>,
    work: impl FnOnce(&[Run<'_>]) -> Result<T, RunError>,
) -> Result<T, RunError> {
    let programs: Vec<Programs> = others.iter().map(Programs::of).collect();
    let crews: Vec<Crew<'_>> = programs.iter().map(|programs| crew.hosted_by(programs)).collect();
    let runs = others.iter().zip(&crews).map(|(experiment, crew)| Run::new(experiment, crew));
    work(&runs.collect::<Result<Vec<_>, _>>()?)
}

/// The run's experiment on another simulator: a kind, or a TOML file with a `[simulator]` table (and `[workers]`).
fn on_simulator(config: &Path, simulator: &str, plugins: &[&[Plugin]]) -> Result<Experiment, Exit> {
    let path = Path::new(simulator);
    if path.extension().is_none() {
        let kinds: Vec<&str> = plugins
            .iter()
            .flat_map(|slice| slice.iter())
            .filter(|plugin| plugin.role == Role::Simulator)
            .map(|plugin| plugin.kind)
            .collect();
        if !kinds.contains(&simulator) {
            let hint = meant(simulator, kinds.iter().copied(), '`');
            return Err(Exit::BadInput(format!(
                "--simulator {simulator}: expected a kind of simulator ({}) or a TOML file{hint}",
                kinds.join(", ")
            )));
        }
        return load::experiment(config, &[format!("simulator.kind={simulator}")], plugins)
            .map_err(of_the_run);
    }
    let cannot = |why: String| Exit::BadInput(format!("--simulator {simulator}: {why}"));
    let read = |path: &Path| -> Result<Table, Exit> {
        load::read_text(path)?.parse().map_err(|error: toml::de::Error| cannot(error.to_string()))
    };
    let (mut whole, mut given) = (read(config)?, read(path)?);
    let table = given.remove("simulator").ok_or_else(|| cannot("it has no table [simulator]".to_owned()))?;
    whole.insert("simulator".to_owned(), table);
    match given.remove("workers") {
        Some(workers @ Value::Table(_)) => drop(whole.insert("workers".to_owned(), workers)),
        Some(other) => {
            return Err(cannot(format!("`workers`: expected a table, got the {} {other}", other.type_str())));
        }
        None => {}
    }
    // Of a whole config the rest is that of another run. A name that no config has is a slip.
    let schema = config::json_schema::<Experiment>(plugins);
    let known: Vec<&str> =
        schema["properties"].as_object().into_iter().flatten().map(|(name, _)| &**name).collect();
    if let Some(unknown) = given.keys().find(|name| !known.contains(&name.as_str())) {
        let hint = meant(unknown, known.iter().copied(), '`');
        return Err(cannot(format!("`{unknown}`: is unknown; expected one of {}{hint}", known.join(", "))));
    }
    load::embedded(&whole.to_string(), path, &[], plugins).map_err(of_the_run)
}

/// A fault of the run's config on another simulator.
fn of_the_run(exit: Exit) -> Exit {
    exit.with_hint(
        "--simulator takes the place of the run's [simulator], and its other tables stay: it must be the same robot",
    )
}
