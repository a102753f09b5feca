//! What a run reports: the chosen sets and what they are compared with, on held-out contexts that chose nothing.
//!
//! The sampling unit of every interval is the context: options that meet the same contexts are not independent.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::crew::RunError;
use crate::discover::{Candidate, ContextSet, Discovery, Origin, Run, Teacher, duplicate};
use crate::experiment::TeacherActs;
use crate::figures::{Comparison, Row, Sample, Yardstick};
use crate::metric::Reference;
use crate::parts::OptionPart;
use crate::performer::{Performer, PerformerRole};
use crate::policy::Way;
use crate::returns::Scale;
use crate::rollout::Rollout;
use crate::select::Selection;
use crate::simulator::Engine;
use crate::statistics::bootstrap::Interval;
use crate::statistics::summary::mean;
use crate::task::Task;
use crate::units::evaluate::Behavior;
use rand::RngExt as _;

/// The format number of [`Report`]; raised with every change that a reader must know of.
pub const REPORT_FORMAT: u32 = 1;

/// Everything that a run found out, as `report.json` holds it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// [`REPORT_FORMAT`].
    pub format: u32,
    /// The robot.
    pub robot: String,
    /// The engine.
    pub engine: Engine,
    /// The root seed.
    pub seed: u64,
    /// `W` and its teachers.
    pub teachers: Vec<TeacherReport>,
    /// Candidates with an option, and recordings given up.
    pub candidates: CandidateCounts,
    /// Mean random steps and redraws of the held-out starts.
    pub starts: StartReport,
    /// The normalisation of returns: `(return - offset) / scale`.
    pub scale: Scale,
    /// `(μ*, σ*)`, in normalised returns, from the selecting contexts.
    pub reference: Reference,
    /// One selected set a metric.
    pub sets: Vec<SetReport>,
    /// What the sets are compared with, in the same contexts.
    pub baselines: Vec<Row>,
    /// What a reader should know.
    pub warnings: Vec<String>,
}

/// One teacher.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeacherReport {
    /// Its task.
    pub task: Task,
    /// Whether it was recorded; given up otherwise.
    pub usable: bool,
    /// Mean return of its last training episodes, in its own task.
    pub training_return: Option<f64>,
    /// Attempts that were given up, and why.
    pub diverged: Vec<String>,
}

/// How many candidates there are: options, or sets that were learned as a whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateCounts {
    /// With an option.
    pub usable: usize,
    /// Numbers of those whose every recording fell, or whose every training diverged.
    pub given_up: Vec<usize>,
    /// Recordings that fell and were taken again.
    pub retakes: u64,
    /// The teachers' mean return while candidates were recorded; `None` where candidates are sets learned by practice.
    pub teacher_return: Option<f64>,
}

/// How the held-out starts came about.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartReport {
    /// How many.
    pub contexts: usize,
    /// Random control steps before a start, on average.
    pub mean_random_steps: f64,
    /// Falls of the random policy before a start was reached, on average.
    pub mean_redraws: f64,
}

/// One metric's set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetReport {
    /// The metric's label.
    pub metric: String,
    /// The candidates that make the set, best first: its options, or the one set that was learned as a whole.
    pub options: Vec<OptionReport>,
    /// `ψ` of the set (Eq. 4.4) by the returns that selected it; optimistic, because they did.
    pub selection_score: f64,
    /// `ψ` of the set in the held-out contexts.
    pub score: Interval,
    /// The infant agent with this set.
    pub row: Row,
    /// The set against each baseline, context by context.
    pub against: Vec<Comparison>,
    /// What each option does in a set that was learned as a whole; empty for other sets, which draw options alike.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<OptionPart>,
}

impl SetReport {
    /// The one candidate of a set that was learned by practice; it has the same figures as the set.
    pub fn learned_as_a_whole(&self) -> Option<&OptionReport> {
        self.options.first().filter(|candidate| candidate.teacher.is_none())
    }
}

/// One chosen candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OptionReport {
    /// Its number among the candidates.
    pub number: usize,
    /// Its teacher; `None` for sets learned by practice.
    pub teacher: Option<usize>,
    /// Its score by the returns that selected it.
    pub selection_score: f64,
    /// Its own figures in the held-out contexts.
    pub row: Row,
}

