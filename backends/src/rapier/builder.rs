//! From links to a world of the engine.

use mjcf_rs::Pose;
use mjcf_rs::glam::DVec3;
use rapier3d_f64::dynamics::{
    CCDSolver, CoefficientCombineRule, GenericJoint, ImpulseJointSet, IslandManager, JointAxesMask,
    Multibody, MultibodyJointSet, MultibodyLinkId, RigidBodyBuilder, RigidBodyHandle, RigidBodySet,
    SoftBodySet, SpringCoefficients,
};
use rapier3d_f64::geometry::{
    BroadPhaseBvh, ColliderBuilder, ColliderSet, Group, InteractionGroups, InteractionTestMode, NarrowPhase,
};

use super::inertia::Inertia;
use super::shape::{Form, Shape};
use super::skeleton::{Freedom, Freedoms, Link, Skeleton};
use crate::locomotion::body::Dynamics;

/// Everything that a trajectory depends on, and nothing else. `clone_from` reuses what is already allocated.
#[derive(Clone)]
pub(super) struct World {
    pub islands: IslandManager,
    pub broad_phase: BroadPhaseBvh,
    pub narrow_phase: NarrowPhase,
    pub bodies: RigidBodySet,
    pub colliders: ColliderSet,
    pub impulse_joints: ImpulseJointSet,
    pub multibody_joints: MultibodyJointSet,
    pub soft_bodies: SoftBodySet,
    pub ccd_solver: CCDSolver,
    /// Links in the skeleton's order.
    pub links: Vec<LinkHandle>,
}

/// One link's names in the engine.
#[derive(Clone, Copy)]
pub(super) struct LinkHandle {
    pub body: RigidBodyHandle,
    pub id: MultibodyLinkId,
    /// Where its freedoms start in the engine's generalised vectors.
    pub first: usize,
    /// Centre of mass in the link's frame, m.
    pub centre: DVec3,
}

impl World {
    /// The robot at zero coordinates, at rest, with the payload on body `torso`.
    pub fn build(
        skeleton: &Skeleton,
        dynamics: &Dynamics,
        torso: usize,
        limits: SpringCoefficients<f64>,
    ) -> Self {
        let mut world = Self {
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            narrow_phase: NarrowPhase::new(),
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            impulse_joints: ImpulseJointSet::new(),
            multibody_joints: MultibodyJointSet::new(),
            soft_bodies: SoftBodySet::new(),
            ccd_solver: CCDSolver::new(),
            links: Vec::with_capacity(skeleton.links.len()),
        };
        // The floor must not be the body that the robot's joints hang on: contacts between those two would count as the
        // robot's contacts with itself.
        let ground = world.bodies.insert(RigidBodyBuilder::fixed());
        let root = world.bodies.insert(RigidBodyBuilder::fixed());
        for obstacle in &skeleton.obstacles {
            let floor = obstacle.form == Form::Plane;
            world.add_collider(
                obstacle,
                if floor { dynamics.floor_friction } else { obstacle.friction },
                ground,
            );
        }
        for (index, link) in skeleton.links.iter().enumerate() {
            let mut inertia = link.inertia;
            if skeleton.places[torso].link == Some(index) {
                let place = &skeleton.places[torso];
                inertia = inertia.plus(&Inertia::point(dynamics.payload, place.pose * place.centre));
            }
            let parent = link.parent.map_or(root, |p| world.links[p].body);
            world.add_link(link, &inertia, parent, limits);
            for shape in &link.shapes {
                world.add_collider(shape, shape.friction, world.links[index].body);
            }
        }
        world.set_passive_forces(skeleton, robot_touches_itself(skeleton));
        world
    }

