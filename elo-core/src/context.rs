//! Contexts `C = (τ, s0)` (§4.1) and the initial-state distribution `d0` (§5.1).
//!
//! Context `j` of a split is a pure function of the run's seed, the split and `j`: every candidate meets the same
//! contexts, so comparisons are paired, and a start is prepared once however many options begin there.

use rand::RngExt as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::agent::{Agent, RandomTorque};
use crate::fault::Faults;
use crate::seed::{Seed, Stream};
use crate::simulator::{End, Simulator, SimulatorError, Start};
use crate::spec::SimulatorSpec;
use crate::task::Task;

/// The disjoint streams of contexts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// For ranking candidates.
    Select,
    /// For every figure that is reported: neither candidates nor sets have been chosen by these.
    Report,
}

impl Split {
    /// The split's name in seeds, files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Select => "select",
            Self::Report => "report",
        }
    }

    /// The root of the split's streams in a run.
    pub fn seed(self, run: &Seed) -> Seed {
        run.child("contexts").child(self.name())
    }
}

/// One task and one start, ready to begin from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Context {
    /// `τ`.
    pub task: Task,
    /// `s0`.
    pub start: PreparedStart,
}

/// A start state, and how it came about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PreparedStart {
    /// Where to reset to.
    pub start: Start,
    /// Actions to replay after the reset, one row each; empty where the simulator can be set to the state itself.
    pub prefix: Vec<Vec<f32>>,
    /// Control steps of the random policy that led here.
    pub random_steps: u32,
    /// How often the random policy fell and was drawn again.
    pub redraws: u32,
}

impl PreparedStart {
    /// The standard reset numbered `seed`, with no random steps.
    pub fn standard(seed: u64) -> Self {
        Self { start: Start::Seed(seed), prefix: Vec::new(), random_steps: 0, redraws: 0 }
    }

    /// Puts `simulator` there and writes the observation.
    ///
    /// # Errors
    /// The simulator's; also when a replayed prefix ends the episode, which a deterministic simulator never does.
    pub fn begin(
        &self,
        simulator: &mut dyn Simulator,
        task: &Task,
        observation: &mut [f32],
    ) -> Result<(), SimulatorError> {
        simulator.reset(task, &self.start, observation)?;
        let mut terms = vec![0.0; simulator.spec().reward_terms.len()];
        for action in &self.prefix {
            if simulator.step(action, observation, &mut terms)? != End::Running {
                return Err(SimulatorError::Start(
                    "replaying the start's actions ended the episode".to_owned(),
                ));
            }
        }
        Ok(())
    }
}

/// `d0`: the standard pose, then a uniformly random policy for `t ~ U{0..max_random_steps}` control steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InitialStates {
    /// The greatest number of random control steps before a context begins. The paper uses 100 (§5.1).
    #[schemars(range(max = 100000))]
    pub max_random_steps: u32,
    /// What happens when the random policy falls before its steps are over; the paper does not say.
    pub on_termination: OnTermination,
    /// After this many falls in a row the context is given up with an error.
    #[schemars(range(min = 1))]
    pub max_redraws: u32,
}

impl Default for InitialStates {
    fn default() -> Self {
        Self { max_random_steps: 100, on_termination: OnTermination::Redraw, max_redraws: 10_000 }
    }
}

/// What to do with a random policy that falls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnTermination {
    /// Draw length and actions again until the robot survives; redraws are counted.
    Redraw,
    /// Keep going from the fallen state. Needs a simulator whose state can be set.
    Ignore,
    /// Start one step before the fall.
    Truncate,
}

impl InitialStates {
    /// Checks the fields against what the simulator can do.
    pub fn validate(&self, spec: &SimulatorSpec, faults: &mut Faults) {
        let possible = self.on_termination != OnTermination::Ignore || spec.capabilities.settable_state;
        faults.check(possible, "on_termination", || {
            "\"ignore\" needs a simulator whose state can be set; use \"redraw\" or \"truncate\"".to_owned()
        });
    }

    /// Draws one start under `task`. Leaves `simulator` anywhere.
    ///
    /// Costs about `max_random_steps / 2` control steps, times the redraws.
    ///
    /// # Errors
    /// The simulator's; also when the random policy fell `max_redraws` times in a row.
    pub fn draw(
        &self,
        simulator: &mut dyn Simulator,
        task: &Task,
        seed: &Seed,
    ) -> Result<PreparedStart, SimulatorError> {
        for redraws in 0..self.max_redraws {
            let seed = seed.index(u64::from(redraws));
            let steps = seed.child("length").stream().random_range(0..=self.max_random_steps);
            let attempt = Attempt { start: Start::Seed(seed.child("reset").number()), steps, redraws };
            let survived =
                attempt.run(simulator, task, &seed, self.on_termination == OnTermination::Ignore)?;
            match (survived == steps, self.on_termination) {
                (true, _) => return attempt.prepared(simulator, &seed, steps),
                (false, OnTermination::Truncate) => {
                    let before = Attempt { steps: survived, ..attempt };
                    before.run(simulator, task, &seed, false)?;
                    return before.prepared(simulator, &seed, survived);
                }
                (false, _) => {}
            }
        }
        Err(SimulatorError::Start(format!(
            "the random policy fell {} times in a row; lower `max_random_steps` or choose another `on_termination`",
            self.max_redraws
        )))
    }
}

