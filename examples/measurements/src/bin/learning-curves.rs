//! Trains teachers on the default task of a config's simulator and prints learning curves as CSV: the mean return of whole
//! episodes (1000 control steps, standard reset, mean action, no exploration) of every policy kept during training.
//!
//! ```sh
//! cargo run --release -p measurements --bin learning-curves -- examples/paper/ant.toml 3 > curve.csv
//! cargo run --release -p measurements --bin learning-curves -- examples/paper/ant.toml 3 teacher.gamma=0.99
//! ```
//!
//! Arguments: config, number of seeds or a range of them (`11..20`, both included), then overrides as `elo --set` takes them. Programs of workers (`elo-mujoco`) are those
//! beside this one. Seeds are trained in turn on one core each, as many at a time as there are cores.

use std::path::Path;

use elo_core::context::{Context, PreparedStart};
use elo_core::crew::{Unit, Watcher};
use elo_core::discover::{Run, duplicate};
use elo_core::experiment::TeacherActs;
use elo_core::rollout::{Ending, Horizon, Rollout, price};
use elo_core::seed::Seed;
use elo_core::statistics::StatisticsError;
use elo_core::statistics::summary::{mean, sample_sd};
use elo_core::task::Task;
use elo_core::units::evaluate::{Behavior, Evaluate, RolloutTable, Subject};
use elo_core::units::play::Play;
use elo_core::units::prepare;
use elo_core::units::train::TeacherResult;
use measurements::{Failure, PLUGINS, with_crew};

/// Episodes behind each point of a curve.
const EPISODES: u64 = 20;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [config, seeds, overrides @ ..] = arguments.as_slice() else {
        return Err("expected: CONFIG SEEDS [PATH=VALUE]…, e.g. examples/paper/ant.toml 3".into());
    };
    let seeds = range(seeds)?;
    let experiment = elo_cli::load::experiment(Path::new(config), overrides, &PLUGINS)?;
    let folder = tempfile::tempdir()?;
    with_crew(&experiment, &folder.path().join("run"), &Told, |crew| {
        print_curves(&Run::new(&experiment, crew)?, &seeds)
    })
}

/// Seeds 1 to a number, or those of a range.
fn range(text: &str) -> Result<Vec<u64>, Failure> {
    let (first, last) = text.split_once("..").unwrap_or(("1", text));
    let seeds: Vec<u64> = (first.parse()?..=last.parse()?).collect();
    if seeds.is_empty() { Err(format!("seeds {text}: expected at least one").into()) } else { Ok(seeds) }
}

fn print_curves(run: &Run<'_>, seeds: &[u64]) -> Result<(), Failure> {
    let (experiment, crew) = (run.experiment, run.crew);
    let roots: Vec<Seed> = seeds.iter().map(|seed| Seed::root(*seed).child("learning-curves")).collect();
    let trainings: Vec<Unit> = roots
        .iter()
        .map(|root| run.training(&Task::default(), root.child("teacher")))
        .collect::<Result<_, _>>()?;
    let trained = crew.complete("trainings", &trainings)?;

    println!("engine,robot,seed,steps,mean_return,standard_deviation,mean_length,falls");
    let (engine, spec) = (experiment.simulator.engine().name, experiment.simulator.spec()?);
    for ((seed, root), key) in seeds.iter().zip(&roots).zip(&trained) {
        let result = TeacherResult::decode(&crew.result(key)?)?;
        let snapshots = result.trained.ok_or("a training diverged")?.snapshots;
        let contexts = crew.import(&prepare::encode(&contexts(root)))?;
        let unit = |snapshot: usize| {
            let work = episodes(run, root, snapshot)?.into();
            Ok(Unit { work, inputs: vec![contexts, *key] })
        };
        let units: Vec<Unit> = (0..snapshots.len()).map(unit).collect::<Result<_, Failure>>()?;
        for (snapshot, key) in snapshots.iter().zip(crew.complete("episodes", &units)?) {
            let table = RolloutTable::decode(&crew.result(&key)?)?;
            let figures = figures(&table, &spec.prices(&Task::default()))?;
            println!("{engine},{},{seed},{},{figures}", spec.robot, snapshot.steps);
        }
    }
    Ok(())
}

fn contexts(root: &Seed) -> Vec<Context> {
    let start = |episode| PreparedStart::standard(root.child("episode").index(episode).number());
    (0..EPISODES).map(|episode| Context { task: Task::default(), start: start(episode) }).collect()
}

fn episodes(run: &Run<'_>, root: &Seed, snapshot: usize) -> Result<Evaluate, Failure> {
    let behavior = Behavior::Teacher {
        teacher: run.teacher()?,
        input: 1,
        snapshot: Some(snapshot),
        acts: TeacherActs::Mean,
    };
    let play = Play {
        simulator: duplicate(&run.experiment.simulator),
        subjects: vec![Subject { name: "teacher".to_owned(), behavior }],
        horizon: Horizon { steps: 1000, discount: 1.0, stop_at_fall: true },
        seed: root.child("episodes"),
    };
    Ok(Evaluate { contexts: 1, play })
}

/// Mean and deviation of returns, mean length, share of falls.
fn figures(table: &RolloutTable, prices: &[f64]) -> Result<String, StatisticsError> {
    let of = |figure: &dyn Fn(&Rollout) -> f64| table.rollouts.iter().map(figure).collect::<Vec<f64>>();
    let returns = of(&|rollout| price(&rollout.term_sums, prices));
    let (mean_return, deviation) = (mean(&returns)?, sample_sd(&returns)?);
    let length = mean(&of(&|rollout| f64::from(rollout.length)))?;
    let falls = mean(&of(&|rollout| f64::from(u8::from(rollout.ending == Ending::Terminated))))?;
    Ok(format!("{mean_return:.1},{deviation:.1},{length:.1},{falls:.2}"))
}

/// Tells on stderr how far the trainings are, each tenth of one.
struct Told;

impl Watcher for Told {
    fn begin(&self, _: &str, _: usize, _: usize) {}
    fn advance(&self, stage: &str, done: f64) {
        static TENTHS: std::sync::Mutex<f64> = std::sync::Mutex::new(0.0);
        let mut told = TENTHS.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if stage == "trainings" && done >= *told + 0.1 {
            *told = (done * 10.0).floor() / 10.0;
            eprintln!("{:.1} trainings are done", *told);
        }
    }
    fn end(&self, _: &str) {}
    fn notice(&self, message: &str) {
        eprintln!("{message}");
    }
}
