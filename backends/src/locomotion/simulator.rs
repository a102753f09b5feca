//! A robot with legs on a floor, in any engine: reset, observation, reward terms and ends.

use elo_core::seed::Seed;
use elo_core::simulator::{End, Simulator, SimulatorError, Start, State, check_action, check_length};
use elo_core::spec::SimulatorSpec;
use elo_core::task::Task;
use rand::RngExt as _;

use super::body::{ArticulatedBody, Dynamics, Reading};
use super::model::RobotModel;
use super::observation::{Remembered, Stance, normalised, observe};
use super::reward;

/// The simulator of `model`'s robot in the engine `B`.
///
/// The standard reset is the file's pose at rest with each actuated joint moved by an own uniform draw from
/// ±`reset_noise`, in the order of the actuators.
///
/// [`State::memory`] holds the torso's height at the standard reset; then one flag (0 or 1) a foot, as the present
/// observation shows them; then one flag a body (in the order of the file): whether it touched the floor when the
/// present step ended, which the next observation and the next alive term use.
#[derive(Debug)]
pub struct Locomotion<B> {
    body: B,
    model: RobotModel,
    spec: SimulatorSpec,
    dynamics: Option<Dynamics>,
    phase: Phase,
    elapsed: u64,
    memory: Memory,
    // What a step works on, kept so that it allocates nothing.
    reading: Reading,
    torques: Vec<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Before the first reset, or after the engine failed.
    Nowhere,
    Running,
    Ended,
}

/// What observation and reward remember.
#[derive(Debug)]
struct Memory {
    /// The torso's height at the standard reset, in m.
    height: f64,
    /// Foot contacts as the present observation shows them.
    shown: Vec<bool>,
    /// Floor contacts of all bodies at the end of the present step.
    on_floor: Vec<bool>,
    /// Progress potential of the present coordinates; follows from them.
    potential: f64,
}

impl<B: ArticulatedBody> Locomotion<B> {
    /// The simulator; `body` must be of the same file.
    pub fn new(model: RobotModel, body: B) -> Self {
        let (bodies, joints) = (model.bodies.len(), model.joints.len());
        Self {
            body,
            spec: model.spec(),
            dynamics: None,
            phase: Phase::Nowhere,
            elapsed: 0,
            memory: Memory {
                height: 0.0,
                shown: vec![false; model.feet.len()],
                on_floor: vec![false; bodies],
                potential: 0.0,
            },
            reading: Reading::sized(bodies, joints),
            torques: vec![0.0; joints],
            model,
        }
    }

    /// The engine, e.g. to ask it for what only it knows.
    pub fn body(&self) -> &B {
        &self.body
    }

    fn set_task(&mut self, task: &Task) -> Result<(), SimulatorError> {
        if let Some(fault) = self.spec.task_faults(task).into_iter().next() {
            return Err(SimulatorError::Task(fault));
        }
        let dynamics = Dynamics {
            floor_friction: self.spec.parameter_value(task, "floor_friction"),
            payload: self.spec.parameter_value(task, "payload"),
        };
        if self.dynamics != Some(dynamics) {
            self.dynamics = None;
            self.body.set_dynamics(&dynamics)?;
            self.dynamics = Some(dynamics);
        }
        Ok(())
    }

    /// The standard reset's coordinates; `memory` and `elapsed` follow once the engine has taken them.
    fn standard(&self, seed: u64) -> State {
        let mut positions = self.model.standard_positions.clone();
        let mut stream = Seed::root(seed).stream();
        for joint in &self.model.joints {
            positions[joint.position] +=
                (stream.random::<f64>() * 2.0 - 1.0) * self.model.description.reset_noise;
        }
        State { positions, velocities: vec![0.0; self.model.velocity_count], memory: Vec::new(), elapsed: 0 }
    }

    fn check_state(&self, state: &State) -> Result<(), SimulatorError> {
        check_length("positions", state.positions.len(), self.model.standard_positions.len())?;
        check_length("velocities", state.velocities.len(), self.model.velocity_count)?;
        let flags = self.model.feet.len() + self.model.bodies.len();
        check_length("memory", state.memory.len(), 1 + flags)?;
        let numbers = state.positions.iter().chain(&state.velocities).chain(&state.memory);
        if let Some(bad) = numbers.copied().find(|x| !x.is_finite()) {
            return Err(SimulatorError::Start(format!("a coordinate is {bad}")));
        }
        if let Some(flag) = state.memory[1..].iter().find(|&&x| x != 0.0 && x != 1.0) {
            return Err(SimulatorError::Start(format!("a contact flag is {flag}, expected 0 or 1")));
        }
        if let Some(first) = self.model.root_quaternion {
            let square: f64 = state.positions[first..first + 4].iter().map(|x| x * x).sum();
            if (square - 1.0).abs() > 1e-3 {
                return Err(SimulatorError::Start(format!(
                    "the root's quaternion has length {}",
                    square.sqrt()
                )));
            }
        }
        Ok(())
    }

