//! The start from recordings: the policy of option `o` is fitted to what a teacher did in recording `o`, by behaviour
//! cloning; those that fell are left out, so it is the `o`th of the others. Interests, `ε` and the critic begin as they do from scratch.
//!
//! All networks of a set see observations on one scale. From scratch it follows what the infant agent sees; from recordings it
//! is theirs and stays, because a clone that saw them on another scale would do something else.

use elo_core::policy::{Practice, TrainError};
use elo_core::spec::SimulatorSpec;

use super::config::InterestConfig;
use super::learner::Learner;
use crate::behavior_cloning::{BehaviorCloningConfig, normalizer_of};
use crate::demonstration;
use crate::kernels::running_moments::Normalizer;

/// The scale of the recordings; `None` where practice begins from scratch.
///
/// # Errors
/// A recording that is none, or of another robot; no recording where practice is to begin from some.
pub(super) fn scale(
    config: &InterestConfig,
    practice: &Practice<'_>,
    spec: &SimulatorSpec,
) -> Result<Option<Normalizer>, TrainError> {
    for recording in practice.demonstrations {
        demonstration::check(recording, spec, usize::MAX).map_err(TrainError::Other)?;
    }
    if config.imitation_start && practice.demonstrations.is_empty() {
        return Err(TrainError::Other("`imitation_start` needs recordings to begin from".to_owned()));
    }
    Ok(config.imitation_start.then(|| normalizer_of(practice.demonstrations, spec.observation_size)))
}

/// Fits policies to recordings on their `scale`. Options for which there is none, because it fell, stay as they are.
///
/// # Errors
/// A fit that does not converge.
pub(super) fn imitate(
    learner: &mut Learner,
    practice: &Practice<'_>,
    scale: &Normalizer,
) -> Result<(), TrainError> {
    for (index, (policy, recording)) in learner.policies.iter_mut().zip(practice.demonstrations).enumerate() {
        let sizes = policy.means.network.sizes();
        let cloning = BehaviorCloningConfig {
            hidden: sizes[1..sizes.len() - 1].to_vec(),
            ..BehaviorCloningConfig::default()
        };
        let seed = practice.seed.child("imitation").index(index as u64);
        policy.means.network = cloning.fit(recording, scale, &seed).map_err(TrainError::Other)?;
    }
    Ok(())
}
