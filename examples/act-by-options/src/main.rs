//! Acts by an option set in a world that elo knows nothing of, as a robot's own program would: the infant agent picks an option
//! by its interest, runs it to its end, and picks again.
//!
//! ```text
//! cargo run --release --package act-by-options -- runs/half-cheetah-quick/results/option_sets/maximum_mean
//! ```

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use elo_core::agent::{Agent as _, InfantAgent};
use elo_core::policy::OptionPolicy;
use elo_core::seed::Seed;

/// Control steps until the program ends; a robot's would go on.
const STEPS: usize = 10;

fn main() -> ExitCode {
    let acted = act();
    if let Err(error) = &acted {
        eprintln!("act-by-options: {error}");
    }
    ExitCode::from(u8::from(acted.is_err()))
}

fn act() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("expected the folder of an option set")?;
    let options = elo_learners::load(Path::new(&folder))?;
    let policies: Vec<&dyn OptionPolicy> = options.policies.iter().map(AsRef::as_ref).collect();
    let mut infant = InfantAgent::new(&policies, &options.manifest.spec);

    let mut noise = Seed::root(1).stream();
    let mut action = vec![0.0; options.action_size()];
    let mut observation = vec![0.0; options.observation_size()];
    infant.begin(&observation, &mut noise);
    for _ in 0..STEPS {
        infant.act(&observation, &mut noise, &mut action);
        observation = sense(&action, options.observation_size());
        println!("{action:?}");
    }
    Ok(())
}

/// Stands for the motors and sensors of a robot.
fn sense(_action: &[f32], size: usize) -> Vec<f32> {
    vec![0.0; size]
}
