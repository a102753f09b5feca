//! A metric that is not a mean of one number a rollout: how bad the worst returns are.

use elo_core::fault::Faults;
use elo_core::metric::{Metric, Reference};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The mean of the worst returns, also called conditional value at risk or expected shortfall.
///
/// With `m = share · n` for `n` returns it is the mean of the `m` smallest, the last of them counted by the fraction that
/// `m` leaves (Rockafellar and Uryasev 2000).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WorstShare {
    /// Which share of the returns counts, above 0 and at most 1; 1 is the mean of all.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub share: f64,
}

impl Default for WorstShare {
    fn default() -> Self {
        Self { share: 0.1 }
    }
}

#[typetag::serde(name = "worst_share")]
impl Metric for WorstShare {
    fn label(&self) -> String {
        format!("worst_share({})", self.share)
    }

    fn validate(&self, faults: &mut Faults) {
        faults.check(self.share > 0.0 && self.share <= 1.0, "share", || {
            format!("expected more than 0 and at most 1, got {}", self.share)
        });
    }

    fn rollout_score(&self, value: f64, _: &Reference) -> f64 {
        value
    }

    fn score(&self, returns: &[f64], _: &Reference) -> f64 {
        let mut sorted = returns.to_vec();
        sorted.sort_by(f64::total_cmp);
        let mass = self.share * sorted.len() as f64;
        let counted = |(i, value): (usize, &f64)| value * (mass - i as f64).clamp(0.0, 1.0);
        sorted.iter().enumerate().map(counted).sum::<f64>() / mass
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elo_core::conformance::metric;

    const ANY: Reference = Reference { mean: 0.0, standard_deviation: 1.0 };

    #[test]
    fn the_worst_count_and_the_last_of_them_by_a_fraction() {
        let returns = [5.0, 1.0, 4.0, 2.0, 3.0];
        // 0.4 of five returns are the two smallest, 1 and 2; 0.5 of them are those and half of 3: (1 + 2 + 1.5) / 2.5.
        assert!((WorstShare { share: 0.4 }.score(&returns, &ANY) - 1.5).abs() < 1e-12);
        assert!((WorstShare { share: 0.5 }.score(&returns, &ANY) - 1.8).abs() < 1e-12);
        assert!((WorstShare { share: 1.0 }.score(&returns, &ANY) - 3.0).abs() < 1e-12);
        assert!((WorstShare { share: 0.1 }.score(&[7.0], &ANY) - 7.0).abs() < 1e-12);
    }

    #[test]
    fn a_share_of_nothing_is_a_fault() {
        for (share, count) in [(0.0, 1), (1.5, 1), (f64::NAN, 1), (0.1, 0)] {
            let mut faults = Faults::new();
            WorstShare { share }.validate(&mut faults);
            assert_eq!(faults.found().len(), count, "{share}");
        }
    }

    #[test]
    fn it_keeps_every_rule_of_metrics() {
        let report = metric::run(&WorstShare::default());
        assert!(report.failed().is_empty() && report.skipped().is_empty(), "{report}");
    }
}
