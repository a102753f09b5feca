//! Geoms that this engine can collide with.

use mjcf_rs::Pose;
use mjcf_rs::body::{Geom, GeomType};
use mjcf_rs::glam::{DMat3, DQuat, DVec3};
use rapier3d_f64::geometry::SharedShape;

use super::inertia::Inertia;

/// What a geom looks like in its own frame. Lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Form {
    /// Everything below z = 0.
    Plane,
    /// A ball.
    Sphere { radius: f64 },
    /// A segment along z, thickened.
    Capsule { half: f64, radius: f64 },
    /// A cuboid of these half extents.
    Box { half: DVec3 },
}

/// A geom in the frame of what carries it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shape {
    /// Its body in the order of the file, without the world; meaningless for the world's own geoms.
    pub body: usize,
    /// Its place on its link, or in the world.
    pub pose: Pose,
    pub form: Form,
    /// Sliding friction coefficient.
    pub friction: f64,
    /// MuJoCo's contact bits: two geoms meet when one's type and the other's affinity share a bit.
    pub contype: u32,
    pub conaffinity: u32,
}

impl Form {
    /// The form and where it stands in the body's frame.
    ///
    /// # Errors
    /// A type that this engine does not know, or a size that is not positive.
    pub fn of_geom(geom: &Geom) -> Result<(Self, Pose), String> {
        let (pose, half) = match geom.fromto {
            None => (geom.pose, None),
            Some([x0, y0, z0, x1, y1, z1]) => {
                let (from, to) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
                let axis = (to - from).try_normalize().ok_or("`fromto` has no length")?;
                let turn = DQuat::from_rotation_arc(DVec3::Z, axis);
                (Pose::from_parts((from + to) / 2.0, turn), Some((to - from).length() / 2.0))
            }
        };
        let [a, b, c] = geom.size;
        let form = match (geom.type_, half) {
            (GeomType::Plane, None) => return Ok((Self::Plane, pose)),
            (GeomType::Sphere, None) => Self::Sphere { radius: a },
            (GeomType::Capsule, half) => Self::Capsule { half: half.unwrap_or(b), radius: a },
            (GeomType::Box, None) => Self::Box { half: DVec3::new(a, b, c) },
            (other, _) => {
                return Err(format!(
                    "type {other:?}{} is not supported: use sphere, capsule or box",
                    if half.is_some() { " with `fromto`" } else { "" }
                ));
            }
        };
        if form.lengths().iter().all(|x| *x > 0.0 && x.is_finite()) {
            Ok((form, pose))
        } else {
            Err(format!("size {:?} is not positive", geom.size))
        }
    }

    fn lengths(&self) -> [f64; 3] {
        match *self {
            Self::Plane => [1.0; 3],
            Self::Sphere { radius } => [radius; 3],
            Self::Capsule { half, radius } => [half, radius, radius],
            Self::Box { half } => half.to_array(),
        }
    }

    /// Mass and inertia at 1 kg/m³; none for the plane.
    pub fn unit_density(&self) -> Option<Inertia> {
        use std::f64::consts::PI;
        let (mass, diagonal) = match *self {
            Self::Plane => return None,
            Self::Sphere { radius: r } => {
                let mass = 4.0 / 3.0 * PI * r.powi(3);
                (mass, DVec3::splat(0.4 * mass * r * r))
            }
            Self::Capsule { half: h, radius: r } => {
                let (rod, ends) = (2.0 * PI * r * r * h, 4.0 / 3.0 * PI * r.powi(3));
                let along = rod * r * r / 2.0 + ends * 0.4 * r * r;
                // Half spheres have their centre of mass 3/8 r beyond the segment's ends.
                let across = rod * (h * h / 3.0 + r * r / 4.0) + ends * (0.4 * r * r + h * h + 0.75 * h * r);
                (rod + ends, DVec3::new(across, across, along))
            }
            Self::Box { half } => {
                let mass = 8.0 * half.x * half.y * half.z;
                let square = half * half;
                let sums = DVec3::splat(square.x + square.y + square.z) - square;
                (mass, sums * (mass / 3.0))
            }
        };
        Some(Inertia { mass, centre: DVec3::ZERO, matrix: DMat3::from_diagonal(diagonal) })
    }

