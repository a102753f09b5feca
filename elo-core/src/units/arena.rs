//! The simulator of one unit, where code of users may fail now and then.

use super::{Site, WorkError, name};
use crate::context::{InitialStates, PreparedStart};
use crate::rollout::{Ending, Rollout};
use crate::seed::Seed;
use crate::simulator::{BuildError, Simulator, SimulatorConfig, SimulatorError};
use crate::task::Task;

/// What fails in a user's own code is tried this often in all, each time in a new environment.
const TRIES: usize = 3;

/// A site's simulator of one config.
pub(super) struct Arena<'a> {
    site: &'a mut Site,
    config: &'a dyn SimulatorConfig,
    name: String,
}

impl<'a> Arena<'a> {
    pub(super) fn new(site: &'a mut Site, config: &'a dyn SimulatorConfig) -> Self {
        Self { site, config, name: name(config) }
    }

    pub(super) fn simulator(&mut self) -> Result<&mut dyn Simulator, BuildError> {
        self.site.named_simulator(&self.name, self.config)
    }

    /// Does `act`. Where it `failed` for a reason that may be gone the next time, in code of users, the environment is made
    /// anew and it is done again. Engines of our own repeat their failures.
    fn attempt<T>(
        &mut self,
        mut act: impl FnMut(&mut dyn Simulator) -> T,
        failed: impl Fn(&T) -> bool,
    ) -> Result<T, BuildError> {
        let mut tries = 0;
        loop {
            let done = act(self.simulator()?);
            if !(self.is_foreign() && failed(&done)) {
                return Ok(done);
            }
            // What raised an exception may be broken.
            self.site.simulators.remove(&self.name);
            tries += 1;
            if tries == TRIES {
                return Ok(done);
            }
        }
    }

    /// Plays a rollout, with what a witness saw of it.
    pub(super) fn roll_out<W>(
        &mut self,
        play: impl FnMut(&mut dyn Simulator) -> (Rollout, W),
    ) -> Result<(Rollout, W), BuildError> {
        self.attempt(play, |(rollout, _)| matches!(rollout.ending, Ending::Failed(_)))
    }

    /// Draws a start under `task`.
    pub(super) fn start(
        &mut self,
        initial_states: &InitialStates,
        task: &Task,
        seed: &Seed,
    ) -> Result<PreparedStart, WorkError> {
        let may_pass =
            |error: &SimulatorError| matches!(error, SimulatorError::Engine(_) | SimulatorError::Unstable(_));
        let drawn = self.attempt(
            |simulator| initial_states.draw(simulator, task, seed),
            |drawn| drawn.as_ref().is_err_and(may_pass),
        )?;
        drawn.map_err(|error| {
            let often = if self.is_foreign() && may_pass(&error) {
                format!(", in {TRIES} tries")
            } else {
                String::new()
            };
            WorkError::Failed(format!("no start could be drawn{often}: {error}"))
        })
    }

    fn is_foreign(&self) -> bool {
        self.config.hosted().is_some_and(|hosted| hosted.worker().is_interpreter())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::cell::Cell;

    use serde::{Deserialize, Serialize};

    use super::*;
    use crate::conformance::point_mass::PointMassConfig;
    use crate::fault::Faults;
    use crate::hosted::{Hosted, WorkerProgram};
    use crate::policy::Unwatched;
    use crate::simulator::{End, Engine, Start, State};
    use crate::spec::SimulatorSpec;
    use crate::task::TaskDistribution;
    use crate::units::prepare::{self, Prepare, TaskSource};
    use crate::units::{Span, Work};

    thread_local! {
        /// Exceptions that are still to come, and environments that were made.
        static LEFT: Cell<usize> = const { Cell::new(0) };
        static MADE: Cell<usize> = const { Cell::new(0) };
    }

    /// The mass on a line as a user's code, some of whose steps raise an exception that leaves it broken.
    #[derive(Debug, Serialize, Deserialize)]
    struct FlakyConfig {
        foreign: bool,
    }

    #[typetag::serde(name = "flaky")]
    impl SimulatorConfig for FlakyConfig {
        fn validate(&self, _: &mut Faults) {}

        fn spec(&self) -> Result<SimulatorSpec, BuildError> {
            PointMassConfig::default().spec()
        }

        fn engine(&self) -> Engine {
            PointMassConfig::default().engine()
        }

        fn hosted(&self) -> Option<&dyn Hosted> {
            self.foreign.then_some(self as &dyn Hosted)
        }

        fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
            MADE.set(MADE.get() + 1);
            Ok(Box::new(Flaky { inner: PointMassConfig::default().build()?, broken: false }))
        }
    }

    impl Hosted for FlakyConfig {
        fn worker(&self) -> WorkerProgram {
            WorkerProgram::Interpreter("a language")
        }
    }

    struct Flaky {
        inner: Box<dyn Simulator>,
        broken: bool,
    }

    impl Simulator for Flaky {
        fn spec(&self) -> &SimulatorSpec {
            self.inner.spec()
        }

        fn reset(
            &mut self,
            task: &Task,
            start: &Start,
            observation: &mut [f32],
        ) -> Result<(), SimulatorError> {
            if self.broken {
                return Err(SimulatorError::Engine("it is broken".to_owned()));
            }
            self.inner.reset(task, start, observation)
        }

        fn step(
            &mut self,
            action: &[f32],
            observation: &mut [f32],
            reward_terms: &mut [f64],
        ) -> Result<End, SimulatorError> {
            if LEFT.get() > 0 {
                LEFT.set(LEFT.get() - 1);
                self.broken = true;
                return Err(SimulatorError::Engine("ValueError: it raised".to_owned()));
            }
            self.inner.step(action, observation, reward_terms)
        }

        fn state(&self) -> Result<State, SimulatorError> {
            self.inner.state()
        }
    }

    /// Six contexts in an environment that raises so often, and how many environments were made for that.
    fn prepared(foreign: bool, raises: usize) -> (Result<Vec<u8>, WorkError>, usize) {
        LEFT.set(raises);
        MADE.set(0);
        let work = Work::from(Prepare {
            simulator: Box::new(FlakyConfig { foreign }),
            tasks: TaskSource::Distribution(TaskDistribution::default()),
            initial_states: InitialStates { max_random_steps: 5, ..InitialStates::default() },
            span: Span { first: 0, count: 6 },
            seed: Seed::root(1),
        });
        (work.perform(&[], &mut Site::new(Vec::new()), &mut Unwatched), MADE.get())
    }

    #[test]
    fn exceptions_of_users_code_are_forgiven_twice_and_change_nothing() {
        let (undisturbed, made) = prepared(true, 0);
        assert_eq!((prepare::decode(undisturbed.as_ref().unwrap()).unwrap().len(), made), (6, 1));
        assert_eq!(prepared(true, 1), (undisturbed.clone(), 2));
        assert_eq!(prepared(true, 2), (undisturbed, 3));
        let (ended, made) = prepared(true, 3);
        let message = ended.unwrap_err().to_string();
        assert!(message.ends_with("no start could be drawn, in 3 tries: ValueError: it raised"), "{message}");
        assert!(message.starts_with("context ") && made == 3, "{message}, {made}");
        let message = prepared(false, 1).0.unwrap_err().to_string();
        assert!(message.ends_with("no start could be drawn: ValueError: it raised"), "{message}");
    }
}
