//! A robot with legs on a floor, in any engine: reset, observation, reward terms and ends.

use elo_core::scene::{Pose, Scene, Visible};
use elo_core::seed::Seed;
use elo_core::simulator::{End, Simulator, SimulatorError, Start, State, check_action, check_length};
use elo_core::spec::SimulatorSpec;
use elo_core::task::Task;
use rand::RngExt as _;

use super::body::{ArticulatedBody, Dynamics, Reading};
use super::model::RobotModel;
use super::observation::{Remembered, Stance, normalised, observe};
use super::reward;
use super::scene;

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
    /// Before the first reset, or after an error.
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
        let phase = std::mem::replace(&mut self.phase, Phase::Nowhere);
        check_length("action", action.len(), self.spec.action_size())?;
        check_length("observation", observation.len(), self.spec.observation_size)?;
        check_length("reward terms", reward_terms.len(), self.spec.reward_terms.len())?;
        check_action(action)?;
        if phase != Phase::Running {
            // The state of an end can still be read.
            self.phase = phase;
            return Err(SimulatorError::NoEpisode);
        }
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

    fn visible(&self) -> Option<&dyn Visible> {
        Some(self)
    }
}

impl<B: ArticulatedBody> Visible for Locomotion<B> {
    fn scene(&self) -> Scene {
        scene::of(&self.model)
    }

    fn poses(&self) -> Result<Vec<Pose>, SimulatorError> {
        if self.phase == Phase::Nowhere {
            return Err(SimulatorError::NoEpisode);
        }
        Ok(scene::poses(&self.model, &self.reading))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::robot::built_in;
    use super::*;

    /// HalfCheetah as a toy: all bodies sit at the root, which each step moves 0.0165 m forward (1 m/s) and turns by the
    /// first torque, in rad per kN m; in the steps of `landed` the body with that number is on the floor.
    #[derive(Debug, Default)]
    struct Toy {
        positions: Vec<f64>,
        velocities: Vec<f64>,
        torques: Vec<f64>,
        steps: usize,
        landed: Vec<Option<usize>>,
        dynamics: Vec<Dynamics>,
        unstable_at: Option<usize>,
    }

    impl ArticulatedBody for Toy {
        fn set_dynamics(&mut self, dynamics: &Dynamics) -> Result<(), SimulatorError> {
            self.dynamics.push(*dynamics);
            Ok(())
        }

        fn restore(&mut self, positions: &[f64], velocities: &[f64]) -> Result<(), SimulatorError> {
            (self.positions, self.velocities) = (positions.to_vec(), velocities.to_vec());
            Ok(())
        }

        fn advance(&mut self, torques: &[f64]) -> Result<(), SimulatorError> {
            self.torques = torques.to_vec();
            self.steps += 1;
            self.positions[0] += 0.0165;
            self.positions[2] += torques[0] / 1000.0;
            if self.unstable_at == Some(self.steps) {
                return Err(SimulatorError::Unstable("as asked".to_owned()));
            }
            Ok(())
        }

        fn read(&self, reading: &mut Reading) {
            let half = self.positions[2] / 2.0;
            let position = [self.positions[0], 0.0, 0.7 + self.positions[1]];
            reading.bodies.fill(Pose { position, rotation: [half.cos(), 0.0, half.sin(), 0.0] });
            reading.joint_positions.copy_from_slice(&self.positions[3..]);
            reading.joint_velocities.copy_from_slice(&self.velocities[3..]);
            let landed = self.steps.checked_sub(1).and_then(|step| *self.landed.get(step)?);
            (0..7).for_each(|body| reading.on_floor[body] = Some(body) == landed);
        }

        fn coordinates(&self, positions: &mut [f64], velocities: &mut [f64]) {
            positions.copy_from_slice(&self.positions);
            velocities.copy_from_slice(&self.velocities);
        }
    }

    const BFOOT: usize = 3;
    const FSHIN: usize = 5;

    fn toy(landed: &[Option<usize>]) -> Locomotion<Toy> {
        let model = RobotModel::load(&built_in("half-cheetah").unwrap()).unwrap();
        Locomotion::new(model, Toy { landed: landed.to_vec(), ..Toy::default() })
    }

    fn begin(simulator: &mut Locomotion<Toy>) -> Vec<f32> {
        let mut observation = vec![0.0; 26];
        simulator.reset(&Task::default(), &Start::Seed(1), &mut observation).unwrap();
        observation
    }

    fn step(simulator: &mut Locomotion<Toy>, action: [f32; 6]) -> (End, Vec<f32>, [f64; 6]) {
        let (mut observation, mut terms) = (vec![0.0; 26], [0.0; 6]);
        let end = simulator.step(&action, &mut observation, &mut terms).unwrap();
        (end, observation, terms)
    }

    #[test]
    fn contacts_are_shown_one_step_late_and_a_shin_on_the_floor_ends_the_next_step() {
        let mut simulator = toy(&[Some(BFOOT), Some(FSHIN), None]);
        assert_eq!(begin(&mut simulator)[20..], [0.0; 6]);
        let (end, observation, terms) = step(&mut simulator, [0.0; 6]);
        assert_eq!((end, &observation[20..], terms[0]), (End::Running, &[0.0; 6][..], 1.0));
        assert!((terms[1] - 1.0).abs() < 1e-9, "1 m/s, got {}", terms[1]);
        // Feet in the order of the observation: ffoot, fshin, fthigh, bfoot, bshin, bthigh.
        let (end, observation, terms) = step(&mut simulator, [0.0; 6]);
        assert_eq!(
            (end, &observation[20..], terms[0]),
            (End::Running, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0][..], 1.0)
        );
        let (end, observation, terms) = step(&mut simulator, [0.0; 6]);
        assert_eq!((end, observation[21], terms[0]), (End::Terminated, 1.0, -1.0));
        let mut observation = vec![0.0; 26];
        let after = simulator.step(&[0.0; 6], &mut observation, &mut [0.0; 6]);
        assert_eq!(after, Err(SimulatorError::NoEpisode));
        // The end's state can be taken up; what ended it is over.
        let state = simulator.state().unwrap();
        simulator.reset(&Task::default(), &Start::State(state), &mut observation).unwrap();
        assert_eq!(step(&mut simulator, [0.0; 6]).0, End::Running);
    }

