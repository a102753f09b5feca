//! Laws of the robots' motion in the air, where it is smooth enough to be compared.

use super::laws::{Build, Rig, built, expect, expect_all};
use super::model::RobotModel;
use super::robot::NAMES;

/// Mirrored at the x-z plane: legs 1 and 4, 2 and 3 change places, hips change sign.
pub(super) fn mirrored_torques_mirror_the_ant(build: &Build<'_>) -> Result<(), String> {
    let mut ant = Rig::new(build, built("ant")?)?;
    let mirror = |x: &[f64]| [-x[6], x[7], -x[4], x[5], -x[2], x[3], -x[0], x[1]];
    let (mut positions, velocities) = ant.standing();
    positions[2] = 5.0;
    positions[7..].copy_from_slice(&[0.2, 1.0, -0.1, -1.1, 0.3, -0.9, 0.0, 1.2]);
    let mut mirrored = positions.clone();
    mirrored[7..].copy_from_slice(&mirror(&positions[7..]));
    let torques: Vec<[f64; 8]> =
        (0..15).map(|t| std::array::from_fn(|j| 40.0 * (0.7 * t as f64 + 1.3 * j as f64).sin())).collect();
    ant.restore(&(positions, velocities.clone()))?;
    torques.iter().try_for_each(|torques| ant.advance(torques))?;
    let (one, _) = ant.coordinates();
    ant.restore(&(mirrored, velocities))?;
    torques.iter().try_for_each(|torques| ant.advance(&mirror(torques)))?;
    let (other, _) = ant.coordinates();
    expect_all("root", &other[..3], &[one[0], -one[1], one[2]], 1e-9)?;
    expect_all("rotation", &other[3..7], &[one[3], -one[4], one[5], -one[6]], 1e-9)?;
    expect_all("joints", &other[7..], &mirror(&one[7..]), 1e-9)?;
    if one[7..].iter().zip(&ant.standing().0[7..]).all(|(a, b)| (a - b).abs() < 0.1) {
        return Err("the torques moved nothing".to_owned());
    }
    Ok(())
}

/// A robot 5 m up with free joints, and its time step divided by `fineness`.
fn in_flight(name: &str, fineness: u32) -> Result<RobotModel, String> {
    let mut description = built(name)?.description;
    let step = format!("timestep=\"{}\"", 0.004125 / f64::from(fineness));
    description.mjcf = description
        .mjcf
        .replace("timestep=\"0.004125\"", &step)
        .replace("limited=\"true\" solref", "limited=\"false\" solref");
    description.substeps *= fineness;
    RobotModel::load(&description).map_err(|faults| format!("{faults:?}"))
}

/// Where the robot's joints and root are after a quarter of a second of torques that differ from joint to joint.
fn flown(build: &Build<'_>, name: &str, fineness: u32) -> Result<Vec<f64>, String> {
    let mut rig = Rig::new(build, in_flight(name, fineness)?)?;
    let (mut positions, velocities) = rig.standing();
    positions[if rig.model.root_quaternion.is_some() { 2 } else { 1 }] += 5.0;
    for (j, joint) in rig.model.joints.iter().enumerate() {
        positions[joint.position] = 0.3 * (1.9 * j as f64).cos();
    }
    rig.restore(&(positions, velocities))?;
    for t in 0..15 {
        let swing = |(j, gear): (usize, f64)| 0.2 * gear * (0.5 * f64::from(t) + 1.3 * j as f64).sin();
        let gears = rig.model.joints.iter().map(|joint| joint.gear).enumerate();
        let torques: Vec<f64> = gears.map(swing).collect();
        rig.advance(&torques)?;
    }
    Ok(rig.coordinates().0)
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Halving the step twice: the second change is half the first, within a fifth of it.
pub(super) fn robots_err_in_proportion_to_the_step(build: &Build<'_>) -> Result<(), String> {
    for name in NAMES {
        let [coarse, middle, fine] = [1, 2, 4].map(|fineness| flown(build, name, fineness));
        let (coarse, middle, fine) = (coarse?, middle?, fine?);
        let (first, second) = (distance(&coarse, &middle), distance(&middle, &fine));
        expect(&format!("{name}: change at a quarter over change at half a step"), second / first, 0.5, 0.1)?;
        expect(&format!("{name}: change at half a step"), first, 0.0, 0.2)?;
    }
    Ok(())
}

/// Two engines' motions differ by no more than twice their own errors, which halving the step shows.
#[cfg(all(feature = "mujoco", feature = "rapier"))]
fn engines_agree(one: &Build<'_>, other: &Build<'_>) -> Result<(), String> {
    for name in NAMES {
        let (a, b) = (flown(one, name, 1)?, flown(other, name, 1)?);
        let own = distance(&a, &flown(one, name, 2)?) + distance(&b, &flown(other, name, 2)?);
        expect(&format!("{name}: distance between the engines"), distance(&a, &b), 0.0, 2.0 * own)?;
    }
    Ok(())
}

#[cfg(all(feature = "mujoco", feature = "rapier"))]
#[test]
fn mujoco_and_rapier_agree_in_flight() {
    use crate::mujoco::MujocoBody;
    use crate::rapier::{Division, RapierBody};

    let agreement =
        engines_agree(&|model| Box::new(MujocoBody::new(model).expect("a built-in robot")), &|model| {
            let division = Division { steps: model.description.substeps as usize, substeps: 1 };
            Box::new(RapierBody::new(model, division).expect("a built-in robot"))
        });
    assert_eq!(agreement, Ok(()));
}
