//! Running means and variances, and the two things that are scaled by them: observations and rewards.

use serde::{Deserialize, Serialize};

/// Normalised numbers are cut to `± LIMIT`.
const LIMIT: f64 = 10.0;

/// Added to a variance before its root is taken.
const EPSILON: f64 = 1e-8;

/// Count, means and variances of vectors seen so far, per component, in double precision. A summary of some vectors and
/// one of others merge into the summary of all, by the formulas of Chan, Golub & LeVeque (1983).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunningMoments {
    count: u64,
    means: Vec<f64>,
    /// Sums of squared differences from the mean.
    squares: Vec<f64>,
}

impl RunningMoments {
    /// Nothing seen yet, of vectors of this size.
    pub fn new(size: usize) -> Self {
        Self { count: 0, means: vec![0.0; size], squares: vec![0.0; size] }
    }

    /// Takes in vectors, one after the other in `rows`. The result depends on their order only in the last bits. A
    /// number that is not finite spoils the moments for good.
    ///
    /// # Panics
    /// When the length of `rows` is no multiple of the size.
    pub fn update(&mut self, rows: &[f32]) {
        let size = self.means.len();
        assert!(rows.len().is_multiple_of(size.max(1)), "length of rows for running moments");
        for row in rows.chunks_exact(size.max(1)) {
            self.add(row.iter().map(|&x| f64::from(x)));
        }
    }

    /// Welford's update with one vector.
    fn add(&mut self, row: impl Iterator<Item = f64>) {
        self.count += 1;
        let weight = 1.0 / self.count as f64;
        for ((x, mean), squares) in row.zip(&mut self.means).zip(&mut self.squares) {
            let before = x - *mean;
            *mean += weight * before;
            *squares += before * (x - *mean);
        }
    }

    /// Takes in everything that `other` has seen.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(other.means.len(), self.means.len(), "size of merged running moments");
        if other.count == 0 {
            return;
        }
        let (a, b) = (self.count as f64, other.count as f64);
        self.count += other.count;
        for i in 0..self.means.len() {
            let difference = other.means[i] - self.means[i];
            self.means[i] += difference * b / (a + b);
            self.squares[i] += other.squares[i] + difference * difference * a * b / (a + b);
        }
    }

    /// How many vectors were seen.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Means; zero before the first vector.
    pub fn means(&self) -> &[f64] {
        &self.means
    }

    /// Variances, with divisor `n`; one before the second vector, so that nothing is scaled up on no evidence.
    pub fn variances(&self) -> impl Iterator<Item = f64> {
        self.squares.iter().map(|squares| if self.count < 2 { 1.0 } else { squares / self.count as f64 })
    }

    /// The moments as they stand, as a map for observations.
    pub fn normalizer(&self) -> Normalizer {
        let mut normalizer = Normalizer::identity(self.means.len());
        self.refresh(&mut normalizer);
        normalizer
    }

    /// Brings a [`Self::normalizer`] of earlier up to date.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn refresh(&self, normalizer: &mut Normalizer) {
        let Normalizer { means, scales } = normalizer;
        assert_eq!(means.len(), self.means.len(), "size of a normaliser");
        means.iter_mut().zip(&self.means).for_each(|(to, &mean)| *to = mean as f32);
        scales
            .iter_mut()
            .zip(self.variances())
            .for_each(|(to, variance)| *to = (1.0 / (variance + EPSILON).sqrt()) as f32);
    }
}

/// A fixed map of observations, `(x − mean) / σ`, cut to ±10. Part of a trained policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normalizer {
    /// Means.
    pub means: Vec<f32>,
    /// Reciprocals of the standard deviations.
    pub scales: Vec<f32>,
}

impl Normalizer {
    /// Changes nothing that lies within ±10.
    pub fn identity(size: usize) -> Self {
        Self { means: vec![0.0; size], scales: vec![1.0; size] }
    }

