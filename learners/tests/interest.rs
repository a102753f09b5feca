//! Options with interests, learned on a simulator of continuous states.
#![allow(clippy::unwrap_used)]

use elo_core::conformance::option_policy;
use elo_core::conformance::point_mass::PointMassConfig;
use elo_core::context::InitialStates;
use elo_core::policy::{Practice, Unwatched};
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_core::task::{Range, TaskDistribution};
use elo_learners::interest::duration::Band;
use elo_learners::interest::{FORMAT, InterestConfig, LearningRates, train};

#[test]
fn options_for_a_mass_of_unknown_weight_earn_more_with_practice_and_last_as_asked() {
    let config = InterestConfig {
        continuations: Band { low: 4.0, high: 6.0 },
        duration_weight: 10.0,
        steps: 60 * 960,
        rollout_steps: 960,
        context_pool: 500,
        minibatch: 64,
        learning_rates: LearningRates { policies: 3e-3, interests: 3e-3, termination: 0.02, critic: 3e-3 },
        hidden: vec![16],
        ..InterestConfig::default()
    };
    // The mass changes the motion, the cost prices it.
    let tasks = TaskDistribution::new([
        ("effort_cost", Range { low: -0.5, high: -0.1 }),
        ("mass", Range { low: 0.5, high: 2.0 }),
    ]);
    let initial_states = InitialStates { max_random_steps: 20, ..InitialStates::default() };
    let simulator = PointMassConfig::default();
    let practice = Practice {
        simulator: &simulator,
        tasks: &tasks,
        initial_states: &initial_states,
        set_size: 3,
        horizon: Horizon { steps: 60, discount: 1.0, stop_at_fall: true },
        demonstrations: &[],
        seed: Seed::root(1),
    };
    let learned = train(&config, &practice, &mut Unwatched).unwrap();
    let mean = |points: &[elo_learners::interest::Point]| {
        points.iter().map(|point| point.mean_return).sum::<f64>() / points.len() as f64
    };
    let (first, last) = (mean(&learned.curve[..5]), mean(&learned.curve[55..]));
    assert!(last > first + 10.0, "{first} first, {last} last");
    let continuations = learned.curve[59].continuations;
    assert!((3.8..6.3).contains(&continuations), "{continuations}");
    for option in learned.options {
        let spec = PointMassConfig::default().description();
        let case = option_policy::Case { policy: Box::new(option), format: FORMAT, spec };
        option_policy::run(&case).require_clean().unwrap_or_else(|report| panic!("{report}"));
    }
}
