//! What a user may set of PPO.

use elo_core::fault::Faults;
use elo_core::policy::{Lesson, Monitor, TeacherConfig, TeacherPolicy, TrainError, Trained};
use elo_core::seed::Seed;
use elo_core::spec::SimulatorSpec;
use elo_core::tensors::{TensorError, Tensors};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::learner::initial_policy;
use super::policy::GaussianMlpTeacher;
use super::train::train;
use crate::fields::check_hidden;
use crate::kernels::running_moments::Normalizer;
use crate::normalized_mlp::NormalizedMlp;

/// Teachers by proximal policy optimisation (Schulman et al. 2017; Weber et al. 2019, Eq. 2.3 and 2.4).
///
/// Costs about 13 µs of computation a step beside the simulator, at the default sizes on one core (`docs/results/speed.md`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PpoConfig {
    /// Control steps of practice, rounded up to whole iterations of `rollout_steps`.
    #[schemars(range(min = 1))]
    pub steps: u64,
    /// Control steps between two changes of the policy, in all environments together. A multiple of `environments` and
    /// of `minibatch`. More give a steadier and slower improvement.
    #[schemars(range(min = 2, max = 10_000_000))]
    pub rollout_steps: usize,
    /// Environments practised in, one after the other. More see more of the task in each iteration, with shorter pieces
    /// of each episode.
    #[schemars(range(min = 1, max = 4096))]
    pub environments: usize,
    /// Steps whose mean loss one gradient step descends.
    #[schemars(range(min = 2))]
    pub minibatch: usize,
    /// Passes over the steps of one iteration.
    #[schemars(range(min = 1, max = 1000))]
    pub epochs: usize,
    /// Adam's step size at the beginning; must be positive.
    pub learning_rate: f64,
    /// Adam's step size at the end, reached linearly. Equal to `learning_rate` for a constant one.
    #[schemars(range(min = 0.0))]
    pub learning_rate_end: f64,
    /// `ε` of Eq. 2.4: how far the probability of an action may move before there is no reward for moving it further.
    /// Between 0 and 1, both excluded.
    pub clip: f64,
    /// `γ`, the discount of rewards per control step while learning (returns that are reported have their own). 0.98
    /// looks about fifty steps ahead, 0.8 s of the robots here; with 0.99 Walker2d learns in some trainings to stand and
    /// not to walk (`docs/results/teachers.md`).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gamma: f64,
    /// `λ` of generalised advantage estimation (Schulman et al. 2016): 0 trusts the critic one step ahead, 1 trusts the
    /// rewards until the episode's end.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gae_lambda: f64,
    /// Reward for entropy of the action distribution, in units of the policy's loss per nat.
    #[schemars(range(min = 0.0))]
    pub entropy_coefficient: f64,
    /// Weight of the critic's loss (half the mean squared error) beside the policy's; where the loss is the whole mean
    /// squared error, half this number is the same. The networks are separate, so it acts only through the common limit
    /// `max_grad_norm` and through Adam's `ε`, beside which the critic's gradient is small once it has been limited.
    #[schemars(range(min = 0.0))]
    pub value_coefficient: f64,
    /// Gradients longer than this are scaled down to it; must be positive.
    pub max_grad_norm: f64,
    /// No further epoch begins in an iteration once the policy has moved by this Kullback–Leibler divergence, in nats.
    /// Must be positive. The default allows all `epochs` always; with 0.015 policies fall more seldom and earn about as much
    /// (`docs/results/teachers.md`).
    pub target_kl: f64,
    /// Widths of the hidden layers, of the policy and of the critic.
    pub hidden: Vec<usize>,
    /// Natural logarithm of the action noise's standard deviation at the beginning, in units of the action.
    #[schemars(range(min = -5.0, max = 1.0))]
    pub initial_log_std: f64,
    /// Share of the episodes that begin in `d0`, where teachers are recorded; the others begin with the standard reset.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub d0_share: f64,
    /// How many starts are drawn from `d0` before training, for those episodes to choose from. Each costs up to
    /// `initial_states.max_random_steps` control steps, times the redraws.
    #[schemars(range(min = 1, max = 100_000))]
    pub d0_pool: u64,
    /// Control steps after which an episode is cut short. The critic knows that more could have been earned.
    #[schemars(range(min = 1))]
    pub max_episode_steps: u64,
    /// How many policies are kept on the way for learning curves, at equal distances; the last is the final one.
    #[schemars(range(min = 1, max = 10_000))]
    pub snapshots: u64,
    /// Control steps between checkpoints, rounded up to whole iterations. At each, every environment is put down and
    /// taken up again, so this changes the result; a simulator whose state cannot be set begins a new episode there.
    #[schemars(range(min = 1))]
    pub checkpoint_every: u64,
}

