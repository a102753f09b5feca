//! What learning costs beside the simulator, on one thread: `cargo bench -p elo-learners --bench training`.
//!
//! The world moves next to nothing, so that what is left is the learner's own: acting (normalising, inference, sampling) and
//! improving (epochs of minibatches). Their shares come from trainings with one and with ten epochs.

use std::time::Instant;

use elo_core::context::InitialStates;
use elo_core::fault::Faults;
use elo_core::policy::{
    Demonstration, Imitate as _, Lesson, Practice, Practise as _, TeacherConfig as _, Unwatched,
};
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_core::simulator::{
    BuildError, End, Engine, Simulator, SimulatorConfig, SimulatorError, Start, State,
};
use elo_core::spec::{Capabilities, RewardTerm, SimulatorSpec, Weight};
use elo_core::task::{Task, TaskDistribution};
use elo_learners::behavior_cloning::BehaviorCloningConfig;
use elo_learners::interest::InterestConfig;
use elo_learners::ppo::PpoConfig;
use serde::{Deserialize, Serialize};

const OBSERVATION: usize = 26;
const ACTION: usize = 6;

/// Steps of an iteration, and of the rollouts into which practice divides them.
const ITERATION: usize = 2048;
const ROLLOUT: usize = 128;

/// As many numbers as a robot with six motors, each drawn to its action.
#[derive(Debug, Serialize, Deserialize)]
struct Drift {}

#[typetag::serde(name = "bench_drift")]
impl SimulatorConfig for Drift {
    fn validate(&self, _: &mut Faults) {}

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Ok(SimulatorSpec {
            robot: "drift".to_owned(),
            observation_size: OBSERVATION,
            action_low: vec![-1.0; ACTION],
            action_high: vec![1.0; ACTION],
            control_step: 0.0165,
            reward_terms: vec![RewardTerm { name: "first".to_owned(), weight: Weight::Constant(1.0) }],
            task_parameters: Vec::new(),
            reward_floor: -1.0,
            capabilities: Capabilities { settable_state: false },
        })
    }

    fn engine(&self) -> Engine {
        Engine { name: "drift".to_owned(), version: "1".to_owned() }
    }

    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        Ok(Box::new(Drifting { spec: self.spec()?, seen: [0.0; OBSERVATION] }))
    }
}

struct Drifting {
    spec: SimulatorSpec,
    seen: [f32; OBSERVATION],
}

impl Simulator for Drifting {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn reset(&mut self, _: &Task, _: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        self.seen = [0.0; OBSERVATION];
        observation.copy_from_slice(&self.seen);
        Ok(())
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        for (index, x) in self.seen.iter_mut().enumerate() {
            *x += 0.1 * (action[index % ACTION] - *x);
        }
        observation.copy_from_slice(&self.seen);
        reward_terms[0] = f64::from(self.seen[0]);
        Ok(End::Running)
    }

    fn state(&self) -> Result<State, SimulatorError> {
        Err(SimulatorError::Unsupported("reading a state"))
    }
}

/// The fastest of five trainings, in µs a step.
fn training(epochs: usize) -> f64 {
    let config = PpoConfig { steps: 20_480, epochs, d0_share: 0.0, ..PpoConfig::default() };
    let (task, initial_states) = (Task::default(), InitialStates::default());
    let lesson =
        Lesson { simulator: &Drift {}, task: &task, initial_states: &initial_states, seed: Seed::root(1) };
    fastest(5, || {
        config.train(&lesson, &mut Unwatched).expect("nothing here can diverge");
    }) / config.simulator_steps() as f64
}

/// The same for sets of five closed-loop options.
fn practice(epochs: usize) -> f64 {
    let steps = 10 * ITERATION as u64;
    let config =
        InterestConfig { steps, rollout_steps: ITERATION as u64, epochs, ..InterestConfig::default() };
    let (tasks, initial_states) =
        (TaskDistribution::default(), InitialStates { max_random_steps: 0, ..InitialStates::default() });
    let practice = Practice {
        simulator: &Drift {},
        tasks: &tasks,
        initial_states: &initial_states,
        set_size: 5,
        horizon: Horizon { steps: ROLLOUT, discount: 1.0, stop_at_fall: true },
        demonstrations: &[],
        seed: Seed::root(1),
    };
    fastest(5, || {
        config.practise(&practice, &mut Unwatched).expect("nothing here can diverge");
    }) / config.simulator_steps() as f64
}

/// The fastest of five fits of 200 steps, in µs.
fn cloning() -> f64 {
    let steps = 200;
    let wave = |count: usize, rate: f32| (0..steps * count).map(|i| (i as f32 * rate).sin()).collect();
    let (observations, actions) = (wave(OBSERVATION, 0.013), wave(ACTION, 0.047));
    let demonstration = Demonstration { observations, actions, steps };
    let spec = Drift {}.spec().expect("it has one");
    fastest(5, || {
        let learned = BehaviorCloningConfig::default().learn(&demonstration, &spec, &Seed::root(1));
        learned.expect("nothing here can diverge");
    })
}

fn fastest(times: usize, mut run: impl FnMut()) -> f64 {
    let seconds = (0..times).map(|_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    });
    seconds.fold(f64::INFINITY, f64::min) * 1e6
}

fn main() {
    println!("{OBSERVATION} → 64 → 64 → {ACTION}, {ITERATION} steps, 10 epochs, otherwise the defaults:");
    for (learner, cost) in [("PPO", training as fn(usize) -> f64), ("interest, K = 5", practice)] {
        let (one, ten) = (cost(1), cost(10));
        let epoch = (ten - one) / 9.0;
        println!("  {learner:<16} acting and advantages {:8.2} µs a step", one - epoch);
        println!("  {learner:<16} improving             {:8.2} µs a step", 10.0 * epoch);
    }
    println!("behaviour cloning of 200 steps, default: {:.1} ms", cloning() / 1000.0);
}
