//! `elo crosscheck`: a finished run's options in the same contexts on other engines.

use std::path::Path;

use elo_core::crosscheck::crosscheck;
use elo_core::discover::{Run, discover, duplicate};
use elo_core::experiment::Experiment;
use elo_core::plugin::Plugin;
use toml::{Table, Value};

use crate::arguments::Crosscheck;
use crate::exit::Exit;
use crate::open::{ready_to_run, staff, with_crew};
use crate::output::print;
use crate::{load, table};

/// Measures the candidates of a run on each engine and prints how far the engines agree.
pub fn run(arguments: &Crosscheck, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let config = arguments.run.join("experiment.toml");
    let experiment = load::of_run(&arguments.run, plugins)?;
    if arguments.contexts < 2 {
        return Err(Exit::BadInput(format!("`--contexts`: expected at least 2, got {}", arguments.contexts)));
    }
    let others: Vec<Experiment> = arguments
        .simulators
        .iter()
        .map(|simulator| other(&config, simulator, plugins))
        .collect::<Result<_, _>>()?;
    let own = experiment.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
    for (given, other) in arguments.simulators.iter().zip(&others) {
        let spec = other.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
        if let Some(difference) = own.interface().difference(&spec.interface()) {
            return Err(Exit::BadInput(format!("--simulator {given}: the options do not fit: {difference}")));
        }
        ready_to_run(other)?;
    }
    ready_to_run(&experiment)?;

    // Which interpreter works may be said by any of the configs.
    let hosts = others.iter().chain([&experiment]).find(|e| in_interpreter(e)).unwrap_or(&experiment);
    let simulators: Vec<_> = others.iter().map(|other| duplicate(&other.simulator)).collect();
    let staff = staff(arguments.workers, plugins)?;
    let (found, json) = with_crew(&arguments.run, hosts, staff, |crew| {
        let discovery = discover(&experiment, crew)?;
        let found = crosscheck(&Run::new(&experiment, crew)?, &discovery, &simulators, arguments.contexts)?;
        let mut json = serde_json::to_vec_pretty(&found).expect("figures are plain data");
        json.push(b'\n');
        crew.run_dir.write_file("results/crosscheck.json", &json)?;
        Ok((found, json))
    })?;
    if arguments.json { print(&String::from_utf8_lossy(&json)) } else { print(&table::crosscheck(&found)) }
}

fn in_interpreter(experiment: &Experiment) -> bool {
    experiment.simulator.hosted().is_some_and(|hosted| hosted.worker().is_interpreter())
}

/// The run's experiment on another simulator: a kind, or a TOML file with a `[simulator]` table (and `[workers]`).
fn other(config: &Path, simulator: &str, plugins: &[&[Plugin]]) -> Result<Experiment, Exit> {
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
