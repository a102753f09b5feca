//! What a physics engine must do for a robot; everything above it (observation, reward, reset, ends) exists once.

use elo_core::scene::Pose;
use elo_core::simulator::SimulatorError;

/// One articulated robot on a floor, in an engine.
///
/// Generalised coordinates follow MuJoCo's `qpos` and `qvel` for the robot's MJCF file, whatever the engine uses inside:
/// a free root is position and unit quaternion (w first), its velocity the linear velocity of its frame's origin in world
/// axes and the angular velocity in its own axes; hinges are radians, slides metres, in the order of the file.
///
/// A trajectory is a function of (dynamics, coordinates, torques) alone, bit for bit.
pub trait ArticulatedBody: Send {
    /// Sets what a task may change about the world. Holds until the next call.
    ///
    /// # Errors
    /// A value that the engine cannot hold.
    fn set_dynamics(&mut self, dynamics: &Dynamics) -> Result<(), SimulatorError>;

    /// Forgets everything and puts the robot at these coordinates.
    ///
    /// # Errors
    /// Numbers that are not finite.
    fn restore(&mut self, positions: &[f64], velocities: &[f64]) -> Result<(), SimulatorError>;

    /// Advances one control step with a constant torque (N m) on each actuated joint, in the order of the file's
    /// actuators.
    ///
    /// # Errors
    /// [`SimulatorError::Unstable`] when the engine's numbers can no longer be trusted.
    fn advance(&mut self, torques: &[f64]) -> Result<(), SimulatorError>;

    /// Reads where everything is now.
    fn read(&self, reading: &mut Reading);

    /// Reads the generalised coordinates.
    fn coordinates(&self, positions: &mut [f64], velocities: &mut [f64]);
}

/// What a task may change about the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dynamics {
    /// Sliding friction coefficient of the floor. Of the two coefficients at a contact the greater counts, as in MuJoCo;
    /// the project's own robots have 0.
    pub floor_friction: f64,
    /// Mass added at the torso's centre of mass, in kg.
    pub payload: f64,
}

/// Where everything is. Sized once by the simulator; `read` allocates nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Pose of each body's frame, in the order of the file, without the world.
    pub bodies: Vec<Pose>,
    /// Linear velocity of the torso's centre of mass in world axes, m/s.
    pub torso_velocity: [f64; 3],
    /// Angle of each actuated joint in the order of the actuators, rad.
    pub joint_positions: Vec<f64>,
    /// Its velocity, rad/s.
    pub joint_velocities: Vec<f64>,
    /// Whether each body touches the floor, in the order of `bodies`.
    pub on_floor: Vec<bool>,
}

impl Reading {
    /// A reading with room for these numbers of bodies and actuated joints.
    pub fn sized(bodies: usize, joints: usize) -> Self {
        Self {
            bodies: vec![Pose::IDENTITY; bodies],
            torso_velocity: [0.0; 3],
            joint_positions: vec![0.0; joints],
            joint_velocities: vec![0.0; joints],
            on_floor: vec![false; bodies],
        }
    }
}
