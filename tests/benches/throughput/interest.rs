//! Practice of a set of closed-loop options beside the training of a teacher: environment steps with updates.

use std::error::Error;

use elo_core::context::InitialStates;
use elo_core::policy::{Practice, Practise as _, Unwatched};
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_core::task::TaskDistribution;
use elo_learners::interest::InterestConfig;

use crate::median;
use crate::ppo::{self, Costs, ROBOT};
use crate::robots::linked;

const STEPS: u64 = 2 * 8192;
const ROUNDS: usize = 5;

/// Prints a line for every engine.
pub fn run() -> Result<(), Box<dyn Error>> {
    println!("  {ROBOT}, K = 5, defaults, 64 x 64, one thread; medians of {ROUNDS} alternating rounds");
    println!("  engine  PPO, steps/s of processor time   interest   interest/PPO");
    for engine in linked() {
        let rounds = (0..ROUNDS).map(|_| {
            let [teacher, set] = [ppo::training(engine, 10)?, practice(engine)?].map(|costs| costs.rate());
            Ok((teacher, set))
        });
        let rounds = rounds.collect::<Result<Vec<(f64, f64)>, Box<dyn Error>>>()?;
        let ratio = median(rounds.iter().map(|(teacher, set)| set / teacher).collect());
        let (teachers, sets) = rounds.into_iter().unzip();
        println!("  {engine:<7} {:30.0}   {:8.0}   {ratio:12.2}", median(teachers), median(sets));
    }
    Ok(())
}

fn practice(engine: &str) -> Result<Costs, Box<dyn Error>> {
    let config = InterestConfig { steps: STEPS, context_pool: 1, ..InterestConfig::default() };
    // Rollouts begin where episodes of the teacher do.
    let initial_states = InitialStates { max_random_steps: 0, ..InitialStates::default() };
    ppo::costs(engine, STEPS, |simulator| {
        let practice = Practice {
            simulator,
            tasks: &TaskDistribution::default(),
            initial_states: &initial_states,
            set_size: 5,
            horizon: Horizon { steps: 200, discount: 1.0, stop_at_fall: true },
            demonstrations: &[],
            seed: Seed::root(1),
        };
        config.practise(&practice, &mut Unwatched).map(|_| ())
    })
}
