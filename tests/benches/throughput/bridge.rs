//! An environment in Python through two workers, beside the same environment, actions and resets in a bare Python loop in two
//! processes.

use std::error::Error;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use elo_cli::hosts::Programs;
use elo_core::discover::CONTEXTS_PER_UNIT;
use elo_core::hosted::WorkerProgram;
use elo_core::policy;
use elo_core::simulator::SimulatorConfig;
use elo_core::units::Work;
use elo_core::units::describe::Describe;
use elo_core::workers::Workers;
use elo_core::workforce::Hosts as _;
use serde_json::json;

use crate::median;
use crate::processor_time::load_average;
use crate::robots::STEPS;
use crate::workers::Bout;

/// Robots, and how many units a round has of each: one that falls early has short ones.
const ROBOTS: [(&str, usize); 3] = [("ant", 8), ("half-cheetah", 128), ("walker2d", 128)];
const CONTEXTS: usize = CONTEXTS_PER_UNIT;
const ROUNDS: usize = 9;
const PROCESSES: usize = 2;

/// Prints a line for every robot.
pub fn run() -> Result<(), Box<dyn Error>> {
    println!(
        "  medians of {ROUNDS} alternating rounds of units of {CONTEXTS} rollouts, least and greatest ratio; aim: at least 0.9"
    );
    println!("  environment                       units   bare, steps/s   elo, steps/s   elo/bare");
    if !python().is_file() {
        println!("  left out: `tests/set-up` makes {}", python().display());
        return Ok(());
    }
    for (robot, candidates) in ROBOTS {
        let bout = Bout { simulator: described(robot)?, candidates, contexts: CONTEXTS };
        let (mut bare, mut ours, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..ROUNDS {
            bare.push(bare_rate(robot, &bout)?);
            let evaluated = bout.evaluate(&programs(), PROCESSES)?;
            let rate = evaluated.steps as f64 / evaluated.seconds;
            ratios.push(rate / bare[bare.len() - 1]);
            ours.push(rate);
        }
        let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = ratios.iter().copied().fold(0.0, f64::max);
        let (bare, ours, ratio) = (median(bare), median(ours), median(ratios));
        println!(
            "  roboschool_bullet, {robot:<13} {candidates:6}   {bare:13.0}   {ours:12.0}   {ratio:8.3} ({least:.2} to {greatest:.2})"
        );
    }
    println!("  load average after: {}", load_average());
    Ok(())
}

fn repository() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

fn python() -> PathBuf {
    repository().join("target/python/bin/python")
}

/// Where the environment lies.
fn examples() -> PathBuf {
    repository().join("examples/python")
}

/// Workers as `elo` starts them.
fn programs() -> Programs {
    let text = |path: PathBuf| path.to_string_lossy().into_owned();
    let python_path = vec![text(examples())];
    Programs { workers: Workers { python: text(python()), python_path, ..Workers::default() } }
}

fn described(robot: &str) -> Result<Box<dyn SimulatorConfig>, Box<dyn Error>> {
    let table = json!({
        "kind": "python", "target": "roboschool_bullet:RoboschoolBullet", "kwargs": { "robot": robot }, "state": {},
    });
    let read = || serde_json::from_value::<Box<dyn SimulatorConfig>>(table.clone());
    let job = serde_json::to_vec(&Work::from(Describe::Simulator(read()?)))?;
    let mut worker = programs().start(&WorkerProgram::Interpreter("python"))?;
    let description = worker.run(&job, &[], &mut policy::Unwatched)?;
    let mut simulator = read()?;
    let hosted = simulator.hosted_mut().ok_or("it runs in a worker")?;
    hosted.accept_description(&description)?;
    Ok(simulator)
}

/// Steps a second of the bare loops together: the same actions from the same resets, every second candidate each.
fn bare_rate(robot: &str, bout: &Bout) -> Result<f64, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let start = |first: usize| -> Result<(Child, BufReader<ChildStdout>), Box<dyn Error>> {
        let mut actions = Vec::new();
        for item in (first..bout.candidates).step_by(PROCESSES) {
            actions.extend(bout.actions(item)?.iter().flat_map(|a| a.to_le_bytes()));
        }
        let file = folder.path().join(first.to_string());
        std::fs::write(&file, actions)?;
        let mut command = Command::new(python());
        command.env("PYTHONPATH", examples());
        command.arg(repository().join("tests/benches/throughput/bridge.py")).arg(robot).arg(file);
        command.args([STEPS, CONTEXTS].map(|size| size.to_string()));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn()?;
        let mut output = BufReader::new(child.stdout.take().ok_or("its output is a pipe")?);
        output.read_line(&mut String::new())?;
        Ok((child, output))
    };
    let mut loops = (0..PROCESSES).map(start).collect::<Result<Vec<_>, _>>()?;
    for (child, _) in &mut loops {
        child.stdin.take().ok_or("its input is a pipe")?.write_all(b"go\n")?;
    }
    let (mut steps, mut seconds) = (0.0, 0.0_f64);
    for (mut child, mut output) in loops {
        let mut line = String::new();
        output.read_line(&mut line)?;
        child.wait()?;
        let (taken, elapsed) = line.trim().split_once(' ').ok_or("the bare loop failed")?;
        steps += taken.parse::<f64>()?;
        seconds = seconds.max(elapsed.parse()?);
    }
    Ok(steps / seconds)
}
