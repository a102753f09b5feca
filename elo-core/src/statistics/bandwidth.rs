//! How wide the kernel of a [`Density`](super::density::Density) should be.
//!
//! All rules follow the sample when it is shifted or scaled. A sample without spread (one value, or values
//! equal but for rounding or underflow) has no bandwidth of its own; every rule then answers [`SPIKE`] of its
//! magnitude, so its curve is a narrow spike where the values are.

use super::summary::{quantile_of_sorted, sample_sd, sorted};
use super::{StatisticsError, check_result, check_sample};
use std::f64::consts::PI;

/// Bandwidth of a sample without spread, as a share of `max(|x|, 0.001)`.
pub const SPIKE: f64 = 1e-3;

/// Range of a sample, relative to its magnitude, that counts as rounding.
const NO_SPREAD: f64 = 1e-12;

/// Range below which squared deviations underflow.
const SMALLEST_RANGE: f64 = 1e-150;

/// Cells of the mesh on which [`improved_sheather_jones`] bins the sample, which resolve 1/512 of its range.
const CELLS: usize = 1024;

/// Highest derivative of the density whose norm starts the recursion of Botev et al.; they call it ℓ.
const STAGES: i32 = 7;

/// The rules.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum BandwidthRule {
    /// [`silverman`]: robust and quick; smooths the valley between two modes a little.
    #[default]
    Silverman,
    /// [`scott`]: wider, meant for one bell; what scipy's `gaussian_kde` does unasked.
    Scott,
    /// [`improved_sheather_jones`]: adapts to several modes; wants a hundred values or more.
    ImprovedSheatherJones,
}

impl BandwidthRule {
    /// Bandwidth of this rule for the sample, in the sample's unit; positive.
    pub fn bandwidth(self, sample: &[f64]) -> Result<f64, StatisticsError> {
        match self {
            BandwidthRule::Silverman => silverman(sample),
            BandwidthRule::Scott => scott(sample),
            BandwidthRule::ImprovedSheatherJones => improved_sheather_jones(sample),
        }
    }
}

/// `0.9 · min(sd, IQR / 1.34) · n^(−1/5)` (Silverman 1986, Eq. 3.31), with the sample standard deviation and
/// type-7 quartiles. When half of the values are equal and the IQR is 0, the standard deviation stands alone.
pub fn silverman(sample: &[f64]) -> Result<f64, StatisticsError> {
    let ordered = sorted(sample);
    if let Some(spike) = spike(&ordered)? {
        return Ok(spike);
    }
    let sd = sample_sd(&ordered)?;
    let iqr = quantile_of_sorted(&ordered, 0.75)? - quantile_of_sorted(&ordered, 0.25)?;
    let spread = if iqr > 0.0 { sd.min(iqr / 1.34) } else { sd };
    check_result(0.9 * spread * (ordered.len() as f64).powf(-0.2), "a bandwidth")
}

/// `sd · n^(−1/5)` with the sample standard deviation, as scipy's `gaussian_kde` has Scott's rule (without
/// the factor 1.06 of the normal reference).
pub fn scott(sample: &[f64]) -> Result<f64, StatisticsError> {
    let ordered = sorted(sample);
    if let Some(spike) = spike(&ordered)? {
        return Ok(spike);
    }
    check_result(sample_sd(&ordered)? * (ordered.len() as f64).powf(-0.2), "a bandwidth")
}

/// Improved Sheather–Jones plug-in bandwidth (Botev, Grotowski and Kroese 2010, Algorithm 1): the fixed
/// point of `t = ξ γ^[ℓ](t)` with `ℓ = 7`, which assumes no normal reference anywhere.
///
/// The sample is binned linearly on 1024 cells over twice its range, so the cosine series sees no edge. Where
/// the equation has no root (few or heavily tied values), the answer is that of [`silverman`]. Costs about
/// `2 · min(2n, 1024) · 1024` operations for the transform, and a few milliseconds for the root.
pub fn improved_sheather_jones(sample: &[f64]) -> Result<f64, StatisticsError> {
    let ordered = sorted(sample);
    if let Some(spike) = spike(&ordered)? {
        return Ok(spike);
    }
    let range = check_result(2.0 * (ordered[ordered.len() - 1] - ordered[0]), "the range of a sample")? / 2.0;
    let mass = linear_bins(&ordered, ordered[0] - 0.5 * range, 2.0 * range);
    let coefficients = squared_cosine_coefficients(&mass);
    let distinct = 1 + ordered.windows(2).filter(|pair| pair[0] != pair[1]).count();
    match fixed_point(distinct as f64, &coefficients) {
        Some(t) => Ok(t.sqrt() * 2.0 * range),
        None => silverman(&ordered),
    }
}

