//! Percentile bootstrap over contexts.
//!
//! The context is what was sampled independently: all options of a set meet the same contexts, so their
//! returns in one context move together. Resampling (option, context) pairs as if they were independent gives
//! intervals that are too short; a test below shows how much. Here whole contexts are drawn with replacement,
//! and whatever was measured in a context comes along.

use super::summary::{quantile_of_sorted, sorted, sum};
use super::{StatisticsError, check_confidence, check_result, check_sample};
use rand::RngExt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Resamples behind an interval where nothing else is asked for.
pub const DEFAULT_DRAWS: usize = 2000;

/// Confidence of an interval where nothing else is asked for.
pub const DEFAULT_CONFIDENCE: f64 = 0.95;

/// An estimate and the range that covers the true value with the confidence it was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// The statistic of the sample itself. A percentile interval of a skewed statistic need not contain it.
    pub estimate: f64,
    /// Lower end, included.
    pub low: f64,
    /// Upper end, included.
    pub high: f64,
}

impl Interval {
    /// Whether `value` is in the range, ends included.
    pub fn contains(&self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }
}

/// Percentile interval of any statistic of `n_contexts` contexts (Efron and Tibshirani 1993, section 13.3).
///
/// `statistic` is called with context indices: first `0..n_contexts` for the estimate, then `draws` times
/// with `n_contexts` indices drawn uniformly with replacement. The ends are the quantiles at
/// `(1 ∓ confidence) / 2` of the resampled statistics. To compare two sets on common contexts, let the
/// statistic be the difference of theirs at the same indices. For means, [`bootstrap_means`] and
/// [`paired_difference`] give the same interval faster.
///
/// # Errors
/// - fewer than two contexts: one context says nothing of the others;
/// - a confidence outside (0, 1), or too few draws for it: at least one draw must fall beyond each end
///   (40 for 0.95);
/// - a statistic that is NaN or infinite on some resample.
pub fn bootstrap(
    n_contexts: usize,
    draws: usize,
    confidence: f64,
    rng: &mut (impl rand::Rng + ?Sized),
    statistic: impl Fn(&[usize]) -> f64,
) -> Result<Interval, StatisticsError> {
    check_plan(n_contexts, draws, confidence)?;
    let mut indices: Vec<usize> = (0..n_contexts).collect();
    let mut statistics = vec![statistic(&indices)];
    for _ in 0..draws {
        indices.fill_with(|| rng.random_range(0..n_contexts));
        statistics.push(statistic(&indices));
    }
    interval_of(&statistics, n_contexts, confidence)
}

/// The interval of [`bootstrap`] from its statistics: first the estimate, then that of each resample.
///
/// # Errors
/// As [`bootstrap`].
pub fn interval_of(
    statistics: &[f64],
    n_contexts: usize,
    confidence: f64,
) -> Result<Interval, StatisticsError> {
    check_plan(n_contexts, statistics.len().saturating_sub(1), confidence)?;
    match statistics.iter().position(|value| !value.is_finite()) {
        None => percentile_interval(statistics[0], &statistics[1..], confidence),
        Some(draw) => Err(StatisticsError::Statistic { draw, value: statistics[draw] }),
    }
}

/// Percentile interval of the mean of one value a context. See [`bootstrap`] for method and errors.
pub fn bootstrap_mean(
    values: &[f64],
    draws: usize,
    confidence: f64,
    rng: &mut (impl rand::Rng + ?Sized),
) -> Result<Interval, StatisticsError> {
    Ok(bootstrap_means(&[values], draws, confidence, rng)?[0])
}

