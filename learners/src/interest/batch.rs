//! The gradients of a minibatch, part by part.

use super::drawing;
use super::learner::{Learner, Net, Policy};
use super::practice::Experience;
use super::train::Signals;
use crate::kernels::clipped_surrogate::{SurrogateBatch, clipped_surrogate};
use crate::kernels::value_loss::value_loss;
use crate::nn::GaussianBatch;

/// Some steps of an iteration.
#[derive(Clone, Copy)]
pub(super) struct Batch<'a> {
    /// How far probabilities may move.
    pub clip: f64,
    pub experience: &'a Experience,
    pub signals: &'a Signals,
    /// Which steps.
    pub rows: &'a [usize],
}

impl Batch<'_> {
    /// Leaves every network with the gradient of its loss.
    pub fn differentiate(&self, learner: &mut Learner) {
        for option in 0..learner.options() {
            self.differentiate_policy(&mut learner.policies[option], option);
        }
        self.differentiate_interests(&mut learner.interests);
        self.differentiate_critic(&mut learner.critic);
    }

    /// `E[∇ log π_o(a|s) · A_action]`, clipped, over this option's steps.
    fn differentiate_policy(&self, policy: &mut Policy, option: usize) {
        let Self { experience, signals, .. } = self;
        let rows = self.select(|row| experience.options[row] == option);
        policy.log_std_gradient.fill(0.0);
        if rows.is_empty() {
            return policy.means.no_gradient();
        }
        let means =
            policy.means.forward(&gather(&experience.observations, experience.steps.len(), &rows)).to_vec();
        let actions = gather(&experience.actions, experience.steps.len(), &rows);
        let head = GaussianBatch { means: &means, log_std: &policy.log_std, actions: &actions };
        let mut log_probs = vec![0.0; rows.len()];
        head.log_probs(&mut log_probs);
        let d_log_probs = self.surrogate(&rows, &log_probs, &experience.log_probs, &signals.actions);
        let mut d_means = vec![0.0; means.len()];
        head.backward(&d_log_probs, &mut d_means, &mut policy.log_std_gradient);
        policy.means.backward(&d_means);
    }

    /// `E[∇ log π_I(o|s) · A_draw]`, clipped, over the steps where an option was drawn.
    fn differentiate_interests(&self, interests: &mut [Net]) {
        let Self { experience, signals, .. } = self;
        let rows = self.select(|row| experience.steps[row].drawn);
        if rows.is_empty() {
            return interests.iter_mut().for_each(Net::no_gradient);
        }
        let inputs = gather(&experience.observations, experience.steps.len(), &rows);
        let columns: Vec<Vec<f32>> = interests.iter_mut().map(|net| net.forward(&inputs).to_vec()).collect();
        let mut d_interests = vec![vec![0.0; rows.len()]; columns.len()];
        let mut log_probs = vec![0.0; rows.len()];
        let mut d_row = vec![0.0; columns.len()];
        for (i, &row) in rows.iter().enumerate() {
            let log_interests: Vec<f64> = columns.iter().map(|column| f64::from(column[i])).collect();
            log_probs[i] =
                drawing::log_probability(&log_interests, experience.options[row], &mut d_row) as f32;
            d_interests.iter_mut().zip(&d_row).for_each(|(column, d)| column[i] = *d as f32);
        }
        let d_log_probs = self.surrogate(&rows, &log_probs, &experience.draw_log_probs, &signals.draws);
        for (net, mut d_output) in interests.iter_mut().zip(d_interests) {
            d_output.iter_mut().zip(&d_log_probs).for_each(|(d, by)| *d *= by);
            net.backward(&d_output);
        }
    }

    /// Half the squared error of `Q(s_t, o_t|τ)`.
    fn differentiate_critic(&self, critic: &mut Net) {
        let Self { experience, signals, rows, .. } = *self;
        let options = critic.network.output_size();
        let inputs = gather(&experience.critic_inputs, experience.steps.len(), rows);
        let all = critic.forward(&inputs);
        let values: Vec<f32> =
            rows.iter().zip(all.chunks_exact(options)).map(|(&row, q)| q[experience.options[row]]).collect();
        let mut d_values = vec![0.0; rows.len()];
        value_loss(&values, &gather(&signals.targets, experience.steps.len(), rows), &mut d_values);
        let mut d_all = vec![0.0; rows.len() * options];
        for ((&row, d_row), d) in rows.iter().zip(d_all.chunks_exact_mut(options)).zip(d_values) {
            d_row[experience.options[row]] = d;
        }
        critic.backward(&d_all);
    }

    fn select(&self, wanted: impl Fn(usize) -> bool) -> Vec<usize> {
        self.rows.iter().copied().filter(|&row| wanted(row)).collect()
    }

    /// Derivatives of the clipped surrogate by the log-probabilities of some decisions, as a mean over all steps of the
    /// batch.
    fn surrogate(&self, rows: &[usize], log_probs: &[f32], old: &[f32], advantages: &[f32]) -> Vec<f32> {
        let count = self.experience.steps.len();
        let decisions = SurrogateBatch {
            log_probs,
            old_log_probs: &gather(old, count, rows),
            advantages: &gather(advantages, count, rows),
        };
        let mut d_log_probs = vec![0.0; rows.len()];
        clipped_surrogate(&decisions, self.clip as f32, &mut d_log_probs);
        let share = rows.len() as f32 / self.rows.len() as f32;
        d_log_probs.iter_mut().for_each(|d| *d *= share);
        d_log_probs
    }
}

/// Copies rows of a table of `count` rows.
fn gather(table: &[f32], count: usize, rows: &[usize]) -> Vec<f32> {
    let width = table.len() / count;
    rows.iter().flat_map(|&row| &table[row * width..][..width]).copied().collect()
}
