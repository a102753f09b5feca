//! Algorithm 1(b) and (c) on a finished pool of candidates: measuring them in contexts, and selecting.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::crew::RunError;
use crate::discover::{CANDIDATES_PER_UNIT, CONTEXTS_PER_UNIT, Candidate, ContextSet, Run, value};
use crate::metric::Metric;
use crate::performer::Performer;
use crate::returns::{ReturnScaling, ReturnTable};
use crate::rollout::Rollout;
use crate::select::{Bench, Scoring, SelectError, Selection};

/// Candidates and the contexts in which they are measured.
#[derive(Clone, Copy, Debug)]
pub struct Pool<'a> {
    /// Who may be chosen.
    pub candidates: &'a [Candidate],
    /// Where they are measured.
    pub contexts: &'a ContextSet,
}

impl Run<'_> {
    /// What candidates are ranked by.
    pub(crate) fn scoring<'b>(
        &'b self,
        candidates: &[Candidate],
        metrics: &'b [Box<dyn Metric>],
        scaling: &'b ReturnScaling,
    ) -> Scoring<'b> {
        let returns: f64 = candidates.iter().filter_map(Candidate::teacher_return).sum();
        Scoring {
            judge: self,
            set_size: self.experiment.candidates_of_a_set(),
            metrics,
            scaling,
            failures: &self.experiment.failures,
            return_floor: self.return_floor(),
            teacher_mean: returns / candidates.len() as f64,
        }
    }

    /// Selects a set by each of `metrics`, measuring whatever the run directory does not hold yet. Gives every
    /// candidate's rollouts too, over the contexts that it has met.
    ///
    /// # Errors
    /// See [`RunError`]; also a metric by which no candidate can be chosen.
    pub fn select(
        &self,
        pool: &Pool<'_>,
        metrics: &[Box<dyn Metric>],
        scaling: &ReturnScaling,
    ) -> Result<(Selection, Vec<Vec<Rollout>>), RunError> {
        let scoring = self.scoring(pool.candidates, metrics, scaling);
        let mut bench = Measured { run: self, pool, rollouts: Vec::new() };
        let selection = self.experiment.selector.select(&mut bench, &scoring)?;
        if let Some(empty) = selection.choices.iter().find(|choice| choice.chosen.is_empty()) {
            let candidates = empty.scores.len();
            let why = match empty.scores.iter().flatten().count() {
                0 => format!(
                    "each of {candidates} has a rollout that failed, and `failures.policy` leaves such out"
                ),
                scored => format!("the scores of {scored} of {candidates} are no numbers"),
            };
            return Err(RunError::Select(format!("no candidate can be chosen by {}: {why}", empty.metric)));
        }
        Ok((selection, bench.rollouts))
    }
}

/// The bench on which candidates meet the selecting contexts.
struct Measured<'a> {
    run: &'a Run<'a>,
    pool: &'a Pool<'a>,
    /// Rollouts of each candidate over the contexts that it has met.
    rollouts: Vec<Vec<Rollout>>,
}

impl Bench for Measured<'_> {
    fn candidates(&self) -> usize {
        self.pool.candidates.len()
    }

    fn contexts(&self) -> usize {
        self.pool.contexts.count
    }

    fn measure(&mut self, ids: &[usize], contexts: Range<usize>) -> Result<ReturnTable, SelectError> {
        let blocks = contexts.start / CONTEXTS_PER_UNIT..contexts.end.div_ceil(CONTEXTS_PER_UNIT);
        let skipped = contexts.start - blocks.start * CONTEXTS_PER_UNIT;
        // Groups are cut by the candidates' numbers, so that they do not depend on who else is measured.
        let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for id in ids {
            groups.entry(self.pool.candidates[*id].number / CANDIDATES_PER_UNIT).or_default().push(*id);
        }
        let performers: Vec<Vec<Performer>> = groups
            .values()
            .map(|group| group.iter().map(|id| Performer::candidate(&self.pool.candidates[*id])).collect())
            .collect();
        let rollouts = self
            .run
            .evaluate("selection rollouts", &performers, self.pool.contexts, blocks)
            .map_err(|error| SelectError::Measure(Box::new(error)))?;
        self.rollouts.resize(self.pool.candidates.len(), Vec::new());
        let mut rows: BTreeMap<usize, Vec<Option<f64>>> = BTreeMap::new();
        for (id, rollouts) in groups.values().flatten().zip(rollouts) {
            let prices = &self.pool.contexts.prices[contexts.clone()];
            let row = rollouts[skipped..]
                .iter()
                .zip(prices)
                .map(|(rollout, prices)| value(rollout, prices))
                .collect();
            rows.insert(*id, row);
            self.rollouts[*id] = rollouts;
        }
        let values = ids.iter().flat_map(|id| rows[id].clone()).collect();
        Ok(ReturnTable::new(contexts.len(), values))
    }
}

impl From<SelectError> for RunError {
    fn from(error: SelectError) -> Self {
        match error {
            SelectError::Measure(inner) => inner
                .downcast::<RunError>()
                .map_or_else(|other| RunError::Select(other.to_string()), |inner| *inner),
            failures @ SelectError::Failures { .. } => RunError::Select(failures.to_string()),
        }
    }
}
