//! Gaussian kernel density estimate: a smooth curve through a return sample.
//!
//! For plots, and for the smooth tail areas that the tables quote beside the counted ones. Selection never
//! uses it: it overstates rare bad tails and understates rare good ones, because it carries mass across the
//! threshold.

use super::bandwidth::BandwidthRule;
use super::summary::sorted;
use super::{StatisticsError, check_sample};
use statrs::function::erf::erfc;
use std::f64::consts::{PI, SQRT_2};

/// Bandwidths beyond a bound at which mirror images are left out; their density there is below 1e-21 of a
/// peak.
const REACH: f64 = 10.0;

/// Values that the quantity cannot pass, `None` where it is free. A return that ends with a fall, for
/// example, may have a hard lower bound.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bounds {
    /// Smallest possible value.
    pub lower: Option<f64>,
    /// Largest possible value.
    pub upper: Option<f64>,
}

/// The estimate `f(x) = 1/(n h) Σ_i φ((x − x_i) / h)`, reflected at hard bounds.
///
/// Mass that the kernels would put outside a bound is folded back inside (Silverman 1986, section 2.10), so
/// that the density integrates to 1 over the bounds and meets them with slope 0. With two bounds the folding
/// goes on between them. The answers depend on the values of the sample, not on their order. A query costs
/// `O(n)`.
#[derive(Debug, Clone)]
pub struct Density {
    /// The sample and its mirror images that are near enough to matter, in a fixed order.
    centres: Vec<f64>,
    size: f64,
    smallest: f64,
    largest: f64,
    bandwidth: f64,
    bounds: Bounds,
    /// `Σ Φ((lower − c) / h)` over the centres; 0 without a lower bound.
    below: f64,
}

impl Density {
    /// Estimate with the bandwidth that `rule` gives for this sample. A sample without spread becomes a
    /// narrow spike ([`SPIKE`](super::bandwidth::SPIKE)). Errors as [`Density::with_bandwidth`].
    pub fn new(sample: &[f64], rule: BandwidthRule, bounds: Bounds) -> Result<Self, StatisticsError> {
        Self::with_bandwidth(sample, rule.bandwidth(sample)?, bounds)
    }

    /// Estimate with a given bandwidth `h > 0`, the standard deviation of the kernel in the sample's unit.
    /// Between two bounds, a bandwidth beyond their distance is cut to it: the curve is flat to 1.5 % by
    /// then.
    ///
    /// # Errors
    /// - an empty sample, or values that are not finite;
    /// - a bandwidth that is not positive and finite, or so small that the peak overflows;
    /// - bounds that are not finite or not in ascending order; a value outside them.
    pub fn with_bandwidth(sample: &[f64], bandwidth: f64, bounds: Bounds) -> Result<Self, StatisticsError> {
        check_sample(sample, 1)?;
        if !(bandwidth > 0.0 && bandwidth.is_finite() && bandwidth.recip().is_finite()) {
            let expected = "positive, finite and not subnormal";
            return Err(StatisticsError::Parameter { name: "bandwidth", expected, value: bandwidth });
        }
        bounds.check(sample)?;
        let ordered = sorted(sample);
        let bandwidth = bounds.width().map_or(bandwidth, |width| bandwidth.min(width));
        let centres = bounds.images(&ordered, REACH * bandwidth);
        let below = bounds.lower.map_or(0.0, |lower| normal_cdf_sum(&centres, lower, bandwidth));
        Ok(Density {
            size: ordered.len() as f64,
            smallest: ordered[0],
            largest: ordered[ordered.len() - 1],
            centres,
            bandwidth,
            bounds,
            below,
        })
    }

    /// The bandwidth in use, in the sample's unit.
    pub fn bandwidth(&self) -> f64 {
        self.bandwidth
    }

    /// Density at `x`, in 1 / unit of the sample; 0 outside the bounds, NaN only for NaN.
    pub fn pdf(&self, x: f64) -> f64 {
        if x.is_infinite() || self.bounds.exclude(x) {
            return 0.0;
        }
        let kernel = |centre: &f64| (-0.5 * ((x - centre) / self.bandwidth).powi(2)).exp();
        let total: f64 = self.centres.iter().map(kernel).sum();
        total / self.size / (self.bandwidth * (2.0 * PI).sqrt())
    }

    /// Smooth `Pr(V ≤ x)`, from 0 to 1; NaN only for NaN.
    pub fn cdf(&self, x: f64) -> f64 {
        if x == f64::NEG_INFINITY || self.bounds.lower.is_some_and(|lower| x <= lower) {
            return 0.0;
        }
        if x == f64::INFINITY || self.bounds.upper.is_some_and(|upper| x >= upper) {
            return 1.0;
        }
        ((normal_cdf_sum(&self.centres, x, self.bandwidth) - self.below) / self.size).clamp(0.0, 1.0)
    }

