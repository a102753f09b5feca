//! Trainings that may diverge: each attempt has a seed of its own, and the one under way is taken up where it was
//! interrupted.

use super::WorkError;
use super::codec::{self, Malformed};
use crate::policy::{Monitor, Stopped, TrainError};
use crate::seed::Seed;

/// How often a training is tried, each time with another seed, before it counts as diverged.
const ATTEMPTS: u64 = 3;

/// What came of all attempts.
pub(super) struct Outcome<T> {
    /// What was trained; `None` when every attempt diverged.
    pub trained: Option<T>,
    /// Why each earlier attempt was given up.
    pub diverged: Vec<String>,
}

/// Runs `train` with one seed below `seed` after another, until an attempt does not diverge.
pub(super) fn attempt<T>(
    seed: &Seed,
    monitor: &mut dyn Monitor,
    train: impl Fn(&Seed, &mut dyn Monitor) -> Result<T, TrainError>,
) -> Result<Outcome<T>, WorkError> {
    let mut attempts =
        monitor.resume().map(|bytes| Attempts::decode(&bytes)).transpose()?.unwrap_or_default();
    while (attempts.diverged.len() as u64) < ATTEMPTS {
        let seed = seed.child("attempt").index(attempts.diverged.len() as u64);
        match train(&seed, &mut WithinAttempts { attempts: &mut attempts, monitor }) {
            Ok(trained) => return Ok(Outcome { trained: Some(trained), diverged: attempts.diverged }),
            Err(TrainError::Diverged { steps, reason }) => {
                attempts.diverged.push(format!("after {steps} steps: {reason}"));
                attempts.checkpoint = None;
            }
            Err(TrainError::Stopped(stopped)) => return Err(stopped.into()),
            Err(TrainError::Build(error)) => return Err(error.into()),
            Err(TrainError::Other(reason)) => return Err(WorkError::Failed(reason)),
        }
    }
    Ok(Outcome { trained: None, diverged: attempts.diverged })
}

/// What a checkpoint of such a unit holds: the attempts given up, and the running one's own checkpoint.
#[derive(Debug, Default)]
struct Attempts {
    diverged: Vec<String>,
    checkpoint: Option<Vec<u8>>,
}

impl Attempts {
    fn encode(diverged: &[String], checkpoint: &[u8]) -> Vec<u8> {
        codec::encode(&diverged, &[checkpoint])
    }

    fn decode(bytes: &[u8]) -> Result<Self, Malformed> {
        let (diverged, sections) = codec::decode(bytes)?;
        Ok(Self { diverged, checkpoint: sections.first().map(|bytes| bytes.to_vec()) })
    }
}

/// Puts the attempts given up beside the running training's checkpoints.
struct WithinAttempts<'a> {
    attempts: &'a mut Attempts,
    monitor: &'a mut dyn Monitor,
}

impl Monitor for WithinAttempts<'_> {
    fn resume(&mut self) -> Option<Vec<u8>> {
        self.attempts.checkpoint.take()
    }

    fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped> {
        self.monitor.checkpoint(&Attempts::encode(&self.attempts.diverged, bytes))
    }

    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped> {
        self.monitor.progress(done, total)
    }

    fn threads(&self) -> usize {
        self.monitor.threads()
    }
}