    /// The engine's shape, in the same frame.
    pub fn to_engine(self) -> SharedShape {
        match self {
            Self::Plane => SharedShape::halfspace(DVec3::Z),
            Self::Sphere { radius } => SharedShape::ball(radius),
            Self::Capsule { half, radius } => SharedShape::capsule(DVec3::Z * half, DVec3::Z * -half, radius),
            Self::Box { half } => SharedShape::cuboid(half.x, half.y, half.z),
        }
    }
}

impl Shape {
    /// Signed distance from this shape, on a link at `link`, to a plane of the world, m.
    pub fn gap_above(&self, plane: &Self, link: &Pose) -> f64 {
        let pose = *link * self.pose;
        let normal = plane.pose.rotation * DVec3::Z;
        let height = (pose.translation - plane.pose.translation).dot(normal);
        // The plane's normal as the form sees it.
        let down = (pose.rotation.inverse() * normal).abs();
        height
            - match self.form {
                Form::Plane => 0.0,
                Form::Sphere { radius } => radius,
                Form::Capsule { half, radius } => half * down.z + radius,
                Form::Box { half } => half.dot(down),
            }
    }

    /// Whether MuJoCo's rule lets these two touch.
    pub fn meets(&self, other: &Self) -> bool {
        self.contype & other.conaffinity != 0 || other.contype & self.conaffinity != 0
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn geom(type_: GeomType, size: [f64; 3], fromto: Option<[f64; 6]>) -> Geom {
        Geom { type_, size, fromto, ..Geom::default() }
    }

    #[test]
    fn a_capsule_between_two_points_lies_between_them() {
        let given = geom(GeomType::Capsule, [0.1, 0.0, 0.0], Some([1.0, 0.0, 0.0, 1.0, 2.0, 0.0]));
        let (form, pose) = Form::of_geom(&given).unwrap();
        assert_eq!(form, Form::Capsule { half: 1.0, radius: 0.1 });
        assert!((pose * DVec3::Z - DVec3::new(1.0, 2.0, 0.0)).length() < 1e-15);
        assert!((pose * -DVec3::Z - DVec3::new(1.0, 0.0, 0.0)).length() < 1e-15);
    }

    #[test]
    fn other_geoms_are_refused_by_name() {
        let mesh = Form::of_geom(&geom(GeomType::Mesh, [0.0; 3], None)).unwrap_err();
        assert!(mesh.contains("Mesh"), "{mesh}");
        assert!(Form::of_geom(&geom(GeomType::Sphere, [0.0; 3], None)).is_err());
    }

    #[test]
    fn gaps_are_those_of_the_lowest_point() {
        let at = |form, pose| Shape { body: 0, pose, form, friction: 0.0, contype: 1, conaffinity: 1 };
        let floor = at(Form::Plane, Pose::from_translation(DVec3::new(5.0, 0.0, 1.0)));
        let link =
            Pose::from_parts(DVec3::new(0.0, 0.0, 3.0), DQuat::from_rotation_y(std::f64::consts::FRAC_PI_4));
        let edge = 0.5f64.sqrt();
        // Half a metre down the turned x axis, then the form's own reach along the vertical.
        let down = Pose::from_translation(DVec3::new(0.5, 0.0, 0.0));
        let cases = [
            (Form::Sphere { radius: 0.2 }, 0.2),
            (Form::Capsule { half: 0.3, radius: 0.1 }, 0.3 * edge + 0.1),
            (Form::Box { half: DVec3::new(0.1, 0.4, 0.2) }, 0.3 * edge),
        ];
        for (form, reach) in cases {
            let gap = at(form, down).gap_above(&floor, &link);
            assert!((gap - (2.0 - 0.5 * edge - reach)).abs() < 1e-12, "{form:?}: {gap}");
        }
    }

    #[test]
    fn a_cube_has_a_sixth_of_mass_times_side_squared() {
        let cube = Form::Box { half: DVec3::splat(0.5) }.unit_density().unwrap();
        assert_eq!(cube.mass, 1.0);
        assert!((cube.matrix.x_axis.x - 1.0 / 6.0).abs() < 1e-15);
    }
}
