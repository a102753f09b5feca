//! A finished run on other simulators of the same robot, in the same contexts.

use crate::context::Split;
use crate::crew::{RunError, Unit};
use crate::discover::{ContextSet, Run, duplicate};
use crate::experiment::Experiment;
use crate::performer::Performer;
use crate::simulator::SimulatorConfig;
use crate::units::prepare::TaskSource;
use crate::units::trace::{self, Seen, Trace};

impl Run<'_> {
    /// The experiment on its own simulator, then on each of `others`.
    pub(crate) fn on_each(&self, others: &[Box<dyn SimulatorConfig>]) -> Vec<Experiment> {
        let on = |simulator| Experiment { simulator: duplicate(simulator), ..duplicate(self.experiment) };
        std::iter::once(&self.experiment.simulator).chain(others).map(on).collect()
    }

    /// The first `count` held-out contexts.
    ///
    /// # Errors
    /// See [`RunError`].
    pub fn held_out_contexts(&self, count: usize) -> Result<ContextSet, RunError> {
        let tasks = TaskSource::Distribution(self.experiment.tasks.clone());
        self.prepare_contexts(Split::Report, count, &tasks)
    }

    /// What performers see, rollout by rollout, in the first [`CONTEXTS_PER_UNIT`](crate::discover::CONTEXTS_PER_UNIT) of some contexts; performer by performer.
    ///
    /// # Errors
    /// See [`RunError`].
    pub fn observations(
        &self,
        performers: &[Performer],
        contexts: &ContextSet,
    ) -> Result<Vec<Seen>, RunError> {
        let mut inputs = vec![contexts.keys[0]];
        let subjects = performers.iter().map(|performer| performer.subject(&mut inputs)).collect();
        let play = self.play(subjects, self.seed.child("trace"));
        let keys = self.crew.complete("trajectories", &[Unit { work: Trace(play).into(), inputs }])?;
        Ok(trace::decode(&self.crew.result(&keys[0])?)?)
    }

    /// The held-out contexts of another run with the same seed, on this simulator: in the very states of `own` where
    /// states can be set, else with starts of its own that the same seeds and random actions lead to.
    pub(crate) fn same_contexts(&self, own: &ContextSet) -> Result<ContextSet, RunError> {
        if self.spec.capabilities.settable_state {
            Ok(own.clone())
        } else {
            self.held_out_contexts(own.count)
        }
    }
}
