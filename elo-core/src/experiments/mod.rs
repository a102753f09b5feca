//! The experiments of the paper's section 5.2 on a finished run, and what belongs beside them.
//!
//! Every figure is measured in the run's held-out contexts, in which nobody was selected, and carries an interval over
//! contexts. Whatever a run has measured already is not measured again.

pub mod curve;
mod files;
mod plan;
pub mod tails;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use files::write;
pub use plan::ExperimentsPlan;

use crate::crew::RunError;
use crate::discover::{Discovery, Run, discover, duplicate};
use crate::experiment::Experiment;
use crate::figures::{Row, Sample, Tail, Yardstick};
use crate::performer::{Performer, PerformerRole};
use crate::policy::OptionLearner;
use crate::report::{HeldOut, measure_options};
use crate::rollout::{Ending, Rollout};
use crate::select::{Choice, Selection};
use crate::simulator::Engine;
use crate::statistics::proportion::clopper_pearson_upper;
use crate::statistics::ranking::near_best;
use curve::{CurvePoint, Equivalent, LearningCurve};
use rand::RngExt as _;
use tails::{SweepPoint, TailTable};

/// The format number of [`Experiments`]; raised with every change that a reader must know of.
pub const EXPERIMENTS_FORMAT: u32 = 1;

/// What the experiments found, as `experiments.json` holds it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiments {
    /// [`EXPERIMENTS_FORMAT`].
    pub format: u32,
    /// The robot.
    pub robot: String,
    /// The engine.
    pub engine: Engine,
    /// The root seed.
    pub seed: u64,
    /// Held-out contexts behind every figure.
    pub contexts: usize,
    /// `T`: control steps of every rollout.
    pub steps: usize,
    /// Figures 5.2 and 5.3: everybody in the same contexts.
    pub agents: Vec<AgentReturns>,
    /// What a teacher for the default task earns on its way; empty for teachers that keep no policies.
    pub curve: Vec<CurvePoint>,
    /// How long a teacher must train to earn what the agents with options earn from the start.
    pub equivalents: Vec<Equivalent>,
    /// Tables 5.1 and 5.2, under both readings of a set's value.
    pub tails: Vec<TailTable>,
    /// What other values of `k` select.
    pub sweep: Vec<SweepPoint>,
    /// Figure 5.6, for each metric of the run.
    pub spreads: Vec<ScoreSpread>,
}

/// One agent's returns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentReturns {
    /// Its figures, under its name.
    pub row: Row,
    /// As the tasks pay them: context by context, in each one a member.
    pub returns: Vec<f64>,
    /// Rollouts in which the robot fell.
    pub falls: Bound,
    /// Rollouts with a return in the lower tail, `V < μ* − α σ*`.
    pub low_returns: Bound,
}

/// A count among independent rollouts, one in each context (a random member's), with an upper bound of its probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bound {
    /// How many.
    pub count: u64,
    /// Among how many.
    pub rollouts: u64,
    /// Clopper and Pearson's one-sided upper bound at the report's confidence.
    pub upper: f64,
}

/// The scores of all candidates by one metric (Figure 5.6), from the selecting contexts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScoreSpread {
    /// The metric's label.
    pub metric: String,
    /// Numbers of the candidates that can be chosen.
    pub candidates: Vec<usize>,
    /// The score of each.
    pub scores: Vec<f64>,
    /// Share of candidates whose score is within 10 % of the best one's, the best among them.
    pub near_best: f64,
}

