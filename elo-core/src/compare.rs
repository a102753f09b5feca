//! The sets of two runs on common contexts: whose earns more, and by how much.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::crew::RunError;
use crate::discover::{ContextSet, Run};
use crate::figures::{Row, Sample};
use crate::metric::Reference;
use crate::option_set::OptionSet;
use crate::performer::Performer;
use crate::returns::Scale;
use crate::rollout::{Horizon, Rollout};
use crate::simulator::Engine;
use crate::statistics::StatisticsError;
use crate::statistics::bootstrap::{Interval, paired_difference};
use crate::units::learn;

/// What the comparison found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunComparison {
    /// The robot.
    pub robot: String,
    /// The engine, that of the first run.
    pub engine: Engine,
    /// The contexts: the held-out ones of the first run.
    pub contexts: usize,
    /// The root seed that they come from. Where the second run has the same, they are its held-out contexts too.
    pub seed: u64,
    /// Each pair of sets: those of the same metric; all of them where no metric is in both runs.
    pub pairs: Vec<SetPair>,
}

/// A set of each run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetPair {
    /// The normalisation of returns in both: the first set's own.
    pub scale: Scale,
    /// Its `(μ*, σ*)`.
    pub reference: Reference,
    /// The first run's, named by its metric.
    pub first: Row,
    /// The second run's.
    pub second: Row,
    /// Mean return of the second less that of the first, context by context.
    pub difference: Interval,
    /// Share of falls of the second less that of the first.
    pub falls: Interval,
}

/// Why returns by this horizon and those that the sets were selected by are not comparable, if they are not.
pub fn incomparable<'a>(horizon: &Horizon, sets: impl IntoIterator<Item = &'a OptionSet>) -> Option<String> {
    let other = sets.into_iter().find(|set| set.manifest.horizon != *horizon)?;
    Some(format!(
        "returns by {horizon} and by {} (of `[discover]`) are not comparable",
        other.manifest.horizon
    ))
}

/// Measures the sets of two runs in the held-out contexts of the first, whose run is `run`.
///
/// Costs (candidates of all sets) · contexts · T control steps.
///
/// # Errors
/// See [`RunError`]; also sets of another horizon.
pub fn compare(run: &Run<'_>, first: &[OptionSet], second: &[OptionSet]) -> Result<RunComparison, RunError> {
    let horizon = run.experiment.discover.horizon();
    if let Some(why) = incomparable(&horizon, first.iter().chain(second)) {
        return Err(RunError::Config(why));
    }
    let contexts = run.held_out_contexts(run.experiment.report.contexts)?;
    let (first, second) = (members(run, first, &contexts)?, members(run, second, &contexts)?);
    let same = |a: &Members<'_>, b: &Members<'_>| a.set.manifest.metric == b.set.manifest.metric;
    let meet = first.iter().any(|a| second.iter().any(|b| same(a, b)));
    let mut pairs = Vec::new();
    for a in &first {
        for b in second.iter().filter(|b| !meet || same(a, b)) {
            pairs.push(pair(run, (a, b), &contexts)?);
        }
    }
    Ok(RunComparison {
        robot: run.spec.robot.clone(),
        engine: run.experiment.simulator.engine(),
        contexts: contexts.count,
        seed: run.experiment.seed,
        pairs,
    })
}

/// A set with its candidates' rollouts.
struct Members<'a> {
    set: &'a OptionSet,
    rollouts: Vec<Vec<Rollout>>,
}

fn members<'a>(
    run: &Run<'_>,
    sets: &'a [OptionSet],
    contexts: &ContextSet,
) -> Result<Vec<Members<'a>>, RunError> {
    let of = |set: &'a OptionSet| {
        let measured = run.measure_set("rollouts", set, contexts)?;
        Ok(Members { set, rollouts: measured.into_iter().map(|(_, rollouts)| rollouts).collect() })
    };
    sets.iter().map(of).collect()
}

impl Run<'_> {
    /// The candidates of a stored set, best first, each by its name and with its rollouts in all of `contexts`: an option by
    /// itself, or the infant agent with options that were learned together.
    ///
    /// # Errors
    /// See [`RunError`].
    pub fn measure_set(
        &self,
        stage: &str,
        set: &OptionSet,
        contexts: &ContextSet,
    ) -> Result<Vec<(String, Vec<Rollout>)>, RunError> {
        let records: Vec<_> = set.options.iter().cloned().map(Some).collect();
        let key = self.crew.import(&learn::encode(&records))?;
        let alone = |(number, items): (usize, Range<usize>)| {
            Performer::alone(number, items.map(|item| (key, item)).collect())
        };
        let performers: Vec<Performer> = set.manifest.candidates().into_iter().map(alone).collect();
        let names: Vec<String> = performers.iter().map(|performer| performer.name.clone()).collect();
        let groups: Vec<Vec<Performer>> = performers.into_iter().map(|performer| vec![performer]).collect();
        let rollouts = self.evaluate(stage, &groups, contexts, 0..contexts.keys.len())?;
        Ok(names.into_iter().zip(rollouts).collect())
    }
}

fn pair(
    run: &Run<'_>,
    (a, b): (&Members<'_>, &Members<'_>),
    contexts: &ContextSet,
) -> Result<SetPair, StatisticsError> {
    let (scale, reference): (Scale, Reference) = (a.set.manifest.scale, a.set.manifest.reference);
    let plan = &run.experiment.report;
    let yardstick = run.yardstick(scale, reference);
    let sample = |members: &Members<'_>| {
        let rows: Vec<&[Rollout]> = members.rollouts.iter().map(Vec::as_slice).collect();
        yardstick.sample(&members.set.manifest.metric, &rows, &contexts.prices)
    };
    let (ours, theirs) = (sample(a), sample(b));
    let difference = |of: &dyn Fn(&Sample) -> Vec<f64>| {
        let stream = &mut yardstick.stream();
        paired_difference(&of(&theirs), &of(&ours), plan.bootstrap_draws, plan.confidence, stream)
    };
    Ok(SetPair {
        scale,
        reference,
        first: yardstick.row(&ours)?,
        second: yardstick.row(&theirs)?,
        difference: difference(&Sample::context_means)?,
        falls: difference(&|sample| sample.falls.clone())?,
    })
}