/// The bandwidth of a sample without spread, `None` for one that has some. Expects ascending order.
fn spike(ordered: &[f64]) -> Result<Option<f64>, StatisticsError> {
    check_sample(ordered, 1)?;
    let (low, high) = (ordered[0], ordered[ordered.len() - 1]);
    let magnitude = low.abs().max(high.abs());
    Ok((high - low <= (NO_SPREAD * magnitude).max(SMALLEST_RANGE)).then(|| SPIKE * magnitude.max(1e-3)))
}

/// Shares of the sample on [`CELLS`] equal cells of `[start, start + width]`; each value is split between the
/// two nearest cell centres in proportion to its nearness. All values must be a cell or more inside.
fn linear_bins(sample: &[f64], start: f64, width: f64) -> Vec<f64> {
    let mut mass = vec![0.0; CELLS];
    let share = 1.0 / sample.len() as f64;
    for value in sample {
        let position = (value - start) / width * CELLS as f64 - 0.5;
        let left = (position.max(0.0) as usize).min(CELLS - 2);
        let toward_right = position - left as f64;
        mass[left] += share * (1.0 - toward_right);
        mass[left + 1] += share * toward_right;
    }
    mass
}

/// `(2 Σ_j mass_j cos(π k (j + ½) / m))²` for `k = 1 .. m − 1`: the squared coefficients of the cosine series
/// of a density on `[0, 1]` (DCT-II in scipy's scaling), evaluated directly over the cells that hold mass.
fn squared_cosine_coefficients(mass: &[f64]) -> Vec<f64> {
    let m = mass.len();
    let cosines: Vec<f64> = (0..4 * m).map(|i| (PI * i as f64 / (2 * m) as f64).cos()).collect();
    let held: Vec<(usize, f64)> =
        mass.iter().copied().enumerate().filter(|&(_, share)| share != 0.0).collect();
    (1..m)
        .map(|k| {
            let term = |&(j, share): &(usize, f64)| share * cosines[k * (2 * j + 1) % (4 * m)];
            let coefficient = 2.0 * held.iter().map(term).sum::<f64>();
            coefficient * coefficient
        })
        .collect()
}

/// The smallest bracketed root of `t − ξ γ^[ℓ](t)`, where `t` is the squared bandwidth on the unit interval.
fn fixed_point(distinct: f64, coefficients: &[f64]) -> Option<f64> {
    let excess = |t: f64| Some(t - plug_in_time(t, distinct, coefficients)?);
    // The first bracket follows the sample size, as in the authors' program, and doubles until the sign
    // changes.
    let mut high = 1e-11 + 0.01 * (distinct.clamp(50.0, 1050.0) - 50.0) / 1000.0;
    while excess(high).is_none_or(|excess| excess <= 0.0) {
        high *= 2.0;
        if high >= 1.0 {
            return None;
        }
    }
    let mut low = 0.0;
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match excess(middle)? > 0.0 {
            true => high = middle,
            false => low = middle,
        }
    }
    Some(high)
}

/// `ξ γ^[ℓ](t)`: the time that minimises the asymptotic error when the norm of derivative `ℓ` is estimated at
/// `t` and each lower one at the time that is best for it. `None` when a norm vanishes or overflows.
fn plug_in_time(t: f64, distinct: f64, coefficients: &[f64]) -> Option<f64> {
    let mut norm = derivative_norm(STAGES, t, coefficients)?;
    for s in (2..STAGES).rev() {
        // (1 + 2^−(s+½)) / 3 · (1·3···(2s − 1)) / √(2π), both from the Gaussian kernel's own derivatives.
        let odd_product: f64 = (1..=s).map(|i| f64::from(2 * i - 1)).product();
        let kernel = (1.0 + 0.5_f64.powf(f64::from(s) + 0.5)) / 3.0 * odd_product / (2.0 * PI).sqrt();
        let time = (2.0 * kernel / (distinct * norm)).powf(2.0 / (3.0 + 2.0 * f64::from(s)));
        norm = derivative_norm(s, time, coefficients)?;
    }
    let time = (2.0 * distinct * PI.sqrt() * norm).powf(-0.4);
    time.is_finite().then_some(time)
}

