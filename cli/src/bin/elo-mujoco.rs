//! `elo-mujoco`: the worker program that links libmujoco and does `elo`'s units in that engine.

use std::process::ExitCode;

fn main() -> ExitCode {
    elo_cli::worker_main_with(
        "mujoco 3.17.0",
        &[elo_core::plugin::PLUGINS, elo_backends::PLUGINS, elo_learners::PLUGINS],
    )
}
