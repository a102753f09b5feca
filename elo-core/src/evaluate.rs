//! Measuring a finished option set again: fresh contexts, any simulator of the same robot.

use serde::{Deserialize, Serialize};

use crate::crew::RunError;
use crate::discover::Run;
use crate::figures::{Comparison, Row};
use crate::metric::Reference;
use crate::option_set::OptionSet;
use crate::performer::{Performer, PerformerRole};
use crate::returns::Scale;
use crate::rollout::Rollout;
use crate::simulator::Engine;
use crate::units::evaluate::Behavior;

/// What was measured of a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evaluation {
    /// The metric that had selected it.
    pub metric: String,
    /// The robot.
    pub robot: String,
    /// The engine that it was measured in.
    pub engine: Engine,
    /// The root seed of the contexts.
    pub seed: u64,
    /// The root seed of the run that made the set. Where it is the same, the contexts are those of that run's report.
    pub made_with_seed: u64,
    /// How many contexts.
    pub contexts: usize,
    /// How returns are normalised.
    pub scale: Scale,
    /// `(μ*, σ*)`.
    pub reference: Reference,
    /// The infant agent with the set.
    pub set: Row,
    /// Each of its options, best first; options that were learned together as one row.
    pub options: Vec<Row>,
    /// Random torque and no torque in the same contexts.
    pub baselines: Vec<Row>,
    /// The set against each baseline.
    pub against: Vec<Comparison>,
}

/// Runs the set's options in the `report` contexts of `run`, whose seed should be another than that of the run which
/// made the set. The horizon, the normalisation and `(μ*, σ*)` are those stored with the set.
///
/// # Errors
/// See [`RunError`]; a set that does not fit the simulator has been refused before, by [`OptionSet::policies`].
pub fn evaluate(run: &Run<'_>, set: &OptionSet) -> Result<Evaluation, RunError> {
    let manifest = &set.manifest;
    let contexts = run.held_out_contexts(run.experiment.report.contexts)?;
    let plain =
        |name: &str, behavior| Performer { name: name.to_owned(), role: PerformerRole::Plain(behavior) };
    let baselines = [vec![
        plain("random torque", || Behavior::RandomTorque),
        plain("zero torque", || Behavior::ZeroTorque),
    ]];
    let (names, mut rollouts): (Vec<String>, Vec<_>) =
        run.measure_set("rollouts", set, &contexts)?.into_iter().unzip();
    rollouts.extend(run.evaluate("baselines", &baselines, &contexts, 0..contexts.keys.len())?);

    let yardstick = run.yardstick(manifest.scale, manifest.reference);
    let rows: Vec<&[Rollout]> = rollouts.iter().map(Vec::as_slice).collect();
    let (members, others) = rows.split_at(names.len());
    let sample = |name: &str, members: &[&[Rollout]]| yardstick.sample(name, members, &contexts.prices);
    let whole = sample(&manifest.metric, members);
    let baselines = [sample("random torque", &others[..1]), sample("zero torque", &others[1..])];
    let option = |(name, row): (&String, &&[Rollout])| yardstick.row(&sample(name, &[row]));
    Ok(Evaluation {
        metric: manifest.metric.clone(),
        robot: run.spec.robot.clone(),
        engine: run.experiment.simulator.engine(),
        seed: run.experiment.seed,
        made_with_seed: manifest.experiment["seed"].as_u64().unwrap_or_default(),
        contexts: contexts.count,
        scale: manifest.scale,
        reference: manifest.reference,
        set: yardstick.row(&whole)?,
        options: names.iter().zip(members).map(option).collect::<Result<_, _>>()?,
        baselines: baselines.iter().map(|b| yardstick.row(b)).collect::<Result<_, _>>()?,
        against: baselines.iter().map(|b| yardstick.compare(&whole, b)).collect::<Result<_, _>>()?,
    })
}
