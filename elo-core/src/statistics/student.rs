//! An interval for the mean of a few independent values, such as one figure of each pipeline seed.

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::bootstrap::Interval;
use super::summary::{mean, sample_sd};
use super::{StatisticsError, check_confidence};

/// Student's interval of the mean: `mean ± t · s / √n` with `n − 1` degrees of freedom.
///
/// Exact for normal values; a bootstrap over so few would be too short.
///
/// # Errors
/// Fewer than two values, values that are not finite, or a confidence outside (0, 1).
pub fn mean_interval(values: &[f64], confidence: f64) -> Result<Interval, StatisticsError> {
    check_confidence(confidence)?;
    let (estimate, deviation) = (mean(values)?, sample_sd(values)?);
    let degrees = values.len() as f64 - 1.0;
    let t = StudentsT::new(0.0, 1.0, degrees).expect("at least one degree of freedom");
    let half = t.inverse_cdf(0.5 + confidence / 2.0) * deviation / (values.len() as f64).sqrt();
    Ok(Interval { estimate, low: estimate - half, high: estimate + half })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn three_values_by_the_table() {
        // Mean 2, deviation 1; the two-sided 95 % quantile of t with 2 degrees of freedom is 4.302652729911275.
        let found = mean_interval(&[1.0, 2.0, 3.0], 0.95).unwrap();
        let half = 4.302_652_729_911_275 / 3.0_f64.sqrt();
        assert!((found.estimate - 2.0).abs() < 1e-12);
        assert!(
            (found.low - (2.0 - half)).abs() < 1e-6 && (found.high - (2.0 + half)).abs() < 1e-6,
            "{found:?}"
        );
        assert!(mean_interval(&[1.0], 0.95).is_err());
    }
}
