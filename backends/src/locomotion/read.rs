//! From a parsed MJCF file to a [`RobotModel`], with everything that is wrong on the way.

use std::f64::consts::PI;

use elo_core::fault::{Fault, Faults, meant};
use mjcf_rs::body::{Body, Geom, GeomType, InertiaSpec, Inertial, Joint, JointType};
use mjcf_rs::compiler::InertiaFromGeom;
use mjcf_rs::extras::{Actuator, ActuatorKind};
use mjcf_rs::glam::DVec3;
use nalgebra::Matrix3;

use super::body::Dynamics;
use super::model::{ActuatedJoint, BodyModel, RobotModel};
use super::robot::RobotDescription;

/// Reads the robot; see [`RobotModel::load`].
pub(super) fn robot(description: &RobotDescription, mjcf: mjcf_rs::Model) -> Result<RobotModel, Vec<Fault>> {
    let mut of_file = Vec::new();
    let bodies = bodies(&mjcf, &mut of_file);
    let floor_friction = floor_friction(&mjcf, &mut of_file);
    let coordinates = Coordinates::of(&mjcf, &mut of_file);
    let joints = actuated_joints(&mjcf, &coordinates, &mut of_file);

    let mut faults = Faults::new();
    of_file.into_iter().for_each(|message| faults.add("mjcf", message));
    let find_all = |field: &str, names: &[String], faults: &mut Faults| -> Vec<usize> {
        names.iter().filter_map(|name| find(&bodies, field, name, faults)).collect()
    };
    let torso = find(&bodies, "torso", &description.torso, &mut faults).unwrap_or(0);
    let feet = find_all("feet", &description.feet, &mut faults);
    let no_floor_contact =
        find_all("alive.no_floor_contact", &description.alive.no_floor_contact, &mut faults);
    let progress = progress(description, &bodies, torso, &mut faults);
    check_numbers(description, &mut faults);
    if let (Some(least), Some(torso)) = (description.alive.min_height, bodies.get(torso)) {
        let height = rest_height(&mjcf, torso);
        faults.check(height >= least, "alive.min_height", || {
            format!("the robot would have fallen at its reset already, where its torso's centre is {height:.3} m high")
        });
    }
    if !faults.found().is_empty() {
        return Err(faults.into_found());
    }
    Ok(RobotModel {
        description: description.clone(),
        joints,
        standard_positions: coordinates.standard,
        velocity_count: coordinates.velocities,
        root_quaternion: coordinates.quaternion,
        bodies,
        mjcf,
        torso,
        feet,
        no_floor_contact,
        progress,
        dynamics: Dynamics { floor_friction, payload: 0.0 },
    })
}

/// Names, masses and centres of the bodies.
pub(super) fn bodies(mjcf: &mjcf_rs::Model, faults: &mut Vec<String>) -> Vec<BodyModel> {
    let compiler = &mjcf.compiler;
    let mut bodies = Vec::new();
    for (id, entry) in mjcf.bodies_iter() {
        let by_geoms = compiler.inertia_from_geom == InertiaFromGeom::True;
        let (mass, center) = match &entry.body.inertial {
            Some(inertial) if !by_geoms => (inertial.mass, inertial.pose.translation),
            _ => mass_of_geoms(&entry.body, compiler.inertia_density),
        };
        let name = entry.body.name.clone().unwrap_or_default();
        if name.is_empty() {
            faults.push(format!("<body> number {id} has no name"));
        }
        if let Some(inertial) = &entry.body.inertial {
            check_inertial(&name, inertial, faults);
        }
        if entry.body.mocap {
            faults.push(format!("<body name=\"{name}\">: mocap bodies are not supported"));
        }
        bodies.push(BodyModel { name, mass, center: center.to_array() });
    }
    if compiler.set_total_mass > 0.0 {
        let total: f64 = bodies.iter().map(|body| body.mass).sum();
        bodies.iter_mut().for_each(|body| body.mass *= compiler.set_total_mass / total);
    }
    let roots = mjcf.bodies_iter().filter(|(_, entry)| entry.parent == Some(0)).count();
    if roots != 1 {
        faults.push(format!("<worldbody> holds {roots} bodies, expected one, the root of the robot"));
    }
    bodies
}

/// How high a body's centre of mass is in the file's own pose, in m.
fn rest_height(mjcf: &mjcf_rs::Model, body: &BodyModel) -> f64 {
    let named = mjcf.bodies_iter().find(|(_, entry)| entry.body.name.as_deref() == Some(&body.name));
    let (mut point, mut at) = (DVec3::from_array(body.center), named.map(|(id, _)| id));
    while let Some(entry) = at.and_then(|id| mjcf.bodies.get(id)) {
        point = entry.body.pose.rotation * point + entry.body.pose.translation;
        at = entry.parent;
    }
    point.z
}

