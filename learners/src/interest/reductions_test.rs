//! What training comes to where it should be something simpler.

#![allow(clippy::unwrap_used)]

use elo_core::context::InitialStates;
use elo_core::policy::{Practice, Unwatched};
use elo_core::task::TaskDistribution;

use super::batch::Batch;
use super::config::{InterestConfig, LearningRates};
use super::practice::{Experience, LastState};
use super::train::{Signals, Training};
use super::worlds::{World, practice};
use crate::kernels::clipped_surrogate::{SurrogateBatch, clipped_surrogate};
use crate::kernels::gae::{StepEnd, Trajectory, gae, normalize};
use crate::nn::GaussianBatch;

/// `ε` is fixed, and interests are held at 1.
fn config() -> InterestConfig {
    InterestConfig {
        steps: 1000,
        rollout_steps: 1000,
        context_pool: 20,
        learning_rates: LearningRates { interests: 0.0, termination: 0.0, ..LearningRates::default() },
        hidden: vec![8],
        ..InterestConfig::default()
    }
}

/// Collects in the world with the hot surface, in rollouts of 40 steps, with sets of `set_size`.
fn collected<T>(set_size: usize, look: impl FnOnce(&mut Training<'_>, &Experience) -> T) -> T {
    let (config, tasks) = (config(), TaskDistribution::default());
    let initial_states = InitialStates { max_random_steps: 0, ..InitialStates::default() };
    let practice = Practice { set_size, ..practice(&World::Hot, &tasks, &initial_states, 40, 1) };
    let mut training = Training::new(&config, &practice, &mut Unwatched).unwrap();
    let experience = training.collect(&mut Unwatched).unwrap();
    look(&mut training, &experience)
}

/// Advantages of the actions by GAE, as PPO computes them: from rewards and values of the states alone.
fn plain_advantages(training: &mut Training<'_>, experience: &Experience) -> Vec<f32> {
    let critic = &mut training.learner.critic;
    let values = critic.forward(&experience.critic_inputs).to_vec();
    let mut final_values = experience.ends.iter().map(|end| match end {
        LastState::Cut { critic_input, .. } => critic.forward(critic_input)[0],
        LastState::Terminal => panic!("this world goes on"),
    });
    let ends: Vec<StepEnd> = experience
        .steps
        .iter()
        .map(|step| match step.last {
            true => StepEnd::Truncated { final_value: final_values.next().unwrap() },
            false => StepEnd::Running,
        })
        .collect();
    let rewards: Vec<f32> = experience.steps.iter().map(|step| step.reward as f32).collect();
    let mut advantages = vec![0.0; rewards.len()];
    let trajectory = Trajectory { rewards: &rewards, values: &values, ends: &ends, value_after: 0.0 };
    gae(&trajectory, config().discount.into(), &mut advantages);
    advantages
}

#[test]
fn one_option_is_plain_policy_gradient() {
    collected(1, |training, experience| {
        let estimates = training.estimate(experience, None);
        let signals = Signals::new(experience, &estimates);
        let rows: Vec<usize> = (0..experience.steps.len()).collect();
        let config = config();
        let batch = Batch { config: &config, experience, signals: &signals, usage: None, rows: &rows };
        batch.differentiate(&mut training.learner);
        let policy = &training.learner.policies[0];
        let ours = [policy.means.gradient.clone(), policy.log_std_gradient.clone()].concat();

        let mut advantages = plain_advantages(training, experience);
        normalize(&mut advantages);
        let policy = &mut training.learner.policies[0];
        let means = policy.means.forward(&experience.observations).to_vec();
        let head = GaussianBatch { means: &means, log_std: &policy.log_std, actions: &experience.actions };
        let (mut log_probs, mut d_log_probs) = (vec![0.0; rows.len()], vec![0.0; rows.len()]);
        head.log_probs(&mut log_probs);
        let surrogate = SurrogateBatch {
            log_probs: &log_probs,
            old_log_probs: &experience.log_probs,
            advantages: &advantages,
        };
        clipped_surrogate(&surrogate, config.clip as f32, &mut d_log_probs);
        let (mut d_means, mut d_log_std) = (vec![0.0; means.len()], vec![0.0; policy.log_std.len()]);
        head.backward(&d_log_probs, &mut d_means, &mut d_log_std);
        policy.means.backward(&d_means);

        let plain = [policy.means.gradient.clone(), d_log_std].concat();
        let length = plain.iter().map(|d| d * d).sum::<f32>().sqrt();
        assert!(length > 1e-3, "a gradient of {length} shows nothing");
        for (ours, plain) in ours.iter().zip(plain) {
            assert!((ours - plain).abs() < 1e-5 * length, "{ours} against {plain}");
        }
        // The critic alone would give a draw no advantage: what is left of it is that of the actions that followed.
        let lambda = config.discount.gae_lambda;
        for (step, of) in experience.steps.iter().zip(&estimates.advantages).filter(|(step, _)| step.drawn) {
            assert!((of.draw - lambda * of.action).abs() < 1e-9, "{step:?}: {of:?}");
        }
    });
}

#[test]
fn interests_held_at_1_draw_like_a_uniform_agent() {
    for set_size in [2, 5] {
        collected(set_size, |_, experience| {
            let uniform = -(set_size as f32).ln();
            assert!(experience.drawn().all(|row| experience.draw_log_probs[row] == uniform));
            for option in 0..set_size {
                let count = experience.drawn().count() as f64;
                let share = experience.drawn().filter(|&row| experience.options[row] == option).count()
                    as f64
                    / count;
                let expected = 1.0 / set_size as f64;
                let error = (expected * (1.0 - expected) / count).sqrt();
                assert!((share - expected).abs() < 4.0 * error, "option {option}: {share} of {count}");
            }
        });
    }
}
