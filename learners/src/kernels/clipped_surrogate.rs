//! The clipped surrogate objective of PPO (Weber et al. 2019, Eq. 2.4; Schulman et al. 2017).

/// What a batch knows of its actions. All slices have length `n`.
#[derive(Clone, Copy, Debug)]
pub struct SurrogateBatch<'a> {
    /// Log-densities of the actions under the policy that is being changed, `log π_θ(a|s)`.
    pub log_probs: &'a [f32],
    /// Log-densities under the policy that took them, `log π_θk(a|s)`.
    pub old_log_probs: &'a [f32],
    /// Advantages under that policy.
    pub advantages: &'a [f32],
}

/// Means over a batch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surrogate {
    /// The negated objective, to be minimised.
    pub loss: f32,
    /// An estimate of the Kullback–Leibler divergence of the new policy from the old, `mean(ρ − 1 − log ρ)`: never
    /// negative, and of less variance than `−mean(log ρ)`.
    pub approx_kl: f32,
    /// Share of the actions whose probability ratio lies outside `1 ± ε`, in [0, 1].
    pub clip_fraction: f32,
}

/// The loss `−mean(min(ρ A, clip(ρ, 1 − ε, 1 + ε) A))` with ratio `ρ = π_θ / π_θk`, and its derivatives by the new
/// log-densities: `−ρ A / n`, or zero where the clipped term is the smaller one.
///
/// Sums are in double precision. Ratios overflow when log-densities differ by more than 88; loss and derivatives are
/// then not finite.
///
/// # Panics
/// When lengths differ or the batch is empty.
pub fn clipped_surrogate(batch: &SurrogateBatch<'_>, epsilon: f32, d_log_probs: &mut [f32]) -> Surrogate {
    let SurrogateBatch { log_probs, old_log_probs, advantages } = *batch;
    assert!(!log_probs.is_empty(), "a surrogate of an empty batch");
    assert_eq!(old_log_probs.len(), log_probs.len(), "old log-densities");
    assert_eq!(advantages.len(), log_probs.len(), "advantages");
    assert_eq!(d_log_probs.len(), log_probs.len(), "derivatives by the log-densities");
    let count = log_probs.len() as f64;
    let (mut objective, mut divergence, mut clipped) = (0.0_f64, 0.0_f64, 0_usize);
    for (i, derivative) in d_log_probs.iter_mut().enumerate() {
        let log_ratio = log_probs[i] - old_log_probs[i];
        let ratio = log_ratio.exp();
        let free = ratio * advantages[i];
        let bound = ratio.clamp(1.0 - epsilon, 1.0 + epsilon) * advantages[i];
        *derivative = if free <= bound { -free / count as f32 } else { 0.0 };
        objective += f64::from(free.min(bound));
        divergence += f64::from(log_ratio.exp_m1() - log_ratio);
        clipped += usize::from((ratio - 1.0).abs() > epsilon);
    }
    Surrogate {
        loss: (-objective / count) as f32,
        approx_kl: (divergence / count) as f32,
        clip_fraction: (clipped as f64 / count) as f32,
    }
}