/// `‖f^(s)‖²` of the density smoothed for time `t`, by Parseval: `½ π^(2s) Σ k^(2s) a_k² exp(−k² π² t)`.
fn derivative_norm(s: i32, t: f64, coefficients: &[f64]) -> Option<f64> {
    let terms = coefficients.iter().zip(1..).map(|(squared, k)| {
        let frequency = PI * PI * f64::from(k * k);
        frequency.powi(s) * squared * (-frequency * t).exp()
    });
    let norm = 0.5 * terms.sum::<f64>();
    (norm > 0.0 && norm.is_finite()).then_some(norm)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::fixture::two_mode_sample;
    use super::*;
    use statrs::function::erf::erfc_inv;

    const RULES: [BandwidthRule; 3] =
        [BandwidthRule::Silverman, BandwidthRule::Scott, BandwidthRule::ImprovedSheatherJones];

    #[test]
    fn rules_match_scipy_and_kdepy() {
        let sample = two_mode_sample(300);
        assert!((silverman(&sample).unwrap() / 0.017160684183067453 - 1.0).abs() < 1e-12);
        assert!((scott(&sample).unwrap() / 0.029185732620155003 - 1.0).abs() < 1e-12);
        let isj = improved_sheather_jones(&sample).unwrap();
        // The same method on the same mesh in numpy, then KDEpy's mesh with its range corrected (see
        // goldens.py).
        assert!((isj / 0.02048082776502853 - 1.0).abs() < 1e-6, "{isj}");
        assert!((isj / 0.02046081759934994 - 1.0).abs() < 1e-2, "{isj}");
    }

    #[test]
    fn improved_sheather_jones_of_a_bell_is_near_its_known_optimum() {
        let bell: Vec<f64> =
            (0..500).map(|i| -2.0_f64.sqrt() * erfc_inv(2.0 * (f64::from(i) + 0.5) / 500.0)).collect();
        let isj = improved_sheather_jones(&bell).unwrap();
        assert!((isj / 0.34873356821376633 - 1.0).abs() < 1e-6, "{isj}");
        // The least asymptotic error for N(0, 1) is at (4 / 3n)^(1/5) = 0.306; a gridded bell looks smoother.
        assert!((0.27..0.37).contains(&isj));
    }

    #[test]
    fn rules_follow_shift_and_scale() {
        let sample = two_mode_sample(300);
        let moved: Vec<f64> = sample.iter().map(|value| 4096.0 * value + 512.0).collect();
        for rule in RULES {
            let ratio = rule.bandwidth(&moved).unwrap() / rule.bandwidth(&sample).unwrap();
            assert!((ratio / 4096.0 - 1.0).abs() < 1e-6, "{rule:?}: {ratio}");
        }
    }

    #[test]
    fn bandwidth_ignores_the_order_of_the_sample() {
        let sample = two_mode_sample(101);
        let backwards: Vec<f64> = sample.iter().rev().copied().collect();
        for rule in RULES {
            assert_eq!(rule.bandwidth(&sample), rule.bandwidth(&backwards));
        }
    }

    #[test]
    fn samples_without_spread_get_a_spike() {
        for rule in RULES {
            assert_eq!(rule.bandwidth(&[5.0; 40]), Ok(5e-3));
            assert_eq!(rule.bandwidth(&[-5.0]), Ok(5e-3));
            assert_eq!(rule.bandwidth(&[0.0, 0.0]), Ok(1e-6));
            assert_eq!(rule.bandwidth(&[1.0, 1.0 + f64::EPSILON]), Ok(SPIKE * (1.0 + f64::EPSILON)));
            assert!(matches!(rule.bandwidth(&[]), Err(StatisticsError::TooFew { .. })));
            assert!(matches!(rule.bandwidth(&[1.0, f64::NAN]), Err(StatisticsError::NotFinite { .. })));
            assert!(matches!(rule.bandwidth(&[f64::MAX, f64::MIN]), Err(StatisticsError::Overflow { .. })));
        }
    }

    #[test]
    fn difficult_samples_still_get_a_positive_bandwidth() {
        let mut tied = vec![1.0; 99];
        tied.push(2.0);
        // sd = 0.1, IQR = 0: 0.9 · 0.1 · 100^−0.2.
        assert!((silverman(&tied).unwrap() - 0.09 * 100_f64.powf(-0.2)).abs() < 1e-12);
        let grid: Vec<f64> = (0..60).map(|i| f64::from(i % 3)).collect();
        let outlier: Vec<f64> = two_mode_sample(50).into_iter().chain([1e9]).collect();
        for sample in [&tied[..], &grid, &outlier, &[0.0, 1.0], &[1e-300, 2e-300, 4e-300]] {
            for rule in RULES {
                let bandwidth = rule.bandwidth(sample).unwrap();
                assert!(bandwidth > 0.0 && bandwidth.is_finite(), "{rule:?} {bandwidth} of {sample:?}");
            }
        }
    }

    #[test]
    fn cosine_coefficients_match_scipy() {
        // scipy.fft.dct([0.1, 0.2, 0.3, 0.4])[1:] ** 2
        let want = [0.39798989873223345, 0.0, 0.002010101267766701];
        for (got, want) in squared_cosine_coefficients(&[0.1, 0.2, 0.3, 0.4]).iter().zip(want) {
            assert!((got - want).abs() < 1e-14, "got {got}, want {want}");
        }
    }
}
