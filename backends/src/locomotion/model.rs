//! What locomotion must know of a robot's MJCF file, read without any engine.

use elo_core::fault::Fault;
use elo_core::spec::{Capabilities, Effect, RewardTerm, SimulatorSpec, TaskParameter, Weight};

use super::body::Dynamics;
use super::prescan;
use super::read;
use super::reward;
use super::robot::RobotDescription;

/// A robot that has been read and found sound. Body and joint numbers are those of the file's order, without the world.
#[derive(Clone, Debug)]
pub struct RobotModel {
    /// What it was made from; `mjcf` holds the file's text.
    pub description: RobotDescription,
    /// The parsed file, for engines that build from it. Its bodies include the world, at 0.
    pub mjcf: mjcf_rs::Model,
    /// The file's bodies.
    pub bodies: Vec<BodyModel>,
    /// The joints that have a motor, in the order of the motors: the components of an action.
    pub joints: Vec<ActuatedJoint>,
    /// Generalised positions (`qpos`) of the file's own pose.
    pub standard_positions: Vec<f64>,
    /// Generalised velocities (`qvel`).
    pub velocity_count: usize,
    /// Where in `qpos` a free root's unit quaternion begins.
    pub root_quaternion: Option<usize>,
    /// Which body is the torso.
    pub torso: usize,
    /// Which bodies are the feet, in the order of the observation.
    pub feet: Vec<usize>,
    /// Which bodies must not touch the floor.
    pub no_floor_contact: Vec<usize>,
    /// Progress points: body, place in its frame, share of the mean (the shares sum to 1).
    pub progress: Vec<(usize, [f64; 3], f64)>,
    /// What a task changes, as the file has it.
    pub dynamics: Dynamics,
}

/// One body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyModel {
    /// Its name in the file.
    pub name: String,
    /// In kg.
    pub mass: f64,
    /// Its centre of mass in its frame, in m.
    pub center: [f64; 3],
}

/// One joint with a motor.
#[derive(Clone, Debug, PartialEq)]
pub struct ActuatedJoint {
    /// Its name in the file.
    pub name: String,
    /// Its place in `qpos`.
    pub position: usize,
    /// Its place in `qvel`.
    pub velocity: usize,
    /// Its limits, in rad (hinges) or m (slides).
    pub range: [f64; 2],
    /// Torque (N m) or force (N) at action 1.
    pub gear: f64,
    /// Actions are clamped to this before they reach the motor.
    pub control: [f64; 2],
}

impl RobotModel {
    /// Reads a robot.
    ///
    /// # Errors
    /// Everything found wrong: the file as [`prescan::check`] sees it, what the parser refuses, what locomotion cannot
    /// use (unnamed bodies, ball joints, several trees, other actuators than motors on limited hinges), names in the
    /// description that the file lacks.
    pub fn load(description: &RobotDescription) -> Result<Self, Vec<Fault>> {
        let of_file = |message: String| Fault { path: "mjcf".to_owned(), message };
        if !prescan::is_text(&description.mjcf) {
            return Err(vec![of_file(format!("the file `{}` has not been read", description.mjcf))]);
        }
        prescan::check(&description.mjcf)
            .map_err(|messages| messages.into_iter().map(of_file).collect::<Vec<_>>())?;
        // Without files there is nothing to resolve against the folder.
        let mjcf =
            mjcf_rs::Model::from_str(&description.mjcf, "").map_err(|e| vec![of_file(e.to_string())])?;
        read::robot(description, mjcf)
    }

    /// Simulated seconds between two actions.
    pub fn control_step(&self) -> f64 {
        self.mjcf.option.timestep * f64::from(self.description.substeps)
    }

    /// The mass of all bodies, in kg.
    pub fn total_mass(&self) -> f64 {
        self.bodies.iter().map(|body| body.mass).sum()
    }

    /// Numbers in an observation: 8 of the torso, 2 a joint, 1 a foot.
    pub fn observation_size(&self) -> usize {
        8 + 2 * self.joints.len() + self.feet.len()
    }

    /// The spec that every engine's simulator of this robot has.
    pub fn spec(&self) -> SimulatorSpec {
        let term = |name: &str, weight| RewardTerm { name: name.to_owned(), weight };
        let parameter = |name: &str, default, (low, high), effect| TaskParameter {
            name: name.to_owned(),
            default,
            low,
            high,
            effect,
        };
        SimulatorSpec {
            robot: self.description.name.clone(),
            observation_size: self.observation_size(),
            action_low: self.joints.iter().map(|joint| joint.control[0] as f32).collect(),
            action_high: self.joints.iter().map(|joint| joint.control[1] as f32).collect(),
            control_step: self.control_step(),
            reward_terms: reward::TERMS.iter().map(|&(name, weight)| term(name, price(weight))).collect(),
            task_parameters: vec![
                parameter(reward::ELECTRICITY_COST, -2.0, (reward::DEAREST_ELECTRICITY, 0.0), Effect::Reward),
                parameter("floor_friction", self.dynamics.floor_friction, (0.0, 10.0), Effect::Dynamics),
                parameter("payload", 0.0, (0.0, self.total_mass()), Effect::Dynamics),
            ],
            reward_floor: reward::FLOOR,
            capabilities: Capabilities { settable_state: true },
        }
    }
}

