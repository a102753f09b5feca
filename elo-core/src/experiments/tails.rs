//! Tables 5.1 and 5.2: what the metrics with a tail select, beside what the mean selects; and a sweep over their `k`.
//!
//! The baseline of both tables is `ψ_μ`: the means in the column that Table 5.1 heads `ψ_+` are those of `ψ_μ` in Table 5.2.

use serde::{Deserialize, Serialize};

use super::View;
use crate::crew::RunError;
use crate::discover::duplicate;
use crate::figures::{Sample, Tail, Yardstick};
use crate::measured::Pool;
use crate::metric::{MaximumMean, Metric, NegativeTail, PositiveSkew};
use crate::report::measure_options;
use crate::returns::{ReturnScaling, SetValue};
use crate::select::{Choice, Selection};
use crate::statistics::bandwidth::BandwidthRule;
use crate::statistics::bootstrap::{Interval, bootstrap};
use crate::statistics::density::{Bounds, Density};

/// A metric's set beside the set of `ψ_μ`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TailTable {
    /// The metric's label.
    pub metric: String,
    /// How the value of a set is read, when `(μ*, σ*)` are taken and here.
    pub set_value: SetValue,
    /// Which tail the metric looks at.
    pub tail: Tail,
    /// Where it begins, in normalised returns.
    pub threshold: f64,
    /// The set of `ψ_μ`.
    pub baseline: TailFigures,
    /// The metric's set.
    pub set: TailFigures,
    /// By how much the metric's set has less of the lower tail, or more of the upper one, as a share of what the baseline
    /// has. `None` where the baseline has none; a resample in which it has none counts as the estimate.
    pub improvement: Option<Interval>,
}

/// A set's mean and tail in held-out contexts, in normalised returns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TailFigures {
    /// Numbers of its options, best first.
    pub options: Vec<usize>,
    /// Mean.
    pub mean: Interval,
    /// The tail's probability, counted.
    pub area: Interval,
    /// The same area under a kernel density estimate, as the paper's tables quote it.
    pub smooth: f64,
}

/// What a metric selects with another `k`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepPoint {
    /// Which tail the metric looks at: the lower is that of `ψ_-`, the upper that of `ψ_+`.
    pub tail: Tail,
    /// Its `k`.
    pub k: f64,
    /// The set.
    pub set: TailFigures,
}

/// The tail that a metric of the paper looks at.
fn tail_of(metric: &dyn Metric) -> Option<Tail> {
    let text = serde_json::to_value(metric).expect("a config is plain data");
    match text["kind"].as_str()? {
        "negative_tail" => Some(Tail::Lower),
        "positive_skew" => Some(Tail::Upper),
        _ => None,
    }
}

/// Tables 5.1 and 5.2, first with the run's reading of a set's value, then with the other.
pub(crate) fn tables(view: &View<'_>) -> Result<Vec<TailTable>, RunError> {
    let own = view.run.experiment.returns.set_value;
    let other = match own {
        SetValue::Mixture => SetValue::Average,
        SetValue::Average => SetValue::Mixture,
    };
    let (mut metrics, tails): (Vec<Box<dyn Metric>>, Vec<Tail>) = view
        .run
        .experiment
        .metrics
        .iter()
        .filter_map(|metric| Some((duplicate(metric), tail_of(metric.as_ref())?)))
        .unzip();
    metrics.insert(0, Box::new(MaximumMean {}));
    let mut tables = Vec::new();
    for set_value in [own, other] {
        let sets = Sets::select(view, &metrics, set_value)?;
        for (index, tail) in tails.iter().enumerate() {
            tables.push(sets.table(index + 1, *tail)?);
        }
    }
    Ok(tables)
}

/// What every `k` of the plan selects, for both tails.
pub(crate) fn sweep(view: &View<'_>) -> Result<Vec<SweepPoint>, RunError> {
    let alpha = view.run.experiment.report.alpha;
    let ks = &view.run.experiment.experiments.sweep;
    let lower =
        ks.iter().map(|k| (Tail::Lower, *k, Box::new(NegativeTail { k: *k, alpha }) as Box<dyn Metric>));
    let upper = ks.iter().map(|k| (Tail::Upper, *k, Box::new(PositiveSkew { k: *k }) as Box<dyn Metric>));
    let (mut points, mut metrics) = (Vec::new(), Vec::new());
    for (tail, k, metric) in lower.chain(upper) {
        points.push((tail, k));
        metrics.push(metric);
    }
    if metrics.is_empty() {
        return Ok(Vec::new());
    }
    let sets = Sets::select(view, &metrics, view.run.experiment.returns.set_value)?;
    points
        .into_iter()
        .enumerate()
        .map(|(index, (tail, k))| Ok(SweepPoint { tail, k, set: sets.figures(index, tail)? }))
        .collect()
}