/// Measures everything that the paper's figures and tables show of a finished run, and what [`ExperimentsPlan`] adds.
///
/// Costs one more teacher, and then about (2 · its snapshots + candidates newly chosen + other learners · candidates ·
/// (selecting contexts / held-out contexts)) rollouts in each held-out context.
///
/// # Errors
/// See [`RunError`].
pub fn experiments(
    run: &Run<'_>,
    discovery: &Discovery,
    held_out: &HeldOut,
) -> Result<Experiments, RunError> {
    let Selection { scale, reference, .. } = discovery.selection;
    let view = View { run, discovery, held_out, yardstick: run.yardstick(scale, reference) };

    // Figures 5.2 and 5.3: the infant agent with each set, and everybody that it is compared with.
    let mut agents = view.infants()?;
    agents.push(view.mixed()?);
    let others = &run.experiment.experiments.other_learners;
    for (learner, name) in others.iter().zip(names(others)) {
        agents.extend(view.of_learner(learner.as_ref(), &name)?);
    }
    let with_options: Vec<Sample> = agents.iter().map(|agent| agent.sample.clone()).collect();
    agents.extend(view.baselines());

    // How long PPO trains until its mean return is the infant agent's.
    let learning = curve::measure(&view)?;
    agents.extend(learning.as_ref().map(|curve| curve.nearest(run.experiment.experiments.trained_steps)));
    let equivalents = match &learning {
        Some(curve) => with_options
            .iter()
            .map(|agent| curve.equivalents(&view, agent))
            .collect::<Result<Vec<_>, _>>()?
            .concat(),
        None => Vec::new(),
    };

    Ok(Experiments {
        format: EXPERIMENTS_FORMAT,
        robot: run.spec.robot.clone(),
        engine: run.experiment.simulator.engine(),
        seed: run.experiment.seed,
        contexts: held_out.contexts.count,
        steps: run.experiment.discover.steps,
        agents: agents.iter().map(|agent| view.figures(agent)).collect::<Result<_, _>>()?,
        curve: learning.as_ref().map_or(Ok(Vec::new()), |curve| LearningCurve::points(curve, &view))?,
        equivalents,
        // Tables 5.1 and 5.2, and the sweep over k.
        tails: tails::tables(&view)?,
        sweep: tails::sweep(&view)?,
        // Figure 5.6.
        spreads: view.spreads(),
    })
}

/// A finished run, looked at in its held-out contexts.
pub(crate) struct View<'a> {
    pub run: &'a Run<'a>,
    pub discovery: &'a Discovery,
    pub held_out: &'a HeldOut,
    pub yardstick: Yardstick<'a>,
}

/// Somebody in the held-out contexts.
#[derive(Clone, Debug)]
pub(crate) struct Measured {
    pub sample: Sample,
    /// One row a member.
    rows: Vec<Vec<Rollout>>,
}

/// The kinds of some learners; with a number where there are several of a kind.
fn names(learners: &[Box<dyn OptionLearner>]) -> Vec<String> {
    let kind = |learner: &dyn OptionLearner| {
        let text = serde_json::to_value(learner).expect("a config is plain data");
        text["kind"].as_str().unwrap_or("learner").to_owned()
    };
    let kinds: Vec<String> = learners.iter().map(|learner| kind(learner.as_ref())).collect();
    let alike = |among: &[String], kind: &String| among.iter().filter(|other| *other == kind).count();
    let name = |(index, kind): (usize, &String)| match alike(&kinds, kind) {
        1 => kind.clone(),
        _ => format!("{kind} {}", alike(&kinds[..=index], kind)),
    };
    kinds.iter().enumerate().map(name).collect()
}

/// The rollouts of what a metric chose, best candidate first.
fn rows_of(choice: &Choice, rollouts: &BTreeMap<usize, Vec<Rollout>>) -> Vec<Vec<Rollout>> {
    choice.chosen.iter().map(|id| rollouts[id].clone()).collect()
}

