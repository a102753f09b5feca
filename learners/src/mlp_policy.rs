//! The format `mlp` of stored options: a network that sees the observation, for a fixed number of steps.

use elo_core::policy::{OptionPolicy, PolicyFormat, PolicyRecord};
use elo_core::seed::Stream;
use elo_core::spec::SimulatorSpec;
use elo_core::tensors::{TensorError, Tensors};

use crate::normalized_mlp::NormalizedMlp;

/// The tensors of [`NormalizedMlp`] and `horizon` `[1]`, the duration in control steps; see [`MlpPolicy`].
pub const FORMAT: PolicyFormat = PolicyFormat {
    name: "mlp",
    summary: "a deterministic network of the normalised observation, with a duration: observation_mean [O], \
              observation_scale [O], layer{i}.weight [in, out], layer{i}.bias [out], horizon [1]",
    load,
};

/// A closed-loop option: acts by a network's output for its observation and ends after a fixed number of control steps.
#[derive(Clone, Debug, PartialEq)]
pub struct MlpPolicy {
    network: NormalizedMlp,
    horizon: usize,
}

impl MlpPolicy {
    /// The greatest duration in control steps: up to it, `f32` has every whole number.
    pub const MAX_HORIZON: usize = 1 << 24;

    /// Follows `network` for `horizon` control steps.
    ///
    /// # Panics
    /// When the duration is 0 or more than 2^24 steps.
    pub fn new(network: NormalizedMlp, horizon: usize) -> Self {
        assert!((1..=Self::MAX_HORIZON).contains(&horizon), "a duration of {horizon} steps");
        Self { network, horizon }
    }
}

impl OptionPolicy for MlpPolicy {
    fn act(&self, observation: &[f32], _elapsed: usize, _noise: &mut Stream, action: &mut [f32]) {
        self.network.evaluate(observation, action);
    }

    fn termination(&self, _observation: &[f32], elapsed: usize) -> f64 {
        if elapsed >= self.horizon { 1.0 } else { 0.0 }
    }

    fn record(&self) -> PolicyRecord {
        let mut tensors = self.network.to_tensors();
        tensors.insert("horizon", &[1], vec![self.horizon as f32]);
        PolicyRecord { format: FORMAT.name.to_owned(), tensors }
    }
}

fn load(tensors: &Tensors, spec: &SimulatorSpec) -> Result<Box<dyn OptionPolicy>, TensorError> {
    let network = NormalizedMlp::from_tensors(tensors, spec.observation_size, spec.action_size())?;
    let horizon = tensors.get_shaped("horizon", &[1])?[0];
    if horizon.fract() != 0.0 || !(1.0..=MlpPolicy::MAX_HORIZON as f32).contains(&horizon) {
        return Err(TensorError::Shape {
            name: "horizon".to_owned(),
            got: vec![1],
            expected: format!(
                "one whole number of steps from 1 to {} in it, not {horizon}",
                MlpPolicy::MAX_HORIZON
            ),
        });
    }
    Ok(Box::new(MlpPolicy { network, horizon: horizon as usize }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;
    use elo_core::seed::Seed;

    use super::*;
    use crate::kernels::running_moments::Normalizer;
    use crate::nn::Mlp;

    fn sample() -> MlpPolicy {
        let network = Mlp::orthogonal(&[2, 4, 1], 1.0, &mut Seed::root(1).stream()).unwrap();
        MlpPolicy::new(NormalizedMlp::new(Normalizer::identity(2), network), 7)
    }

    #[test]
    fn a_stored_option_acts_and_ends_as_before() {
        let spec = PointMassConfig::default().description();
        let record = sample().record();
        assert_eq!(record.format, "mlp");
        let loaded = load(&record.tensors, &spec).unwrap();
        let mut noise = Seed::root(2).stream();
        let (mut ours, mut theirs) = ([0.0], [0.0]);
        for elapsed in 0..9 {
            let observation = [0.1 * elapsed as f32, -0.3];
            sample().act(&observation, elapsed, &mut noise, &mut ours);
            loaded.act(&observation, elapsed, &mut noise, &mut theirs);
            assert_eq!(ours, theirs);
            assert_eq!(loaded.termination(&observation, elapsed), if elapsed < 7 { 0.0 } else { 1.0 });
        }
        assert_eq!(loaded.record(), record);
    }

    #[test]
    fn durations_that_are_no_number_of_steps_are_refused() {
        let spec = PointMassConfig::default().description();
        for horizon in [0.0, -1.0, 2.5, 1e9, f32::NAN] {
            let mut tensors = sample().record().tensors;
            tensors.insert("horizon", &[1], vec![horizon]);
            let error = load(&tensors, &spec).unwrap_err();
            assert!(error.to_string().contains("whole number of steps"), "{error}");
        }
    }
}
