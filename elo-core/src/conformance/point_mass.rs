//! The smallest world with everything a simulator must have: a mass on a line, a force, a wall to run into.
//!
//! It is what the algorithm, the learners and the suites are tried on: a thousand steps take well under a millisecond,
//! and its motion can be worked out by hand.

use rand::RngExt as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fault::Faults;
use crate::scene::{Pose, Scene, Shape, Solid, Visible};
use crate::seed::Seed;
use crate::simulator::{
    BuildError, End, Engine, Simulator, SimulatorConfig, SimulatorError, Start, State, check_action,
    check_length,
};
use crate::spec::{Capabilities, Effect, RewardTerm, SimulatorSpec, TaskParameter, Weight};
use crate::task::Task;

/// A mass on a line that is paid for being near the origin and pays for effort (a toy for tests and first steps).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PointMassConfig {
    /// Distance from the origin at which the episode terminates, in m.
    #[schemars(range(min = 0.01))]
    pub wall: f64,
    /// The standard reset puts the mass uniformly within this distance of the origin, in m.
    #[schemars(range(min = 0.0))]
    pub reset_spread: f64,
}

impl Default for PointMassConfig {
    fn default() -> Self {
        Self { wall: 2.0, reset_spread: 0.1 }
    }
}

impl PointMassConfig {
    const CONTROL_STEP: f64 = 0.05;

    /// The spec, which does not depend on the fields.
    pub fn description(&self) -> SimulatorSpec {
        SimulatorSpec {
            robot: "point-mass".to_owned(),
            observation_size: 2,
            action_low: vec![-1.0],
            action_high: vec![1.0],
            control_step: Self::CONTROL_STEP,
            reward_terms: vec![
                RewardTerm { name: "closeness".to_owned(), weight: Weight::Constant(1.0) },
                RewardTerm { name: "effort".to_owned(), weight: Weight::Parameter("effort_cost".to_owned()) },
            ],
            task_parameters: vec![
                TaskParameter {
                    name: "effort_cost".to_owned(),
                    default: -0.1,
                    low: -10.0,
                    high: 0.0,
                    effect: Effect::Reward,
                },
                TaskParameter {
                    name: "mass".to_owned(),
                    default: 1.0,
                    low: 0.1,
                    high: 10.0,
                    effect: Effect::Dynamics,
                },
            ],
            reward_floor: -20.0,
            capabilities: Capabilities { settable_state: true },
        }
    }
}

#[typetag::serde(name = "point_mass")]
impl SimulatorConfig for PointMassConfig {
    fn validate(&self, faults: &mut Faults) {
        faults.check(self.wall > self.reset_spread, "wall", || {
            format!("expected more than reset_spread = {}, got {}", self.reset_spread, self.wall)
        });
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Ok(self.description())
    }

    fn engine(&self) -> Engine {
        Engine { name: "point_mass".to_owned(), version: "1".to_owned() }
    }

    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        Ok(Box::new(PointMass {
            config: self.clone(),
            spec: self.description(),
            mass: 1.0,
            state: State::default(),
            running: false,
        }))
    }
}

/// The running world. Positions and velocities hold one number each.
#[derive(Clone, Debug)]
pub struct PointMass {
    config: PointMassConfig,
    spec: SimulatorSpec,
    mass: f64,
    state: State,
    running: bool,
}

impl PointMass {
    fn observe(&self, observation: &mut [f32]) {
        observation[0] = self.state.positions[0] as f32;
        observation[1] = self.state.velocities[0] as f32;
    }
}

impl Simulator for PointMass {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        self.running = false;
        check_length("observation", observation.len(), 2)?;
        if let Some(fault) = self.spec.task_faults(task).into_iter().next() {
            return Err(SimulatorError::Task(fault));
        }
        self.state = match start {
            Start::Seed(seed) => {
                let x = (Seed::root(*seed).stream().random::<f64>() * 2.0 - 1.0) * self.config.reset_spread;
                State { positions: vec![x], velocities: vec![0.0], memory: Vec::new(), elapsed: 0 }
            }
            Start::State(state) => {
                check_length("positions", state.positions.len(), 1)?;
                check_length("velocities", state.velocities.len(), 1)?;
                check_length("memory", state.memory.len(), 0)?;
                if !(state.positions[0].is_finite() && state.velocities[0].is_finite()) {
                    return Err(SimulatorError::Start("a number of the state is not finite".to_owned()));
                }
                state.clone()
            }
        };
        self.mass = self.spec.parameter_value(task, "mass");
        self.running = true;
        self.observe(observation);
        Ok(())
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        if !std::mem::take(&mut self.running) {
            return Err(SimulatorError::NoEpisode);
        }
        check_length("action", action.len(), 1)?;
        check_length("observation", observation.len(), 2)?;
        check_length("reward terms", reward_terms.len(), 2)?;
        check_action(action)?;
        let force = f64::from(action[0].clamp(-1.0, 1.0));
        let h = PointMassConfig::CONTROL_STEP;
        self.state.velocities[0] += force / self.mass * h;
        self.state.positions[0] += self.state.velocities[0] * h;
        self.state.elapsed += 1;
        self.observe(observation);
        let x = self.state.positions[0];
        reward_terms[0] = 1.0 - x.abs();
        reward_terms[1] = f64::from(action[0] * action[0]);
        let fallen = x.abs() >= self.config.wall;
        self.running = !fallen;
        Ok(if fallen { End::Terminated } else { End::Running })
    }

    fn state(&self) -> Result<State, SimulatorError> {
        if self.state.positions.is_empty() { Err(SimulatorError::NoEpisode) } else { Ok(self.state.clone()) }
    }

    fn visible(&self) -> Option<&dyn Visible> {
        Some(self)
    }
}

/// A ball on the x axis.
impl Visible for PointMass {
    fn scene(&self) -> Scene {
        let solid = Solid { body: 0, pose: Pose::IDENTITY, shape: Shape::Sphere { radius: 0.05 } };
        Scene { bodies: vec!["mass".to_owned()], solids: vec![solid], floor: false }
    }

    fn poses(&self) -> Result<Vec<Pose>, SimulatorError> {
        let x = *self.state.positions.first().ok_or(SimulatorError::NoEpisode)?;
        Ok(vec![Pose { position: [x, 0.0, 0.0], ..Pose::IDENTITY }])
    }
}

/// The same world without settable states, for what must also work there.
pub fn replay_only(config: PointMassConfig) -> Box<dyn Simulator> {
    let mut spec = config.description();
    spec.capabilities.settable_state = false;
    let inner = PointMass { spec, mass: 1.0, state: State::default(), running: false, config };
    Box::new(ReplayOnly(inner))
}

struct ReplayOnly(PointMass);

impl Simulator for ReplayOnly {
    fn spec(&self) -> &SimulatorSpec {
        self.0.spec()
    }

    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        match start {
            Start::Seed(_) => self.0.reset(task, start, observation),
            Start::State(_) => Err(SimulatorError::Unsupported("setting a state")),
        }
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        self.0.step(action, observation, reward_terms)
    }

    fn state(&self) -> Result<State, SimulatorError> {
        Err(SimulatorError::Unsupported("reading a state"))
    }

    fn visible(&self) -> Option<&dyn Visible> {
        self.0.visible()
    }
}
