//! Laws of pendulums, against closed forms and against equations of motion integrated here to rounding error.

use super::laws::{Build, Coordinates, Rig, expect, robot, robot_with_step};

const GRAVITY: f64 = 9.8;

/// One rod: mass, distance of its centre of mass from its pivot, inertia about the centre of mass.
const MASS: f64 = 2.0;
const CENTER: f64 = 0.5;
const INERTIA: f64 = 0.1;

const SINGLE: (&str, &str) = (
    r#"<body name="torso" pos="0 0 3"><inertial pos="0 0 -0.5" mass="2" diaginertia="0.1 0.1 0.1"/>
    <joint name="swing" limited="true" range="-3 3"/></body>"#,
    r#"<motor joint="swing"/>"#,
);

fn about_the_pivot() -> f64 {
    INERTIA + MASS * CENTER * CENTER
}

fn released(build: &Build<'_>, angle: f64) -> Result<Rig, String> {
    let mut rig = Rig::new(build, robot(GRAVITY, SINGLE.0, SINGLE.1)?)?;
    rig.restore(&(vec![angle], vec![0.0]))?;
    Ok(rig)
}

/// `T = 2π sqrt(I/(m g l)) (1 + θ²/16)`, over five swings, within a thousandth.
pub(super) fn has_its_period(build: &Build<'_>) -> Result<(), String> {
    let mut rig = released(build, 0.1)?;
    let expected = std::f64::consts::TAU
        * (about_the_pivot() / (MASS * GRAVITY * CENTER)).sqrt()
        * (1.0 + 0.1_f64.powi(2) / 16.0);
    let mut downward_crossings = Vec::new();
    let mut before = 0.1;
    for step in 0..2000 {
        rig.advance(&[0.0])?;
        let now = rig.coordinates().0[0];
        if before > 0.0 && now <= 0.0 {
            downward_crossings.push((f64::from(step) + before / (before - now)) * 0.0165);
        }
        before = now;
        if let [first, .., last] = downward_crossings[..]
            && downward_crossings.len() == 6
        {
            return expect("period", (last - first) / 5.0, expected, 1e-3 * expected);
        }
    }
    Err(format!("it swung {} times in 33 s", downward_crossings.len()))
}

/// From 2 rad, over 20 s: the energy stays within 2 % of the swing's below what it was, and never rises above it by more.
pub(super) fn gains_no_energy(build: &Build<'_>) -> Result<(), String> {
    let mut rig = released(build, 2.0)?;
    let energy = |(positions, velocities): &Coordinates| {
        0.5 * about_the_pivot() * velocities[0].powi(2) + MASS * GRAVITY * CENTER * (1.0 - positions[0].cos())
    };
    let start = energy(&rig.coordinates());
    for _ in 0..1200 {
        rig.advance(&[0.0])?;
        expect("energy", energy(&rig.coordinates()), start, 0.02 * start)?;
    }
    Ok(())
}

/// Two such rods, the second hinged at the end (1 m) of the first, under constant torques: against the Lagrangian
/// equations, the error of half the step is half the error.
pub(super) fn errs_in_proportion_to_the_step(build: &Build<'_>) -> Result<(), String> {
    let tree = r#"<body name="torso" pos="0 0 3"><inertial pos="0 0 -0.5" mass="2" diaginertia="0.1 0.1 0.1"/>
        <joint name="upper" limited="true" range="-9 9"/>
        <body name="lower" pos="0 0 -1"><inertial pos="0 0 -0.5" mass="2" diaginertia="0.1 0.1 0.1"/>
        <joint name="lower" limited="true" range="-9 9"/></body></body>"#;
    let motors = r#"<motor joint="upper"/><motor joint="lower"/>"#;
    let torques = [3.0, -2.0];
    let error = |step: f64, substeps: u32| {
        let model = robot_with_step(step, substeps, GRAVITY, (tree, motors))?;
        let mut rig = Rig::new(build, model)?;
        rig.restore(&(vec![0.8, -0.3], vec![0.0, 0.5]))?;
        let steps = 40;
        (0..steps).try_for_each(|_| rig.advance(&torques))?;
        let exact = exact_double_pendulum([0.8, -0.3, 0.0, 0.5], torques, 0.0165 * f64::from(steps));
        let (positions, _) = rig.coordinates();
        Ok::<f64, String>((positions[0] - exact[0]).hypot(positions[1] - exact[1]))
    };
    let (coarse, fine) = (error(0.004125, 4)?, error(0.004125 / 2.0, 8)?);
    expect("error at 4.125 ms, in rad", coarse, 0.0, 0.05)?;
    expect("error of half the step over that of the step", fine / coarse, 0.5, 0.1)
}

/// Joint angles and velocities `[q1, q2, q1', q2']` after `time`, by Runge-Kutta in steps of 0.1 ms.
fn exact_double_pendulum(start: [f64; 4], torques: [f64; 2], time: f64) -> [f64; 4] {
    let steps = (time / 1e-4).round() as usize;
    let h = time / steps as f64;
    let along = |x: [f64; 4], k: [f64; 4], h: f64| -> [f64; 4] { std::array::from_fn(|i| x[i] + h * k[i]) };
    (0..steps).fold(start, |x, _| {
        let a = derivative(x, torques);
        let b = derivative(along(x, a, h / 2.0), torques);
        let c = derivative(along(x, b, h / 2.0), torques);
        let d = derivative(along(x, c, h), torques);
        std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]))
    })
}

/// Lagrange's equations in the absolute angles `θ1 = q1` and `θ2 = q1 + q2`, on which the torques act as `τ1 - τ2` and
/// `τ2`.
fn derivative([q1, q2, w1, w2]: [f64; 4], [t1, t2]: [f64; 2]) -> [f64; 4] {
    let (theta1, theta2, v1, v2) = (q1, q1 + q2, w1, w1 + w2);
    let a = about_the_pivot() + MASS;
    let b = MASS * CENTER;
    let c = about_the_pivot();
    let (sin, cos) = (theta1 - theta2).sin_cos();
    let f1 = t1 - t2 - b * sin * v2 * v2 - (MASS * CENTER + MASS) * GRAVITY * theta1.sin();
    let f2 = t2 + b * sin * v1 * v1 - MASS * CENTER * GRAVITY * theta2.sin();
    let det = a * c - b * b * cos * cos;
    let acceleration1 = (c * f1 - b * cos * f2) / det;
    let acceleration2 = (a * f2 - b * cos * f1) / det;
    [w1, w2, acceleration1, acceleration2 - acceleration1]
}
