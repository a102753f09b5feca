//! The gradients of a minibatch, part by part.

use super::config::InterestConfig;
use super::drawing;
use super::learner::{Learner, Net, Policy};
use super::practice::Experience;
use super::train::Signals;
use crate::kernels::clipped_surrogate::{SurrogateBatch, clipped_surrogate};
use crate::kernels::value_loss::value_loss;
use crate::nn::{GaussianBatch, gather};

/// Some steps of an iteration.
#[derive(Clone, Copy)]
pub(super) struct Batch<'a> {
    pub config: &'a InterestConfig,
    pub experience: &'a Experience,
    pub signals: &'a Signals<'a>,
    /// How often each option is drawn, where that matters; see [`usage`].
    pub usage: Option<&'a [f64]>,
    /// Which steps.
    pub rows: &'a [usize],
}

impl Batch<'_> {
    /// Leaves every network with the gradient of its loss. Returns how far decisions have moved from those that were taken, as
    /// the estimated Kullback–Leibler divergence a step, in nats.
    pub fn differentiate(&self, learner: &mut Learner) -> f32 {
        let mut moved = 0.0;
        for option in 0..learner.options() {
            moved += self.differentiate_policy(&mut learner.policies[option], option);
        }
        moved += self.differentiate_interests(&mut learner.interests);
        self.differentiate_critic(&mut learner.critic);
        moved
    }

    /// `E[∇ log π_o(a|s) · A_action]`, clipped, over this option's steps.
    fn differentiate_policy(&self, policy: &mut Policy, option: usize) -> f32 {
        let Self { experience, signals, .. } = self;
        let rows = self.select(|row| experience.options[row] == option);
        policy.log_std_gradient.fill(0.0);
        if rows.is_empty() {
            policy.means.no_gradient();
            return 0.0;
        }
        let means = policy.means.forward_rows(&experience.observations, &rows);
        let actions = rows_of(&experience.actions, policy.log_std.len(), &rows);
        let head = GaussianBatch { means, log_std: &policy.log_std, actions: &actions };
        let mut log_probs = vec![0.0; rows.len()];
        head.log_probs(&mut log_probs);
        let (d_log_probs, moved) = self.surrogate(&rows, &log_probs, &experience.log_probs, &signals.actions);
        let mut d_means = vec![0.0; actions.len()];
        head.backward(&d_log_probs, &mut d_means, &mut policy.log_std_gradient);
        policy.means.backward(&d_means);
        moved
    }

    /// `E[∇ log π_I(o|s) · A_draw]`, clipped, and the gradient of the diversity, over the steps where an option was drawn.
    fn differentiate_interests(&self, interests: &mut [Net]) -> f32 {
        let Self { experience, signals, .. } = self;
        let rows = self.select(|row| experience.steps[row].drawn);
        if rows.is_empty() {
            interests.iter_mut().for_each(Net::no_gradient);
            return 0.0;
        }
        let log_interests = log_interests(interests, experience, &rows);
        let options = interests.len();
        let mut d_log_probs_by_interests = vec![0.0; log_interests.len()];
        let states =
            log_interests.chunks_exact(options).zip(d_log_probs_by_interests.chunks_exact_mut(options));
        let log_probs: Vec<f32> = rows
            .iter()
            .zip(states)
            .map(|(&row, (z, d_z))| drawing::log_probability(z, experience.options[row], d_z) as f32)
            .collect();
        let (d_log_probs, moved) =
            self.surrogate(&rows, &log_probs, &experience.draw_log_probs, &signals.draws);
        let mut d_diversity = vec![0.0; log_interests.len()];
        if let Some(usage) = self.usage {
            for (z, d_z) in log_interests.chunks_exact(options).zip(d_diversity.chunks_exact_mut(options)) {
                drawing::diversity(usage, z, d_z);
            }
        }
        let weight = self.config.diversity_weight / self.rows.len() as f64;
        for (option, net) in interests.iter_mut().enumerate() {
            let places = (0..rows.len()).map(|i| i * options + option);
            let d_outputs = places.zip(&d_log_probs).map(|(place, by)| {
                (f64::from(*by) * d_log_probs_by_interests[place] - weight * d_diversity[place]) as f32
            });
            net.backward(&d_outputs.collect::<Vec<f32>>());
        }
        moved
    }

    /// Half the squared error of `Q(s_t, o_t|τ)`.
    fn differentiate_critic(&self, critic: &mut Net) {
        let Self { experience, signals, rows, .. } = *self;
        let options = critic.network.output_size();
        let all = critic.forward_rows(&experience.critic_inputs, rows);
        let values: Vec<f32> =
            rows.iter().zip(all.chunks_exact(options)).map(|(&row, q)| q[experience.options[row]]).collect();
        let mut d_values = vec![0.0; rows.len()];
        value_loss(&values, &rows_of(signals.targets, 1, rows), &mut d_values);
        let mut d_all = vec![0.0; rows.len() * options];
        for ((&row, d_row), d) in rows.iter().zip(d_all.chunks_exact_mut(options)).zip(d_values) {
            d_row[experience.options[row]] = d;
        }
        critic.backward(&d_all);
    }

    fn select(&self, wanted: impl Fn(usize) -> bool) -> Vec<usize> {
        self.rows.iter().copied().filter(|&row| wanted(row)).collect()
    }

    /// How many of the batch's steps `rows` are.
    fn share(&self, rows: &[usize]) -> f64 {
        rows.len() as f64 / self.rows.len() as f64
    }

    /// Derivatives of the clipped surrogate by the log-probabilities of some decisions, and how far they have moved, both as
    /// a mean over all steps of the batch.
    fn surrogate(
        &self,
        rows: &[usize],
        log_probs: &[f32],
        old: &[f32],
        advantages: &[f32],
    ) -> (Vec<f32>, f32) {
        let decisions = SurrogateBatch {
            log_probs,
            old_log_probs: &rows_of(old, 1, rows),
            advantages: &rows_of(advantages, 1, rows),
        };
        let mut d_log_probs = vec![0.0; rows.len()];
        let surrogate = clipped_surrogate(&decisions, self.config.clip as f32, &mut d_log_probs);
        let share = self.share(rows) as f32;
        d_log_probs.iter_mut().for_each(|d| *d *= share);
        (d_log_probs, share * surrogate.approx_kl)
    }
}

/// How often each option is drawn in the mean over all states where one was drawn, with the interests as they are now; `None` where
/// diversity has no weight.
pub(super) fn usage(
    config: &InterestConfig,
    experience: &Experience,
    learner: &mut Learner,
) -> Option<Vec<f64>> {
    if config.diversity_weight <= 0.0 {
        return None;
    }
    let (rows, options) = (experience.drawn().collect::<Vec<_>>(), learner.options());
    Some(drawing::usage(&log_interests(&mut learner.interests, experience, &rows), options))
}

/// What the interests say of the states of `rows`, one row of `K` numbers each.
fn log_interests(interests: &mut [Net], experience: &Experience, rows: &[usize]) -> Vec<f64> {
    let options = interests.len();
    let mut all = vec![0.0; rows.len() * options];
    for (option, net) in interests.iter_mut().enumerate() {
        let column = net.forward_rows(&experience.observations, rows);
        all.chunks_exact_mut(options).zip(column).for_each(|(z, output)| z[option] = f64::from(*output));
    }
    all
}

/// A copy of rows of a table, each `width` numbers.
fn rows_of(table: &[f32], width: usize, rows: &[usize]) -> Vec<f32> {
    let mut copy = vec![0.0; rows.len() * width];
    gather(table, width, rows, &mut copy);
    copy
}