/// No body has a negative mass, nor a moment of inertia greater than the sum of the other two.
fn check_inertial(body: &str, inertial: &Inertial, faults: &mut Vec<String>) {
    let here = format!("<body name=\"{body}\">, <inertial>");
    if inertial.mass <= 0.0 {
        faults.push(format!("{here}: mass=\"{}\": expected more than 0", inertial.mass));
    }
    let [xx, yy, zz, xy, xz, yz] = match inertial.inertia {
        InertiaSpec::Full(full) => full,
        InertiaSpec::Diagonal([x, y, z]) => [x, y, z, 0.0, 0.0, 0.0],
    };
    let moments = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).symmetric_eigenvalues();
    let [a, b, c] = [moments[0], moments[1], moments[2]];
    // Rounded numbers of thin bodies may miss equality by a little.
    if a.min(b).min(c) < 0.0 || a.max(b).max(c) > (a + b + c) / 2.0 * (1.0 + 1e-3) {
        faults.push(format!(
            "{here}: principal moments {a:.4}, {b:.4}, {c:.4}: no body has a negative one, nor one greater than the sum of \
             the others"
        ));
    }
}

/// Mass and centre of mass of a body by MuJoCo's rule: each geom's `mass`, or its density times its volume.
fn mass_of_geoms(body: &Body, density: f64) -> (f64, DVec3) {
    let (mut mass, mut moment) = (0.0, DVec3::ZERO);
    for geom in &body.geoms {
        let ends = geom.fromto.map(|p| (DVec3::new(p[0], p[1], p[2]), DVec3::new(p[3], p[4], p[5])));
        let center = ends.map_or(geom.pose.translation, |(a, b)| (a + b) / 2.0);
        let half_length = ends.map(|(a, b)| (b - a).length() / 2.0);
        let own = geom.mass.unwrap_or_else(|| geom.density.unwrap_or(density) * volume(geom, half_length));
        mass += own;
        moment += center * own;
    }
    (mass, if mass > 0.0 { moment / mass } else { DVec3::ZERO })
}

/// The volume of a primitive in m³; `half_length` is that of a `fromto` and replaces the size along z.
fn volume(geom: &Geom, half_length: Option<f64>) -> f64 {
    let [a, b, c] = geom.size;
    let ball = |r: f64| 4.0 / 3.0 * PI * r * r * r;
    match geom.type_ {
        GeomType::Sphere => ball(a),
        GeomType::Capsule => ball(a) + PI * a * a * 2.0 * half_length.unwrap_or(b),
        GeomType::Cylinder => PI * a * a * 2.0 * half_length.unwrap_or(b),
        GeomType::Box => 8.0 * if let Some(half) = half_length { a * a * half } else { a * b * c },
        GeomType::Ellipsoid => {
            4.0 / 3.0 * PI * if let Some(half) = half_length { a * a * half } else { a * b * c }
        }
        GeomType::Plane | GeomType::Hfield | GeomType::Mesh | GeomType::Sdf => 0.0,
    }
}

/// The sliding friction of the floor, the world's one plane.
fn floor_friction(mjcf: &mjcf_rs::Model, faults: &mut Vec<String>) -> f64 {
    let geoms = &mjcf.bodies[0].body.geoms;
    let planes: Vec<&Geom> = geoms.iter().filter(|geom| geom.type_ == GeomType::Plane).collect();
    if let [floor] = planes[..] {
        let up = floor.pose.rotation * DVec3::Z;
        if floor.pose.translation.z != 0.0 || (up - DVec3::Z).length() > 1e-9 {
            faults.push("the floor, <geom type=\"plane\">: expected it level at height 0".to_owned());
        }
        if floor.friction[0] < 0.0 {
            let got = floor.friction[0];
            faults
                .push(format!("the floor, <geom type=\"plane\">: friction=\"{got} …\": expected at least 0"));
        }
        return floor.friction[0];
    }
    faults.push(format!("<worldbody> holds {} planes, expected one, the floor", planes.len()));
    0.0
}

/// Where each joint's coordinates lie, and the file's own pose.
struct Coordinates<'a> {
    joints: Vec<(&'a Joint, usize, usize)>,
    standard: Vec<f64>,
    velocities: usize,
    quaternion: Option<usize>,
}

impl<'a> Coordinates<'a> {
    fn of(mjcf: &'a mjcf_rs::Model, faults: &mut Vec<String>) -> Self {
        let mut all = Self { joints: Vec::new(), standard: Vec::new(), velocities: 0, quaternion: None };
        for (_, entry) in mjcf.bodies_iter() {
            for joint in &entry.body.joints {
                all.joints.push((joint, all.standard.len(), all.velocities));
                all.velocities += match joint.type_ {
                    JointType::Hinge | JointType::Slide => {
                        all.standard.push(joint.ref_);
                        1
                    }
                    JointType::Free => {
                        let (origin, turn) = (entry.body.pose.translation, entry.body.pose.rotation);
                        all.standard.extend(origin.to_array());
                        all.quaternion = Some(all.standard.len());
                        all.standard.extend([turn.w, turn.x, turn.y, turn.z]);
                        6
                    }
                    JointType::Ball => {
                        let name = joint.name.as_deref().unwrap_or_default();
                        faults.push(format!(
                            "<joint name=\"{name}\">: ball joints are not supported; use hinges"
                        ));
                        0
                    }
                };
            }
        }
        all
    }
}

