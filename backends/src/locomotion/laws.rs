//! Laws of mechanics that every [`ArticulatedBody`] must obey. Each engine's tests run [`LAWS`] with its own constructor.
//!
//! The robots are ten lines each and the expectations come from closed forms or from equations of motion integrated here,
//! never from another engine. Tolerances are those of a first-order integrator with the file's time step.

use elo_core::simulator::SimulatorError;

use super::body::{ArticulatedBody, Dynamics, Reading};
use super::laws_flight as flight;
use super::laws_pendulum as pendulum;
use super::model::RobotModel;
use super::observation::in_world;
use super::robot::{AliveRule, RobotDescription, built_in};

/// Makes an engine's body of a robot.
pub type Build<'a> = dyn Fn(&RobotModel) -> Box<dyn ArticulatedBody> + 'a;

/// A law: what is wrong with the engine, if anything.
pub type Law = fn(&Build<'_>) -> Result<(), String>;

/// All of them, by name.
pub const LAWS: [(&str, Law); 16] = [
    ("poses_follow_coordinates", poses_follow_coordinates),
    ("coordinates_are_those_restored", coordinates_are_those_restored),
    ("free_fall_is_uniform_acceleration", free_fall_is_uniform_acceleration),
    ("a_free_body_turns_about_its_centre_of_mass", a_free_body_turns_about_its_centre_of_mass),
    ("torso_velocity_is_that_of_its_centre_of_mass", torso_velocity_is_that_of_its_centre_of_mass),
    ("torque_accelerates_by_inertia", torque_accelerates_by_inertia),
    ("payload_slows_the_motion", payload_slows_the_motion),
    ("friction_stops_a_sliding_box", friction_stops_a_sliding_box),
    ("a_resting_box_stays_and_touches_the_floor", a_resting_box_stays_and_touches_the_floor),
    ("limits_stop_and_bring_back_slowly", limits_stop_and_bring_back_slowly),
    ("mirrored_torques_mirror_the_ant", flight::mirrored_torques_mirror_the_ant),
    ("robots_in_flight_err_in_proportion_to_the_step", flight::robots_err_in_proportion_to_the_step),
    ("replays_are_equal_bit_for_bit", replays_are_equal_bit_for_bit),
    ("pendulum_has_its_period", pendulum::has_its_period),
    ("pendulum_gains_no_energy", pendulum::gains_no_energy),
    ("double_pendulum_errs_in_proportion_to_the_step", pendulum::errs_in_proportion_to_the_step),
];

/// A robot in an engine, and what is read of it.
pub(super) struct Rig {
    pub model: RobotModel,
    body: Box<dyn ArticulatedBody>,
}

/// Generalised positions and velocities.
pub(super) type Coordinates = (Vec<f64>, Vec<f64>);

impl Rig {
    pub fn new(build: &Build<'_>, model: RobotModel) -> Result<Self, String> {
        let mut body = build(&model);
        body.set_dynamics(&model.dynamics).map_err(text)?;
        Ok(Self { model, body })
    }

    pub fn restore(&mut self, (positions, velocities): &Coordinates) -> Result<(), String> {
        self.body.restore(positions, velocities).map_err(text)
    }

    pub fn advance(&mut self, torques: &[f64]) -> Result<(), String> {
        self.body.advance(torques).map_err(text)
    }

    pub fn coordinates(&self) -> Coordinates {
        let mut coordinates = self.standing();
        self.body.coordinates(&mut coordinates.0, &mut coordinates.1);
        coordinates
    }

    /// The file's own pose at rest.
    pub fn standing(&self) -> Coordinates {
        (self.model.standard_positions.clone(), vec![0.0; self.model.velocity_count])
    }

    fn reading(&self) -> Reading {
        let mut reading = Reading::sized(self.model.bodies.len(), self.model.joints.len());
        self.body.read(&mut reading);
        reading
    }

    /// Where a body's centre of mass is.
    fn center(&self, body: usize) -> [f64; 3] {
        in_world(&self.reading().bodies[body], self.model.bodies[body].center)
    }
}

fn text(error: SimulatorError) -> String {
    error.to_string()
}

/// A robot of one tree below `torso`, with time step 4.125 ms in 4 sub-steps. `gravity` is downwards in m/s²; `tree` and
/// `motors` are MJCF. The floor has friction 0.5.
pub(super) fn robot(gravity: f64, tree: &str, motors: &str) -> Result<RobotModel, String> {
    robot_with_step(0.004125, 4, gravity, (tree, motors))
}

/// [`robot`] with another time step.
pub(super) fn robot_with_step(
    step: f64,
    substeps: u32,
    gravity: f64,
    (tree, motors): (&str, &str),
) -> Result<RobotModel, String> {
    let mjcf = format!(
        r#"<mujoco><compiler angle="radian" inertiafromgeom="false"/>
        <option timestep="{step}" gravity="0 0 -{gravity}" integrator="Euler"/>
        <default><joint axis="0 1 0" damping="0" armature="0" solreflimit="0.01 10" solimplimit="0.99 0.99 0.01"/>
        <geom contype="1" conaffinity="0" friction="0 0 0" condim="3"/></default>
        <worldbody><geom name="floor" type="plane" size="0 0 1" contype="0" conaffinity="1" friction="0.5 0 0"/>
        {tree}</worldbody><actuator>{motors}</actuator></mujoco>"#
    );
    let description = RobotDescription {
        name: "law".to_owned(),
        mjcf,
        torso: "torso".to_owned(),
        feet: Vec::new(),
        torque_scale: 1.0,
        reset_noise: 0.0,
        substeps,
        alive: AliveRule::default(),
        progress: Vec::new(),
    };
    RobotModel::load(&description).map_err(|faults| format!("{faults:?}"))
}

/// A free body of 2 kg, its centre of mass 0.3 m and 0.1 m off its frame, with a light arm that the motor needs.
fn free_body(gravity: f64) -> Result<RobotModel, String> {
    let tree = r#"<body name="torso" pos="0 0 10"><freejoint/>
        <inertial pos="0.3 0 0.1" mass="2" diaginertia="0.2 0.3 0.15"/>
        <body name="arm" pos="0.3 0 0.1"><inertial pos="0 0 0" mass="0.001" diaginertia="1e-3 1e-3 1e-3"/>
        <joint name="arm" limited="true" range="-3 3"/></body></body>"#;
    robot(gravity, tree, r#"<motor joint="arm"/>"#)
}

/// A cart of 2 kg on a slide along x, 1 m up.
const CART: (&str, &str) = (
    r#"<body name="torso" pos="0 0 1"><inertial pos="0 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>
    <joint name="cart" type="slide" axis="1 0 0" limited="true" range="-50 50"/></body>"#,
    r#"<motor joint="cart" gear="10"/>"#,
);

/// A box of 4 kg and half a metre, standing on the floor, free in the plane; its foot is what the motor needs.
fn box_on_the_floor() -> Result<RobotModel, String> {
    let tree = r#"<body name="torso" pos="0 0 0.1"><inertial pos="0 0 0" mass="4" diaginertia="0.1 0.1 0.1"/>
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint type="hinge"/>
        <geom type="box" size="0.25 0.25 0.1"/>
        <body name="arm"><inertial pos="0 0 0" mass="0.001" diaginertia="1e-3 1e-3 1e-3"/>
        <joint name="arm" limited="true" range="-3 3"/></body></body>"#;
    robot(9.8, tree, r#"<motor joint="arm"/>"#)
}

pub(super) fn expect(what: &str, got: f64, expected: f64, tolerance: f64) -> Result<(), String> {
    if (got - expected).abs() <= tolerance {
        Ok(())
    } else {
        Err(format!("{what} is {got}, expected {expected} within {tolerance}"))
    }
}

pub(super) fn expect_all(what: &str, got: &[f64], expected: &[f64], tolerance: f64) -> Result<(), String> {
    got.iter()
        .zip(expected)
        .enumerate()
        .try_for_each(|(i, (&got, &expected))| expect(&format!("{what}[{i}]"), got, expected, tolerance))
}

/// The ant's first foot, worked out by hand: hip 0.3 turns the leg about z, ankle 1.0 bends the foot down.
fn poses_follow_coordinates(build: &Build<'_>) -> Result<(), String> {
    let mut ant = Rig::new(build, built("ant")?)?;
    let (mut positions, velocities) = ant.standing();
    (positions[7], positions[8]) = (0.3, 1.0);
    ant.restore(&(positions, velocities))?;
    let (sin, cos) = 0.3_f64.sin_cos();
    let (x, y) = (0.2 * (cos - sin), 0.2 * (cos + sin));
    expect_all("foot", &ant.reading().bodies[2].position, &[0.2 + x, 0.2 + y, 0.75], 1e-9)?;
    // The foot's centre lies at (0.2, 0.2, 0), across the ankle's axis: it sinks by 0.2 sqrt 2 sin 1.
    let level = 1_f64.cos();
    let centre = [0.2 + x * (1.0 + level), 0.2 + y * (1.0 + level), 0.75 - 0.2 * 2_f64.sqrt() * 1_f64.sin()];
    expect_all("foot's centre", &ant.center(2), &centre, 1e-9)?;
    // HalfCheetah's torso turned by 0.5 about +y lowers what is in front of it.
    let mut cheetah = Rig::new(build, built("half-cheetah")?)?;
    let (mut positions, velocities) = cheetah.standing();
    positions[..3].copy_from_slice(&[1.0, 0.2, 0.5]);
    cheetah.restore(&(positions, velocities))?;
    let front = [1.0 + 0.5 * 0.5_f64.cos(), 0.0, 0.9 - 0.5 * 0.5_f64.sin()];
    expect_all("fthigh", &cheetah.reading().bodies[4].position, &front, 1e-9)
}

pub(super) fn built(name: &str) -> Result<RobotModel, String> {
    let description = built_in(name).ok_or_else(|| format!("no robot {name}"))?;
    RobotModel::load(&description).map_err(|faults| format!("{faults:?}"))
}

fn coordinates_are_those_restored(build: &Build<'_>) -> Result<(), String> {
    for name in super::robot::NAMES {
        let mut rig = Rig::new(build, built(name)?)?;
        let (mut positions, mut velocities) = rig.standing();
        let free = rig.model.root_quaternion.is_some();
        if free {
            // A rotation by 1 rad about (1, 2, 2)/3.
            let (sin, cos) = 0.5_f64.sin_cos();
            positions[3..7].copy_from_slice(&[cos, sin / 3.0, sin * 2.0 / 3.0, sin * 2.0 / 3.0]);
        }
        let first = if free { 7 } else { 0 };
        positions[first..].iter_mut().enumerate().for_each(|(i, q)| *q += 0.05 * i as f64);
        velocities.iter_mut().enumerate().for_each(|(i, v)| *v = 0.1 * i as f64 - 0.3);
        rig.restore(&(positions.clone(), velocities.clone()))?;
        let (got_positions, got_velocities) = rig.coordinates();
        expect_all(&format!("{name}: position"), &got_positions, &positions, 1e-12)?;
        expect_all(&format!("{name}: velocity"), &got_velocities, &velocities, 1e-12)?;
    }
    Ok(())
}

/// `z = z0 - g t²/2`; semi-implicit Euler falls `g t h/2` further.
fn free_fall_is_uniform_acceleration(build: &Build<'_>) -> Result<(), String> {
    let mut rig = Rig::new(build, free_body(9.8)?)?;
    rig.restore(&rig.standing())?;
    let steps = 40;
    (0..steps).try_for_each(|_| rig.advance(&[0.0]))?;
    let t = 0.0165 * f64::from(steps);
    expect("height", rig.center(0)[2], 10.1 - 4.9 * t * t, 9.8 * t * 0.004125)?;
    let (positions, velocities) = rig.coordinates();
    expect("speed", velocities[2], -9.8 * t, 1e-9)?;
    expect_all("rotation", &positions[3..7], &[1.0, 0.0, 0.0, 0.0], 1e-9)
}

/// Without gravity a spinning body's centre of mass flies straight on and its angular momentum keeps its length and
/// direction, to first order in the step.
fn a_free_body_turns_about_its_centre_of_mass(build: &Build<'_>) -> Result<(), String> {
    let mut rig = Rig::new(build, free_body(0.0)?)?;
    let (mut positions, mut velocities) = rig.standing();
    // A quarter turn about z, so that world and own axes differ: own x is world y. The centre of mass shall move with
    // (0.5, 0, 0) while the body spins with 2 rad/s about its own (0.6, 0.8, 0.1)-ish axes.
    let h = std::f64::consts::FRAC_1_SQRT_2;
    positions[3..7].copy_from_slice(&[h, 0.0, 0.0, h]);
    let own = [1.2, 1.6, 0.2];
    let spin = [-own[1], own[0], own[2]];
    let arm = [0.0, 0.3, 0.1];
    let swing = cross(spin, arm);
    velocities[..3].copy_from_slice(&[0.5 - swing[0], -swing[1], -swing[2]]);
    velocities[3..6].copy_from_slice(&own);
    rig.restore(&(positions, velocities))?;
    let (start, before) = (rig.center(0), angular_momentum(&rig));
    let steps = 60;
    (0..steps).try_for_each(|_| rig.advance(&[0.0]))?;
    let t = 0.0165 * f64::from(steps);
    let [x, y, z] = start;
    // The arm at the centre of mass is one part in 2000, and turns with little force.
    expect_all("centre of mass", &rig.center(0), &[x + 0.5 * t, y, z], 5e-3)?;
    let size = before.iter().map(|l| l * l).sum::<f64>().sqrt();
    expect_all("angular momentum", &angular_momentum(&rig), &before, 0.02 * size)
}

/// About the torso's centre of mass, from its orientation and its angular velocity in its own axes.
fn angular_momentum(rig: &Rig) -> [f64; 3] {
    let (_, velocities) = rig.coordinates();
    let own = [0.2 * velocities[3], 0.3 * velocities[4], 0.15 * velocities[5]];
    let frame = elo_core::scene::Pose { position: [0.0; 3], ..rig.reading().bodies[0] };
    in_world(&frame, own)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Against the displacement of the torso's centre over the next control step, in which it hardly accelerates.
fn torso_velocity_is_that_of_its_centre_of_mass(build: &Build<'_>) -> Result<(), String> {
    let mut walker = Rig::new(build, built("walker2d")?)?;
    let (mut positions, mut velocities) = walker.standing();
    positions[1] = 3.0;
    positions[3..].fill(-0.2);
    // The root turns 1.25 m below the torso's centre: 2 rad/s about +y add 2.5 m/s forwards.
    velocities[..3].copy_from_slice(&[0.5, 0.0, 2.0]);
    walker.restore(&(positions, velocities))?;
    expect_all("at the start", &walker.reading().torso_velocity, &[3.0, 0.0, 0.0], 1e-9)?;
    for _ in 0..5 {
        let (before, speed) = (walker.center(0), walker.reading().torso_velocity);
        walker.advance(&[0.0; 6])?;
        let (after, later) = (walker.center(0), walker.reading().torso_velocity);
        let mean: [f64; 3] = std::array::from_fn(|i| 0.5 * (speed[i] + later[i]));
        let moved: [f64; 3] = std::array::from_fn(|i| (after[i] - before[i]) / 0.0165);
        expect_all("torso velocity", &moved, &mean, 0.05)?;
    }
    Ok(())
}

/// `x = F t²/(2 m)`; semi-implicit Euler goes `F t h/(2 m)` further.
fn torque_accelerates_by_inertia(build: &Build<'_>) -> Result<(), String> {
    let mut cart = Rig::new(build, robot(9.8, CART.0, CART.1)?)?;
    expect("distance", distance_under_force(&mut cart)?, 5.0 / 2.0 / 2.0, 0.012)
}

fn payload_slows_the_motion(build: &Build<'_>) -> Result<(), String> {
    let mut cart = Rig::new(build, robot(9.8, CART.0, CART.1)?)?;
    cart.body.set_dynamics(&Dynamics { payload: 3.0, ..cart.model.dynamics }).map_err(text)?;
    expect("distance with 3 kg", distance_under_force(&mut cart)?, 5.0 / 2.0 / 5.0, 0.005)?;
    cart.body.set_dynamics(&cart.model.dynamics).map_err(text)?;
    expect("distance without again", distance_under_force(&mut cart)?, 5.0 / 2.0 / 2.0, 0.012)
}

/// How far 5 N move a cart from rest in 1 s, to within a control step.
fn distance_under_force(cart: &mut Rig) -> Result<f64, String> {
    cart.restore(&cart.standing())?;
    (0..60).try_for_each(|_| cart.advance(&[5.0]))?;
    let t: f64 = 0.0165 * 60.0;
    Ok(cart.coordinates().0[0] / (t * t))
}

/// `d = v²/(2 μ g)`, within 10 %: MuJoCo's contacts are soft.
fn friction_stops_a_sliding_box(build: &Build<'_>) -> Result<(), String> {
    let mut rig = Rig::new(build, box_on_the_floor()?)?;
    for friction in [0.5, 0.2] {
        rig.body.set_dynamics(&Dynamics { floor_friction: friction, payload: 0.0 }).map_err(text)?;
        let (positions, mut velocities) = rig.standing();
        velocities[0] = 1.0;
        rig.restore(&(positions, velocities))?;
        (0..80).try_for_each(|_| rig.advance(&[0.0]))?;
        let expected = 1.0 / (2.0 * friction * 9.8);
        let what = format!("sliding distance with friction {friction}");
        expect(&what, rig.coordinates().0[0], expected, 0.1 * expected)?;
    }
    Ok(())
}

/// Its weight is borne: the mean acceleration over 2 s of rest is nil. In the air it touches nothing.
fn a_resting_box_stays_and_touches_the_floor(build: &Build<'_>) -> Result<(), String> {
    let mut rig = Rig::new(build, box_on_the_floor()?)?;
    rig.restore(&rig.standing())?;
    (0..60).try_for_each(|_| rig.advance(&[0.0]))?;
    let before = rig.coordinates();
    (0..120).try_for_each(|_| rig.advance(&[0.0]))?;
    let after = rig.coordinates();
    expect_all("place", &after.0[..3], &before.0[..3], 1e-4)?;
    expect("mean acceleration", (after.1[1] - before.1[1]) / 2.0, 0.0, 1e-3)?;
    expect("depth below the floor", after.0[1], 0.0, 2e-3)?;
    if rig.reading().on_floor != [true, false] {
        return Err(format!("on the floor: {:?}, expected the box alone", rig.reading().on_floor));
    }
    let (mut positions, velocities) = rig.standing();
    positions[1] = 0.5;
    rig.restore(&(positions, velocities))?;
    rig.advance(&[0.0])?;
    if rig.reading().on_floor != [false, false] {
        return Err("contacts half a metre above the floor".to_owned());
    }
    Ok(())
}

/// A cart that starts 0.5 m outside its range comes back with half the violation per second, and one that runs into its
/// limit with 5 m/s is stopped within 10 cm.
fn limits_stop_and_bring_back_slowly(build: &Build<'_>) -> Result<(), String> {
    let tree = CART.0.replace("-50 50", "-1 1");
    let mut cart = Rig::new(build, robot(9.8, &tree, CART.1)?)?;
    cart.restore(&(vec![1.5], vec![0.0]))?;
    let mut fastest: f64 = 0.0;
    for _ in 0..60 {
        cart.advance(&[0.0])?;
        fastest = fastest.max(cart.coordinates().1[0].abs());
    }
    // An engine may keep the first 0.25 m/s, which nothing brakes, or slow down with the violation: to 0.5 exp(-0.5) m
    // outside after a second. And it may move the cart without calling that a velocity.
    expect("place after a second outside", cart.coordinates().0[0], 1.28, 0.05)?;
    expect("speed on the way back", fastest, 0.135, 0.135)?;
    cart.restore(&(vec![0.9], vec![5.0]))?;
    let mut furthest: f64 = 0.0;
    for _ in 0..30 {
        cart.advance(&[0.0])?;
        furthest = furthest.max(cart.coordinates().0[0]);
    }
    expect("furthest place after running into the limit", furthest, 1.05, 0.05)?;
    expect("speed after running into the limit", cart.coordinates().1[0], 0.0, 0.1)
}

/// Through contacts and limits, on the same body after other work, and on a new one.
fn replays_are_equal_bit_for_bit(build: &Build<'_>) -> Result<(), String> {
    let mut ant = Rig::new(build, built("ant")?)?;
    let run = |ant: &mut Rig| {
        ant.restore(&ant.standing())?;
        for t in 0..80 {
            let torques: [f64; 8] = std::array::from_fn(|j| 150.0 * (0.9 * t as f64 + 1.7 * j as f64).sin());
            ant.advance(&torques)?;
        }
        Ok::<_, String>(ant.coordinates())
    };
    let first = run(&mut ant)?;
    ant.body.set_dynamics(&Dynamics { floor_friction: 0.3, payload: 5.0 }).map_err(text)?;
    let other = run(&mut ant)?;
    ant.body.set_dynamics(&ant.model.dynamics).map_err(text)?;
    let again = run(&mut ant)?;
    let fresh = run(&mut Rig::new(build, built("ant")?)?)?;
    if first != again || first != fresh {
        return Err(format!("three runs differ: {first:?} {again:?} {fresh:?}"));
    }
    if first == other { Err("friction and payload change nothing".to_owned()) } else { Ok(()) }
}
