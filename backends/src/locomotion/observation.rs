//! The observation of Roboschool's walkers, from poses and velocities.
//!
//! Numbers 0 to 7 are the torso's: height above the reset's, sine and cosine of the angle to the target, 0.3 times its
//! velocity (m/s) along its heading, to its left and upwards, roll and pitch (rad). Then two numbers a joint: position
//! across its range from -1 to 1, and 0.1 times its velocity (rad/s). Then one number a foot: 1 if it touched the floor
//! one control step ago, else 0. Everything is clipped to ±5.

use elo_core::scene::Pose;

use super::body::Reading;
use super::model::{ActuatedJoint, RobotModel};
use super::reward::TARGET;

/// Clipping bound of every number.
const BOUND: f64 = 5.0;

/// Roll, pitch and yaw in rad of a unit quaternion (w first), turned first about x, then y, then z. Pitch is within
/// ±π/2; beyond, roll and yaw flip by π.
pub fn roll_pitch_yaw([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    [
        (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
        (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    ]
}

/// Where the point with these coordinates in a frame is in the world, in m.
pub fn in_world(frame: &Pose, [x, y, z]: [f64; 3]) -> [f64; 3] {
    // v + 2 w (q × v) + 2 q × (q × v), with the quaternion's vector part q.
    let [w, a, b, c] = frame.rotation;
    let cross = [b * z - c * y, c * x - a * z, a * y - b * x];
    let twice = [b * cross[2] - c * cross[1], c * cross[0] - a * cross[2], a * cross[1] - b * cross[0]];
    let turned = |i: usize, v: f64| v + 2.0 * (w * cross[i] + twice[i]);
    let [px, py, pz] = frame.position;
    [px + turned(0, x), py + turned(1, y), pz + turned(2, z)]
}

/// The position of a joint across its range: -1 and 1 at the limits, beyond them outside.
pub fn normalised(joint: &ActuatedJoint, position: f64) -> f64 {
    let [low, high] = joint.range;
    2.0 * (position - 0.5 * (low + high)) / (high - low)
}

/// What a reading says of the whole robot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stance {
    /// Height of the torso's centre of mass in m.
    pub height: f64,
    /// Mean place of the progress points on the floor's plane, in m.
    pub place: [f64; 2],
    /// The torso's roll, pitch and yaw in rad.
    pub angles: [f64; 3],
}

impl Stance {
    /// Computes it.
    pub fn of(model: &RobotModel, reading: &Reading) -> Self {
        let torso = &reading.bodies[model.torso];
        let mut place = [0.0; 2];
        for &(body, offset, share) in &model.progress {
            let pose = &reading.bodies[body];
            let [x, y, _] = if offset == [0.0; 3] { pose.position } else { in_world(pose, offset) };
            place[0] += share * x;
            place[1] += share * y;
        }
        Self {
            height: in_world(torso, model.bodies[model.torso].center)[2],
            place,
            angles: roll_pitch_yaw(torso.rotation),
        }
    }
}

/// What the observation remembers of earlier steps.
#[derive(Clone, Copy, Debug)]
pub struct Remembered<'a> {
    /// The torso's height at the reset, in m.
    pub height: f64,
    /// Whether each foot touched the floor, in the order of the feet.
    pub feet: &'a [bool],
}

/// Writes the observation (`RobotModel::observation_size` numbers).
pub fn observe(
    model: &RobotModel,
    reading: &Reading,
    stance: &Stance,
    remembered: Remembered<'_>,
    observation: &mut [f32],
) {
    let clip = |x: f64| x.clamp(-BOUND, BOUND) as f32;
    let [roll, pitch, yaw] = stance.angles;
    let [x, y] = stance.place;
    let to_target = (TARGET[1] - y).atan2(TARGET[0] - x) - yaw;
    let (sin, cos) = yaw.sin_cos();
    let [vx, vy, vz] = reading.torso_velocity;
    let torso = [
        stance.height - remembered.height,
        to_target.sin(),
        to_target.cos(),
        0.3 * (cos * vx + sin * vy),
        0.3 * (cos * vy - sin * vx),
        0.3 * vz,
        roll,
        pitch,
    ];
    let (head, rest) = observation.split_at_mut(torso.len());
    let (joints, feet) = rest.split_at_mut(2 * model.joints.len());
    head.iter_mut().zip(torso).for_each(|(out, x)| *out = clip(x));
    for (j, joint) in model.joints.iter().enumerate() {
        joints[2 * j] = clip(normalised(joint, reading.joint_positions[j]));
        joints[2 * j + 1] = clip(0.1 * reading.joint_velocities[j]);
    }
    feet.iter_mut().zip(remembered.feet).for_each(|(out, &touches)| *out = f32::from(u8::from(touches)));
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::locomotion::robot::built_in;

    fn near(a: &[f64], b: &[f64]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    /// `first` turned further by `then`, about the world's axes.
    fn after(then: [f64; 4], first: [f64; 4]) -> [f64; 4] {
        let ([a, b, c, d], [w, x, y, z]) = (then, first);
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]
    }

    #[test]
    fn angles_undo_the_rotation_they_name() {
        let about = |axis: usize, angle: f64| {
            let mut q = [(angle / 2.0).cos(), 0.0, 0.0, 0.0];
            q[axis + 1] = (angle / 2.0).sin();
            q
        };
        let q = after(about(2, 0.5), after(about(1, -0.7), about(0, 0.3)));
        assert!(near(&roll_pitch_yaw(q), &[0.3, -0.7, 0.5]));
        // Past the vertical the planar robots' yaw flips.
        let [roll, pitch, yaw] = roll_pitch_yaw(about(1, 2.0));
        assert!(near(
            &[pitch, yaw.abs(), roll.abs()],
            &[std::f64::consts::PI - 2.0, std::f64::consts::PI, std::f64::consts::PI]
        ));
    }

    #[test]
    fn points_turn_with_their_frame() {
        // A quarter turn about z takes x to y; about y it takes z to x.
        let h = std::f64::consts::FRAC_1_SQRT_2;
        let frame = Pose { position: [1.0, 2.0, 3.0], rotation: [h, 0.0, 0.0, h] };
        assert!(near(&in_world(&frame, [1.0, 0.0, 0.5]), &[1.0, 3.0, 3.5]));
        let frame = Pose { position: [0.0; 3], rotation: [h, 0.0, h, 0.0] };
        assert!(near(&in_world(&frame, [0.0, 0.0, 2.0]), &[2.0, 0.0, 0.0]));
    }

    #[test]
    fn a_hand_made_reading_gives_the_numbers_worked_out_by_hand() {
        let model = crate::locomotion::model::RobotModel::load(&built_in("half-cheetah").unwrap()).unwrap();
        // Everything at one place 2 m up, turned by a quarter about z; heading is +y, the target lies to the right.
        let h = std::f64::consts::FRAC_1_SQRT_2;
        let pose = Pose { position: [0.0, 0.0, 2.0], rotation: [h, 0.0, 0.0, h] };
        let reading = Reading {
            bodies: vec![pose; 7],
            torso_velocity: [1.0, 2.0, -30.0],
            // bthigh's range is -0.52 to 1.05: the middle is 0.265, the half 0.785.
            // bshin's middle is 0: eight times its limit is clipped.
            joint_positions: vec![1.05, -0.785 * 8.0, 0.0, 0.0, 0.0, -0.3],
            joint_velocities: vec![10.0, -70.0, 0.0, 0.0, 0.0, 0.0],
            on_floor: vec![false; 7],
        };
        let stance = Stance::of(&model, &reading);
        assert!(near(&[stance.height, stance.place[0], stance.angles[2]], &[2.0, 0.0, FRAC_PI_2]));
        let feet = [true, false, false, true, false, false];
        let mut observation = vec![9.0; 26];
        observe(&model, &reading, &stance, Remembered { height: 0.7, feet: &feet }, &mut observation);
        let expected = [1.3, -1.0, 0.0, 0.6, -0.3, -5.0, 0.0, 0.0, 1.0, 1.0, -5.0, -5.0];
        for (i, (got, expected)) in observation.iter().zip(expected).enumerate() {
            assert!((got - expected).abs() < 1e-6, "{i}: {got} {expected}");
        }
        assert_eq!(observation[18], 1.0, "ffoot is at its upper limit");
        assert_eq!(observation[20..], [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    }
}
