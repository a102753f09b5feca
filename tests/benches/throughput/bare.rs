//! The loop that anybody would write on the engine itself: start, torques, steps; it looks at nothing.

use std::error::Error;

use elo_backends::locomotion::body::ArticulatedBody as _;
use elo_backends::locomotion::model::RobotModel;
use elo_backends::locomotion::robot::built_in;
use elo_backends::rapier::{Division, RapierBody};
use elo_core::simulator::State;

/// One robot in an engine.
pub trait Bare {
    /// Puts the robot at `start` and plays `actions`, row after row.
    fn run(&mut self, start: &State, actions: &[f32]) -> Result<(), Box<dyn Error>>;

    /// Generalised positions now.
    fn positions(&self) -> Vec<f64>;
}

/// The built-in robot in `engine`.
pub fn bare(engine: &str, robot: &str) -> Result<Box<dyn Bare>, Box<dyn Error>> {
    let description = built_in(robot).ok_or("a built-in robot")?;
    let model = RobotModel::load(&description).map_err(|faults| format!("{robot}: {faults:?}"))?;
    match engine {
        "rapier" => Ok(Box::new(Rapier::new(model)?)),
        _ => mujoco(&model),
    }
}

#[cfg(feature = "mujoco")]
fn mujoco(model: &RobotModel) -> Result<Box<dyn Bare>, Box<dyn Error>> {
    Ok(Box::new(mujoco_rs_loop::Mujoco::new(model)?))
}

#[cfg(not(feature = "mujoco"))]
fn mujoco(_: &RobotModel) -> Result<Box<dyn Bare>, Box<dyn Error>> {
    Err("MuJoCo is not linked".into())
}

/// Torques of one row of actions.
fn torques(model: &RobotModel, row: &[f32], torques: &mut [f64]) {
    for ((torque, joint), &a) in torques.iter_mut().zip(&model.joints).zip(row) {
        *torque = joint.gear * f64::from(a).clamp(joint.control[0], joint.control[1]);
    }
}

struct Rapier {
    body: RapierBody,
    torques: Vec<f64>,
    model: RobotModel,
}

impl Rapier {
    fn new(model: RobotModel) -> Result<Self, Box<dyn Error>> {
        let division = Division { steps: model.description.substeps as usize, substeps: 1 };
        let body = RapierBody::new(&model, division)?;
        Ok(Self { body, torques: vec![0.0; model.joints.len()], model })
    }
}

impl Bare for Rapier {
    fn run(&mut self, start: &State, actions: &[f32]) -> Result<(), Box<dyn Error>> {
        self.body.restore(&start.positions, &start.velocities)?;
        for row in actions.chunks_exact(self.torques.len()) {
            torques(&self.model, row, &mut self.torques);
            self.body.advance(&self.torques)?;
        }
        Ok(())
    }

    fn positions(&self) -> Vec<f64> {
        let mut positions = vec![0.0; self.model.standard_positions.len()];
        self.body.coordinates(&mut positions, &mut vec![0.0; self.model.velocity_count]);
        positions
    }
}

#[cfg(feature = "mujoco")]
mod mujoco_rs_loop {
    use std::error::Error;

    use elo_backends::locomotion::model::RobotModel;
    use elo_core::simulator::State;
    use mujoco_rs::mujoco_c::mjtDisableBit;
    use mujoco_rs::prelude::{MjData, MjModel};

    use super::Bare;

    pub struct Mujoco {
        data: MjData<Box<MjModel>>,
        torques: Vec<f64>,
        model: RobotModel,
    }

    impl Mujoco {
        pub fn new(model: &RobotModel) -> Result<Self, Box<dyn Error>> {
            let mut compiled = MjModel::from_xml_string(&model.description.mjcf)?;
            // Torques are applied to the joints themselves.
            compiled.opt_mut().disableflags |= mjtDisableBit::mjDSBL_ACTUATION as i32;
            let data = MjData::new(Box::new(compiled));
            Ok(Self { data, torques: vec![0.0; model.joints.len()], model: model.clone() })
        }
    }

    impl Bare for Mujoco {
        fn run(&mut self, start: &State, actions: &[f32]) -> Result<(), Box<dyn Error>> {
            self.data.reset();
            self.data.qpos_mut().copy_from_slice(&start.positions);
            self.data.qvel_mut().copy_from_slice(&start.velocities);
            for row in actions.chunks_exact(self.torques.len()) {
                super::torques(&self.model, row, &mut self.torques);
                let applied = self.data.qfrc_applied_mut();
                for (joint, torque) in self.model.joints.iter().zip(&self.torques) {
                    applied[joint.velocity] = *torque;
                }
                for _ in 0..self.model.description.substeps {
                    self.data.step();
                }
            }
            Ok(())
        }

        fn positions(&self) -> Vec<f64> {
            self.data.qpos().to_vec()
        }
    }
}
