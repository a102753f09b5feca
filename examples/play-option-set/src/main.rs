//! Loads an option set and plays each of its options once, from the robot's standard reset:
//!
//! ```text
//! cargo run --release --package play-option-set -- runs/half-cheetah-quick/results/option_sets/maximum_mean
//! ```

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use elo_core::option_set::OptionSet;
use elo_core::rollout::price;
use elo_core::seed::Seed;
use elo_core::simulator::{End, SimulatorConfig, Start};
use elo_core::task::Task;

fn main() -> ExitCode {
    let played = play();
    if let Err(error) = &played {
        eprintln!("play-option-set: {error}");
    }
    ExitCode::from(u8::from(played.is_err()))
}

fn play() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("expected the folder of an option set")?;
    let set = OptionSet::read(Path::new(&folder))?;

    // The simulator that the set was selected on. The slices say which engines and policy formats this program knows.
    let plugins = [elo_core::plugin::PLUGINS, elo_backends::PLUGINS, elo_learners::PLUGINS].concat();
    let simulator = set.manifest.experiment["simulator"].clone();
    let mut world = serde_json::from_value::<Box<dyn SimulatorConfig>>(simulator)?.build()?;
    let formats: Vec<_> = plugins.iter().filter_map(|plugin| plugin.format).collect();
    let options = set.policies(world.spec(), &formats)?;

    let (spec, task, mut noise) = (world.spec().clone(), Task::default(), Seed::root(0).stream());
    let mut action = vec![0.0; spec.action_size()];
    let mut observation = vec![0.0; spec.observation_size];
    let mut terms = vec![0.0; spec.reward_terms.len()];
    for (entry, option) in set.manifest.options.iter().zip(&options) {
        world.reset(&task, &Start::Seed(0), &mut observation)?;
        let (mut steps, mut total) = (0, 0.0);
        while steps < set.manifest.horizon.steps {
            option.act(&observation, steps, &mut noise, &mut action);
            let end = world.step(&action, &mut observation, &mut terms)?;
            total += price(&terms, &spec.prices(&task));
            steps += 1;
            if end != End::Running {
                break;
            }
        }
        println!("option {}: return {total:.1} in {steps} steps", entry.number);
    }
    Ok(())
}
