//! Intervals for a share that was counted: `successes` of `trials` independent trials.
//!
//! Trials must be independent: one trial a context. Shares over (option, context) pairs are not, because the
//! options meet the same contexts; [`bootstrap`](super::bootstrap) over contexts is right for those.

use super::bootstrap::Interval;
use super::{StatisticsError, check_confidence};
use statrs::function::beta::beta_reg;
use statrs::function::erf::erf_inv;

/// Score interval of Wilson (1927): all shares that a two-sided normal test of level `1 − confidence` would
/// not reject.
///
/// The estimate is `successes / trials` and always lies inside. Keeps its coverage near shares of 0 and 1 on
/// average, where the interval of the mean collapses. [`clopper_pearson_lower`] and [`clopper_pearson_upper`]
/// never cover less than promised, and are wider.
///
/// # Errors
/// When there are no trials, more successes than trials, or the confidence is not strictly between 0 and 1.
pub fn wilson(successes: u64, trials: u64, confidence: f64) -> Result<Interval, StatisticsError> {
    check(successes, trials, confidence)?;
    let (n, share) = (trials as f64, successes as f64 / trials as f64);
    let z = std::f64::consts::SQRT_2 * erf_inv(confidence);
    let shrink = 1.0 + z * z / n;
    let centre = (share + z * z / (2.0 * n)) / shrink;
    let half = z / shrink * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt();
    // At the ends both bounds are exact; elsewhere the clamp only removes rounding.
    let low = if successes == 0 { 0.0 } else { (centre - half).max(0.0) };
    let high = if successes == trials { 1.0 } else { (centre + half).min(1.0) };
    Ok(Interval { estimate: share, low, high })
}

/// Exact one-sided upper bound of Clopper and Pearson (1934): the share `p` at which `successes` or fewer
/// happen with probability `1 − confidence`. The true share is below it with at least the given confidence.
///
/// A two-sided interval of confidence `c` takes both bounds at `(1 + c) / 2`. With 0 of `n`, the 95 % bound
/// is about `3 / n`. Agrees with scipy to 1e-9 for up to a million trials.
///
/// # Errors
/// As [`wilson`].
pub fn clopper_pearson_upper(successes: u64, trials: u64, confidence: f64) -> Result<f64, StatisticsError> {
    // By symmetry: at most p of successes is at least 1 − p of failures.
    check(successes, trials, confidence)?;
    let failures = trials - successes;
    if failures == 0 {
        return Ok(1.0);
    }
    Ok(beta_quantile(successes as f64 + 1.0, failures as f64, confidence))
}

/// Exact one-sided lower bound: the share at which `successes` or more happen with probability
/// `1 − confidence`. The counterpart of [`clopper_pearson_upper`].
///
/// # Errors
/// As [`wilson`].
pub fn clopper_pearson_lower(successes: u64, trials: u64, confidence: f64) -> Result<f64, StatisticsError> {
    check(successes, trials, confidence)?;
    if successes == 0 {
        return Ok(0.0);
    }
    Ok(beta_quantile(successes as f64, (trials - successes) as f64 + 1.0, 1.0 - confidence))
}

/// `x` with `I_x(a, b) = p`, by bisection to neighbouring floats; `a, b > 0` and `p ∈ (0, 1)`.
fn beta_quantile(a: f64, b: f64, p: f64) -> f64 {
    let (mut low, mut high) = (0.0_f64, 1.0_f64);
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if beta_reg(a, b, middle) < p {
            low = middle;
        } else {
            high = middle;
        }
    }
}

fn check(successes: u64, trials: u64, confidence: f64) -> Result<(), StatisticsError> {
    if trials == 0 {
        return Err(StatisticsError::TooFew { needed: 1, got: 0 });
    }
    if successes > trials {
        let value = successes as f64;
        return Err(StatisticsError::Parameter { name: "successes", expected: "at most the trials", value });
    }
    check_confidence(confidence)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// successes, trials, Wilson low, high (two-sided 95 %), Clopper–Pearson low, high (one-sided 95 %).
    const SCIPY: [(u64, u64, f64, f64, f64, f64); 7] = [
        (0, 300, 0.0, 0.012642971224546036, 0.0, 0.009936081944523167),
        (10, 300, 0.01820494733885481, 0.06026182580405482, 0.018193839077636973, 0.055884740515025046),
        (299, 300, 0.9813633063054688, 0.9994113422781488, 0.9842854451084136, 0.9998290369677474),
        (300, 300, 0.9873570287754541, 1.0, 0.9900639180554768, 1.0),
        (1, 1, 0.20654931437723745, 1.0, 0.050000000000000044, 1.0),
        (7, 20, 0.1811918241010821, 0.5671457233147637, 0.1773109175744692, 0.5580345113154888),
        (
            50_000,
            1_000_000,
            0.04957456172546827,
            0.05042889557418928,
            0.04964197535717931,
            0.05035995136217607,
        ),
    ];

    #[test]
    fn intervals_match_scipy() {
        for (successes, trials, low, high, exact_low, exact_high) in SCIPY {
            let interval = wilson(successes, trials, 0.95).unwrap();
            let lower = clopper_pearson_lower(successes, trials, 0.95).unwrap();
            let upper = clopper_pearson_upper(successes, trials, 0.95).unwrap();
            for (got, want) in
                [(interval.low, low), (interval.high, high), (lower, exact_low), (upper, exact_high)]
            {
                assert!((got - want).abs() < 1e-9, "{successes} of {trials}: got {got}, want {want}");
            }
            assert!(interval.contains(interval.estimate));
        }
    }

    #[test]
    fn upper_bound_of_no_success_has_its_closed_form() {
        // (1 − p)^n = 1 − confidence.
        for n in [1, 20, 300] {
            let want = 1.0 - 0.05_f64.powf(1.0 / n as f64);
            assert!((clopper_pearson_upper(0, n, 0.95).unwrap() - want).abs() < 1e-12);
        }
    }

    #[test]
    fn bounds_mirror_when_success_and_failure_swap() {
        for successes in 0..=12 {
            let lower = clopper_pearson_lower(successes, 12, 0.9).unwrap();
            let upper = clopper_pearson_upper(12 - successes, 12, 0.9).unwrap();
            assert!((lower - (1.0 - upper)).abs() < 1e-12);
        }
    }

    #[test]
    fn exact_upper_bound_covers_at_least_as_promised() {
        // Sum the binomial probabilities of all outcomes whose bound lies above the true share. The second share is that of
        // the lower mode in the model of the bootstrap's test.
        for (n, share) in [(25_u64, 0.13_f64), (300, 0.151_083)] {
            let mut probability = (1.0 - share).powi(i32::try_from(n).unwrap());
            let mut covered = 0.0;
            for successes in 0..=n {
                if clopper_pearson_upper(successes, n, 0.95).unwrap() >= share {
                    covered += probability;
                }
                probability *= (n - successes) as f64 / (successes + 1) as f64 * share / (1.0 - share);
            }
            assert!((0.95..0.99).contains(&covered), "{share} of {n}: covered {covered}");
        }
    }

    #[test]
    fn impossible_counts_are_errors() {
        assert!(wilson(0, 0, 0.95).is_err());
        assert!(wilson(2, 1, 0.95).is_err());
        assert!(clopper_pearson_upper(1, 2, 1.0).is_err());
        assert!(clopper_pearson_lower(1, 2, 0.0).is_err());
    }
}
