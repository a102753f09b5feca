//! Subjects in contexts, each by its own random stream: what evaluating and tracing have in common.

use super::evaluate::Subject;
use super::{Site, WorkError};
use crate::context::Context;
use crate::hosted::WorkerProgram;
use crate::policy::Monitor;
use crate::rollout::{Ending, Horizon, Rollout, Setting, Witness, watched};
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;

/// A rollout in a user's own code that failed is tried this often in all, each time in a new environment.
const TRIES: usize = 3;

/// Who plays where, and for how long.
pub(super) struct Play<'a> {
    pub simulator: &'a dyn SimulatorConfig,
    pub subjects: &'a [Subject],
    pub horizon: &'a Horizon,
    /// Context `j` of subject `n` draws from `seed / n / j`.
    pub seed: &'a Seed,
}

impl Play<'_> {
    /// Runs every subject in every context, subject by subject; gives each rollout with what its witness saw.
    pub fn run<W: Witness + Default>(
        &self,
        contexts: &[Context],
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<(Rollout, W)>, WorkError> {
        let spec = site.simulator(self.simulator)?.spec().clone();
        let cast = self.subjects.iter().map(|subject| subject.cast(inputs, site, &spec));
        let cast = cast.collect::<Result<Vec<_>, _>>()?;
        let total = (cast.len() * contexts.len()) as u64;
        let mut played = Vec::with_capacity(cast.len() * contexts.len());
        let mut simulator = site.simulator(self.simulator)?;
        for (subject, cast) in self.subjects.iter().zip(&cast) {
            let seed = self.seed.child(&subject.name);
            for (j, context) in contexts.iter().enumerate() {
                monitor.progress(played.len() as u64, total)?;
                let mut tries = 0;
                played.push(loop {
                    let (mut noise, mut witness) = (seed.index(j as u64).stream(), W::default());
                    let setting = Setting { context, horizon: self.horizon };
                    let rollout = cast.play(&spec, |agent| {
                        watched(&mut *simulator, agent, setting, &mut noise, &mut witness)
                    });
                    tries += 1;
                    if !(self.may_pass(&rollout) && tries < TRIES) {
                        break (rollout, witness);
                    }
                    site.forget(self.simulator);
                    simulator = site.simulator(self.simulator)?;
                });
            }
        }
        Ok(played)
    }

    /// Whether it failed for a reason that may be gone the next time. Engines of our own repeat their failures.
    fn may_pass(&self, rollout: &Rollout) -> bool {
        let worker = self.simulator.hosted().map(|hosted| hosted.worker());
        matches!(rollout.ending, Ending::Failed(_)) && matches!(worker, Some(WorkerProgram::Interpreter(_)))
    }
}
