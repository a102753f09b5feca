//! What a simulator looks like, for whoever draws its rollouts.
//!
//! Axes: z is up, robots walk along +x. Lengths in metres.

use serde::{Deserialize, Serialize};

use crate::simulator::SimulatorError;

/// A frame in the world, or in another frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Its origin, m.
    pub position: [f64; 3],
    /// Its orientation as a unit quaternion, w first.
    pub rotation: [f64; 4],
}

impl Pose {
    /// The frame that it is seen from.
    pub const IDENTITY: Self = Self { position: [0.0; 3], rotation: [1.0, 0.0, 0.0, 0.0] };

    /// Place, then orientation.
    pub(crate) fn numbers(&self) -> [f64; 7] {
        let ([x, y, z], [w, i, j, k]) = (self.position, self.rotation);
        [x, y, z, w, i, j, k]
    }
}

/// What a simulator looks like: bodies that move, and rigid solids on them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Names of the bodies.
    pub bodies: Vec<String>,
    /// What is to be drawn of them. A body may have none or several.
    pub solids: Vec<Solid>,
    /// Whether the plane z = 0 is a floor.
    pub floor: bool,
}

/// A shape that moves with a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Solid {
    /// Which of [`Scene::bodies`].
    pub body: usize,
    /// Where it is in the body's frame.
    pub pose: Pose,
    /// What it is in its own frame.
    pub shape: Shape,
}

/// A convex shape about the origin of its frame. Lengths are positive, m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// All points within `radius` of a segment of the z axis.
    Capsule {
        /// Its radius.
        radius: f64,
        /// Half the segment, the caps not counted.
        half_length: f64,
    },
    /// A cuboid along the axes.
    Box {
        /// Half its edges.
        half_size: [f64; 3],
    },
}

/// One rollout to be looked at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Film {
    /// Poses of all bodies: at the start, then after each control step.
    pub steps: Vec<Vec<Pose>>,
    /// The rollout's return under its context's task.
    pub returns: f64,
}

/// A simulator that can be looked at; see [`crate::simulator::Simulator::visible`].
pub trait Visible {
    /// What it looks like: a function of its config, whatever its state and task.
    fn scene(&self) -> Scene;

    /// Where the scene's bodies are in the present state, one pose each in the order of [`Scene::bodies`]. Looking disturbs
    /// nothing. As for [`crate::simulator::Simulator::state`], the state after an end can be looked at.
    ///
    /// # Errors
    /// Before the first reset; also after an error that lost the state.
    fn poses(&self) -> Result<Vec<Pose>, SimulatorError>;
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use serde_json::json;

    use super::*;

    #[test]
    fn the_words_in_files_are_these() {
        let pose = Pose { position: [1.0, 2.0, 3.0], ..Pose::IDENTITY };
        let shapes = [
            (Shape::Sphere { radius: 0.5 }, json!({ "sphere": { "radius": 0.5 } })),
            (
                Shape::Capsule { radius: 0.5, half_length: 2.0 },
                json!({ "capsule": { "radius": 0.5, "half_length": 2.0 } }),
            ),
            (Shape::Box { half_size: [1.0, 2.0, 3.0] }, json!({ "box": { "half_size": [1.0, 2.0, 3.0] } })),
        ];
        for (shape, written) in shapes {
            let solid = Solid { body: 0, pose, shape };
            let scene = Scene { bodies: vec!["torso".to_owned()], solids: vec![solid], floor: true };
            let expected = json!({
                "bodies": ["torso"],
                "solids": [{
                    "body": 0,
                    "pose": { "position": [1.0, 2.0, 3.0], "rotation": [1.0, 0.0, 0.0, 0.0] },
                    "shape": written,
                }],
                "floor": true,
            });
            assert_eq!(serde_json::to_value(&scene).unwrap(), expected);
            assert_eq!(serde_json::from_value::<Scene>(expected).unwrap(), scene);
        }
    }
}
