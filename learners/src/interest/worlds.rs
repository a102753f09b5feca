//! For tests: worlds of one or two states, told apart by an observation with one 1, in which only the action's sign counts.

use elo_core::context::InitialStates;
use elo_core::fault::Faults;
use elo_core::policy::Practice;
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_core::simulator::{
    BuildError, End, Engine, Simulator, SimulatorConfig, SimulatorError, Start, State,
};
use elo_core::spec::{Capabilities, Effect, RewardTerm, SimulatorSpec, TaskParameter, Weight};
use elo_core::task::{Task, TaskDistribution};
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

/// A practice of two options from scratch.
pub(super) fn practice<'a>(
    simulator: &'a dyn SimulatorConfig,
    tasks: &'a TaskDistribution,
    initial_states: &'a InitialStates,
    steps: usize,
    seed: u64,
) -> Practice<'a> {
    let seed = Seed::root(seed);
    let horizon = Horizon { steps, discount: 1.0, stop_at_fall: true };
    Practice { simulator, tasks, initial_states, set_size: 2, horizon, demonstrations: &[], seed }
}

/// Which world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum World {
    /// State 1 is a hot surface. Going on (a positive action) earns 1 elsewhere, where it leads to the surface in three of
    /// ten cases, and −1 on the surface; pulling back earns 1 on the surface, which it leaves, and nothing elsewhere. The
    /// best one can do is 1 a step.
    Hot,
    /// The same for three steps; then the task ends.
    BrieflyHot,
    /// One state. Pays ½ or 1½, whatever is done, and goes on.
    Endless,
    /// The same, and ends after each step.
    Fatal,
    /// The same as `Endless`, but the third step fails.
    Failing,
    /// One state. Keeping the sign of the last action earns 1, changing it −1.
    Steady,
    /// One state. Going on earns 1.5, but once in twenty times −8, which is 1.025 in the mean; pulling back earns 0.9.
    Gamble,
    /// The states change at random. The right sign, positive in state 0, earns 1, the other −1.
    Fickle,
}

impl World {
    /// Reward and next state.
    fn step(self, state: usize, action: f32, last: Option<f32>, luck: f64) -> (f64, usize) {
        let forward = action > 0.0;
        match (self, state) {
            (Self::Hot | Self::BrieflyHot, 0) => (f64::from(forward), usize::from(forward && luck < 0.3)),
            (Self::Hot | Self::BrieflyHot, _) => (if forward { -1.0 } else { 1.0 }, usize::from(forward)),
            (Self::Endless | Self::Fatal | Self::Failing, _) => (if luck < 0.5 { 0.5 } else { 1.5 }, 0),
            (Self::Steady, _) => {
                let kept = last.is_none_or(|last| (last > 0.0) == forward);
                (if kept { 1.0 } else { -1.0 }, 0)
            }
            (Self::Gamble, _) => {
                let paid = if luck < 0.05 { -8.0 } else { 1.5 };
                (if forward { paid } else { 0.9 }, 0)
            }
            (Self::Fickle, _) => (if forward == (state == 0) { 1.0 } else { -1.0 }, usize::from(luck < 0.5)),
        }
    }

    /// Whether the task ends with a step of an episode, counted from 1.
    fn ends(self, step: u64) -> bool {
        self == Self::Fatal || self == Self::BrieflyHot && step == 3
    }
}

/// What a step of a world earned is priced by the task.
#[typetag::serde(name = "test_interest_world")]
impl SimulatorConfig for World {
    fn validate(&self, _: &mut Faults) {}
    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Ok(self.build()?.spec().clone())
    }
    fn engine(&self) -> Engine {
        Engine { name: "world".to_owned(), version: "1".to_owned() }
    }
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        let pay = TaskParameter {
            name: "pay".to_owned(),
            default: 1.0,
            low: 0.0,
            high: 2.0,
            effect: Effect::Reward,
        };
        let weight = Weight::Parameter("pay".to_owned());
        let spec = SimulatorSpec {
            robot: "finger".to_owned(),
            observation_size: 2,
            action_low: vec![-1.0],
            action_high: vec![1.0],
            control_step: 1.0,
            reward_terms: vec![RewardTerm { name: "earned".to_owned(), weight }],
            task_parameters: vec![pay],
            reward_floor: -2.0,
            capabilities: Capabilities { settable_state: false },
        };
        Ok(Box::new(Running { world: *self, spec, seed: Seed::root(0), steps: 0, state: 0, last: None }))
    }
}

struct Running {
    world: World,
    spec: SimulatorSpec,
    seed: Seed,
    steps: u64,
    state: usize,
    last: Option<f32>,
}

impl Simulator for Running {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn reset(&mut self, _: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        let Start::Seed(seed) = start else { return Err(SimulatorError::Unsupported("setting a state")) };
        self.seed = Seed::root(*seed);
        (self.steps, self.state, self.last) = (0, 0, None);
        observation.copy_from_slice(&[1.0, 0.0]);
        Ok(())
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        self.steps += 1;
        if self.world == World::Failing && self.steps == 3 {
            return Err(SimulatorError::Engine("it stops at its third step".to_owned()));
        }
        let luck = self.seed.index(self.steps).stream().random::<f64>();
        (reward_terms[0], self.state) = self.world.step(self.state, action[0], self.last, luck);
        self.last = Some(action[0]);
        observation.fill(0.0);
        observation[self.state] = 1.0;
        Ok(if self.world.ends(self.steps) { End::Terminated } else { End::Running })
    }

    fn state(&self) -> Result<State, SimulatorError> {
        Err(SimulatorError::Unsupported("telling a state"))
    }
}
