//! `elo plugins`: everything that a config can choose.

use std::fmt::Write as _;

use elo_core::plugin::{Plugin, Role};

use crate::exit::Exit;
use crate::output::print;

/// Lists the plugins by role.
pub fn run(plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let mut text = String::new();
    let roles = [
        (Role::Simulator, "[simulator]"),
        (Role::Teacher, "[teacher]"),
        (Role::OptionLearner, "[option_learner]"),
        (Role::Metric, "[[metrics]]"),
        (Role::Selector, "[selector]"),
        (Role::PolicyFormat, "formats of option policies in option sets"),
    ];
    for (role, title) in roles {
        let _ = writeln!(text, "{title}");
        for plugin in plugins.iter().flat_map(|slice| slice.iter()).filter(|plugin| plugin.role == role) {
            let _ = writeln!(text, "  {:<18} {}", plugin.kind, plugin.summary);
        }
    }
    text.push_str("\n`elo example KIND` prints the fields of a kind, with their defaults.\n");
    print(&text)
}
