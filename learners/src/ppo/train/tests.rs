#![allow(clippy::unwrap_used)]

use std::time::Duration;

use elo_core::conformance::point_mass::PointMassConfig;
use elo_core::context::InitialStates;
use elo_core::fault::Faults;
use elo_core::policy::{Stopped, Unwatched};
use elo_core::simulator::*;
use elo_core::spec::{Capabilities, RewardTerm, Weight};
use elo_core::task::Task;
use serde::{Deserialize, Serialize};

use super::*;

/// Pays ½ a step in one half of the episodes and 1½ in the other, looks always the same, and says `end` of every
/// step.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Steady {
    end: End,
}

#[typetag::serde(name = "test_steady")]
impl SimulatorConfig for Steady {
    fn validate(&self, _: &mut Faults) {}
    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Ok(self.build()?.spec().clone())
    }
    fn engine(&self) -> Engine {
        Engine { name: "steady".to_owned(), version: "1".to_owned() }
    }
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        let spec = SimulatorSpec {
            robot: "rock".to_owned(),
            observation_size: 1,
            action_low: vec![-1.0],
            action_high: vec![1.0],
            control_step: 1.0,
            reward_terms: vec![RewardTerm { name: "rest".to_owned(), weight: Weight::Constant(1.0) }],
            task_parameters: Vec::new(),
            reward_floor: 0.0,
            capabilities: Capabilities { settable_state: true },
        };
        Ok(Box::new(Rock { spec, end: self.end, pay: 0.0, pause: Duration::ZERO }))
    }
}

/// Goes on for ever, and takes its time over each step.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Slow {
    milliseconds: u64,
}

#[typetag::serde(name = "test_slow")]
impl SimulatorConfig for Slow {
    fn validate(&self, _: &mut Faults) {}
    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Steady { end: End::Running }.spec()
    }
    fn engine(&self) -> Engine {
        Engine { name: "slow".to_owned(), version: "1".to_owned() }
    }
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        let pause = Duration::from_millis(self.milliseconds);
        Ok(Box::new(Rock { spec: self.spec()?, end: End::Running, pay: 0.0, pause }))
    }
}

struct Rock {
    spec: SimulatorSpec,
    end: End,
    pay: f64,
    pause: Duration,
}

impl Simulator for Rock {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }
    fn reset(&mut self, _: &Task, start: &Start, seen: &mut [f32]) -> Result<(), SimulatorError> {
        seen.fill(0.5);
        self.pay = if matches!(start, Start::Seed(seed) if seed.is_multiple_of(2)) { 0.5 } else { 1.5 };
        Ok(())
    }
    fn step(&mut self, _: &[f32], seen: &mut [f32], terms: &mut [f64]) -> Result<End, SimulatorError> {
        std::thread::sleep(self.pause);
        seen.fill(0.5);
        terms.fill(self.pay);
        Ok(self.end)
    }
    fn state(&self) -> Result<State, SimulatorError> {
        Ok(State::default())
    }
}

/// What the critic thinks of the only observation, in unscaled rewards, after 15 000 steps with γ = 0.9; and the
/// factor by which rewards were scaled.
fn learned(end: End, max_episode_steps: u64) -> (f64, f64) {
    let config = PpoConfig {
        steps: 15_000,
        rollout_steps: 300,
        minibatch: 50,
        gamma: 0.9,
        learning_rate: 3e-3,
        hidden: vec![8],
        max_episode_steps,
        d0_share: 0.0,
        ..PpoConfig::default()
    };
    taken_up(&config, &Steady { end }, |training, progress| {
        for _ in 0..config.iterations() {
            training.iterate(progress, &mut Unwatched).unwrap();
        }
        let mut value = [0.0];
        let mut observation = [0.0];
        progress.record.moments.normalizer().apply(&[0.5], &mut observation);
        progress.learner.critic.forward_one(&observation, &mut Scratch::default(), &mut value);
        let factor = progress.record.scaler.factor();
        (f64::from(value[0]) / factor, factor)
    })
}