    /// `points` equally spaced places to draw the curve at: from three bandwidths below the smallest value to
    /// three above the largest, within the bounds. One point is the middle; none is no point.
    pub fn grid(&self, points: usize) -> Vec<f64> {
        let reach = 3.0 * self.bandwidth;
        let start = (self.smallest - reach).max(self.bounds.lower.unwrap_or(f64::MIN));
        let end = (self.largest + reach).min(self.bounds.upper.unwrap_or(f64::MAX));
        if points == 1 {
            return vec![0.5 * start + 0.5 * end];
        }
        let at = |i: usize| i as f64 / (points - 1) as f64;
        (0..points).map(|i| start * (1.0 - at(i)) + end * at(i)).collect()
    }
}

impl Bounds {
    fn check(&self, sample: &[f64]) -> Result<(), StatisticsError> {
        for (name, bound) in [("lower bound", self.lower), ("upper bound", self.upper)] {
            if let Some(value) = bound.filter(|bound| !bound.is_finite()) {
                return Err(StatisticsError::Parameter { name, expected: "finite", value });
            }
        }
        if let Some(value) = self.width().filter(|width| !(*width > 0.0 && width.is_finite())) {
            let name = "distance from lower to upper bound";
            return Err(StatisticsError::Parameter { name, expected: "positive and finite", value });
        }
        match sample.iter().position(|&value| self.exclude(value)) {
            Some(index) => Err(StatisticsError::OutOfBounds { index, value: sample[index] }),
            None => Ok(()),
        }
    }

    fn exclude(&self, x: f64) -> bool {
        self.lower.is_some_and(|lower| x < lower) || self.upper.is_some_and(|upper| x > upper)
    }

    fn width(&self) -> Option<f64> {
        Some(self.upper? - self.lower?)
    }

    /// The sample with its mirror images up to `reach` outside the bounds.
    fn images(&self, ordered: &[f64], reach: f64) -> Vec<f64> {
        let mut centres = ordered.to_vec();
        match (self.lower, self.upper) {
            (None, None) => {}
            (Some(bound), None) | (None, Some(bound)) => {
                let mirrored = ordered.iter().map(|value| bound + (bound - value));
                centres.extend(mirrored.filter(|image| (image - bound).abs() <= reach));
            }
            (Some(lower), Some(upper)) => {
                let width = upper - lower;
                let copies = (reach / (2.0 * width)).ceil() as i32 + 1;
                let near = |image: &f64| *image >= lower - reach && *image <= upper + reach;
                for copy in -copies..=copies {
                    let shift = 2.0 * f64::from(copy) * width;
                    if copy != 0 {
                        centres.extend(ordered.iter().map(|value| value + shift).filter(near));
                    }
                    centres.extend(ordered.iter().map(|value| lower + (lower - value) + shift).filter(near));
                }
            }
        }
        centres
    }
}

