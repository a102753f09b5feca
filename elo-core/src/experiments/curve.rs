//! What a teacher earns on its way, and how long it must train to earn what the infant agent earns from the start.

use serde::{Deserialize, Serialize};

use super::{Measured, View};
use crate::crew::RunError;
use crate::experiment::TeacherActs;
use crate::figures::{Row, Sample};
use crate::key::Key;
use crate::performer::{Performer, PerformerRole};
use crate::seed::{Seed, Stream};
use crate::statistics::bootstrap::Interval;
use crate::task::Task;
use crate::units::train::TeacherResult;
use rand::RngExt as _;

/// A policy kept on the way of a teacher for the default task, in the held-out contexts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvePoint {
    /// Control steps of training before it; 0 for the untrained one.
    pub steps: u64,
    /// Acting by samples, as it does while it learns.
    pub sampled: Row,
    /// Acting by its mean.
    pub mean_action: Row,
}

/// How long a teacher must train to earn what an agent with options earns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Equivalent {
    /// The agent with options.
    pub agent: String,
    /// How the teacher acts.
    pub acts: TeacherActs,
    /// The agent's mean return.
    pub level: Interval,
    /// Where the learning curve reaches it.
    pub steps: Crossing,
    /// Lower end of the percentile interval over contexts, which are common to agent and curve.
    pub low: Crossing,
    /// Its upper end.
    pub high: Crossing,
}

/// Where a learning curve first reaches a level.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Crossing {
    /// The untrained policy earns as much.
    BelowCurve,
    /// After so many control steps, on the straight line between two policies that were kept.
    At(f64),
    /// No policy that was kept earns so much.
    AboveCurve,
}

/// `curve`: training steps with mean returns, the first at 0 steps. A curve that falls again counts where it first reaches
/// the level.
pub fn crossing(curve: &[(f64, f64)], level: f64) -> Crossing {
    match curve.iter().position(|(_, value)| *value >= level) {
        None => Crossing::AboveCurve,
        Some(0) => Crossing::BelowCurve,
        Some(after) => {
            let ((from, low), (to, high)) = (curve[after - 1], curve[after]);
            Crossing::At(from + (to - from) * (level - low) / (high - low))
        }
    }
}

/// A teacher's policies in the held-out contexts, in the order of their training.
pub(crate) struct LearningCurve {
    policies: Vec<Kept>,
}

struct Kept {
    steps: u64,
    sampled: Measured,
    mean_action: Measured,
}

/// Trains a teacher for the default task and runs every policy that it kept.
pub(crate) fn measure(view: &View<'_>) -> Result<Option<LearningCurve>, RunError> {
    let run = view.run;
    let seed = run.seed.child("learning curve");
    let Some(teacher) = &run.experiment.teacher else { return Ok(None) };
    if teacher.untrained(&run.spec, &seed).is_none() {
        return Ok(None);
    }
    let key = run.crew.complete("learning curve", &[run.training(&Task::default(), seed.clone())?])?[0];
    let Some(trained) = TeacherResult::decode(&run.crew.result(&key)?)?.trained else { return Ok(None) };
    if trained.snapshots.is_empty() {
        return Ok(None);
    }
    let steps: Vec<u64> =
        std::iter::once(0).chain(trained.snapshots.iter().map(|snapshot| snapshot.steps)).collect();
    let way = Way { view, key, seed };
    let sampled = way.measure(&steps, TeacherActs::Sample)?;
    let mean_action = way.measure(&steps, TeacherActs::Mean)?;
    let policies = steps.into_iter().zip(sampled).zip(mean_action);
    let policies =
        policies.map(|((steps, sampled), mean_action)| Kept { steps, sampled, mean_action }).collect();
    Ok(Some(LearningCurve { policies }))
}

/// The training behind a curve.
struct Way<'a> {
    view: &'a View<'a>,
    key: Key,
    seed: Seed,
}

impl Way<'_> {
    fn measure(&self, steps: &[u64], acts: TeacherActs) -> Result<Vec<Measured>, RunError> {
        let performers = (0..steps.len()).map(|index| self.policy(index, steps[index], acts));
        let performers = performers.collect::<Result<_, _>>()?;
        let rows = self.view.run_in_contexts(performers)?;
        let named = rows.into_iter().zip(steps);
        Ok(named.map(|(row, steps)| self.view.measured(&name(*steps), vec![row])).collect())
    }

    /// The untrained policy is the first, then the snapshots follow.
    fn policy(&self, index: usize, steps: u64, acts: TeacherActs) -> Result<Performer, RunError> {
        let teacher = self.view.run.teacher()?;
        let role = match index.checked_sub(1) {
            None => PerformerRole::Untrained { teacher, seed: self.seed.child("untrained"), acts },
            Some(index) => PerformerRole::Teacher { teacher, key: self.key, snapshot: Some(index), acts },
        };
        Ok(Performer { name: format!("{} {acts:?}", name(steps)), role })
    }
}