/// Percentile intervals of the means of several quantities measured on the same contexts, in the order of
/// `columns`; `columns[q][c]` is quantity `q` in context `c`.
///
/// A resample is one multinomial vector of weights that averages all columns, so the cost of drawing is
/// shared and each column gets exactly the interval that it would get alone from the same generator. No
/// columns give no intervals and draw nothing. Costs `O(draws · contexts · columns)`.
///
/// # Errors
/// As [`bootstrap`]; also when columns differ in length or hold a value that is not finite.
pub fn bootstrap_means(
    columns: &[&[f64]],
    draws: usize,
    confidence: f64,
    rng: &mut (impl rand::Rng + ?Sized),
) -> Result<Vec<Interval>, StatisticsError> {
    let Some(n_contexts) = columns.first().map(|column| column.len()) else {
        return Ok(Vec::new());
    };
    check_plan(n_contexts, draws, confidence)?;
    for column in columns {
        check_common(n_contexts, column.len())?;
        check_sample(column, 2)?;
    }
    let mut resampled = vec![Vec::with_capacity(draws); columns.len()];
    let mut weights = vec![0.0; n_contexts];
    for _ in 0..draws {
        weights.fill(0.0);
        for _ in 0..n_contexts {
            weights[rng.random_range(0..n_contexts)] += 1.0;
        }
        for (column, means) in columns.iter().zip(&mut resampled) {
            let total =
                column.iter().zip(&weights).fold(0.0, |total, (value, weight)| total + value * weight);
            means.push(check_result(total / n_contexts as f64, "a mean")?);
        }
    }
    columns
        .iter()
        .zip(&resampled)
        .map(|(column, means)| percentile_interval(sum(column) / n_contexts as f64, means, confidence))
        .collect()
}

/// Percentile interval of `mean(first) − mean(second)`, two quantities measured on the same contexts.
///
/// `first[c]` and `second[c]` belong to context `c`, for example the average return of two option sets there.
/// What the contexts do to both cancels, so this is far sharper than comparing two separate intervals. The
/// difference is significant at `1 − confidence` when the interval does not contain 0.
///
/// # Errors
/// As [`bootstrap_means`].
pub fn paired_difference(
    first: &[f64],
    second: &[f64],
    draws: usize,
    confidence: f64,
    rng: &mut (impl rand::Rng + ?Sized),
) -> Result<Interval, StatisticsError> {
    check_common(first.len(), second.len())?;
    check_sample(first, 2)?;
    check_sample(second, 2)?;
    let differences: Vec<f64> = first.iter().zip(second).map(|(first, second)| first - second).collect();
    bootstrap_mean(&differences, draws, confidence, rng)
}

fn check_common(expected: usize, got: usize) -> Result<(), StatisticsError> {
    if expected == got { Ok(()) } else { Err(StatisticsError::Unpaired { expected, got }) }
}

fn check_plan(n_contexts: usize, draws: usize, confidence: f64) -> Result<(), StatisticsError> {
    check_confidence(confidence)?;
    if n_contexts < 2 {
        return Err(StatisticsError::TooFew { needed: 2, got: n_contexts });
    }
    // The slack absorbs the rounding of 1 − confidence.
    if draws as f64 * (1.0 - confidence) / 2.0 < 1.0 - 1e-9 {
        let expected = "at least 2 / (1 - confidence)";
        return Err(StatisticsError::Parameter { name: "draws", expected, value: draws as f64 });
    }
    Ok(())
}

