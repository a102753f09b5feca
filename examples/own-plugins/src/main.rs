//! `elo` with the plugins of this package beside its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    elo_cli::main_with(&[
        elo_core::plugin::PLUGINS,
        elo_backends::PLUGINS,
        elo_learners::PLUGINS,
        own_plugins::PLUGINS,
    ])
}
