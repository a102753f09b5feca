//! Joint torques. The engine knows only torques on bodies: an equal and opposite pair along the joint's axis is, in
//! reduced coordinates, exactly the torque of the joint.

use mjcf_rs::glam::{DQuat, DVec3};

use super::builder::World;
use super::skeleton::{Motor, Skeleton};

/// Replaces all forces by these torques (N m; N on slides), one a motor, along the joints' present axes. They act until
/// the next call.
pub(super) fn apply(world: &mut World, skeleton: &Skeleton, torques: &[f64]) {
    for handle in &world.links {
        let body = &mut world.bodies[handle.body];
        body.reset_forces(false);
        body.reset_torques(false);
    }
    for (motor, torque) in skeleton.motors.iter().zip(torques) {
        drive(world, skeleton, motor, *torque);
    }
}

fn drive(world: &mut World, skeleton: &Skeleton, motor: &Motor, torque: f64) {
    let link = &skeleton.links[motor.link];
    let parent = link.parent.map(|p| world.links[p].body);
    let parent_turn = parent.map_or(DQuat::IDENTITY, |p| world.bodies[p].position().rotation);
    let unit = [DVec3::X, DVec3::Y, DVec3::Z][motor.freedom.axis % 3];
    let push = parent_turn * (link.frame_on_parent.rotation * unit) * (motor.freedom.sign * torque);
    let handle = world.links[motor.link];
    let child = &mut world.bodies[handle.body];
    if motor.freedom.axis >= 3 {
        child.add_torque(push, false);
        if let Some(parent) = parent {
            world.bodies[parent].add_torque(-push, false);
        }
    } else {
        let at = *child.position() * handle.centre;
        child.add_force(push, false);
        if let Some(parent) = parent {
            world.bodies[parent].add_force_at_point(-push, at, false);
        }
    }
}
