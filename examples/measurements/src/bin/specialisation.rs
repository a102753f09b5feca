//! How the options of sets with interests divide the states among themselves, as CSV: where each option is drawn, in the
//! states that the infant agent comes through in the first 50 held-out contexts of finished runs.
//!
//! ```sh
//! cargo run --release -p measurements --bin specialisation -- runs/ant runs/half-cheetah > specialisation.csv
//! ```
//!
//! One line an option of the first metric's set. `share` is how often it is drawn; `height` (metres above the torso's standard
//! height), `pitch` (radians) and `contacts` (share of the feet on the floor) are means over the states, weighted by how often
//! it is drawn there. `information` is that between state and option, `H(mean of π_I) − mean of H(π_I)` in nats: 0 where options
//! are drawn alike everywhere, `log K` where every state has its own. `actions` is the mean number of actions of an option.
//!
//! The observations are those of this project's robots. Programs of workers (`elo-mujoco`) are those beside this one.

use std::path::Path;

use elo_core::crew::Unwatched;
use elo_core::discover::{CONTEXTS_PER_UNIT, Discovery, Run, discover};
use elo_core::performer::Performer;
use elo_core::policy::OptionPolicy;
use elo_core::results::folder_name;
use elo_core::spec::SimulatorSpec;
use elo_core::units::trace::Traced;
use measurements::{Failure, PLUGINS, with_crew};

fn main() -> Result<(), Failure> {
    let runs: Vec<String> = std::env::args().skip(1).collect();
    if runs.is_empty() {
        return Err("expected: RUN…, folders of finished runs".into());
    }
    println!("run,option,share,height,pitch,contacts,information,actions");
    runs.iter().try_for_each(|run| measure(Path::new(run)))
}

fn measure(folder: &Path) -> Result<(), Failure> {
    let experiment = elo_cli::load::of_run(folder, &PLUGINS)?;
    with_crew(&experiment, folder, &Unwatched, |crew| {
        print(folder, &Run::new(&experiment, crew)?, &discover(&experiment, crew)?)
    })
}

fn print(folder: &Path, run: &Run<'_>, discovery: &Discovery) -> Result<(), Failure> {
    let choice = &discovery.selection.choices[0];
    let chosen = &discovery.candidates[choice.chosen[0]];
    let set = folder.join("results/option_sets").join(folder_name(&choice.metric));
    let set = elo_learners::load(&set)?;
    if chosen.options.len() != set.policies.len() {
        return Err(format!("{}: its candidates are no sets", folder.display()).into());
    }
    let contexts = run.held_out_contexts(CONTEXTS_PER_UNIT)?;
    let seen = match run.observations(&[Performer::candidate(chosen)], &contexts)? {
        Traced::Rollouts(seen) => seen.concat(),
        Traced::Lost(why) => return Err(why.into()),
    };
    let Division { parts, information } = Division::of(&set.policies, &seen, &set.manifest.spec);
    let actions = 1.0 / set.policies[0].termination(&seen[..set.observation_size()], 1);
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    for (option, Part { share, height, pitch, contacts }) in parts.iter().enumerate() {
        println!(
            "{name},{option},{share:.4},{height:.4},{pitch:.4},{contacts:.4},{information:.4},{actions:.3}"
        );
    }
    Ok(())
}

/// Who is drawn where.
struct Division {
    /// Of each option.
    parts: Vec<Part>,
    /// Between state and option, in nats.
    information: f64,
}

/// One option's part.
#[derive(Clone, Debug, Default, PartialEq)]
struct Part {
    share: f64,
    height: f64,
    pitch: f64,
    contacts: f64,
}

impl Division {
    /// Of the states in rows of `seen`. An observation has the torso's height first, its pitch in the eighth place, and the
    /// contacts of the feet after eight numbers of the torso and two of each joint.
    fn of(options: &[Box<dyn OptionPolicy>], seen: &[f32], spec: &SimulatorSpec) -> Self {
        let states = seen.chunks_exact(spec.observation_size);
        let count = states.len() as f64;
        let feet = 8 + 2 * spec.action_size();
        let mut parts = vec![Part::default(); options.len()];
        let mut uncertainty = 0.0;
        for state in states {
            let interests: Vec<f64> = options.iter().map(|o| f64::from(o.interest(state))).collect();
            let total: f64 = interests.iter().sum();
            let drawn: Vec<f64> = interests.iter().map(|interest| interest / total).collect();
            let contacts = &state[feet..];
            let contacts = contacts.iter().map(|x| f64::from(*x)).sum::<f64>() / contacts.len() as f64;
            for (part, p) in parts.iter_mut().zip(&drawn) {
                part.share += p / count;
                part.height += p * f64::from(state[0]) / count;
                part.pitch += p * f64::from(state[7]) / count;
                part.contacts += p * contacts / count;
            }
            uncertainty += entropy(drawn.iter().copied()) / count;
        }
        for Part { share, height, pitch, contacts } in &mut parts {
            [height, pitch, contacts].into_iter().for_each(|sum| *sum /= *share);
        }
        let information = entropy(parts.iter().map(|part| part.share)) - uncertainty;
        Self { parts, information }
    }
}

/// `−Σ p log p`.
fn entropy(probabilities: impl Iterator<Item = f64>) -> f64 {
    probabilities.filter(|p| *p > 0.0).map(|p| -p * p.ln()).sum()
}
