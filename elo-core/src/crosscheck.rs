//! The same options in the same contexts on several engines: whose ranking holds on another, and which options do.

use serde::{Deserialize, Serialize};

use crate::crew::RunError;
use crate::discover::{CANDIDATES_PER_UNIT, ContextSet, Discovery, Run, value};
use crate::performer::Performer;
use crate::rollout::Rollout;
use crate::simulator::Engine;
use crate::statistics::agreement::{kendall_tau_b, sign_test, spearman};
use crate::statistics::bootstrap::{Interval, bootstrap};
use crate::statistics::ranking::top_k_positions;
use crate::statistics::summary::{mean, quantile};
use crate::units::trace::Traced;

/// Two trajectories have parted once a component of their observations differs by more than this. Observations of robots
/// with legs lie between -5 and 5.
pub const PARTED: f32 = 0.05;

/// What a cross-check found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crosscheck {
    /// The robot.
    pub robot: String,
    /// Contexts that all engines share.
    pub contexts: usize,
    /// Numbers of the candidates, in the order of all lists below.
    pub candidates: Vec<usize>,
    /// The engines; the first is the run's own.
    pub engines: Vec<EngineScores>,
    /// Each two engines.
    pub pairs: Vec<Pair>,
    /// Numbers of the `K` candidates with the best worst score over all engines, best first.
    pub robust: Vec<usize>,
    /// Their worst scores.
    pub robust_scores: Vec<f64>,
}

impl Crosscheck {
    /// What to call each engine: its name, and a number from the second of that name on.
    pub fn names(&self) -> Vec<String> {
        let name = |index: usize| self.engines[index].engine.name.as_str();
        let earlier = |index: usize| (0..index).filter(|before| name(*before) == name(index)).count();
        (0..self.engines.len())
            .map(|index| match earlier(index) {
                0 => name(index).to_owned(),
                before => format!("{} ({})", name(index), before + 1),
            })
            .collect()
    }
}

/// The candidates on one engine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EngineScores {
    /// The engine.
    pub engine: Engine,
    /// Whether it began in the very states of the run's own engine. Where one of both cannot be put into states, it reached
    /// starts of its own by the same seeds and random actions: then pairs share the task alone, and differences hold that of
    /// the starts too.
    pub same_starts: bool,
    /// Each candidate's mean return over the contexts.
    pub scores: Vec<f64>,
    /// Share of rollouts that failed; each counts with the engine's own reward floor.
    pub failures: f64,
    /// Why the first of those failed.
    pub first_failure: Option<String>,
    /// Why its trajectories were not seen, where no worker could be kept alive over them.
    pub unseen: Option<String>,
    /// Numbers of the `K` best candidates, best first.
    pub best: Vec<usize>,
}

/// Two engines, by their positions in [`Crosscheck::engines`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// Position of the one engine.
    pub first: usize,
    /// Position of the other engine.
    pub second: usize,
    /// Kendall's τ-b of the scores, with a bootstrap interval over contexts; `None` where one engine scores all alike.
    pub kendall: Option<Interval>,
    /// Spearman's ρ of the scores.
    pub spearman: Option<Interval>,
    /// How many of the `K` best are the same.
    pub shared_best: usize,
    /// Each candidate's mean return on the second less that on the first, and the sign test's probability of it.
    pub differences: Vec<Difference>,
    /// Share of the trajectories of the run's own engine's best options that part, over options and contexts. `None` where
    /// those of one engine were not seen.
    pub parted: Option<f64>,
    /// Control steps until those do: their quartiles. `None` where none does.
    pub parted_after: Option<[f64; 3]>,
}

/// One candidate on two engines.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Difference {
    /// Mean over contexts.
    pub mean: f64,
    /// Two-sided probability that a fair coin would split the contexts' signs so unevenly.
    pub sign_test: f64,
}

/// One engine's rollouts: a return for each candidate and context, and what the chosen options saw.
struct Measured {
    engine: Engine,
    same_starts: bool,
    priced: Priced,
    traced: Traced,
}

/// A return for each candidate and context.
struct Priced {
    returns: Vec<Vec<f64>>,
    /// Share of failed rollouts.
    failures: f64,
    first_failure: Option<String>,
}

