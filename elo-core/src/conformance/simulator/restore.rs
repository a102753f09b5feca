//! A state is everything that observation and reward depend on.

use super::trace::{Episode, Trace, advance, begin, ending_episode, middle};
use super::{Case, Check, Finding, Violation};
use crate::conformance::compare::{finite, granted, near};
use crate::simulator::{End, Simulator, Start, State};

pub(super) const RESTORE_RESUMES: Check<Case> = Check {
    name: "restore_resumes",
    rule: "Starting from a state gives the observation, and one step later the observation and reward terms, of the \
           run it was read in, within the tolerance.",
    run: |case| {
        let mut simulator = case.settable()?;
        for seed in 0..3 {
            let episode = Episode::random(simulator.spec(), seed, case.steps);
            let (trace, states) = episode.states(simulator.as_mut())?;
            for step in points(&trace) {
                resume(case, simulator.as_mut(), &episode, (&trace, &states[step], step))?;
            }
        }
        Ok(())
    },
};

pub(super) const STATES_MOVE_BETWEEN_OBJECTS: Check<Case> = Check {
    name: "states_move_between_objects",
    rule: "A state read in one object starts another, fresh or used, as it does the first, within the tolerance.",
    run: |case| {
        let mut simulator = case.settable()?;
        let episode = Episode::random(simulator.spec(), 1, case.steps);
        let (trace, states) = episode.states(simulator.as_mut())?;
        let mut used = case.settable()?;
        Episode::random(used.spec(), 2, case.steps).play(used.as_mut())?;
        for step in points(&trace) {
            for other in [&mut case.settable()?, &mut used] {
                resume(case, other.as_mut(), &episode, (&trace, &states[step], step))?;
            }
        }
        Ok(())
    },
};

pub(super) const STATES_COME_BACK_AS_THEY_WERE: Check<Case> = Check {
    name: "states_come_back_as_they_were",
    rule: "A state that was set is what is read: the same numbers within the tolerance, the same elapsed steps.",
    run: |case| {
        let mut simulator = case.settable()?;
        let episode = Episode::random(simulator.spec(), 1, case.steps);
        let (trace, states) = episode.states(simulator.as_mut())?;
        for step in points(&trace) {
            begin(simulator.as_mut(), &episode.task, &Start::State(states[step].clone()))?;
            let back = granted("state", simulator.state())?;
            same_state(&states[step], &back, case.tolerance.start).map_err(|v| v.at(step))?;
        }
        Ok(())
    },
};

pub(super) const READING_THE_STATE_DISTURBS_NOTHING: Check<Case> = Check {
    name: "reading_the_state_disturbs_nothing",
    rule: "An episode whose state is read before each step is the same, bit for bit, as one left alone.",
    run: |case| {
        let mut simulator = case.settable()?;
        let episode = Episode::random(simulator.spec(), 1, case.steps);
        let expected = episode.play(simulator.as_mut())?;
        let (watched, _) = episode.states(simulator.as_mut())?;
        Ok(expected.same(&watched)?)
    },
};

pub(super) const ENDS_COME_AGAIN: Check<Case> = Check {
    name: "ends_come_again",
    rule: "From a state before an end the same actions lead to the same kind of end: a fall stays a fall.",
    run: |case| {
        let mut simulator = case.settable()?;
        let (episode, trace) = ending_episode(case)?;
        let (_, states) = episode.states(simulator.as_mut())?;
        let last = trace.moments.len() - 1;
        let end = trace.moments[last].end;
        for back in 0..last.min(3) {
            let step = last - back;
            begin(simulator.as_mut(), &episode.task, &Start::State(states[step].clone()))?;
            // An engine with a tolerance may need a step or two more than the run itself.
            let held = std::iter::repeat_n(&episode.actions[last], 3);
            let mut came = End::Running;
            for action in episode.actions[step..].iter().chain(held) {
                came = advance(simulator.as_mut(), action)?.end;
                if came != End::Running {
                    break;
                }
            }
            if came != end {
                let differ = Violation::new("end", format!("{end:?}"), format!("{came:?}"));
                return Err(differ.at(step).into());
            }
        }
        Ok(())
    },
};

