//! The robot as MuJoCo sees it.

use std::sync::Arc;

use elo_core::simulator::{BuildError, SimulatorError};
use mujoco_rs::mujoco_c::{mjtIntegrator, mjtWarning};
use mujoco_rs::prelude::{MjData, MjModel};
use mujoco_rs::wrappers::mj_model::{MjtGeomBase, MjtObjBase};

use super::library;
use crate::locomotion::body::{ArticulatedBody, Dynamics, Pose, Reading};
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

    fn build(model: &RobotModel) -> Box<dyn ArticulatedBody> {
        Box::new(MujocoBody::new(model).unwrap())
    }

    #[test]
    fn mechanics() {
        let broken: Vec<String> =
            LAWS.iter().filter_map(|(name, law)| law(&build).err().map(|e| format!("{name}: {e}"))).collect();
        assert!(broken.is_empty(), "{broken:#?}");
    }
}
