//! One worker and two on the same units, each time in a new run directory. Elapsed times tell about the program only on
//! a machine without other work; processor times tell on any whether two workers cost more than one.

use std::error::Error;
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use elo_core::context::{Context, PreparedStart};
use elo_core::crew::{Crew, Staff, Unit, Unwatched};
use elo_core::discover::duplicate;
use elo_core::fingerprint::fingerprint;
use elo_core::hosted::{Hosted, WorkerProgram};
use elo_core::key::Key;
use elo_core::rollout::Horizon;
use elo_core::run_dir::RunDir;
use elo_core::seed::Seed;
use elo_core::simulator::SimulatorConfig;
use elo_core::task::Task;
use elo_core::units::evaluate::{Behavior, Evaluate, Place, RolloutTable, Subject};
use elo_core::units::play::Play;
use elo_core::units::{learn, prepare};
use elo_core::worker::{Limits, WorkerFault, WorkerProcess};
use elo_core::workforce::Hosts;
use elo_learners::open_loop::FORMAT;

use crate::median;
use crate::processor_time::{load_average, of_family};
use crate::robots::{ENGINES, STEPS, option, simulator, swinging};

const ROBOT: &str = "ant";
const CANDIDATES: usize = 64;
const CONTEXTS: usize = 10;
const ROUNDS: usize = 3;

/// Prints a line for every engine.
pub fn run() -> Result<(), Box<dyn Error>> {
    println!(
        "  {CANDIDATES} units of {CONTEXTS} rollouts of {ROBOT}, medians of {ROUNDS} alternating rounds; aim: at least 1.85"
    );
    println!("  engine  workers are   one, s   two, s   one/two   processor time: one, s   two, s");
    for engine in ENGINES {
        let program = simulator(engine, ROBOT).hosted().map(Hosted::worker);
        if let Some(program) = program.as_ref().filter(|program| !Beside::path(program).is_file()) {
            println!("  {engine:<7} left out: `tests/set-up` builds {program} with the release profile");
            continue;
        }
        let mut times = [Vec::new(), Vec::new()];
        let mut processor = [Vec::new(), Vec::new()];
        for _ in 0..ROUNDS {
            for workers in [1, 2] {
                let before = of_family();
                let bout =
                    Bout { simulator: simulator(engine, ROBOT), candidates: CANDIDATES, contexts: CONTEXTS };
                times[workers - 1].push(bout.evaluate(&Beside, workers)?.seconds);
                processor[workers - 1].push(of_family() - before);
            }
        }
        let ([one, two], [one_busy, two_busy]) = (times.map(median), processor.map(median));
        let kind = program.map_or("threads", |_| "processes");
        let ratio = one / two;
        println!(
            "  {engine:<7} {kind:<11}   {one:6.2}   {two:6.2}   {ratio:7.2}   {one_busy:22.2}   {two_busy:6.2}"
        );
    }
    println!("  load average after: {}", load_average());
    Ok(())
}

/// Worker programs where `cargo build --release` puts them: one folder above this program.
struct Beside;

impl Beside {
    fn path(program: &WorkerProgram) -> PathBuf {
        let here = std::env::current_exe().unwrap_or_default();
        here.parent().unwrap_or(&here).with_file_name(program.to_string())
    }
}

impl Hosts for Beside {
    fn start(&self, program: &WorkerProgram) -> Result<WorkerProcess, WorkerFault> {
        let limits = Limits { greeting: Duration::from_secs(60), silence: None, memory_bytes: None };
        WorkerProcess::spawn(Command::new(Self::path(program)), &elo_cli::build(), limits)
    }
}

/// How long the units of evaluation took, and how many control steps that were.
pub struct Evaluated {
    pub seconds: f64,
    pub steps: u64,
}

/// A unit of evaluation for each candidate, all in the same contexts: standard resets by the seeds 0, 1, ….
pub struct Bout {
    pub simulator: Box<dyn SimulatorConfig>,
    pub candidates: usize,
    pub contexts: usize,
}

impl Bout {
    /// Has the units done. A unit a worker is done before, so that all are up.
    pub fn evaluate(&self, hosts: &dyn Hosts, workers: usize) -> Result<Evaluated, Box<dyn Error>> {
        let folder = tempfile::tempdir()?;
        let run_dir = RunDir::open(folder.path().join("run"))?;
        let stop = AtomicBool::new(false);
        let staff = Staff { workers, formats: vec![FORMAT], program: fingerprint() };
        let crew = Crew::new(staff, &run_dir, hosts, &Unwatched, &stop);
        let seed = Seed::root(1);
        let start = |seed| Context { task: Task::default(), start: PreparedStart::standard(seed) };
        let contexts = prepare::encode(&(0..self.contexts as u64).map(start).collect::<Vec<_>>());
        let contexts = crew.import(&contexts)?;
        let units = (0..self.candidates + workers).map(|item| {
            let spec = self.simulator.spec()?;
            let option = option(&self.actions(item)?, &spec)?;
            let option = crew.import(&learn::encode(&[Some(option.record())]))?;
            Ok(self.unit(item, vec![contexts, option], &seed))
        });
        let units = units.collect::<Result<Vec<Unit>, Box<dyn Error>>>()?;
        crew.complete("begin", &units[self.candidates..])?;
        let begin = Instant::now();
        let keys = crew.complete("evaluate", &units[..self.candidates])?;
        let seconds = begin.elapsed().as_secs_f64();
        let mut steps = 0;
        for key in &keys {
            let table = RolloutTable::decode(&crew.result(key)?)?;
            steps += table.rollouts.iter().map(|rollout| u64::from(rollout.length)).sum::<u64>();
        }
        Ok(Evaluated { seconds, steps })
    }

    /// What a candidate does: [`STEPS`] rows.
    pub fn actions(&self, item: usize) -> Result<Vec<f32>, Box<dyn Error>> {
        Ok(swinging(&self.simulator.spec()?, &Seed::root(1).child("option").index(item as u64)))
    }

    fn unit(&self, item: usize, inputs: Vec<Key>, seed: &Seed) -> Unit {
        let options = vec![Place { input: inputs.len() - 1, item: 0 }];
        let play = Play {
            simulator: duplicate(&self.simulator),
            subjects: vec![Subject {
                name: item.to_string(),
                behavior: Behavior::Infant { options, primitive_probability: 0.0 },
            }],
            horizon: Horizon { steps: STEPS, discount: 1.0, stop_at_fall: true },
            seed: seed.child("evaluate"),
        };
        Unit { work: Evaluate { contexts: inputs.len() - 1, play }.into(), inputs }
    }
}
