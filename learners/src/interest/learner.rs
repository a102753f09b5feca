//! What training changes: `θ = [θ_I, θ_π, ε]` and the critic, each with its optimiser.

use elo_core::policy::Practice;
use elo_core::seed::Seed;
use elo_core::spec::SimulatorSpec;

use super::config::{InterestConfig, LearningRates};
use super::duration::Termination;
use crate::divergence::divergence;
use crate::fields::widths;
use crate::nn::{Activations, Adam, Mlp, clip_grad_norm};

/// A network with what its training needs.
#[derive(Clone, Debug)]
pub(super) struct Net {
    /// The network.
    pub network: Mlp,
    activations: Activations,
    /// Of the loss by the parameters.
    pub gradient: Vec<f32>,
    /// Whether the loss depends on this network at all.
    concerned: bool,
    optimiser: Adam,
}

impl Net {
    fn new(sizes: &[usize], output_gain: f32, seed: &Seed) -> Self {
        let network = Mlp::orthogonal(sizes, output_gain, &mut seed.stream())
            .expect("a valid config and spec have no width of zero");
        let count = network.params().len();
        let activations = network.activations();
        Self {
            network,
            activations,
            gradient: vec![0.0; count],
            concerned: false,
            optimiser: Adam::new(count),
        }
    }

    /// The outputs for a batch.
    pub fn forward(&mut self, inputs: &[f32]) -> &[f32] {
        self.network.forward(inputs, &mut self.activations)
    }

    /// The outputs for rows of a table of inputs.
    pub fn forward_rows(&mut self, table: &[f32], rows: &[usize]) -> &[f32] {
        self.activations.gather(table, rows);
        self.network.forward_loaded(&mut self.activations)
    }

    /// Keeps the gradient of a loss whose derivatives by the outputs of the last forward pass are `d_output`.
    pub fn backward(&mut self, d_output: &[f32]) {
        self.gradient.fill(0.0);
        self.network.backward(&mut self.activations, d_output, &mut self.gradient);
        self.concerned = true;
    }

    /// The loss does not depend on this network: it stays as it is, and so does its optimiser, whose memory of other minibatches
    /// would move it on.
    pub fn no_gradient(&mut self) {
        self.gradient.fill(0.0);
        self.concerned = false;
    }

    /// Descends along the gradient, which is cut to `max_norm`, and returns how long it was; there is no step along one
    /// that is not finite, and none with a rate of 0.
    fn descend(&mut self, rate: f64, max_norm: f64) -> f32 {
        let norm = clip_grad_norm(&mut [&mut self.gradient], max_norm as f32);
        if norm.is_finite() && self.concerned && rate > 0.0 {
            self.optimiser.step(self.network.params_mut(), &self.gradient, rate);
        }
        norm
    }

    fn part(&mut self, name: String) -> Part<'_> {
        Part { name, params: self.network.params_mut(), optimiser: &mut self.optimiser }
    }
}

/// `π_o`: a normal distribution around what a network says.
#[derive(Clone, Debug)]
pub(super) struct Policy {
    /// Means of the actions.
    pub means: Net,
    /// Logarithms of their standard deviations.
    pub log_std: Vec<f32>,
    /// Of the loss by those.
    pub log_std_gradient: Vec<f32>,
    optimiser: Adam,
}

/// Some parameters and their optimiser, for checkpoints.
pub(super) struct Part<'a> {
    /// What they are called.
    pub name: String,
    /// The parameters.
    pub params: &'a mut [f32],
    /// What changes them.
    pub optimiser: &'a mut Adam,
}

/// Everything that is learned, for `K` options.
#[derive(Clone, Debug)]
pub(super) struct Learner {
    /// `π_o`, of the observation.
    pub policies: Vec<Policy>,
    /// `z_o = log I_o`, of the observation.
    pub interests: Vec<Net>,
    /// `Q(s,·|τ)`, `K` numbers, of the observation and the task.
    pub critic: Net,
    /// `ε`.
    pub termination: Termination,
    optimiser: Adam,
}

impl Learner {
    /// Before any training: all options nearly alike, interests all nearly 1.
    pub fn new(config: &InterestConfig, practice: &Practice<'_>, spec: &SimulatorSpec) -> Self {
        let (inputs, actions) = (spec.observation_size, spec.action_size());
        let Practice { set_size, seed, .. } = practice;
        let task_features = practice.tasks.names().count();
        let numbers = 0..*set_size as u64;
        let policy = |number: u64| Policy {
            means: Net::new(
                &widths(inputs, &config.hidden, actions),
                0.01,
                &seed.child("policy").index(number),
            ),
            log_std: vec![config.initial_log_std as f32; actions],
            log_std_gradient: vec![0.0; actions],
            optimiser: Adam::new(actions),
        };
        // Exactly 1 where interests are not learned: then options are drawn uniformly.
        let gain = if config.learning_rates.interests > 0.0 { 0.01 } else { 0.0 };
        let interest = |number: u64| {
            Net::new(&widths(inputs, &config.hidden, 1), gain, &seed.child("interest").index(number))
        };
        let critic = widths(inputs + task_features, &config.hidden, *set_size);
        Self {
            policies: numbers.clone().map(policy).collect(),
            interests: numbers.map(interest).collect(),
            critic: Net::new(&critic, 1.0, &seed.child("critic")),
            termination: Termination::lasting(config.initial_continuations),
            optimiser: Adam::new(1),
        }
    }

