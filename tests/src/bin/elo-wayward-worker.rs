//! The worker program of the simulator that ends its process.

use std::process::ExitCode;

fn main() -> ExitCode {
    elo_cli::worker_main_with("wayward 1", elo_tests::PLUGINS)
}
