//! `elo discover`: from a config to selected option sets.

use std::path::{Path, PathBuf};

use elo_core::config;
use elo_core::crew::{Crew, Staff};
use elo_core::discover::{Run, discover};
use elo_core::experiment::Experiment;
use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use elo_core::report::report;
use elo_core::results;
use elo_core::run_dir::RunDir;

use crate::arguments::Discover;
use crate::commands::plan;
use crate::exit::Exit;
use crate::hosts::Programs;
use crate::output::print;
use crate::progress::Progress;
use crate::worker::formats;
use crate::{interrupt, load, table};

/// Runs or takes up the experiment, then prints what it found.
pub fn run(arguments: &Discover, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let experiment = load::experiment(&arguments.config, &arguments.overrides, plugins)?;
    let workers = workers(arguments.workers)?;
    if arguments.plan {
        return print(&plan::plan(&experiment, workers)?);
    }
    ready_to_run(&experiment)?;
    let folder = arguments.out.clone().unwrap_or_else(|| default_folder(&arguments.config));
    if folder.exists() && !folder.is_dir() {
        return Err(Exit::BadInput(format!("--out: {} is no folder", folder.display())));
    }
    let run_dir = RunDir::open(&folder)?;
    let stop =
        interrupt::watch().map_err(|error| Exit::Failed(format!("cannot watch for signals: {error}")))?;
    let progress = Progress::new();
    let staff = Staff { workers, formats: formats(plugins), program: fingerprint() };
    let programs = Programs::of(&experiment);
    let crew = Crew::new(staff, &run_dir, &programs, &progress, &stop);

    let resolved = config::show(&experiment).map_err(|error| Exit::Failed(error.to_string()))?;
    run_dir.write_file("experiment.toml", resolved.as_bytes())?;
    run_dir.write_file("provenance.json", provenance(&experiment).as_bytes())?;

    let discovery = discover(&experiment, &crew)?;
    let run = Run::new(&experiment, &crew)?;
    let held_out = report(&run, &discovery)?;
    results::write(&run, &discovery, &held_out)?;

    if arguments.json {
        let text = serde_json::to_string_pretty(&held_out.report).expect("a report is plain data");
        print(&format!("{text}\n"))
    } else {
        let table = table::report(&held_out.report, experiment.report.confidence);
        print(&format!("{table}\nresults in {}\n", folder.join("results").display()))
    }
}

/// Refuses to begin what a missing engine would stop later.
pub fn ready_to_run(experiment: &Experiment) -> Result<(), Exit> {
    match experiment.simulator.hosted() {
        Some(hosted) => Programs::of(experiment).find(&hosted.worker()).map(|_| ()).map_err(Exit::BadInput),
        None => experiment.simulator.build().map(|_| ()).map_err(|error| Exit::BadInput(error.to_string())),
    }
}

/// As many workers as were asked for, or as there are processors.
pub fn workers(asked: Option<usize>) -> Result<usize, Exit> {
    match asked {
        Some(0) => Err(Exit::BadInput("`--workers`: expected at least 1, got 0".to_owned())),
        Some(count) => Ok(count),
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
    }
}

fn default_folder(config: &Path) -> PathBuf {
    Path::new("runs").join(config.file_stem().unwrap_or("run".as_ref()))
}

/// What the results depend on besides the config.
fn provenance(experiment: &Experiment) -> String {
    let value = serde_json::json!({
        "program": fingerprint(),
        "engine": experiment.simulator.engine(),
        "operating_system": std::env::consts::OS,
        "lock_file_blake3": env!("ELO_LOCK_HASH"),
        "commit": env!("ELO_COMMIT"),
        "compiler": env!("ELO_COMPILER"),
    });
    serde_json::to_string_pretty(&value).expect("plain data") + "\n"
}
