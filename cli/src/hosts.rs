//! Finds and starts the worker programs of engines that must not run inside `elo`.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use elo_core::crew::Hosts;
use elo_core::fingerprint::fingerprint;
use elo_core::worker::{Limits, WorkerFault, WorkerProcess};

/// Worker programs that lie beside this program.
#[derive(Clone, Copy, Debug)]
pub struct Beside;

/// What to run when a worker program is missing.
pub const SET_UP: &str =
    "run `tests/set-up` in the repository, which places MuJoCo under target/ and builds the worker";

impl Beside {
    /// Where `program` is, or what to do where it is not.
    pub fn find(program: &str) -> Result<PathBuf, String> {
        let here =
            std::env::current_exe().map_err(|error| format!("cannot tell where this program is: {error}"))?;
        let path = here.with_file_name(program);
        if path.is_file() { Ok(path) } else { Err(format!("{} is missing: {SET_UP}", path.display())) }
    }
}

/// What a worker may take before it counts as lost.
const LIMITS: Limits = Limits {
    greeting: Duration::from_secs(60),
    silence: Some(Duration::from_secs(600)),
    memory_bytes: Some(16 << 30),
};

impl Hosts for Beside {
    fn start(&self, program: &str) -> Result<WorkerProcess, WorkerFault> {
        let path = Self::find(program).map_err(|message| WorkerFault::Start {
            program: program.to_owned(),
            source: std::io::Error::new(std::io::ErrorKind::NotFound, message),
        })?;
        WorkerProcess::spawn(Command::new(path), &fingerprint(), LIMITS)
    }
}
