//! The program `elo` as a library, so that a user's own `main` can add a user's own plugins:
//!
//! ```no_run
//! fn main() -> std::process::ExitCode {
//!     elo_cli::main_with(&[elo_core::plugin::PLUGINS, elo_backends::PLUGINS, elo_learners::PLUGINS])
//! }
//! ```
//!
//! Each command is one file in `commands/`.

mod arguments;
mod commands;
mod engines;
pub mod exit;
mod experiments_table;
mod format;
pub mod hosts;
mod interrupt;
pub mod load;
mod open;
mod output;
mod page;
mod paper;
mod progress;
mod table;
mod worker;

pub use worker::{build, formats, worker_main_with};

use std::process::ExitCode;

use elo_core::plugin::Plugin;

use arguments::{Command, parse};
use exit::Exit;

/// Runs `elo` with these plugins on this process's arguments.
///
/// Exit codes: see `elo --help`.
pub fn main_with(plugins: &[&[Plugin]]) -> ExitCode {
    let command = match parse() {
        Ok(command) => command,
        Err(code) => return code,
    };
    let done = match command {
        Command::Discover(arguments) => commands::discover::run(&arguments, plugins),
        Command::Evaluate(arguments) => commands::evaluate::run(&arguments, plugins),
        Command::Crosscheck(arguments) => commands::crosscheck::run(&arguments, plugins),
        Command::Reprice(arguments) => commands::reprice::run(&arguments, plugins),
        Command::Compare(arguments) => commands::compare::run(&arguments, plugins),
        Command::Experiments(arguments) => commands::experiments::run(&arguments, plugins),
        Command::Reproduce(arguments) => commands::reproduce::run(&arguments, plugins),
        Command::Report(arguments) => commands::report::run(&arguments, plugins),
        Command::Plugins => commands::plugins::run(plugins),
        Command::Example { kind } => commands::example::run(&kind, plugins),
        Command::Config { action } => commands::config::run(&action, plugins),
        Command::Doctor(arguments) => commands::doctor::run(&arguments, plugins),
    };
    Exit::code(done)
}