/// `Σ Φ((x − c) / h)` over the centres.
fn normal_cdf_sum(centres: &[f64], x: f64, bandwidth: f64) -> f64 {
    centres.iter().map(|centre| 0.5 * erfc((centre - x) / bandwidth / SQRT_2)).sum()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::fixture::two_mode_sample;
    use super::*;

    const FREE: Bounds = Bounds { lower: None, upper: None };

    fn near(got: f64, want: f64) {
        assert!((got - want).abs() <= 1e-7 * want.abs().max(0.1), "got {got}, want {want}");
    }

    #[test]
    fn curve_matches_scipy() {
        let density = Density::new(&two_mode_sample(300), BandwidthRule::Silverman, FREE).unwrap();
        // x, gaussian_kde.evaluate, gaussian_kde.integrate_box_1d from −∞
        for (x, pdf, cdf) in [
            (0.0, 0.38708029, 0.0053620973617378555),
            (0.05, 1.41965373, 0.05415503882023544),
            (0.1, 0.48868796, 0.10283245584089311),
            (0.2, 1.2745166, 0.1326862149315049),
            (0.3, 6.31276597, 0.55332473012968),
            (0.45, 0.06403516, 0.9995235116245746),
        ] {
            near(density.pdf(x), pdf);
            near(density.cdf(x), cdf);
        }
    }

    #[test]
    fn reflected_curve_matches_the_sum_over_mirror_images() {
        let bounds = Bounds { lower: Some(0.02), upper: Some(0.4) };
        let mut sample = two_mode_sample(300);
        sample.retain(|value| (0.02..=0.4).contains(value));
        let density = Density::with_bandwidth(&sample, 0.05, bounds).unwrap();
        for (x, pdf, cdf) in [
            (0.02, 1.1808550701304603, 0.0),
            (0.1, 0.6973389735479588, 0.07938498638869379),
            (0.3, 5.187969737190896, 0.5627769749039173),
            (0.4, 3.517873886090915, 1.0),
        ] {
            near(density.pdf(x), pdf);
            near(density.cdf(x), cdf);
        }
    }

    #[test]
    fn density_integrates_to_its_cdf_under_all_bounds() {
        let mut sample = two_mode_sample(60);
        sample.retain(|value| (0.0..=0.5).contains(value));
        for (lower, upper) in [(None, None), (Some(0.0), None), (None, Some(0.5)), (Some(0.0), Some(0.5))] {
            for bandwidth in [0.01, 0.1, 7.0] {
                let density = Density::with_bandwidth(&sample, bandwidth, Bounds { lower, upper }).unwrap();
                let reach = 12.0 * bandwidth;
                let (start, end) = (lower.unwrap_or(0.0 - reach), upper.unwrap_or(0.5 + reach));
                let step = (end - start) / 2000.0;
                let mut area = 0.0;
                for i in 0..2000 {
                    // Simpson's rule over one step.
                    let x = start + step * f64::from(i);
                    let middle = density.pdf(x + 0.5 * step);
                    if i % 400 == 199 {
                        assert!(
                            (area - density.cdf(x)).abs() < 1e-9,
                            "{lower:?} {upper:?} {bandwidth} at {x}"
                        );
                    }
                    area += step / 6.0 * (density.pdf(x) + 4.0 * middle + density.pdf((x + step).min(end)));
                }
                assert!((area - 1.0).abs() < 1e-9, "{lower:?} {upper:?} {bandwidth}: {area}");
            }
        }
    }

    #[test]
    fn nothing_lies_outside_the_bounds() {
        let bounds = Bounds { lower: Some(0.0), upper: Some(1.0) };
        let density = Density::new(&[0.0, 0.2, 1.0], BandwidthRule::Scott, bounds).unwrap();
        assert_eq!([density.pdf(-1e-9), density.pdf(1.0 + 1e-9)], [0.0, 0.0]);
        assert_eq!(
            [density.cdf(-1.0), density.cdf(0.0), density.cdf(1.0), density.cdf(2.0)],
            [0.0, 0.0, 1.0, 1.0]
        );
        assert_eq!(density.grid(3), [0.0, 0.5, 1.0]);
        let wide = Density::with_bandwidth(&[0.3], 1e12, bounds).unwrap();
        assert_eq!(wide.bandwidth(), 1.0);
        assert!((wide.pdf(0.3) - 1.0).abs() < 0.015 && (wide.pdf(1.0) - 1.0).abs() < 0.015);
        // Slope 0 at the bounds: the curve is even around them.
        assert!((density.pdf(1e-6) - density.pdf(0.0)).abs() < 1e-9);
    }

    #[test]
    fn samples_without_spread_are_spikes_and_never_nan() {
        for sample in [&[0.3; 50][..], &[0.3], &[0.0], &[-7.0, -7.0]] {
            for rule in [BandwidthRule::Silverman, BandwidthRule::Scott, BandwidthRule::ImprovedSheatherJones]
            {
                let density = Density::new(sample, rule, FREE).unwrap();
                near(density.cdf(sample[0]), 0.5);
                assert!(density.pdf(sample[0]) > 10.0 && density.pdf(sample[0]).is_finite());
                assert_eq!([density.cdf(sample[0] - 0.3), density.cdf(sample[0] + 0.3)], [0.0, 1.0]);
                assert_eq!([density.pdf(f64::MAX), density.pdf(f64::INFINITY)], [0.0, 0.0]);
            }
        }
    }

    #[test]
    fn grid_spans_the_visible_curve() {
        let density = Density::with_bandwidth(&[1.0, 3.0], 0.5, FREE).unwrap();
        assert_eq!(density.grid(5), [-0.5, 0.75, 2.0, 3.25, 4.5]);
        assert_eq!(density.grid(1), [2.0]);
        assert!(density.grid(0).is_empty());
    }

    #[test]
    fn order_of_the_sample_does_not_matter() {
        let sample = two_mode_sample(77);
        let backwards: Vec<f64> = sample.iter().rev().copied().collect();
        let at = |sample: &[f64]| Density::new(sample, BandwidthRule::Scott, FREE).unwrap().pdf(0.21);
        assert_eq!(at(&sample), at(&backwards));
    }

    #[test]
    fn impossible_densities_are_errors() {
        let build = |sample: &[f64], bandwidth, lower, upper| {
            Density::with_bandwidth(sample, bandwidth, Bounds { lower, upper }).map(|_| ())
        };
        assert!(matches!(build(&[], 1.0, None, None), Err(StatisticsError::TooFew { .. })));
        for bandwidth in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-310] {
            assert!(matches!(build(&[1.0], bandwidth, None, None), Err(StatisticsError::Parameter { .. })));
        }
        let outside = build(&[1.0, 3.0], 1.0, Some(0.0), Some(2.0));
        assert_eq!(outside, Err(StatisticsError::OutOfBounds { index: 1, value: 3.0 }));
        assert!(matches!(build(&[1.0], 1.0, Some(1.0), Some(1.0)), Err(StatisticsError::Parameter { .. })));
        assert!(matches!(build(&[1.0], 1.0, Some(f64::NAN), None), Err(StatisticsError::Parameter { .. })));
    }
}