    fn add_link(
        &mut self,
        link: &Link,
        inertia: &Inertia,
        parent: RigidBodyHandle,
        limits: SpringCoefficients<f64>,
    ) {
        let body = self.bodies.insert(
            RigidBodyBuilder::dynamic().can_sleep(false).additional_mass_properties(inertia.to_engine()),
        );
        let mut joint = GenericJoint {
            local_frame1: link.frame_on_parent,
            local_frame2: link.frame,
            locked_axes: JointAxesMask::all(),
            contacts_enabled: link.parent.is_none(),
            softness: limits,
            ..GenericJoint::default()
        };
        match &link.freedoms {
            Freedoms::Free(_) => {
                // The engine moves the joint's frame with the velocity of the centre of mass.
                joint.local_frame2 = Pose::from_translation(inertia.centre);
                joint.locked_axes = JointAxesMask::empty();
            }
            Freedoms::Axes(axes) => axes.iter().for_each(|freedom| unlock(&mut joint, freedom)),
        }
        let handle = self
            .multibody_joints
            .insert(parent, body, joint, true)
            .expect("every link is inserted once, after its parent");
        let id = *self.multibody_joints.rigid_body_link(body).expect("it has just been inserted");
        if let Freedoms::Axes(axes) = &link.freedoms {
            let (multibody, index) =
                self.multibody_joints.get_mut(handle).expect("it has just been inserted");
            let joint = &mut multibody.link_mut(index).expect("the link just inserted").joint;
            for freedom in axes.iter().filter(|f| f.stiffness != 0.0) {
                joint.set_spring(freedom.axis, freedom.stiffness, freedom.inward(freedom.spring_rest));
            }
        }
        self.links.push(LinkHandle { body, id, first: 0, centre: inertia.centre });
    }

    fn add_collider(&mut self, shape: &Shape, friction: f64, parent: RigidBodyHandle) {
        let groups = InteractionGroups::new(
            Group::from_bits_truncate(shape.contype),
            Group::from_bits_truncate(shape.conaffinity),
            InteractionTestMode::Or,
        );
        let collider = ColliderBuilder::new(shape.form.to_engine())
            .position(shape.pose)
            .density(0.0)
            .friction(friction)
            .friction_combine_rule(CoefficientCombineRule::Max)
            .restitution(0.0)
            .collision_groups(groups);
        self.colliders.insert_with_parent(collider, parent, &mut self.bodies);
    }

    /// Armature, damping and dry friction; the engine's own damping of angular freedoms goes.
    fn set_passive_forces(&mut self, skeleton: &Skeleton, self_contacts: bool) {
        let (multibody, bodies) = (
            self.multibody_joints
                .get_multibody_mut(self.links[0].id.multibody)
                .expect("there is at least one link"),
            &self.bodies,
        );
        // Fixes the root, which changes the number of freedoms.
        multibody.forward_kinematics(bodies, true);
        multibody.set_self_contacts_enabled(self_contacts);
        multibody.damping_mut().fill(0.0);
        for (link, handle) in skeleton.links.iter().zip(&mut self.links) {
            handle.first = multibody.link(handle.id.id).expect("a link of this world").assembly_id();
            if let Freedoms::Axes(axes) = &link.freedoms {
                for freedom in axes {
                    let at = handle.first + rank(axes, freedom);
                    multibody.damping_mut()[at] = freedom.damping;
                    multibody.armature_mut()[at] = freedom.armature;
                    multibody.frictions_mut()[at] = freedom.friction;
                }
            }
        }
    }

    /// The robot, as one.
    pub fn multibody(&self) -> &Multibody {
        self.multibody_joints.get_multibody(self.links[0].id.multibody).expect("there is at least one link")
    }

    /// Where a link is.
    pub fn pose(&self, link: usize) -> &Pose {
        self.bodies[self.links[link].body].position()
    }

    /// Velocity of a point (in the world, m) that moves with a link, in world axes. The engine's own link velocities are
    /// those before the last sub-step.
    pub fn point_velocity(&self, link: usize, point: DVec3) -> DVec3 {
        let handle = &self.links[link];
        let multibody = self.multibody();
        let twist = multibody.body_jacobian(handle.id.id) * multibody.generalized_velocity();
        let centre = *self.pose(link) * handle.centre;
        let spin = DVec3::new(twist[3], twist[4], twist[5]);
        DVec3::new(twist[0], twist[1], twist[2]) + spin.cross(point - centre)
    }

