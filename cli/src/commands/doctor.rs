//! `elo doctor`: which engines were found, and what to run for those that are missing.

use std::fmt::Write as _;
use std::path::Path;

use elo_core::hosted::Hosted;
use elo_core::plugin::{Plugin, Role};
use elo_core::simulator::SimulatorConfig;
use elo_core::workers::Workers;
use elo_core::workforce::Hosts as _;

use crate::arguments::Doctor;
use crate::exit::Exit;
use crate::hosts::{Programs, remedy};
use crate::load;
use crate::output::print;
use crate::worker::build;

/// Looks for every engine and says what it found.
pub fn run(arguments: &Doctor, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let workers = arguments.config.as_deref().map_or(Ok(Workers::default()), workers)?;
    let programs = Programs { workers };
    let mut text = format!("{}\n", build());
    let simulators =
        plugins.iter().flat_map(|slice| slice.iter()).filter(|plugin| plugin.role == Role::Simulator);
    for plugin in simulators {
        let config: Box<dyn SimulatorConfig> =
            serde_json::from_value((plugin.default_config)()).expect("a default config reads back");
        let _ = writeln!(text, "{:<12} {}", plugin.kind, finding(config.as_ref(), &programs));
    }
    print(&text)
}

/// The `[workers]` of a config, whose other tables may have faults.
fn workers(config: &Path) -> Result<Workers, Exit> {
    let bad = |error: toml::de::Error| Exit::BadInput(format!("{}: {}", config.display(), error.message()));
    let mut tables: toml::Table = load::read_text(config)?.parse().map_err(bad)?;
    let given = tables.remove("workers").unwrap_or_else(|| toml::Table::new().into());
    let mut workers: Workers = given.try_into().map_err(bad)?;
    workers.resolve(config.parent().unwrap_or(Path::new(".")));
    Ok(workers)
}

fn finding(config: &dyn SimulatorConfig, programs: &Programs) -> String {
    let engine = config.engine();
    let Some(program) = config.hosted().map(Hosted::worker) else {
        return match config.build() {
            Ok(_) => format!("ready: {} {}, inside elo", engine.name, engine.version),
            Err(error) => error.to_string(),
        };
    };
    match programs.start(&program) {
        Ok(worker) => format!("ready: {}, in {program}", worker.engine()),
        Err(fault) => format!("missing: {fault}{}", remedy(&program)),
    }
}
