//! Plays a short episode in an environment before a run spends time on it. Its result is never stored.
//!
//! Whoever rehearses has two workers do it and compares what they found: a run's units are done by several processes.

use serde::{Deserialize, Serialize};

use super::codec::{self, Malformed};
use super::{Work, WorkError};
use crate::agent::{Agent as _, RandomTorque};
use crate::policy::Monitor;
use crate::rollout::price;
use crate::seed::Seed;
use crate::simulator::{End, Simulator, SimulatorConfig, Start, check_finite};
use crate::task::Task;

/// Control steps of the episode, if it does not end before.
const STEPS: usize = 20;

/// Plays one episode of uniformly random actions in the default task: in one simulator, then twice in another.
#[derive(Debug, Serialize, Deserialize)]
pub struct Rehearse(pub Box<dyn SimulatorConfig>);

/// What a rehearsal that nothing went wrong in found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rehearsed {
    /// The first step at which the episodes differed, though their seeds and actions were the same; 0 is the reset.
    pub differed_at: Option<usize>,
    /// A hash of what came of the reset and of each step of the first episode.
    pub moments: Vec<String>,
}

/// What came of the reset or of one step: observation, reward terms, and whether the episode ended.
type Moment = (Vec<f32>, Vec<f64>, End);

impl Rehearse {
    pub(super) fn perform(&self, monitor: &mut dyn Monitor) -> Result<Vec<u8>, WorkError> {
        let expected = play(self.0.build()?.as_mut(), monitor)?;
        let mut simulator = self.0.build()?;
        let again = [play(simulator.as_mut(), monitor)?, play(simulator.as_mut(), monitor)?];
        let differed_at = again.iter().filter_map(|again| parting(&expected, again)).min();
        let moments = expected.iter().map(hash).collect();
        Ok(codec::encode(&Rehearsed { differed_at, moments }, &[]))
    }
}

fn hash((observation, terms, end): &Moment) -> String {
    let numbers = observation.iter().flat_map(|x| x.to_le_bytes());
    let bytes: Vec<u8> =
        numbers.chain(terms.iter().flat_map(|x| x.to_le_bytes())).chain([*end as u8]).collect();
    blake3::hash(&bytes).to_hex().to_string()
}

/// Where the episodes begin to differ.
fn parting<T: PartialEq>(first: &[T], second: &[T]) -> Option<usize> {
    let same = first.iter().zip(second).take_while(|(a, b)| a == b).count();
    (same < first.len().max(second.len())).then_some(same)
}

fn play(simulator: &mut dyn Simulator, monitor: &mut dyn Monitor) -> Result<Vec<Moment>, WorkError> {
    let spec = simulator.spec().clone();
    let (task, prices) = (Task::default(), spec.prices(&Task::default()));
    let (mut observation, mut terms) = (vec![0.0; spec.observation_size], vec![0.0; spec.reward_terms.len()]);
    let mut action = vec![0.0; spec.action_size()];
    let mut noise = Seed::root(0).child("rehearsal").stream();
    let mut agent = RandomTorque::new(&spec);

    monitor.progress(0, STEPS as u64)?;
    let begun = simulator.reset(&task, &Start::Seed(0), &mut observation);
    begun
        .and_then(|()| check_finite(&observation, &[]))
        .map_err(|error| WorkError::Failed(format!("at the reset: {error}")))?;
    let mut seen = vec![(observation.clone(), Vec::new(), End::Running)];
    for step in 1..=STEPS {
        monitor.progress(step as u64, STEPS as u64)?;
        agent.act(&observation, &mut noise, &mut action);
        let end = simulator.step(&action, &mut observation, &mut terms);
        let end = end.and_then(|end| check_finite(&observation, &terms).map(|()| end));
        let failed = |error| WorkError::Failed(format!("at step {step} of random actions: {error}"));
        let end = end.map_err(failed)?;
        let (reward, floor) = (price(&terms, &prices), spec.reward_floor);
        if reward < floor {
            return Err(WorkError::Failed(format!(
                "step {step} of random actions was paid {reward}, less than `reward_floor`, {floor}; expected a lower bound on \
                 every step's reward"
            )));
        }
        seen.push((observation.clone(), terms.clone(), end));
        if end != End::Running {
            break;
        }
    }
    Ok(seen)
}

impl Rehearsed {
    /// Reads a unit's result.
    ///
    /// # Errors
    /// [`Malformed`].
    pub fn decode(bytes: &[u8]) -> Result<Self, Malformed> {
        Ok(codec::decode(bytes)?.0)
    }

