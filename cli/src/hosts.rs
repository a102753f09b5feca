//! Finds and starts the worker programs of engines that must not run inside `elo`.

use std::io;
use std::process::Command;

use elo_core::experiment::Experiment;
use elo_core::fingerprint::fingerprint;
use elo_core::hosted::WorkerProgram;
use elo_core::worker::{WorkerFault, WorkerProcess};
use elo_core::workers::Workers;
use elo_core::workforce::Hosts;

/// Starts worker programs: our own beside this program, interpreters as the config says.
#[derive(Clone, Debug, Default)]
pub struct Programs {
    /// Which interpreters, and what a worker may take.
    pub workers: Workers,
}

/// What to run when a worker program of ours is missing.
pub const SET_UP: &str =
    "run `tests/set-up` in the repository, which places MuJoCo under target/ and builds the worker";

/// What else to do about a worker that does not start.
pub fn remedy(program: &WorkerProgram) -> &'static str {
    match program {
        WorkerProgram::Beside(_) => "",
        WorkerProgram::Interpreter(_) => {
            "; install the package with `PYTHON -m pip install ./python` (in the repository), or name another interpreter \
             or virtual environment in `workers.python`; `tests/set-up` makes one in target/python"
        }
    }
}

/// How long a step may take, for workers that watch their environments.
const STEP_SECONDS: &str = "ELO_STEP_SECONDS";

impl Programs {
    /// As the experiment's `[workers]` says.
    pub fn of(experiment: &Experiment) -> Self {
        Self { workers: experiment.workers.clone() }
    }

    /// What starts `program`, or what to do where it is not there.
    pub fn find(&self, program: &WorkerProgram) -> Result<Command, String> {
        match program {
            WorkerProgram::Beside(name) => {
                let here = std::env::current_exe()
                    .map_err(|error| format!("cannot tell where this program is: {error}"))?;
                let path = here.with_file_name(name);
                if path.is_file() {
                    Ok(Command::new(path))
                } else {
                    Err(format!("{} is missing: {SET_UP}", path.display()))
                }
            }
            WorkerProgram::Interpreter(_) => Ok(self.python()),
        }
    }

    fn python(&self) -> Command {
        let mut command = Command::new(&self.workers.python);
        command.args(["-m", "elo.worker"]).env(STEP_SECONDS, self.workers.step_seconds.to_string());
        let own = std::env::var_os("PYTHONPATH");
        let folders = self.workers.python_path.iter().map(Into::into).chain(own);
        let folders: Vec<std::ffi::OsString> = folders.collect();
        if let Ok(path) = std::env::join_paths(folders.iter().flat_map(std::env::split_paths))
            && !path.is_empty()
        {
            command.env("PYTHONPATH", path);
        }
        command
    }
}

impl Hosts for Programs {
    fn start(&self, program: &WorkerProgram) -> Result<WorkerProcess, WorkerFault> {
        let missing = |message| WorkerFault::Start {
            program: program.to_string(),
            source: io::Error::new(io::ErrorKind::NotFound, message),
        };
        let command = self.find(program).map_err(missing)?;
        WorkerProcess::spawn(command, &fingerprint(), self.workers.limits())
    }
}
