//! The robot as MuJoCo sees it.

use std::sync::Arc;

use elo_core::scene::Pose;
use elo_core::simulator::{BuildError, SimulatorError};
use mujoco_rs::mujoco_c::{mjtIntegrator, mjtWarning};
use mujoco_rs::prelude::{MjData, MjModel};
use mujoco_rs::wrappers::mj_model::{MjtGeomBase, MjtObjBase};

use super::library;
use crate::locomotion::body::{ArticulatedBody, Dynamics, Reading};
use crate::locomotion::model::RobotModel;

/// A robot in MuJoCo.
///
/// Bodies, joints and coordinates have MuJoCo's own order. A control step alternates MuJoCo's two half-steps, second half
/// first, so that poses, velocities and contacts belong to the state that the step ends with, at the cost of plain steps
/// (files with the integrator RK4, which has no halves, pay for one more position stage).
#[derive(Debug)]
pub struct MujocoBody {
    /// As compiled; never edited.
    pristine: Arc<MjModel>,
    data: MjData<Box<MjModel>>,
    substeps: u32,
    torso: usize,
    floor: usize,
    /// Place in `qpos` and `qvel` of each actuated joint.
    joints: Vec<(usize, usize)>,
    whole_steps: bool,
}

impl MujocoBody {
    /// Compiles the robot's file.
    ///
    /// # Errors
    /// What MuJoCo says of it; or a difference between what MuJoCo and [`RobotModel`] read.
    pub fn new(model: &RobotModel) -> Result<Self, BuildError> {
        let pristine = library::model(&model.description.mjcf).map_err(BuildError::Robot)?;
        if let Some(difference) = difference(&pristine, model) {
            return Err(BuildError::Robot(format!("MuJoCo reads the file otherwise: {difference}")));
        }
        let floor = pristine.geom_bodyid().iter().zip(pristine.geom_type());
        let floor = floor
            .enumerate()
            .find_map(|(id, (&body, kind))| (body == 0 && *kind == MjtGeomBase::mjGEOM_PLANE).then_some(id));
        let data = MjData::try_new(Box::new((*pristine).clone()));
        Ok(Self {
            data: data.map_err(|error| BuildError::Robot(error.to_string()))?,
            substeps: model.description.substeps,
            torso: model.torso + 1,
            floor: floor.ok_or_else(|| BuildError::Robot("the file has no floor".to_owned()))?,
            joints: model.joints.iter().map(|joint| (joint.position, joint.velocity)).collect(),
            whole_steps: pristine.opt().integrator == mjtIntegrator::mjINT_RK4 as i32,
            pristine,
        })
    }

    /// The warnings that MuJoCo has counted since the last reset, in words.
    fn warnings(&self) -> Option<String> {
        const NAMES: [(mjtWarning, &str); 7] = [
            (mjtWarning::mjWARN_INERTIA, "the inertia matrix is close to singular"),
            (mjtWarning::mjWARN_CONTACTFULL, "contacts were dropped, the contact buffer is full"),
            (mjtWarning::mjWARN_CNSTRFULL, "constraints were dropped, the arena is full"),
            (mjtWarning::mjWARN_BADQPOS, "a position is NaN or huge"),
            (mjtWarning::mjWARN_BADQVEL, "a velocity is NaN or huge"),
            (mjtWarning::mjWARN_BADQACC, "an acceleration is NaN or huge"),
            (mjtWarning::mjWARN_BADCTRL, "a control is NaN or huge"),
        ];
        let warnings = self.data.warning();
        NAMES
            .iter()
            .find(|(kind, _)| warnings[*kind as usize].number > 0)
            .map(|(_, words)| (*words).to_owned())
    }
}

