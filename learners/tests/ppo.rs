//! PPO as a user meets it: does it learn, does it repeat, does it go on, does it say when it fails?
#![allow(clippy::unwrap_used)]

use elo_core::agent::{Agent, Taught, ZeroTorque};
use elo_core::conformance::point_mass::PointMassConfig;
use elo_core::context::{Context, InitialStates, PreparedStart};
use elo_core::policy::{Lesson, Monitor, Stopped, TeacherConfig, TrainError, Trained, Unwatched};
use elo_core::rollout::{Horizon, price, rollout};
use elo_core::seed::{Seed, Stream};
use elo_core::simulator::SimulatorConfig;
use elo_core::task::Task;
use elo_learners::ppo::PpoConfig;

/// Starts anywhere within 1.5 m of the origin, so that doing nothing earns little.
fn wide() -> PointMassConfig {
    PointMassConfig { wall: 2.0, reset_spread: 1.5 }
}

fn small() -> PpoConfig {
    PpoConfig {
        steps: 2_000,
        rollout_steps: 200,
        environments: 2,
        minibatch: 50,
        epochs: 3,
        hidden: vec![8],
        max_episode_steps: 60,
        checkpoint_every: 400,
        snapshots: 4,
        d0_pool: 10,
        ..PpoConfig::default()
    }
}

fn train_on(
    simulator: &dyn SimulatorConfig,
    config: &PpoConfig,
    monitor: &mut dyn Monitor,
) -> Result<Trained, TrainError> {
    let (task, initial_states) = (Task::default(), InitialStates::default());
    let lesson = Lesson { simulator, task: &task, initial_states: &initial_states, seed: Seed::root(7) };
    config.train(&lesson, monitor)
}

/// Mean return of 200 steps over a hundred standard resets.
fn mean_return(agent: &mut dyn Agent) -> f64 {
    let mut simulator = wide().build().unwrap();
    let prices = simulator.spec().prices(&Task::default());
    let horizon = Horizon { steps: 200, discount: 1.0, stop_at_fall: true };
    let mut stream = Seed::root(1).stream();
    let returns = (0..100).map(|number| {
        let context = Context { task: Task::default(), start: PreparedStart::standard(number) };
        let outcome = rollout(simulator.as_mut(), agent, &context, &horizon, &mut stream);
        price(&outcome.term_sums, &prices)
    });
    returns.sum::<f64>() / 100.0
}

/// Pulls the mass to the origin as hard as it can and brakes in time: nearly the best that can be done.
struct Controller;

impl Agent for Controller {
    fn act(&mut self, observation: &[f32], _: &mut Stream, action: &mut [f32]) {
        action[0] = (-3.0 * observation[0] - 2.5 * observation[1]).clamp(-1.0, 1.0);
    }
}

#[test]
fn a_teacher_comes_close_to_the_best_controller() {
    let config = PpoConfig {
        steps: 60_000,
        rollout_steps: 2000,
        minibatch: 50,
        hidden: vec![32, 32],
        learning_rate: 1e-3,
        max_episode_steps: 200,
        ..PpoConfig::default()
    };
    let trained = train_on(&wide(), &config, &mut Unwatched).unwrap();
    let teacher = config.load(&trained.policy, &wide().description()).unwrap();
    let (nothing, best) = (mean_return(&mut ZeroTorque), mean_return(&mut Controller));
    let learned = mean_return(&mut Taught { policy: teacher.as_ref(), sampling: false });
    let share = (learned - nothing) / (best - nothing);
    assert!(best > nothing + 50.0 && share > 0.9, "nothing {nothing}, learned {learned}, best {best}");
    // The curve saw it happen, and the snapshots lead to the policy.
    let (first, last) = (trained.curve[0], trained.curve[trained.curve.len() - 1]);
    assert!(last.mean_return > first.mean_return && last.steps == 60_000, "{first:?} {last:?}");
    assert_eq!(trained.snapshots.len(), 20);
    assert_eq!(trained.snapshots[19].policy, trained.policy);
    let untrained = config.untrained(&wide().description(), &Seed::root(7)).unwrap();
    let before = config.load(&untrained, &wide().description()).unwrap();
    let before = mean_return(&mut Taught { policy: before.as_ref(), sampling: false });
    assert!(before < nothing + 0.2 * (best - nothing), "untrained {before}");
}