/// Sets that were selected by some metrics under one reading, in the held-out contexts.
struct Sets<'a> {
    view: &'a View<'a>,
    set_value: SetValue,
    selection: Selection,
    yardstick: Yardstick<'a>,
    samples: Vec<Sample>,
}

impl<'a> Sets<'a> {
    fn select(
        view: &'a View<'a>,
        metrics: &[Box<dyn Metric>],
        set_value: SetValue,
    ) -> Result<Self, RunError> {
        let (run, discovery) = (view.run, view.discovery);
        let scaling = ReturnScaling { set_value, ..run.experiment.returns.clone() };
        let pool = Pool { candidates: &discovery.candidates, contexts: &discovery.contexts };
        let (selection, _) = run.select(&pool, metrics, &scaling)?;
        let rollouts = measure_options(run, discovery, &view.held_out.contexts, &selection.chosen())?;
        let yardstick = run.yardstick(selection.scale, selection.reference);
        let sample = |choice: &Choice| {
            let members: Vec<_> = choice.chosen.iter().map(|id| rollouts[id].as_slice()).collect();
            let sample = yardstick.sample(&choice.metric, &members, &view.held_out.contexts.prices);
            match set_value {
                SetValue::Mixture => sample,
                SetValue::Average => sample.averaged(),
            }
        };
        let samples = selection.choices.iter().map(sample).collect();
        Ok(Self { view, set_value, yardstick, samples, selection })
    }

    fn figures(&self, index: usize, tail: Tail) -> Result<TailFigures, RunError> {
        let sample = &self.samples[index];
        let row = self.yardstick.row(sample)?;
        let returns = self.yardstick.normal(sample).concat();
        let density = Density::new(&returns, BandwidthRule::Silverman, Bounds::default())?;
        let below = density.cdf(self.yardstick.threshold(tail));
        let (area, smooth) = match tail {
            Tail::Lower => (row.lower_tail, below),
            Tail::Upper => (row.upper_tail, 1.0 - below),
        };
        let number = |id: &usize| self.view.discovery.candidates[*id].number;
        let options = self.selection.choices[index].chosen.iter().map(number).collect();
        Ok(TailFigures { options, mean: row.mean, area, smooth })
    }

    /// The set of metric `index` beside the first, which is that of `ψ_μ`.
    fn table(&self, index: usize, tail: Tail) -> Result<TailTable, RunError> {
        Ok(TailTable {
            metric: self.selection.choices[index].metric.clone(),
            set_value: self.set_value,
            tail,
            threshold: self.yardstick.threshold(tail),
            baseline: self.figures(0, tail)?,
            set: self.figures(index, tail)?,
            improvement: self.improvement(index, tail),
        })
    }

    fn improvement(&self, index: usize, tail: Tail) -> Option<Interval> {
        let shares = |index: usize| self.yardstick.tail_shares(&self.samples[index], tail);
        let (before, after) = (shares(0), shares(index));
        let sign = match tail {
            Tail::Lower => -1.0,
            Tail::Upper => 1.0,
        };
        let relative = |drawn: &[usize]| {
            let total = |shares: &[f64]| drawn.iter().map(|j| shares[*j]).sum::<f64>();
            let (before, after) = (total(&before), total(&after));
            (before > 0.0).then(|| sign * (after - before) / before + 0.0)
        };
        let all: Vec<usize> = (0..before.len()).collect();
        let estimate = relative(&all)?;
        let mut stream = self.yardstick.stream();
        let plan = self.yardstick.plan;
        let found = |drawn: &[usize]| relative(drawn).unwrap_or(estimate);
        bootstrap(before.len(), plan.bootstrap_draws, plan.confidence, &mut stream, found).ok()
    }
}