/// What keeps the indices of `robot` from being those of `mujoco` plus one (bodies) or equal (coordinates).
fn difference(mujoco: &MjModel, robot: &RobotModel) -> Option<String> {
    let differ = |what: &str, theirs: usize, ours: usize| {
        (theirs != ours).then(|| format!("{theirs} {what}, expected {ours}"))
    };
    differ("bodies", mujoco.nbody() as usize, robot.bodies.len() + 1)
        .or_else(|| differ("positions", mujoco.nq() as usize, robot.standard_positions.len()))
        .or_else(|| differ("velocities", mujoco.nv() as usize, robot.velocity_count))
        .or_else(|| {
            robot.bodies.iter().enumerate().find_map(|(id, body)| {
                let name = mujoco.id_to_name(MjtObjBase::mjOBJ_BODY, id + 1);
                (name != Some(&body.name))
                    .then(|| format!("body {} is {name:?}, expected `{}`", id + 1, body.name))
            })
        })
}

impl ArticulatedBody for MujocoBody {
    /// Always starts from a copy of the compiled model, so that the way to a value does not matter. Costs some tens of
    /// microseconds.
    fn set_dynamics(&mut self, dynamics: &Dynamics) -> Result<(), SimulatorError> {
        let mut model = Box::new((*self.pristine).clone());
        model.geom_friction_mut()[self.floor][0] = dynamics.floor_friction;
        model.body_mass_mut()[self.torso] += dynamics.payload;
        self.data.swap_model(model);
        if dynamics.payload != 0.0 {
            // Recomputes what MuJoCo derives from masses.
            self.data.set_const();
        }
        self.data.reset();
        Ok(())
    }

    fn restore(&mut self, positions: &[f64], velocities: &[f64]) -> Result<(), SimulatorError> {
        self.data.reset();
        self.data.qpos_mut().copy_from_slice(positions);
        self.data.qvel_mut().copy_from_slice(velocities);
        self.data.step1();
        self.warnings().map_or(Ok(()), |warning| Err(SimulatorError::Start(warning)))
    }

    fn advance(&mut self, torques: &[f64]) -> Result<(), SimulatorError> {
        let before = self.data.time();
        let applied = self.data.qfrc_applied_mut();
        applied.fill(0.0);
        for (&(_, velocity), torque) in self.joints.iter().zip(torques) {
            applied[velocity] += torque;
        }
        if self.whole_steps {
            (0..self.substeps).for_each(|_| self.data.step());
            self.data.step1();
        } else {
            for _ in 0..self.substeps {
                self.data.step2();
                self.data.step1();
            }
        }
        if let Some(warning) = self.warnings() {
            return Err(SimulatorError::Unstable(warning));
        }
        // Also false when the time itself is NaN.
        if self.data.time() > before {
            Ok(())
        } else {
            Err(SimulatorError::Unstable("time did not advance".to_owned()))
        }
    }

    fn read(&self, reading: &mut Reading) {
        let (positions, rotations) = (&self.data.xpos()[1..], &self.data.xquat()[1..]);
        for ((pose, &position), &rotation) in reading.bodies.iter_mut().zip(positions).zip(rotations) {
            *pose = Pose { position, rotation };
        }
        // MuJoCo keeps velocities about the centre of mass of the whole tree.
        let [wx, wy, wz, vx, vy, vz] = self.data.cvel()[self.torso];
        let root = self.data.model().body_rootid()[self.torso] as usize;
        let (at, about) = (self.data.xipos()[self.torso], self.data.subtree_com()[root]);
        let [x, y, z] = std::array::from_fn(|i| at[i] - about[i]);
        reading.torso_velocity = [vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x];

        let (qpos, qvel) = (self.data.qpos(), self.data.qvel());
        for (j, &(position, velocity)) in self.joints.iter().enumerate() {
            reading.joint_positions[j] = qpos[position];
            reading.joint_velocities[j] = qvel[velocity];
        }

        reading.on_floor.fill(false);
        let bodies = self.data.model().geom_bodyid();
        for contact in self.data.contact().iter().filter(|contact| contact.exclude == 0) {
            let [a, b] = contact.geom.map(|geom| geom as usize);
            let other = if a == self.floor { b } else { a };
            if (a == self.floor) != (b == self.floor) && bodies[other] > 0 {
                reading.on_floor[bodies[other] as usize - 1] = true;
            }
        }
    }

