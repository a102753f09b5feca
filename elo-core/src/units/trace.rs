//! What somebody sees in some contexts, step by step: for finding out where two engines part.

use serde::{Deserialize, Serialize};

use super::codec::{self, Malformed};
use super::play::Play;
use super::{Site, Work, WorkError, input, prepare};
use crate::policy::Monitor;
use crate::rollout::{Rollout, Witness};

/// Some subjects in all contexts of the first input; the other inputs are whatever the subjects name.
#[derive(Debug, Serialize, Deserialize)]
pub struct Trace(pub Play);

/// The observations of one rollout, one after the other; the first is that of the start.
pub type Seen = Vec<f32>;

#[derive(Default)]
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
        let contexts = prepare::decode(input(inputs, 0)?)?;
        let played: Vec<(Rollout, Eyes)> = self.0.run(&contexts, inputs, site, monitor)?;
        let seen: Vec<Seen> = played.into_iter().map(|(_, eyes)| eyes.0).collect();
        Ok(codec::encode_rows(&seen, codec::f32_bytes))
    }
}

/// Reads a unit's result: the observations of each rollout, subject by subject.
///
/// # Errors
/// [`Malformed`].
pub fn decode(bytes: &[u8]) -> Result<Vec<Seen>, Malformed> {
    codec::decode_rows(bytes, codec::f32_numbers)
}

impl From<Trace> for Work {
    fn from(work: Trace) -> Self {
        Self::Trace(work)
    }
}
