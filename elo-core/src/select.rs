//! Algorithm 1(c): scoring candidates by every metric and choosing the `K` best of each, or the one best set where
//! candidates are sets.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::discover::duplicate;
use crate::fault::Faults;
use crate::judge::Judge;
use crate::metric::{MaximumMean, Metric, Reference};
use crate::returns::{FailurePolicy, FailureRule, ReturnScaling, ReturnTable, Scale, reference};
use crate::seed::Seed;
use crate::units::score::Score;

/// How candidates are measured and eliminated: `[selector]`, by its `kind`.
#[typetag::serde(tag = "kind")]
pub trait Selector: fmt::Debug + Send + Sync {
    /// Finds every fault of the fields.
    fn validate(&self, faults: &mut Faults);

    /// Rollouts that selecting among `candidates` with a budget of `contexts` each takes, for estimates.
    fn rollouts(&self, candidates: u64, contexts: u64) -> u64;

    /// Chooses a set for every metric.
    ///
    /// # Errors
    /// Whatever measuring fails with, or more failures than the rule allows.
    fn select(&self, bench: &mut dyn Bench, scoring: &Scoring<'_>) -> Result<Selection, SelectError>;
}

/// Where a selector gets returns from. Measuring the same thing twice costs nothing.
pub trait Bench {
    /// `N`.
    fn candidates(&self) -> usize;

    /// `Z`: contexts a candidate may be measured in.
    fn contexts(&self) -> usize;

    /// Returns of `candidates` in the selecting contexts `contexts`, one row a candidate in the given order.
    ///
    /// # Errors
    /// Whatever keeps the rollouts from being made.
    fn measure(&mut self, candidates: &[usize], contexts: Range<usize>) -> Result<ReturnTable, SelectError>;
}

/// Why no set could be selected.
#[derive(Debug, thiserror::Error)]
pub enum SelectError {
    /// Too many rollouts failed, or one did where none may.
    #[error(
        "{failed} of {rollouts} selection rollouts failed, more than `failures` allows; first: candidate {first}"
    )]
    Failures {
        /// Failed rollouts.
        failed: usize,
        /// All rollouts.
        rollouts: usize,
        /// The first candidate with one.
        first: usize,
    },
    /// Measuring stopped.
    #[error(transparent)]
    Measure(Box<dyn std::error::Error + Send + Sync>),
}

/// What selectors rank by.
#[derive(Clone, Copy)]
pub struct Scoring<'a> {
    /// Who asks the metrics.
    pub judge: &'a dyn Judge,
    /// How many candidates are chosen: `K` options, or one set that was learned as a whole.
    pub set_size: usize,
    /// The metrics, in the order of the config.
    pub metrics: &'a [Box<dyn Metric>],
    /// Normalisation and the value of a set.
    pub scaling: &'a ReturnScaling,
    /// What failed rollouts count as.
    pub failures: &'a FailureRule,
    /// The return that a failed rollout is given under `worst_possible`.
    pub return_floor: f64,
    /// The teachers' mean return while they were recorded, for that normaliser.
    pub teacher_mean: f64,
}

/// What was chosen, and by what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Selection {
    /// The normalisation of returns.
    pub scale: Scale,
    /// `(μ*, σ*)`, in normalised returns.
    pub reference: Reference,
    /// One choice a metric, in the order of the config.
    pub choices: Vec<Choice>,
    /// Share of failed rollouts of each candidate.
    pub failure_shares: Vec<f64>,
    /// What a reader should know: ties, fewer options than asked for, returns without variance.
    pub warnings: Vec<String>,
}

impl Selection {
    /// Every candidate that some metric chose.
    pub fn chosen(&self) -> BTreeSet<usize> {
        self.choices.iter().flat_map(|choice| choice.chosen.iter().copied()).collect()
    }
}

/// One metric's choice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    /// The metric's label.
    pub metric: String,
    /// Its score of each candidate; `None` for those that cannot be chosen.
    pub scores: Vec<Option<f64>>,
    /// `O*_ψ`: the candidates with the highest scores, best first; ties go to the lower number.
    pub chosen: Vec<usize>,
}