impl View<'_> {
    pub fn measured(&self, name: &str, rows: Vec<Vec<Rollout>>) -> Measured {
        let members: Vec<&[Rollout]> = rows.iter().map(Vec::as_slice).collect();
        Measured { sample: self.yardstick.sample(name, &members, &self.held_out.contexts.prices), rows }
    }

    /// Runs somebody in the held-out contexts.
    pub fn run_in_contexts(&self, performers: Vec<Performer>) -> Result<Vec<Vec<Rollout>>, RunError> {
        let groups: Vec<Vec<Performer>> = performers.into_iter().map(|performer| vec![performer]).collect();
        let contexts = &self.held_out.contexts;
        self.run.evaluate("experiments", &groups, contexts, 0..contexts.keys.len())
    }

    fn infants(&self) -> Result<Vec<Measured>, RunError> {
        let choices = self.discovery.selection.choices.iter();
        Ok(choices
            .map(|choice| self.measured(&choice.metric, rows_of(choice, &self.held_out.options)))
            .collect())
    }

    /// The agent with the first metric's options and primitive actions.
    fn mixed(&self) -> Result<Measured, RunError> {
        let choice = &self.discovery.selection.choices[0];
        let primitive_probability = self.run.experiment.experiments.primitive_probability;
        let options = choice.chosen.iter().flat_map(|id| self.discovery.candidates[*id].options.clone());
        let name = format!("{} and primitive actions", choice.metric);
        let role = PerformerRole::Infant { options: options.collect(), primitive_probability };
        let rows = self.run_in_contexts(vec![Performer { name: name.clone(), role }])?;
        Ok(self.measured(&name, rows))
    }

    /// The sets of another learner, selected by the same metrics; of one that imitates, from the same recordings.
    fn of_learner(&self, learner: &dyn OptionLearner, name: &str) -> Result<Vec<Measured>, RunError> {
        let text = serde_json::to_value(learner).expect("a config is plain data");
        let option_learner = serde_json::from_value(text).expect("a config reads back what it wrote");
        let experiment = Experiment { option_learner, ..duplicate(self.run.experiment) };
        let discovery = discover(&experiment, self.run.crew)?;
        let run = Run::new(&experiment, self.run.crew)?;
        let contexts = &self.held_out.contexts;
        let rollouts = measure_options(&run, &discovery, contexts, &discovery.selection.chosen())?;
        let choices = discovery.selection.choices.iter();
        Ok(choices
            .map(|choice| self.measured(&format!("{name}: {}", choice.metric), rows_of(choice, &rollouts)))
            .collect())
    }

    fn baselines(&self) -> Vec<Measured> {
        self.held_out.baselines.iter().map(|(name, rows)| self.measured(name, rows.clone())).collect()
    }

    fn figures(&self, agent: &Measured) -> Result<AgentReturns, RunError> {
        let sample = &agent.sample;
        let threshold = self.yardstick.threshold(Tail::Lower);
        let mut stream = self.yardstick.seed.child("one member a context").stream();
        let members: Vec<usize> =
            sample.returns.iter().map(|values| stream.random_range(0..values.len())).collect();
        let drawn = || members.iter().enumerate().map(|(j, member)| (j, *member));
        let falls = drawn().filter(|(j, member)| agent.rows[*member][*j].ending == Ending::Terminated);
        let low =
            drawn().filter(|(j, member)| self.yardstick.scale.apply(sample.returns[*j][*member]) < threshold);
        let rollouts = members.len() as u64;
        let bound = |count: usize| {
            let count = count as u64;
            let upper = clopper_pearson_upper(count, rollouts, self.run.experiment.report.confidence)?;
            Ok::<_, RunError>(Bound { count, rollouts, upper })
        };
        Ok(AgentReturns {
            row: self.yardstick.row(sample)?,
            returns: sample.returns.concat(),
            falls: bound(falls.count())?,
            low_returns: bound(low.count())?,
        })
    }

    fn spreads(&self) -> Vec<ScoreSpread> {
        let choices = self.discovery.selection.choices.iter();
        choices
            .map(|choice| {
                let scored = choice.scores.iter().zip(&self.discovery.candidates);
                let (candidates, scores): (Vec<usize>, Vec<f64>) =
                    scored.filter_map(|(score, candidate)| Some((candidate.number, (*score)?))).unzip();
                let near_best = near_best(&scores, 0.1);
                ScoreSpread { metric: choice.metric.clone(), candidates, scores, near_best }
            })
            .collect()
    }
}
