//! Buffers that are filled again in every iteration, so that practice allocates nothing.

use super::config::PpoConfig;
use super::learner::Learner;
use crate::kernels::gae::StepEnd;
use crate::nn::{Activations, gather};

/// One iteration's steps, environment after environment: row `e · T + t` is step `t` of environment `e`.
#[derive(Clone, Debug)]
pub(super) struct Experience {
    /// Normalised, one row a step.
    pub observations: Vec<f32>,
    /// As sampled, one row a step.
    pub actions: Vec<f32>,
    /// Scaled.
    pub rewards: Vec<f32>,
    /// How each step ended.
    pub ends: Vec<StepEnd>,
    /// `log π_θk(a|s)`.
    pub log_probs: Vec<f32>,
    /// `V(s)`.
    pub values: Vec<f32>,
    /// The value of the observation after each environment's last step.
    pub values_after: Vec<f32>,
    /// Estimates of `A_πθk(s, a)`.
    pub advantages: Vec<f32>,
    /// What the critic should have said.
    pub targets: Vec<f32>,
}

impl Experience {
    /// Room for an iteration of `config`, for observations and actions of these sizes.
    pub fn new(config: &PpoConfig, observation_size: usize, action_size: usize) -> Self {
        let steps = config.rollout_steps;
        let zeros = vec![0.0; steps];
        Self {
            observations: vec![0.0; steps * observation_size],
            actions: vec![0.0; steps * action_size],
            rewards: zeros.clone(),
            ends: vec![StepEnd::Running; steps],
            log_probs: zeros.clone(),
            values: zeros.clone(),
            values_after: vec![0.0; config.environments],
            advantages: zeros.clone(),
            targets: zeros,
        }
    }
}

/// The rows of one minibatch, gathered, and what the passes over them need.
#[derive(Clone, Debug)]
pub(super) struct Minibatch {
    /// Of the policy and of the critic; they hold the observations too.
    pub activations: [Activations; 2],
    pub actions: Vec<f32>,
    pub old_log_probs: Vec<f32>,
    /// Normalised over the minibatch before they are used.
    pub advantages: Vec<f32>,
    pub targets: Vec<f32>,
    /// `log π_θ(a|s)`.
    pub log_probs: Vec<f32>,
    pub d_log_probs: Vec<f32>,
    pub d_means: Vec<f32>,
    pub d_values: Vec<f32>,
    /// Of policy, log standard deviations and critic.
    pub gradients: [Vec<f32>; 3],
}

impl Minibatch {
    /// Room for `size` rows of actions like the learner's.
    pub fn new(learner: &Learner, size: usize) -> Self {
        let Learner { policy, log_std, critic, .. } = learner;
        let (zeros, action_zeros) = (vec![0.0; size], vec![0.0; size * log_std.len()]);
        Self {
            activations: [policy.activations(), critic.activations()],
            actions: action_zeros.clone(),
            old_log_probs: zeros.clone(),
            advantages: zeros.clone(),
            targets: zeros.clone(),
            log_probs: zeros.clone(),
            d_log_probs: zeros.clone(),
            d_means: action_zeros,
            d_values: zeros,
            gradients: [policy.params().len(), log_std.len(), critic.params().len()].map(|n| vec![0.0; n]),
        }
    }

    /// Copies `rows` of `experience`, as many as there is room for.
    pub fn gather(&mut self, experience: &Experience, rows: &[usize]) {
        for activations in &mut self.activations {
            activations.gather(&experience.observations, rows);
        }
        gather(&experience.actions, self.actions.len() / rows.len(), rows, &mut self.actions);
        gather(&experience.log_probs, 1, rows, &mut self.old_log_probs);
        gather(&experience.advantages, 1, rows, &mut self.advantages);
        gather(&experience.targets, 1, rows, &mut self.targets);
    }
}
