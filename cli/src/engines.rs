//! A finished run on other simulators than its own.

use std::path::Path;

use elo_core::experiment::Experiment;
use elo_core::plugin::Plugin;
use toml::{Table, Value};

use crate::exit::Exit;
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
    let config = folder.join("experiment.toml");
    let twice = simulators.iter().enumerate().find(|(i, given)| simulators[..*i].contains(given));
    if let Some((_, given)) = twice {
        return Err(Exit::BadInput(format!("--simulator {given}: is given twice")));
    }
    let read = |given: &String| {
        let other = on_simulator(&config, given, plugins)?;
        let spec = other.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
        if let Some(difference) = own.interface().difference(&spec.interface()) {
            return Err(Exit::BadInput(format!("--simulator {given}: the options do not fit: {difference}")));
        }
        ready_to_run(&other)?;
        Ok(other)
    };
    simulators.iter().map(read).collect()
}

/// Which of the experiments says which interpreter works: any of them may.
pub fn hosts<'a>(own: &'a Experiment, others: &'a [Experiment]) -> &'a Experiment {
    let interprets =
        |e: &&Experiment| e.simulator.hosted().is_some_and(|hosted| hosted.worker().is_interpreter());
    others.iter().chain([own]).find(interprets).unwrap_or(own)
}

/// The run's experiment on another simulator: a kind, or a TOML file with a `[simulator]` table (and `[workers]`).
fn on_simulator(config: &Path, simulator: &str, plugins: &[&[Plugin]]) -> Result<Experiment, Exit> {
    let path = Path::new(simulator);
    if path.extension().is_none() {
        return load::experiment(config, &[format!("simulator.kind={simulator}")], plugins);
    }
    let cannot = |why: String| Exit::BadInput(format!("--simulator {simulator}: {why}"));
    let read = |path: &Path| -> Result<Table, Exit> {
        load::read_text(path)?.parse().map_err(|error: toml::de::Error| cannot(error.to_string()))
    };
    let (mut whole, mut given) = (read(config)?, read(path)?);
    let table = given.remove("simulator").ok_or_else(|| cannot("it has no table [simulator]".to_owned()))?;
    whole.insert("simulator".to_owned(), table);
    if let Some(workers @ Value::Table(_)) = given.remove("workers") {
        whole.insert("workers".to_owned(), workers);
    }
    load::embedded(&whole.to_string(), path, &[], plugins)
}