    /// Writes the normalised vectors of `rows`, one after the other.
    ///
    /// # Panics
    /// When the lengths differ or are no multiple of the size.
    pub fn apply(&self, rows: &[f32], normalized: &mut [f32]) {
        let size = self.means.len();
        assert_eq!(normalized.len(), rows.len(), "length of normalised rows");
        assert!(rows.len().is_multiple_of(size.max(1)), "length of rows to normalise");
        let limit = LIMIT as f32;
        for (to, from) in normalized.chunks_exact_mut(size.max(1)).zip(rows.chunks_exact(size.max(1))) {
            for (((y, x), mean), scale) in to.iter_mut().zip(from).zip(&self.means).zip(&self.scales) {
                *y = ((x - mean) * scale).clamp(-limit, limit);
            }
        }
    }
}

/// Scales rewards by the spread of the discounted returns that they add up to, so that a critic's targets are of order
/// one whatever the task's units. Rewards are not shifted: that would change which behaviour is best.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReturnScaler {
    gamma: f64,
    /// Per environment, `G_t = γ G_{t−1} + r_t` since the episode began.
    returns: Vec<f64>,
    /// Of all environments' `G_t`.
    moments: RunningMoments,
}

impl ReturnScaler {
    /// For that many environments with rewards discounted by `gamma` per step.
    pub fn new(environments: usize, gamma: f64) -> Self {
        Self { gamma, returns: vec![0.0; environments], moments: RunningMoments::new(1) }
    }

    /// Takes in the reward of one environment's step and returns it scaled, cut to ±10.
    ///
    /// # Panics
    /// When there is no such environment.
    pub fn scale(&mut self, environment: usize, reward: f64) -> f64 {
        let running = &mut self.returns[environment];
        *running = self.gamma * *running + reward;
        self.moments.add(std::iter::once(*running));
        (reward * self.factor()).clamp(-LIMIT, LIMIT)
    }

    /// Starts an environment's discounted sum afresh; to be called after the [`Self::scale`] of an episode's last step,
    /// terminated or truncated.
    ///
    /// # Panics
    /// When there is no such environment.
    pub fn end_episode(&mut self, environment: usize) {
        self.returns[environment] = 0.0;
    }

