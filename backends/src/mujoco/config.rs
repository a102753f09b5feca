//! What a user may set about MuJoCo.

use std::path::Path;

use elo_core::fault::Faults;
use elo_core::hosted::{Hosted, WorkerProgram};
use elo_core::simulator::{BuildError, Engine, Simulator, SimulatorConfig};
use elo_core::spec::SimulatorSpec;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::locomotion::model::RobotModel;
use crate::locomotion::robot::{self, RobotDescription};

/// A robot in MuJoCo. Exactly one of the two fields is set.
///
/// Task parameters: `electricity_cost`, reward per unit of mean `|a · 0.1 q̇|` (-10 to 0, default -2); `floor_friction`,
/// sliding friction coefficient (0 to 10, default the file's); `payload`, mass added to the torso in kg (0 to the robot's
/// own mass, default 0).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MujocoConfig {
    /// One of the built-in robots: `ant`, `half-cheetah` or `walker2d`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// A robot of the user's own: a table as in `examples/hopper-quick.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_robot: Option<RobotDescription>,
}

impl Default for MujocoConfig {
    fn default() -> Self {
        Self { robot: Some("half-cheetah".to_owned()), own_robot: None }
    }
}

impl MujocoConfig {
    /// The version of libmujoco that the engine is built against; another does not load.
    pub const VERSION: &str = "3.17.0";

    fn model(&self) -> Result<RobotModel, BuildError> {
        robot::chosen(self.robot.as_deref(), self.own_robot.as_ref()).map_err(BuildError::Robot)
    }
}

#[typetag::serde(name = "mujoco")]
impl SimulatorConfig for MujocoConfig {
    fn embed_files(&mut self, folder: &Path, faults: &mut Faults) {
        if let Some(own) = &mut self.own_robot {
            faults.within("own_robot", |faults| own.embed(folder, faults));
        }
    }

    fn validate(&self, faults: &mut Faults) {
        robot::validate(self.robot.as_deref(), self.own_robot.as_ref(), faults);
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Ok(self.model()?.spec())
    }

    fn engine(&self) -> Engine {
        Engine { name: "mujoco".to_owned(), version: Self::VERSION.to_owned() }
    }

    fn hosted(&self) -> Option<&dyn Hosted> {
        Some(self)
    }

    #[cfg(feature = "mujoco")]
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        let model = self.model()?;
        let body = super::engine::MujocoBody::new(&model)?;
        Ok(Box::new(crate::locomotion::simulator::Locomotion::new(model, body)))
    }

    /// In an interpreter MuJoCo is the package `mujoco`, which takes the same steps.
    #[cfg(all(feature = "python", not(feature = "mujoco")))]
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        let kwargs = [("version".to_owned(), Self::VERSION.into())].into_iter().collect();
        let (robot, own_robot) = (self.robot.clone(), self.own_robot.clone());
        crate::python::PythonBodyConfig { kwargs, robot, own_robot, ..Default::default() }.build()
    }

    #[cfg(not(any(feature = "python", feature = "mujoco")))]
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        self.model()?;
        Err(BuildError::MissingEngine {
            engine: format!("MuJoCo {}", Self::VERSION),
            remedy: "this program was built without it; build it with the feature `mujoco` of `elo-backends` after \
                     `tests/set-up`"
                .to_owned(),
        })
    }
}

impl Hosted for MujocoConfig {
    fn worker(&self) -> WorkerProgram {
        WorkerProgram::Beside("elo-mujoco")
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn faults(config: &MujocoConfig) -> Vec<String> {
        let mut faults = Faults::new();
        config.validate(&mut faults);
        faults.into_found().iter().map(ToString::to_string).collect()
    }

    fn config(text: &str) -> Result<MujocoConfig, serde_json::Error> {
        serde_json::from_str(text)
    }

    #[test]
    fn exactly_one_robot_is_chosen_and_slips_are_named() {
        assert_eq!(faults(&MujocoConfig::default()), Vec::<String>::new());
        let slip = config(r#"{"robot": "walker-2d"}"#).unwrap();
        assert!(faults(&slip)[0].ends_with("did you mean `walker2d`?"), "{:?}", faults(&slip));
        assert!(faults(&config("{}").unwrap())[0].contains("own_robot"));
        assert!(config(r#"{"robbot": "ant"}"#).unwrap_err().to_string().contains("robbot"));
        assert_eq!(slip.spec().unwrap_err(), slip.build().err().unwrap());
    }

    #[test]
    fn an_own_robot_is_read_once_and_checked() {
        let folder = tempfile::tempdir().unwrap();
        let mut own = robot::built_in("ant").unwrap();
        std::fs::write(folder.path().join("mine.xml"), &own.mjcf).unwrap();
        own.name = "mine".to_owned();
        own.mjcf = "mine.xml".to_owned();
        let mut config = MujocoConfig { robot: None, own_robot: Some(own) };
        let mut found = Faults::new();
        config.embed_files(folder.path(), &mut found);
        assert_eq!(found.found(), []);
        assert_eq!(faults(&config), Vec::<String>::new());
        assert_eq!(config.spec().unwrap().robot, "mine");
        // The text stands for itself now.
        let stored = serde_json::to_string(&config).unwrap();
        drop(folder);
        let again: MujocoConfig = serde_json::from_str(&stored).unwrap();
        assert_eq!(again, config);
        assert_eq!(again.spec().unwrap().observation_size, 28);

        let own = config.own_robot.as_mut().unwrap();
        own.mjcf = own.mjcf.replace("<worldbody>", "<worldbody><include file='/etc/passwd'/>");
        assert!(faults(&config)[0].contains("<include>"), "{:?}", faults(&config));
    }

    #[test]
    fn only_regular_files_of_bounded_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut large = "<".repeat(crate::locomotion::prescan::MAX_BYTES);
        large.push('<');
        std::fs::write(folder.path().join("large.xml"), large).unwrap();
        std::fs::write(folder.path().join("text.xml"), "no markup").unwrap();
        let expected = [
            ("large.xml", "larger than"),
            ("text.xml", "does not begin"),
            (".", "no regular file"),
            ("/dev/zero", "no regular file"),
            ("absent.xml", "cannot read"),
        ];
        for (path, message) in expected {
            let own = RobotDescription { mjcf: path.to_owned(), ..robot::built_in("ant").unwrap() };
            let mut config = MujocoConfig { robot: None, own_robot: Some(own) };
            let mut found = Faults::new();
            config.embed_files(folder.path(), &mut found);
            assert_eq!(found.found()[0].path, "own_robot.mjcf");
            assert!(found.found()[0].message.contains(message), "{:?}", found.found());
        }
    }

    #[cfg(not(any(feature = "python", feature = "mujoco")))]
    #[test]
    fn without_the_engine_the_error_says_what_to_run() {
        let error = MujocoConfig::default().build().err().unwrap();
        let text = "MuJoCo 3.17.0 is missing: this program was built without it; build it with the feature `mujoco` of \
                    `elo-backends` after `tests/set-up`";
        assert_eq!(error.to_string(), text);
    }
}
