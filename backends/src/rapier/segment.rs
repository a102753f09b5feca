//! Which joints of one body make one joint of the engine.

use mjcf_rs::Pose;
use mjcf_rs::body::{Joint, JointType};
use mjcf_rs::glam::{DMat3, DQuat, DVec3};

/// Axes that differ by less than this are the same.
const PARALLEL: f64 = 1e-9;

/// Joints of one body that make one joint of the engine: all six freedoms, or slides at right angles followed by at most
/// one hinge along or across them.
#[derive(Clone, Debug)]
pub(super) struct Segment<'a> {
    pub joints: Vec<&'a Joint>,
    /// One free joint.
    pub free: bool,
    /// Of each joint: 0 to 2 for slides along x, y, z of the joint's frame, 3 to 5 for hinges about them; and -1 where
    /// the file's axis points the other way.
    pub axes: Vec<(usize, f64)>,
    /// The joint's frame in the body's.
    pub frame: Pose,
}

impl<'a> Segment<'a> {
    /// The fewest segments, in the order of the file; none for a body without joints.
    ///
    /// # Errors
    /// A joint type that this engine does not represent, or an axis without length.
    pub fn of(joints: &'a [Joint]) -> Result<Vec<Self>, String> {
        let mut segments: Vec<Self> = Vec::new();
        for joint in joints {
            let fused = segments.pop().map(|last| {
                let mut longer = last.joints.clone();
                longer.push(joint);
                (Self::fuse(longer), last)
            });
            match fused {
                None => segments.push(Self::alone(joint)?),
                Some((Some(longer), _)) => segments.push(longer),
                Some((None, last)) => segments.extend([last, Self::alone(joint)?]),
            }
        }
        Ok(segments)
    }

    fn alone(joint: &'a Joint) -> Result<Self, String> {
        let label = joint.name.as_deref().unwrap_or("without name");
        match joint.type_ {
            JointType::Free => {
                Ok(Self { joints: vec![joint], free: true, axes: Vec::new(), frame: Pose::IDENTITY })
            }
            JointType::Ball => {
                Err(format!("joint `{label}`: ball joints are not supported: use three hinges"))
            }
            JointType::Hinge | JointType::Slide => {
                Self::fuse(vec![joint]).ok_or_else(|| format!("joint `{label}`: its axis has no length"))
            }
        }
    }

    /// The joints as one, if they can be.
    fn fuse(joints: Vec<&'a Joint>) -> Option<Self> {
        let hinge = joints.iter().position(|j| j.type_ == JointType::Hinge);
        let slides = hinge.unwrap_or(joints.len());
        if hinge.is_some_and(|h| h + 1 != joints.len())
            || joints[..slides].iter().any(|j| j.type_ != JointType::Slide)
        {
            return None;
        }
        let axes: Option<Vec<DVec3>> =
            joints.iter().map(|j| DVec3::from_array(j.axis).try_normalize()).collect();
        let axes = axes?;
        let (turn, found) = basis(&axes)?;
        let repeated = (0..slides).any(|i| found[..i].iter().any(|(k, _)| *k == found[i].0));
        if repeated {
            return None;
        }
        let anchor = hinge.map_or(DVec3::ZERO, |h| DVec3::from_array(joints[h].pos));
        let axes =
            found.iter().enumerate().map(|(i, (k, s))| (if i < slides { *k } else { k + 3 }, *s)).collect();
        Some(Self { joints, free: false, axes, frame: Pose::from_parts(anchor, turn) })
    }
}

/// A frame whose axes these are up to sign, and which of its axes each one is. The given frame itself where it will do.
fn basis(axes: &[DVec3]) -> Option<(DQuat, Vec<(usize, f64)>)> {
    let along = |frame: &[DVec3], axis: &DVec3| {
        let nearest = frame.iter().position(|b| b.cross(*axis).length() < PARALLEL)?;
        Some((nearest, frame[nearest].dot(*axis).signum()))
    };
    let plain = [DVec3::X, DVec3::Y, DVec3::Z];
    if let Some(found) = axes.iter().map(|a| along(&plain, a)).collect() {
        return Some((DQuat::IDENTITY, found));
    }
    let mut frame: Vec<DVec3> = Vec::new();
    for axis in axes {
        if along(&frame, axis).is_some() {
            continue;
        }
        if frame.len() == 3 || frame.iter().any(|b| b.dot(*axis).abs() > PARALLEL) {
            return None;
        }
        frame.push(*axis);
    }
    if frame.len() == 1 {
        frame.push(frame[0].any_orthonormal_vector());
    }
    // Right-handed, whatever the file's third axis says: its sign goes into the coordinate.
    let third = frame[0].cross(frame[1]).normalize();
    frame.truncate(2);
    frame.push(third);
    let found: Option<Vec<_>> = axes.iter().map(|a| along(&frame, a)).collect();
    let turn = DQuat::from_mat3(&DMat3::from_cols(frame[0], frame[1], frame[2])).normalize();
    found.map(|found| (turn, found))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn joint(type_: JointType, axis: [f64; 3]) -> Joint {
        Joint { type_, axis, ..Joint::default() }
    }

    #[test]
    fn a_planar_root_is_one_joint() {
        let joints = [
            joint(JointType::Slide, [1.0, 0.0, 0.0]),
            joint(JointType::Slide, [0.0, 0.0, 1.0]),
            joint(JointType::Hinge, [0.0, -1.0, 0.0]),
        ];
        let segments = Segment::of(&joints).unwrap();
        assert_eq!(segments.len(), 1);
        assert_eq!(segments[0].axes, [(0, 1.0), (2, 1.0), (4, -1.0)]);
        assert_eq!(segments[0].frame, Pose::IDENTITY);
    }

    #[test]
    fn three_hinges_are_three_joints() {
        let joints = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|a| joint(JointType::Hinge, a));
        assert_eq!(Segment::of(&joints).unwrap().len(), 3);
    }

    #[test]
    fn skew_axes_become_axes_of_a_right_handed_frame() {
        let h = 0.5f64.sqrt();
        let joints = [
            joint(JointType::Slide, [h, 0.0, h]),
            joint(JointType::Slide, [-h, 0.0, h]),
            joint(JointType::Hinge, [0.0, 1.0, 0.0]),
        ];
        let segments = Segment::of(&joints).unwrap();
        assert_eq!(segments.len(), 1);
        for ((axis, sign), joint) in segments[0].axes.iter().zip(&joints) {
            let unit = [DVec3::X, DVec3::Y, DVec3::Z][axis % 3];
            let turned = segments[0].frame.rotation * unit * *sign;
            assert!((turned - DVec3::from_array(joint.axis)).length() < 1e-15);
        }
    }

    #[test]
    fn slides_that_are_not_at_right_angles_follow_each_other() {
        let joints = [joint(JointType::Slide, [1.0, 0.0, 0.0]), joint(JointType::Slide, [1.0, 0.0, 1.0])];
        assert_eq!(Segment::of(&joints).unwrap().len(), 2);
    }

    #[test]
    fn ball_joints_are_refused_by_name() {
        let mut ball = joint(JointType::Ball, [0.0; 3]);
        ball.name = Some("shoulder".into());
        let joints = [ball];
        let error = Segment::of(&joints).unwrap_err();
        assert!(error.contains("shoulder") && error.contains("ball"), "{error}");
    }
}