    /// What rewards are multiplied with at present.
    pub fn factor(&self) -> f64 {
        self.moments.variances().map(|variance| 1.0 / (variance + EPSILON).sqrt()).sum()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn rows(count: usize) -> Vec<f32> {
        // Two components; the second far from zero, where naive sums of squares lose their digits.
        (0..count).flat_map(|i| [(i as f32 * 0.7).sin(), 1000.0 + (i as f32 * 1.1).cos()]).collect()
    }

    fn assert_close(a: &RunningMoments, b: &RunningMoments) {
        assert_eq!(a.count(), b.count());
        let pairs = a.means().iter().zip(b.means()).map(|(a, b)| (*a, *b));
        for (a, b) in pairs.chain(a.variances().zip(b.variances())) {
            assert!((a - b).abs() <= 1e-9 * b.abs().max(1e-3), "{a} against {b}");
        }
    }

    #[test]
    fn moments_are_those_worked_out_by_hand() {
        // 2 4 9: mean 5, squared differences 9 1 16, variance 26/3. 1 1 1: mean 1, variance 0.
        let mut moments = RunningMoments::new(2);
        moments.update(&[2.0, 1.0, 4.0, 1.0, 9.0, 1.0]);
        assert_eq!(moments.count(), 3);
        assert!((moments.means()[0] - 5.0).abs() < 1e-12 && (moments.means()[1] - 1.0).abs() < 1e-12);
        let variances: Vec<f64> = moments.variances().collect();
        assert!((variances[0] - 26.0 / 3.0).abs() < 1e-12 && variances[1] == 0.0, "{variances:?}");
    }

    #[test]
    fn parts_merge_into_the_whole() {
        let all = rows(101);
        let mut whole = RunningMoments::new(2);
        whole.update(&all);
        for cut in [0, 2, 60, 200, 202] {
            let (mut first, mut second) = (RunningMoments::new(2), RunningMoments::new(2));
            first.update(&all[..cut]);
            second.update(&all[cut..]);
            first.merge(&second);
            assert_close(&first, &whole);
        }
        // Against two plain passes over the numbers.
        for component in 0..2 {
            let column = || all.iter().skip(component).step_by(2).map(|&x| f64::from(x));
            let mean = column().sum::<f64>() / 101.0;
            let variance = column().map(|x| (x - mean).powi(2)).sum::<f64>() / 101.0;
            assert!((whole.means()[component] - mean).abs() < 1e-9);
            assert!((whole.variances().nth(component).unwrap() - variance).abs() < 1e-9);
        }
    }

    #[test]
    fn normalised_observations_have_mean_zero_and_deviation_one_and_are_cut_at_ten() {
        let all = rows(500);
        let mut moments = RunningMoments::new(2);
        moments.update(&all);
        let mut normalized = vec![0.0; all.len()];
        moments.normalizer().apply(&all, &mut normalized);
        let mut after = RunningMoments::new(2);
        after.update(&normalized);
        for (mean, variance) in after.means().iter().zip(after.variances()) {
            assert!(mean.abs() < 1e-4 && (variance - 1.0).abs() < 1e-4, "{mean} {variance}");
        }
        let mut far = [0.0; 2];
        moments.normalizer().apply(&[1e6, -1e6], &mut far);
        assert_eq!(far, [10.0, -10.0]);
    }

    #[test]
    fn before_there_is_a_spread_nothing_is_scaled() {
        let mut moments = RunningMoments::new(1);
        let mut y = [0.0];
        moments.normalizer().apply(&[3.0], &mut y);
        assert_eq!(y, [3.0]);
        moments.update(&[2.0]);
        moments.normalizer().apply(&[3.0], &mut y);
        assert_eq!(y, [1.0]);
        Normalizer::identity(1).apply(&[3.0], &mut y);
        assert_eq!(y, [3.0]);
    }

    #[test]
    fn rewards_are_divided_by_the_deviation_of_discounted_returns() {
        // γ = ½, rewards 2 then 4 then, in a new episode, 3: G = 2, 5, 3.
        // After one: no spread yet, factor 1. After two: mean 3.5, variance 2.25, deviation 1.5: 4/1.5 = 2.6666667.
        // After three: mean 10/3, variance (16 + 25 + 1)/27 = 14/9, deviation 1.2472191: 3/1.2472191 = 2.4053511.
        let mut scaler = ReturnScaler::new(2, 0.5);
        assert!((scaler.scale(0, 2.0) - 2.0).abs() < 1e-7);
        assert!((scaler.scale(0, 4.0) - 2.666_666_7).abs() < 1e-7);
        scaler.end_episode(0);
        assert!((scaler.scale(0, 3.0) - 2.405_351_1).abs() < 1e-7);
        // Environment 1 has a sum of its own: G = −1, not ½·3 − 1.
        scaler.scale(1, -1.0);
        assert_eq!(scaler.returns, [3.0, -1.0]);
    }

    #[test]
    fn a_scaled_reward_is_cut_at_ten() {
        // One outlier x among n − 1 zeros: deviation x·√(n − 1)/n. 5/√4 = 2.5 passes; 401/√400 = 20.05 is cut.
        for (zeros, expected) in [(4, 2.5), (400, 10.0)] {
            let mut scaler = ReturnScaler::new(1, 0.9);
            (0..zeros).for_each(|_| assert_eq!(scaler.scale(0, 0.0), 0.0));
            assert!((scaler.scale(0, -1e6) + expected).abs() < 1e-6);
        }
    }

    #[test]
    fn stored_and_read_again_they_are_the_same() {
        let mut scaler = ReturnScaler::new(3, 0.99);
        for step in 0..100 {
            scaler.scale(step % 3, (step as f64 * 0.3).sin());
        }
        let text = serde_json::to_string(&scaler).unwrap();
        assert_eq!(serde_json::from_str::<ReturnScaler>(&text).unwrap(), scaler);
        let normalizer = scaler.moments.normalizer();
        let text = serde_json::to_string(&normalizer).unwrap();
        assert_eq!(serde_json::from_str::<Normalizer>(&text).unwrap(), normalizer);
    }
}
