//! Algorithm 1(a), step 2: a near-optimal policy for one task.

use serde::{Deserialize, Serialize};

use super::attempts::attempt;
use super::codec::{self, Malformed};
use super::{Work, WorkError};
use crate::agent::{Agent, RandomTorque, Taught};
use crate::context::{Context, InitialStates, PreparedStart};
use crate::policy::{CurvePoint, Lesson, Monitor, Snapshot, Stopped, TeacherConfig, TrainError, Trained};
use crate::rollout::{Ending, Horizon, price, rollout};
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;
use crate::task::Task;
use crate::tensors::Tensors;

/// One training.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Train {
    /// The world that the teacher practises in.
    pub simulator: Box<dyn SimulatorConfig>,
    /// How teachers are trained.
    pub teacher: Box<dyn TeacherConfig>,
    /// The task that it is to master.
    pub task: Task,
    /// `d0`.
    pub initial_states: InitialStates,
    /// The root of its streams.
    pub seed: Seed,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct TeacherResult {
    /// The teacher; `None` when every attempt diverged.
    pub trained: Option<Trained>,
    /// Why each earlier attempt was given up.
    pub diverged: Vec<String>,
}

/// Episodes in which a teacher is compared with random torque before it is accepted.
const TRIAL_EPISODES: u64 = 30;

/// Control steps of such an episode.
const TRIAL_STEPS: usize = 200;

impl Train {
    pub(super) fn perform(&self, monitor: &mut dyn Monitor) -> Result<Vec<u8>, WorkError> {
        let outcome = attempt(&self.seed, monitor, |seed, monitor| {
            let lesson = Lesson {
                simulator: self.simulator.as_ref(),
                task: &self.task,
                initial_states: &self.initial_states,
                seed: seed.clone(),
            };
            let trained = self.teacher.train(&lesson, monitor)?;
            self.trial(&trained, seed, monitor)?;
            Ok(trained)
        })?;
        Ok(TeacherResult { trained: outcome.trained, diverged: outcome.diverged }.encode())
    }

    /// Refuses a teacher that is worse than random torque from the same starts, beyond what chance explains, and one that breaks the
    /// simulator from every one of them, where random torque does not. A start from which a rollout of either fails says nothing else. The monitor hears of each
    /// rollout; to it the training is over.
    fn trial(&self, trained: &Trained, seed: &Seed, monitor: &mut dyn Monitor) -> Result<(), TrainError> {
        let mut simulator = self.simulator.build()?;
        let spec = simulator.spec().clone();
        let policy = self
            .teacher
            .load(&trained.policy, &spec)
            .map_err(|error| TrainError::Other(error.to_string()))?;
        let (prices, steps) = (spec.prices(&self.task), self.teacher.simulator_steps());
        let horizon = Horizon { steps: TRIAL_STEPS, discount: 1.0, stop_at_fall: true };
        let diverged = |reason: String| {
            let steps = trained.curve.last().map_or(0, |point| point.steps);
            Err(TrainError::Diverged { steps, reason })
        };
        let (mut differences, mut failures) = (Vec::new(), Vec::new());
        for episode in 0..TRIAL_EPISODES {
            let seed = seed.child("trial").index(episode);
            let start = PreparedStart::standard(seed.number());
            let context = Context { task: self.task.clone(), start };
            let mut value = |agent: &mut dyn Agent| -> Result<Result<f64, String>, Stopped> {
                monitor.progress(steps, steps)?;
                let result = rollout(simulator.as_mut(), agent, &context, &horizon, &mut seed.stream());
                Ok(match result.ending {
                    Ending::Failed(why) => Err(why),
                    _ => Ok(price(&result.term_sums, &prices)),
                })
            };
            let taught = value(&mut Taught { policy: policy.as_ref(), sampling: false })?;
            let random = value(&mut RandomTorque::new(&spec))?;
            match (taught, random) {
                (Ok(taught), Ok(random)) => differences.push(taught - random),
                (Err(why), Ok(_)) => failures.push(why),
                // That is the simulator's own doing.
                (_, Err(_)) => {}
            }
        }
        if failures.len() as u64 == TRIAL_EPISODES {
            return diverged(format!("each of its first {TRIAL_EPISODES} rollouts failed: {}", failures[0]));
        }
        if differences.len() < 2 {
            return Ok(());
        }
        let count = differences.len() as f64;
        let mean = differences.iter().sum::<f64>() / count;
        let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let upper = mean + 1.96 * (variance / count).sqrt();
        if upper < 0.0 {
            return diverged(format!("worse than random torque by {:.3} a rollout", -mean));
        }
        Ok(())
    }
}