/// Measures the chosen sets and the baselines on held-out contexts.
///
/// # Errors
/// See [`RunError`].
pub fn report(run: &Run<'_>, discovery: &Discovery) -> Result<HeldOut, RunError> {
    let contexts = run.held_out_contexts(run.experiment.report.contexts)?;

    let subsets = random_subsets(run, discovery.candidates.len());
    let mut wanted: BTreeSet<usize> = discovery.selection.chosen();
    wanted.extend(subsets.iter().flatten());
    let options = measure_options(run, discovery, &contexts, &wanted)?;
    let (names, rollouts) = measure_baselines(run, discovery, &contexts)?;

    let Selection { scale, reference, .. } = discovery.selection;
    let yardstick = run.yardstick(scale, reference);
    let view = View { run, discovery, contexts: &contexts, yardstick };
    let subset_rows: Vec<&[Rollout]> = subsets.iter().flatten().map(|id| options[id].as_slice()).collect();
    let sample = |name: &str, rows: &[&[Rollout]]| view.yardstick.sample(name, rows, &contexts.prices);
    // There are none where candidates are whole sets.
    let subsets = (!subset_rows.is_empty()).then(|| sample("random K-subsets", &subset_rows));
    let others = names
        .iter()
        .zip(&rollouts)
        .map(|(name, rows)| sample(name, &rows.iter().map(Vec::as_slice).collect::<Vec<_>>()));
    let baselines: Vec<Sample> = subsets.into_iter().chain(others).collect();
    let sets = (0..discovery.selection.choices.len())
        .map(|index| view.set(index, &options, &baselines))
        .collect::<Result<Vec<_>, _>>()?;
    let rows = baselines.iter().map(|sample| view.yardstick.row(sample)).collect::<Result<_, _>>()?;
    let report = view.report(sets, rows);
    Ok(HeldOut { report, contexts, options, baselines: names.into_iter().zip(rollouts).collect() })
}

/// The report, and the rollouts that it was made of.
#[derive(Debug)]
pub struct HeldOut {
    /// The figures.
    pub report: Report,
    /// The held-out contexts.
    pub contexts: ContextSet,
    /// Rollouts of candidates, by their position in [`Discovery::candidates`].
    pub options: BTreeMap<usize, Vec<Rollout>>,
    /// Rollouts of the baselines; several rows where there are several of a kind.
    pub baselines: Vec<(String, Vec<Vec<Rollout>>)>,
}

/// Random `K`-subsets of the candidates, each drawn without replacement; none of candidates that are whole sets.
fn random_subsets(run: &Run<'_>, candidates: usize) -> Vec<Vec<usize>> {
    let seed = run.seed.child("random subsets");
    let count = match run.experiment.option_learner.way() {
        Way::Imitates(_) | Way::Apprentices(_) => run.experiment.report.random_subsets,
        Way::Practises(_) => 0,
    };
    (0..count)
        .map(|index| {
            let mut stream = seed.index(index as u64).stream();
            let mut ids: Vec<usize> = (0..candidates).collect();
            let size = run.experiment.discover.set_size.min(candidates);
            for place in 0..size {
                ids.swap(place, stream.random_range(place..candidates));
            }
            ids.truncate(size);
            ids
        })
        .collect()
}

/// The held-out rollouts of candidates, by their positions.
pub(crate) fn measure_options(
    run: &Run<'_>,
    discovery: &Discovery,
    contexts: &ContextSet,
    ids: &BTreeSet<usize>,
) -> Result<BTreeMap<usize, Vec<Rollout>>, RunError> {
    let group = |id: &usize| vec![Performer::candidate(&discovery.candidates[*id])];
    let groups: Vec<Vec<Performer>> = ids.iter().map(group).collect();
    let rollouts = run.evaluate("report rollouts", &groups, contexts, 0..contexts.keys.len())?;
    Ok(ids.iter().copied().zip(rollouts).collect())
}

type Baselines = (Vec<String>, Vec<Vec<Vec<Rollout>>>);

fn measure_baselines(
    run: &Run<'_>,
    discovery: &Discovery,
    contexts: &ContextSet,
) -> Result<Baselines, RunError> {
    let one = |name: &str, role| vec![Performer { name: name.to_owned(), role }];
    let seed = run.seed.child("untrained");
    let mut groups = vec![
        ("random torque", one("random torque", PerformerRole::Plain(|| Behavior::RandomTorque))),
        ("zero torque", one("zero torque", PerformerRole::Plain(|| Behavior::ZeroTorque))),
    ];
    if let Some(config) = &run.experiment.teacher {
        if config.untrained(&run.spec, &seed).is_some() {
            let role =
                PerformerRole::Untrained { teacher: duplicate(config), seed, acts: TeacherActs::Sample };
            groups.push(("untrained teacher", one("untrained teacher", role)));
        }
        let usable = discovery.teachers.iter().enumerate().filter(|(_, teacher)| teacher.usable);
        let teachers: Vec<Performer> = usable
            .map(|(m, teacher)| Performer {
                name: format!("teacher {m}"),
                role: PerformerRole::Teacher {
                    teacher: duplicate(config),
                    key: teacher.key,
                    snapshot: None,
                    acts: TeacherActs::Mean,
                },
            })
            .collect();
        if !teachers.is_empty() {
            groups.push(("teachers", teachers));
        }
    }
    let (names, groups): (Vec<&str>, Vec<Vec<Performer>>) = groups.into_iter().unzip();
    let names = names.into_iter().map(str::to_owned).collect();
    let mut rollouts = run.evaluate("baselines", &groups, contexts, 0..contexts.keys.len())?.into_iter();
    let grouped = groups.iter().map(|group| rollouts.by_ref().take(group.len()).collect()).collect();
    Ok((names, grouped))
}

