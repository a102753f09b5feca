//! Numbers that summarise one sample.
//!
//! All of them refuse empty samples and samples with NaN or infinite values.

use super::{StatisticsError, check_result, check_sample};

/// Longest run that [`sum`] adds in one go.
const SUM_BLOCK: usize = 64;

/// Pairwise sum: blocks of 64 from left to right, then halves, so the rounding error grows with `log n` and
/// the order depends on the length alone. An empty slice gives 0; NaN and infinities propagate.
pub fn sum(values: &[f64]) -> f64 {
    if values.len() <= SUM_BLOCK {
        return values.iter().fold(0.0, |total, value| total + value);
    }
    let (left, right) = values.split_at(values.len() / 2);
    sum(left) + sum(right)
}

/// Arithmetic mean.
pub fn mean(sample: &[f64]) -> Result<f64, StatisticsError> {
    check_sample(sample, 1)?;
    check_result(sum(sample) / sample.len() as f64, "a mean")
}

/// Standard deviation of the sample as a population of its own (divides by `n`); 0 for one value.
///
/// This is σ* of a stored return sample (Weber et al. 2019, Eq. 4.2), where the sample stands for the
/// distribution.
pub fn population_sd(sample: &[f64]) -> Result<f64, StatisticsError> {
    check_sample(sample, 1)?;
    check_result((squared_deviations(sample) / sample.len() as f64).sqrt(), "a standard deviation")
}

/// Standard deviation that estimates the spread of the distribution behind the sample (divides by `n − 1`).
///
/// # Errors
/// Needs two values.
pub fn sample_sd(sample: &[f64]) -> Result<f64, StatisticsError> {
    check_sample(sample, 2)?;
    check_result((squared_deviations(sample) / (sample.len() - 1) as f64).sqrt(), "a standard deviation")
}

/// `Σ (x − mean)²`, of the sample shifted by its first value so that equal values give exactly 0.
fn squared_deviations(sample: &[f64]) -> f64 {
    let shifted: Vec<f64> = sample.iter().map(|value| value - sample[0]).collect();
    let centre = sum(&shifted) / shifted.len() as f64;
    let squares: Vec<f64> = shifted.iter().map(|value| (value - centre) * (value - centre)).collect();
    sum(&squares)
}

