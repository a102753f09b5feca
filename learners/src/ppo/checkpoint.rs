//! All that a training is made of between two iterations, and its bytes.
//!
//! Every random draw has a stream named by counters, so that numbers are enough to go on. Training itself goes on from
//! what it reads back from the bytes, whether or not it was interrupted.

use elo_core::policy::{CurvePoint, Snapshot};
use elo_core::seed::Seed;
use elo_core::spec::SimulatorSpec;
use elo_core::tensors::{TensorError, Tensors};
use serde::{Deserialize, Serialize};

use super::config::PpoConfig;
use super::environment::AtRest;
use super::learner::Learner;
use crate::acting::Tally;
use crate::checkpoint;
use crate::fields::widths;
use crate::kernels::running_moments::{ReturnScaler, RunningMoments};
use crate::nn::{Adam, AdamState, Mlp};

/// The training between two iterations.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Progress {
    /// What is being trained.
    pub learner: Learner,
    /// How far it is, and what was seen.
    pub record: Record,
    /// Policies kept on the way.
    pub snapshots: Vec<Snapshot>,
}

/// The part of [`Progress`] that is no network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    /// Iterations done.
    pub iteration: u64,
    /// Of all observations acted on.
    pub moments: RunningMoments,
    /// Scale of the rewards.
    pub scaler: ReturnScaler,
    /// Counts.
    pub tally: Tally,
    /// Where each environment was put down.
    pub environments: Vec<AtRest>,
    /// The learning curve so far.
    pub curve: Vec<CurvePoint>,
}

/// Why bytes are no checkpoint of this training.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the checkpoint cannot be read: {0}")]
pub(super) struct BadCheckpoint(String);

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    record: Record,
    adam_steps: [u64; 3],
    snapshot_steps: Vec<u64>,
}

impl Progress {
    /// Before the first iteration.
    pub fn new(config: &PpoConfig, spec: &SimulatorSpec, seed: &Seed) -> Self {
        let record = Record {
            iteration: 0,
            moments: RunningMoments::new(spec.observation_size),
            scaler: ReturnScaler::new(config.environments, config.gamma),
            tally: Tally::default(),
            environments: vec![AtRest::default(); config.environments],
            curve: Vec::new(),
        };
        Self { learner: Learner::new(config, spec, seed), record, snapshots: Vec::new() }
    }

    /// The bytes of a checkpoint.
    pub fn encode(&self) -> Vec<u8> {
        let Learner { policy, log_std, critic, optimisers } = &self.learner;
        let mut tensors = Tensors::new();
        let mut insert = |name: &str, data: &[f32]| tensors.insert(name, &[data.len()], data.to_vec());
        insert("policy", policy.params());
        insert("log_std", log_std);
        insert("critic", critic.params());
        for (index, optimiser) in optimisers.iter().enumerate() {
            insert(&format!("adam{index}.first"), &optimiser.state().first_moments);
            insert(&format!("adam{index}.second"), &optimiser.state().second_moments);
        }
        for (index, snapshot) in self.snapshots.iter().enumerate() {
            tensors.extend_prefixed(&snapshot_prefix(index), &snapshot.policy);
        }
        let head = Head {
            record: self.record.clone(),
            adam_steps: [0, 1, 2].map(|index: usize| optimisers[index].state().steps),
            snapshot_steps: self.snapshots.iter().map(|snapshot| snapshot.steps).collect(),
        };
        checkpoint::write(&head, &tensors)
    }

    /// Reads a checkpoint of a training with this config on a robot of this spec.
    ///
    /// # Errors
    /// Bytes that [`Self::encode`] did not write, or of networks or environments of another shape.
    pub fn decode(bytes: &[u8], config: &PpoConfig, spec: &SimulatorSpec) -> Result<Self, BadCheckpoint> {
        let (head, tensors) = checkpoint::read::<Head>(bytes).map_err(BadCheckpoint)?;
        if head.record.environments.len() != config.environments {
            return Err(BadCheckpoint(format!("it has {} environments", head.record.environments.len())));
        }
        let snapshots = head.snapshot_steps.iter().enumerate().map(|(index, &steps)| {
            let policy = tensors.with_prefix(&snapshot_prefix(index));
            Snapshot { steps, policy }
        });
        Ok(Self {
            learner: learner(&tensors, head.adam_steps, config, spec)?,
            snapshots: snapshots.collect(),
            record: head.record,
        })
    }
}