impl Default for PpoConfig {
    fn default() -> Self {
        Self {
            steps: 2_000_000,
            rollout_steps: 2048,
            environments: 1,
            minibatch: 64,
            epochs: 10,
            learning_rate: 3e-4,
            learning_rate_end: 0.0,
            clip: 0.2,
            gamma: 0.98,
            gae_lambda: 0.95,
            entropy_coefficient: 0.0,
            value_coefficient: 1.0,
            max_grad_norm: 0.5,
            target_kl: 1000.0,
            hidden: vec![64, 64],
            initial_log_std: 0.0,
            d0_share: 0.5,
            d0_pool: 200,
            max_episode_steps: 1000,
            snapshots: 20,
            checkpoint_every: 100_000,
        }
    }
}

impl PpoConfig {
    /// Iterations of practice and improvement in one training.
    pub(super) fn iterations(&self) -> u64 {
        self.steps.div_ceil(self.rollout_steps as u64)
    }

    /// Control steps of one environment in one iteration.
    pub(super) fn steps_per_environment(&self) -> usize {
        self.rollout_steps / self.environments
    }

    /// Adam's step size in an iteration counted from 0.
    pub(super) fn rate(&self, iteration: u64) -> f64 {
        let done = iteration as f64 / self.iterations() as f64;
        self.learning_rate + (self.learning_rate_end - self.learning_rate) * done
    }

    fn counts_are_right(&self, faults: &mut Faults) {
        let mut at_least = |least: u64, value: u64, field: &str| {
            faults.check(value >= least, field, || format!("expected at least {least}, got {value}"));
        };
        at_least(1, self.steps, "steps");
        at_least(2, self.rollout_steps as u64, "rollout_steps");
        at_least(1, self.environments as u64, "environments");
        at_least(2, self.minibatch as u64, "minibatch");
        at_least(1, self.epochs as u64, "epochs");
        at_least(1, self.d0_pool, "d0_pool");
        at_least(1, self.max_episode_steps, "max_episode_steps");
        at_least(1, self.snapshots, "snapshots");
        at_least(1, self.checkpoint_every, "checkpoint_every");
        let mut at_most = |most: u64, value: u64, field: &str| {
            faults.check(value <= most, field, || format!("expected at most {most}, got {value}"));
        };
        at_most(10_000_000, self.rollout_steps as u64, "rollout_steps");
        at_most(4096, self.environments as u64, "environments");
        at_most(1000, self.epochs as u64, "epochs");
        at_most(100_000, self.d0_pool, "d0_pool");
        at_most(10_000, self.snapshots, "snapshots");
        for (field, part) in [("environments", self.environments), ("minibatch", self.minibatch)] {
            faults.check(part == 0 || self.rollout_steps.is_multiple_of(part), field, || {
                format!("expected a divisor of rollout_steps = {}, got {part}", self.rollout_steps)
            });
        }
        check_hidden(faults, &self.hidden);
    }
}

#[typetag::serde(name = "ppo")]
impl TeacherConfig for PpoConfig {
    fn validate(&self, faults: &mut Faults) {
        self.counts_are_right(faults);
        let mut within = |range: std::ops::RangeInclusive<f64>, value: f64, field: &str| {
            faults.check(range.contains(&value), field, || {
                format!("expected {} to {}, got {value}", range.start(), range.end())
            });
        };
        within(0.0..=1.0, self.gamma, "gamma");
        within(0.0..=1.0, self.gae_lambda, "gae_lambda");
        within(-5.0..=1.0, self.initial_log_std, "initial_log_std");
        within(0.0..=1.0, self.d0_share, "d0_share");
        let mut finite = |holds: bool, expected: &str, value: f64, field: &str| {
            faults.check(holds && value.is_finite(), field, || format!("expected {expected}, got {value}"));
        };
        let positive = "a positive number";
        finite(self.learning_rate > 0.0, positive, self.learning_rate, "learning_rate");
        finite(self.max_grad_norm > 0.0, positive, self.max_grad_norm, "max_grad_norm");
        finite(self.target_kl > 0.0, positive, self.target_kl, "target_kl");
        finite(self.clip > 0.0 && self.clip < 1.0, "more than 0 and less than 1", self.clip, "clip");
        for (value, field) in [
            (self.learning_rate_end, "learning_rate_end"),
            (self.entropy_coefficient, "entropy_coefficient"),
            (self.value_coefficient, "value_coefficient"),
        ] {
            finite(value >= 0.0, "zero or a positive number", value, field);
        }
    }

