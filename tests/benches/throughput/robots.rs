//! What all sections measure with: simulators by engine, and options that move all joints.

use std::error::Error;

use elo_backends::mujoco::MujocoConfig;
use elo_backends::rapier::RapierConfig;
use elo_core::policy::{Demonstration, Imitate as _, OptionPolicy};
use elo_core::seed::Seed;
use elo_core::simulator::SimulatorConfig;
use elo_core::spec::SimulatorSpec;
use elo_learners::open_loop::OpenLoopConfig;
use rand::RngExt as _;

/// `T`: control steps of an option, and of a rollout.
pub const STEPS: usize = 200;

/// The engines, whether or not they are linked.
pub const ENGINES: [&str; 2] = ["rapier", "mujoco"];

/// The engines that can run inside this program. Says what is left out.
pub fn linked() -> Vec<&'static str> {
    if cfg!(feature = "mujoco") {
        return ENGINES.to_vec();
    }
    println!("  MuJoCo inside this program is left out: build with `--features mujoco` after `tests/set-up`");
    vec!["rapier"]
}

/// A built-in robot in an engine.
pub fn simulator(engine: &str, robot: &str) -> Box<dyn SimulatorConfig> {
    let robot = Some(robot.to_owned());
    match engine {
        "rapier" => Box::new(RapierConfig { robot, ..RapierConfig::default() }),
        _ => Box::new(MujocoConfig { robot, own_robot: None }),
    }
}

/// The actions of an option, row after row: every joint swings by 0.15 at its own pace.
pub fn swinging(spec: &SimulatorSpec, seed: &Seed) -> Vec<f32> {
    let mut stream = seed.stream();
    let joints: Vec<[f32; 2]> = (0..spec.action_size()).map(|_| [stream.random(), stream.random()]).collect();
    let swing = |step: usize, [pace, phase]: &[f32; 2]| {
        0.15 * (step as f32 * (0.1 + 0.2 * pace) + phase * std::f32::consts::TAU).sin()
    };
    (0..STEPS).flat_map(|step| joints.iter().map(move |joint| swing(step, joint))).collect()
}

/// The open-loop option that plays `actions`.
pub fn option(actions: &[f32], spec: &SimulatorSpec) -> Result<Box<dyn OptionPolicy>, Box<dyn Error>> {
    let demonstration = Demonstration {
        observations: vec![0.0; STEPS * spec.observation_size],
        actions: actions.to_vec(),
        steps: STEPS,
    };
    Ok(OpenLoopConfig {}.learn(&demonstration, spec, &Seed::root(1))?)
}
