//! Subjects in contexts, each by its own random stream: what evaluating and tracing have in common.

use serde::{Deserialize, Serialize};

use super::arena::Arena;
use super::evaluate::{Cast, Subject};
use super::{Site, WorkError};
use crate::context::Context;
use crate::policy::Monitor;
use crate::rollout::{Horizon, Rollout, Setting, Witness, watched};
use crate::seed::Seed;
use crate::simulator::{BuildError, SimulatorConfig};
use crate::spec::SimulatorSpec;

/// Who plays where, and for how long.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Play {
    /// The world that they play in.
    pub simulator: Box<dyn SimulatorConfig>,
    /// Who plays, one after the other.
    pub subjects: Vec<Subject>,
    /// Length, discount and end of a rollout.
    pub horizon: Horizon,
    /// The root of the rollouts' streams: context `j` of subject `n` draws from `seed / n / j`.
    pub seed: Seed,
}

impl Play {
    /// Runs every subject in every context, subject by subject; gives each rollout with what its witness saw.
    pub(super) fn run<W: Witness + Default>(
        &self,
        contexts: &[Context],
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<(Rollout, W)>, WorkError> {
        let mut ensemble = self.ensemble(contexts, inputs, site)?;
        let total = ensemble.rollouts();
        let mut played = Vec::with_capacity(total);
        for number in 0..total {
            monitor.progress(number as u64, total as u64)?;
            played.push(ensemble.play(number)?);
        }
        Ok(played)
    }

    /// Loads all subjects.
    pub(super) fn ensemble<'a>(
        &'a self,
        contexts: &'a [Context],
        inputs: &[Vec<u8>],
        site: &'a mut Site,
    ) -> Result<Ensemble<'a>, WorkError> {
        let spec = site.simulator(self.simulator.as_ref())?.spec().clone();
        let cast = self.subjects.iter().map(|subject| subject.cast(inputs, site, &spec));
        let cast = cast.collect::<Result<Vec<_>, _>>()?;
        let arena = Arena::new(site, self.simulator.as_ref());
        Ok(Ensemble { play: self, contexts, cast, spec, arena })
    }
}

/// All that is needed to play any of the rollouts, each by itself.
pub(super) struct Ensemble<'a> {
    play: &'a Play,
    contexts: &'a [Context],
    cast: Vec<Cast>,
    spec: SimulatorSpec,
    arena: Arena<'a>,
}

impl Ensemble<'_> {
    /// How many there are.
    pub(super) fn rollouts(&self) -> usize {
        self.cast.len() * self.contexts.len()
    }

    /// Plays rollout `number`, as they are counted subject by subject.
    pub(super) fn play<W: Witness + Default>(&mut self, number: usize) -> Result<(Rollout, W), BuildError> {
        let (subject, j) = (number / self.contexts.len(), number % self.contexts.len());
        let seed = self.play.seed.child(&self.play.subjects[subject].name).index(j as u64);
        let setting = Setting { context: &self.contexts[j], horizon: &self.play.horizon };
        self.arena.roll_out(|simulator| {
            let (mut noise, mut witness) = (seed.stream(), W::default());
            let rollout = self.cast[subject]
                .play(&self.spec, |agent| watched(&mut *simulator, agent, setting, &mut noise, &mut witness));
            (rollout, witness)
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::conformance::point_mass::PointMassConfig;
    use crate::units::Work;
    use crate::units::evaluate::{Behavior, Evaluate};
    use crate::units::trace::Trace;

    fn play() -> Play {
        Play {
            simulator: Box::new(PointMassConfig::default()),
            subjects: vec![Subject { name: "one".to_owned(), behavior: Behavior::RandomTorque }],
            horizon: Horizon { steps: 5, discount: 0.98, stop_at_fall: true },
            seed: Seed::root(u64::MAX).child("a"),
        }
    }

    #[test]
    fn what_both_stages_share_keeps_its_fields_and_keys() {
        let works = [
            (
                Work::from(Evaluate { contexts: 2, play: play() }),
                "a354c9b05291c26dc4167c7d9bbeec60f909d04f428e5dcd103408bb993e106b",
            ),
            (Work::from(Trace(play())), "f8d7ccdd929002dce10cb4b69dbc79d53685dcbad40be11f148d65665d6dc52a"),
        ];
        for (work, key) in works {
            assert_eq!(work.key(&[], "elo 1").to_string(), key);
            let mut form = serde_json::to_value(&work).unwrap();
            let again: Work = serde_json::from_slice(&serde_json::to_vec(&work).unwrap()).unwrap();
            assert_eq!(again.key(&[], "elo 1").to_string(), key);
            form["lengths"] = 5.into();
            assert!(serde_json::from_value::<Work>(form).unwrap_err().to_string().contains("lengths"));
        }
    }
}
