//! A training between two iterations, as bytes. Rollouts are whole and every draw has a stream named by counters, so
//! networks, optimisers and counts are all there is.

use elo_core::policy::TrainError;
use elo_core::tensors::{TensorError, Tensors};
use serde::{Deserialize, Serialize};

use super::duration::Termination;
use super::learner::Part;
use super::train::{Record, Training};
use crate::checkpoint;
use crate::nn::{Adam, AdamState};

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    record: Record,
    termination: Termination,
    /// Of each part's optimiser.
    adam_steps: Vec<u64>,
}

impl Training<'_> {
    /// The bytes of a checkpoint.
    pub fn checkpoint(&mut self) -> Vec<u8> {
        let mut tensors = Tensors::new();
        let mut adam_steps = Vec::new();
        for Part { name, params, optimiser } in self.learner.parts() {
            let AdamState { steps, first_moments, second_moments } = optimiser.state();
            let mut insert = |name: &str, data: &[f32]| tensors.insert(name, &[data.len()], data.to_vec());
            insert(&name, params);
            insert(&format!("{name}.first"), first_moments);
            insert(&format!("{name}.second"), second_moments);
            adam_steps.push(*steps);
        }
        let head = Head { record: self.record.clone(), termination: self.learner.termination, adam_steps };
        checkpoint::write(&head, &tensors)
    }

    /// Goes on from a checkpoint of a training with this config, simulator and seed.
    ///
    /// # Errors
    /// Bytes that [`Self::checkpoint`] did not write, or of networks of another shape. The training is then no good any
    /// more.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), TrainError> {
        self.read(bytes)
            .map_err(|reason| TrainError::Other(format!("the checkpoint cannot be read: {reason}")))
    }

    fn read(&mut self, bytes: &[u8]) -> Result<(), String> {
        let (Head { record, termination, adam_steps }, tensors) = checkpoint::read(bytes)?;
        let mut parts = self.learner.parts();
        if adam_steps.len() != parts.len() {
            return Err(format!("it has {} parts, not {}", adam_steps.len(), parts.len()));
        }
        for (part, steps) in parts.iter_mut().zip(adam_steps) {
            restore_part(part, &tensors, steps).map_err(|error| error.to_string())?;
        }
        (self.record, self.learner.termination) = (record, termination);
        Ok(())
    }
}

fn restore_part(part: &mut Part<'_>, tensors: &Tensors, steps: u64) -> Result<(), TensorError> {
    let Part { name, params, optimiser } = part;
    params.copy_from_slice(tensors.get_shaped(name, &[params.len()])?);
    let moments = |which: &str| {
        let count = optimiser.state().first_moments.len();
        tensors.get_shaped(&format!("{name}.{which}"), &[count]).map(<[f32]>::to_vec)
    };
    let (first_moments, second_moments) = (moments("first")?, moments("second")?);
    **optimiser = Adam::from_state(AdamState { steps, first_moments, second_moments })
        .expect("both have the length of the optimiser's own");
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;
    use elo_core::context::InitialStates;
    use elo_core::policy::{Monitor, Practice, Stopped, Unwatched};
    use elo_core::task::TaskDistribution;

    use super::super::config::InterestConfig;
    use super::super::train::train;
    use super::super::worlds::practice;
    use super::*;

    fn config() -> InterestConfig {
        InterestConfig {
            steps: 240,
            rollout_steps: 40,
            context_pool: 5,
            epochs: 2,
            hidden: vec![4],
            checkpoint_every: 80,
            ..InterestConfig::default()
        }
    }

    fn with_practice<T>(run: impl FnOnce(&Practice<'_>) -> T) -> T {
        let (tasks, initial_states) = (TaskDistribution::default(), InitialStates::default());
        let simulator = PointMassConfig::default();
        run(&practice(&simulator, &tasks, &initial_states, 20, 1))
    }

    /// Stops at its `until`th checkpoint, and starts from the one that it has.
    struct Stopping {
        until: usize,
        last: Option<Vec<u8>>,
    }

    impl Monitor for Stopping {
        fn resume(&mut self) -> Option<Vec<u8>> {
            self.last.clone()
        }
        fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped> {
            self.last = Some(bytes.to_vec());
            self.until -= 1;
            if self.until == 0 { Err(Stopped) } else { Ok(()) }
        }
        fn progress(&mut self, _: u64, _: u64) -> Result<(), Stopped> {
            Ok(())
        }
    }

    #[test]
    fn an_interrupted_training_ends_as_one_that_was_not() {
        with_practice(|practice| {
            let whole = train(&config(), practice, &mut Unwatched).unwrap();
            let never =
                train(&InterestConfig { checkpoint_every: 1000, ..config() }, practice, &mut Unwatched);
            assert_eq!(never.unwrap(), whole);
            for until in [1, 2] {
                let mut monitor = Stopping { until, last: None };
                assert_eq!(train(&config(), practice, &mut monitor), Err(TrainError::Stopped(Stopped)));
                monitor.until = 100;
                assert_eq!(train(&config(), practice, &mut monitor).unwrap(), whole);
            }
        });
    }

    #[test]
    fn bytes_of_something_else_are_refused() {
        with_practice(|practice| {
            let config = config();
            let mut training = Training::new(&config, practice, &mut Unwatched).unwrap();
            training.iterate(&mut Unwatched).unwrap();
            let bytes = training.checkpoint();
            training.restore(&bytes).unwrap();
            assert_eq!(training.checkpoint(), bytes);
            for length in (0..bytes.len()).step_by(97) {
                assert!(training.restore(&bytes[..length]).is_err(), "{length} bytes");
            }
            let (wider, larger) = (
                InterestConfig { hidden: vec![5], ..config.clone() },
                Practice { set_size: 3, ..practice.clone() },
            );
            for (config, practice) in [(&wider, practice), (&config, &larger)] {
                let error =
                    Training::new(config, practice, &mut Unwatched).unwrap().restore(&bytes).unwrap_err();
                assert!(error.to_string().starts_with("the checkpoint cannot be read: "), "{error}");
            }
        });
    }
}
