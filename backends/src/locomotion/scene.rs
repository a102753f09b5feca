//! What a robot looks like: the geoms of its MJCF file, and where its bodies are.

use elo_core::scene::{Pose, Scene, Shape, Solid};
use mjcf_rs::body::{Geom, GeomType};
use mjcf_rs::glam::{DQuat, DVec3};

use super::body::Reading;
use super::model::RobotModel;

/// The bodies in the order of the file and their geoms. Where the world has solids besides the floor, it follows the robot's
/// bodies as one more.
///
/// Capsules, spheres and boxes are those of the file; a cylinder or ellipsoid is drawn as the box around it. Geoms that
/// neither touch anything nor are visible are left out.
pub(super) fn of(model: &RobotModel) -> Scene {
    let mut scene = Scene {
        bodies: model.bodies.iter().map(|body| body.name.clone()).collect(),
        solids: Vec::new(),
        // The file has been refused if its floor lies elsewhere.
        floor: true,
    };
    for (body, (_, entry)) in model.mjcf.bodies_iter().enumerate() {
        scene.solids.extend(entry.body.geoms.iter().filter_map(|geom| solid(body, geom)));
    }
    if world(model).next().is_some() {
        scene.solids.extend(world(model).map(|solid| Solid { body: scene.bodies.len(), ..solid }));
        scene.bodies.push("world".to_owned());
    }
    scene
}

/// Where they are.
pub(super) fn poses(model: &RobotModel, reading: &Reading) -> Vec<Pose> {
    let world = world(model).next().map(|_| Pose::IDENTITY);
    reading.bodies.iter().copied().chain(world).collect()
}

/// What stands still.
fn world(model: &RobotModel) -> impl Iterator<Item = Solid> {
    model.mjcf.bodies[0].body.geoms.iter().filter_map(|geom| solid(0, geom))
}

fn solid(body: usize, geom: &Geom) -> Option<Solid> {
    let touches = geom.contype != 0 || geom.conaffinity != 0;
    let seen = geom.rgba.is_none_or(|[_, _, _, alpha]| alpha > 0.0);
    let (center, turn, size) = placed(geom);
    let turn = turn.normalize();
    let pose = Pose { position: center.to_array(), rotation: [turn.w, turn.x, turn.y, turn.z] };
    (touches || seen).then_some(())?;
    Some(Solid { body, pose, shape: shape(geom.type_, size)? })
}

fn shape(form: GeomType, [a, b, c]: [f64; 3]) -> Option<Shape> {
    match form {
        GeomType::Sphere => Some(Shape::Sphere { radius: a }),
        GeomType::Capsule => Some(Shape::Capsule { radius: a, half_length: b }),
        GeomType::Cylinder => Some(Shape::Box { half_size: [a, a, b] }),
        GeomType::Box | GeomType::Ellipsoid => Some(Shape::Box { half_size: [a, b, c] }),
        GeomType::Plane | GeomType::Hfield | GeomType::Mesh | GeomType::Sdf => None,
    }
}

