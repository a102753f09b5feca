//! A finished run under another range of tasks, without simulating: the stored sums of reward terms are priced anew.
//!
//! Exact for whoever does not see the task, which is everybody here. The teachers stay those of the run's own tasks.

use serde::{Deserialize, Serialize};

use crate::crew::RunError;
use crate::discover::{ContextSet, Discovery, Run, value};
use crate::figures::{Row, Yardstick};
use crate::metric::Reference;
use crate::report::HeldOut;
use crate::returns::{ReturnTable, Scale};
use crate::rollout::Rollout;
use crate::simulator::Engine;
use crate::spec::{Effect, SimulatorSpec};
use crate::task::TaskDistribution;

/// What a run's sets earn under other tasks, and what would be selected there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Repriced {
    /// The robot.
    pub robot: String,
    /// The engine.
    pub engine: Engine,
    /// The root seed.
    pub seed: u64,
    /// The new ranges, from which every context has a new task.
    pub tasks: TaskDistribution,
    /// Held-out contexts.
    pub contexts: usize,
    /// The normalisation under the new tasks.
    pub scale: Scale,
    /// `(μ*, σ*)` under the new tasks, in normalised returns.
    pub reference: Reference,
    /// One entry a metric.
    pub sets: Vec<RepricedSet>,
    /// What the sets are compared with.
    pub baselines: Vec<Row>,
}

/// One metric's set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RepricedSet {
    /// The metric's label.
    pub metric: String,
    /// Numbers of the run's own options.
    pub options: Vec<usize>,
    /// Their figures in the held-out contexts under the new tasks.
    pub row: Row,
    /// Numbers of the options that the metric would choose under the new tasks, best first.
    pub chosen: Vec<usize>,
    /// Their figures; `None` where one of them has no held-out rollouts, because the run did not choose it.
    pub chosen_row: Option<Row>,
}

/// Prices a run anew. No context is simulated, and the draws of tasks are those of a run with these ranges.
///
/// # Errors
/// Parameters that change the motion, a selector that did not measure every candidate in every context, or statistics
/// that are not defined.
pub fn reprice(
    run: &Run<'_>,
    discovery: &Discovery,
    held_out: &HeldOut,
    tasks: &TaskDistribution,
) -> Result<Repriced, RunError> {
    if let Some(why) = refusal(&run.spec, &run.experiment.tasks, tasks) {
        return Err(RunError::Config(why));
    }
    let select = run.repriced(&discovery.contexts, tasks);
    let report = run.repriced(&held_out.contexts, tasks);

    if discovery.rollouts.iter().any(|row| row.len() != select.count) {
        let why = "the run's selector did not measure every candidate in every context";
        return Err(RunError::Config(format!("{why}: prices of its rollouts do not rank them")));
    }
    let values = discovery.rollouts.iter().flat_map(|row| {
        row.iter().zip(&select.prices).map(|(rollout, prices)| value(rollout, prices)).collect::<Vec<_>>()
    });
    let table = ReturnTable::new(select.count, values.collect());
    let scoring = run.scoring(&discovery.candidates, &run.experiment.metrics, &run.experiment.returns);
    let selection = scoring.choose(&table)?;

    let yardstick = run.yardstick(selection.scale, selection.reference);
    let priced = Priced { yardstick, held_out, prices: &report.prices };
    let number = |id: &usize| discovery.candidates[*id].number;
    let sets = discovery.selection.choices.iter().zip(&selection.choices).map(|(own, new)| {
        Ok(RepricedSet {
            metric: own.metric.clone(),
            options: own.chosen.iter().map(number).collect(),
            row: priced.set(&own.metric, &own.chosen)?.ok_or_else(|| {
                RunError::Config("the run has no held-out rollouts of its own options".to_owned())
            })?,
            chosen: new.chosen.iter().map(number).collect(),
            chosen_row: priced.set(&new.metric, &new.chosen)?,
        })
    });
    Ok(Repriced {
        robot: run.spec.robot.clone(),
        engine: run.experiment.simulator.engine(),
        seed: run.experiment.seed,
        tasks: tasks.clone(),
        contexts: report.count,
        scale: selection.scale,
        reference: selection.reference,
        sets: sets.collect::<Result<_, RunError>>()?,
        baselines: held_out
            .baselines
            .iter()
            .map(|(name, rows)| priced.row(name, &rows.iter().map(Vec::as_slice).collect::<Vec<_>>()))
            .collect::<Result<_, _>>()?,
    })
}

/// Why rollouts under tasks of `own` cannot be priced for those of `other`, if they cannot: a parameter of one of them
/// changes the motion.
pub fn refusal(spec: &SimulatorSpec, own: &TaskDistribution, other: &TaskDistribution) -> Option<String> {
    let moves = |name: &&str| spec.task_parameter(name).is_some_and(|p| p.effect == Effect::Dynamics);
    let name = own.names().chain(other.names()).find(moves)?;
    Some(format!("`{name}` changes how the robot moves: run `elo discover` with the new ranges instead"))
}

impl Run<'_> {
    /// The same starts with new tasks, drawn as a run with these ranges would draw them.
    fn repriced(&self, contexts: &ContextSet, tasks: &TaskDistribution) -> ContextSet {
        let seed = contexts.split.seed(&self.seed);
        let task = |j: usize| tasks.draw(&mut seed.index(j as u64).child("task").stream());
        let tasks: Vec<_> = (0..contexts.count).map(task).collect();
        let prices = tasks.iter().map(|task| self.spec.prices(task)).collect();
        ContextSet { tasks, prices, ..contexts.clone() }
    }
}

/// Held-out rollouts under new prices.
struct Priced<'a> {
    yardstick: Yardstick<'a>,
    held_out: &'a HeldOut,
    prices: &'a [Vec<f64>],
}

impl Priced<'_> {
    fn row(&self, name: &str, members: &[&[Rollout]]) -> Result<Row, RunError> {
        Ok(self.yardstick.row(&self.yardstick.sample(name, members, self.prices))?)
    }

    fn set(&self, name: &str, ids: &[usize]) -> Result<Option<Row>, RunError> {
        let members: Option<Vec<&[Rollout]>> =
            ids.iter().map(|id| self.held_out.options.get(id).map(Vec::as_slice)).collect();
        members.map(|members| self.row(name, &members)).transpose()
    }
}