fn percentile_interval(
    estimate: f64,
    resampled: &[f64],
    confidence: f64,
) -> Result<Interval, StatisticsError> {
    let ordered = sorted(resampled);
    let tail = (1.0 - confidence) / 2.0;
    Ok(Interval {
        estimate: check_result(estimate, "a mean")?,
        low: quantile_of_sorted(&ordered, tail)?,
        high: quantile_of_sorted(&ordered, 1.0 - tail)?,
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::fixture::two_mode_sample;
    use super::super::summary::{lower_tail, mean, sample_sd};
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn normal(rng: &mut ChaCha8Rng) -> f64 {
        let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
        radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
    }

    /// Share of replications in which the interval covers the truth, one entry a statistic.
    fn coverage<const S: usize>(
        replications: usize,
        mut intervals: impl FnMut(&mut ChaCha8Rng) -> [(Interval, f64); S],
    ) -> [f64; S] {
        let mut rng = ChaCha8Rng::seed_from_u64(20190613);
        let mut hits = [0; S];
        for _ in 0..replications {
            for (hit, (interval, truth)) in hits.iter_mut().zip(intervals(&mut rng)) {
                *hit += usize::from(interval.contains(truth));
            }
        }
        hits.map(|hit| f64::from(u32::try_from(hit).unwrap()) / replications as f64)
    }

    #[test]
    fn bootstrap_covers_mean_and_tail_of_a_two_mode_model() {
        // 85 % N(0.30, 0.05²), 15 % N(0.05, 0.03²). Below 0.15: 0.85 Φ(−3) + 0.15 Φ(10/3).
        let truths = (0.85 * 0.30 + 0.15 * 0.05, 0.85 * 0.001349898031630 + 0.15 * 0.999570939666803);
        let [mean, tail] = coverage(2000, |rng| {
            let draw = |rng: &mut ChaCha8Rng| {
                let good = rng.random::<f64>() < 0.85;
                if good { 0.30 + 0.05 * normal(rng) } else { 0.05 + 0.03 * normal(rng) }
            };
            let returns: Vec<f64> = (0..300).map(|_| draw(rng)).collect();
            let falls: Vec<f64> = returns.iter().map(|&v| f64::from(u8::from(v < 0.15))).collect();
            let both = bootstrap_means(&[&returns, &falls], 400, 0.95, rng).unwrap();
            [(both[0], truths.0), (both[1], truths.1)]
        });
        assert!((0.92..=0.97).contains(&mean), "mean covered {mean}");
        assert!((0.92..=0.97).contains(&tail), "tail covered {tail}");
    }

    #[test]
    fn options_on_common_contexts_need_whole_contexts() {
        // Five options whose returns in one context correlate by 0.4. Resampling pairs must be caught
        // covering less.
        let [contexts, pairs] = coverage(400, |rng| {
            let returns: Vec<[f64; 5]> = (0..60)
                .map(|_| {
                    let shared = 0.4_f64.sqrt() * normal(rng);
                    std::array::from_fn(|_| shared + 0.6_f64.sqrt() * normal(rng))
                })
                .collect();
            let averages: Vec<f64> = returns.iter().map(|row| mean(row).unwrap()).collect();
            let flat: Vec<f64> = returns.iter().flatten().copied().collect();
            let contexts = bootstrap_mean(&averages, 400, 0.95, rng).unwrap();
            [(contexts, 0.0), (bootstrap_mean(&flat, 400, 0.95, rng).unwrap(), 0.0)]
        });
        assert!((0.91..=0.98).contains(&contexts), "contexts covered {contexts}");
        assert!(pairs < 0.88, "pairs covered {pairs}");
    }

    #[test]
    fn interval_of_a_mean_is_that_of_the_normal_limit() {
        // Mean ± 1.96 s / √n, to the Monte-Carlo error of an end: about 2 % of the half width at 20 000
        // draws.
        let sample = two_mode_sample(300);
        let interval = bootstrap_mean(&sample, 20_000, 0.95, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
        let half = 1.959963984540054 * sample_sd(&sample).unwrap() / 300_f64.sqrt();
        assert_eq!(interval.estimate, mean(&sample).unwrap());
        assert!((interval.low - (interval.estimate - half)).abs() < 0.06 * half, "{interval:?}");
        assert!((interval.high - (interval.estimate + half)).abs() < 0.06 * half, "{interval:?}");
    }

    #[test]
    fn fast_path_equals_the_general_one() {
        let sample = two_mode_sample(120);
        let other: Vec<f64> = sample.iter().map(|value| value * value).collect();
        let rng = || ChaCha8Rng::seed_from_u64(7);
        let at = |column: &[f64], indices: &[usize]| indices.iter().map(|&c| column[c]).sum::<f64>() / 120.0;
        let general = bootstrap(120, 200, 0.9, &mut rng(), |indices| at(&sample, indices)).unwrap();
        let difference = |indices: &[usize]| at(&sample, indices) - at(&other, indices);
        let general_difference = bootstrap(120, 200, 0.9, &mut rng(), difference).unwrap();
        let columns = bootstrap_means(&[&other, &sample], 200, 0.9, &mut rng()).unwrap();
        let fast_difference = paired_difference(&sample, &other, 200, 0.9, &mut rng()).unwrap();
        for (fast, general) in [(columns[1], general), (fast_difference, general_difference)] {
            assert!((fast.estimate - general.estimate).abs() < 1e-14);
            assert!((fast.low - general.low).abs() < 1e-14 && (fast.high - general.high).abs() < 1e-14);
        }
        assert_eq!(columns[1], bootstrap_mean(&sample, 200, 0.9, &mut rng()).unwrap());
    }

    #[test]
    fn pairing_removes_what_contexts_do_to_both() {
        let first = two_mode_sample(200);
        let second: Vec<f64> = first.iter().map(|value| value - 0.01).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let difference = paired_difference(&first, &second, 100, 0.95, &mut rng).unwrap();
        assert!((difference.low - 0.01).abs() < 1e-12 && (difference.high - 0.01).abs() < 1e-12);
    }

    #[test]
    fn any_statistic_of_contexts_can_be_resampled() {
        let sample = two_mode_sample(300);
        let tail = |indices: &[usize]| {
            let resample: Vec<f64> = indices.iter().map(|&c| sample[c]).collect();
            lower_tail(&resample, 0.1).unwrap()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let interval = bootstrap(300, DEFAULT_DRAWS, DEFAULT_CONFIDENCE, &mut rng, tail).unwrap();
        // Binomial(300, 31/300): mean 31, standard deviation 5.27, 95 % of its mass from 21 to 42.
        assert!((interval.low - 21.0 / 300.0).abs() <= 1.01 / 300.0, "{interval:?}");
        assert!((interval.high - 42.0 / 300.0).abs() <= 1.01 / 300.0, "{interval:?}");
        assert_eq!(interval.estimate, 31.0 / 300.0);
    }

    #[test]
    fn equal_seeds_give_equal_bits() {
        let sample = two_mode_sample(50);
        let run = |seed| bootstrap_mean(&sample, 100, 0.95, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
    }

    #[test]
    fn undefined_intervals_are_errors() {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut go = |values: &[f64], draws, confidence| bootstrap_mean(values, draws, confidence, &mut rng);
        assert!(matches!(go(&[], 100, 0.95), Err(StatisticsError::TooFew { needed: 2, got: 0 })));
        assert!(matches!(go(&[1.0], 100, 0.95), Err(StatisticsError::TooFew { needed: 2, got: 1 })));
        assert!(matches!(go(&[1.0, f64::NAN], 100, 0.95), Err(StatisticsError::NotFinite { index: 1, .. })));
        assert!(matches!(go(&[1.0, 2.0], 39, 0.95), Err(StatisticsError::Parameter { name: "draws", .. })));
        assert!(go(&[1.0, 2.0], 40, 0.95).is_ok());
        assert!(matches!(go(&[1.0, 2.0], 100, 1.0), Err(StatisticsError::Parameter { .. })));
        assert!(matches!(go(&[f64::MAX, f64::MAX], 100, 0.95), Err(StatisticsError::Overflow { .. })));
        let unpaired = paired_difference(&[1.0, 2.0], &[1.0], 100, 0.95, &mut rng);
        assert!(matches!(unpaired, Err(StatisticsError::Unpaired { expected: 2, got: 1 })));
        let nan = bootstrap(5, 100, 0.95, &mut rng, |indices| if indices[0] == 0 { 1.0 } else { f64::NAN });
        assert!(matches!(nan, Err(StatisticsError::Statistic { draw: 1.., .. })));
        assert_eq!(bootstrap_means(&[], 100, 0.95, &mut rng), Ok(Vec::new()));
    }
}