fn learner(
    tensors: &Tensors,
    adam_steps: [u64; 3],
    config: &PpoConfig,
    spec: &SimulatorSpec,
) -> Result<Learner, BadCheckpoint> {
    let (inputs, actions) = (spec.observation_size, spec.action_size());
    let network = |name: &str, outputs: usize| {
        let params = tensors.get(name)?.data.clone();
        let network = Mlp::from_params(&widths(inputs, &config.hidden, outputs), params);
        network.map_err(|error| BadCheckpoint(error.to_string()))
    };
    let (policy, critic) = (network("policy", actions)?, network("critic", 1)?);
    let adam = |index: usize, parameters: usize| {
        let moments = |which: &str| {
            tensors.get_shaped(&format!("adam{index}.{which}"), &[parameters]).map(<[f32]>::to_vec)
        };
        let (first_moments, second_moments) = (moments("first")?, moments("second")?);
        let state = AdamState { steps: adam_steps[index], first_moments, second_moments };
        Adam::from_state(state).map_err(|error| BadCheckpoint(error.to_string()))
    };
    let optimisers = [adam(0, policy.params().len())?, adam(1, actions)?, adam(2, critic.params().len())?];
    let log_std = tensors.get_shaped("log_std", &[actions])?.to_vec();
    Ok(Learner { policy, log_std, critic, optimisers })
}

fn snapshot_prefix(index: usize) -> String {
    format!("snapshot{index}/")
}

impl From<TensorError> for BadCheckpoint {
    fn from(error: TensorError) -> Self {
        Self(error.to_string())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;
    use elo_core::policy::TeacherConfig as _;

    use super::*;

    fn sample(config: &PpoConfig, spec: &SimulatorSpec) -> Progress {
        let mut progress = Progress::new(config, spec, &Seed::root(1));
        progress.record.moments.update(&[0.1, 0.2, 0.3, 0.7]);
        progress.record.scaler.scale(1, 0.1);
        progress.record.curve.push(CurvePoint { steps: 9, mean_return: Some(0.1), mean_length: None });
        let gradient = vec![0.1; progress.learner.log_std.len()];
        progress.learner.optimisers[1].step(&mut progress.learner.log_std, &gradient, 0.01);
        let policy = config.untrained(spec, &Seed::root(2)).unwrap();
        // Eleven, so that the names of the first and of the eleventh begin alike.
        progress.snapshots = (0..11).map(|index| Snapshot { steps: index, policy: policy.clone() }).collect();
        progress
    }

    #[test]
    fn a_checkpoint_gives_back_every_bit() {
        let config = PpoConfig { environments: 2, ..PpoConfig::default() };
        let spec = PointMassConfig::default().description();
        let progress = sample(&config, &spec);
        let read = Progress::decode(&progress.encode(), &config, &spec).unwrap();
        assert_eq!(read, progress);
        assert_eq!(read.encode(), progress.encode());
    }

    #[test]
    fn bytes_of_something_else_are_refused() {
        let config = PpoConfig { environments: 2, ..PpoConfig::default() };
        let spec = PointMassConfig::default().description();
        let bytes = sample(&config, &spec).encode();
        for length in (0..bytes.len()).step_by(97) {
            assert!(Progress::decode(&bytes[..length], &config, &spec).is_err(), "{length} bytes");
        }
        assert!(Progress::decode(&u64::MAX.to_le_bytes(), &config, &spec).is_err());
        let narrower = PpoConfig { hidden: vec![8], ..config.clone() };
        let message = Progress::decode(&bytes, &narrower, &spec).unwrap_err().to_string();
        assert!(message.starts_with("the checkpoint cannot be read: a network of widths"), "{message}");
        let more = PpoConfig { environments: 4, ..config };
        assert!(Progress::decode(&bytes, &more, &spec).is_err());
    }
}