/// How far an epoch moved the policy: the median of its minibatches' `approx_kl`, because single actions that have become
/// likely beyond measure make a mean useless.
///
/// # Panics
/// When there is none.
pub fn typical_kl(mut minibatches: Vec<f32>) -> f32 {
    minibatches.sort_by(f32::total_cmp);
    minibatches[minibatches.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::reference;

    #[test]
    fn each_branch_gives_the_number_worked_out_by_hand() {
        // ε = 0.2. Ratios 1, 1.5, 1.5, 0.5, 0.5 with advantages 2, 1, −1, 1, −1:
        //   ρ A:        2,  1.5, −1.5,  0.5, −0.5
        //   clipped A:  2,  1.2, −1.2,  0.8, −0.8
        //   minimum:    2,  1.2, −1.5,  0.5, −0.8   sum 1.4, loss −1.4/5 = −0.28
        //   −ρ A / 5 where the free term is the minimum: −0.4, 0, 0.3, −0.1, 0
        // Outside 0.8..1.2: four of five.
        // ρ − 1 − ln ρ: 0; 0.5 − 0.4054651 = 0.0945349 twice; −0.5 + 0.6931472 = 0.1931472 twice; mean 0.1150728.
        let log_ratios: Vec<f32> = [1.0_f32, 1.5, 1.5, 0.5, 0.5].iter().map(|r| r.ln()).collect();
        let old_log_probs = [-3.0, 0.0, 1.0, -1.0, 2.0];
        let log_probs: Vec<f32> = log_ratios.iter().zip(&old_log_probs).map(|(r, o)| r + o).collect();
        let batch = SurrogateBatch {
            log_probs: &log_probs,
            old_log_probs: &old_log_probs,
            advantages: &[2.0, 1.0, -1.0, 1.0, -1.0],
        };
        let mut derivatives = [9.0; 5];
        let surrogate = clipped_surrogate(&batch, 0.2, &mut derivatives);
        assert!((surrogate.loss + 0.28).abs() < 1e-6, "{surrogate:?}");
        assert!((surrogate.approx_kl - 0.115_072_8).abs() < 1e-6, "{surrogate:?}");
        assert!((surrogate.clip_fraction - 0.8).abs() < 1e-7, "{surrogate:?}");
        for (got, expected) in derivatives.iter().zip([-0.4, 0.0, 0.3, -0.1, 0.0]) {
            assert!((got - expected).abs() < 1e-6, "{derivatives:?}");
        }
    }

    #[test]
    fn one_minibatch_beyond_measure_does_not_count() {
        assert_eq!(typical_kl(vec![0.3, f32::INFINITY, 0.1]), 0.3);
        assert_eq!(typical_kl(vec![0.2]), 0.2);
    }

    #[test]
    fn an_unchanged_policy_has_the_plain_policy_gradient() {
        let log_probs = [-1.0, -2.0];
        let batch =
            SurrogateBatch { log_probs: &log_probs, old_log_probs: &log_probs, advantages: &[3.0, -5.0] };
        let mut derivatives = [0.0; 2];
        let surrogate = clipped_surrogate(&batch, 0.2, &mut derivatives);
        assert_eq!(surrogate, Surrogate { loss: 1.0, approx_kl: 0.0, clip_fraction: 0.0 });
        assert_eq!(derivatives, [-1.5, 2.5]);
    }

    #[test]
    fn derivatives_agree_with_finite_differences() {
        let count = 24;
        let wave = |i: usize, rate: f32| (i as f32 * rate).sin();
        let log_probs: Vec<f32> = (0..count).map(|i| -1.0 + 0.4 * wave(i, 1.3)).collect();
        let old_log_probs: Vec<f32> = (0..count).map(|i| -1.0 + 0.1 * wave(i, 2.1)).collect();
        let advantages: Vec<f32> = (0..count).map(|i| 2.0 * wave(i, 0.7)).collect();
        let batch =
            SurrogateBatch { log_probs: &log_probs, old_log_probs: &old_log_probs, advantages: &advantages };
        let mut derivatives = vec![0.0; count];
        clipped_surrogate(&batch, 0.2, &mut derivatives);
        let loss = |log_probs: &[f64]| -> f64 {
            let objective = |i: usize| {
                let (ratio, advantage) =
                    ((log_probs[i] - f64::from(old_log_probs[i])).exp(), f64::from(advantages[i]));
                (ratio * advantage).min(ratio.clamp(0.8, 1.2) * advantage)
            };
            -(0..count).map(objective).sum::<f64>() / count as f64
        };
        let point: Vec<f64> = log_probs.iter().map(|&x| f64::from(x)).collect();
        let all: Vec<usize> = (0..count).collect();
        let exact = reference::differences(&point, &all, loss);
        assert!(exact.contains(&0.0) && exact.iter().any(|&d| d != 0.0), "both branches occur");
        let error = reference::relative_error(&derivatives, &exact);
        assert!(error < 1e-5, "relative error {error}");
    }
}
