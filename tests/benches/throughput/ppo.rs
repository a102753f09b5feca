//! Training a teacher: environment steps with updates, where the time goes, and Stable-Baselines3 on the same robot.

use std::error::Error;
use std::process::Command;
use std::time::Instant;

use elo_core::context::InitialStates;
use elo_core::policy::{Lesson, TeacherConfig as _, TrainError, Unwatched};
use elo_core::seed::Seed;
use elo_core::simulator::SimulatorConfig;
use elo_core::task::Task;
use elo_learners::ppo::PpoConfig;

use crate::median;
use crate::processor_time::of_thread;
use crate::robots::{linked, simulator};
use crate::timed::{Timed, take_seconds};

pub const ROBOT: &str = "half-cheetah";
const MJCF: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../backends/src/locomotion/robots/half-cheetah.xml");
const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/sb3_ppo.py");
const STEPS: u64 = 4 * 2048;
const ROUNDS: usize = 3;

/// Prints a line for every engine, and the comparison.
pub fn run() -> Result<(), Box<dyn Error>> {
    println!(
        "  {ROBOT}, 2048 steps an iteration, minibatch 64, 10 epochs, 64 x 64, one thread; medians of {ROUNDS}"
    );
    println!("  engine  steps/s of processor time   simulator   acting and advantages   updates");
    let engines = linked();
    let baseline = engines.contains(&"mujoco") && has_baseline();
    for engine in engines {
        let (mut ten, mut one, mut theirs) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..ROUNDS {
            ten.push(training(engine, 10)?);
            one.push(training(engine, 1)?);
            if baseline && engine == "mujoco" {
                theirs.push(stable_baselines()?);
            }
        }
        let [ten, one] = [ten, one].map(Costs::median);
        let updates = 10.0 * (ten.rest - one.rest) / 9.0;
        let total = ten.simulator + ten.rest;
        let (rate, share) = (ten.rate(), |us: f64| format!("{us:.1} us {:.0} %", 100.0 * us / total));
        let (simulator, acting) = (share(ten.simulator), share(ten.rest - updates));
        println!("  {engine:<7} {rate:25.0}   {simulator:>9}   {acting:>21}   {}", share(updates));
        if !theirs.is_empty() {
            let theirs = median(theirs);
            println!(
                "  Stable-Baselines3 on MuJoCo, in turn: {theirs:.0} steps/s; elo/SB3 {:.2}",
                rate / theirs
            );
        }
    }
    Ok(())
}

/// Microseconds a step: in the simulator, and besides.
pub struct Costs {
    simulator: f64,
    rest: f64,
}

impl Costs {
    fn median(all: Vec<Self>) -> Self {
        let (simulator, rest) = all.into_iter().map(|costs| (costs.simulator, costs.rest)).unzip();
        Self { simulator: median(simulator), rest: median(rest) }
    }

    /// Steps a second of processor time.
    pub fn rate(&self) -> f64 {
        1e6 / (self.simulator + self.rest)
    }
}

/// Of a training with so many epochs.
pub fn training(engine: &str, epochs: usize) -> Result<Costs, Box<dyn Error>> {
    let config = PpoConfig { steps: STEPS, epochs, d0_share: 0.0, ..PpoConfig::default() };
    costs(engine, STEPS, |simulator| {
        let (task, initial_states) = (&Task::default(), &InitialStates::default());
        let lesson = Lesson { simulator, task, initial_states, seed: Seed::root(1) };
        config.train(&lesson, &mut Unwatched).map(|_| ())
    })
}

/// What `learn`, which takes `steps` control steps, costs on one of them.
pub fn costs(
    engine: &str,
    steps: u64,
    learn: impl FnOnce(&dyn SimulatorConfig) -> Result<(), TrainError>,
) -> Result<Costs, Box<dyn Error>> {
    let timed = Timed(simulator(engine, ROBOT));
    take_seconds();
    let (begin, begin_elapsed) = (of_thread(), Instant::now());
    learn(&timed)?;
    // The share is of elapsed time: asking for processor time at every step would take as long as some steps.
    let share = take_seconds() / begin_elapsed.elapsed().as_secs_f64();
    let step = (of_thread() - begin) * 1e6 / steps as f64;
    Ok(Costs { simulator: step * share, rest: step * (1.0 - share) })
}

/// Whether `python3` can run the other side; says what to install if not.
fn has_baseline() -> bool {
    let check = Command::new("python3").args(["-c", "import gymnasium, mujoco, stable_baselines3"]).output();
    let there = check.is_ok_and(|output| output.status.success());
    if !there {
        println!(
            "  Stable-Baselines3 is left out: `pip install 'stable-baselines3==2.9.*' 'gymnasium[mujoco]'` for python3"
        );
    }
    there
}

/// Environment steps a second of processor time.
fn stable_baselines() -> Result<f64, Box<dyn Error>> {
    let output = Command::new("python3").args([SCRIPT, MJCF, &STEPS.to_string()]).output()?;
    if !output.status.success() {
        return Err(format!("{SCRIPT}: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().parse()?)
}
