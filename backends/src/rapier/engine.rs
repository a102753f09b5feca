//! One robot in one world, stepped.

use mjcf_rs::Pose;
use mjcf_rs::glam::DVec3;
use rapier3d_f64::dynamics::{IntegrationParameters, SpringCoefficients};
use rapier3d_f64::pipeline::PhysicsPipeline;

use elo_core::simulator::{SimulatorError, check_length};

use super::builder::World;
use super::shape::Form;
use super::skeleton::Skeleton;
use super::{coordinates, motors};
use crate::locomotion::body::{ArticulatedBody, Dynamics, Pose as BodyPose, Reading};
use crate::locomotion::model::RobotModel;

/// How the engine divides a control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Division {
    /// Engine steps in it: contacts are found and torques turned to their axes once in each.
    pub steps: usize,
    /// Parts of an engine step, in each of which the equations of motion are set up and solved anew.
    pub substeps: usize,
}

/// A gap below which a geom counts as touching the floor, m.
const TOUCH: f64 = 1e-3;

/// Coordinates beyond this mean that the simulation has failed (MuJoCo's bound).
const BEYOND: f64 = 1e10;

/// A robot in Rapier.
pub struct RapierBody {
    skeleton: Skeleton,
    torso: usize,
    parameters: IntegrationParameters,
    steps: usize,
    dynamics: Dynamics,
    pristine: World,
    world: World,
    pipeline: PhysicsPipeline,
}

impl RapierBody {
    /// Loads a robot, with the dynamics of its file.
    ///
    /// # Errors
    /// The first element of the file that this engine cannot represent, by name; a division without steps.
    pub fn new(model: &RobotModel, division: Division) -> Result<Self, String> {
        if division.steps == 0 || division.substeps == 0 {
            return Err("a control step needs at least one engine step of one part".to_owned());
        }
        let skeleton = Skeleton::of(&model.mjcf)?;
        let (torso, dynamics) = (model.torso, model.dynamics);
        let parameters = parameters(model.control_step(), division);
        let pristine = pristine(&skeleton, &dynamics, torso, &parameters);
        Ok(Self {
            world: pristine.clone(),
            pipeline: PhysicsPipeline::new(),
            steps: division.steps,
            skeleton,
            torso,
            parameters,
            dynamics,
            pristine,
        })
    }

    /// Pose of a body's frame.
    fn pose(&self, body: usize) -> Pose {
        let place = &self.skeleton.places[body];
        place.link.map_or(place.pose, |link| *self.world.pose(link) * place.pose)
    }

    fn check(&self) -> Result<(), SimulatorError> {
        let quarantine = self.pipeline.quarantine();
        let fine = |x: &f64| x.abs() < BEYOND;
        let multibody = self.world.multibody();
        let velocities_fine = multibody.generalized_velocity().iter().all(fine);
        let poses_fine = self.world.links.iter().all(|handle| {
            let position = self.world.bodies[handle.body].position();
            position.translation.to_array().iter().all(fine) && position.rotation.is_finite()
        });
        if quarantine.is_empty() && velocities_fine && poses_fine {
            Ok(())
        } else {
            Err(SimulatorError::Unstable("Rapier's coordinates are no longer finite numbers".to_owned()))
        }
    }

    /// Marks the bodies of which some geom is within [`TOUCH`] of the floor, or in it.
    fn mark_contacts(&self, on_floor: &mut [bool]) {
        on_floor.fill(false);
        for (index, link) in self.skeleton.links.iter().enumerate() {
            let at = self.world.pose(index);
            for shape in &link.shapes {
                let mut floors =
                    self.skeleton.obstacles.iter().filter(|o| o.form == Form::Plane && o.meets(shape));
                on_floor[shape.body] |= floors.any(|floor| shape.gap_above(floor, at) <= TOUCH);
            }
        }
    }
}

impl ArticulatedBody for RapierBody {
    fn set_dynamics(&mut self, dynamics: &Dynamics) -> Result<(), SimulatorError> {
        let heavy_enough = |payload: f64| payload.is_finite() && payload >= 0.0;
        if !heavy_enough(dynamics.payload) || !heavy_enough(dynamics.floor_friction) {
            return Err(SimulatorError::Task(format!(
                "friction {} and payload {} must be finite and not negative",
                dynamics.floor_friction, dynamics.payload
            )));
        }
        if *dynamics != self.dynamics {
            self.pristine = pristine(&self.skeleton, dynamics, self.torso, &self.parameters);
            self.dynamics = *dynamics;
        }
        Ok(())
    }

