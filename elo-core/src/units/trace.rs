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

/// What a unit gives.
#[derive(Clone, Debug, PartialEq)]
pub enum Traced {
    /// What was seen in each rollout, subject by subject.
    Rollouts(Vec<Seen>),
    /// Nothing, because no worker could be kept alive: why.
    Lost(String),
}

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
        let seen = played.into_iter().map(|(_, eyes)| eyes.0).collect();
        Ok(Traced::Rollouts(seen).encode())
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Lost {
    lost: String,
}

impl Traced {
    /// The bytes.
    pub(super) fn encode(&self) -> Vec<u8> {
        match self {
            Self::Rollouts(seen) => codec::encode_rows(seen, codec::f32_bytes),
            Self::Lost(reason) => codec::encode(&Lost { lost: reason.clone() }, &[]),
        }
    }

    /// Reads a unit's result.
    ///
    /// # Errors
    /// [`Malformed`].
    pub fn decode(bytes: &[u8]) -> Result<Self, Malformed> {
        match codec::decode::<Lost>(bytes) {
            Ok((Lost { lost }, _)) => Ok(Self::Lost(lost)),
            Err(_) => codec::decode_rows(bytes, codec::f32_numbers).map(Self::Rollouts),
        }
    }
}

impl From<Trace> for Work {
    fn from(work: Trace) -> Self {
        Self::Trace(work)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn what_was_seen_and_why_nothing_was_come_back() {
        for traced in [Traced::Rollouts(vec![vec![0.5, 1.0], vec![]]), Traced::Lost("it died".to_owned())] {
            let bytes = traced.encode();
            assert_eq!(Traced::decode(&bytes).unwrap(), traced);
            assert!((0..bytes.len()).all(|length| Traced::decode(&bytes[..length]).is_err()), "{traced:?}");
        }
    }
}
