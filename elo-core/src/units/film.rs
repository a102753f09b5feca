//! What rollouts look like, step by step: for drawing them.

use serde::{Deserialize, Serialize};

use super::codec::{self, Malformed};
use super::evaluate::Evaluate;
use super::{Site, Work, WorkError};
use crate::policy::Monitor;
use crate::rollout::{Rollout, Witness, price};
use crate::scene::{Pose, Scene, Visible};
use crate::simulator::Simulator;

/// Some of the rollouts of a unit of that stage, with the same inputs and the same random streams: the very rollouts that
/// it measures, bit for bit.
///
/// Costs their control steps again, and in its result 28 bytes a body and step. Where there is nothing to be seen it takes
/// no step.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Film {
    /// Who, where, and for how long.
    pub rollouts: Evaluate,
    /// Only in so many of the contexts, the first.
    pub first: usize,
}

/// What a unit gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Filmed {
    /// What the simulator looks like; `None` where it cannot be seen, or its worker was lost. Then there are no takes.
    pub scene: Option<Scene>,
    /// Each rollout, subject by subject, in each one the contexts in order.
    pub takes: Vec<Take>,
}

/// One rollout.
#[derive(Clone, Debug, PartialEq)]
pub struct Take {
    /// Poses of all bodies at the start, then after each control step, to the precision of `f32`. A rollout that failed
    /// ends before the step that it failed in.
    pub steps: Vec<Vec<Pose>>,
    /// The return under the context's task; `None` for a rollout that failed.
    pub returns: Option<f64>,
}

/// Sees the poses, as long as there are any.
#[derive(Default)]
struct Camera {
    steps: Vec<Vec<Pose>>,
    stopped: bool,
}

impl Witness for Camera {
    fn step(&mut self, _: &[f32], _: &[f32]) {}

    fn look(&mut self, simulator: &dyn Simulator) {
        let finite = |poses: &Vec<Pose>| poses.iter().flat_map(Pose::numbers).all(f64::is_finite);
        let poses = simulator.visible().and_then(|visible| visible.poses().ok()).filter(finite);
        match poses {
            Some(poses) if !self.stopped => self.steps.push(poses),
            _ => self.stopped = true,
        }
    }
}

impl Film {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        let simulator = &self.rollouts.play.simulator;
        let scene = site.simulator(simulator.as_ref())?.visible().map(Visible::scene);
        let Some(scene) = scene.filter(|scene| !scene.bodies.is_empty()) else {
            return Ok(Filmed::nothing().encode());
        };
        let mut contexts = self.rollouts.read_contexts(inputs)?;
        contexts.truncate(self.first);
        let played: Vec<(Rollout, Camera)> = self.rollouts.play.run(&contexts, inputs, site, monitor)?;
        let spec = simulator.spec()?;
        let prices: Vec<Vec<f64>> = contexts.iter().map(|context| spec.prices(&context.task)).collect();
        let bodies = scene.bodies.len();
        let take = |((rollout, camera), prices): ((Rollout, Camera), &Vec<f64>)| match camera
            .steps
            .iter()
            .map(Vec::len)
            .find(|poses| *poses != bodies)
        {
            Some(poses) => Err(WorkError::Failed(format!("{poses} poses of a scene of {bodies} bodies"))),
            None => Ok(Take {
                steps: camera.steps,
                returns: rollout.ending.is_valid().then(|| price(&rollout.term_sums, prices)),
            }),
        };
        let takes = played.into_iter().zip(prices.iter().cycle()).map(take).collect::<Result<_, _>>()?;
        Ok(Filmed { scene: Some(scene), takes }.encode())
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    scene: Option<Scene>,
    /// Steps and return of each take.
    takes: Vec<(usize, Option<f64>)>,
}

impl Filmed {
    /// Of what cannot be seen.
    pub(super) fn nothing() -> Self {
        Self { scene: None, takes: Vec::new() }
    }

