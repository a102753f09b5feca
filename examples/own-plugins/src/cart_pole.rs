//! A simulator of one's own: a pole hinged to a cart on a rail (Barto, Sutton and Anderson 1983), without friction.

use elo_core::fault::Faults;
use elo_core::seed::Seed;
use elo_core::simulator::{
    BuildError, End, Engine, Simulator, SimulatorConfig, SimulatorError, Start, State, check_action,
    check_length,
};
use elo_core::spec::{Capabilities, Effect, RewardTerm, SimulatorSpec, TaskParameter, Weight};
use elo_core::task::Task;
use rand::RngExt as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A pole hinged to a cart that a force pushes along a rail.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CartPoleConfig {
    /// Force on the cart at action 1, in N; must be positive.
    pub force: f64,
    /// The episode terminates when the pole leans more than this to either side, in rad; between 0.1 and 1.5.
    #[schemars(range(min = 0.1, max = 1.5))]
    pub fall_angle: f64,
    /// The standard reset puts position (m), angle (rad) and their velocities uniformly within this distance of 0.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub reset_spread: f64,
}

impl Default for CartPoleConfig {
    fn default() -> Self {
        Self { force: 10.0, fall_angle: 0.7, reset_spread: 0.05 }
    }
}

/// Simulated seconds of one control step, which is one step of semi-implicit Euler.
const CONTROL_STEP: f64 = 0.02;
/// Half the length of the rail in m; beyond it the episode terminates.
const RAIL: f64 = 2.4;
/// In kg.
const CART_MASS: f64 = 1.0;
/// In kg, spread evenly over the pole.
const POLE_MASS: f64 = 0.1;
/// In m/s².
const GRAVITY: f64 = 9.8;

const POLE_LENGTH: &str = "pole_length";
const EFFORT_COST: &str = "effort_cost";

fn description() -> SimulatorSpec {
    let term = |name: &str, weight| RewardTerm { name: name.to_owned(), weight };
    let parameter = |name: &str, (low, default, high), effect| TaskParameter {
        name: name.to_owned(),
        default,
        low,
        high,
        effect,
    };
    SimulatorSpec {
        robot: "cart-pole".to_owned(),
        observation_size: 5,
        action_low: vec![-1.0],
        action_high: vec![1.0],
        control_step: CONTROL_STEP,
        reward_terms: vec![
            term("upright", Weight::Constant(1.0)),
            term("squared_distance", Weight::Constant(-0.1)),
            term("effort", Weight::Parameter(EFFORT_COST.to_owned())),
        ],
        task_parameters: vec![
            parameter(EFFORT_COST, (-10.0, -0.1, 0.0), Effect::Reward),
            parameter(POLE_LENGTH, (0.5, 1.0, 2.0), Effect::Dynamics),
        ],
        reward_floor: -12.0,
        capabilities: Capabilities { settable_state: true },
    }
}

#[typetag::serde(name = "cart_pole")]
impl SimulatorConfig for CartPoleConfig {
    fn validate(&self, faults: &mut Faults) {
        faults.check(self.force > 0.0 && self.force.is_finite(), "force", || {
            format!("expected a positive number, got {}", self.force)
        });
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Ok(description())
    }

    fn engine(&self) -> Engine {
        Engine { name: "cart_pole".to_owned(), version: "1".to_owned() }
    }

    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        Ok(Box::new(CartPole {
            config: self.clone(),
            spec: description(),
            pole_length: 1.0,
            position: [0.0; 2],
            velocity: [0.0; 2],
            elapsed: None,
            running: false,
        }))
    }
}

/// The running world. Position and velocity are those of the cart (m) and of the pole's angle (rad, 0 is upright).
#[derive(Clone, Debug)]
struct CartPole {
    config: CartPoleConfig,
    spec: SimulatorSpec,
    pole_length: f64,
    position: [f64; 2],
    velocity: [f64; 2],
    /// Control steps since the standard reset; `None` before the first.
    elapsed: Option<u64>,
    running: bool,
}

impl CartPole {
    /// Accelerations of cart and pole under `force`: the equations of Barto, Sutton and Anderson (1983), appendix.
    fn acceleration(&self, force: f64) -> [f64; 2] {
        let (half, total) = (self.pole_length / 2.0, CART_MASS + POLE_MASS);
        let (sin, cos) = self.position[1].sin_cos();
        let pushed = (force + POLE_MASS * half * self.velocity[1].powi(2) * sin) / total;
        let turn = (GRAVITY * sin - cos * pushed) / (half * (4.0 / 3.0 - POLE_MASS * cos * cos / total));
        [pushed - POLE_MASS * half * turn * cos / total, turn]
    }

    fn observe(&self, observation: &mut [f32]) {
        let (sin, cos) = self.position[1].sin_cos();
        let seen = [self.position[0], self.velocity[0], sin, cos, self.velocity[1]];
        for (to, from) in observation.iter_mut().zip(seen) {
            *to = from as f32;
        }
    }
}