/// One try at reaching a start.
struct Attempt {
    start: Start,
    steps: u32,
    redraws: u32,
}

impl Attempt {
    /// Runs the random policy; returns how many steps the robot survived.
    fn run(
        &self,
        simulator: &mut dyn Simulator,
        task: &Task,
        seed: &Seed,
        past_falls: bool,
    ) -> Result<u32, SimulatorError> {
        let mut observation = vec![0.0; simulator.spec().observation_size];
        let mut terms = vec![0.0; simulator.spec().reward_terms.len()];
        simulator.reset(task, &self.start, &mut observation)?;
        for (step, action) in self.actions(simulator.spec(), seed).iter().enumerate() {
            if simulator.step(action, &mut observation, &mut terms)? != End::Running {
                if !past_falls {
                    return Ok(step as u32);
                }
                continue_past_end(simulator, task, &mut observation)?;
            }
        }
        Ok(self.steps)
    }

    fn actions(&self, spec: &SimulatorSpec, seed: &Seed) -> Vec<Vec<f32>> {
        let mut stream: Stream = seed.child("actions").stream();
        let mut policy = RandomTorque::new(spec);
        let mut action = || {
            let mut action = vec![0.0; spec.action_size()];
            policy.act(&[], &mut stream, &mut action);
            action
        };
        (0..self.steps).map(|_| action()).collect()
    }

    fn prepared(
        &self,
        simulator: &dyn Simulator,
        seed: &Seed,
        random_steps: u32,
    ) -> Result<PreparedStart, SimulatorError> {
        let (start, prefix) = if simulator.spec().capabilities.settable_state {
            (Start::State(simulator.state()?), Vec::new())
        } else {
            (self.start.clone(), self.actions(simulator.spec(), seed))
        };
        Ok(PreparedStart { start, prefix, random_steps, redraws: self.redraws })
    }
}

/// Takes an episode up again where it ended.
///
/// # Errors
/// The simulator's; [`SimulatorError::Unsupported`] where its state cannot be set.
pub fn continue_past_end(
    simulator: &mut dyn Simulator,
    task: &Task,
    observation: &mut [f32],
) -> Result<(), SimulatorError> {
    let state = simulator.state()?;
    simulator.reset(task, &Start::State(state), observation)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::conformance::point_mass::{PointMassConfig, replay_only};
    use crate::simulator::SimulatorConfig as _;

    fn first_observation(simulator: &mut dyn Simulator, start: &PreparedStart) -> Vec<f32> {
        let mut observation = vec![0.0; simulator.spec().observation_size];
        start.begin(simulator, &Task::default(), &mut observation).unwrap();
        observation
    }

    #[test]
    fn a_start_by_state_and_a_start_by_replay_are_the_same_place() {
        let mut settable = PointMassConfig::default().build().unwrap();
        let mut replayed = replay_only(PointMassConfig::default());
        let d0 = InitialStates { max_random_steps: 20, ..InitialStates::default() };
        for j in 0..20 {
            let seed = Split::Select.seed(&Seed::root(1)).index(j);
            let a = d0.draw(settable.as_mut(), &Task::default(), &seed).unwrap();
            let b = d0.draw(replayed.as_mut(), &Task::default(), &seed).unwrap();
            assert_eq!((a.random_steps, a.redraws), (b.random_steps, b.redraws));
            assert!(a.prefix.is_empty() && b.prefix.len() == b.random_steps as usize);
            let here = first_observation(settable.as_mut(), &a);
            assert_eq!(here, first_observation(replayed.as_mut(), &b));
        }
    }

    #[test]
    fn each_rule_for_falls_gives_the_start_that_it_promises() {
        // A wall so near that most random walks of up to 200 steps meet it.
        let mut simulator = PointMassConfig { wall: 0.4, ..PointMassConfig::default() }.build().unwrap();
        let draw = |simulator: &mut dyn Simulator, rule| {
            let d0 =
                InitialStates { max_random_steps: 200, on_termination: rule, ..InitialStates::default() };
            let starts: Vec<PreparedStart> = (0..40)
                .map(|j| d0.draw(simulator, &Task::default(), &Seed::root(2).index(j)).unwrap())
                .collect();
            starts
        };
        let redrawn = draw(simulator.as_mut(), OnTermination::Redraw);
        assert!(redrawn.iter().any(|s| s.redraws > 0));
        let truncated = draw(simulator.as_mut(), OnTermination::Truncate);
        assert!(truncated.iter().all(|s| s.redraws == 0));
        for start in redrawn.iter().chain(&truncated) {
            assert!(first_observation(simulator.as_mut(), start)[0].abs() < 0.4);
        }
        let ignored = draw(simulator.as_mut(), OnTermination::Ignore);
        assert!(ignored.iter().any(|s| first_observation(simulator.as_mut(), s)[0].abs() >= 0.4));
    }
}
