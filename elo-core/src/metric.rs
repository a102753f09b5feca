//! Metrics `ψ` that score an option by its return distribution (§4.3); higher is better.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fault::Faults;
use crate::hosted::Hosted;

/// `(μ*, σ*)`: mean and standard deviation of the returns of the set that `ψ_μ` selects.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// `μ*`.
    pub mean: f64,
    /// `σ*`, at least 0.
    pub standard_deviation: f64,
}

/// A score of a return distribution. A metric is its own inert config: one `[[metrics]]` table, by its `kind`.
///
/// Given the reference, the paper's metrics are means of one number a rollout, so a metric states that number; one that
/// is no mean overrides [`Metric::score`] as well.
#[typetag::serde(tag = "kind")]
pub trait Metric: fmt::Debug + Send + Sync {
    /// A short name for tables, unique among a run's metrics, e.g. `negative_tail(k=0.75)`.
    fn label(&self) -> String;

    /// Finds every fault of the fields.
    fn validate(&self, faults: &mut Faults);

    /// The number whose mean is the score.
    fn rollout_score(&self, value: f64, reference: &Reference) -> f64;

    /// The score of a whole sample of returns, not empty.
    fn score(&self, returns: &[f64], reference: &Reference) -> f64 {
        let sum: f64 = returns.iter().map(|value| self.rollout_score(*value, reference)).sum();
        sum / returns.len() as f64
    }

    /// The scores of many samples of equal size, in order. This is what ranks options; a metric overrides it to see them
    /// all at once.
    ///
    /// # Errors
    /// Why there are no scores, for metrics whose code can fail.
    fn scores(&self, samples: &[Vec<f64>], reference: &Reference) -> Result<Vec<f64>, String> {
        Ok(samples.iter().map(|returns| self.score(returns, reference)).collect())
    }

    /// Where its code runs, if not in the caller's process.
    fn hosted(&self) -> Option<&dyn Hosted> {
        None
    }

    /// [`Self::hosted`], to be told what its worker says.
    fn hosted_mut(&mut self) -> Option<&mut dyn Hosted> {
        None
    }
}

/// `ψ_μ`, *Maximum-Mean*: the expected return (Eq. 4.5).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaximumMean {}

#[typetag::serde(name = "maximum_mean")]
impl Metric for MaximumMean {
    fn label(&self) -> String {
        "maximum_mean".to_owned()
    }

    fn validate(&self, _: &mut Faults) {}

    /// Eq. 4.5: `ψ_μ = E[V]`.
    fn rollout_score(&self, value: f64, _: &Reference) -> f64 {
        value
    }
}

/// `ψ_-`, *Negative Tail-Averse*: the expected return less a price on the probability of returns far below the reference
/// (Eq. 4.6).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NegativeTail {
    /// Price of the tail's whole probability, in units of (normalised) return; at least 0. The paper uses 0.05 for Ant
    /// and 0.75 for HalfCheetah and Walker2d (Table 5.1).
    pub k: f64,
    /// How many reference standard deviations below the reference mean the tail begins; at least 0. The paper does not
    /// give it.
    pub alpha: f64,
}

impl Default for NegativeTail {
    fn default() -> Self {
        Self { k: 0.75, alpha: 1.0 }
    }
}

#[typetag::serde(name = "negative_tail")]
impl Metric for NegativeTail {
    fn label(&self) -> String {
        format!("negative_tail(k={})", self.k)
    }

    fn validate(&self, faults: &mut Faults) {
        at_least_zero(faults, "k", self.k);
        at_least_zero(faults, "alpha", self.alpha);
    }

    /// Eq. 4.6: `ψ_- = E[V] − k · Pr(V < μ* − α σ*)`.
    fn rollout_score(&self, value: f64, reference: &Reference) -> f64 {
        let tail = value < reference.mean - self.alpha * reference.standard_deviation;
        value - self.k * f64::from(tail)
    }
}

/// `ψ_+`, *Positively-Skewed*: the expected return plus a premium on the probability of returns above the reference mean
/// (Eq. 4.7).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PositiveSkew {
    /// Premium for certainty of a return above the reference mean, in units of (normalised) return; at least 0. The
    /// paper uses 0.05 for Ant and HalfCheetah and 0.10 for Walker2d (Table 5.2).
    pub k: f64,
}

impl Default for PositiveSkew {
    fn default() -> Self {
        Self { k: 0.05 }
    }
}

#[typetag::serde(name = "positive_skew")]
impl Metric for PositiveSkew {
    fn label(&self) -> String {
        format!("positive_skew(k={})", self.k)
    }

    fn validate(&self, faults: &mut Faults) {
        at_least_zero(faults, "k", self.k);
    }

    /// Eq. 4.7: `ψ_+ = E[V] + k · Pr(V > μ*)`.
    fn rollout_score(&self, value: f64, reference: &Reference) -> f64 {
        value + self.k * f64::from(value > reference.mean)
    }
}

fn at_least_zero(faults: &mut Faults, field: &str, value: f64) {
    faults.check(value.is_finite() && value >= 0.0, field, || {
        format!("expected a number of at least 0, got {value}")
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_match_hand_worked_scores() {
        // Mean 0.5; with μ* = 0.5 and σ* = 0.25 the tail below 0.25 holds one return of four, two lie above 0.5.
        let returns = [0.0, 0.4, 0.7, 0.9];
        let reference = Reference { mean: 0.5, standard_deviation: 0.25 };
        assert!((MaximumMean {}.score(&returns, &reference) - 0.5).abs() < 1e-12);
        let risk = NegativeTail { k: 0.8, alpha: 1.0 };
        assert!((risk.score(&returns, &reference) - (0.5 - 0.8 * 0.25)).abs() < 1e-12);
        let seek = PositiveSkew { k: 0.1 };
        assert!((seek.score(&returns, &reference) - (0.5 + 0.1 * 0.5)).abs() < 1e-12);
    }

    #[test]
    fn the_tail_excludes_its_border() {
        let reference = Reference { mean: 1.0, standard_deviation: 1.0 };
        assert_eq!(NegativeTail { k: 1.0, alpha: 1.0 }.rollout_score(0.0, &reference), 0.0);
        assert_eq!(PositiveSkew { k: 1.0 }.rollout_score(1.0, &reference), 1.0);
    }
}