#[test]
fn the_same_lesson_gives_the_same_teacher() {
    let train = || train_on(&wide(), &small(), &mut Unwatched).unwrap();
    let (first, second) = (train(), train());
    assert_eq!(first, second);
    assert_eq!(first.policy.encode(), second.policy.encode());
}

/// Stops at every checkpoint, the first time that it comes, and hands it back when asked.
#[derive(Default)]
struct StopAtEvery {
    kept: Option<Vec<u8>>,
    reports: Vec<(u64, u64)>,
}

impl Monitor for StopAtEvery {
    fn resume(&mut self) -> Option<Vec<u8>> {
        self.kept.clone()
    }
    fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped> {
        self.kept = Some(bytes.to_vec());
        Err(Stopped)
    }
    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped> {
        self.reports.push((done, total));
        Ok(())
    }
}

#[test]
fn stopped_at_every_checkpoint_a_training_gives_the_same_bytes() {
    for simulator in
        [&wide() as &dyn SimulatorConfig, &worlds::ReplayOnly {}, &worlds::Fragile { mean_life: 400 }]
    {
        let straight = train_on(simulator, &small(), &mut Unwatched).unwrap();
        let mut monitor = StopAtEvery::default();
        let mut stops = 0;
        let resumed = loop {
            match train_on(simulator, &small(), &mut monitor) {
                Err(TrainError::Stopped(Stopped)) => stops += 1,
                finished => break finished.unwrap(),
            }
        };
        // 2000 steps with a checkpoint each 400, but none at the end.
        assert_eq!(stops, 4, "{simulator:?}");
        assert_eq!(resumed, straight, "{simulator:?}");
        // Where iterations end, and what is repeated while something else is done; nothing is ever taken back.
        assert!(monitor.reports.is_sorted(), "{simulator:?}: {:?}", monitor.reports);
        monitor.reports.retain(|(done, _)| done % 200 == 0);
        monitor.reports.dedup();
        assert_eq!(monitor.reports, (0..=10).map(|done| (200 * done, 2000)).collect::<Vec<_>>());
    }
}

#[test]
fn a_checkpoint_of_another_training_is_refused() {
    let mut monitor = StopAtEvery::default();
    assert_eq!(train_on(&wide(), &small(), &mut monitor), Err(TrainError::Stopped(Stopped)));
    let other = PpoConfig { hidden: vec![9], ..small() };
    let error = train_on(&wide(), &other, &mut monitor).unwrap_err();
    assert!(error.to_string().starts_with("the checkpoint cannot be read"), "{error}");
}

#[test]
fn epochs_end_when_the_policy_has_moved_far_enough() {
    let policy = |epochs, target_kl| {
        let config = PpoConfig { epochs, target_kl, ..small() };
        train_on(&wide(), &config, &mut Unwatched).unwrap().policy
    };
    // Any movement is too much: one epoch and no second.
    assert_eq!(policy(5, 1e-12), policy(1, 1000.0));
    assert_ne!(policy(5, 1000.0), policy(1, 1000.0));
}

#[test]
fn an_absurd_learning_rate_is_reported_as_divergence() {
    let config = PpoConfig { learning_rate: 1e3, ..small() };
    match train_on(&wide(), &config, &mut Unwatched).unwrap_err() {
        TrainError::Diverged { steps, .. } => assert!(steps <= 400, "noticed after {steps} steps"),
        other => panic!("{other}"),
    }
}

