//! What somebody sees in some contexts, step by step: for finding out where two engines part.

use serde::{Deserialize, Serialize};

use super::codec::{self, Malformed};
use super::evaluate::Subject;
use super::{Site, Work, WorkError, input, prepare};
use crate::policy::Monitor;
use crate::rollout::{Horizon, Setting, Witness, watched};
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;

/// Some subjects in all contexts of the first input; the other inputs are whatever the subjects name.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trace {
    /// Where.
    pub simulator: Box<dyn SimulatorConfig>,
    /// Who.
    pub subjects: Vec<Subject>,
    /// For how long.
    pub horizon: Horizon,
    /// The root of the rollouts' streams, as in [`super::evaluate::Evaluate`].
    pub seed: Seed,
}

/// The observations of one rollout, one after the other; the first is that of the start.
pub type Seen = Vec<f32>;

struct Eyes(Seen);

impl Witness for Eyes {
    fn step(&mut self, observation: &[f32], _: &[f32]) {
        self.0.extend_from_slice(observation);
    }
}

impl Trace {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        let spec = site.simulator(self.simulator.as_ref())?.spec().clone();
        let contexts = prepare::decode(input(inputs, 0)?)?;
        let cast: Vec<_> = self
            .subjects
            .iter()
            .map(|subject| subject.cast(inputs, site, &spec))
            .collect::<Result<_, _>>()?;
        let simulator = site.simulator(self.simulator.as_ref())?;
        let (mut seen, total) = (Vec::new(), (cast.len() * contexts.len()) as u64);
        for (subject, cast) in self.subjects.iter().zip(&cast) {
            let seed = self.seed.child(&subject.name);
            for (j, context) in contexts.iter().enumerate() {
                monitor.progress(seen.len() as u64, total)?;
                let (mut noise, mut eyes) = (seed.index(j as u64).stream(), Eyes(Vec::new()));
                let setting = Setting { context, horizon: &self.horizon };
                cast.play(&spec, |agent| watched(&mut *simulator, agent, setting, &mut noise, &mut eyes));
                seen.push(eyes.0);
            }
        }
        Ok(encode(&seen))
    }
}

fn encode(seen: &[Seen]) -> Vec<u8> {
    let sections: Vec<Vec<u8>> = seen.iter().map(|one| codec::f32_bytes(one)).collect();
    codec::encode(&seen.len(), &sections.iter().map(Vec::as_slice).collect::<Vec<_>>())
}

/// Reads a unit's result: the observations of each rollout, subject by subject.
///
/// # Errors
/// [`Malformed`].
pub fn decode(bytes: &[u8]) -> Result<Vec<Seen>, Malformed> {
    let (count, sections): (usize, _) = codec::decode(bytes)?;
    if count != sections.len() {
        return Err(Malformed(format!("{} traces of {count}", sections.len())));
    }
    sections.iter().map(|section| codec::f32_numbers(section, section.len() / 4)).collect()
}

impl From<Trace> for Work {
    fn from(work: Trace) -> Self {
        Self::Trace(work)
    }
}