impl Run<'_> {
    /// What held-out returns are measured against, by a selection's normalisation and `(μ*, σ*)`.
    pub fn yardstick(&self, scale: Scale, reference: Reference) -> Yardstick<'_> {
        Yardstick {
            scale,
            reference,
            plan: &self.experiment.report,
            return_floor: self.return_floor(),
            seed: self.seed.child("bootstrap"),
        }
    }
}

/// What to know of teachers that could not be trained.
fn given_up_teachers(teachers: &[Teacher]) -> Vec<String> {
    let warning = |(m, teacher): (usize, &Teacher)| {
        let why = teacher.diverged.join("; ");
        (!teacher.usable)
            .then(|| format!("teacher {m} was given up, and nothing of its task was recorded: {why}"))
    };
    teachers.iter().enumerate().filter_map(warning).collect()
}

/// What to know of sets that were to begin from recordings of which some fell.
fn missing_clones(candidates: &[Candidate]) -> Vec<String> {
    let warning = |candidate: &Candidate| match candidate.origin {
        Origin::Practice { clones, .. } if (1..candidate.options.len()).contains(&clones) => Some(format!(
            "set {}: {clones} of {} options began from recordings, the others from scratch, because theirs fell",
            candidate.number,
            candidate.options.len()
        )),
        _ => None,
    };
    candidates.iter().filter_map(warning).collect()
}

/// How rollouts are looked at.
struct View<'a> {
    run: &'a Run<'a>,
    discovery: &'a Discovery,
    contexts: &'a ContextSet,
    yardstick: Yardstick<'a>,
}

impl View<'_> {
    fn set(
        &self,
        index: usize,
        options: &BTreeMap<usize, Vec<Rollout>>,
        baselines: &[Sample],
    ) -> Result<SetReport, RunError> {
        let choice = &self.discovery.selection.choices[index];
        let metric = duplicate(&self.run.experiment.metrics[index]);
        let members: Vec<&[Rollout]> = choice.chosen.iter().map(|id| options[id].as_slice()).collect();
        let sample = self.yardstick.sample(&choice.metric, &members, &self.contexts.prices);
        let selection_score = |id: usize| choice.scores[id].unwrap_or(f64::MIN);
        let scores: Vec<f64> = choice.chosen.iter().map(|id| selection_score(*id)).collect();
        let option = |id: &usize| {
            let candidate = &self.discovery.candidates[*id];
            let name = Performer::candidate(candidate).name;
            let sample = self.yardstick.sample(&name, &[&options[id]], &self.contexts.prices);
            let row = self.yardstick.row(&sample)?;
            let teacher = match candidate.origin {
                Origin::Recording { teacher, .. } => Some(teacher),
                Origin::Practice { .. } => None,
            };
            Ok(OptionReport { number: candidate.number, teacher, selection_score: selection_score(*id), row })
        };
        let whole = choice.chosen.first().map(|id| &self.discovery.candidates[*id]);
        let parts = match whole.filter(|candidate| matches!(candidate.origin, Origin::Practice { .. })) {
            Some(candidate) => self.run.parts(candidate, self.contexts)?,
            None => Vec::new(),
        };
        Ok(SetReport {
            parts,
            metric: choice.metric.clone(),
            options: choice.chosen.iter().map(option).collect::<Result<_, RunError>>()?,
            selection_score: mean(&scores)?,
            score: self.yardstick.score(metric, &sample, self.run)?,
            row: self.yardstick.row(&sample)?,
            against: baselines
                .iter()
                .map(|b| self.yardstick.compare(&sample, b))
                .collect::<Result<_, _>>()?,
        })
    }

    fn report(&self, sets: Vec<SetReport>, baselines: Vec<Row>) -> Report {
        let Discovery { teachers, candidates, given_up, selection, .. } = self.discovery;
        let teacher_returns: Option<Vec<f64>> = candidates.iter().map(Candidate::teacher_return).collect();
        let retakes = |candidate: &Candidate| match candidate.origin {
            Origin::Recording { retakes, .. } | Origin::Practice { retakes, .. } => u64::from(retakes),
        };
        let average =
            |values: &[u32]| values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len().max(1) as f64;
        Report {
            format: REPORT_FORMAT,
            robot: self.discovery.spec.robot.clone(),
            engine: self.run.experiment.simulator.engine(),
            seed: self.run.experiment.seed,
            teachers: teachers
                .iter()
                .map(|t| TeacherReport {
                    task: t.task.clone(),
                    usable: t.usable,
                    training_return: t.training_return,
                    diverged: t.diverged.clone(),
                })
                .collect(),
            candidates: CandidateCounts {
                usable: candidates.len(),
                given_up: given_up.clone(),
                retakes: candidates.iter().map(retakes).sum(),
                teacher_return: teacher_returns
                    .map(|returns| returns.iter().sum::<f64>() / returns.len().max(1) as f64),
            },
            starts: StartReport {
                contexts: self.contexts.count,
                mean_random_steps: average(&self.contexts.random_steps),
                mean_redraws: average(&self.contexts.redraws),
            },
            scale: selection.scale,
            reference: selection.reference,
            sets,
            baselines,
            warnings: [given_up_teachers(teachers), missing_clones(candidates), selection.warnings.clone()]
                .concat(),
        }
    }
}
