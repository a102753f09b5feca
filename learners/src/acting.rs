//! What learners that act in a simulator have in common: where they begin, and what they forgive.

use std::time::{Duration, Instant};

use elo_core::context::{Context, InitialStates};
use elo_core::policy::{Monitor, Stopped, TrainError};
use elo_core::seed::Seed;
use elo_core::simulator::{Simulator, SimulatorError};
use elo_core::task::Task;
use serde::{Deserialize, Serialize};

/// Failed episodes that are forgiven however few the others are.
const FORGIVEN_FAILURES: u64 = 10;

/// Draws a start from `d0` for each task. A draw during which the simulator fails gives none. `word` is called before each draw, for
/// whoever waits.
///
/// # Errors
/// When no draw gave a start, for a reason that another draw would meet too, or when `word` says to stop.
pub(crate) fn draw_contexts(
    initial_states: &InitialStates,
    simulator: &mut dyn Simulator,
    tasks: impl Iterator<Item = Task>,
    seed: &Seed,
    word: &mut dyn FnMut() -> Result<(), Stopped>,
) -> Result<Vec<Context>, TrainError> {
    let mut contexts = Vec::new();
    let mut last_failure = None;
    for (index, task) in (0..).zip(tasks) {
        word()?;
        match initial_states.draw(simulator, &task, &seed.index(index)) {
            Ok(start) => contexts.push(Context { task, start }),
            Err(error @ (SimulatorError::Unstable(_) | SimulatorError::Engine(_))) => {
                last_failure = Some(error)
            }
            Err(error) => return Err(TrainError::Other(format!("no start can be drawn from d0: {error}"))),
        }
    }
    match last_failure {
        Some(error) if contexts.is_empty() => {
            Err(TrainError::Other(format!("no start can be drawn from d0: {error}")))
        }
        _ => Ok(contexts),
    }
}

/// How often a [`Teller`] passes a word on.
const WORDS_APART: Duration = Duration::from_millis(100);

/// Tells a monitor of each step of a training, which would cost more than some steps do, about ten times a second.
pub(crate) struct Teller<'a> {
    monitor: &'a mut dyn Monitor,
    total: u64,
    last: Instant,
}

impl<'a> Teller<'a> {
    /// Of a training of `total` steps.
    pub fn new(monitor: &'a mut dyn Monitor, total: u64) -> Self {
        Self { monitor, total, last: Instant::now() }
    }

    /// `done` steps are taken.
    ///
    /// # Errors
    /// [`Stopped`], as [`Monitor::progress`].
    pub fn step(&mut self, done: u64) -> Result<(), Stopped> {
        if self.last.elapsed() < WORDS_APART {
            return Ok(());
        }
        self.last = Instant::now();
        self.monitor.progress(done, self.total)
    }
}

/// Counts of a whole training.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Tally {
    /// Control steps taken that can be learned from.
    pub steps: u64,
    /// Episodes begun.
    pub episodes: u64,
    /// Those among them that the simulator could not carry through.
    pub failures: u64,
}

impl Tally {
    /// Counts a simulator's error that spoils one episode.
    ///
    /// # Errors
    /// [`TrainError::Diverged`] when more than one episode in a hundred failed, and at least [`FORGIVEN_FAILURES`];
    /// [`TrainError::Other`] for errors that every episode would meet.
    pub fn fail(&mut self, error: &SimulatorError) -> Result<(), TrainError> {
        match error {
            SimulatorError::Unstable(_) | SimulatorError::Engine(_) | SimulatorError::Start(_) => {}
            SimulatorError::NonFiniteAction { .. } => {
                return Err(TrainError::Diverged { steps: self.steps, reason: error.to_string() });
            }
            _ => return Err(TrainError::Other(error.to_string())),
        }
        self.failures += 1;
        let Self { steps, episodes, failures } = *self;
        if failures > FORGIVEN_FAILURES && failures * 100 > episodes {
            let reason =
                format!("the simulator failed in {failures} of {episodes} episodes, lastly: {error}");
            return Err(TrainError::Diverged { steps, reason });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn few_failures_are_forgiven_and_many_are_divergence() {
        let unstable = SimulatorError::Unstable("a test".to_owned());
        let mut tally = Tally { steps: 7, episodes: 20, failures: 0 };
        for _ in 0..FORGIVEN_FAILURES {
            tally.fail(&unstable).unwrap();
        }
        match tally.fail(&unstable).unwrap_err() {
            TrainError::Diverged { steps: 7, reason } => {
                assert!(reason.contains("11 of 20 episodes"), "{reason}")
            }
            other => panic!("{other}"),
        }
        let mut tally = Tally { steps: 0, episodes: 10_000, failures: 99 };
        tally.fail(&unstable).unwrap();
        assert!(tally.fail(&unstable).is_err());
        assert!(matches!(Tally::default().fail(&SimulatorError::NoEpisode), Err(TrainError::Other(_))));
    }
}
