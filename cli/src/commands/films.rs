//! The films of a page's replay: chosen options and random torque in the first held-out contexts.

use std::path::Path;

use elo_core::discover::{Run, discover};
use elo_core::experiment::Experiment;
use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use elo_core::replay::{Replay, replays};
use elo_core::results;

use crate::arguments::Report;
use crate::engines::{others, with_runs};
use crate::exit::Exit;
use crate::load;
use crate::open::{ready_to_run, staff, with_crew};
use crate::output::print_error;

/// One replay an engine. None where nothing can be filmed without doing the run again, which is said on stderr.
pub fn films(arguments: &Report, folder: &Path, plugins: &[&[Plugin]]) -> Result<Vec<Replay>, Exit> {
    if arguments.replays == 0 {
        return Ok(Vec::new());
    }
    let experiment = load::experiment(&folder.join(results::CONFIG), &[], plugins)?;
    let simulators: Vec<String> = arguments.simulator.iter().cloned().collect();
    let others = others(folder, &experiment, &simulators, plugins)?;
    if let Some(why) = unfilmable(&experiment, folder) {
        print_error(&format!("{}: no replay, because {why}", folder.display()));
        return Ok(Vec::new());
    }
    let staff = staff(arguments.workers, plugins)?;
    with_crew(folder, &experiment, staff, |crew| {
        let discovery = discover(&experiment, crew)?;
        let own = Run::new(&experiment, crew)?;
        Ok(with_runs(&others, crew, |others| replays(&own, &discovery, others, arguments.replays))?)
    })
}

/// Why a run's rollouts cannot be filmed.
fn unfilmable(experiment: &Experiment, folder: &Path) -> Option<String> {
    let provenance = std::fs::read_to_string(folder.join(results::PROVENANCE)).unwrap_or_default();
    let made_by = serde_json::from_str::<serde_json::Value>(&provenance).unwrap_or_default();
    let program = made_by["program"].as_str().unwrap_or("an unknown program").to_owned();
    if program != fingerprint() {
        return Some(format!("{program} made it: this program would have to do the whole run again"));
    }
    ready_to_run(experiment).err().map(|error| error.to_string())
}
