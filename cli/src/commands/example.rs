//! `elo example`: a commented config.

use elo_core::config;
use elo_core::fault::meant;
use elo_core::plugin::{Plugin, Role};

use crate::exit::Exit;
use crate::load;
use crate::output::print;

/// Prints a commented config of `kind`.
pub fn run(kind: &str, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    if kind == "experiment" {
        let experiment = load::embedded(DEFAULT, "the default experiment".as_ref(), &[], plugins)?;
        let text = config::example_root(&experiment, plugins);
        return print(&text.map_err(|error| Exit::Failed(error.to_string()))?);
    }
    let all = || plugins.iter().flat_map(|slice| slice.iter()).filter(|p| p.role != Role::PolicyFormat);
    // Plugins of different roles may share a kind.
    let found: Vec<String> =
        all().filter(|p| p.kind == kind).filter_map(|plugin| config::example(plugin, plugins)).collect();
    if !found.is_empty() {
        return print(&found.join("\n"));
    }
    let meant = meant(kind, all().map(|plugin| plugin.kind), '`');
    Err(Exit::BadInput(format!("no plugin has the kind `{kind}`{meant} (`elo plugins` lists them)")))
}

/// What must be chosen; every other field has its default.
const DEFAULT: &str = r#"
seed = 1
metrics = [{ kind = "maximum_mean" }, { kind = "negative_tail" }, { kind = "positive_skew" }]
[simulator]
kind = "rapier"
robot = "half-cheetah"
[tasks.electricity_cost]
low = -2.4
high = -1.4
[teacher]
kind = "ppo"
[option_learner]
kind = "open_loop"
"#;
