//! A finished run on other simulators of the same robot, in the same contexts.

use crate::context::Split;
use crate::crew::{RunError, Unit};
use crate::discover::{ContextSet, Run};
use crate::performer::Performer;
use crate::simulator::Engine;
use crate::units::prepare::TaskSource;
use crate::units::trace::{Trace, Traced};

impl Run<'_> {
    /// Refuses runs on other simulators whose rollouts cannot be compared with this one's.
    ///
    /// # Errors
    /// The first difference, see [`incomparable`](crate::spec::SimulatorSpec::incomparable).
    pub(crate) fn comparable_with(&self, others: &[Run<'_>]) -> Result<(), RunError> {
        let refused = |there: &Run<'_>| {
            let Engine { name, version } = there.experiment.simulator.engine();
            let why = self.spec.incomparable(&there.spec)?;
            Some(RunError::Config(format!("{name} {version}: {why}")))
        };
        others.iter().find_map(refused).map_or(Ok(()), Err)
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
    pub fn observations(&self, performers: &[Performer], contexts: &ContextSet) -> Result<Traced, RunError> {
        let mut inputs = vec![contexts.keys[0]];
        let subjects = performers.iter().map(|performer| performer.subject(&mut inputs)).collect();
        let play = self.play(subjects, self.seed.child("trace"));
        let keys = self.crew.complete("trajectories", &[Unit { work: Trace(play).into(), inputs }])?;
        Ok(Traced::decode(&self.crew.result(&keys[0])?)?)
    }

    /// The held-out contexts `own` of `run`, a run with the same seed, on this simulator: the very same where both
    /// simulators can be put into states, else with starts of its own that the same seeds and random actions lead to.
    pub(crate) fn same_contexts(&self, run: &Run<'_>, own: &ContextSet) -> Result<ContextSet, RunError> {
        if self.spec.capabilities.settable_state && run.spec.capabilities.settable_state {
            let prices = own.tasks.iter().map(|task| self.spec.prices(task)).collect();
            Ok(ContextSet { prices, ..own.clone() })
        } else {
            self.held_out_contexts(own.count)
        }
    }
}
