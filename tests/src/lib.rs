//! What the tests of whole programs share: the programs themselves, small experiments, and plugins that go wrong in one
//! declared way each.
//!
//! A test that needs something which this machine does not have says so on stderr, in a line that begins with `SKIPPED`
//! and names the test; see [`skipped`].

pub mod folders;
pub mod preload;
pub mod programs;
pub mod toy;
pub mod wayward;

use elo_core::plugin::Plugin;
use std::io::Write as _;

/// Every plugin of the program `elo`, and those that go wrong.
pub const PLUGINS: &[&[Plugin]] =
    &[elo_core::plugin::PLUGINS, elo_backends::PLUGINS, elo_learners::PLUGINS, wayward::PLUGINS];

/// Tells that `test` could not be tried: one line to this process's stderr, past the test harness, which would hide it.
pub fn skipped(test: &str, reason: &str) {
    let line = format!("SKIPPED {test}: {reason}\n");
    // The harness catches what `eprint!` writes, and not what is written to the stream itself.
    let _ = std::io::stderr().write_all(line.as_bytes());
}
