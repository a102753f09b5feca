//! A whole experiment in about a second: Algorithm 1 on a mass on a line.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use elo_core::config;
use elo_core::crew::{Crew, RunError, Staff, Unwatched};
use elo_core::discover::{Discovery, Run, discover};
use elo_core::experiment::Experiment;
use elo_core::fault::Faults;
use elo_core::hosted::WorkerProgram;
use elo_core::policy::PolicyFormat;
use elo_core::report::{Report, report};
use elo_core::results;
use elo_core::run_dir::RunDir;
use elo_core::worker::{WorkerFault, WorkerProcess};
use elo_core::workforce::Hosts;

use crate::PLUGINS;

/// Two teachers with eight checkpoints each, 24 candidates, 60 contexts in two blocks, two metrics.
pub const TOY: &str = r#"
seed = 7

[simulator]
kind = "point_mass"
reset_spread = 0.5

[tasks.effort_cost]
low = -0.3
high = -0.05

[initial_states]
max_random_steps = 10

[teacher]
kind = "ppo"
steps = 16_384
rollout_steps = 512
minibatch = 64
epochs = 4
hidden = [16]
learning_rate = 1e-3
d0_pool = 20
max_episode_steps = 100
snapshots = 2
checkpoint_every = 2048

[option_learner]
kind = "open_loop"

[discover]
teachers = 2
candidates = 24
contexts = 60
steps = 20
set_size = 3

[report]
contexts = 60
random_subsets = 2
bootstrap_draws = 200

[[metrics]]
kind = "maximum_mean"

[[metrics]]
kind = "negative_tail"
"#;

/// [`TOY`] with `from` replaced by `to`.
///
/// # Panics
/// When `from` does not occur.
pub fn toy_with(changes: &[(&str, &str)]) -> String {
    changes.iter().fold(TOY.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}

/// Has no worker programs.
#[derive(Clone, Copy, Debug)]
pub struct NoWorkers;

impl Hosts for NoWorkers {
    fn start(&self, program: &WorkerProgram) -> Result<WorkerProcess, WorkerFault> {
        let source = std::io::Error::new(std::io::ErrorKind::NotFound, "this test has none");
        Err(WorkerFault::Start { program: program.to_string(), source })
    }
}

/// Reads an experiment with every plugin, those that go wrong too.
///
/// # Panics
/// When it has faults.
pub fn experiment(text: &str) -> Experiment {
    let reading = config::read::<Experiment>(text, Path::new("test.toml"), &[], PLUGINS);
    let config = reading.unwrap_or_else(|error| panic!("{error}")).config;
    let mut faults = Faults::new();
    config.validate(&mut faults);
    assert!(faults.found().is_empty(), "{:?}", faults.found());
    config
}

/// The formats of option policies that [`PLUGINS`] read.
pub fn formats() -> Vec<PolicyFormat> {
    PLUGINS.iter().flat_map(|slice| slice.iter()).filter_map(|plugin| plugin.format).collect()
}

/// Runs an experiment in this process, as a program of version `program` would, with its run directory at `folder`.
///
/// # Errors
/// Those of the run.
pub fn run_here(
    experiment: &Experiment,
    folder: &Path,
    program: &str,
) -> Result<(Discovery, Report), RunError> {
    let run_dir = RunDir::open(folder)?;
    let stop = AtomicBool::new(false);
    let staff = Staff { workers: 2, formats: formats(), program: program.to_owned() };
    let crew = Crew::new(staff, &run_dir, &NoWorkers, &Unwatched, &stop);
    let discovery = discover(experiment, &crew)?;
    let run = Run::new(experiment, &crew)?;
    let held_out = report(&run, &discovery)?;
    results::write(&run, &discovery, &held_out, "{}")?;
    Ok((discovery, held_out.report))
}