    /// The bytes: scene and returns as JSON, then a section of `f32` a take.
    pub fn encode(&self) -> Vec<u8> {
        let head = Head {
            scene: self.scene.clone(),
            takes: self.takes.iter().map(|take| (take.steps.len(), take.returns)).collect(),
        };
        let numbers = |take: &Take| -> Vec<f32> {
            take.steps.iter().flatten().flat_map(Pose::numbers).map(|x| x as f32).collect()
        };
        let sections: Vec<Vec<u8>> = self.takes.iter().map(|take| codec::f32_bytes(&numbers(take))).collect();
        codec::encode(&head, &sections.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// Reads a unit's result.
    ///
    /// # Errors
    /// [`Malformed`].
    pub fn decode(bytes: &[u8]) -> Result<Self, Malformed> {
        let (head, sections): (Head, _) = codec::decode(bytes)?;
        if head.takes.len() != sections.len() {
            return Err(Malformed(format!("{} films of {}", sections.len(), head.takes.len())));
        }
        let bodies = head.scene.as_ref().map_or(0, |scene| scene.bodies.len());
        let take = |((steps, returns), section): ((usize, Option<f64>), &[u8])| {
            let size = steps.checked_mul(7 * bodies).filter(|size| steps <= *size && *size <= section.len());
            let size = size.ok_or_else(|| Malformed(format!("{steps} steps in {} bytes", section.len())))?;
            let numbers = codec::f32_numbers(section, size)?;
            let mut poses = numbers.as_chunks::<7>().0.iter().map(|numbers| {
                let [x, y, z, w, i, j, k] = numbers.map(f64::from);
                Pose { position: [x, y, z], rotation: [w, i, j, k] }
            });
            let steps = (0..steps).map(|_| poses.by_ref().take(bodies).collect()).collect();
            Ok(Take { steps, returns })
        };
        let takes = head.takes.into_iter().zip(sections).map(take).collect::<Result<_, Malformed>>()?;
        Ok(Self { scene: head.scene, takes })
    }
}

impl From<Film> for Work {
    fn from(work: Film) -> Self {
        Self::Film(work)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::evaluate::{Behavior, RolloutTable, Subject};
    use super::super::loss::AfterLoss;
    use super::super::play::Play;
    use super::super::prepare;
    use super::*;
    use crate::conformance::point_mass::PointMassConfig;
    use crate::context::{Context, PreparedStart};
    use crate::policy::Unwatched;
    use crate::rollout::Horizon;
    use crate::seed::Seed;
    use crate::simulator::{SimulatorConfig as _, Start};
    use crate::task::Task;

    fn rollouts() -> Evaluate {
        let subject = |name: &str, behavior| Subject { name: name.to_owned(), behavior };
        let play = Play {
            simulator: Box::new(PointMassConfig::default()),
            subjects: vec![subject("random", Behavior::RandomTorque), subject("zero", Behavior::ZeroTorque)],
            horizon: Horizon { steps: 30, discount: 0.9, stop_at_fall: true },
            seed: Seed::root(3),
        };
        Evaluate { contexts: 2, play }
    }

    /// Two units of contexts, with a dear task and a start at the wall.
    fn inputs() -> Vec<Vec<u8>> {
        let dear = Task::new([("effort_cost", -1.0)]);
        let at_the_wall = {
            let mut simulator = PointMassConfig::default().build().unwrap();
            simulator.reset(&Task::default(), &Start::Seed(0), &mut [0.0; 2]).unwrap();
            let mut state = simulator.state().unwrap();
            (state.positions[0], state.velocities[0]) = (1.97, 0.5);
            PreparedStart { start: Start::State(state), ..PreparedStart::standard(0) }
        };
        let standard = |seed, task| Context { task, start: PreparedStart::standard(seed) };
        let fall = Context { task: Task::default(), start: at_the_wall };
        vec![prepare::encode(&[standard(1, dear), fall]), prepare::encode(&[standard(2, Task::default())])]
    }

    fn done(work: &Work) -> Vec<u8> {
        work.perform(&inputs(), &mut Site::new(Vec::new()), &mut Unwatched).unwrap()
    }

    #[test]
    fn a_film_shows_the_very_rollout_that_is_measured() {
        let filmed = |first| Filmed::decode(&done(&Film { rollouts: rollouts(), first }.into())).unwrap();
        let all = filmed(3);
        let table = RolloutTable::decode(&done(&rollouts().into())).unwrap();
        assert_eq!((all.takes.len(), table.contexts), (6, 3));
        let prices = [[1.0, -1.0], [1.0, -0.1], [1.0, -0.1]];
        for (i, (take, rollout)) in all.takes.iter().zip(&table.rollouts).enumerate() {
            assert_eq!(take.returns, Some(price(&rollout.term_sums, &prices[i % 3])), "{i}");
            assert_eq!(take.steps.len(), rollout.length as usize + 1, "{i}");
        }
        assert_eq!(all.takes[1].steps.len(), 3, "0.025 m a step from 1.97 to beyond 2");
        let places = |take: &Take| take.steps.iter().map(|poses| poses[0].position[0]).collect::<Vec<_>>();
        assert!(places(&all.takes[1])[2] >= 2.0, "the fall is seen");
        assert!(places(&all.takes[3]).iter().all(|x| *x == places(&all.takes[3])[0]), "nothing pushes it");
        // The first contexts alone, and again: the same.
        let some = filmed(2);
        assert_eq!(some.takes, [0, 1, 3, 4].map(|i| all.takes[i].clone()));
        assert_eq!(some.scene.as_ref().unwrap().bodies, ["mass"]);
        assert_eq!(filmed(2), some);
    }

    #[test]
    fn every_truncation_is_noticed_and_lost_workers_leave_nothing() {
        let work = Work::from(Film { rollouts: rollouts(), first: 1 });
        let bytes = done(&work);
        let decoded = Filmed::decode(&bytes).unwrap();
        assert_eq!(decoded.encode(), bytes);
        assert!((0..bytes.len()).all(|length| Filmed::decode(&bytes[..length]).is_err()));
        let greedy = Filmed { scene: None, takes: decoded.takes };
        assert!(Filmed::decode(&greedy.encode()).is_err(), "steps without bodies");
        let Some(AfterLoss::Result(lost)) = work.after_loss(&inputs(), None, "it died").unwrap() else {
            panic!("a film is never taken up again");
        };
        assert_eq!(Filmed::decode(&lost).unwrap(), Filmed::nothing());
    }
}
