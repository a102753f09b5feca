//! `elo doctor`: which engines were found, and what to run for those that are missing.

use std::fmt::Write as _;

use elo_core::fingerprint::fingerprint;
use elo_core::hosted::Hosted;
use elo_core::plugin::{Plugin, Role};
use elo_core::simulator::SimulatorConfig;
use elo_core::workforce::Hosts as _;

use crate::exit::Exit;
use crate::hosts::{Programs, remedy};
use crate::output::print;

/// Looks for every engine and says what it found.
pub fn run(plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let mut text = format!("{}\n", fingerprint());
    let simulators =
        plugins.iter().flat_map(|slice| slice.iter()).filter(|plugin| plugin.role == Role::Simulator);
    for plugin in simulators {
        let config: Box<dyn SimulatorConfig> =
            serde_json::from_value((plugin.default_config)()).expect("a default config reads back");
        let _ = writeln!(text, "{:<12} {}", plugin.kind, finding(config.as_ref()));
    }
    print(&text)
}

fn finding(config: &dyn SimulatorConfig) -> String {
    let engine = config.engine();
    let Some(program) = config.hosted().map(Hosted::worker) else {
        return match config.build() {
            Ok(_) => format!("ready: {} {}, inside elo", engine.name, engine.version),
            Err(error) => error.to_string(),
        };
    };
    match Programs::default().start(&program) {
        Ok(worker) => format!("ready: {}, in the worker {program}", worker.engine()),
        Err(fault) => format!("missing: {fault}{}", remedy(&program)),
    }
}