    #[test]
    fn torques_are_clamped_and_terms_are_not() {
        let mut simulator = toy(&[]);
        begin(&mut simulator);
        let (end, observation, terms) = step(&mut simulator, [2.0, -3.0, 0.5, 0.0, 0.0, 0.0]);
        assert_eq!(simulator.body().torques, [108.0, -81.0, 27.0, 0.0, 0.0, 0.0]);
        assert!((terms[3] - (4.0 + 9.0 + 0.25) / 6.0).abs() < 1e-12, "{terms:?}");
        assert!((observation[7] - 0.108).abs() < 1e-6, "pitch {}", observation[7]);
        assert_eq!(end, End::Running);
        // Ten more of these turn it past 1 rad: 9 * 0.108 = 0.972 stands, 10 * 0.108 does not.
        let ends: Vec<End> = (0..9).map(|_| step(&mut simulator, [1.0; 6]).0).collect();
        assert_eq!((ends[7], ends[8]), (End::Running, End::Terminated));
    }

    #[test]
    fn the_standard_reset_moves_each_joint_by_its_own_draw() {
        let mut simulator = toy(&[]);
        let noise = |simulator: &mut Locomotion<Toy>, seed| {
            simulator.reset(&Task::default(), &Start::Seed(seed), &mut [0.0; 26]).unwrap();
            simulator.state().unwrap().positions
        };
        let all: Vec<f64> = (0..500).flat_map(|seed| noise(&mut simulator, seed)[3..].to_vec()).collect();
        assert!(all.iter().all(|x| x.abs() < 0.1));
        let mean = all.iter().sum::<f64>() / 3000.0;
        let square = all.iter().map(|x| x * x).sum::<f64>() / 3000.0;
        // A uniform draw from ±0.1: standard deviation of the mean 0.0577/sqrt(3000), mean square 0.1^2/3.
        assert!(mean.abs() < 4.0 * 0.0577 / 3000_f64.sqrt(), "{mean}");
        assert!((square - 0.01 / 3.0).abs() < 2.5e-4, "{square}");
        assert_eq!(noise(&mut simulator, 7), noise(&mut simulator, 7));
        assert_eq!(noise(&mut simulator, 7)[..3], [0.0; 3]);
    }

