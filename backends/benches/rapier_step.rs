//! What dividing a control step costs in Rapier, and what it buys: microseconds a control step under full random torque,
//! and how far a gently driven robot is from the same motion with 64 engine steps a control step, as the root mean
//! square over the coordinates, in the air (after 10 control steps from 3 m up) and on the floor (after 20, dropped
//! from the standard pose). Medians over episodes; costs are tenth percentiles.
//!
//! `cargo bench -p elo-backends --bench rapier_step`

use std::error::Error;
use std::time::Instant;

use elo_backends::locomotion::robot::{AliveRule, NAMES, RobotDescription, built_in};
use elo_backends::rapier::RapierConfig;
use elo_core::seed::Seed;
use elo_core::simulator::{Simulator, SimulatorConfig as _, Start};
use elo_core::task::Task;
use rand::RngExt as _;

const DIVISIONS: [(u32, u32); 9] = [(1, 1), (1, 2), (2, 1), (1, 4), (2, 2), (4, 1), (4, 2), (8, 1), (16, 1)];
const FINE: (u32, u32) = (64, 1);
const EPISODES: u64 = 40;

fn main() -> Result<(), Box<dyn Error>> {
    println!("robot          steps x parts     us   restore us   error in the air   error on the floor");
    for name in NAMES {
        let fine = Errors::of(name, FINE)?;
        for division in DIVISIONS {
            let (step, restore) = cost(name, division)?;
            let [air, floor] = Errors::of(name, division)?.from(&fine);
            let (steps, parts) = division;
            println!(
                "{name:<14} {steps:>5} x {parts:<5} {step:8.1}   {restore:10.1}   {air:16.5}   {floor:18.5}"
            );
        }
    }
    Ok(())
}

/// A robot whose episodes never end.
fn simulator(name: &str, (steps, parts): (u32, u32)) -> Result<Box<dyn Simulator>, Box<dyn Error>> {
    let robot = built_in(name).ok_or("a built-in robot")?;
    let config = RapierConfig {
        robot: None,
        own_robot: Some(RobotDescription { alive: AliveRule::default(), ..robot }),
        steps_per_control: Some(steps),
        substeps: parts,
    };
    Ok(config.build()?)
}

/// Microseconds of a control step and of a reset.
fn cost(name: &str, division: (u32, u32)) -> Result<(f64, f64), Box<dyn Error>> {
    let mut simulator = simulator(name, division)?;
    let (mut steps, mut resets) = (Vec::new(), Vec::new());
    for episode in 0..EPISODES {
        let actions = actions(simulator.as_ref(), episode, 200, 1.0);
        let begin = Instant::now();
        reset(simulator.as_mut(), episode, None)?;
        resets.push(begin.elapsed().as_secs_f64() * 1e6);
        let begin = Instant::now();
        run(simulator.as_mut(), &actions)?;
        steps.push(begin.elapsed().as_secs_f64() * 1e6 / actions.len() as f64);
    }
    Ok((quantile(steps, 0.1), quantile(resets, 0.1)))
}

/// Final coordinates of every episode.
struct Errors {
    air: Vec<Vec<f64>>,
    floor: Vec<Vec<f64>>,
}

impl Errors {
    fn of(name: &str, division: (u32, u32)) -> Result<Self, Box<dyn Error>> {
        let mut simulator = simulator(name, division)?;
        let mut this = Self { air: Vec::new(), floor: Vec::new() };
        for episode in 0..EPISODES {
            for (height, steps, ends) in [(Some(3.0), 10, &mut this.air), (None, 20, &mut this.floor)] {
                let actions = actions(simulator.as_ref(), episode, steps, 0.3);
                reset(simulator.as_mut(), episode, height)?;
                run(simulator.as_mut(), &actions)?;
                ends.push(simulator.state()?.positions);
            }
        }
        Ok(this)
    }

    fn from(&self, fine: &Self) -> [f64; 2] {
        [(&self.air, &fine.air), (&self.floor, &fine.floor)].map(|(ours, fine)| {
            let apart = |(a, b): (&Vec<f64>, &Vec<f64>)| {
                let sum: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
                (sum / a.len() as f64).sqrt()
            };
            quantile(ours.iter().zip(fine).map(apart).collect(), 0.5)
        })
    }
}

fn actions(simulator: &dyn Simulator, episode: u64, steps: usize, scale: f32) -> Vec<Vec<f32>> {
    let mut stream = Seed::root(1).index(episode).stream();
    let mut draw = || (stream.random::<f32>() * 2.0 - 1.0) * scale;
    (0..steps).map(|_| (0..simulator.spec().action_size()).map(|_| draw()).collect()).collect()
}

/// The standard reset, raised by so many metres.
fn reset(simulator: &mut dyn Simulator, episode: u64, raised: Option<f64>) -> Result<(), Box<dyn Error>> {
    let mut observation = vec![0.0; simulator.spec().observation_size];
    simulator.reset(&Task::default(), &Start::Seed(episode), &mut observation)?;
    if let Some(raised) = raised {
        let mut state = simulator.state()?;
        // Of a free root z is the third coordinate, of a planar root the second.
        let z = if state.positions.len() > state.velocities.len() { 2 } else { 1 };
        state.positions[z] += raised;
        simulator.reset(&Task::default(), &Start::State(state), &mut observation)?;
    }
    Ok(())
}

fn run(simulator: &mut dyn Simulator, actions: &[Vec<f32>]) -> Result<(), Box<dyn Error>> {
    let mut observation = vec![0.0; simulator.spec().observation_size];
    let mut terms = vec![0.0; simulator.spec().reward_terms.len()];
    for action in actions {
        simulator.step(action, &mut observation, &mut terms)?;
    }
    Ok(())
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[(values.len() as f64 * share) as usize]
}
