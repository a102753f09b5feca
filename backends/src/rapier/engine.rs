//! One robot in one world, stepped.

use mjcf_rs::Pose;
use mjcf_rs::glam::DVec3;
use rapier3d_f64::dynamics::IntegrationParameters;
use rapier3d_f64::pipeline::PhysicsPipeline;

use elo_core::scene::Pose as BodyPose;
use elo_core::simulator::{SimulatorError, check_length};

use super::builder::World;
use super::settings::{self, Division};
use super::shape::Form;
use super::skeleton::Skeleton;
use super::{coordinates, motors};
use crate::locomotion::body::{ArticulatedBody, Dynamics, Reading};
use crate::locomotion::model::RobotModel;

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
        let parameters = settings::parameters(model.control_step(), division);
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
    let mut world = World::build(skeleton, dynamics, torso, settings::limit_softness());
    let still = IntegrationParameters { dt: 0.0, ..*parameters };
    step(&mut PhysicsPipeline::new(), &mut world, DVec3::ZERO, &still);
    world
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
    use crate::locomotion::robot::{NAMES, built_in};
    use elo_core::seed::Seed;
    use rand::RngExt as _;

    fn built(name: &str) -> RobotModel {
        RobotModel::load(&built_in(name).unwrap()).unwrap()
    }

    fn body(model: &RobotModel) -> RapierBody {
        let division = Division { steps: model.description.substeps as usize, substeps: 1 };
        RapierBody::new(model, division).unwrap()
    }

    fn build(model: &RobotModel) -> Box<dyn ArticulatedBody> {
        Box::new(body(model))
    }

    /// The standard start of an episode and its torques, full and random.
    struct Episode {
        positions: Vec<f64>,
        velocities: Vec<f64>,
        torques: Vec<Vec<f64>>,
    }

    impl Episode {
        fn of(model: &RobotModel, seed: u64) -> Self {
            let mut stream = Seed::root(seed).stream();
            let mut draw = || 2.0 * stream.random::<f64>() - 1.0;
            let mut positions = model.standard_positions.clone();
            model.joints.iter().for_each(|joint| positions[joint.position] += 0.1 * draw());
            let torques =
                (0..200).map(|_| model.joints.iter().map(|joint| joint.gear * draw()).collect()).collect();
            Self { positions, velocities: vec![0.0; model.velocity_count], torques }
        }

        fn begin(&self, body: &mut RapierBody) {
            body.restore(&self.positions, &self.velocities).unwrap();
        }

        /// Where it ends.
        fn run(&self, body: &mut RapierBody) -> (Vec<f64>, Vec<f64>) {
            self.begin(body);
            self.torques.iter().for_each(|torques| body.advance(torques).unwrap());
            self.end(body)
        }

        fn end(&self, body: &RapierBody) -> (Vec<f64>, Vec<f64>) {
            let mut end = (self.positions.clone(), self.velocities.clone());
            body.coordinates(&mut end.0, &mut end.1);
            end
        }
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

    #[test]
    fn the_floor_bears_the_weight_at_rest() {
        for name in NAMES {
            let model = built(name);
            let mut body = body(&model);
            body.restore(&model.standard_positions, &vec![0.0; model.velocity_count]).unwrap();
            (0..1000).for_each(|_| body.advance(&vec![0.0; model.joints.len()]).unwrap());
            let manifolds = body.world.narrow_phase.contact_pairs().flat_map(|pair| pair.manifolds());
            let impulse: f64 = manifolds.flat_map(|m| m.points.iter().map(|point| point.data.impulse)).sum();
            let (force, weight) = (impulse / body.parameters.dt, model.total_mass() * 9.8);
            assert!((force / weight - 1.0).abs() < 1e-3, "{name}: {force} N, weight {weight} N");
        }
    }

    #[test]
    fn full_random_torque_breaks_nothing() {
        // Peak joint speeds in rad/s that MuJoCo has in 20 such episodes are 21, 51 and 31.
        for (name, fastest) in [("ant", 40.0), ("half-cheetah", 100.0), ("walker2d", 60.0)] {
            let model = built(name);
            let mut body = body(&model);
            let mut reading = Reading::sized(model.bodies.len(), model.joints.len());
            for seed in 0..5 {
                let episode = Episode::of(&model, seed);
                episode.begin(&mut body);
                for torques in &episode.torques {
                    body.advance(torques).unwrap();
                    body.read(&mut reading);
                    assert!(reading.joint_velocities.iter().all(|speed| speed.abs() < fastest), "{name}");
                    assert!(
                        reading.bodies.iter().all(|pose| pose.position[2] > -1.3),
                        "{name} falls through"
                    );
                }
            }
        }
    }

    #[test]
    fn a_restored_state_goes_on_as_the_run_did() {
        // A free root's coordinates are converted to and fro, which costs some last bits.
        for (name, tolerance) in [("ant", 1e-9), ("half-cheetah", 0.0), ("walker2d", 0.0)] {
            let model = built(name);
            let (mut run, mut other) = (body(&model), body(&model));
            let episode = Episode::of(&model, 1);
            episode.begin(&mut run);
            for (step, torques) in episode.torques.iter().enumerate() {
                let (positions, velocities) = episode.end(&run);
                other.restore(&positions, &velocities).unwrap();
                run.advance(torques).unwrap();
                other.advance(torques).unwrap();
                let (one, two) = (episode.end(&run).1, episode.end(&other).1);
                let differ = one.iter().zip(&two).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(differ <= tolerance, "{name}, step {step}: velocities differ by {differ}");
            }
        }
    }

    #[test]
    fn neither_other_episodes_nor_threads_change_a_bit() {
        for name in NAMES {
            let model = built(name);
            let episode = Episode::of(&model, 7);
            let mut used = body(&model);
            let expected = episode.run(&mut used);
            Episode::of(&model, 8).run(&mut used);
            used.set_dynamics(&Dynamics { floor_friction: 0.1, payload: 5.0 }).unwrap();
            Episode::of(&model, 9).run(&mut used);
            used.set_dynamics(&model.dynamics).unwrap();
            assert_eq!(episode.run(&mut used), expected, "{name} on the used body");
            std::thread::scope(|scope| {
                let runs: Vec<_> = (0..2).map(|_| scope.spawn(|| episode.run(&mut body(&model)))).collect();
                for run in runs {
                    assert_eq!(run.join().unwrap(), expected, "{name} in a thread");
                }
            });
        }
    }

    #[test]
    fn a_lost_state_is_reported_and_the_next_episode_is_as_good_as_new() {
        for name in NAMES {
            let model = built(name);
            let episode = Episode::of(&model, 3);
            let mut lost = body(&model);
            let expected = episode.run(&mut lost);
            episode.begin(&mut lost);
            let outcome = (0..10).try_for_each(|_| lost.advance(&vec![1e150; model.joints.len()]));
            assert!(matches!(outcome, Err(SimulatorError::Unstable(_))), "{name}: {outcome:?}");
            assert_eq!(episode.run(&mut lost), expected, "{name}");
        }
    }

    #[test]
    fn wrong_input_is_refused() {
        let model = built("ant");
        let mut ant = body(&model);
        let (positions, velocities) = (model.standard_positions.clone(), vec![0.0; 14]);
        assert!(matches!(ant.restore(&positions[1..], &velocities), Err(SimulatorError::Length { .. })));
        let mut bad = velocities.clone();
        bad[3] = f64::NAN;
        assert!(matches!(ant.restore(&positions, &bad), Err(SimulatorError::Start(_))));
        ant.restore(&positions, &velocities).unwrap();
        assert!(matches!(ant.advance(&[0.0; 7]), Err(SimulatorError::Length { .. })));
        let heavy = Dynamics { payload: f64::INFINITY, ..model.dynamics };
        assert!(matches!(ant.set_dynamics(&heavy), Err(SimulatorError::Task(_))));
        assert!(RapierBody::new(&model, Division { steps: 0, substeps: 1 }).is_err());
    }
}