    /// Copies another world without allocating where sizes agree.
    pub fn restore(&mut self, pristine: &Self) {
        self.islands.clone_from(&pristine.islands);
        self.broad_phase.clone_from(&pristine.broad_phase);
        self.narrow_phase.clone_from(&pristine.narrow_phase);
        self.bodies.clone_from(&pristine.bodies);
        self.colliders.clone_from(&pristine.colliders);
        self.impulse_joints.clone_from(&pristine.impulse_joints);
        self.multibody_joints.clone_from(&pristine.multibody_joints);
        self.soft_bodies.clone_from(&pristine.soft_bodies);
        self.ccd_solver.clone_from(&pristine.ccd_solver);
        self.links.clone_from(&pristine.links);
    }
}

fn unlock(joint: &mut GenericJoint, freedom: &Freedom) {
    let axis = JointAxesMask::from_bits_truncate(1 << freedom.axis);
    joint.locked_axes.remove(axis);
    if let Some([least, greatest]) = freedom.range {
        let ends = [freedom.inward(least), freedom.inward(greatest)];
        joint.limit_axes |= axis;
        joint.limits[freedom.axis].min = ends[0].min(ends[1]);
        joint.limits[freedom.axis].max = ends[0].max(ends[1]);
    }
}

/// A freedom's place among its joint's: the engine counts axes upwards.
pub(super) fn rank(axes: &[Freedom], freedom: &Freedom) -> usize {
    axes.iter().filter(|other| other.axis < freedom.axis).count()
}

