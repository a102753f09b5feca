//! `elo reproduce`: the paper's experiments, from nothing to figures beside the paper's.

use std::fmt::Write as _;
use std::path::PathBuf;

use elo_core::csv::quoted;
use elo_core::discover::Run;
use elo_core::experiment::Experiment;
use elo_core::experiments::Experiments;
use elo_core::fingerprint::fingerprint;
use elo_core::plugin::Plugin;
use serde::Serialize;
use toml::{Table, Value};

use crate::arguments::{Reproduce, Scale};
use crate::commands::{discover, experiments};
use crate::exit::Exit;
use crate::open::{ready_to_run, staff, with_crew};
use crate::output::{print, print_error};
use crate::paper::{self, Beside};
use crate::{experiments_table, load};

/// The configs of `examples/paper`.
const PRESETS: [(&str, &str); 3] = [
    ("ant", include_str!("../../../examples/paper/ant.toml")),
    ("half-cheetah", include_str!("../../../examples/paper/half-cheetah.toml")),
    ("walker2d", include_str!("../../../examples/paper/walker2d.toml")),
];

/// What the quick scale changes.
const QUICK: &str = "
    teacher = { steps = 300_000, snapshots = 6, d0_pool = 100 }
    discover = { teachers = 2, candidates = 40, contexts = 40 }
    report = { contexts = 60, random_subsets = 4 }
";

/// `reproduction.json`.
#[derive(Serialize)]
struct Reproduction<'a> {
    /// What did it.
    program: String,
    scale: &'static str,
    simulator: &'a str,
    /// What `--set` changed.
    changes: &'a [String],
    robots: &'a [Reproduced],
}

/// One robot's runs.
#[derive(Serialize)]
struct Reproduced {
    robot: String,
    /// Our figures beside the paper's.
    beside: Vec<Beside>,
    /// What each pipeline seed found.
    seeds: Vec<Experiments>,
}

/// Runs what is missing, robot by robot and seed by seed, and prints our figures beside the paper's.
pub fn run(arguments: &Reproduce, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    if arguments.seeds == 0 {
        return Err(Exit::BadInput("`--seeds`: expected at least 1, got 0".to_owned()));
    }
    let presets = presets(&arguments.robots)?;
    let scale = match arguments.scale {
        Scale::Quick => "quick",
        Scale::Paper => "paper",
    };
    let folder = arguments.out.join(format!("{scale}-{}", arguments.simulator));
    // All configs are read before anything is run.
    let mut robots = Vec::new();
    for (robot, preset) in presets {
        let experiments =
            (1..=arguments.seeds).map(|seed| experiment(arguments, (robot, preset), seed, plugins));
        robots.push((robot, experiments.collect::<Result<Vec<_>, _>>()?));
    }
    let (runs, mut done) = (robots.len() as u64 * arguments.seeds, 0);
    let mut all = Vec::new();
    for (robot, experiments) in robots {
        let mut seeds = Vec::new();
        for experiment in experiments {
            done += 1;
            let seed = experiment.seed;
            print_error(&format!("{robot}, seed {seed} (run {done} of {runs})"));
            let staff = staff(arguments.workers, plugins)?;
            let run = folder.join(format!("{robot}-seed-{seed}"));
            seeds.push(with_crew(&run, &experiment, staff, |crew| {
                let run = Run::new(&experiment, crew)?;
                let (discovery, held_out) = discover::run_in(&run)?;
                for warning in &held_out.report.warnings {
                    print_error(&format!("{robot}, seed {seed}: {warning}"));
                }
                experiments::run_in(&run, &discovery, &held_out)
            })?);
        }
        let beside = paper::beside(&seeds, CONFIDENCE);
        if !arguments.json {
            let tables = seeds.iter().map(|found| experiments_table::experiments(found, CONFIDENCE));
            print(&(tables.collect::<String>() + &experiments_table::beside(&beside)))?;
        }
        all.push(Reproduced { robot: robot.to_owned(), beside, seeds });
    }
    let reproduction = Reproduction {
        program: fingerprint(),
        scale,
        simulator: &arguments.simulator,
        changes: &arguments.overrides,
        robots: &all,
    };
    let json = serde_json::to_string_pretty(&reproduction).expect("figures are plain data") + "\n";
    let files = [("reproduction.json", json.clone()), ("reproduction.csv", csv(&all))];
    for (name, text) in files {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| Exit::Failed(format!("{}: {error}", path.display())))?;
    }
    if arguments.json { print(&json) } else { print(&format!("results in {}\n", folder.display())) }
}

/// Coverage of the intervals: that of the presets.
const CONFIDENCE: f64 = 0.95;

/// The wanted presets in the paper's order; all without a wish.
fn presets(robots: &[String]) -> Result<Vec<(&'static str, &'static str)>, Exit> {
    if let Some(unknown) = robots.iter().find(|robot| PRESETS.iter().all(|(name, _)| name != robot)) {
        let names = PRESETS.map(|(name, _)| name).join(", ");
        return Err(Exit::BadInput(format!("`--robot`: expected one of {names}, got {unknown}")));
    }
    let wanted = |name: &str| robots.is_empty() || robots.iter().any(|robot| robot == name);
    Ok(PRESETS.into_iter().filter(|(name, _)| wanted(name)).collect())
}

fn experiment(
    arguments: &Reproduce,
    (robot, preset): (&str, &str),
    seed: u64,
    plugins: &[&[Plugin]],
) -> Result<Experiment, Exit> {
    let table = |text: &str| text.parse::<Table>().expect("presets are TOML");
    let mut preset = table(preset);
    merge(&mut preset, toml::toml! { seed = (seed as i64) });
    merge(&mut preset, toml::toml! { simulator = { kind = (arguments.simulator.clone()) } });
    if arguments.scale == Scale::Quick {
        merge(&mut preset, table(QUICK));
    }
    let name = PathBuf::from(format!("the preset of {robot}"));
    let experiment = load::embedded(&preset.to_string(), &name, &arguments.overrides, plugins)?;
    ready_to_run(&experiment)?;
    Ok(experiment)
}

/// Puts the values of `changes` into `table`, those of tables within it one by one.
fn merge(table: &mut Table, changes: Table) {
    for (name, change) in changes {
        match (table.get_mut(&name), change) {
            (Some(Value::Table(inner)), Value::Table(changes)) => merge(inner, changes),
            (_, change) => drop(table.insert(name, change)),
        }
    }
}

fn csv(all: &[Reproduced]) -> String {
    let mut text = "robot,figure,estimate,low,high,seeds,paper,comparable,remark,note\n".to_owned();
    for (robot, beside) in all.iter().flat_map(|one| one.beside.iter().map(move |b| (&one.robot, b))) {
        let ours = beside.ours.map_or(",,".to_owned(), |i| format!("{},{},{}", i.estimate, i.low, i.high));
        let seeds = beside.seeds.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
        let paper = beside.paper.map_or(String::new(), |value| value.to_string());
        let (figure, remark) = (quoted(&beside.figure), quoted(beside.remark()));
        let note = quoted(beside.note.as_deref().unwrap_or_default());
        let comparable = beside.comparable;
        let _ = writeln!(text, "{robot},{figure},{ours},{seeds},{paper},{comparable},{remark},{note}");
    }
    text
}