fn price(weight: Option<f64>) -> Weight {
    weight.map_or_else(|| Weight::Parameter(reward::ELECTRICITY_COST.to_owned()), Weight::Constant)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::locomotion::robot::{NAMES, built_in};

    fn robot(name: &str) -> RobotModel {
        RobotModel::load(&built_in(name).unwrap()).unwrap()
    }

    fn messages(faults: Vec<Fault>) -> Vec<String> {
        faults.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn the_robots_weigh_what_roboschools_weigh() {
        for (name, mass) in NAMES.into_iter().zip([182.176, 38.188, 23.677]) {
            let total = robot(name).total_mass();
            assert!((total - mass).abs() < 5e-4, "{name}: {total}");
        }
    }

    #[test]
    fn sizes_motors_and_ranges_are_roboschools() {
        let [ant, cheetah, walker] = NAMES.map(robot);
        let gears = |model: &RobotModel| model.joints.iter().map(|joint| joint.gear).collect::<Vec<_>>();
        assert_eq!(gears(&ant), [250.0; 8]);
        assert_eq!(gears(&cheetah), [108.0, 81.0, 54.0, 126.0, 54.0, 27.0]);
        assert_eq!(gears(&walker), [40.0, 40.0, 12.0, 40.0, 40.0, 12.0]);
        assert_eq!([&ant, &cheetah, &walker].map(RobotModel::observation_size), [28, 26, 22]);
        let sizes =
            [&ant, &cheetah, &walker].map(|m| (m.standard_positions.len(), m.velocity_count, m.bodies.len()));
        assert_eq!(sizes, [(15, 14, 9), (9, 9, 7), (9, 9, 7)]);
        assert_eq!(ant.joints[1].range, [30_f64.to_radians(), 100_f64.to_radians()]);
        assert_eq!((ant.joints[1].position, ant.joints[1].velocity), (8, 7));
        assert_eq!(ant.standard_positions[..7], [0.0, 0.0, 0.75, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(cheetah.joints[5].range, [-3.1, -0.3]);
        assert_eq!([&ant, &cheetah, &walker].map(|m| m.dynamics.floor_friction), [1.2, 0.64, 0.64]);
        assert!(NAMES.map(robot).iter().all(|model| (model.control_step() - 0.0165).abs() < 1e-15));
    }

    #[test]
    fn bodies_without_an_inertial_get_their_geoms_masses() {
        // Density 1000: the capsule's cylinder pi * 0.1^2 * 1 and its ball 4/3 pi 0.1^3; the box of 3 kg at x = 2.
        let text = r#"<mujoco><worldbody><geom type="plane" size="0 0 1"/>
            <body name="torso"><freejoint/><geom type="capsule" size="0.1" fromto="0 0 0 0 0 1"/>
            <geom type="box" size="1 1 1" mass="3" pos="2 0 0"/></body></worldbody></mujoco>"#;
        let mut own = built_in("ant").unwrap();
        own.mjcf = text.to_owned();
        own.feet.clear();
        own.progress.clear();
        own.alive = Default::default();
        let model = RobotModel::load(&own);
        // No motors: refused, but the masses can be read all the same.
        assert_eq!(messages(model.unwrap_err()), ["`mjcf`: <actuator> holds no <motor>"]);
        let parsed = mjcf_rs::Model::from_str(text, "").unwrap();
        let body = &read::bodies(&parsed, &mut Vec::new())[0];
        let capsule = 1000.0 * std::f64::consts::PI * (0.01 + 4.0 / 3.0 * 0.001);
        assert!((body.mass - capsule - 3.0).abs() < 1e-9, "{body:?}");
        assert!((body.center[0] - 6.0 / body.mass).abs() < 1e-12, "{body:?}");
        assert!((body.center[2] - 0.5 * capsule / body.mass).abs() < 1e-12, "{body:?}");
    }

    #[test]
    fn bodies_floors_and_rules_that_make_no_sense_are_named() {
        let cheetah = built_in("half-cheetah").unwrap();
        let refused = |from: &str, to: &str, said: &str| {
            let mut own = cheetah.clone();
            own.mjcf = own.mjcf.replacen(from, to, 1);
            assert_ne!(own.mjcf, cheetah.mjcf, "{from}");
            let found = messages(RobotModel::load(&own).unwrap_err());
            assert!(found.iter().any(|message| message.contains(said)), "{found:?}");
        };
        refused(r#"range="-0.4 0.785""#, r#"range="0.785 -0.4""#, "lower end first");
        refused(r#"mass="9.4573""#, r#"mass="-9""#, "mass=\"-9\": expected more than 0");
        refused("1.56463 1.56463 1.56463", "1 1 5", "greater than the sum of the others");
        refused(r#"size="0 0 1""#, r#"size="0 0 1" pos="0 0 0.5""#, "level at height 0");
        refused(r#"size="0 0 1""#, r#"size="0 0 1" euler="0.3 0 0""#, "level at height 0");
        refused(r#"friction="0.64 0 0""#, r#"friction="-1 0 0""#, "friction=\"-1 …\"");
        let mut fallen = cheetah.clone();
        fallen.alive.min_height = Some(0.71);
        let found = messages(RobotModel::load(&fallen).unwrap_err());
        assert!(found[0].contains("alive.min_height") && found[0].contains("0.700 m"), "{found:?}");
    }

    #[test]
    fn what_locomotion_cannot_use_is_named() {
        let mut own = built_in("half-cheetah").unwrap();
        own.torso = "trunk".to_owned();
        own.feet[0] = "fot".to_owned();
        own.mjcf = own.mjcf.replace(r#"name="bfoot" range="-0.4 0.785""#, r#"name="bfoot""#);
        let faults = messages(RobotModel::load(&own).unwrap_err());
        assert_eq!(faults.len(), 3, "{faults:?}");
        assert!(faults[0].contains("bfoot") && faults[0].contains("range"), "{faults:?}");
        assert!(faults[1].contains("`torso`") && faults[1].contains("`trunk`"), "{faults:?}");
        assert!(faults[2].contains("did you mean"), "{faults:?}");
    }
}