/// Measures all candidates of a finished run in `contexts` of its held-out contexts, on its own engine and on those of
/// `others`: the run's experiment on other simulators, by crews of their own in the same run directory.
///
/// Costs candidates · contexts · T control steps an engine, less what the run directory holds already.
///
/// # Errors
/// See [`RunError`]; also another robot, other reward terms, or fewer than two candidates.
pub fn crosscheck(
    run: &Run<'_>,
    discovery: &Discovery,
    others: &[Run<'_>],
    contexts: usize,
) -> Result<Crosscheck, RunError> {
    run.comparable_with(others)?;
    if discovery.candidates.len() < 2 {
        return Err(RunError::Config(format!(
            "a cross-check ranks candidates and needs at least 2, the run has {}: raise `discover.candidates`",
            discovery.candidates.len()
        )));
    }
    let own = run.held_out_contexts(contexts)?;
    let set_size = run.experiment.candidates_of_a_set();

    let mut measured: Vec<Measured> = Vec::new();
    let mut best = Vec::new();
    for there in std::iter::once(run).chain(others) {
        let starts = there.same_contexts(run, &own)?;
        let same_starts = starts.keys == own.keys;
        let priced = priced(there, discovery, &starts)?;
        if measured.is_empty() {
            best = top_k_positions(&scores(&priced.returns)?, set_size);
        }
        let options = best.iter().map(|id| Performer::candidate(&discovery.candidates[*id]));
        let traced = there.observations(&options.collect::<Vec<_>>(), &starts)?;
        let engine = there.experiment.simulator.engine();
        measured.push(Measured { engine, same_starts, priced, traced });
    }
    compared(run, discovery, &measured, own.count)
}

/// Each candidate's return in each context.
fn priced(run: &Run<'_>, discovery: &Discovery, contexts: &ContextSet) -> Result<Priced, RunError> {
    let groups: Vec<Vec<Performer>> = discovery
        .candidates
        .chunks(CANDIDATES_PER_UNIT)
        .map(|group| group.iter().map(Performer::candidate).collect())
        .collect();
    let stage = format!("rollouts on {}", run.experiment.simulator.engine().name);
    let rollouts = run.evaluate(&stage, &groups, contexts, 0..contexts.keys.len())?;
    let count = rollouts.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let failed: Vec<&str> =
        rollouts.iter().flatten().filter_map(|rollout| rollout.ending.trouble()).collect();
    let floor = run.return_floor();
    let returns = |row: &Vec<Rollout>| {
        row.iter()
            .zip(&contexts.prices)
            .map(|(rollout, prices)| value(rollout, prices).unwrap_or(floor))
            .collect()
    };
    Ok(Priced {
        returns: rollouts.iter().map(returns).collect(),
        failures: failed.len() as f64 / count,
        first_failure: failed.first().map(ToString::to_string),
    })
}

fn scores(returns: &[Vec<f64>]) -> Result<Vec<f64>, RunError> {
    returns.iter().map(|row| Ok(mean(row)?)).collect()
}

fn compared(
    run: &Run<'_>,
    discovery: &Discovery,
    measured: &[Measured],
    contexts: usize,
) -> Result<Crosscheck, RunError> {
    let set_size = run.experiment.candidates_of_a_set();
    let numbers: Vec<usize> = discovery.candidates.iter().map(|candidate| candidate.number).collect();
    let named = |positions: &[usize]| positions.iter().map(|id| numbers[*id]).collect::<Vec<_>>();
    let scores: Vec<Vec<f64>> =
        measured.iter().map(|m| scores(&m.priced.returns)).collect::<Result<_, _>>()?;
    let engines = measured.iter().zip(&scores).map(|(m, scores)| EngineScores {
        engine: m.engine.clone(),
        same_starts: m.same_starts,
        scores: scores.clone(),
        failures: m.priced.failures,
        first_failure: m.priced.first_failure.clone(),
        unseen: match &m.traced {
            Traced::Lost(why) => Some(why.clone()),
            Traced::Rollouts(_) => None,
        },
        best: named(&top_k_positions(scores, set_size)),
    });
    let engines: Vec<EngineScores> = engines.collect();
    let mut pairs = Vec::new();
    for second in 0..measured.len() {
        for first in 0..second {
            pairs.push(pair(run, measured, (first, second), &engines)?);
        }
    }
    let worst: Vec<f64> = (0..numbers.len())
        .map(|id| scores.iter().map(|scores| scores[id]).fold(f64::INFINITY, f64::min))
        .collect();
    let robust = top_k_positions(&worst, set_size);
    Ok(Crosscheck {
        robot: run.spec.robot.clone(),
        contexts,
        engines,
        pairs,
        robust: named(&robust),
        robust_scores: robust.iter().map(|id| worst[*id]).collect(),
        candidates: numbers,
    })
}

fn pair(
    run: &Run<'_>,
    measured: &[Measured],
    (first, second): (usize, usize),
    engines: &[EngineScores],
) -> Result<Pair, RunError> {
    let (a, b) = (&measured[first], &measured[second]);
    let plan = &run.experiment.report;
    let (returns, theirs) = (&a.priced.returns, &b.priced.returns);
    let contexts = returns.first().map_or(0, Vec::len);
    let resampled = |returns: &[Vec<f64>], indices: &[usize]| -> Vec<f64> {
        let average = |row: &Vec<f64>| indices.iter().map(|j| row[*j]).sum::<f64>() / indices.len() as f64;
        returns.iter().map(average).collect()
    };
    let interval = |statistic: fn(&[f64], &[f64]) -> Option<f64>| {
        statistic(&engines[first].scores, &engines[second].scores)?;
        let mut stream = run.seed.child("crosscheck").stream();
        let of = |indices: &[usize]| {
            statistic(&resampled(returns, indices), &resampled(theirs, indices)).unwrap_or_default()
        };
        bootstrap(contexts, plan.bootstrap_draws, plan.confidence, &mut stream, of).ok()
    };
    let differences = returns.iter().zip(theirs).map(|(a, b)| {
        let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| b - a).collect();
        let count = |sign: f64| differences.iter().filter(|d| **d * sign > 0.0).count() as u64;
        Difference {
            mean: differences.iter().sum::<f64>() / differences.len() as f64,
            sign_test: sign_test(count(1.0), count(-1.0)),
        }
    });
    let (parted, parted_after) = partings(&a.traced, &b.traced, run.spec.observation_size)?;
    Ok(Pair {
        first,
        second,
        kendall: interval(kendall_tau_b),
        spearman: interval(spearman),
        shared_best: engines[first].best.iter().filter(|n| engines[second].best.contains(n)).count(),
        differences: differences.collect(),
        parted,
        parted_after,
    })
}