    fn simulator_steps(&self) -> u64 {
        self.iterations() * self.rollout_steps as u64
    }

    fn starts(&self) -> u64 {
        if self.d0_share > 0.0 { self.d0_pool } else { 0 }
    }

    fn train(&self, lesson: &Lesson<'_>, monitor: &mut dyn Monitor) -> Result<Trained, TrainError> {
        train(self, lesson, monitor)
    }

    fn untrained(&self, spec: &SimulatorSpec, seed: &Seed) -> Option<Tensors> {
        let network = initial_policy(self, spec, seed);
        let log_std = vec![self.initial_log_std as f32; spec.action_size()];
        let normalizer = Normalizer::identity(spec.observation_size);
        Some(GaussianMlpTeacher::new(NormalizedMlp::new(normalizer, network), log_std, spec).to_tensors())
    }

    fn load(&self, tensors: &Tensors, spec: &SimulatorSpec) -> Result<Box<dyn TeacherPolicy>, TensorError> {
        Ok(Box::new(GaussianMlpTeacher::from_tensors(tensors, spec, &self.hidden)?))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn fields_at_fault(config: &PpoConfig) -> Vec<String> {
        let mut faults = Faults::new();
        config.validate(&mut faults);
        faults.into_found().into_iter().map(|fault| fault.path).collect()
    }

    #[test]
    fn the_defaults_are_valid_and_survive_a_file() {
        let config = PpoConfig::default();
        assert_eq!(fields_at_fault(&config), Vec::<String>::new());
        let text = serde_json::to_string(&config as &dyn TeacherConfig).unwrap();
        let read: Box<dyn TeacherConfig> = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&read).unwrap(), text);
        assert!(serde_json::from_str::<PpoConfig>(r#"{"learning_rat": 1.0}"#).is_err());
    }

    #[test]
    fn every_fault_is_found_at_once() {
        let config = PpoConfig {
            steps: 0,
            rollout_steps: 100,
            environments: 3,
            minibatch: 64,
            epochs: 0,
            learning_rate: f64::NAN,
            learning_rate_end: -1.0,
            clip: 1.0,
            gamma: 1.5,
            gae_lambda: -0.1,
            entropy_coefficient: f64::INFINITY,
            value_coefficient: -0.5,
            max_grad_norm: 0.0,
            target_kl: 0.0,
            hidden: vec![64, 0],
            initial_log_std: 2.0,
            d0_share: f64::NAN,
            d0_pool: 0,
            max_episode_steps: 0,
            snapshots: 0,
            checkpoint_every: 0,
        };
        let mut found = fields_at_fault(&config);
        found.sort();
        // All fields but rollout_steps, which only its divisors disagree with.
        let mut all: Vec<String> = match serde_json::to_value(&config).unwrap() {
            serde_json::Value::Object(fields) => fields.keys().cloned().collect(),
            other => panic!("{other}"),
        };
        all.retain(|field| field != "rollout_steps");
        all.sort();
        assert_eq!(found, all);
    }

    #[test]
    fn the_learning_rate_falls_linearly_to_its_end() {
        let config = PpoConfig { steps: 100_000, rollout_steps: 1000, ..PpoConfig::default() };
        assert_eq!(config.rate(0), 3e-4);
        assert!((config.rate(50) - 1.5e-4).abs() < 1e-12);
        assert!(config.rate(99) > 0.0 && config.rate(99) < 4e-6);
        assert_eq!(config.simulator_steps(), 100_000);
        let odd = PpoConfig { steps: 100_001, ..config };
        assert_eq!(odd.simulator_steps(), 101_000);
    }
}