pub(super) const FALLEN_STATES_CAN_BE_TAKEN_UP: Check<Case> = Check {
    name: "fallen_states_can_be_taken_up",
    rule: "After an end the state can be read, and an episode begun from it shows that end's observation and steps on.",
    run: |case| {
        let mut simulator = case.settable()?;
        let (episode, trace) = ending_episode(case)?;
        episode.play(simulator.as_mut())?;
        let steps = trace.moments.len();
        let fallen = granted("the state after an end", simulator.state()).map_err(|v| v.at(steps))?;
        let first = begin(simulator.as_mut(), &episode.task, &Start::State(fallen))
            .map_err(|v| v.during("from a fallen state").at(steps))?;
        let seen = &trace.moments[steps - 1].observation;
        near("observation", seen, &first, case.tolerance.start).map_err(|v| v.at(steps))?;
        let action = middle(simulator.spec());
        let next = advance(simulator.as_mut(), &action).map_err(|v| v.during("from a fallen state"))?;
        finite("observation after a fallen state", &next.observation)?;
        finite("reward terms after a fallen state", &next.terms)?;
        Ok(())
    },
};

pub(super) const TIME_ALONE_IS_NO_FALL: Check<Case> = Check {
    name: "time_alone_is_no_fall",
    rule: "A state from which a step goes on does not terminate by that step because more steps have elapsed: time \
           limits are the caller's, and one of the environment's own truncates.",
    run: |case| {
        let mut simulator = case.settable()?;
        let episode = Episode::random(simulator.spec(), 1, case.steps);
        let (trace, states) = episode.states(simulator.as_mut())?;
        for step in points(&trace) {
            let late = State { elapsed: 1 << 40, ..states[step].clone() };
            begin(simulator.as_mut(), &episode.task, &Start::State(late))?;
            let end = advance(simulator.as_mut(), &episode.actions[step])?.end;
            if end == End::Terminated && trace.moments[step].end != End::Terminated {
                let (expected, elapsed) = (format!("{:?}", trace.moments[step].end), 1_u64 << 40);
                let differ =
                    Violation::new(format!("end with {elapsed} steps elapsed"), expected, "Terminated");
                return Err(differ.at(step).into());
            }
        }
        Ok(())
    },
};

/// Steps of a trace from which to resume: the first, the last and about eight between.
pub(super) fn points(trace: &Trace) -> impl Iterator<Item = usize> + use<> {
    let length = trace.moments.len();
    (0..length).step_by((length / 8).max(1)).chain(length.checked_sub(1))
}

/// Starts `simulator` from the state before `step` and compares with what the run gave there.
fn resume(
    case: &Case,
    simulator: &mut dyn Simulator,
    episode: &Episode,
    (trace, state, step): (&Trace, &State, usize),
) -> Result<(), Finding> {
    let seen = if step == 0 { &trace.first } else { &trace.moments[step - 1].observation };
    let first = begin(simulator, &episode.task, &Start::State(state.clone())).map_err(|v| v.at(step))?;
    near("observation at the state", seen, &first, case.tolerance.start).map_err(|v| v.at(step))?;
    let next = advance(simulator, &episode.actions[step]).map_err(|v| v.at(step))?;
    let expected = &trace.moments[step];
    near("observation after the state", &expected.observation, &next.observation, case.tolerance.step)
        .map_err(|v| v.at(step))?;
    near("reward terms after the state", &expected.terms, &next.terms, case.tolerance.step)
        .map_err(|v| v.at(step))?;
    Ok(())
}

fn same_state(expected: &State, got: &State, tolerance: f64) -> Result<(), Violation> {
    near("positions", &expected.positions, &got.positions, tolerance)?;
    near("velocities", &expected.velocities, &got.velocities, tolerance)?;
    near("memory", &expected.memory, &got.memory, tolerance)?;
    if expected.elapsed == got.elapsed {
        Ok(())
    } else {
        Err(Violation::new("elapsed steps", expected.elapsed, got.elapsed))
    }
}