fn name(steps: u64) -> String {
    format!("teacher after {steps} steps")
}

impl LearningCurve {
    /// The policy kept nearest to so many steps, acting by samples.
    pub fn nearest(&self, steps: u64) -> Measured {
        let kept = self.policies.iter().min_by_key(|kept| kept.steps.abs_diff(steps));
        kept.expect("a curve has points").sampled.clone()
    }

    pub fn points(&self, view: &View<'_>) -> Result<Vec<CurvePoint>, RunError> {
        let row = |measured: &Measured| view.yardstick.row(&measured.sample);
        self.policies
            .iter()
            .map(|kept| {
                let (sampled, mean_action) = (row(&kept.sampled)?, row(&kept.mean_action)?);
                Ok(CurvePoint { steps: kept.steps, sampled, mean_action })
            })
            .collect()
    }

    /// How long the teacher trains to earn what `agent` earns, by samples and by its mean.
    pub fn equivalents(&self, view: &View<'_>, agent: &Sample) -> Result<Vec<Equivalent>, RunError> {
        let level = view.yardstick.row(agent)?.mean_return;
        [TeacherActs::Sample, TeacherActs::Mean]
            .into_iter()
            .map(|acts| {
                let values: Vec<(f64, Vec<f64>)> =
                    self.policies.iter().map(|kept| (kept.steps as f64, kept.acting(acts))).collect();
                let mut stream = view.yardstick.stream();
                let (steps, mut drawn) = resampled(&values, &agent.context_means(), view, &mut stream);
                drawn.sort_by(|a, b| a.partial_cmp(b).expect("crossings are numbers"));
                let tail = (1.0 - view.yardstick.plan.confidence) / 2.0;
                let end = |share: f64| drawn[((drawn.len() - 1) as f64 * share).round() as usize];
                Ok(Equivalent {
                    agent: agent.name.clone(),
                    acts,
                    level,
                    steps,
                    low: end(tail),
                    high: end(1.0 - tail),
                })
            })
            .collect()
    }
}

impl Kept {
    fn acting(&self, acts: TeacherActs) -> Vec<f64> {
        match acts {
            TeacherActs::Sample => self.sampled.sample.context_means(),
            TeacherActs::Mean => self.mean_action.sample.context_means(),
        }
    }
}

/// The crossing in all contexts, then in each resample of them; agent and curve meet the same contexts each time.
fn resampled(
    curve: &[(f64, Vec<f64>)],
    levels: &[f64],
    view: &View<'_>,
    stream: &mut Stream,
) -> (Crossing, Vec<Crossing>) {
    let average =
        |values: &[f64], drawn: &[usize]| drawn.iter().map(|j| values[*j]).sum::<f64>() / drawn.len() as f64;
    let crossed = |drawn: &[usize]| {
        let means: Vec<(f64, f64)> =
            curve.iter().map(|(steps, values)| (*steps, average(values, drawn))).collect();
        crossing(&means, average(levels, drawn))
    };
    let mut drawn: Vec<usize> = (0..levels.len()).collect();
    let estimate = crossed(&drawn);
    let resample = |_| {
        drawn.fill_with(|| stream.random_range(0..levels.len()));
        crossed(&drawn)
    };
    (estimate, (0..view.yardstick.plan.bootstrap_draws).map(resample).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_crossed_on_the_line_between_its_points() {
        let curve = [(0.0, 10.0), (100.0, 30.0), (200.0, 20.0), (300.0, 50.0)];
        assert_eq!(crossing(&curve, 5.0), Crossing::BelowCurve);
        assert_eq!(crossing(&curve, 10.0), Crossing::BelowCurve);
        assert_eq!(crossing(&curve, 25.0), Crossing::At(75.0));
        // It falls below 30 and rises above it again: 35 is first reached half way between 20 and 50.
        assert_eq!(crossing(&curve, 35.0), Crossing::At(250.0));
        assert_eq!(crossing(&curve, 50.5), Crossing::AboveCurve);
        assert!(Crossing::BelowCurve < Crossing::At(0.0) && Crossing::At(1e9) < Crossing::AboveCurve);
    }
}
