//! What training changes: policy and critic, each with its optimiser.

use elo_core::seed::Seed;
use elo_core::spec::SimulatorSpec;

use super::config::PpoConfig;
use crate::divergence::divergence;
use crate::fields::widths;
use crate::nn::{Adam, Mlp};

/// `π_θ` and the critic `V`, with the optimisers' memory.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Learner {
    /// Means of the actions.
    pub policy: Mlp,
    /// Logarithms of the actions' standard deviations.
    pub log_std: Vec<f32>,
    /// Values of observations, in scaled rewards.
    pub critic: Mlp,
    /// Of `policy`, `log_std` and `critic`.
    pub optimisers: [Adam; 3],
}

impl Learner {
    /// The state before any training.
    pub fn new(config: &PpoConfig, spec: &SimulatorSpec, seed: &Seed) -> Self {
        let policy = initial_policy(config, spec, seed);
        let sizes = widths(spec.observation_size, &config.hidden, 1);
        let critic = Mlp::orthogonal(&sizes, 1.0, &mut seed.child("critic").stream())
            .expect("a valid config and spec have no width of zero");
        let log_std = vec![config.initial_log_std as f32; spec.action_size()];
        let optimisers = [policy.params().len(), log_std.len(), critic.params().len()].map(Adam::new);
        Self { policy, log_std, critic, optimisers }
    }

    /// Why this is no policy to go on with, after an iteration that moved it by `kl` nats.
    pub fn divergence(&self, kl: f32) -> Option<String> {
        divergence([self.policy.params(), self.critic.params()], [&self.log_std[..]], kl)
    }
}

/// The policy's network before any training, a function of the lesson's seed.
///
/// # Panics
/// When a width of the config or of the spec is zero.
pub(super) fn initial_policy(config: &PpoConfig, spec: &SimulatorSpec, seed: &Seed) -> Mlp {
    let sizes = widths(spec.observation_size, &config.hidden, spec.action_size());
    Mlp::orthogonal(&sizes, 0.01, &mut seed.child("policy").stream())
        .expect("a valid config and spec have no width of zero")
}

#[cfg(test)]
mod tests {
    use elo_core::conformance::point_mass::PointMassConfig;

    use super::*;

    fn learner() -> Learner {
        Learner::new(&PpoConfig::default(), &PointMassConfig::default().description(), &Seed::root(1))
    }

    #[test]
    fn each_part_that_diverges_is_noticed() {
        assert_eq!(learner().divergence(6.1), None);
        assert!(learner().divergence(f32::NAN).is_some());
        let spoil: [fn(&mut Learner); 3] = [
            |learner| learner.policy.params_mut()[0] = f32::NAN,
            |learner| learner.critic.params_mut()[3] = f32::NAN,
            |learner| learner.log_std[0] = 3.5,
        ];
        for spoil in spoil {
            let mut spoilt = learner();
            spoil(&mut spoilt);
            assert!(spoilt.divergence(0.02).is_some());
        }
    }
}