/// The values in ascending order of [`f64::total_cmp`].
pub fn sorted(sample: &[f64]) -> Vec<f64> {
    let mut values = sample.to_vec();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// Quantile at `p ∈ [0, 1]`, interpolated linearly between order statistics: the value at position
/// `p (n − 1)` of the sorted sample (type 7 of Hyndman and Fan 1996, numpy's default).
///
/// Costs a sort; [`quantile_of_sorted`] saves it when several are wanted.
///
/// # Errors
/// Also when `p` is outside `[0, 1]` or NaN.
pub fn quantile(sample: &[f64], p: f64) -> Result<f64, StatisticsError> {
    quantile_of_sorted(&sorted(sample), p)
}

/// [`quantile`] of a sample that is in ascending order already; another order gives a meaningless number.
pub fn quantile_of_sorted(sorted: &[f64], p: f64) -> Result<f64, StatisticsError> {
    check_sample(sorted, 1)?;
    if !(0.0..=1.0).contains(&p) {
        return Err(StatisticsError::Parameter { name: "p", expected: "from 0 to 1", value: p });
    }
    let position = p * (sorted.len() - 1) as f64;
    let below = sorted[position.floor() as usize];
    let above = sorted[position.ceil() as usize];
    let share = position.fract();
    // Started from the nearer end, so that the result is monotone in p and hits both ends exactly.
    let value =
        if share < 0.5 { below + share * (above - below) } else { above - (1.0 - share) * (above - below) };
    check_result(value, "a quantile")
}

/// Interquartile mean: the mean without the lowest and the highest quarter, each of `⌊n / 4⌋` values
/// (Agarwal et al. 2021 through `scipy.stats.trim_mean(x, 0.25)`). Below four values it is the plain mean.
pub fn interquartile_mean(sample: &[f64]) -> Result<f64, StatisticsError> {
    let values = sorted(sample);
    let cut = values.len() / 4;
    check_sample(sample, 1)?;
    mean(&values[cut..values.len() - cut])
}

/// `Pr(V < threshold)`, counted: the share of values strictly below. The tail of ψ_- (Eq. 4.6) has the
/// threshold `μ* − α σ*`.
///
/// # Errors
/// Also when the threshold is NaN; an infinite one is an ordinary threshold.
pub fn lower_tail(sample: &[f64], threshold: f64) -> Result<f64, StatisticsError> {
    share(sample, threshold, |value| value < threshold)
}

/// `Pr(V > threshold)`, counted: the share of values strictly above. The tail of ψ_+ (Eq. 4.7) has the
/// threshold `μ*`.
///
/// # Errors
/// As [`lower_tail`].
pub fn upper_tail(sample: &[f64], threshold: f64) -> Result<f64, StatisticsError> {
    share(sample, threshold, |value| value > threshold)
}

fn share(sample: &[f64], threshold: f64, inside: impl Fn(f64) -> bool) -> Result<f64, StatisticsError> {
    check_sample(sample, 1)?;
    if threshold.is_nan() {
        let value = threshold;
        return Err(StatisticsError::Parameter { name: "threshold", expected: "a number", value });
    }
    Ok(sample.iter().filter(|&&value| inside(value)).count() as f64 / sample.len() as f64)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::fixture::two_mode_sample;
    use super::*;

    fn near(got: f64, want: f64) {
        assert!((got - want).abs() <= 1e-13 * want.abs().max(1.0), "got {got}, want {want}");
    }

    #[test]
    fn moments_match_numpy() {
        let sample = two_mode_sample(300);
        near(mean(&sample).unwrap(), 0.272113885076344);
        near(population_sd(&sample).unwrap(), 0.09117374986902677);
        near(sample_sd(&sample).unwrap(), 0.09132608706777175);
        near(interquartile_mean(&sample).unwrap(), 0.2909627808729807);
    }

    #[test]
    fn quantiles_match_numpy() {
        let sample = two_mode_sample(300);
        for (p, want) in [
            (0.025, 0.03323049),
            (0.1, 0.09487272),
            (0.5, 0.29197591),
            (0.9, 0.35868678),
            (0.975, 0.39002844),
        ] {
            assert!((quantile(&sample, p).unwrap() - want).abs() < 1e-8, "p = {p}");
        }
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.0), Ok(1.0));
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 1.0), Ok(3.0));
        assert_eq!(quantile(&[4.0, 1.0, 2.0, 3.0], 0.5), Ok(2.5));
        assert_eq!(quantile(&[7.0], 0.3), Ok(7.0));
        assert!(quantile(&[1.0], 1.1).is_err());
        assert!(quantile(&[1.0], f64::NAN).is_err());
    }

    #[test]
    fn interquartile_mean_drops_whole_values_at_each_end() {
        // trim_mean([0, 1, 2, 3, 100], 0.25) cuts ⌊1.25⌋ = 1 at each end: (1 + 2 + 3) / 3.
        near(interquartile_mean(&[100.0, 0.0, 2.0, 1.0, 3.0]).unwrap(), 2.0);
        near(interquartile_mean(&[0.0, 0.0, 9.0]).unwrap(), 3.0);
    }

    #[test]
    fn tails_are_strict_counts() {
        let sample = two_mode_sample(300);
        near(lower_tail(&sample, 0.1).unwrap(), 31.0 / 300.0);
        near(upper_tail(&sample, 0.35).unwrap(), 42.0 / 300.0);
        assert_eq!(lower_tail(&[1.0, 2.0, 2.0, 3.0], 2.0), Ok(0.25));
        assert_eq!(upper_tail(&[1.0, 2.0, 2.0, 3.0], 2.0), Ok(0.25));
        assert_eq!(lower_tail(&[1.0], f64::INFINITY), Ok(1.0));
        assert!(upper_tail(&[1.0], f64::NAN).is_err());
    }

    #[test]
    fn equal_values_have_no_spread_at_all() {
        let sample = vec![0.1; 1001];
        assert_eq!(population_sd(&sample), Ok(0.0));
        assert_eq!(sample_sd(&sample), Ok(0.0));
        assert_eq!(population_sd(&[5.0]), Ok(0.0));
    }

    #[test]
    fn spread_survives_a_large_offset() {
        // Deviations of ±1 around 1e9: the sum of squares cancels if it is taken before the mean.
        let sample: Vec<f64> = (0..1000).map(|i| 1e9 + if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        near(population_sd(&sample).unwrap(), 1.0);
    }

    #[test]
    fn pairwise_sum_loses_less_than_a_running_one() {
        let values = vec![0.1; 1_000_000];
        let running: f64 = values.iter().fold(0.0, |total, value| total + value);
        assert!((sum(&values) - 1e5).abs() < 1e-9);
        assert!((running - 1e5).abs() > 1e-7);
        assert_eq!(sum(&[]), 0.0);
    }

    #[test]
    fn no_statistic_answers_nan() {
        for statistic in [
            mean,
            population_sd,
            sample_sd,
            interquartile_mean,
            |x: &[f64]| quantile(x, 0.5),
            |x: &[f64]| lower_tail(x, 0.0),
        ] {
            assert!(matches!(statistic(&[]), Err(StatisticsError::TooFew { got: 0, .. })));
            let nan = statistic(&[1.0, f64::NAN, 2.0]);
            assert!(matches!(nan, Err(StatisticsError::NotFinite { .. })), "{nan:?}");
            assert!(statistic(&[1.0, f64::INFINITY, f64::NEG_INFINITY]).is_err());
        }
        assert!(matches!(sample_sd(&[1.0]), Err(StatisticsError::TooFew { needed: 2, got: 1 })));
        assert!(matches!(mean(&[f64::MAX, f64::MAX]), Err(StatisticsError::Overflow { .. })));
        assert!(matches!(population_sd(&[f64::MAX, f64::MIN]), Err(StatisticsError::Overflow { .. })));
        assert!(matches!(quantile(&[f64::MAX, f64::MIN], 0.5), Err(StatisticsError::Overflow { .. })));
    }
}
