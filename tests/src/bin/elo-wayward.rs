//! `elo` with the plugins that go wrong.

use std::process::ExitCode;

fn main() -> ExitCode {
    elo_cli::main_with(elo_tests::PLUGINS)
}
