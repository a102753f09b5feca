//! The action distribution of a stochastic policy: independent normal distributions, one per action component, whose
//! means depend on the observation and whose standard deviations do not.

use std::f32::consts::{E, PI};

use rand::Rng;

use super::normal::fill_standard_normal;

/// Distributions whose log standard deviation leaves this range no longer explore, or no longer aim.
const LOG_STD_RANGE: std::ops::RangeInclusive<f32> = -8.0..=3.0;

/// Why a training cannot go on with `whose` logarithms of standard deviations, if it cannot.
pub(crate) fn lost_aim(log_stds: &[f32], whose: &str) -> Option<String> {
    let log_std = log_stds.iter().find(|log_std| !LOG_STD_RANGE.contains(*log_std))?;
    let (low, high) = (LOG_STD_RANGE.start(), LOG_STD_RANGE.end());
    Some(format!("a log standard deviation of {whose} is {log_std}, outside {low} to {high}"))
}

/// The distribution for one observation. `means` and `log_std` have one number per action component.
#[derive(Clone, Copy, Debug)]
pub struct DiagonalGaussian<'a> {
    /// Means.
    pub means: &'a [f32],
    /// Natural logarithms of the standard deviations.
    pub log_std: &'a [f32],
}

impl DiagonalGaussian<'_> {
    /// Draws an action. How much of the stream is used depends only on the number of components.
    ///
    /// # Panics
    /// When lengths differ.
    pub fn sample<R: Rng + ?Sized>(&self, rng: &mut R, action: &mut [f32]) {
        assert_eq!(self.means.len(), self.log_std.len(), "means and log standard deviations");
        assert_eq!(action.len(), self.means.len(), "length of an action");
        fill_standard_normal(rng, action);
        for ((a, mean), log_std) in action.iter_mut().zip(self.means).zip(self.log_std) {
            *a = mean + log_std.exp() * *a;
        }
    }

    /// Natural logarithm of the density at `action`.
    ///
    /// # Panics
    /// When lengths differ.
    pub fn log_prob(&self, action: &[f32]) -> f32 {
        let mut log_prob = [0.0];
        GaussianBatch { means: self.means, log_std: self.log_std, actions: action }.log_probs(&mut log_prob);
        log_prob[0]
    }

    /// Differential entropy in nats, `Σ log σ + ½ log 2πe`. It does not depend on the means; its derivative by each
    /// log standard deviation is 1.
    pub fn entropy(&self) -> f32 {
        self.log_std.iter().map(|log_std| log_std + 0.5 * (2.0 * PI * E).ln()).sum()
    }
}

/// The distributions and actions of a batch: `means` and `actions` are `batch × components`, row-major; `log_std` has
/// one number per component and holds for all rows.
#[derive(Clone, Copy, Debug)]
pub struct GaussianBatch<'a> {
    /// Means.
    pub means: &'a [f32],
    /// Natural logarithms of the standard deviations.
    pub log_std: &'a [f32],
    /// The actions that were taken.
    pub actions: &'a [f32],
}