impl Simulator for CartPole {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        self.running = false;
        check_length("observation", observation.len(), self.spec.observation_size)?;
        if let Some(fault) = self.spec.task_faults(task).into_iter().next() {
            return Err(SimulatorError::Task(fault));
        }
        let (position, velocity, elapsed) = match start {
            Start::Seed(seed) => {
                let mut stream = Seed::root(*seed).stream();
                let mut draw = || (stream.random::<f64>() * 2.0 - 1.0) * self.config.reset_spread;
                ([draw(), draw()], [draw(), draw()], 0)
            }
            Start::State(state) => {
                check_length("memory", state.memory.len(), 0)?;
                (pair("positions", &state.positions)?, pair("velocities", &state.velocities)?, state.elapsed)
            }
        };
        (self.position, self.velocity, self.elapsed) = (position, velocity, Some(elapsed));
        self.pole_length = self.spec.parameter_value(task, POLE_LENGTH);
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
        // Until the step has succeeded, only `reset` may follow.
        let Some(elapsed) = self.elapsed.filter(|_| std::mem::take(&mut self.running)) else {
            return Err(SimulatorError::NoEpisode);
        };
        check_length("action", action.len(), 1)?;
        check_length("observation", observation.len(), self.spec.observation_size)?;
        check_length("reward terms", reward_terms.len(), self.spec.reward_terms.len())?;
        check_action(action)?;
        let push = f64::from(action[0].clamp(-1.0, 1.0));
        let acceleration = self.acceleration(self.config.force * push);
        let motion = self.velocity.iter_mut().zip(&mut self.position);
        for ((velocity, position), acceleration) in motion.zip(acceleration) {
            *velocity += acceleration * CONTROL_STEP;
            *position += *velocity * CONTROL_STEP;
        }
        self.elapsed = Some(elapsed + 1);
        let [place, angle] = self.position;
        if !(place.is_finite() && angle.is_finite()) {
            return Err(SimulatorError::Unstable(format!(
                "the cart is at {place} m, the pole at {angle} rad"
            )));
        }
        self.observe(observation);
        reward_terms.copy_from_slice(&[angle.cos(), place * place, push * push]);
        let fallen = angle.abs() > self.config.fall_angle || place.abs() > RAIL;
        self.running = !fallen;
        Ok(if fallen { End::Terminated } else { End::Running })
    }

    fn state(&self) -> Result<State, SimulatorError> {
        let elapsed = self.elapsed.ok_or(SimulatorError::NoEpisode)?;
        let (positions, velocities) = (self.position.to_vec(), self.velocity.to_vec());
        Ok(State { positions, velocities, memory: Vec::new(), elapsed })
    }
}

fn pair(what: &'static str, numbers: &[f64]) -> Result<[f64; 2], SimulatorError> {
    check_length(what, numbers.len(), 2)?;
    if numbers.iter().any(|number| !number.is_finite()) {
        return Err(SimulatorError::Start(format!("a number of the {what} is not finite")));
    }
    Ok([numbers[0], numbers[1]])
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use elo_core::conformance::simulator;

    #[test]
    fn it_keeps_every_rule_of_simulators() {
        let case = simulator::Case::new(Box::new(CartPoleConfig::default()));
        let report = simulator::run(&case);
        // That check needs a counting allocator in the test program.
        assert_eq!(report.skipped(), ["steps_allocate_nothing", "scene_follows_the_state"], "{report}");
        assert!(report.failed().is_empty(), "{report}");
    }

    #[test]
    fn a_pole_at_rest_begins_to_fall_as_the_equations_say() {
        // Half length 0.5 m: 9.8 sin θ / (0.5 (4/3 - 0.1 cos² θ / 1.1)), by hand for θ = 0.1: 0.97837 / 0.62166.
        let mut world = CartPoleConfig::default().build().unwrap();
        let start = State { positions: vec![0.0, 0.1], velocities: vec![0.0; 2], ..State::default() };
        let (mut observation, mut terms) = ([0.0; 5], [0.0; 3]);
        world.reset(&Task::default(), &Start::State(start), &mut observation).unwrap();
        world.step(&[0.0], &mut observation, &mut terms).unwrap();
        assert!((f64::from(observation[4]) / CONTROL_STEP - 1.5738).abs() < 1e-4, "{observation:?}");
    }

    #[test]
    fn a_short_pole_falls_sooner() {
        let falls_after = |length: f64| {
            let mut world = CartPoleConfig::default().build().unwrap();
            let task = Task::new([(POLE_LENGTH, length)]);
            let (mut observation, mut terms) = ([0.0; 5], [0.0; 3]);
            world.reset(&task, &Start::Seed(1), &mut observation).unwrap();
            (1..1000)
                .find(|_| world.step(&[0.0], &mut observation, &mut terms).unwrap() == End::Terminated)
                .unwrap()
        };
        assert!(falls_after(0.5) < falls_after(2.0));
    }
}
