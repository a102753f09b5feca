//! Mass, centre of mass and inertia of what moves as one.

use mjcf_rs::body::{Body, Geom, InertiaSpec};
use mjcf_rs::glam::{DMat3, DQuat, DVec3};
use mjcf_rs::{Model, Pose, compiler::InertiaFromGeom};
use rapier3d_f64::parry::mass_properties::MassProperties;

use super::shape::Form;

/// How mass is spread, in some frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Inertia {
    /// kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub centre: DVec3,
    /// Inertia about the centre of mass, kg m², in the axes of the frame.
    pub matrix: DMat3,
}

impl Inertia {
    /// Nothing there.
    pub const NONE: Self = Self { mass: 0.0, centre: DVec3::ZERO, matrix: DMat3::ZERO };

    /// A point mass.
    pub fn point(mass: f64, centre: DVec3) -> Self {
        Self { mass, centre, matrix: DMat3::ZERO }
    }

    /// The body's `<inertial>`, or, as the file's `inertiafromgeom` says, what follows from its geoms' densities.
    ///
    /// # Errors
    /// A geom without volume that should weigh something.
    pub fn of_body(body: &Body, model: &Model) -> Result<Self, String> {
        let from_geoms = match model.compiler.inertia_from_geom {
            InertiaFromGeom::True => true,
            InertiaFromGeom::False => false,
            InertiaFromGeom::Auto => body.inertial.is_none(),
        };
        if from_geoms {
            let mut sum = Self::NONE;
            for geom in &body.geoms {
                sum = sum.plus(&Self::of_geom(geom, model)?);
            }
            return Ok(sum);
        }
        Ok(body.inertial.as_ref().map_or(Self::NONE, |given| {
            let matrix = match given.inertia {
                InertiaSpec::Diagonal(d) => DMat3::from_diagonal(DVec3::from_array(d)),
                InertiaSpec::Full([xx, yy, zz, xy, xz, yz]) => {
                    DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz])
                }
            };
            Self { mass: given.mass, centre: DVec3::ZERO, matrix }.seen_from(given.pose)
        }))
    }

    fn of_geom(geom: &Geom, model: &Model) -> Result<Self, String> {
        let (form, pose) = Form::of_geom(geom)?;
        let density = geom.density.unwrap_or(model.compiler.inertia_density);
        let unit = form.unit_density().ok_or("a plane cannot weigh anything")?;
        let scale = geom.mass.map_or(density, |mass| mass / unit.mass);
        Ok(unit.scaled(scale).seen_from(pose))
    }

    /// As many times as heavy.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { mass: self.mass * factor, centre: self.centre, matrix: self.matrix * factor }
    }

    /// The same matter from a frame in which its own frame stands at `pose`.
    pub fn seen_from(&self, pose: Pose) -> Self {
        let matrix = if pose.rotation == DQuat::IDENTITY {
            self.matrix
        } else {
            let turn = DMat3::from_quat(pose.rotation);
            turn * self.matrix * turn.transpose()
        };
        Self { mass: self.mass, centre: pose * self.centre, matrix }
    }

    /// Both together (parallel axes).
    pub fn plus(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        if mass == 0.0 {
            return Self { matrix: self.matrix + other.matrix, ..*self };
        }
        let centre = (self.centre * self.mass + other.centre * other.mass) / mass;
        let about = |part: &Self| {
            let arm = part.centre - centre;
            let spread = DMat3::from_diagonal(DVec3::splat(arm.length_squared()))
                - DMat3::from_cols(arm * arm.x, arm * arm.y, arm * arm.z);
            part.matrix + spread * part.mass
        };
        Self { mass, centre, matrix: about(self) + about(other) }
    }

    /// Whether it resists every push and turn.
    pub fn is_solid(&self) -> bool {
        let [x, y, z] = [self.matrix.x_axis.x, self.matrix.y_axis.y, self.matrix.z_axis.z];
        [self.mass, x, y, z].iter().all(|m| *m > 0.0 && m.is_finite())
    }

    /// As the engine wants it: axes are searched for only where the given ones are not principal, and a link without
    /// mass gets an inertia that the engine can invert.
    pub fn to_engine(self) -> MassProperties {
        const NEXT_TO_NOTHING: f64 = 1e-12;
        let matrix =
            if self.is_solid() { self.matrix } else { DMat3::from_diagonal(DVec3::splat(NEXT_TO_NOTHING)) };
        let m = matrix.to_cols_array();
        if [m[1], m[2], m[5]].iter().all(|x| *x == 0.0) {
            let diagonal = DVec3::new(m[0], m[4], m[8]);
            MassProperties::with_principal_inertia_frame(self.centre, self.mass, diagonal, DQuat::IDENTITY)
        } else {
            MassProperties::with_inertia_matrix(self.centre, self.mass, matrix)
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn first_body(xml: &str) -> Inertia {
        let model = Model::from_str(xml, ".").unwrap();
        Inertia::of_body(&model.bodies[1].body, &model).unwrap()
    }

    #[test]
    fn two_points_make_a_dumbbell() {
        let rod = Inertia::point(1.0, DVec3::X).plus(&Inertia::point(3.0, -DVec3::X));
        // Centre at (1 - 3) / 4; arms 1.5 and 0.5: 1 · 2.25 + 3 · 0.25 = 3.
        assert_eq!((rod.mass, rod.centre), (4.0, DVec3::new(-0.5, 0.0, 0.0)));
        assert_eq!(rod.matrix, DMat3::from_diagonal(DVec3::new(0.0, 3.0, 3.0)));
    }

    #[test]
    fn a_capsule_weighs_what_its_volume_says() {
        let xml = r#"<mujoco><worldbody><body>
            <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.1" density="1000"/></body></worldbody></mujoco>"#;
        let capsule = first_body(xml);
        // Cylinder π r² L and sphere 4/3 π r³; axial inertia m r²/2 and 2/5 m r².
        let (cylinder, sphere) =
            (1000.0 * std::f64::consts::PI * 0.01 * 0.4, 4.0 / 3.0 * std::f64::consts::PI);
        assert!((capsule.mass - (cylinder + sphere)).abs() < 1e-12 * cylinder);
        assert!((capsule.centre - DVec3::new(0.2, 0.0, 0.0)).length() < 1e-15);
        let axial = cylinder * 0.01 / 2.0 + sphere * 0.01 * 0.4;
        assert!((capsule.matrix.x_axis.x - axial).abs() < 1e-12);
        // Across: m(L²/12 + r²/4), and each half sphere 2/5 r² with its centre 3/8 r beyond the end.
        let across =
            cylinder * (0.16 / 12.0 + 0.01 / 4.0) + sphere * (0.4 * 0.01 + 0.04 + 2.0 * 0.2 * 0.375 * 0.1);
        assert!((capsule.matrix.y_axis.y - across).abs() < 1e-9, "{} {across}", capsule.matrix.y_axis.y);
    }

    #[test]
    fn an_explicit_inertial_wins_over_geoms() {
        let xml = r#"<mujoco><worldbody><body>
            <inertial pos="0 0 1" mass="2" fullinertia="3 4 5 0.1 0.2 0.3"/>
            <geom type="sphere" size="1"/></body></worldbody></mujoco>"#;
        let given = first_body(xml);
        assert_eq!((given.mass, given.centre), (2.0, DVec3::Z));
        assert_eq!(given.matrix.x_axis, DVec3::new(3.0, 0.1, 0.2));
        let back = given.to_engine().reconstruct_inertia_matrix();
        assert!((back - given.matrix).to_cols_array().iter().all(|x| x.abs() < 1e-12));
    }
}
