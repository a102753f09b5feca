//! Statistics of return samples: summaries, intervals, density curves and rankings.
//!
//! Every function is pure: it reads slices of `f64`, draws randomness only from the generator it is handed,
//! and adds in a fixed order, so equal inputs give equal bits. Undefined answers are errors, never NaN.
//!
//! | file | answers |
//! | --- | --- |
//! | `summary` | mean, spread, quantiles, interquartile mean, counted tail probabilities |
//! | `bootstrap` | how far a figure would move on other contexts |
//! | `proportion` | how far a counted share may be from the true one |
//! | `bandwidth`, `density` | smooth curves of a return distribution, for plots and tables only |
//! | `ranking` | the K best of scored candidates |
//! | `agreement` | how far two rankings agree, whether paired differences have a sign |
//! | `student` | an interval of the mean of a few independent values, such as pipeline seeds |
//!
//! The expected numbers in the tests come from numpy, scipy and KDEpy; `goldens.py` in this folder prints
//! them.

pub mod agreement;
pub mod bandwidth;
pub mod bootstrap;
pub mod density;
pub mod proportion;
pub mod ranking;
pub mod student;
pub mod summary;

/// Why a statistic has no value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StatisticsError {
    /// The sample is smaller than the statistic needs.
    #[error("expected a sample of at least {needed} values, got {got}")]
    TooFew {
        /// Fewest values for which the statistic is defined.
        needed: usize,
        /// Size of the sample.
        got: usize,
    },
    /// A value of the sample is NaN or infinite. Failed evaluations must be excluded or priced by the caller.
    #[error("expected finite values, got {value} at position {index} of the sample")]
    NotFinite {
        /// Position of the first such value.
        index: usize,
        /// That value.
        value: f64,
    },
    /// The values are finite but the result is not: they are too large to be added or squared.
    #[error("expected values small enough to compute {statistic}, got an overflow")]
    Overflow {
        /// What was being computed.
        statistic: &'static str,
    },
    /// A number that steers the statistic is outside its range.
    #[error("expected {name} to be {expected}, got {value}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its range in words.
        expected: &'static str,
        /// What was passed.
        value: f64,
    },
    /// Samples that should hold one value for each of the same contexts differ in length.
    #[error("expected one value for each of {expected} common contexts, got {got}")]
    Unpaired {
        /// Length of the first sample.
        expected: usize,
        /// Length of the sample that differs.
        got: usize,
    },
    /// A value lies outside the hard bounds that were declared for the sample.
    #[error(
        "expected values within the bounds of the density, got {value} at position {index} of the sample"
    )]
    OutOfBounds {
        /// Position of the first such value.
        index: usize,
        /// That value.
        value: f64,
    },
    /// The caller's statistic was NaN or infinite on a resample.
    #[error("expected a statistic that is finite on every resample, got {value} on draw {draw}")]
    Statistic {
        /// 0 for the sample itself, then the number of the resample.
        draw: usize,
        /// What the statistic returned.
        value: f64,
    },
}

/// Passes samples of at least `needed` finite values.
fn check_sample(sample: &[f64], needed: usize) -> Result<(), StatisticsError> {
    if sample.len() < needed {
        return Err(StatisticsError::TooFew { needed, got: sample.len() });
    }
    match sample.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(StatisticsError::NotFinite { index, value: sample[index] }),
        None => Ok(()),
    }
}

/// Passes finite results.
fn check_result(value: f64, statistic: &'static str) -> Result<f64, StatisticsError> {
    if value.is_finite() { Ok(value) } else { Err(StatisticsError::Overflow { statistic }) }
}

/// Passes confidences strictly between 0 and 1.
fn check_confidence(confidence: f64) -> Result<(), StatisticsError> {
    if confidence > 0.0 && confidence < 1.0 {
        return Ok(());
    }
    Err(StatisticsError::Parameter {
        name: "confidence",
        expected: "strictly between 0 and 1",
        value: confidence,
    })
}

#[cfg(test)]
pub(crate) mod fixture {
    /// A sample with a good mode near 0.30 (85 %) and a bad one near 0.05, the same as in `goldens.py`.
    pub(crate) fn two_mode_sample(n: usize) -> Vec<f64> {
        let mut state: u64 = 1;
        let mut uniform = move || {
            state = (1_103_515_245 * state + 12_345) % (1 << 31);
            state as f64 / f64::from(1_u32 << 31)
        };
        (0..n)
            .map(|_| {
                let good = uniform() < 0.85;
                let bell = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
                if good { 0.30 + 0.05 * bell } else { 0.05 + 0.03 * bell }
            })
            .collect()
    }

    #[test]
    fn fixture_is_the_sample_of_the_goldens() {
        let sample = two_mode_sample(300);
        assert!((sample[0] - 0.22186091).abs() < 1e-8);
        assert!((sample.iter().sum::<f64>() - 81.6341655229032).abs() < 1e-11);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_say_what_was_expected_and_what_came() {
        let few = check_sample(&[], 1).expect_err("an empty sample");
        assert_eq!(few.to_string(), "expected a sample of at least 1 values, got 0");
        let nan = check_sample(&[1.0, f64::NAN], 1).expect_err("a NaN");
        assert_eq!(nan.to_string(), "expected finite values, got NaN at position 1 of the sample");
        let sure = check_confidence(1.0).expect_err("certainty");
        assert_eq!(sure.to_string(), "expected confidence to be strictly between 0 and 1, got 1");
        assert!(check_confidence(f64::NAN).is_err());
    }
}
