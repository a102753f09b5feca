//! What a simulator refuses, and that it can be used afterwards.

use super::mistake::{Kind, MISTAKES};
use super::trace::{Episode, advance, begin, ending_episode, middle};
use super::{Case, Check, Finding};
use crate::conformance::compare::{granted, refused};
use crate::simulator::{Simulator, Start, State};
use crate::task::Task;

pub(super) const WRONG_LENGTHS_ARE_REFUSED: Check<Case> = Check {
    name: "wrong_lengths_are_refused",
    rule: "A buffer that is longer or shorter than the spec says is an error, and the next reset works.",
    run: |case| refuses(case, Kind::Length),
};

pub(super) const NONFINITE_ACTIONS_ARE_REFUSED: Check<Case> = Check {
    name: "nonfinite_actions_are_refused",
    rule: "NaN and infinity in any action component are errors, and the next reset works.",
    run: |case| refuses(case, Kind::Action),
};

pub(super) const UNKNOWN_TASK_PARAMETERS_ARE_REFUSED: Check<Case> = Check {
    name: "unknown_task_parameters_are_refused",
    rule: "A task that names a parameter which the spec does not declare is an error, and the next reset works.",
    run: |case| refuses(case, Kind::Unknown),
};

pub(super) const STEPS_NEED_A_RESET: Check<Case> = Check {
    name: "steps_need_a_reset",
    rule: "A step before the first reset is an error, and the reset after it works.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let action = middle(simulator.spec());
        refused("a step before the first reset", advance(simulator.as_mut(), &action))?;
        usable(simulator.as_mut())
    },
};

pub(super) const STEPS_AFTER_AN_END_ARE_REFUSED: Check<Case> = Check {
    name: "steps_after_an_end_are_refused",
    rule: "A step after the step that ended the episode is an error, and the reset after it works.",
    run: |case| {
        let (episode, trace) = ending_episode(case)?;
        let mut simulator = case.simulator()?;
        episode.play(simulator.as_mut())?;
        let action = middle(simulator.spec());
        refused("a step after the end", advance(simulator.as_mut(), &action))
            .map_err(|violation| violation.at(trace.moments.len()))?;
        usable(simulator.as_mut())
    },
};

pub(super) const AN_ERROR_ENDS_THE_EPISODE: Check<Case> = Check {
    name: "an_error_ends_the_episode",
    rule: "After an error a step is an error too, until a reset.",
    run: |case| {
        for mistake in MISTAKES {
            let mut simulator = case.simulator()?;
            let action = middle(simulator.spec());
            begin(simulator.as_mut(), &Task::default(), &Start::Seed(1))?;
            advance(simulator.as_mut(), &action)?;
            if (mistake.make)(simulator.as_mut()).is_err() {
                let next = advance(simulator.as_mut(), &action);
                refused(format!("a step after a {}", mistake.name), next)?;
            }
            usable(simulator.as_mut())?;
        }
        Ok(())
    },
};

pub(super) const TASK_VALUES_OUTSIDE_THEIR_RANGES_ARE_REFUSED: Check<Case> = Check {
    name: "task_values_outside_their_ranges_are_refused",
    rule: "A task parameter below its range, above it, or not finite is an error, and the next reset works.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let spec = simulator.spec().clone();
        if spec.task_parameters.is_empty() {
            return Err(Finding::Skipped("it has no task parameters".to_owned()));
        }
        for p in &spec.task_parameters {
            let beyond = 1.0 + (p.high - p.low).abs();
            for value in [p.low - beyond, p.high + beyond, f64::NAN, f64::INFINITY] {
                let task = Task::new([(p.name.as_str(), value)]);
                let reset = begin(simulator.as_mut(), &task, &Start::Seed(1));
                refused(format!("reset in a task with {} = {value}", p.name), reset)?;
                usable(simulator.as_mut())?;
            }
        }
        Ok(())
    },
};

pub(super) const STATES_NEED_A_RESET: Check<Case> = Check {
    name: "states_need_a_reset",
    rule: "Reading the state before the first reset is an error.",
    run: |case| {
        let simulator = case.settable()?;
        Ok(refused("the state before the first reset", simulator.state())?)
    },
};

pub(super) const MALFORMED_STATES_ARE_REFUSED: Check<Case> = Check {
    name: "malformed_states_are_refused",
    rule: "A state with too many or too few numbers, or with one that is not finite, is an error as a start.",
    run: |case| {
        let mut simulator = case.settable()?;
        let episode = Episode::random(simulator.spec(), 1, 4);
        episode.play(simulator.as_mut())?;
        let state = granted("state", simulator.state())?;
        for (what, bad) in malformed(&state) {
            let reset = begin(simulator.as_mut(), &Task::default(), &Start::State(bad));
            refused(format!("reset to a state with {what}"), reset)?;
            usable(simulator.as_mut())?;
        }
        Ok(())
    },
};

/// Every way to add, drop or spoil one number of `state`.
fn malformed(state: &State) -> Vec<(String, State)> {
    type Part = (&'static str, fn(&mut State) -> &mut Vec<f64>);
    let parts: [Part; 3] = [
        ("positions", |state| &mut state.positions),
        ("velocities", |state| &mut state.velocities),
        ("memory", |state| &mut state.memory),
    ];
    let mut found = Vec::new();
    let mut add = |what: String, change: &dyn Fn(&mut State)| {
        let mut bad = state.clone();
        change(&mut bad);
        found.push((what, bad));
    };
    for (name, part) in parts {
        add(format!("one number too many in {name}"), &|state| part(state).push(0.0));
        let length = part(&mut state.clone()).len();
        if length > 0 {
            add(format!("one number too few in {name}"), &|state| part(state).truncate(length - 1));
        }
        for i in 0..length {
            for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                add(format!("{value} as {name}[{i}]"), &|state| part(state)[i] = value);
            }
        }
    }
    found
}

fn refuses(case: &Case, kind: Kind) -> Result<(), Finding> {
    let mut simulator = case.simulator()?;
    for mistake in MISTAKES.iter().filter(|mistake| mistake.kind == kind) {
        begin(simulator.as_mut(), &Task::default(), &Start::Seed(1))?;
        refused(mistake.name, (mistake.make)(simulator.as_mut()))?;
        usable(simulator.as_mut())?;
    }
    Ok(())
}

/// Asks that an episode can begin.
fn usable(simulator: &mut dyn Simulator) -> Result<(), Finding> {
    let action = middle(simulator.spec());
    begin(simulator, &Task::default(), &Start::Seed(1)).map_err(|v| v.during("after an error"))?;
    advance(simulator, &action).map_err(|v| v.during("after an error"))?;
    Ok(())
}