/// Place and size in the body's frame. A `fromto` gives both: z then points to its first end, as in MuJoCo.
fn placed(geom: &Geom) -> (DVec3, DQuat, [f64; 3]) {
    let [a, ..] = geom.size;
    let Some([x0, y0, z0, x1, y1, z1]) = geom.fromto else {
        return (geom.pose.translation, geom.pose.rotation, geom.size);
    };
    let (from, to) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
    let (axis, half) = ((from - to).normalize_or(DVec3::Z), (to - from).length() / 2.0);
    let size = match geom.type_ {
        GeomType::Box | GeomType::Ellipsoid => [a, a, half],
        _ => [a, half, 0.0],
    };
    ((from + to) / 2.0, DQuat::from_rotation_arc(DVec3::Z, axis), size)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::locomotion::robot::{NAMES, built_in};

    fn scene(name: &str, change: impl Fn(String) -> String) -> Scene {
        let mut description = built_in(name).unwrap();
        description.mjcf = change(description.mjcf);
        let model = RobotModel::load(&description).unwrap();
        let (scene, reading) = (of(&model), Reading::sized(model.bodies.len(), model.joints.len()));
        assert_eq!(poses(&model, &reading).len(), scene.bodies.len());
        scene
    }

    #[test]
    fn every_geom_of_the_three_robots_is_a_solid() {
        for name in NAMES {
            let text = built_in(name).unwrap().mjcf;
            let geoms = text.matches("<geom name=").count();
            let scene = scene(name, |text| text);
            assert!(scene.floor && geoms > 7, "{name}");
            assert_eq!(scene.solids.len(), geoms - 1, "{name}: all but the floor");
        }
        let cheetah = scene("half-cheetah", |text| text);
        assert_eq!(cheetah.bodies, ["torso", "bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot"]);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let [torso, head, .., ffoot] = &cheetah.solids[..] else { panic!("{cheetah:?}") };
        assert_eq!((torso.body, head.body, ffoot.body), (0, 0, 6));
        assert_eq!(torso.shape, Shape::Capsule { radius: 0.046, half_length: 0.5 });
        let [w, x, y, z] = torso.pose.rotation;
        assert!((w - half).abs() < 1e-12 && (y.abs() - half).abs() < 1e-12 && x == 0.0 && z == 0.0);
        assert_eq!(torso.pose.position, [0.0; 3]);
        assert_eq!(ffoot.shape, Shape::Capsule { radius: 0.046, half_length: 0.07 });
        assert_eq!(ffoot.pose.position, [0.045, 0.0, -0.07]);
        assert!((ffoot.pose.rotation[0] - 0.3_f64.cos()).abs() < 1e-12, "{ffoot:?}");
        assert!((ffoot.pose.rotation[2] + 0.3_f64.sin()).abs() < 1e-12, "{ffoot:?}");
    }

    #[test]
    fn other_shapes_have_boxes_the_world_is_a_body_and_ghosts_are_left_out() {
        let ghosts = r#"<geom name="ghost" type="sphere" size="1" contype="0" conaffinity="0" rgba="1 1 1 0"/>
            <geom name="eye" type="sphere" size="0.1" contype="0" conaffinity="0" mass="0"/>
            <geom name="can" type="cylinder" size="0.1 0.3" pos="0 0 1"/>
            <geom name="egg" type="ellipsoid" size="0.1 0.2 0.3"/>
            <geom name="bar" type="box" size="0.1" fromto="0 0 0 0 0 -2"/>"#;
        let step = r#"<geom name="step" type="box" size="1 2 0.1" pos="5 0 0.1" quat="2 0 0 0"/>"#;
        let change = |text: String| {
            let head = r#"<geom name="head""#;
            let floor = r#"<body name="torso""#;
            text.replace(head, &format!("{ghosts}{head}")).replace(floor, &format!("{step}{floor}"))
        };
        let (plain, changed) = (scene("half-cheetah", |text| text), scene("half-cheetah", change));
        assert_eq!(changed.bodies[..7], plain.bodies);
        assert_eq!(changed.bodies[7..], ["world"]);
        let shapes: Vec<&Shape> = changed.solids[1..5].iter().map(|solid| &solid.shape).collect();
        let boxed = |half_size| Shape::Box { half_size };
        let expected = [
            Shape::Sphere { radius: 0.1 },
            boxed([0.1, 0.1, 0.3]),
            boxed([0.1, 0.2, 0.3]),
            boxed([0.1, 0.1, 1.0]),
        ];
        assert_eq!(shapes, expected.iter().collect::<Vec<_>>());
        assert_eq!(changed.solids[4].pose, Pose { position: [0.0, 0.0, -1.0], ..Pose::IDENTITY });
        let pose = Pose { position: [5.0, 0.0, 0.1], ..Pose::IDENTITY };
        assert_eq!(changed.solids.last(), Some(&Solid { body: 7, pose, shape: boxed([1.0, 2.0, 0.1]) }));
        assert_eq!(changed.solids.len(), plain.solids.len() + 5);
    }
}