impl GaussianBatch<'_> {
    /// Writes the natural logarithm of each action's density:
    /// `Σ −½((a − μ)/σ)² − log σ − ½ log 2π`.
    ///
    /// # Panics
    /// When lengths do not fit.
    pub fn log_probs(&self, log_probs: &mut [f32]) {
        self.check(log_probs.len());
        let width = self.log_std.len();
        let constants: f32 = self.log_std.iter().map(|log_std| log_std + 0.5 * (2.0 * PI).ln()).sum();
        log_probs.fill(-constants);
        for (component, log_std) in self.log_std.iter().enumerate() {
            let inverse = (-log_std).exp();
            let means = self.means[component..].iter().step_by(width);
            let actions = self.actions[component..].iter().step_by(width);
            for ((log_prob, mean), action) in log_probs.iter_mut().zip(means).zip(actions) {
                let z = (action - mean) * inverse;
                *log_prob -= 0.5 * z * z;
            }
        }
    }

    /// The gradient of a loss whose derivatives by the log-densities are `d_log_probs`: writes the derivatives by the
    /// means (`batch × components`), adds those by the log standard deviations.
    ///
    /// `∂/∂μ = (a − μ)/σ²` and `∂/∂log σ = ((a − μ)/σ)² − 1`.
    ///
    /// # Panics
    /// When lengths do not fit.
    pub fn backward(&self, d_log_probs: &[f32], d_means: &mut [f32], d_log_std: &mut [f32]) {
        self.check(d_log_probs.len());
        assert_eq!(d_means.len(), self.means.len(), "derivatives by the means");
        assert_eq!(d_log_std.len(), self.log_std.len(), "derivatives by the log standard deviations");
        let width = self.log_std.len();
        for (component, log_std) in self.log_std.iter().enumerate() {
            let inverse = (-log_std).exp();
            let means = self.means[component..].iter().step_by(width);
            let actions = self.actions[component..].iter().step_by(width);
            let d_means = d_means[component..].iter_mut().step_by(width);
            let mut sum = 0.0_f64;
            for (((d, mean), action), d_mean) in d_log_probs.iter().zip(means).zip(actions).zip(d_means) {
                let z = (action - mean) * inverse;
                *d_mean = d * z * inverse;
                sum += f64::from(d * (z * z - 1.0));
            }
            d_log_std[component] += sum as f32;
        }
    }

    fn check(&self, batch: usize) {
        assert_eq!(self.means.len(), batch * self.log_std.len(), "means of a batch of {batch}");
        assert_eq!(self.actions.len(), self.means.len(), "actions of a batch of {batch}");
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::nn::reference;

    #[test]
    fn density_and_entropy_are_those_worked_out_by_hand() {
        // Means 1 and 0, σ = 1 and 2, action (2, 2): z = 1 and 1;
        // log density = −½ − ½ − ln 1 − ln 2 − ln 2π = −1 − 0.6931472 − 1.8378771 = −3.5310243.
        // Entropy = ln 1 + ln 2 + ln 2πe = 0.6931472 + 2.8378771 = 3.5310243: here the two happen to be opposite.
        let head = DiagonalGaussian { means: &[1.0, 0.0], log_std: &[0.0, std::f32::consts::LN_2] };
        assert!((head.log_prob(&[2.0, 2.0]) + 3.531_024_3).abs() < 1e-6, "{}", head.log_prob(&[2.0, 2.0]));
        assert!((head.entropy() - 3.531_024_3).abs() < 1e-6, "{}", head.entropy());
        // At the mean the two halves are gone: −2.5310243.
        assert!((head.log_prob(&[1.0, 0.0]) + 2.531_024_3).abs() < 1e-6);
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let (batch, width) = (4, 3);
        let actions: Vec<f32> = (0..batch * width).map(|i| (i as f32 * 0.9).sin()).collect();
        let d_log_probs = [0.5, -1.0, 2.0, 0.25];
        // Means first, then log standard deviations.
        let point: Vec<f32> = (0..(batch + 1) * width).map(|i| 0.6 * (i as f32 * 1.7).cos()).collect();
        let (means, log_std) = point.split_at(batch * width);

        let mut d_means = vec![9.0; batch * width];
        let mut d_log_std = vec![1.0; width];
        GaussianBatch { means, log_std, actions: &actions }.backward(
            &d_log_probs,
            &mut d_means,
            &mut d_log_std,
        );
        // Derivatives by the log standard deviations are added to what was there.
        d_log_std.iter_mut().for_each(|d| *d -= 1.0);

        let loss = |point: &[f64]| -> f64 {
            let (means, log_std) = point.split_at(batch * width);
            (0..batch * width)
                .map(|i| {
                    let std = log_std[i % width].exp();
                    let z = (f64::from(actions[i]) - means[i]) / std;
                    let density = (-0.5 * z * z).exp() / (std * (2.0 * std::f64::consts::PI).sqrt());
                    f64::from(d_log_probs[i / width]) * density.ln()
                })
                .sum()
        };
        let point: Vec<f64> = point.iter().map(|&x| f64::from(x)).collect();
        let all: Vec<usize> = (0..point.len()).collect();
        let exact = reference::differences(&point, &all, loss);
        let (exact_means, exact_log_std) = exact.split_at(batch * width);
        assert!(reference::relative_error(&d_means, exact_means) < 1e-5, "{d_means:?} {exact_means:?}");
        assert!(
            reference::relative_error(&d_log_std, exact_log_std) < 1e-5,
            "{d_log_std:?} {exact_log_std:?}"
        );
    }

    #[test]
    fn samples_have_the_mean_and_the_deviation() {
        let head = DiagonalGaussian { means: &[3.0, -1.0, 0.5], log_std: &[-1.0, 0.5, 0.0] };
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let count = 20_000;
        let (mut sums, mut squares) = ([0.0_f64; 3], [0.0_f64; 3]);
        let mut log_probs = 0.0;
        for _ in 0..count {
            let mut action = [0.0; 3];
            head.sample(&mut rng, &mut action);
            log_probs += f64::from(head.log_prob(&action));
            for i in 0..3 {
                sums[i] += f64::from(action[i]);
                squares[i] += f64::from(action[i] - head.means[i]).powi(2);
            }
        }
        for i in 0..3 {
            let std = f64::from(head.log_std[i]).exp();
            let (mean, deviation) = (sums[i] / f64::from(count), (squares[i] / f64::from(count)).sqrt());
            // Four standard errors: σ/√20000 and σ/√40000.
            assert!((mean - f64::from(head.means[i])).abs() < 0.029 * std, "mean {mean}");
            assert!((deviation / std - 1.0).abs() < 0.02, "deviation {deviation} for {std}");
        }
        // Entropy is the mean of −log density; its standard error here is √(3/2)/√20000 = 0.0087.
        assert!((-log_probs / f64::from(count) - f64::from(head.entropy())).abs() < 0.035, "{log_probs}");
    }
}