/// Every candidate in every context, as Algorithm 1(b) and (c) are printed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Uniform {}

#[typetag::serde(name = "uniform")]
impl Selector for Uniform {
    fn validate(&self, _: &mut Faults) {}

    fn rollouts(&self, candidates: u64, contexts: u64) -> u64 {
        candidates * contexts
    }

    fn select(&self, bench: &mut dyn Bench, scoring: &Scoring<'_>) -> Result<Selection, SelectError> {
        let all: Vec<usize> = (0..bench.candidates()).collect();
        let table = bench.measure(&all, 0..bench.contexts())?;
        scoring.choose(&table)
    }
}

impl Scoring<'_> {
    /// Scores a whole table and chooses the best of each metric: `ψ_μ` first, whose set gives `(μ*, σ*)`.
    ///
    /// # Errors
    /// [`SelectError::Failures`] by the failure rule.
    pub fn choose(&self, table: &ReturnTable) -> Result<Selection, SelectError> {
        let mut warnings = Vec::new();
        let failure_shares = self.failure_shares(table)?;
        let (scale, odd_scale) = Scale::fit(self.scaling.normaliser, table, self.teacher_mean);
        warnings.extend(odd_scale);

        let rows: Vec<Option<Vec<f64>>> = (0..table.candidates())
            .map(|candidate| self.filled(table.row(candidate)))
            .map(|row| row.map(|values| values.iter().map(|value| scale.apply(*value)).collect()))
            .collect();
        let known: Vec<Vec<f64>> = rows.iter().flatten().cloned().collect();
        let score = |metric, reference: Reference| -> Result<Vec<Option<f64>>, SelectError> {
            let score = Score { metric, reference, draws: 0, seed: Seed::root(0) };
            let scores = self.judge.scores(score, &known);
            let scores = scores.map_err(|error| SelectError::Measure(Box::new(error)))?;
            let mut scores = scores.into_iter().flatten();
            Ok(rows.iter().map(|row| row.as_ref().and_then(|_| scores.next())).collect())
        };

        let unused = Reference { mean: 0.0, standard_deviation: 0.0 };
        let best_mean = self.best(&score(Box::new(MaximumMean {}), unused)?);
        let members: Vec<Vec<f64>> = best_mean.iter().filter_map(|id| rows[*id].clone()).collect();
        let reference = reference(&members, self.scaling.set_value);

        let choices: Vec<Choice> = self
            .metrics
            .iter()
            .map(|metric| {
                let scores = score(duplicate(metric), reference)?;
                Ok(Choice { metric: metric.label(), chosen: self.best(&scores), scores })
            })
            .collect::<Result<_, SelectError>>()?;
        warnings.extend(choices.iter().flat_map(|choice| self.oddities(choice)));
        Ok(Selection { scale, reference, choices, failure_shares, warnings })
    }

    /// A candidate's returns with failures counted by the rule; `None` when it cannot be chosen.
    fn filled(&self, row: &[Option<f64>]) -> Option<Vec<f64>> {
        match self.failures.policy {
            FailurePolicy::WorstPossible => {
                Some(row.iter().map(|v| v.unwrap_or(self.return_floor)).collect())
            }
            FailurePolicy::ExcludeOption | FailurePolicy::Abort => row.iter().copied().collect(),
        }
    }

    fn failure_shares(&self, table: &ReturnTable) -> Result<Vec<f64>, SelectError> {
        let failed_in = |candidate: usize| table.row(candidate).iter().filter(|v| v.is_none()).count();
        let failed: Vec<usize> = (0..table.candidates()).map(failed_in).collect();
        let (total, rollouts) = (failed.iter().sum::<usize>(), table.values().len());
        let allowed = match self.failures.policy {
            FailurePolicy::Abort => 0.0,
            FailurePolicy::WorstPossible | FailurePolicy::ExcludeOption => self.failures.max_share,
        };
        match failed.iter().position(|count| *count > 0) {
            Some(first) if total as f64 > allowed * rollouts as f64 => {
                Err(SelectError::Failures { failed: total, rollouts, first })
            }
            _ => Ok(failed.iter().map(|count| *count as f64 / table.contexts() as f64).collect()),
        }
    }

    /// The candidates with the highest scores: score descending, then number ascending. Scores that are not a number
    /// cannot be chosen.
    fn best(&self, scores: &[Option<f64>]) -> Vec<usize> {
        let mut ranked: Vec<(f64, usize)> = scores
            .iter()
            .enumerate()
            .filter_map(|(id, s)| s.filter(|s| !s.is_nan()).map(|s| (s, id)))
            .collect();
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        ranked.into_iter().take(self.set_size).map(|(_, id)| id).collect()
    }

    fn oddities(&self, choice: &Choice) -> Vec<String> {
        let mut found = Vec::new();
        if choice.chosen.len() < self.set_size {
            let (got, asked) = (choice.chosen.len(), self.set_size);
            found.push(format!("{}: only {got} of {asked} options could be chosen", choice.metric));
        }
        let without = choice.scores.iter().flatten().filter(|score| score.is_nan()).count();
        if without > 0 {
            let (label, all) = (&choice.metric, choice.scores.len());
            found.push(format!("{label}: the scores of {without} of {all} candidates are no numbers"));
        }
        let score = |id: &usize| choice.scores[*id];
        if let Some(last) = choice.chosen.last() {
            let unchosen = (0..choice.scores.len()).filter(|id| !choice.chosen.contains(id));
            let ties = unchosen.filter(|id| score(id) == score(last)).count();
            if ties > 0 {
                let label = &choice.metric;
                found.push(format!("{label}: {ties} more candidates score the same as the last one chosen"));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::judge::Here;
    use crate::metric::NegativeTail;
    use crate::returns::Normaliser;

    /// A bench over a fixed table.
    struct Fixed(ReturnTable);

    impl Bench for Fixed {
        fn candidates(&self) -> usize {
            self.0.candidates()
        }
        fn contexts(&self) -> usize {
            self.0.contexts()
        }
        fn measure(&mut self, ids: &[usize], contexts: Range<usize>) -> Result<ReturnTable, SelectError> {
            let values = ids.iter().flat_map(|id| self.0.row(*id)[contexts.clone()].to_vec()).collect();
            Ok(ReturnTable::new(contexts.len(), values))
        }
    }

    /// The mean of returns of 2 and more; no number where there are none.
    #[derive(Debug, Serialize, Deserialize)]
    struct MeanOfTheGood {}

    #[typetag::serde(name = "test_mean_of_the_good")]
    impl Metric for MeanOfTheGood {
        fn label(&self) -> String {
            "mean_of_the_good".to_owned()
        }
        fn validate(&self, _: &mut Faults) {}
        fn rollout_score(&self, value: f64, _: &Reference) -> f64 {
            value
        }
        fn score(&self, returns: &[f64], _: &Reference) -> f64 {
            let good: Vec<f64> = returns.iter().copied().filter(|value| *value >= 2.0).collect();
            good.iter().sum::<f64>() / good.len() as f64
        }
    }

    fn select(
        rows: &[&[Option<f64>]],
        set_size: usize,
        failures: FailureRule,
    ) -> Result<Selection, SelectError> {
        select_by(Box::new(NegativeTail { k: 10.0, alpha: 0.5 }), rows, set_size, failures)
    }

    fn select_by(
        second: Box<dyn Metric>,
        rows: &[&[Option<f64>]],
        set_size: usize,
        failures: FailureRule,
    ) -> Result<Selection, SelectError> {
        let metrics: Vec<Box<dyn Metric>> = vec![Box::new(MaximumMean {}), second];
        let scaling = ReturnScaling { normaliser: Normaliser::None, ..ReturnScaling::default() };
        let scoring = Scoring {
            judge: &Here,
            set_size,
            metrics: &metrics,
            scaling: &scaling,
            failures: &failures,
            return_floor: -100.0,
            teacher_mean: 1.0,
        };
        Uniform {}.select(&mut Fixed(ReturnTable::new(rows[0].len(), rows.concat())), &scoring)
    }

    const STEADY: &[Option<f64>] = &[Some(4.0); 10];
    const RISKY: &[Option<f64>] = &[
        Some(5.0),
        Some(5.0),
        Some(5.0),
        Some(5.0),
        Some(5.0),
        Some(5.0),
        Some(5.0),
        Some(5.0),
        Some(5.0),
        Some(-3.0),
    ];
    const POOR: &[Option<f64>] = &[Some(1.0); 10];

    #[test]
    fn the_mean_prefers_the_risky_option_and_the_tail_averse_metric_the_steady_one() {
        let selection = select(&[POOR, STEADY, RISKY], 1, FailureRule::default()).unwrap();
        // RISKY: mean 4.2, σ = 2.4, so its tail below 3.0 has probability 0.1 and ψ_- = 4.2 - 10 * 0.1 = 3.2.
        assert!((selection.reference.mean - 4.2).abs() < 1e-12);
        assert!((selection.reference.standard_deviation - 2.4).abs() < 1e-12);
        assert_eq!(selection.choices[0].chosen, [2]);
        assert_eq!(selection.choices[1].chosen, [1]);
        assert!((selection.choices[1].scores[2].unwrap() - 3.2).abs() < 1e-12);
    }

    #[test]
    fn an_option_that_fails_in_a_tenth_of_contexts_is_not_chosen() {
        let fragile: Vec<Option<f64>> = (0..10).map(|j| (j > 0).then_some(9.0)).collect();
        let selection = select(&[&fragile, STEADY, POOR], 2, FailureRule::default()).unwrap();
        assert_eq!(selection.choices[0].chosen, [1, 2]);
        assert_eq!(selection.failure_shares, [0.1, 0.0, 0.0]);
        let exclude = FailureRule { policy: FailurePolicy::ExcludeOption, ..FailureRule::default() };
        assert_eq!(select(&[&fragile, STEADY, POOR], 2, exclude).unwrap().choices[0].scores[0], None);
        let abort = FailureRule { policy: FailurePolicy::Abort, ..FailureRule::default() };
        assert!(matches!(
            select(&[&fragile, STEADY, POOR], 2, abort),
            Err(SelectError::Failures { failed: 1, rollouts: 30, first: 0 })
        ));
        let strict = FailureRule { max_share: 0.03, ..FailureRule::default() };
        assert!(select(&[&fragile, STEADY, POOR], 2, strict).is_err());
    }

    #[test]
    fn scores_that_are_no_numbers_are_not_chosen_and_said() {
        let by_the_good =
            |rows, size| select_by(Box::new(MeanOfTheGood {}), rows, size, FailureRule::default());
        let selection = by_the_good(&[POOR, STEADY, RISKY], 1).unwrap();
        assert_eq!(selection.choices[1].chosen, [2]);
        let told = "mean_of_the_good: the scores of 1 of 3 candidates are no numbers";
        assert!(selection.warnings.iter().any(|warning| warning == told), "{:?}", selection.warnings);
        let few = by_the_good(&[POOR, STEADY], 2).unwrap();
        assert_eq!(few.choices[1].chosen, [1], "less than asked for, rather than one without a number");
    }

    #[test]
    fn equal_options_and_too_few_options_are_defined_and_said() {
        let selection = select(&[POOR, POOR, POOR], 2, FailureRule::default()).unwrap();
        assert_eq!(selection.choices[0].chosen, [0, 1]);
        assert!(selection.warnings.iter().any(|w| w.contains("1 more candidates score the same")));
        let few = select(&[POOR], 3, FailureRule::default()).unwrap();
        assert_eq!(few.choices[1].chosen, [0]);
        assert!(few.warnings.iter().any(|w| w.contains("only 1 of 3")));
    }
}
