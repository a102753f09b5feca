//! What training changes: policy and critic, each with its optimiser.

use elo_core::seed::Seed;
use elo_core::spec::SimulatorSpec;

use super::config::PpoConfig;
use crate::nn::{Adam, Mlp, lost_aim};

/// An iteration that moved the policy by more, in nats of Kullback–Leibler divergence, has lost the policy that the
/// advantages are about. Without `target_kl`, iterations of Ants that went on to learn moved it by up to 6.
const MAX_KL: f32 = 100.0;

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
        let sizes = config.sizes(spec.observation_size, 1);
        let critic = Mlp::orthogonal(&sizes, 1.0, &mut seed.child("critic").stream())
            .expect("a valid config and spec have no width of zero");
        let log_std = vec![config.initial_log_std as f32; spec.action_size()];
        let optimisers = [policy.params().len(), log_std.len(), critic.params().len()].map(Adam::new);
        Self { policy, log_std, critic, optimisers }
    }

    /// Why this is no policy to go on with, after an iteration that moved it by `kl` nats.
    pub fn divergence(&self, kl: f32) -> Option<String> {
        if !self.policy.params().iter().chain(self.critic.params()).all(|p| p.is_finite()) {
            return Some("a parameter is not finite".to_owned());
        }
        lost_aim(&self.log_std, "the policy").or_else(|| {
            // Written so that NaN is caught.
            let kept = kl <= MAX_KL;
            (!kept).then(|| format!("one iteration moved the policy by {kl:.2} nats, more than {MAX_KL}"))
        })
    }
}

/// The policy's network before any training, a function of the lesson's seed.
///
/// # Panics
/// When a width of the config or of the spec is zero.
pub(super) fn initial_policy(config: &PpoConfig, spec: &SimulatorSpec, seed: &Seed) -> Mlp {
    let sizes = config.sizes(spec.observation_size, spec.action_size());
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
    fn each_way_to_diverge_is_named() {
        assert_eq!(learner().divergence(6.1), None);
        let mut spoilt = learner();
        spoilt.critic.params_mut()[3] = f32::NAN;
        assert_eq!(spoilt.divergence(0.02).as_deref(), Some("a parameter is not finite"));
        for log_std in [-9.0, 3.5, f32::NAN] {
            let mut spoilt = learner();
            spoilt.log_std[0] = log_std;
            assert!(spoilt.divergence(0.02).is_some_and(|reason| reason.contains("standard deviation")));
        }
        for kl in [101.0, f32::INFINITY, f32::NAN] {
            assert!(learner().divergence(kl).is_some_and(|reason| reason.contains("nats")));
        }
    }
}