    /// The first step at which another process, which rehearsed the same, saw another episode.
    pub fn parting_from(&self, other: &Self) -> Option<usize> {
        parting(&self.moments, &other.moments)
    }
}

impl From<Rehearse> for Work {
    fn from(work: Rehearse) -> Self {
        Self::Rehearse(work)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::conformance::point_mass::PointMassConfig;
    use crate::fault::Faults;
    use crate::policy::Unwatched;
    use crate::simulator::{BuildError, Engine, SimulatorError, State};
    use crate::spec::SimulatorSpec;

    /// The point mass with something amiss.
    #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
    enum Amiss {
        Nothing,
        Floor,
        Noise,
        Wear,
        Nan,
        Short,
    }

    static NOISE: AtomicUsize = AtomicUsize::new(0);

    #[typetag::serde(name = "test_amiss")]
    impl SimulatorConfig for Amiss {
        fn validate(&self, _: &mut Faults) {}
        fn spec(&self) -> Result<SimulatorSpec, BuildError> {
            Ok(self.build()?.spec().clone())
        }
        fn engine(&self) -> Engine {
            Engine { name: "amiss".to_owned(), version: "1".to_owned() }
        }
        fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
            let mut spec = PointMassConfig::default().description();
            if *self == Self::Floor {
                spec.reward_floor = 1e6;
            }
            let mass = PointMassConfig::default().build()?;
            Ok(Box::new(Wrong { how: *self, spec, mass, episodes: 0, steps: 0 }))
        }
    }

    struct Wrong {
        how: Amiss,
        spec: SimulatorSpec,
        mass: Box<dyn Simulator>,
        episodes: usize,
        steps: usize,
    }

    impl Simulator for Wrong {
        fn spec(&self) -> &SimulatorSpec {
            &self.spec
        }
        fn reset(&mut self, task: &Task, start: &Start, seen: &mut [f32]) -> Result<(), SimulatorError> {
            (self.episodes, self.steps) = (self.episodes + 1, 0);
            self.mass.reset(task, start, seen)
        }
        fn step(
            &mut self,
            action: &[f32],
            seen: &mut [f32],
            terms: &mut [f64],
        ) -> Result<End, SimulatorError> {
            self.steps += 1;
            let end = self.mass.step(action, seen, terms)?;
            match (self.how, self.steps) {
                (Amiss::Nan, 4) => terms[0] = f64::NAN,
                (Amiss::Noise, 3) => seen[0] += NOISE.fetch_add(1, Ordering::SeqCst) as f32,
                (Amiss::Wear, 5) if self.episodes > 1 => seen[0] += 1.0,
                (Amiss::Short, 2) => return Ok(End::Terminated),
                _ => {}
            }
            Ok(end)
        }
        fn state(&self) -> Result<State, SimulatorError> {
            self.mass.state()
        }
    }

    fn rehearse(how: Amiss) -> Result<Rehearsed, String> {
        let done = Rehearse(Box::new(how)).perform(&mut Unwatched).map_err(|error| error.to_string())?;
        Ok(Rehearsed::decode(&done).unwrap())
    }

    #[test]
    fn a_sound_environment_is_found_sound() {
        for how in [Amiss::Nothing, Amiss::Short] {
            let (here, there) = (rehearse(how).unwrap(), rehearse(how).unwrap());
            assert_eq!((here.differed_at, here.parting_from(&there)), (None, None));
            assert_eq!(here.moments.len(), if how == Amiss::Short { 3 } else { 1 + STEPS });
        }
    }

    #[test]
    fn what_is_amiss_is_told_with_its_step() {
        let told = rehearse(Amiss::Nan).unwrap_err();
        assert!(told.contains("at step 4") && told.contains("not finite"), "{told}");
        let told = rehearse(Amiss::Floor).unwrap_err();
        assert!(told.contains("step 1 ") && told.contains("`reward_floor`, 1000000"), "{told}");
        assert_eq!(rehearse(Amiss::Noise).unwrap().differed_at, Some(3));
        // Its second episode alone differs.
        assert_eq!(rehearse(Amiss::Wear).unwrap().differed_at, Some(5));
    }

    #[test]
    fn what_differs_between_processes_is_found_by_comparing_what_they_saw() {
        let [here, shorter] = [Amiss::Nothing, Amiss::Short].map(|how| rehearse(how).unwrap());
        assert_eq!(here.parting_from(&shorter), Some(2));
        // Each episode has other noise.
        let [here, other] = [Amiss::Noise; 2].map(|how| rehearse(how).unwrap());
        assert_eq!(here.parting_from(&other), Some(3));
    }
}