    fn coordinates(&self, positions: &mut [f64], velocities: &mut [f64]) {
        positions.copy_from_slice(self.data.qpos());
        velocities.copy_from_slice(self.data.qvel());
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::locomotion::laws::LAWS;
    use crate::locomotion::liars;
    use crate::locomotion::robot::{AliveRule, NAMES, RobotDescription, built_in};

    fn build(model: &RobotModel) -> Box<dyn ArticulatedBody> {
        Box::new(MujocoBody::new(model).unwrap())
    }

    fn built(name: &str) -> RobotModel {
        RobotModel::load(&built_in(name).unwrap()).unwrap()
    }

    #[test]
    fn the_laws_of_mechanics_hold() {
        let broken: Vec<String> =
            LAWS.iter().filter_map(|(name, law)| law(&build).err().map(|e| format!("{name}: {e}"))).collect();
        assert!(broken.is_empty(), "{broken:#?}");
    }

    #[test]
    fn the_laws_catch_liars() {
        assert_eq!(liars::undetected(&build), Vec::<String>::new());
    }

    /// A user's file with everything that changes masses: classes, densities, geom masses, degrees, no inertials.
    fn geoms_alone() -> RobotDescription {
        let mjcf = r#"<mujoco><compiler settotalmass="7"/><option timestep="0.005"/>
            <default><geom density="500"/><default class="heavy"><geom density="3000"/></default></default>
            <worldbody><geom type="plane" size="5 5 1"/><body name="torso" pos="0 0 2"><freejoint/>
            <geom type="box" size="0.2 0.1 0.05" pos="0.05 0 0"/><geom class="heavy" type="sphere" size="0.06" pos="0 0 0.1"/>
            <body name="leg" pos="0.2 0 0" euler="0 20 0"><joint name="hip" axis="0 1 0" range="-40 40"/>
            <geom type="capsule" size="0.03" fromto="0 0 0 0.1 0 -0.4"/><geom type="ellipsoid" size="0.05 0.04 0.03" mass="0.2"/>
            <geom type="cylinder" size="0.02 0.1" pos="0 0.1 0"/></body></body></worldbody>
            <actuator><motor joint="hip" gear="30" ctrlrange="-0.4 0.4"/></actuator></mujoco>"#;
        RobotDescription {
            name: "own".to_owned(),
            mjcf: mjcf.to_owned(),
            feet: vec!["leg".to_owned()],
            alive: AliveRule::default(),
            progress: Vec::new(),
            ..built_in("ant").unwrap()
        }
    }

    #[test]
    fn mujoco_and_the_reader_agree_on_every_robot() {
        let own = RobotModel::load(&geoms_alone()).unwrap();
        assert_eq!(own.joints[0].control, [-0.4, 0.4]);
        assert!((own.joints[0].range[1] - 40_f64.to_radians()).abs() < 1e-15);
        for model in NAMES.map(built).into_iter().chain([own]) {
            let body = MujocoBody::new(&model).unwrap();
            for (id, ours) in model.bodies.iter().enumerate() {
                let theirs = body.pristine.body_mass()[id + 1];
                assert!((ours.mass - theirs).abs() < 1e-9 * theirs, "{}: {theirs} {}", ours.name, ours.mass);
                let center = body.pristine.body_ipos()[id + 1];
                assert!(ours.center.iter().zip(center).all(|(a, b)| (a - b).abs() < 1e-9), "{}", ours.name);
            }
            for (ours, theirs) in model.standard_positions.iter().zip(body.pristine.qpos0()) {
                assert!((ours - theirs).abs() < 1e-12);
            }
            let timestep = body.pristine.opt().timestep;
            assert_eq!(model.control_step(), timestep * f64::from(model.description.substeps));
        }
    }

    #[test]
    fn the_floor_bears_the_weight_at_rest() {
        for name in NAMES {
            let model = built(name);
            let mut body = MujocoBody::new(&model).unwrap();
            body.restore(&model.standard_positions, &vec![0.0; model.velocity_count]).unwrap();
            (0..1000).for_each(|_| body.advance(&vec![0.0; model.joints.len()]).unwrap());
            // Forces belong to the state in which they were computed.
            body.data.forward();
            let contacts = 0..body.data.ncon() as usize;
            let force: f64 = contacts.map(|i| body.data.contact_force(i)[0]).sum();
            let weight = model.total_mass() * 9.8;
            assert!((force / weight - 1.0).abs() < 0.01, "{name}: {force} N, weight {weight} N");
        }
    }

    #[test]
    fn a_lost_state_is_reported_and_never_reset_silently() {
        let model = built("half-cheetah");
        let mut body = MujocoBody::new(&model).unwrap();
        let rest = (model.standard_positions.clone(), vec![0.0; model.velocity_count]);
        body.restore(&rest.0, &rest.1).unwrap();
        let lost = body.advance(&[1e12; 6]);
        assert!(matches!(lost, Err(SimulatorError::Unstable(_))), "{lost:?}");
        let mut huge = rest.clone();
        huge.1[0] = 1e11;
        assert!(matches!(body.restore(&huge.0, &huge.1), Err(SimulatorError::Start(_))));
        // And the object is as good as new.
        body.restore(&rest.0, &rest.1).unwrap();
        body.advance(&[1.0; 6]).unwrap();
        let mut fresh = MujocoBody::new(&model).unwrap();
        fresh.restore(&rest.0, &rest.1).unwrap();
        fresh.advance(&[1.0; 6]).unwrap();
        assert_eq!(body.data.qpos(), fresh.data.qpos());
    }

    #[test]
    fn dropped_constraints_are_reported() {
        // An arena that holds the robot and not the constraints of its many contacts.
        let balls: String =
            (0..60).map(|i| format!("<geom size='0.1' pos='{} 0 0.05'/>", 0.3 * f64::from(i))).collect();
        let mut own = geoms_alone();
        own.mjcf = own
            .mjcf
            .replace("<option", "<size memory='90K'/><option")
            .replace("pos=\"0 0 2\"><freejoint/>", &format!("pos=\"0 0 0\"><freejoint/>{balls}"));
        let model = RobotModel::load(&own).unwrap();
        let mut body = MujocoBody::new(&model).unwrap();
        let rest = body.restore(&model.standard_positions, &vec![0.0; model.velocity_count]);
        let dropped = rest.and_then(|()| body.advance(&[0.0])).unwrap_err().to_string();
        assert!(dropped.contains("full"), "{dropped}");
    }

    #[test]
    fn mujocos_own_refusals_are_build_errors() {
        let mut own = geoms_alone();
        own.mjcf = own.mjcf.replace("mass=\"0.2\"", "mass=\"-0.2\"");
        let error = RobotModel::load(&own).map(|model| MujocoBody::new(&model).err().unwrap()).unwrap();
        assert!(matches!(error, BuildError::Robot(_)), "{error}");
    }

    #[test]
    fn whole_steps_of_rk4_leave_a_current_reading_too() {
        let mut own = geoms_alone();
        own.mjcf = own.mjcf.replace("timestep=\"0.005\"", "timestep=\"0.005\" integrator=\"RK4\"");
        let model = RobotModel::load(&own).unwrap();
        let mut body = MujocoBody::new(&model).unwrap();
        body.restore(&model.standard_positions, &vec![0.0; model.velocity_count]).unwrap();
        (0..10).for_each(|_| body.advance(&[3.0]).unwrap());
        let mut reading = Reading::sized(2, 1);
        body.read(&mut reading);
        assert_eq!(reading.bodies[0].position[..], body.data.qpos()[..3]);
    }
}
