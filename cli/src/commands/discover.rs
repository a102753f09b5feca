//! `elo discover`: from a config to selected option sets.

use std::path::{Path, PathBuf};

use elo_core::config;
use elo_core::discover::{Discovery, Run, discover};
use elo_core::experiment::Experiment;
use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use elo_core::report::{HeldOut, report};
use elo_core::results;

use crate::arguments::Discover;
use crate::commands::plan;
use crate::exit::Exit;
use crate::open::{ready_to_run, rehearse, staff, with_crew};
use crate::output::{print, print_error, print_json};
use crate::{load, table};

/// Runs or takes up the experiment, then prints what it found.
pub fn run(arguments: &Discover, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let experiment = load::experiment(&arguments.config, &arguments.overrides, plugins)?;
    let staff = staff(arguments.workers, plugins)?;
    if arguments.plan {
        rehearse(&experiment)?;
        return print(&plan::plan(&experiment, staff.workers)?);
    }
    ready_to_run(&experiment)?;
    let folder = arguments.out.clone().unwrap_or_else(|| default_folder(&arguments.config));
    if folder.exists() && !folder.is_dir() {
        return Err(Exit::BadInput(format!("--out: {} is no folder", folder.display())));
    }
    warn_of_other_results(&folder, &experiment);
    let report =
        with_crew(&folder, &experiment, staff, |crew| Ok(run_in(&Run::new(&experiment, crew)?)?.1.report))?;

    if arguments.json {
        print_json(&report)
    } else {
        let table = table::report(&report, experiment.report.confidence);
        print(&format!("{table}\nresults in {}\n", folder.join("results").display()))
    }
}

/// Says so where a run directory has the results of another config.
fn warn_of_other_results(folder: &Path, experiment: &Experiment) {
    let there = std::fs::read_to_string(folder.join(results::CONFIG));
    if there.is_ok_and(|there| resolved(experiment).is_ok_and(|ours| ours != there)) {
        print_error(&format!(
            "{}: the results there are of another config; this run will replace them (--out names another folder)",
            folder.display()
        ));
    }
}

/// The config as it is stored, every default written out.
fn resolved(experiment: &Experiment) -> Result<String, Exit> {
    config::show(experiment).map_err(|error| Exit::Failed(error.to_string()))
}

/// Runs or takes up an experiment in its crew's run directory, and writes its results.
pub fn run_in(run: &Run<'_>) -> Result<(Discovery, HeldOut), Exit> {
    let Run { experiment, crew, .. } = *run;
    crew.run_dir.write_file("experiment.toml", resolved(experiment)?.as_bytes())?;
    let discovery = discover(experiment, crew)?;
    let held_out = report(run, &discovery)?;
    results::write(run, &discovery, &held_out, &provenance(experiment))?;
    Ok((discovery, held_out))
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