    #[test]
    fn a_start_from_a_state_goes_on_where_it_was_taken() {
        let mut simulator = toy(&[None, Some(BFOOT), None, Some(BFOOT)]);
        begin(&mut simulator);
        (0..2).for_each(|_| drop(step(&mut simulator, [0.3; 6])));
        let state = simulator.state().unwrap();
        assert_eq!((state.elapsed, state.memory.len()), (2, 1 + 6 + 7));
        let expected = step(&mut simulator, [0.3; 6]);
        simulator.body.steps = 2;
        let mut observation = vec![0.0; 26];
        simulator.reset(&Task::default(), &Start::State(state.clone()), &mut observation).unwrap();
        assert_eq!(simulator.state().unwrap(), state);
        assert_eq!(step(&mut simulator, [0.3; 6]), expected);
    }

    #[test]
    fn wrong_calls_are_errors_that_a_reset_cures() {
        let mut simulator = toy(&[]);
        let (mut observation, mut terms) = (vec![0.0; 26], [0.0; 6]);
        assert_eq!(simulator.state(), Err(SimulatorError::NoEpisode));
        assert_eq!(simulator.step(&[0.0; 6], &mut observation, &mut terms), Err(SimulatorError::NoEpisode));
        begin(&mut simulator);
        let wrong = simulator.step(&[0.0; 5], &mut observation, &mut terms);
        assert_eq!(wrong, Err(SimulatorError::Length { what: "action", got: 5, expected: 6 }));
        assert_eq!(simulator.step(&[0.0; 6], &mut observation, &mut terms), Err(SimulatorError::NoEpisode));
        begin(&mut simulator);
        let wrong = simulator.step(&[0.0; 6], &mut observation[..3], &mut terms);
        assert_eq!(wrong, Err(SimulatorError::Length { what: "observation", got: 3, expected: 26 }));
        begin(&mut simulator);
        let wrong = simulator.step(&[0.0, f32::NAN, 0.0, 0.0, 0.0, 0.0], &mut observation, &mut terms);
        assert!(matches!(wrong, Err(SimulatorError::NonFiniteAction { index: 1, .. })), "{wrong:?}");

        begin(&mut simulator);
        let state = simulator.state().unwrap();
        let mut bad = |change: fn(&mut State)| {
            let mut state = state.clone();
            change(&mut state);
            simulator.reset(&Task::default(), &Start::State(state), &mut [0.0; 26]).unwrap_err()
        };
        assert!(matches!(bad(|s| s.positions.push(0.0)), SimulatorError::Length { what: "positions", .. }));
        assert!(matches!(bad(|s| s.memory.truncate(3)), SimulatorError::Length { what: "memory", .. }));
        assert!(matches!(bad(|s| s.velocities[2] = f64::INFINITY), SimulatorError::Start(_)));
        assert!(matches!(bad(|s| s.memory[2] = 0.5), SimulatorError::Start(_)));
        let dear = Task::new([("friction", 1.0)]);
        let wrong = simulator.reset(&dear, &Start::Seed(0), &mut observation);
        assert!(matches!(wrong, Err(SimulatorError::Task(_))), "{wrong:?}");
        begin(&mut simulator);
        simulator.body.unstable_at = Some(simulator.body.steps + 1);
        let wrong = simulator.step(&[0.0; 6], &mut observation, &mut terms);
        assert!(matches!(wrong, Err(SimulatorError::Unstable(_))), "{wrong:?}");
        assert_eq!(simulator.state(), Err(SimulatorError::NoEpisode));
        begin(&mut simulator);
        assert_eq!(step(&mut simulator, [0.0; 6]).0, End::Running);
    }

    #[test]
    fn the_engine_is_told_of_dynamics_only_when_they_change() {
        let mut simulator = toy(&[]);
        let slippery = Task::new([("floor_friction", 0.1), ("payload", 2.0)]);
        for task in [Task::default(), Task::new([("electricity_cost", -1.5)]), slippery.clone(), slippery] {
            simulator.reset(&task, &Start::Seed(0), &mut [0.0; 26]).unwrap();
        }
        let expected =
            [Dynamics { floor_friction: 0.64, payload: 0.0 }, Dynamics { floor_friction: 0.1, payload: 2.0 }];
        assert_eq!(simulator.body().dynamics, expected);
    }
}
