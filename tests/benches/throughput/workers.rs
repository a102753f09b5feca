//! One worker and two on the same units, each time in a new run directory. Elapsed times tell about the program only on
//! a machine without other work; processor times tell on any whether two workers cost more than one.

use std::error::Error;
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use elo_core::context::InitialStates;
use elo_core::crew::{Crew, Hosts, Staff, Unit, Unwatched};
use elo_core::fingerprint::fingerprint;
use elo_core::hosted::{Hosted, WorkerProgram};
use elo_core::key::Key;
use elo_core::rollout::Horizon;
use elo_core::run_dir::RunDir;
use elo_core::seed::Seed;
use elo_core::task::TaskDistribution;
use elo_core::units::Span;
use elo_core::units::evaluate::{Behavior, Evaluate, Place, Subject};
use elo_core::units::learn;
use elo_core::units::prepare::{Prepare, TaskSource};
use elo_core::worker::{Limits, WorkerFault, WorkerProcess};
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
                times[workers - 1].push(evaluate(engine, workers)?);
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
        WorkerProcess::spawn(Command::new(Self::path(program)), &fingerprint(), limits)
    }
}

/// Seconds that the units of evaluation take; contexts are prepared before, so the workers are up.
fn evaluate(engine: &str, workers: usize) -> Result<f64, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let run_dir = RunDir::open(folder.path().join("run"))?;
    let stop = AtomicBool::new(false);
    let staff = Staff { workers, formats: vec![FORMAT], program: fingerprint() };
    let crew = Crew::new(staff, &run_dir, &Beside, &Unwatched, &stop);
    let seed = Seed::root(1);
    let mut inputs = crew.complete("prepare", &contexts(engine, &seed))?;
    inputs.push(crew.import(&options(engine, &seed)?)?);
    let units: Vec<Unit> = (0..CANDIDATES).map(|item| unit(engine, item, &inputs, &seed)).collect();
    let begin = Instant::now();
    crew.complete("evaluate", &units)?;
    Ok(begin.elapsed().as_secs_f64())
}

fn contexts(engine: &str, seed: &Seed) -> Vec<Unit> {
    let prepare = |span| Prepare {
        simulator: simulator(engine, ROBOT),
        tasks: TaskSource::Distribution(TaskDistribution::default()),
        initial_states: InitialStates::default(),
        span,
        seed: seed.child("contexts"),
    };
    let spans = Span::cut(CONTEXTS, CONTEXTS / 2);
    spans.into_iter().map(|span| Unit { work: prepare(span).into(), inputs: Vec::new() }).collect()
}

/// The options of all candidates, as the learning stage writes them.
fn options(engine: &str, seed: &Seed) -> Result<Vec<u8>, Box<dyn Error>> {
    let spec = simulator(engine, ROBOT).spec()?;
    let mut records = Vec::new();
    for item in 0..CANDIDATES {
        let actions = swinging(&spec, &seed.child("option").index(item as u64));
        records.push(Some(option(&actions, &spec)?.record()));
    }
    Ok(learn::encode(&records))
}

fn unit(engine: &str, item: usize, inputs: &[Key], seed: &Seed) -> Unit {
    let options = vec![Place { input: inputs.len() - 1, item }];
    let work = Evaluate {
        simulator: simulator(engine, ROBOT),
        subjects: vec![Subject {
            name: item.to_string(),
            behavior: Behavior::Infant { options, primitive_probability: 0.0 },
        }],
        contexts: inputs.len() - 1,
        horizon: Horizon { steps: STEPS, discount: 1.0, stop_at_fall: true },
        seed: seed.child("evaluate"),
    };
    Unit { work: work.into(), inputs: inputs.to_vec() }
}
