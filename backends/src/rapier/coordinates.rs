//! Between MuJoCo's generalised coordinates and the engine's.
//!
//! Both count hinges and slides alike, up to sign and reference. A free root differs: MuJoCo has the position and linear
//! velocity of the body's origin and the angular velocity in its own axes; the engine has those of the centre of mass,
//! and everything in world axes.

use mjcf_rs::glam::{DQuat, DVec3};

use super::builder::{World, rank};
use super::skeleton::{Freedoms, Motor, Sizes, Skeleton};

/// Puts a pristine world's robot at these coordinates.
pub(super) fn write(world: &mut World, skeleton: &Skeleton, positions: &[f64], velocities: &[f64]) {
    let multibody = world
        .multibody_joints
        .get_multibody_mut(world.links[0].id.multibody)
        .expect("the robot is one multibody");
    for (link, handle) in skeleton.links.iter().zip(&world.links) {
        // The engine takes displacements from where the joint is: in a pristine world, from zero.
        let mut displacement = [0.0; 6];
        let mut rates = multibody.generalized_velocity_mut();
        match &link.freedoms {
            Freedoms::Free(place) => {
                let (centre, turn, rate, spin) = free_inward(place, handle.centre, positions, velocities);
                displacement[..3].copy_from_slice(&centre.to_array());
                displacement[3..].copy_from_slice(&turn.to_scaled_axis().to_array());
                for (i, x) in rate.to_array().into_iter().chain(spin.to_array()).enumerate() {
                    rates[handle.first + i] = x;
                }
            }
            Freedoms::Axes(axes) => {
                for freedom in axes {
                    let at = rank(axes, freedom);
                    displacement[at] = freedom.inward(positions[freedom.place.positions]);
                    rates[handle.first + at] = freedom.sign * velocities[freedom.place.velocities];
                }
            }
        }
        let joint = &mut multibody.link_mut(handle.id.id).expect("a link of this world").joint;
        joint.apply_displacement(&displacement);
    }
    multibody.forward_kinematics(&world.bodies, true);
    for handle in &world.links {
        let pose = *multibody.link(handle.id.id).expect("a link of this world").local_to_world();
        // Unlike the multibody's own update, this takes the colliders along.
        world.bodies[handle.body].set_position(pose, false);
    }
}

/// Centre of mass, orientation, velocity of the centre of mass, angular velocity; all in world axes.
fn free_inward(
    place: &Sizes,
    centre: DVec3,
    positions: &[f64],
    velocities: &[f64],
) -> (DVec3, DQuat, DVec3, DVec3) {
    let (p, v) = (&positions[place.positions..], &velocities[place.velocities..]);
    let turn = DQuat::from_xyzw(p[4], p[5], p[6], p[3]).normalize();
    let arm = turn * centre;
    let spin = turn * DVec3::new(v[3], v[4], v[5]);
    (DVec3::new(p[0], p[1], p[2]) + arm, turn, DVec3::new(v[0], v[1], v[2]) + spin.cross(arm), spin)
}

/// Writes MuJoCo's coordinates of where the robot is.
pub(super) fn read(world: &World, skeleton: &Skeleton, positions: &mut [f64], velocities: &mut [f64]) {
    for (index, link) in skeleton.links.iter().enumerate() {
        match &link.freedoms {
            Freedoms::Free(place) => {
                let (p, v) = (place.positions, place.velocities);
                let pose = world.pose(index);
                let turn = pose.rotation.normalize();
                let first = world.links[index].first;
                let rates = world.multibody().generalized_velocity();
                let spin = DVec3::new(rates[first + 3], rates[first + 4], rates[first + 5]);
                let origin = world.point_velocity(index, pose.translation);
                positions[p..p + 3].copy_from_slice(&pose.translation.to_array());
                positions[p + 3..p + 7].copy_from_slice(&[turn.w, turn.x, turn.y, turn.z]);
                velocities[v..v + 3].copy_from_slice(&origin.to_array());
                velocities[v + 3..v + 6].copy_from_slice(&(turn.inverse() * spin).to_array());
            }
            Freedoms::Axes(axes) => {
                for freedom in axes {
                    let motor = Motor { link: index, freedom: *freedom };
                    (positions[freedom.place.positions], velocities[freedom.place.velocities]) =
                        of_joint(world, skeleton, &motor);
                }
            }
        }
    }
}

/// A hinge's or slide's position and velocity.
pub(super) fn of_joint(world: &World, skeleton: &Skeleton, motor: &Motor) -> (f64, f64) {
    let Freedoms::Axes(axes) = &skeleton.links[motor.link].freedoms else { return (0.0, 0.0) };
    let handle = &world.links[motor.link];
    let multibody = world.multibody();
    let joint = multibody.link(handle.id.id).expect("a link of this world").joint();
    let velocity = multibody.generalized_velocity()[handle.first + rank(axes, &motor.freedom)];
    (motor.freedom.outward(joint.coords()[motor.freedom.axis]), motor.freedom.sign * velocity)
}