fn robot_touches_itself(skeleton: &Skeleton) -> bool {
    let shapes: Vec<&Shape> = skeleton.links.iter().flat_map(|link| &link.shapes).collect();
    shapes.iter().any(|a| shapes.iter().any(|b| a.meets(b)))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::engine::RapierBody;
    use super::super::settings::Division;
    use crate::locomotion::body::ArticulatedBody as _;
    use crate::locomotion::model::RobotModel;
    use crate::locomotion::robot::{AliveRule, RobotDescription, built_in};

    /// Positions after a number of control steps of 10 ms in 10 engine steps, without torques.
    fn positions(bodies: &str, start: (&[f64], &[f64]), control_steps: usize) -> Vec<f64> {
        let mjcf = format!(
            r#"<mujoco><compiler angle="radian"/><option timestep="0.001" gravity="0 0 -9.8"/><worldbody>
            <geom type="plane" size="0 0 1" contype="0" conaffinity="0"/>{bodies}</worldbody>
            <actuator><motor joint="motor"/></actuator></mujoco>"#
        );
        let description = RobotDescription {
            mjcf,
            torso: "torso".to_owned(),
            substeps: 10,
            feet: Vec::new(),
            alive: AliveRule::default(),
            progress: Vec::new(),
            ..built_in("ant").unwrap()
        };
        let model = RobotModel::load(&description).unwrap();
        let mut body = RapierBody::new(&model, Division { steps: 10, substeps: 1 }).unwrap();
        body.restore(start.0, start.1).unwrap();
        (0..control_steps).for_each(|_| body.advance(&[0.0]).unwrap());
        let mut end = (start.0.to_vec(), start.1.to_vec());
        body.coordinates(&mut end.0, &mut end.1);
        end.0
    }

    /// A wheel of 0.5 kg m² about z, which gravity does not turn.
    fn wheel(joint: &str) -> String {
        format!(
            r#"<body name="torso"><inertial pos="0 0 0" mass="1" diaginertia="1 1 0.5"/>
            <joint name="motor" axis="0 0 1" range="-9 9" {joint}/></body>"#
        )
    }

    #[test]
    fn springs_swing_about_their_rest_with_the_armature_on_board() {
        // ω = sqrt(8 / (0.5 + 1.5)) = 2/s, so half a period is π/2 s: from 0.9 past the rest at 0.5 to 0.1.
        let wheel = wheel("stiffness='8' springref='0.5' armature='1.5'");
        let end = positions(&wheel, (&[0.9], &[0.0]), 157)[0];
        assert!((end - 0.1).abs() < 2e-3, "{end}");
        // Given with the coordinate counted from 3, everything moves along.
        let counted = wheel.replace("springref='0.5'", "springref='3.5' ref='3'");
        let from_three = positions(&counted, (&[3.9], &[0.0]), 157)[0];
        assert!((from_three - 3.0 - end).abs() < 1e-9, "{from_three}");
    }

    #[test]
    fn damping_and_dry_friction_are_those_of_the_file() {
        // Rapier's own damping of 0.1 would stop the wheel.
        let coasting = positions(&wheel(""), (&[0.0], &[1.0]), 200)[0];
        assert!((coasting - 2.0).abs() < 1e-9, "{coasting}");
        // v = exp(-t d/I): to 1 - exp(-2) times I/d after two time constants.
        let braked = positions(&wheel("damping='0.5'"), (&[0.0], &[1.0]), 200)[0];
        assert!((braked - (1.0 - (-2f64).exp())).abs() < 1e-3, "{braked}");
        // v² I / (2 friction) = 0.25.
        let rubbed = positions(&wheel("frictionloss='1'"), (&[0.0], &[1.0]), 200)[0];
        assert!((rubbed - 0.25).abs() < 1e-3, "{rubbed}");
    }

    #[test]
    fn several_hinges_on_a_body_are_those_of_bodies_in_a_row() {
        let limb = r#"<inertial pos="0.2 0.1 -0.3" mass="2" diaginertia="0.03 0.02 0.01"/>"#;
        let hinges = [
            r#"<joint name="motor" axis="1 0 0" range="-3 3"/>"#,
            r#"<joint axis="0 1 0"/>"#,
            r#"<joint axis="0 0.6 0.8"/>"#,
        ];
        let one = format!(r#"<body name="torso">{}{limb}</body>"#, hinges.concat());
        let dust = r#"<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/>"#;
        let three = format!(
            r#"<body name="torso">{}{dust}<body name="b">{}{dust}<body name="c">{}{limb}</body></body></body>"#,
            hinges[0], hinges[1], hinges[2]
        );
        let start: (&[f64], &[f64]) = (&[0.3, -0.4, 0.5], &[1.0, 2.0, -1.0]);
        let (row, body) = (positions(&three, start, 25), positions(&one, start, 25));
        assert!(row.iter().zip(&body).all(|(a, b)| (a - b).abs() < 1e-5), "{row:?} {body:?}");
        assert!((body[0] - 0.3).abs() > 0.05, "nothing moved: {body:?}");
    }

    #[test]
    fn bodies_without_joints_weigh_as_if_they_were_one() {
        let whole = r#"<body name="torso"><joint name="motor" axis="0 1 0" range="-9 9"/>
            <inertial pos="0 0 -1" mass="3" diaginertia="2.1 2.1 0.1"/></body>"#;
        // Two points 1 m above and below the middle: 1 · 1² each, with 1 kg more at the middle, and 0.1 of its own.
        let parts = r#"<body name="torso"><joint name="motor" axis="0 1 0" range="-9 9"/>
            <inertial pos="0 0 -1" mass="1" diaginertia="0.1 0.1 0.1"/>
            <body name="a"><inertial pos="0 0 0" mass="1" diaginertia="1e-12 1e-12 1e-12"/></body>
            <body name="b" pos="0 0 -1"><inertial pos="0 0 -1" mass="1" diaginertia="1e-12 1e-12 1e-12"/></body></body>"#;
        let swing = |bodies| positions(bodies, (&[0.5], &[0.0]), 100)[0];
        assert!((swing(whole) - swing(parts)).abs() < 1e-9, "{} {}", swing(whole), swing(parts));
    }
}