/// What `act` makes of a training that was taken up before its first iteration, without starts from `d0`.
fn taken_up<T>(
    config: &PpoConfig,
    simulator: &dyn SimulatorConfig,
    act: impl FnOnce(&mut Training<'_>, &mut Progress) -> T,
) -> T {
    let (task, initial_states) = (Task::default(), InitialStates::default());
    let lesson = Lesson { simulator, task: &task, initial_states: &initial_states, seed: Seed::root(1) };
    let mut training = Training::new(config, &lesson).unwrap();
    let mut progress = Progress::new(config, &training.spec, &lesson.seed);
    training.take_up(&mut progress, &mut Unwatched).unwrap();
    act(&mut training, &mut progress)
}

/// Two iterations of 32 steps.
fn two_iterations() -> PpoConfig {
    PpoConfig { steps: 64, rollout_steps: 32, minibatch: 32, hidden: vec![8], ..PpoConfig::default() }
}

#[test]
fn a_time_limit_is_not_death_to_the_critic() {
    // Whoever is cut short after five steps would have earned 1 + γ + γ² + … = 10 from any of them on, in the mean
    // over episodes. Were the cut taken for an end, it would be the mean of 1, 1.9, 2.71, 3.44, 4.10: 2.63.
    let (cut, _) = learned(End::Running, 5);
    assert!((cut - 10.0).abs() < 1.0, "{cut}");
    let (cut_by_the_simulator, _) = learned(End::Truncated, 5);
    assert!((cut_by_the_simulator - 10.0).abs() < 1.0, "{cut_by_the_simulator}");
}

/// Words of progress, and the steps of the simulator between them.
#[derive(Default)]
struct Words {
    heard: Vec<(u64, u64)>,
    stop_after: Option<usize>,
}

impl Monitor for Words {
    fn resume(&mut self) -> Option<Vec<u8>> {
        None
    }
    fn checkpoint(&mut self, _: &[u8]) -> Result<(), Stopped> {
        Ok(())
    }
    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped> {
        self.heard.push((done, total));
        if self.stop_after == Some(self.heard.len()) { Err(Stopped) } else { Ok(()) }
    }
}

#[test]
fn a_training_in_a_slow_environment_says_so_at_each_start_and_within_an_iteration() {
    let config = PpoConfig { d0_pool: 7, ..two_iterations() };
    let (task, initial_states) = (Task::default(), InitialStates::default());
    let slow = Slow { milliseconds: 10 };
    let lesson =
        Lesson { simulator: &slow, task: &task, initial_states: &initial_states, seed: Seed::root(1) };
    let mut words = Words::default();
    let told = train(&config, &lesson, &mut words).unwrap();
    // Before each of the seven starts; ten steps take a tenth of a second, whatever the machine.
    assert_eq!(words.heard[..7], [(0, 64); 7]);
    assert!(words.heard.is_sorted(), "{:?}", words.heard);
    let within = words.heard.iter().filter(|(done, _)| done % 32 != 0).count();
    assert!(within >= 4, "{:?}", words.heard);
    assert_eq!(words.heard.last(), Some(&(64, 64)));
    // Who listens changes nothing, and a word may be answered by a stop.
    assert_eq!(train(&config, &lesson, &mut Unwatched).unwrap(), told);
    let mut stopping = Words { stop_after: Some(3), ..Words::default() };
    assert!(matches!(train(&config, &lesson, &mut stopping), Err(TrainError::Stopped(_))));
    assert_eq!(stopping.heard.len(), 3);
}

#[test]
fn an_observation_is_normalised_by_all_until_it_and_a_policy_goes_with_all_that_were_seen() {
    let config = PpoConfig { d0_share: 0.0, snapshots: 1, ..two_iterations() };
    taken_up(&config, &PointMassConfig::default(), |training, progress| {
        training.iterate(progress, &mut Unwatched).unwrap();
        // The first is the mean of itself; the second lies one deviation from the mean of two, or nowhere.
        let (first, rest) = training.experience.observations.split_at(training.spec.observation_size);
        let second = &rest[..first.len()];
        assert!(first.iter().all(|x| *x == 0.0), "{first:?}");
        assert!(second.iter().all(|x| *x == 0.0 || (0.9..=1.0).contains(&x.abs())), "{second:?}");
        assert!(second.iter().any(|x| *x != 0.0), "{second:?}");

        training.iterate(progress, &mut Unwatched).unwrap();
        let kept = &progress.snapshots.last().unwrap().policy;
        assert_eq!(progress.record.moments.count(), 64);
        let normalizer = progress.record.moments.normalizer();
        assert_eq!(kept.get("observation_mean").unwrap().data, normalizer.means);
        assert_eq!(kept.get("observation_scale").unwrap().data, normalizer.scales);
    });
}

#[test]
fn the_end_of_an_episode_is() {
    // Nothing comes after the one step of each episode.
    let (ended, factor) = learned(End::Terminated, 5);
    assert!((ended - 1.0).abs() < 0.2, "{ended}");
    // Nor does anything go before it in the returns that rewards are scaled by: ½ and 1½ deviate by ½. Discounted
    // sums over many such steps would deviate by ½ / √(1 - γ²) = 1.15.
    assert!((1.0 / factor - 0.5).abs() < 0.05, "{factor}");
}
