//! Subjects in contexts, each by its own random stream: what evaluating and tracing have in common.

use serde::{Deserialize, Serialize};

use super::arena::Arena;
use super::evaluate::Subject;
use super::{Site, WorkError};
use crate::context::Context;
use crate::policy::Monitor;
use crate::rollout::{Horizon, Rollout, Setting, Witness, watched};
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;

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
        let spec = site.simulator(self.simulator.as_ref())?.spec().clone();
        let cast = self.subjects.iter().map(|subject| subject.cast(inputs, site, &spec));
        let cast = cast.collect::<Result<Vec<_>, _>>()?;
        let total = (cast.len() * contexts.len()) as u64;
        let mut played = Vec::with_capacity(cast.len() * contexts.len());
        let mut arena = Arena::new(site, self.simulator.as_ref());
        for (subject, cast) in self.subjects.iter().zip(&cast) {
            let seed = self.seed.child(&subject.name);
            for (j, context) in contexts.iter().enumerate() {
                monitor.progress(played.len() as u64, total)?;
                played.push(arena.roll_out(|simulator| {
                    let (mut noise, mut witness) = (seed.index(j as u64).stream(), W::default());
                    let setting = Setting { context, horizon: &self.horizon };
                    let rollout = cast.play(&spec, |agent| {
                        watched(&mut *simulator, agent, setting, &mut noise, &mut witness)
                    });
                    (rollout, witness)
                })?);
            }
        }
        Ok(played)
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