impl From<Train> for Work {
    fn from(work: Train) -> Self {
        Self::Train(work)
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    diverged: Vec<String>,
    curve: Vec<CurvePoint>,
    snapshot_steps: Vec<u64>,
    trained: bool,
}

impl TeacherResult {
    /// The bytes of the result.
    pub fn encode(&self) -> Vec<u8> {
        let none = Trained { policy: Tensors::new(), snapshots: Vec::new(), curve: Vec::new() };
        let trained = self.trained.as_ref().unwrap_or(&none);
        let head = Head {
            diverged: self.diverged.clone(),
            curve: trained.curve.clone(),
            snapshot_steps: trained.snapshots.iter().map(|snapshot| snapshot.steps).collect(),
            trained: self.trained.is_some(),
        };
        let policies = std::iter::once(&trained.policy).chain(trained.snapshots.iter().map(|s| &s.policy));
        let sections: Vec<Vec<u8>> = policies.map(Tensors::encode).collect();
        codec::encode(&head, &sections.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// Reads a unit's result.
    ///
    /// # Errors
    /// [`Malformed`].
    pub fn decode(bytes: &[u8]) -> Result<Self, Malformed> {
        let (head, sections): (Head, _) = codec::decode(bytes)?;
        let policies: Vec<Tensors> = sections
            .iter()
            .map(|section| Tensors::decode(section).map_err(|error| Malformed(error.to_string())))
            .collect::<Result<_, _>>()?;
        let (policy, snapshots) = policies.split_first().ok_or_else(|| Malformed("no policy".to_owned()))?;
        if snapshots.len() != head.snapshot_steps.len() {
            return Err(Malformed(format!("{} snapshots", snapshots.len())));
        }
        let snapshots = head.snapshot_steps.iter().zip(snapshots);
        let snapshots =
            snapshots.map(|(steps, policy)| Snapshot { steps: *steps, policy: policy.clone() }).collect();
        let trained = Trained { policy: policy.clone(), snapshots, curve: head.curve };
        Ok(Self { trained: head.trained.then_some(trained), diverged: head.diverged })
    }
}

#[cfg(test)]
pub(super) mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::conformance::point_mass::PointMassConfig;
    use crate::fault::Faults;
    use crate::policy::{TeacherPolicy, Unwatched};
    use crate::seed::Stream;
    use crate::simulator::{BuildError, End, Engine, Simulator, SimulatorError, Start, State};
    use crate::spec::SimulatorSpec;
    use crate::tensors::TensorError;

    /// The mass on a line where every step costs, and a push of exactly 1 breaks it.
    #[derive(Debug, Serialize, Deserialize)]
    struct BrittleConfig {}

    #[typetag::serde(name = "brittle")]
    impl SimulatorConfig for BrittleConfig {
        fn validate(&self, _: &mut Faults) {}

        fn spec(&self) -> Result<SimulatorSpec, BuildError> {
            PointMassConfig::default().spec()
        }

        fn engine(&self) -> Engine {
            PointMassConfig::default().engine()
        }

        fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
            Ok(Box::new(Brittle(PointMassConfig::default().build()?)))
        }
    }

    struct Brittle(Box<dyn Simulator>);

    impl Simulator for Brittle {
        fn spec(&self) -> &SimulatorSpec {
            self.0.spec()
        }

        fn reset(&mut self, task: &Task, start: &Start, seen: &mut [f32]) -> Result<(), SimulatorError> {
            self.0.reset(task, start, seen)
        }

        fn step(
            &mut self,
            action: &[f32],
            observation: &mut [f32],
            reward_terms: &mut [f64],
        ) -> Result<End, SimulatorError> {
            if action[0] == 1.0 {
                return Err(SimulatorError::Unstable("it broke".to_owned()));
            }
            let end = self.0.step(action, observation, reward_terms)?;
            reward_terms.copy_from_slice(&[-1.0, 0.0]);
            Ok(end)
        }

        fn state(&self) -> Result<State, SimulatorError> {
            self.0.state()
        }
    }

    /// A teacher that was never trained and always does the same.
    #[derive(Debug, Serialize, Deserialize)]
    pub(in crate::units) struct SteadyConfig {
        pub action: f32,
    }

    #[typetag::serde(name = "steady")]
    impl TeacherConfig for SteadyConfig {
        fn validate(&self, _: &mut Faults) {}

        fn simulator_steps(&self) -> u64 {
            0
        }

        fn train(&self, _: &Lesson<'_>, _: &mut dyn Monitor) -> Result<Trained, TrainError> {
            Ok(Trained { policy: Tensors::new(), snapshots: Vec::new(), curve: Vec::new() })
        }

        fn untrained(&self, _: &SimulatorSpec, _: &Seed) -> Option<Tensors> {
            None
        }

        fn load(&self, _: &Tensors, _: &SimulatorSpec) -> Result<Box<dyn TeacherPolicy>, TensorError> {
            Ok(Box::new(Steady(self.action)))
        }
    }

    struct Steady(f32);

    impl TeacherPolicy for Steady {
        fn act(&self, _: &[f32], _: Option<&mut Stream>, action: &mut [f32]) {
            action.fill(self.0);
        }
    }

    #[test]
    fn a_teacher_that_breaks_the_simulator_before_anything_costs_is_refused() {
        let trained = |action| {
            let work = Train {
                simulator: Box::new(BrittleConfig {}),
                teacher: Box::new(SteadyConfig { action }),
                task: Task::default(),
                initial_states: InitialStates::default(),
                seed: Seed::root(1),
            };
            TeacherResult::decode(&work.perform(&mut Unwatched).unwrap()).unwrap()
        };
        let breaking = trained(1.0);
        assert_eq!(breaking.trained, None);
        assert_eq!(breaking.diverged.len(), 3);
        let reason = &breaking.diverged[0];
        assert!(
            reason.contains("each of its first 30 rollouts failed: ") && reason.contains("it broke"),
            "{reason}"
        );
        assert!(trained(0.999).trained.is_some());
    }
}
