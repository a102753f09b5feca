//! What a user may set about Rapier.

use std::path::Path;

use elo_core::fault::Faults;
use elo_core::simulator::{BuildError, Engine, Simulator, SimulatorConfig};
use elo_core::spec::SimulatorSpec;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::engine::RapierBody;
use super::settings::Division;
use super::skeleton::Skeleton;
use crate::locomotion::model::RobotModel;
use crate::locomotion::robot::{self, RobotDescription};
use crate::locomotion::simulator::Locomotion;

/// A robot in Rapier. Exactly one of `robot` and `own_robot` is set.
///
/// Task parameters: `electricity_cost`, reward per unit of mean `|a · 0.1 q̇|` (-10 to 0, default -2); `floor_friction`,
/// sliding friction coefficient (0 to 10, default the file's); `payload`, mass added to the torso in kg (0 to the robot's
/// own mass, default 0).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RapierConfig {
    /// One of the built-in robots: `ant`, `half-cheetah` or `walker2d`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// A robot of the user's own: a table as in `examples/hopper-quick.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_robot: Option<RobotDescription>,
    /// Engine steps in one control step, in each of which contacts are found anew. The error of a trajectory is
    /// inversely proportional to it, the cost proportional. Default: the robot's own `substeps` (4 for the built-in
    /// robots), so that engine steps are as long as the file's `timestep`, as they are in MuJoCo.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 1000))]
    pub steps_per_control: Option<u32>,
    /// Parts of one engine step, in each of which the equations of motion are solved anew but contacts are not sought.
    /// Cheaper than further steps, and as good in the air, but not on the floor. The default is 1.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = 1000))]
    pub substeps: u32,
}

fn one() -> u32 {
    1
}

impl Default for RapierConfig {
    fn default() -> Self {
        Self {
            robot: Some("half-cheetah".to_owned()),
            own_robot: None,
            steps_per_control: None,
            substeps: one(),
        }
    }
}

impl RapierConfig {
    /// The version of Rapier that is built in. Trajectories differ between versions.
    pub const VERSION: &str = "0.36.1";

    fn model(&self) -> Result<RobotModel, BuildError> {
        robot::chosen(self.robot.as_deref(), self.own_robot.as_ref()).map_err(BuildError::Robot)
    }
}

#[typetag::serde(name = "rapier")]
impl SimulatorConfig for RapierConfig {
    fn embed_files(&mut self, folder: &Path, faults: &mut Faults) {
        if let Some(own) = &mut self.own_robot {
            faults.within("own_robot", |faults| own.embed(folder, faults));
        }
    }

    fn validate(&self, faults: &mut Faults) {
        let steps = self.steps_per_control.unwrap_or(1);
        for (field, value) in [("steps_per_control", steps), ("substeps", self.substeps)] {
            faults.check((1..=1000).contains(&value), field, || format!("expected 1 to 1000, got {value}"));
        }
        robot::validate(self.robot.as_deref(), self.own_robot.as_ref(), faults);
        if let (Some(own), Ok(model)) = (&self.own_robot, self.model())
            && let Err(fault) = Skeleton::of(&model.mjcf)
        {
            faults.within("own_robot", |faults| faults.add("mjcf", format!("`{}`: {fault}", own.name)));
        }
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        Ok(self.model()?.spec())
    }

    fn engine(&self) -> Engine {
        Engine { name: "rapier".to_owned(), version: Self::VERSION.to_owned() }
    }

    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        let model = self.model()?;
        let division = Division {
            steps: self.steps_per_control.unwrap_or(model.description.substeps) as usize,
            substeps: self.substeps as usize,
        };
        let body = RapierBody::new(&model, division).map_err(BuildError::Robot)?;
        Ok(Box::new(Locomotion::new(model, body)))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn faults(config: &RapierConfig) -> Vec<String> {
        let mut faults = Faults::new();
        config.validate(&mut faults);
        faults.into_found().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn the_default_is_sound_and_names_its_engine() {
        let config = RapierConfig::default();
        assert_eq!(faults(&config), Vec::<String>::new());
        assert_eq!(config.build().unwrap().spec(), &config.spec().unwrap());
        let written = serde_json::to_value(&config as &dyn SimulatorConfig).unwrap();
        let expected = serde_json::json!({"kind": "rapier", "robot": "half-cheetah", "substeps": 1});
        assert_eq!(written, expected);
        let lock = include_str!("../../../Cargo.lock");
        let locked = format!("name = \"rapier3d-f64\"\nversion = \"{}\"", RapierConfig::VERSION);
        assert!(lock.contains(&locked), "the lock file has another version of Rapier");
    }

    #[test]
    fn every_fault_is_found_at_its_field() {
        let config: RapierConfig =
            serde_json::from_str(r#"{"robot": "ants", "steps_per_control": 0, "substeps": 2000}"#).unwrap();
        let found = faults(&config).join("\n");
        for part in ["`steps_per_control`: expected 1 to 1000, got 0", "`substeps`", "did you mean `ant`?"] {
            assert!(found.contains(part), "{found}");
        }
        assert!(serde_json::from_str::<RapierConfig>(r#"{"step_per_control": 4}"#).is_err());
    }

    #[test]
    fn what_the_engine_cannot_represent_is_a_fault_of_the_config() {
        let mut own = robot::built_in("ant").unwrap();
        own.mjcf = own.mjcf.replace(r#"type="sphere" size="0.25""#, r#"type="ellipsoid" size="0.2 0.2 0.2""#);
        let config = RapierConfig { robot: None, own_robot: Some(own), ..RapierConfig::default() };
        let found = faults(&config).join("\n");
        assert!(found.contains("own_robot.mjcf") && found.contains("Ellipsoid"), "{found}");
        assert!(config.build().is_err());
    }
}
