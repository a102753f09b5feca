//! MuJoCo behind our own binding and MuJoCo behind Python's take the same steps, bit for bit.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::process::Command;

use elo_backends::locomotion::robot::{AliveRule, NAMES, RobotDescription, built_in};
use elo_cli::hosts::Programs;
use elo_core::context::{Context, PreparedStart};
use elo_core::hosted::WorkerProgram;
use elo_core::policy::Unwatched;
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_core::task::Task;
use elo_core::units::evaluate::{Behavior, Evaluate, RolloutTable, Subject};
use elo_core::units::film::{Film, Filmed};
use elo_core::units::play::Play;
use elo_core::units::trace::{self, Trace, Traced};
use elo_core::units::{Work, prepare};
use elo_core::worker::WorkerProcess;
use elo_core::workers::Workers;
use elo_core::workforce::Hosts as _;
use elo_tests::{programs, skipped};
use serde_json::json;

const STEPS: usize = 1000;

/// Random torque for [`STEPS`] steps in every context.
struct Played {
    seen: Vec<trace::Seen>,
    table: RolloutTable,
    filmed: Filmed,
}

fn played(worker: &mut WorkerProcess, simulator: &serde_json::Value) -> Played {
    let slippery = Task::new([("floor_friction", 0.3), ("payload", 1.5)]);
    let context = |(seed, task)| Context { task, start: PreparedStart::standard(seed) };
    let contexts = [(1, Task::default()), (2, slippery), (3, Task::default())].map(context);
    let inputs = [prepare::encode(&contexts)];
    let play = || Play {
        simulator: serde_json::from_value(simulator.clone()).unwrap(),
        subjects: vec![Subject { name: "random".to_owned(), behavior: Behavior::RandomTorque }],
        horizon: Horizon { steps: STEPS, discount: 1.0, stop_at_fall: true },
        seed: Seed::root(5),
    };
    let mut done = |work: Work| {
        let job = serde_json::to_vec(&work).unwrap();
        worker.run(&job, &inputs, &mut Unwatched).unwrap()
    };
    let evaluate = || Evaluate { contexts: 1, play: play() };
    let Traced::Rollouts(seen) = Traced::decode(&done(Trace(play()).into())).unwrap() else {
        panic!("nothing was seen")
    };
    Played {
        seen,
        table: RolloutTable::decode(&done(evaluate().into())).unwrap(),
        filmed: Filmed::decode(&done(Film { rollouts: evaluate(), first: 2 }.into())).unwrap(),
    }
}

#[test]
fn mujoco_from_rust_and_from_python_is_bit_identical() {
    let test = "mujoco_from_rust_and_from_python_is_bit_identical";
    let _linked = elo_tests::PLUGINS;
    let Some(ours) = programs::mujoco(test) else { return };
    let python = programs::repository().join("target/python/bin/python");
    if !python.is_file() {
        return skipped(test, &format!("python: {} is missing; run tests/set-up", python.display()));
    }
    let workers = Workers { python: python.to_string_lossy().into_owned(), ..Workers::default() };
    let mut here = WorkerProcess::spawn(Command::new(ours), &elo_cli::build(), workers.limits()).unwrap();
    let mut there = Programs { workers }.start(&WorkerProgram::Interpreter("python")).unwrap();
    for name in NAMES {
        // A robot that cannot fall goes on for all steps.
        let own = RobotDescription { alive: AliveRule::default(), ..built_in(name).unwrap() };
        let here = played(&mut here, &json!({ "kind": "mujoco", "own_robot": own }));
        let there = played(&mut there, &json!({ "kind": "python_body", "own_robot": own }));
        assert_eq!(here.table, there.table, "{name}");
        assert!(here.table.rollouts.iter().all(|rollout| rollout.length as usize == STEPS), "{name}");
        let bits = |seen: &[trace::Seen]| seen.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&here.seen).len() % (3 * STEPS), 0, "{name}");
        assert!(bits(&here.seen) == bits(&there.seen), "{name}: what was seen differs");
        assert!(here.filmed == there.filmed, "{name}: films differ");
        let lengths: Vec<usize> = here.filmed.takes.iter().map(|take| take.steps.len()).collect();
        assert!(here.filmed.scene.is_some() && lengths == [STEPS + 1; 2], "{name}: {lengths:?}");
    }
}
