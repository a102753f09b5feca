//! What uniformly random actions earn on the default task of a robot, as CSV: one line of figures, then how many of the
//! episodes outlive how many steps.
//!
//! ```sh
//! cargo run --release -p measurements --bin random-policy -- rapier ant 100
//! cargo run --release -p measurements --features mujoco --bin random-policy -- mujoco ant 100
//! ```
//!
//! Arguments: engine, robot, number of episodes of at most 200 control steps from the standard reset, stopped by a fall.

use elo_core::agent::RandomTorque;
use elo_core::context::{Context, PreparedStart};
use elo_core::rollout::{Ending, Horizon, Rollout, price, rollout};
use elo_core::seed::Seed;
use elo_core::statistics::summary::{mean, quantile, sample_sd};
use elo_core::task::Task;
use measurements::{Failure, robot};

/// Control steps of an episode at most.
const STEPS: usize = 200;

/// After so many steps survivors are counted.
const AGES: [u32; 8] = [5, 10, 15, 20, 30, 50, 100, 200];

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [engine, robot_name, episodes] = arguments.as_slice() else {
        return Err("expected: ENGINE ROBOT EPISODES, e.g. rapier ant 100".into());
    };
    let mut world = robot(engine, robot_name)?.build()?;
    let spec = world.spec().clone();
    let task = Task::default();
    let horizon = Horizon { steps: STEPS, discount: 1.0, stop_at_fall: true };
    let root = Seed::root(1).child("random policy");
    let episode = |index: u64| {
        let seed = root.index(index);
        let context = Context { task: task.clone(), start: PreparedStart::standard(seed.number()) };
        rollout(world.as_mut(), &mut RandomTorque::new(&spec), &context, &horizon, &mut seed.stream())
    };
    let done: Vec<Rollout> = (0..episodes.parse()?).map(episode).collect();
    if let Some(Ending::Failed(why)) = done.iter().map(|r| &r.ending).find(|ending| !ending.is_valid()) {
        return Err(format!("an episode failed: {why}").into());
    }

    let prices = spec.prices(&task);
    let returns: Vec<f64> = done.iter().map(|r| price(&r.term_sums, &prices)).collect();
    let count = done.len() as f64;
    let all_steps: f64 = done.iter().map(|r| f64::from(r.length)).sum();
    let falls = done.iter().filter(|r| r.ending == Ending::Terminated).count() as f64;
    println!("figure,value");
    println!("mean_return,{:.1}", mean(&returns)?);
    println!("standard_deviation,{:.1}", sample_sd(&returns)?);
    for percent in [5, 25, 50, 75, 95] {
        println!("quantile_{percent:02},{:.1}", quantile(&returns, f64::from(percent) / 100.0)?);
    }
    println!("mean_length,{:.1}", all_steps / count);
    println!("falls,{:.2}", falls / count);
    for (index, term) in spec.reward_terms.iter().enumerate() {
        let paid: f64 = done.iter().map(|r| r.term_sums[index] * prices[index]).sum();
        // A sum of nothing may be -0.
        println!("{}_a_step,{:.3}", term.name, paid / all_steps + 0.0);
    }
    for age in AGES {
        let alive = |r: &&Rollout| r.length > age || r.length == age && r.ending == Ending::Horizon;
        println!("alive_after_{age},{:.2}", done.iter().filter(alive).count() as f64 / count);
    }
    Ok(())
}