    fn stance(&mut self) -> Stance {
        self.body.read(&mut self.reading);
        Stance::of(&self.model, &self.reading)
    }

    fn observe(&self, stance: &Stance, observation: &mut [f32]) {
        let remembered = Remembered { height: self.memory.height, feet: &self.memory.shown };
        observe(&self.model, &self.reading, stance, remembered, observation);
    }

    fn potential(&self, stance: &Stance) -> f64 {
        reward::potential(stance.place, self.spec.control_step)
    }

    /// Whether the robot stands, given the contacts of the previous step.
    fn stands(&self, stance: &Stance) -> bool {
        let rule = &self.model.description.alive;
        rule.min_height.is_none_or(|least| stance.height > least)
            && rule.max_pitch.is_none_or(|most| stance.angles[1].abs() < most)
            && !self.model.no_floor_contact.iter().any(|&body| self.memory.on_floor[body])
    }

    /// One control step in the engine; `action` has been checked.
    fn advance(&mut self, action: &[f32]) -> Result<Stance, SimulatorError> {
        let scale = self.model.description.torque_scale;
        for ((torque, joint), &a) in self.torques.iter_mut().zip(&self.model.joints).zip(action) {
            *torque = joint.gear * scale * f64::from(a).clamp(joint.control[0], joint.control[1]);
        }
        self.body.advance(&self.torques)?;
        let stance = self.stance();
        let numbers = [stance.height, stance.place[0], stance.place[1], stance.angles[1]];
        let joints = self.reading.joint_positions.iter().chain(&self.reading.joint_velocities);
        if numbers.iter().chain(joints).all(|x| x.is_finite()) {
            Ok(stance)
        } else {
            Err(SimulatorError::Unstable("a coordinate is not finite".to_owned()))
        }
    }

    /// The step's reward terms; `memory` is still the previous step's.
    fn reward(&self, action: &[f32], stance: &Stance, terms: &mut [f64]) {
        let positions = self.model.joints.iter().zip(&self.reading.joint_positions);
        terms.copy_from_slice(&[
            if self.stands(stance) { 1.0 } else { -1.0 },
            self.potential(stance) - self.memory.potential,
            reward::electricity(action, &self.reading.joint_velocities),
            reward::stall(action),
            reward::joints_at_limit(positions.map(|(joint, &q)| normalised(joint, q))),
            0.0,
        ]);
    }
}

impl<B: ArticulatedBody> Simulator for Locomotion<B> {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        self.phase = Phase::Nowhere;
        check_length("observation", observation.len(), self.spec.observation_size)?;
        self.set_task(task)?;
        let state = match start {
            Start::Seed(seed) => &self.standard(*seed),
            Start::State(state) => {
                self.check_state(state)?;
                state
            }
        };
        self.body.restore(&state.positions, &state.velocities)?;
        let stance = self.stance();
        let flags = self.memory.shown.iter_mut().chain(&mut self.memory.on_floor);
        if let [height, remembered @ ..] = &state.memory[..] {
            self.memory.height = *height;
            flags.zip(remembered).for_each(|(flag, &x)| *flag = x == 1.0);
        } else {
            self.memory.height = stance.height;
            flags.for_each(|flag| *flag = false);
        }
        self.memory.potential = self.potential(&stance);
        self.elapsed = state.elapsed;
        self.phase = Phase::Running;
        self.observe(&stance, observation);
        Ok(())
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        check_length("action", action.len(), self.spec.action_size())?;
        check_length("observation", observation.len(), self.spec.observation_size)?;
        check_length("reward terms", reward_terms.len(), self.spec.reward_terms.len())?;
        check_action(action)?;
        if self.phase != Phase::Running {
            return Err(SimulatorError::NoEpisode);
        }
        self.phase = Phase::Nowhere;
        let stance = self.advance(action)?;
        self.reward(action, &stance, reward_terms);
        for (shown, &foot) in self.memory.shown.iter_mut().zip(&self.model.feet) {
            *shown = self.memory.on_floor[foot];
        }
        self.observe(&stance, observation);
        self.memory.on_floor.copy_from_slice(&self.reading.on_floor);
        self.memory.potential = self.potential(&stance);
        self.elapsed += 1;
        let fallen = reward_terms[0] < 0.0;
        self.phase = if fallen { Phase::Ended } else { Phase::Running };
        Ok(if fallen { End::Terminated } else { End::Running })
    }

    fn state(&self) -> Result<State, SimulatorError> {
        if self.phase == Phase::Nowhere {
            return Err(SimulatorError::NoEpisode);
        }
        let mut positions = vec![0.0; self.model.standard_positions.len()];
        let mut velocities = vec![0.0; self.model.velocity_count];
        self.body.coordinates(&mut positions, &mut velocities);
        let flags = self.memory.shown.iter().chain(&self.memory.on_floor);
        let flags = flags.map(|&flag| f64::from(u8::from(flag)));
        let memory = std::iter::once(self.memory.height).chain(flags).collect();
        Ok(State { positions, velocities, memory, elapsed: self.elapsed })
    }
}
