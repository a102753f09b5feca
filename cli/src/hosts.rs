//! Finds and starts the worker programs of engines that must not run inside `elo`.

use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::process::Command;

use elo_core::experiment::Experiment;
use elo_core::hosted::WorkerProgram;
use elo_core::worker::{WorkerFault, WorkerProcess};
use elo_core::workers::{STEP_SECONDS, Workers};
use elo_core::workforce::Hosts;

use crate::worker::build;

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
            "; install the package with `PYTHON -m pip install './python[gym]'` (in the repository), or name another interpreter \
             or virtual environment in `workers.python`; `tests/set-up` makes one in target/python"
        }
    }
}

/// What an interpreter finds in its environment where whoever runs this program has not set it: sets of strings are in the same
/// order in each worker, a crash tells the line in Python, what is printed is not lost with its process, and each worker keeps to one core.
const ENVIRONMENT: [(&str, &str); 6] = [
    ("PYTHONHASHSEED", "0"),
    ("PYTHONFAULTHANDLER", "1"),
    ("PYTHONUNBUFFERED", "1"),
    ("OMP_NUM_THREADS", "1"),
    ("OPENBLAS_NUM_THREADS", "1"),
    ("MKL_NUM_THREADS", "1"),
];

/// `python -m elo.worker`, but no module is taken from the folder in which this program happens to run: its entry in the path is empty.
const WORKER: &str = "import sys; sys.path[:] = filter(None, sys.path); import elo.worker; elo.worker.main()";

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
        command.args(["-c", WORKER]).env(STEP_SECONDS, self.workers.step_seconds.to_string());
        command.envs(ENVIRONMENT.into_iter().filter(|(name, _)| std::env::var_os(name).is_none()));
        if let Ok(path) = std::env::join_paths(self.folders())
            && !path.is_empty()
        {
            command.env("PYTHONPATH", path);
        }
        command
    }

    /// Where modules are looked for before the interpreter's own places. An empty entry would mean the working directory.
    fn folders(&self) -> Vec<PathBuf> {
        let own = std::env::var_os("PYTHONPATH");
        let given: Vec<OsString> = self.workers.python_path.iter().map(Into::into).chain(own).collect();
        given.iter().flat_map(std::env::split_paths).filter(|path| !path.as_os_str().is_empty()).collect()
    }
}

impl Hosts for Programs {
    fn start(&self, program: &WorkerProgram) -> Result<WorkerProcess, WorkerFault> {
        let missing = |message| WorkerFault::Start {
            program: program.to_string(),
            source: io::Error::new(io::ErrorKind::NotFound, message),
        };
        let command = self.find(program).map_err(missing)?;
        WorkerProcess::spawn(command, &build(), self.workers.limits())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn interpreters_look_for_modules_where_the_config_says_and_not_where_this_program_runs() {
        let workers = Workers { python_path: vec!["/a".to_owned(), String::new()], ..Workers::default() };
        let programs = Programs { workers };
        assert_eq!(programs.folders()[0], PathBuf::from("/a"));
        assert!(programs.folders().iter().all(|path| !path.as_os_str().is_empty()));
        let command = programs.find(&WorkerProgram::Interpreter("python")).unwrap();
        let set = |name: &str| command.get_envs().find(|(key, _)| *key == name).and_then(|(_, value)| value);
        assert!(set("PYTHONPATH").unwrap().to_str().unwrap().starts_with("/a"));
        for (name, value) in ENVIRONMENT {
            let own = std::env::var_os(name);
            assert_eq!(set(name), own.is_none().then_some(value.as_ref()), "{name}");
        }
    }
}
