//! A simulator that notes how long its engine and its observations take.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use elo_core::fault::Faults;
use elo_core::simulator::{
    BuildError, End, Engine, Simulator, SimulatorConfig, SimulatorError, Start, State,
};
use elo_core::spec::SimulatorSpec;
use elo_core::task::Task;
use serde::{Deserialize, Serialize};

/// Nanoseconds in simulators since the last [`take_seconds`].
static SPENT: AtomicU64 = AtomicU64::new(0);

/// Elapsed seconds in simulators since this was called last.
pub fn take_seconds() -> f64 {
    SPENT.swap(0, Ordering::Relaxed) as f64 * 1e-9
}

/// Another simulator, timed.
#[derive(Debug, Serialize, Deserialize)]
pub struct Timed(pub Box<dyn SimulatorConfig>);

#[typetag::serde(name = "bench_timed")]
impl SimulatorConfig for Timed {
    fn validate(&self, faults: &mut Faults) {
        self.0.validate(faults);
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        self.0.spec()
    }

    fn engine(&self) -> Engine {
        self.0.engine()
    }

    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        Ok(Box::new(Watched(self.0.build()?)))
    }
}

struct Watched(Box<dyn Simulator>);

fn timed<T>(run: impl FnOnce() -> T) -> T {
    let begin = Instant::now();
    let result = run();
    SPENT.fetch_add(begin.elapsed().as_nanos() as u64, Ordering::Relaxed);
    result
}

impl Simulator for Watched {
    fn spec(&self) -> &SimulatorSpec {
        self.0.spec()
    }

    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        timed(|| self.0.reset(task, start, observation))
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        timed(|| self.0.step(action, observation, reward_terms))
    }

    fn state(&self) -> Result<State, SimulatorError> {
        self.0.state()
    }
}
