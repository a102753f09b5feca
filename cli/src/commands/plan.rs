//! `elo discover --plan`: what a run would take.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use elo_core::context::{Context, PreparedStart};
use elo_core::discover::duplicate;
use elo_core::experiment::Experiment;
use elo_core::hosted::Hosted;
use elo_core::policy::{TeacherConfig, Unwatched, Way};
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_core::task::Task;
use elo_core::units::evaluate::{Behavior, Evaluate, RolloutTable, Subject};
use elo_core::units::play::Play;
use elo_core::units::{Site, Work, prepare};
use elo_core::workforce::Hosts as _;

use crate::exit::Exit;
use crate::hosts::Programs;
use crate::progress::duration;

/// Simulator steps, disk and time of `experiment`, in words.
pub fn plan(experiment: &Experiment, workers: usize) -> Result<String, Exit> {
    let spec = experiment.simulator.spec().map_err(|error| Exit::BadInput(error.to_string()))?;
    let sizes = &experiment.discover;
    let prefix = u64::from(experiment.initial_states.max_random_steps) / 2;
    let (n, z, t) = (sizes.candidates as u64, sizes.contexts as u64, sizes.steps as u64);
    let metrics = experiment.metrics.len() as u64;
    let subsets = experiment.report.random_subsets as u64;
    let (subsets, corrected, practised) = match experiment.option_learner.way() {
        Way::Imitates(_) => (subsets, 0, 0),
        Way::Apprentices(learner) => (subsets, n * learner.corrections() * (prefix + t), 0),
        Way::Practises(learner) => (0, 0, n * (learner.simulator_steps() + learner.starts() * prefix)),
    };
    let recorded: u64 = experiment.recordings().iter().map(|span| span.count as u64).sum();
    let teachers = if experiment.records() { sizes.teachers as u64 } else { 0 };
    let training = |teacher: &dyn TeacherConfig| teacher.simulator_steps() + teacher.starts() * prefix;
    let training = experiment.teacher.as_deref().map_or(0, training);
    let measured = (metrics + subsets) * experiment.candidates_of_a_set() as u64;
    let report_rows = measured.min(n) + 3 + teachers;
    let report_contexts = experiment.report.contexts as u64;
    let selection_rollouts = experiment.selector.rollouts(n, z);
    let stages = [
        ("teachers", teachers * training),
        ("recordings", recorded * (prefix + t)),
        ("options", corrected),
        ("option sets", practised),
        ("contexts", (z + report_contexts) * prefix),
        ("selection rollouts", selection_rollouts * t),
        ("report rollouts", report_rows * report_contexts * t),
    ];
    let rollouts = selection_rollouts + report_rows * report_contexts;
    let terms = spec.reward_terms.len() as u64;
    let recorded = recorded * t * (spec.observation_size + spec.action_size()) as u64 * 4;
    let tables = rollouts * (8 * terms + 9) * 2;
    let trained = (teachers + if practised > 0 { n } else { 0 }) * (8 << 20);

    let mut text = format!("{}, {} workers\n", spec.robot, workers);
    let step = seconds_per_step(experiment);
    for (stage, steps) in stages.into_iter().filter(|(_, steps)| *steps > 0) {
        let _ = write!(text, "{stage:<20} {:>16} simulator steps", grouped(steps));
        if let Ok(step) = &step {
            let time = Duration::from_secs_f64(steps as f64 * step / workers as f64);
            let _ = write!(text, ", {:>8}", duration(time));
        }
        text.push('\n');
    }
    let total: u64 = stages.iter().map(|(_, steps)| steps).sum();
    let _ = writeln!(text, "{:<20} {:>16} simulator steps", "all", grouped(total));
    let _ = writeln!(text, "{:<20} {:>16} MiB at most", "disk", grouped((recorded + tables + trained) >> 20));
    let _ = writeln!(text, "{:<20} {:>16} MiB at most", "memory", grouped((rollouts * 120 + trained) >> 20));
    match step {
        Ok(step) => {
            let time = Duration::from_secs_f64(total as f64 * step / workers as f64);
            let _ = writeln!(text, "{:<20} {:>16}", "time", format!("about {}", duration(time)));
            text.push_str(
                "The time is that of the simulator alone, measured just now with random actions. Learning itself comes on top,\n\
                 and so do starts and recordings that fall and are taken again; rollouts that fall are shorter than counted.\n\
                 What is done already is not taken off.\n",
            );
        }
        Err(why) => {
            let _ = writeln!(text, "No time was measured: {why}");
        }
    }
    Ok(text)
}

/// Seconds of one control step, from about a third of a second of random actions where the run would take them: in this
/// program or in the engine's worker. Or why it could not be measured.
fn seconds_per_step(experiment: &Experiment) -> Result<f64, String> {
    let start = |seed| Context { task: Task::default(), start: PreparedStart::standard(seed) };
    let play = Play {
        simulator: duplicate(&experiment.simulator),
        subjects: vec![Subject { name: "plan".to_owned(), behavior: Behavior::RandomTorque }],
        horizon: Horizon { steps: 200, discount: 1.0, stop_at_fall: true },
        seed: Seed::root(0),
    };
    let work = Work::from(Evaluate { contexts: 1, play });
    let inputs = [prepare::encode(&(0..10).map(start).collect::<Vec<_>>())];
    let mut here = Site::new(Vec::new());
    let mut worker = match experiment.simulator.hosted().map(Hosted::worker) {
        Some(program) => Some(Programs::of(experiment).start(&program).map_err(|fault| fault.to_string())?),
        None => None,
    };
    let job = serde_json::to_vec(&work).expect("descriptions are plain data");
    let mut steps = || -> Result<u64, String> {
        let bytes = match &mut worker {
            Some(worker) => worker.run(&job, &inputs, &mut Unwatched).map_err(|fault| fault.to_string())?,
            None => work.perform(&inputs, &mut here, &mut Unwatched).map_err(|error| error.to_string())?,
        };
        let table = RolloutTable::decode(&bytes).map_err(|error| error.to_string())?;
        Ok(table.rollouts.iter().map(|rollout| u64::from(rollout.length)).sum())
    };
    // The first time builds the simulator.
    steps()?;
    let (begun, mut taken) = (Instant::now(), 0);
    while begun.elapsed() < Duration::from_millis(300) {
        taken += steps()?.max(1);
    }
    Ok(begun.elapsed().as_secs_f64() / taken as f64)
}

/// A number with its thousands apart.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().filter_map(|g| std::str::from_utf8(g).ok()).collect();
    groups.join(" ")
}