    /// `K`.
    pub fn options(&self) -> usize {
        self.policies.len()
    }

    /// Descends along the gradients that the networks keep. The error says which is not finite.
    pub fn descend(&mut self, rates: LearningRates, max_norm: f64) -> Result<(), String> {
        let finite = |part: &str, norm: f32| {
            if norm.is_finite() { Ok(()) } else { Err(format!("the gradient of {part} is {norm}")) }
        };
        for Policy { means, log_std, log_std_gradient, optimiser } in &mut self.policies {
            finite("a policy", means.descend(rates.policies, max_norm))?;
            finite("a log standard deviation", clip_grad_norm(&mut [log_std_gradient], max_norm as f32))?;
            if means.concerned && rates.policies > 0.0 {
                optimiser.step(log_std, log_std_gradient, rates.policies);
            }
        }
        for interest in &mut self.interests {
            finite("an interest", interest.descend(rates.interests, max_norm))?;
        }
        finite("the critic", self.critic.descend(rates.critic, max_norm))
    }

    /// Why this is nothing to go on with, after an iteration that moved decisions by `kl` nats.
    pub fn divergence(&self, kl: f32) -> Option<String> {
        let networks = self.policies.iter().map(|policy| &policy.means).chain(&self.interests);
        let params = networks.chain([&self.critic]).map(|net| net.network.params());
        divergence(params, self.policies.iter().map(|policy| &policy.log_std[..]), kl)
    }

    /// All of it, in a fixed order. The logit of `ε` is [`Self::termination`]; its part is the optimiser alone.
    pub fn parts(&mut self) -> Vec<Part<'_>> {
        let mut parts = Vec::new();
        for (o, Policy { means, log_std, optimiser, .. }) in self.policies.iter_mut().enumerate() {
            parts.push(means.part(format!("policy{o}")));
            parts.push(Part { name: format!("log_std{o}"), params: log_std, optimiser });
        }
        parts.extend(self.interests.iter_mut().enumerate().map(|(o, net)| net.part(format!("interest{o}"))));
        parts.push(self.critic.part("critic".to_owned()));
        parts.push(Part { name: "logit".to_owned(), params: &mut [], optimiser: &mut self.optimiser });
        parts
    }

    /// Ascends along `dJ/dx`, `x` the logit of `ε`.
    pub fn ascend_termination(&mut self, gradient: f64, rate: f64) {
        if rate <= 0.0 {
            return;
        }
        let mut logit = [self.termination.logit as f32];
        self.optimiser.step(&mut logit, &[-gradient as f32], rate);
        self.termination.logit = f64::from(logit[0]);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;
    use elo_core::context::InitialStates;
    use elo_core::task::TaskDistribution;

    use super::super::worlds::practice;
    use super::*;

    fn learner() -> Learner {
        let spec = PointMassConfig::default().description();
        let (simulator, tasks) = (PointMassConfig::default(), TaskDistribution::default());
        let initial_states = InitialStates::default();
        let practice = practice(&simulator, &tasks, &initial_states, 10, 1);
        Learner::new(&InterestConfig::default(), &practice, &spec)
    }

    #[test]
    fn each_part_that_diverges_is_noticed() {
        assert_eq!(learner().divergence(6.1), None);
        assert!(learner().divergence(f32::NAN).is_some());
        let spoil: [fn(&mut Learner); 4] = [
            |learner| learner.policies[1].log_std[0] = -9.0,
            |learner| learner.policies[1].means.network.params_mut()[0] = f32::NAN,
            |learner| learner.interests[1].network.params_mut()[0] = f32::NAN,
            |learner| learner.critic.network.params_mut()[0] = f32::INFINITY,
        ];
        for spoil in spoil {
            let mut spoilt = learner();
            spoil(&mut spoilt);
            assert!(spoilt.divergence(0.02).is_some());
        }
    }

    #[test]
    fn what_the_loss_does_not_depend_on_stays_as_it_is() {
        let mut learner = learner();
        let d_outputs = vec![1.0; 2];
        let inputs = vec![0.5; 2 * learner.interests[0].network.input_size()];
        let step = |learner: &mut Learner| learner.descend(LearningRates::default(), 0.5).unwrap();
        for moves in [true, false, false, true] {
            learner.interests[1].forward(&inputs);
            if moves {
                learner.interests[1].backward(&d_outputs);
            } else {
                learner.interests[1].no_gradient();
            }
            let before = learner.interests[1].network.clone();
            step(&mut learner);
            assert_eq!(learner.interests[1].network != before, moves);
        }
    }

    #[test]
    fn gradients_that_are_not_finite_are_not_followed() {
        let mut spoilt = learner();
        spoilt.interests[1].gradient[0] = f32::NAN;
        let before = spoilt.interests[1].network.clone();
        let error = spoilt.descend(LearningRates::default(), 0.5);
        assert_eq!(error, Err("the gradient of an interest is NaN".to_owned()));
        assert_eq!(spoilt.interests[1].network, before);
    }
}
