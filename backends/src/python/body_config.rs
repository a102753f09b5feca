//! What a user says about an engine in Python that moves a robot's bodies.

use std::collections::BTreeMap;
use std::path::Path;

use elo_core::fault::Faults;
use elo_core::hosted::{Hosted, WorkerProgram};
use elo_core::simulator::{BuildError, Engine, Simulator, SimulatorConfig};
use elo_core::spec::SimulatorSpec;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::files;
use crate::locomotion::model::{ActuatedJoint, RobotModel};
use crate::locomotion::robot::{self, RobotDescription};

/// A robot in an engine in Python, which moves its bodies; observation, reward, ends and task parameters are those of the
/// kinds `mujoco` and `rapier`. Exactly one of `robot` and `own_robot` is set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PythonBodyConfig {
    /// `module:callable`, whose call with an `elo.bodies.Robot` and `kwargs` gives an `elo.bodies.Body`. It is code that is
    /// executed: name only what you trust.
    #[serde(default = "mujoco")]
    pub target: String,
    /// Keyword arguments of the callable.
    #[serde(default)]
    pub kwargs: serde_json::Map<String, serde_json::Value>,
    /// Files that the callable is given as keyword arguments, by their paths; relative to the config file here. What they hold is
    /// part of every result's key, which it is not where `kwargs` name a path.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// One of the built-in robots: `ant`, `half-cheetah` or `walker2d`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// A robot of the user's own: a table as in `examples/hopper-quick.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_robot: Option<RobotDescription>,
    /// Versions of what the body's numbers depend on, and hashes of `files` and of the source files of the target, of its class and
    /// of its base classes: part of every result's key. Written by the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub described: Option<String>,
}

fn mujoco() -> String {
    "elo.bodies:MujocoBody".to_owned()
}

impl Default for PythonBodyConfig {
    fn default() -> Self {
        Self {
            target: mujoco(),
            kwargs: serde_json::Map::new(),
            files: BTreeMap::new(),
            robot: Some("half-cheetah".to_owned()),
            own_robot: None,
            described: None,
        }
    }
}

impl PythonBodyConfig {
    fn model(&self) -> Result<RobotModel, BuildError> {
        robot::chosen(self.robot.as_deref(), self.own_robot.as_ref()).map_err(BuildError::Robot)
    }

    pub(super) fn told<'a>(&'a self, model: &'a RobotModel) -> Told<'a> {
        let joint =
            |j: &'a ActuatedJoint| Joint { name: &j.name, position: j.position, velocity: j.velocity };
        let robot = Robot {
            name: &model.description.name,
            mjcf: &model.description.mjcf,
            substeps: model.description.substeps,
            torso: model.torso,
            bodies: model.bodies.iter().map(|body| body.name.as_str()).collect(),
            joints: model.joints.iter().map(joint).collect(),
            positions: model.standard_positions.len(),
            velocities: model.velocity_count,
        };
        Told { target: &self.target, kwargs: &self.kwargs, files: &self.files, robot }
    }
}

/// What the Python side is told.
#[derive(Serialize)]
pub(super) struct Told<'a> {
    target: &'a str,
    kwargs: &'a serde_json::Map<String, serde_json::Value>,
    files: &'a BTreeMap<String, String>,
    robot: Robot<'a>,
}

/// `elo.bodies.Robot`.
#[derive(Serialize)]
struct Robot<'a> {
    name: &'a str,
    mjcf: &'a str,
    substeps: u32,
    torso: usize,
    bodies: Vec<&'a str>,
    joints: Vec<Joint<'a>>,
    positions: usize,
    velocities: usize,
}

/// `elo.bodies.Joint`.
#[derive(Serialize)]
struct Joint<'a> {
    name: &'a str,
    position: usize,
    velocity: usize,
}

#[typetag::serde(name = "python_body")]
impl SimulatorConfig for PythonBodyConfig {
    fn embed_files(&mut self, folder: &Path, faults: &mut Faults) {
        files::embed(&mut self.files, folder, faults);
        if let Some(own) = &mut self.own_robot {
            faults.within("own_robot", |faults| own.embed(folder, faults));
        }
    }

    fn validate(&self, faults: &mut Faults) {
        super::validate_target(&self.target, faults);
        files::validate(&self.files, &self.kwargs, faults);
        robot::validate(self.robot.as_deref(), self.own_robot.as_ref(), faults);
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Ok(self.model()?.spec())
    }

    fn engine(&self) -> Engine {
        let versions = self.described.as_deref().unwrap_or("unknown");
        Engine { name: super::engine_name(&self.target), version: versions.to_owned() }
    }

    fn hosted(&self) -> Option<&dyn Hosted> {
        Some(self)
    }

    fn hosted_mut(&mut self) -> Option<&mut dyn Hosted> {
        Some(self)
    }

    #[cfg(feature = "python")]
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        let model = self.model()?;
        let body = super::PythonBody::new(self, &model)?;
        Ok(Box::new(crate::locomotion::simulator::Locomotion::new(model, body)))
    }

    #[cfg(not(feature = "python"))]
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        Err(super::missing())
    }
}

impl Hosted for PythonBodyConfig {
    fn worker(&self) -> WorkerProgram {
        super::WORKER
    }

    fn describe(&self) -> Result<Vec<u8>, BuildError> {
        super::describe("body", &self.told(&self.model()?))
    }

    fn accept_description(&mut self, description: &[u8]) -> Result<(), String> {
        super::accept(&mut self.described, description)
    }
}
