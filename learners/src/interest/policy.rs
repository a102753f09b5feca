//! The format `interest` of stored options: a stochastic policy, an interest and a constant probability of ending.

use elo_core::policy::{OptionPolicy, PolicyFormat, PolicyRecord};
use elo_core::seed::Stream;
use elo_core::spec::SimulatorSpec;
use elo_core::tensors::{TensorError, Tensors};

use crate::nn::DiagonalGaussian;
use crate::normalized_mlp::NormalizedMlp;

/// See [`InterestPolicy`].
pub const FORMAT: PolicyFormat = PolicyFormat {
    name: "interest",
    summary: "a stochastic network of the normalised observation with an interest and a probability of ending: \
              policy/ and log_interest/, each with observation_mean [O], observation_scale [O], \
              layer{i}.weight [in, out], layer{i}.bias [out]; log_std [A], ending [1]",
    load,
};

/// Log-interests beyond this are cut, so that interests are normal numbers in single precision, as are the sums of many. Practice
/// knows no such limit, and comes nowhere near it.
const MAX_LOG_INTEREST: f32 = 80.0;

/// A closed-loop option: draws its action around a network's output, is preferred where another network says so, and ends
/// after each action with the same probability.
#[derive(Clone, Debug, PartialEq)]
pub struct InterestPolicy {
    /// Means of the actions.
    pub means: NormalizedMlp,
    /// Logarithms of the actions' standard deviations.
    pub log_std: Vec<f32>,
    /// `log I_o`.
    pub log_interest: NormalizedMlp,
    /// `ε`.
    pub ending: f32,
}

impl OptionPolicy for InterestPolicy {
    fn interest(&self, observation: &[f32]) -> f32 {
        let mut z = [0.0];
        self.log_interest.evaluate(observation, &mut z);
        z[0].clamp(-MAX_LOG_INTEREST, MAX_LOG_INTEREST).exp()
    }

    fn act(&self, observation: &[f32], _elapsed: usize, noise: &mut Stream, action: &mut [f32]) {
        let mut means = vec![0.0; action.len()];
        self.means.evaluate(observation, &mut means);
        DiagonalGaussian { means: &means, log_std: &self.log_std }.sample(noise, action);
    }

    fn termination(&self, _observation: &[f32], _elapsed: usize) -> f64 {
        f64::from(self.ending)
    }

    fn record(&self) -> PolicyRecord {
        let mut tensors = Tensors::new();
        tensors.extend_prefixed("policy/", &self.means.to_tensors());
        tensors.extend_prefixed("log_interest/", &self.log_interest.to_tensors());
        tensors.insert("log_std", &[self.log_std.len()], self.log_std.clone());
        tensors.insert("ending", &[1], vec![self.ending]);
        PolicyRecord { format: FORMAT.name.to_owned(), tensors }
    }
}

fn load(tensors: &Tensors, spec: &SimulatorSpec) -> Result<Box<dyn OptionPolicy>, TensorError> {
    let network = |prefix: &str, outputs: usize| {
        NormalizedMlp::from_tensors(&tensors.with_prefix(prefix), spec.observation_size, outputs)
    };
    let log_std = tensors.get_shaped("log_std", &[spec.action_size()])?.to_vec();
    if !log_std.iter().all(|x| x.is_finite()) {
        return Err(TensorError::NotFinite("log_std".to_owned()));
    }
    let ending = tensors.get_shaped("ending", &[1])?[0];
    if !(ending > 0.0 && ending <= 1.0) {
        let expected = format!("one probability above 0 in it, not {ending}");
        return Err(TensorError::Shape { name: "ending".to_owned(), got: vec![1], expected });
    }
    let (means, log_interest) = (network("policy/", spec.action_size())?, network("log_interest/", 1)?);
    Ok(Box::new(InterestPolicy { means, log_std, log_interest, ending }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;
    use elo_core::seed::Seed;

    use super::*;
    use crate::kernels::running_moments::Normalizer;
    use crate::nn::Mlp;

    fn sample() -> InterestPolicy {
        let network = |seed| {
            let network = Mlp::orthogonal(&[2, 4, 1], 1.0, &mut Seed::root(seed).stream()).unwrap();
            NormalizedMlp::new(Normalizer::identity(2), network)
        };
        InterestPolicy { means: network(1), log_std: vec![-0.5], log_interest: network(2), ending: 0.25 }
    }

    #[test]
    fn a_stored_option_is_the_same() {
        let spec = PointMassConfig::default().description();
        let loaded = load(&sample().record().tensors, &spec).unwrap();
        assert_eq!(loaded.record(), sample().record());
        let (mut ours, mut theirs) = ([0.0], [0.0]);
        for x in [-1.0, 0.0, 0.7] {
            sample().act(&[x, 0.3], 0, &mut Seed::root(3).stream(), &mut ours);
            loaded.act(&[x, 0.3], 0, &mut Seed::root(3).stream(), &mut theirs);
            assert_eq!(ours, theirs);
            assert_eq!(loaded.interest(&[x, 0.3]), sample().interest(&[x, 0.3]));
            assert!(loaded.interest(&[x, 0.3]) > 0.0);
        }
        assert_eq!(loaded.termination(&[0.0, 0.0], 3), 0.25);
    }

    #[test]
    fn tensors_of_no_option_are_refused() {
        let spec = PointMassConfig::default().description();
        for ending in [0.0, -0.1, 1.5, f32::NAN] {
            let mut tensors = sample().record().tensors;
            tensors.insert("ending", &[1], vec![ending]);
            assert!(load(&tensors, &spec).unwrap_err().to_string().contains("one probability"));
        }
        let mut tensors = sample().record().tensors;
        tensors.insert("log_std", &[2], vec![0.0; 2]);
        assert!(load(&tensors, &spec).is_err());
        tensors.insert("log_std", &[1], vec![f32::NAN]);
        assert!(load(&tensors, &spec).is_err());
    }
}