    fn restore(&mut self, positions: &[f64], velocities: &[f64]) -> Result<(), SimulatorError> {
        check_length("positions", positions.len(), self.skeleton.sizes.positions)?;
        check_length("velocities", velocities.len(), self.skeleton.sizes.velocities)?;
        if let Some(bad) = positions.iter().chain(velocities).find(|x| !x.is_finite()) {
            return Err(SimulatorError::Start(format!("a coordinate is {bad}")));
        }
        self.world.restore(&self.pristine);
        self.pipeline = PhysicsPipeline::new();
        coordinates::write(&mut self.world, &self.skeleton, positions, velocities);
        Ok(())
    }

    fn advance(&mut self, torques: &[f64]) -> Result<(), SimulatorError> {
        check_length("torques", torques.len(), self.skeleton.motors.len())?;
        for _ in 0..self.steps {
            motors::apply(&mut self.world, &self.skeleton, torques);
            step(&mut self.pipeline, &mut self.world, self.skeleton.gravity, &self.parameters);
        }
        self.check()
    }

    fn read(&self, reading: &mut Reading) {
        for body in 0..self.skeleton.places.len() {
            let pose = self.pose(body);
            let q = pose.rotation.normalize();
            reading.bodies[body] =
                BodyPose { position: pose.translation.to_array(), rotation: [q.w, q.x, q.y, q.z] };
        }
        self.mark_contacts(&mut reading.on_floor);
        let place = &self.skeleton.places[self.torso];
        reading.torso_velocity = place.link.map_or([0.0; 3], |link| {
            self.world.point_velocity(link, self.pose(self.torso) * place.centre).to_array()
        });
        for (index, motor) in self.skeleton.motors.iter().enumerate() {
            let (position, velocity) = coordinates::of_joint(&self.world, &self.skeleton, motor);
            reading.joint_positions[index] = position;
            reading.joint_velocities[index] = velocity;
        }
    }

    fn coordinates(&self, positions: &mut [f64], velocities: &mut [f64]) {
        coordinates::read(&self.world, &self.skeleton, positions, velocities);
    }
}

/// The robot at zero coordinates, entered into the engine's tables, so that copies need not do it again.
fn pristine(
    skeleton: &Skeleton,
    dynamics: &Dynamics,
    torso: usize,
    parameters: &IntegrationParameters,
) -> World {
    let mut world = World::build(skeleton, dynamics, torso, limit_softness());
    let still = IntegrationParameters { dt: 0.0, ..*parameters };
    step(&mut PhysicsPipeline::new(), &mut world, DVec3::ZERO, &still);
    world
}

fn parameters(control_step: f64, division: Division) -> IntegrationParameters {
    IntegrationParameters {
        dt: control_step / division.steps as f64,
        num_solver_iterations: division.substeps,
        // Nothing is carried from step to step but coordinates: without this a restored state does not continue as
        // the run did, and robots at rest tremble (see the module's table). More iterations make up for it.
        warmstart_coefficient: 0.0,
        contact_recycling: false,
        num_internal_pgs_iterations: 4,
        num_internal_stabilization_iterations: 4,
        // The floor is a half-space, which nothing can pass.
        max_ccd_substeps: 0,
        ..IntegrationParameters::default()
    }
}

/// Joint limits are absorbing stops, as in the robots' files for MuJoCo and in Roboschool: a joint that moves outwards
/// stops, and one that starts outside stays there until something pushes it in, but for a return at half its excess per
/// second. (The engine's own default returns within one part of a step, with hundreds of rad/s; and a soft spring would
/// depend on the length of the step, because the engine forgets the velocity with which it corrects positions.)
fn limit_softness() -> SpringCoefficients<f64> {
    // Rate of return ω / (2 ζ) = 0.5/s; a compliance of 1/(2 ζ² · rate · step), about 1e-4, is as good as none.
    let (angular_frequency, damping_ratio) = (1000.0, 1000.0);
    SpringCoefficients::new(angular_frequency / std::f64::consts::TAU, damping_ratio)
}

fn step(
    pipeline: &mut PhysicsPipeline,
    world: &mut World,
    gravity: DVec3,
    parameters: &IntegrationParameters,
) {
    pipeline.step(
        gravity,
        parameters,
        &mut world.islands,
        &mut world.broad_phase,
        &mut world.narrow_phase,
        &mut world.bodies,
        &mut world.colliders,
        &mut world.impulse_joints,
        &mut world.multibody_joints,
        &mut world.soft_bodies,
        &mut world.ccd_solver,
        &(),
        &(),
    );
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::locomotion::laws::LAWS;
    use crate::locomotion::liars;

    fn build(model: &RobotModel) -> Box<dyn ArticulatedBody> {
        let division = Division { steps: model.description.substeps as usize, substeps: 1 };
        Box::new(RapierBody::new(model, division).unwrap())
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
}
