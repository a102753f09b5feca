//! What a task's parameters do, and what they do not.

use super::trace::Episode;
use super::{Case, Check, Finding, Violation};
use crate::spec::{Effect, SimulatorSpec, TaskParameter};
use crate::task::Task;

pub(super) const REWARD_PARAMETERS_DO_NOT_MOVE_ANYTHING: Check<Case> = Check {
    name: "reward_parameters_do_not_move_anything",
    rule: "Parameters that only price change no bit of observations, ends and (unpriced) reward terms.",
    run: |case| {
        let (default, parameters) = of_effect(case, Effect::Reward)?;
        for p in &parameters {
            let expected = default.play(case.simulator()?.as_mut())?;
            for value in [p.low, p.high] {
                let episode = default.clone().in_task(Task::new([(p.name.as_str(), value)]));
                let trace = episode.play(case.simulator()?.as_mut())?;
                expected.same(&trace).map_err(|v| v.during(format!("with {} = {value}", p.name)))?;
            }
        }
        Ok(())
    },
};

pub(super) const DYNAMICS_PARAMETERS_CHANGE_SOMETHING: Check<Case> = Check {
    name: "dynamics_parameters_change_something",
    rule: "Parameters that change the motion make a difference between the two ends of their range, after the standard \
           reset and, where states can be set, after a start from a state.",
    run: |case| {
        let (default, parameters) = of_effect(case, Effect::Dynamics)?;
        let mut simulator = case.simulator()?;
        let mut starts = vec![default.start.clone()];
        if simulator.spec().capabilities.settable_state {
            Episode { actions: Vec::new(), ..default.clone() }.play(simulator.as_mut())?;
            let state = simulator.state().map_err(|error| Violation::new("state", "success", error))?;
            starts.push(crate::simulator::Start::State(state));
        }
        for p in parameters.iter().filter(|p| p.low < p.high) {
            for start in &starts {
                let play = |value| {
                    let task = Task::new([(p.name.as_str(), value)]);
                    let episode = Episode { start: start.clone(), task, ..default.clone() };
                    Ok::<_, Finding>(episode.play(case.simulator()?.as_mut())?)
                };
                if play(p.low)?.same(&play(p.high)?).is_ok() {
                    let what = format!("an episode with {} = {} against {}", p.name, p.low, p.high);
                    return Err(Violation::new(what, "some difference", "none").into());
                }
            }
        }
        Ok(())
    },
};

pub(super) const DEFAULTS_ARE_THOSE_OF_THE_SPEC: Check<Case> = Check {
    name: "defaults_are_those_of_the_spec",
    rule: "A task that spells out every default is, bit for bit, the task that mentions none.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let spec = simulator.spec().clone();
        let spelt = Task::new(spec.task_parameters.iter().map(|p| (p.name.as_str(), p.default)));
        let episode = Episode::random(&spec, 1, case.steps);
        let expected = episode.play(simulator.as_mut())?;
        Ok(expected.same(&episode.in_task(spelt).play(simulator.as_mut())?)?)
    },
};

/// One task for each end of each parameter's range.
pub(super) fn extremes(spec: &SimulatorSpec) -> impl Iterator<Item = Task> + '_ {
    spec.task_parameters
        .iter()
        .flat_map(|p| [p.low, p.high].map(|value| Task::new([(p.name.as_str(), value)])))
}

/// The task whose parameters all lie halfway between default and upper end.
pub(super) fn varied(spec: &SimulatorSpec) -> Task {
    Task::new(spec.task_parameters.iter().map(|p| (p.name.as_str(), p.default / 2.0 + p.high / 2.0)))
}

/// An episode of the default task and the parameters with this effect; a reason to skip when there are none.
fn of_effect(case: &Case, effect: Effect) -> Result<(Episode, Vec<TaskParameter>), Finding> {
    let simulator = case.simulator()?;
    let spec = simulator.spec();
    let parameters: Vec<_> = spec.task_parameters.iter().filter(|p| p.effect == effect).cloned().collect();
    if parameters.is_empty() {
        return Err(Finding::Skipped(format!("no task parameter acts on {effect:?}")));
    }
    Ok((Episode::random(spec, 1, case.steps), parameters))
}
