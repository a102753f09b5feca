//! Tables of returns: one row a candidate, one column a context; what a failed rollout counts as; normalisation.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fault::Faults;
use crate::metric::Reference;

/// Returns of some candidates in some contexts. `None` where the rollout failed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReturnTable {
    contexts: usize,
    values: Vec<Option<f64>>,
}

impl ReturnTable {
    /// A table with `contexts` columns; `values` row by row.
    ///
    /// # Panics
    /// When the values do not fill whole rows: a mistake of the caller.
    pub fn new(contexts: usize, values: Vec<Option<f64>>) -> Self {
        assert!(contexts > 0 && values.len().is_multiple_of(contexts), "{} values", values.len());
        Self { contexts, values }
    }

    /// Number of rows.
    pub fn candidates(&self) -> usize {
        self.values.len() / self.contexts.max(1)
    }

    /// Number of columns.
    pub fn contexts(&self) -> usize {
        self.contexts
    }

    /// One candidate's returns.
    pub fn row(&self, candidate: usize) -> &[Option<f64>] {
        &self.values[candidate * self.contexts..(candidate + 1) * self.contexts]
    }

    /// All returns, row by row.
    pub fn values(&self) -> &[Option<f64>] {
        &self.values
    }
}

/// What a failed rollout counts as: `[failures]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FailureRule {
    /// What a rollout counts as when the simulator gave up on it.
    pub policy: FailurePolicy,
    /// The run stops when more than this share of all selection rollouts failed.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub max_share: f64,
}

impl Default for FailureRule {
    fn default() -> Self {
        Self { policy: FailurePolicy::WorstPossible, max_share: 0.2 }
    }
}

/// See [`FailureRule::policy`]. Failures are never dropped silently: that would favour fragile options.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FailurePolicy {
    /// The simulator's reward floor at every step of the horizon.
    WorstPossible,
    /// The candidate cannot be chosen.
    ExcludeOption,
    /// The run stops.
    Abort,
}

/// How returns are scaled before metrics see them: `[returns]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReturnScaling {
    /// What returns are divided by, so that the `k` of a metric is comparable with a probability. The paper's returns
    /// of 0.08 to 0.33 were normalised somehow; it gives no formula.
    pub normaliser: Normaliser,
    /// What the value of a *set* is when `(μ*, σ*)` are taken from it. The infant agent, which picks one option at random, earns the
    /// mixture; Eq. 4.2 to the letter is the average.
    pub set_value: SetValue,
}

impl Default for ReturnScaling {
    fn default() -> Self {
        Self { normaliser: Normaliser::MinMax, set_value: SetValue::Mixture }
    }
}

/// See [`ReturnScaling::normaliser`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Normaliser {
    /// Returns as they are.
    None,
    /// 0 is the worst and 1 the best selection return of all candidates, failures left out.
    MinMax,
    /// 1 is the teachers' mean return while they were recorded.
    Teacher,
}

/// See [`ReturnScaling::set_value`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SetValue {
    /// The return of an agent that picks one option at random: the mixture of the options' distributions.
    Mixture,
    /// The mean of the options' returns inside one context (Eq. 4.2 to the letter).
    Average,
}

/// An affine map of returns, fixed once and stored with the set: `(return - offset) / scale`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scale {
    /// What becomes 0.
    pub offset: f64,
    /// What becomes 1, less the offset; never 0.
    pub scale: f64,
}

impl Scale {
    /// The normaliser's map for these selection returns. Where it is not defined (no valid return, all equal, teachers
    /// at 0 or below) it only shifts, and the second value says why.
    pub fn fit(normaliser: Normaliser, table: &ReturnTable, teacher_mean: f64) -> (Self, Option<String>) {
        let identity = Self { offset: 0.0, scale: 1.0 };
        match normaliser {
            Normaliser::None => (identity, None),
            Normaliser::Teacher if teacher_mean > 0.0 => (Self { offset: 0.0, scale: teacher_mean }, None),
            Normaliser::Teacher => (
                identity,
                Some(format!("the teachers' mean return is {teacher_mean}: returns are not normalised")),
            ),
            Normaliser::MinMax => {
                let valid = || table.values.iter().flatten().copied();
                let (low, high) =
                    (valid().fold(f64::INFINITY, f64::min), valid().fold(f64::NEG_INFINITY, f64::max));
                if high > low {
                    (Self { offset: low, scale: high - low }, None)
                } else {
                    let offset = if low.is_finite() { low } else { 0.0 };
                    let why = "the candidates' valid returns are all equal: returns are shifted, not scaled";
                    (Self { offset, scale: 1.0 }, Some(why.to_owned()))
                }
            }
        }
    }

    /// The normalised return.
    pub fn apply(&self, value: f64) -> f64 {
        (value - self.offset) / self.scale
    }
}

/// `(μ*, σ*)` of the set whose members' normalised returns are `rows` (one row a member, the same contexts in each).
///
/// The standard deviation is that of the population (Eq. 4.2 and the lines after Eq. 4.5). Empty rows give 0 and 0.
pub fn reference(rows: &[Vec<f64>], set_value: SetValue) -> Reference {
    let sample: Vec<f64> = match set_value {
        SetValue::Mixture => rows.concat(),
        SetValue::Average => {
            let contexts = rows.first().map_or(0, Vec::len);
            let column_mean = |j: usize| rows.iter().map(|row| row[j]).sum::<f64>() / rows.len() as f64;
            (0..contexts).map(column_mean).collect()
        }
    };
    if sample.is_empty() {
        return Reference { mean: 0.0, standard_deviation: 0.0 };
    }
    let count = sample.len() as f64;
    let mean = sample.iter().sum::<f64>() / count;
    let variance = sample.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    Reference { mean, standard_deviation: variance.sqrt() }
}

impl FailureRule {
    /// Checks the fields.
    pub fn validate(&self, faults: &mut Faults) {
        faults.check((0.0..=1.0).contains(&self.max_share), "max_share", || {
            format!("expected 0 to 1, got {}", self.max_share)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mixture_is_wider_than_the_average_of_opposed_options() {
        // Two options that take turns at 0 and 1: every context's average is 0.5, the mixture's deviation is 0.5.
        let rows = [vec![0.0, 1.0], vec![1.0, 0.0]];
        assert_eq!(reference(&rows, SetValue::Mixture), Reference { mean: 0.5, standard_deviation: 0.5 });
        assert_eq!(reference(&rows, SetValue::Average), Reference { mean: 0.5, standard_deviation: 0.0 });
    }

    #[test]
    fn min_max_leaves_failures_out_and_survives_equal_returns() {
        let table = ReturnTable::new(2, vec![Some(-2.0), None, Some(3.0), Some(0.0)]);
        let (scale, warning) = Scale::fit(Normaliser::MinMax, &table, 0.0);
        assert_eq!((scale.apply(-2.0), scale.apply(3.0), warning), (0.0, 1.0, None));
        let (scale, warning) = Scale::fit(Normaliser::MinMax, &ReturnTable::new(1, vec![Some(7.0); 3]), 0.0);
        assert_eq!(scale.apply(7.0), 0.0);
        assert!(warning.is_some());
    }
}
