//! A robot's bodies in an engine in Python; observation, reward and ends are those of every engine.

use elo_core::scene::Pose;
use elo_core::simulator::{BuildError, SimulatorError};
use numpy::PyArray1;
use pyo3::prelude::*;

use super::PythonBodyConfig;
use super::interpreter::{Shared, known_bridge, refused, told};
use super::interruption::asked;
use super::watchdog::Call;
use crate::locomotion::body::{ArticulatedBody, Dynamics, Reading};
use crate::locomotion::model::RobotModel;

/// See the [module](self).
pub struct PythonBody {
    bridge: Py<PyAny>,
    /// `bridge.advance`, looked up once.
    advance: Py<PyAny>,
    torques: Shared<f64>,
    /// What the bridge's `reading` holds; copied to `latest` after each call, so that reading cannot fail.
    reading: Shared<f64>,
    latest: Vec<f64>,
    bodies: usize,
    joints: usize,
}

impl PythonBody {
    /// Has the bridge make the body of `model`'s robot.
    ///
    /// # Errors
    /// A target that cannot be imported or called, that gives no body, or that is not what it was when the
    /// config was read.
    pub fn new(config: &PythonBodyConfig, model: &RobotModel) -> Result<Self, BuildError> {
        Python::attach(|py| {
            let (target, told) = (&config.target, config.told(model));
            let bridge = known_bridge(py, "body", &told, target, config.described.as_ref())?;
            Self::over(bridge, model).map_err(refused)
        })
    }

    fn over(bridge: Bound<'_, PyAny>, model: &RobotModel) -> PyResult<Self> {
        let reading = Shared::of(&bridge, "reading")?;
        Ok(Self {
            advance: bridge.getattr("advance")?.unbind(),
            torques: Shared::of(&bridge, "torques")?,
            latest: vec![0.0; reading.len(bridge.py())?],
            reading,
            bodies: model.bodies.len(),
            joints: model.joints.len(),
            bridge: bridge.unbind(),
        })
    }

    /// Makes a call, then takes over what it left in `reading`.
    fn call(&mut self, call: impl FnOnce(&Self, Python<'_>) -> PyResult<()>) -> Result<(), SimulatorError> {
        let done = asked(|py| {
            let _call = Call::begin();
            call(self, py)?;
            self.reading.read(py, &mut self.latest)
        });
        done.map_err(|error| SimulatorError::Unstable(told(&error)))?;
        match self.latest.iter().all(|x| x.is_finite()) {
            true => Ok(()),
            false => Err(SimulatorError::Unstable("a coordinate is not finite".to_owned())),
        }
    }
}

impl ArticulatedBody for PythonBody {
    fn set_dynamics(&mut self, dynamics: &Dynamics) -> Result<(), SimulatorError> {
        let Dynamics { floor_friction, payload } = *dynamics;
        self.call(|body, py| {
            body.bridge.bind(py).call_method1("set_dynamics", (floor_friction, payload)).map(drop)
        })
    }

    fn restore(&mut self, positions: &[f64], velocities: &[f64]) -> Result<(), SimulatorError> {
        let restored = self.call(|body, py| {
            let given = (PyArray1::from_slice(py, positions), PyArray1::from_slice(py, velocities));
            body.bridge.bind(py).call_method1("restore", given).map(drop)
        });
        restored.map_err(|error| SimulatorError::Start(error.to_string()))
    }

    fn advance(&mut self, torques: &[f64]) -> Result<(), SimulatorError> {
        self.call(|body, py| {
            body.torques.write(py, torques)?;
            body.advance.bind(py).call0().map(drop)
        })
    }

    fn read(&self, reading: &mut Reading) {
        let mut rest = self.latest.as_slice();
        let mut take = |count| {
            let (part, after) = rest.split_at(count);
            rest = after;
            part
        };
        let (positions, rotations) = (take(3 * self.bodies), take(4 * self.bodies));
        let poses = positions.as_chunks::<3>().0.iter().zip(rotations.as_chunks::<4>().0);
        for (pose, (&position, &rotation)) in reading.bodies.iter_mut().zip(poses) {
            *pose = Pose { position, rotation };
        }
        reading.torso_velocity.copy_from_slice(take(3));
        reading.joint_positions.copy_from_slice(take(self.joints));
        reading.joint_velocities.copy_from_slice(take(self.joints));
        for (flag, x) in reading.on_floor.iter_mut().zip(take(self.bodies)) {
            *flag = *x != 0.0;
        }
    }

    fn coordinates(&self, positions: &mut [f64], velocities: &mut [f64]) {
        let (before, qvel) = self.latest.split_at(self.latest.len() - velocities.len());
        velocities.copy_from_slice(qvel);
        positions.copy_from_slice(&before[before.len() - positions.len()..]);
    }
}
