//! All programs run, at the smallest sizes that mean anything.

use std::path::Path;
use std::process::Command;

use elo_core::crew::Unwatched;
use elo_core::discover::{Run, discover};
use elo_core::report::report;
use elo_core::results;
use measurements::{Failure, PLUGINS, with_crew};

fn lines(program: &str, arguments: &[&str]) -> Vec<String> {
    let output = Command::new(program).args(arguments).output().expect("cargo built it");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).lines().map(str::to_owned).collect()
}

#[test]
fn learning_curves() {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../half-cheetah-quick.toml");
    let sizes = ["teacher.steps=4096", "teacher.snapshots=2", "teacher.d0_pool=2"];
    let arguments = [&[config, "4..5"], &sizes[..]].concat();
    let lines = lines(env!("CARGO_BIN_EXE_learning-curves"), &arguments);
    assert_eq!(lines[0], "engine,robot,seed,steps,mean_return,standard_deviation,mean_length,falls");
    let mut begins: Vec<&str> = lines[1..].iter().map(|line| &line[..26]).collect();
    begins.sort_unstable();
    let of = |seed, steps| format!("rapier,half-cheetah,{seed},{steps}");
    assert_eq!(begins, [of(4, "2048"), of(4, "4096"), of(5, "2048"), of(5, "4096")]);
}

#[test]
fn random_policy() {
    let lines = lines(env!("CARGO_BIN_EXE_random-policy"), &["rapier", "walker2d", "10"]);
    let value = |figure: &str| {
        let line = lines.iter().find_map(|line| line.strip_prefix(&format!("{figure},")));
        line.and_then(|value| value.parse::<f64>().ok()).unwrap_or_else(|| panic!("no {figure} in {lines:?}"))
    };
    // The robot stands for some steps and falls.
    assert_eq!((value("falls"), value("alive_after_5"), value("alive_after_200")), (1.0, 1.0, 0.0));
    assert!(value("mean_length") > 5.0 && value("alive_a_step") > 0.5, "{lines:?}");
}

/// A small run of the half-cheetah.
const RUN: &str = r#"seed = 1
[simulator]
kind = "rapier"
robot = "half-cheetah"

[tasks.electricity_cost]
low = -2.4
high = -1.4

[initial_states]
max_random_steps = 0

[report]
contexts = 2

[[metrics]]
kind = "maximum_mean"
"#;

/// One set of two closed-loop options.
const SET: &str = r#"
[option_learner]
kind = "interest"
steps = 400
rollout_steps = 200
context_pool = 2
hidden = [8]

[discover]
candidates = 1
contexts = 2
steps = 20
set_size = 2
"#;

/// Two teachers, and recordings that are too short to fall.
const TEACHERS: &str = r#"
[teacher]
kind = "ppo"
steps = 4096
d0_share = 0.0

[option_learner]
kind = "open_loop"

[discover]
teachers = 2
candidates = 2
contexts = 2
steps = 5
set_size = 1
"#;

fn finish_run(folder: &Path, learner: &str) -> Result<(), Failure> {
    let config = folder.join("experiment.toml");
    std::fs::write(&config, RUN.to_owned() + learner)?;
    let experiment = elo_cli::load::experiment(&config, &[], &PLUGINS)?;
    with_crew(&experiment, folder, &Unwatched, |crew| {
        let (run, discovery) = (Run::new(&experiment, crew)?, discover(&experiment, crew)?);
        Ok(results::write(&run, &discovery, &report(&run, &discovery)?, "{}")?)
    })
}

#[test]
fn specialisation() {
    let folder = tempfile::tempdir().expect("a folder for a run");
    finish_run(folder.path(), SET).expect("a small run");
    let path = folder.path().to_string_lossy();
    let lines = lines(env!("CARGO_BIN_EXE_specialisation"), &[&path]);
    assert_eq!(lines[0], "run,option,share,height,pitch,contacts,information,actions");
    let rows: Vec<Vec<f64>> = lines[1..]
        .iter()
        .map(|line| line.split(',').skip(1).map(|value| value.parse().expect("a number")).collect())
        .collect();
    let [first, second] = &rows[..] else { panic!("{lines:?}") };
    assert_eq!((first[0], second[0]), (0.0, 1.0));
    // Interests that have hardly learned are nearly 1, and options last for ten continuations, as they begin.
    assert!((first[1] + second[1] - 1.0).abs() < 1e-3 && (first[1] - 0.5).abs() < 0.1, "{rows:?}");
    assert!((0.0..0.05).contains(&first[5]) && (first[6] - 11.0).abs() < 2.0, "{rows:?}");
    // It has hardly left where it begins, and touches the floor at times.
    assert!(first[2].abs() < 0.3 && first[3].abs() < 0.5 && (0.01..1.0).contains(&first[4]), "{rows:?}");
}

#[test]
fn drift() {
    let folder = tempfile::tempdir().expect("a folder for a run");
    finish_run(folder.path(), TEACHERS).expect("a small run");
    let path = folder.path().to_string_lossy();
    let lines = lines(env!("CARGO_BIN_EXE_drift"), &[&path, "2", "behavior_cloning"]);
    assert_eq!(lines[0], "teacher,start,teacher_return,teacher_steps,clone_return,clone_steps,seen,met");
    let begins: Vec<String> =
        lines[1..].iter().map(|line| line.split(',').take(2).collect::<Vec<_>>().join(" ")).collect();
    assert_eq!(begins, ["0 own", "0 other", "1 own", "1 other"]);
    for line in &lines[1..] {
        let numbers: Vec<f64> =
            line.split(',').skip(2).map(|value| value.parse().expect("a number")).collect();
        let [_, taught, _, cloned, seen, met] = numbers[..] else { panic!("{line}") };
        assert!((taught, cloned) == (5.0, 5.0) && seen < 0.2 && met >= 0.0, "{line}");
    }
}
