//! What observation, reward and checks cost on top of MuJoCo: control steps of the locomotion simulator beside bare
//! `mj_step`s with a look at the contacts, on the same motions, in one run.
//!
//! `cargo bench -p elo-backends --no-default-features --features mujoco --bench mujoco_step`

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use elo_backends::locomotion::robot::{AliveRule, NAMES, built_in};
use elo_backends::mujoco::MujocoConfig;
use elo_core::seed::Seed;
use elo_core::simulator::{Simulator, SimulatorConfig as _, Start, State};
use elo_core::task::Task;
use mujoco_rs::mujoco_c::mjtDisableBit;
use mujoco_rs::prelude::{MjData, MjModel};
use rand::RngExt as _;

const STEPS: usize = 100;
const ROUNDS: usize = 400;

fn main() -> Result<(), Box<dyn Error>> {
    println!("robot          bare us   simulator us   ratio   control steps/s");
    for name in NAMES {
        // No end of the episode, so that both sides go through the same motion.
        let robot = built_in(name).ok_or("a built-in robot")?;
        let robot =
            elo_backends::locomotion::robot::RobotDescription { alive: AliveRule::default(), ..robot };
        let text = robot.mjcf.clone();
        let mut simulator = MujocoConfig { robot: None, own_robot: Some(robot) }.build()?;
        let mut model = MjModel::from_xml_string(&text)?;
        for flag in [mjtDisableBit::mjDSBL_ACTUATION, mjtDisableBit::mjDSBL_ISLAND] {
            model.opt_mut().disableflags |= flag as i32;
        }
        let mut data = MjData::new(Box::new(model));
        let (mut bare, mut full) = (Vec::new(), Vec::new());
        for round in 0..ROUNDS {
            let actions = actions(simulator.as_ref(), round as u64);
            let mut observation = vec![0.0; simulator.spec().observation_size];
            simulator.reset(&Task::default(), &Start::Seed(round as u64), &mut observation)?;
            let start = simulator.state()?;
            full.push(time(|| run_simulator(simulator.as_mut(), &actions, &mut observation))?);
            bare.push(time(|| run_bare(&mut data, &start, &actions))?);
            let end = simulator.state()?.positions;
            let apart = end.iter().zip(data.qpos()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            if apart > 1e-9 {
                return Err(format!("the two sides part by {apart} in round {round} of {name}").into());
            }
        }
        let (bare, full) = (undisturbed(bare), undisturbed(full));
        println!("{name:<14} {bare:7.2}   {full:12.2}   {:5.3}   {:15.0}", full / bare, 1e6 / full);
    }
    Ok(())
}

fn actions(simulator: &dyn Simulator, round: u64) -> Vec<Vec<f32>> {
    let mut stream = Seed::root(1).index(round).stream();
    let mut action =
        || (0..simulator.spec().action_size()).map(|_| stream.random::<f32>() * 2.0 - 1.0).collect();
    (0..STEPS).map(|_| action()).collect()
}

/// Microseconds a control step.
fn time(run: impl FnOnce() -> Result<(), Box<dyn Error>>) -> Result<f64, Box<dyn Error>> {
    let start = Instant::now();
    run()?;
    Ok(start.elapsed().as_secs_f64() * 1e6 / STEPS as f64)
}

fn run_simulator(
    simulator: &mut dyn Simulator,
    actions: &[Vec<f32>],
    observation: &mut [f32],
) -> Result<(), Box<dyn Error>> {
    let mut terms = [0.0; 6];
    for action in actions {
        simulator.step(action, observation, &mut terms)?;
        black_box(&observation);
    }
    Ok(())
}

fn run_bare(
    data: &mut MjData<Box<MjModel>>,
    start: &State,
    actions: &[Vec<f32>],
) -> Result<(), Box<dyn Error>> {
    data.reset();
    data.qpos_mut().copy_from_slice(&start.positions);
    data.qvel_mut().copy_from_slice(&start.velocities);
    let first = data.model().nv() as usize - actions[0].len();
    let gears: Vec<f64> = (0..actions[0].len()).map(|j| data.model().actuator_gear()[j][0]).collect();
    for action in actions {
        for (force, (gear, &a)) in data.qfrc_applied_mut()[first..].iter_mut().zip(gears.iter().zip(action)) {
            *force = gear * f64::from(a);
        }
        for _ in 0..4 {
            data.step();
        }
        black_box(data.contact().iter().filter(|contact| contact.dist < 0.0).count());
    }
    Ok(())
}

/// The tenth percentile: other work on the machine only ever adds time.
fn undisturbed(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 10]
}