/// [`Pair::parted`] and [`Pair::parted_after`].
fn partings(a: &Traced, b: &Traced, size: usize) -> Result<(Option<f64>, Option<[f64; 3]>), RunError> {
    let (Traced::Rollouts(a), Traced::Rollouts(b)) = (a, b) else { return Ok((None, None)) };
    let steps: Vec<f64> = a.iter().zip(b).filter_map(|(a, b)| parted_after(a, b, size)).collect();
    let quartile = |share: f64| quantile(&steps, share);
    let quartiles = || Ok::<_, RunError>([quartile(0.25)?, quartile(0.5)?, quartile(0.75)?]);
    let share = steps.len() as f64 / a.len().max(1) as f64;
    Ok((Some(share), (!steps.is_empty()).then(quartiles).transpose()?))
}

/// The first control step whose observations differ by more than [`PARTED`], or at which only one goes on; `None` where they
/// end together. Components that are 0 or 1 in all of both are flags, such as foot contacts: they differ by a step long
/// before anything is far apart, and are left out.
fn parted_after(a: &[f32], b: &[f32], size: usize) -> Option<f64> {
    let is_flag = |component: usize| {
        let values = a.iter().skip(component).step_by(size).chain(b.iter().skip(component).step_by(size));
        values.into_iter().all(|value| *value == 0.0 || *value == 1.0)
    };
    let compared: Vec<usize> = (0..size).filter(|component| !is_flag(*component)).collect();
    let apart = |(a, b): (&[f32], &[f32])| compared.iter().any(|i| (a[*i] - b[*i]).abs() > PARTED);
    let common = (a.len() != b.len()).then_some(a.len().min(b.len()) / size);
    let step = a.chunks_exact(size).zip(b.chunks_exact(size)).position(apart).or(common);
    step.map(|step| step as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trajectories_part_where_they_differ_or_one_ends() {
        let (a, b) = ([0.0, 0.0, 1.0, 1.0, 2.0, 2.0], [0.0, 0.01, 1.0, 1.04, 2.0, 2.06]);
        assert_eq!(parted_after(&a, &b, 2), Some(2.0));
        assert_eq!(parted_after(&a, &a, 2), None);
        assert_eq!(parted_after(&a[..4], &a, 2), Some(2.0));
        // The first component is a flag that differs at once, the second parts in the third step.
        let (a, b) = ([0.0, 0.2, 1.0, 0.2, 1.0, 0.2], [1.0, 0.2, 1.0, 0.2, 0.0, 0.4]);
        assert_eq!(parted_after(&a, &b, 2), Some(2.0));
    }
}