#[test]
fn a_simulator_that_always_gives_nan_is_reported_and_one_that_seldom_fails_is_borne() {
    match train_on(&worlds::Fragile { mean_life: 1 }, &small(), &mut Unwatched).unwrap_err() {
        TrainError::Diverged { reason, .. } => {
            assert!(reason.contains("the simulator failed in 11 of"), "{reason}");
            assert!(reason.contains("which is not finite"), "{reason}");
        }
        other => panic!("{other}"),
    }
    // About five failures in the 2000 steps, each of which costs one episode and no more.
    let trained = train_on(&worlds::Fragile { mean_life: 400 }, &small(), &mut Unwatched).unwrap();
    let means = trained.curve.iter().flat_map(|point| point.mean_return);
    assert!(means.clone().count() > 0 && means.clone().all(f64::is_finite));
}

#[test]
fn configs_and_starts_that_cannot_work_are_errors() {
    let wrong = PpoConfig { rollout_steps: 0, ..small() };
    assert!(matches!(train_on(&wide(), &wrong, &mut Unwatched), Err(TrainError::Other(_))));
    // A wall so near that no random walk of the hundred steps or so survives it, and only one try.
    let near = PointMassConfig { wall: 0.001, reset_spread: 0.0 };
    let task = Task::default();
    let initial_states = InitialStates { max_redraws: 1, ..InitialStates::default() };
    let lesson =
        Lesson { simulator: &near, task: &task, initial_states: &initial_states, seed: Seed::root(7) };
    let error = small().train(&lesson, &mut Unwatched).unwrap_err();
    assert!(error.to_string().starts_with("no start can be drawn from d0"), "{error}");
    // Without d0 there is nothing to draw, and falls at once are part of life.
    let without = PpoConfig { d0_share: 0.0, ..small() };
    without.train(&lesson, &mut Unwatched).unwrap();
}

/// Point masses with a fault each.
mod worlds {
    use elo_core::conformance::point_mass::{self, PointMassConfig};
    use elo_core::fault::Faults;
    use elo_core::simulator::*;
    use elo_core::spec::SimulatorSpec;
    use elo_core::task::Task;
    use serde::{Deserialize, Serialize};

    /// One whose state cannot be set.
    #[derive(Debug, Serialize, Deserialize)]
    pub struct ReplayOnly {}

    #[typetag::serde(name = "test_replay_only")]
    impl SimulatorConfig for ReplayOnly {
        fn validate(&self, _: &mut Faults) {}
        fn spec(&self) -> Result<SimulatorSpec, BuildError> {
            Ok(point_mass::replay_only(PointMassConfig::default()).spec().clone())
        }
        fn engine(&self) -> Engine {
            PointMassConfig::default().engine()
        }
        fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
            Ok(point_mass::replay_only(PointMassConfig::default()))
        }
    }

    /// One whose reward is NaN about once in `mean_life` steps, depending on where it is.
    #[derive(Debug, Serialize, Deserialize)]
    pub struct Fragile {
        pub mean_life: u64,
    }

    #[typetag::serde(name = "test_fragile")]
    impl SimulatorConfig for Fragile {
        fn validate(&self, _: &mut Faults) {}
        fn spec(&self) -> Result<SimulatorSpec, BuildError> {
            Ok(PointMassConfig::default().description())
        }
        fn engine(&self) -> Engine {
            PointMassConfig::default().engine()
        }
        fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
            let inner = PointMassConfig::default().build()?;
            Ok(Box::new(FragileMass { inner, mean_life: self.mean_life }))
        }
    }

    struct FragileMass {
        inner: Box<dyn Simulator>,
        mean_life: u64,
    }

    impl Simulator for FragileMass {
        fn spec(&self) -> &SimulatorSpec {
            self.inner.spec()
        }
        fn reset(
            &mut self,
            task: &Task,
            start: &Start,
            observation: &mut [f32],
        ) -> Result<(), SimulatorError> {
            self.inner.reset(task, start, observation)
        }
        fn step(
            &mut self,
            action: &[f32],
            observation: &mut [f32],
            reward_terms: &mut [f64],
        ) -> Result<End, SimulatorError> {
            let end = self.inner.step(action, observation, reward_terms)?;
            if u64::from(observation[0].to_bits() >> 4).is_multiple_of(self.mean_life) {
                reward_terms[1] = f64::NAN;
            }
            Ok(end)
        }
        fn state(&self) -> Result<State, SimulatorError> {
            self.inner.state()
        }
    }
}