fn actuated_joints(
    mjcf: &mjcf_rs::Model,
    coordinates: &Coordinates<'_>,
    faults: &mut Vec<String>,
) -> Vec<ActuatedJoint> {
    if mjcf.actuators.is_empty() {
        faults.push("<actuator> holds no <motor>".to_owned());
    }
    let one =
        |motor| actuated(motor, coordinates, mjcf.compiler.autolimits).map_err(|fault| faults.push(fault));
    mjcf.actuators.iter().map(one).filter_map(Result::ok).collect()
}

fn actuated(
    motor: &Actuator,
    coordinates: &Coordinates<'_>,
    autolimits: bool,
) -> Result<ActuatedJoint, String> {
    let here = format!("<motor name=\"{}\">", motor.name.as_deref().unwrap_or_default());
    let target = motor.joint.as_deref();
    if motor.kind != ActuatorKind::Motor {
        return Err(format!("{here}: expected a <motor>, got {:?}", motor.kind));
    }
    let found =
        coordinates.joints.iter().find(|(joint, ..)| target.is_some() && joint.name.as_deref() == target);
    let &(joint, position, velocity) = found.ok_or_else(|| format!("{here} drives no joint of the file"))?;
    if !matches!(joint.type_, JointType::Hinge | JointType::Slide) {
        return Err(format!("{here}: expected a hinge or slide, got {:?}", joint.type_));
    }
    let owner = format!("<joint name=\"{}\">", target.unwrap_or_default());
    let range = joint.range.ok_or_else(|| {
        format!("{owner}: a joint with a motor needs a range (the observation is relative to it)")
    })?;
    if range[0] >= range[1] {
        return Err(format!("{owner}: range=\"{} {}\": expected the lower end first", range[0], range[1]));
    }
    let limited = motor.ctrl_limited.resolve(autolimits, motor.ctrl_range.is_some());
    let control = motor.ctrl_range.filter(|_| limited).unwrap_or([-1.0, 1.0]);
    if control[0] >= control[1] {
        return Err(format!("{here}: ctrlrange {} to {} is empty", control[0], control[1]));
    }
    let name = target.unwrap_or_default().to_owned();
    Ok(ActuatedJoint { name, position, velocity, range, gear: motor.gear[0], control })
}

fn find(bodies: &[BodyModel], field: &str, name: &str, faults: &mut Faults) -> Option<usize> {
    let found = bodies.iter().position(|body| body.name == name);
    faults.check(found.is_some(), field, || {
        let meant = meant(name, bodies.iter().map(|body| body.name.as_str()), '`');
        format!("the file has no body `{name}`{meant}")
    });
    found
}

fn progress(
    description: &RobotDescription,
    bodies: &[BodyModel],
    torso: usize,
    faults: &mut Faults,
) -> Vec<(usize, [f64; 3], f64)> {
    let mut points: Vec<(usize, [f64; 3], f64)> = Vec::new();
    if description.progress.is_empty() {
        let others = (0..bodies.len()).filter(|&body| body != torso);
        points.extend(others.map(|body| (body, [0.0; 3], 1.0)));
        if points.is_empty() {
            points.push((torso, [0.0; 3], 1.0));
        }
    }
    for point in &description.progress {
        let body = find(bodies, "progress", &point.body, faults);
        points.extend(body.map(|body| (body, point.offset, point.weight)));
    }
    let total: f64 = points.iter().map(|point| point.2).sum();
    let sound = total > 0.0 && total.is_finite() && points.iter().all(|point| point.2 >= 0.0);
    faults.check(sound, "progress", || {
        format!("expected weights >= 0 with a positive sum, got a sum of {total}")
    });
    points.iter_mut().for_each(|point| point.2 /= total);
    points
}

fn check_numbers(description: &RobotDescription, faults: &mut Faults) {
    let alive = &description.alive;
    let mut check = |field: &str, value: f64, low: f64, high: f64| {
        faults
            .check((low..=high).contains(&value), field, || format!("expected {low} to {high}, got {value}"));
    };
    check("torque_scale", description.torque_scale, 0.0, 1e6);
    check("reset_noise", description.reset_noise, 0.0, 10.0);
    check("substeps", f64::from(description.substeps), 1.0, 1000.0);
    check("alive.min_height", alive.min_height.unwrap_or_default(), -1e6, 1e6);
    check("alive.max_pitch", alive.max_pitch.unwrap_or_default(), 0.0, 4.0);
    for point in &description.progress {
        point.offset.iter().for_each(|&x| check("progress", x, -1e6, 1e6));
    }
    faults.check(!description.name.trim().is_empty(), "name", || "expected a name, got nothing".to_owned());
}
