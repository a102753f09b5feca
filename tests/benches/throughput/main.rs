//! What the program costs beside its engines, as ratios measured within one run:
//!
//! `cargo bench -p elo-tests --features mujoco --bench throughput [-- candidates|workers|bridge|ppo|interest ...]`
//!
//! Without the feature only Rapier runs inside this program. Worker processes are measured when `elo-mujoco` lies where
//! `tests/set-up` builds it, the bridge to Python when its virtual environment is there, and Stable-Baselines3 when
//! `python3` has it. To put both sides of that comparison on one core: `taskset -c 0 cargo bench ... -- ppo`.

mod bare;
mod bridge;
mod candidates;
mod interest;
mod ppo;
mod processor_time;
mod robots;
mod timed;
mod workers;

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let sections: [(&str, Section); 5] = [
        ("candidates", candidates::run),
        ("workers", workers::run),
        ("bridge", bridge::run),
        ("ppo", ppo::run),
        ("interest", interest::run),
    ];
    // Cargo adds `--bench`.
    let asked: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    if let Some(unknown) = asked.iter().find(|name| sections.iter().all(|(section, _)| section != name)) {
        let names = sections.map(|(name, _)| name).join(", ");
        return Err(format!("no section `{unknown}`; there are {names}").into());
    }
    for (name, section) in sections {
        if asked.is_empty() || asked.iter().any(|one| one == name) {
            println!("{name} (load average before: {})", processor_time::load_average());
            section()?;
            println!();
        }
    }
    Ok(())
}

type Section = fn() -> Result<(), Box<dyn Error>>;

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
