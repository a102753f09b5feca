//! The numbers that a simulator writes, and what writing them costs.

use super::task::{extremes, varied};
use super::trace::{Episode, Moment, Trace, middle};
use super::{Case, Check, Finding, Violation};
use crate::conformance::compare::{finite, granted};
use crate::rollout::price;
use crate::simulator::{End, Simulator};
use crate::spec::SimulatorSpec;
use crate::task::Task;

pub(super) const NUMBERS_ARE_FINITE: Check<Case> = Check {
    name: "numbers_are_finite",
    rule: "Observations and reward terms are finite, for random and for extreme actions.",
    run: |case| {
        let mut simulator = case.simulator()?;
        for episode in exercises(simulator.spec(), case.steps * 3) {
            let trace = episode.play(simulator.as_mut())?;
            finite("first observation", &trace.first)?;
            for (step, moment) in trace.moments.iter().enumerate() {
                finite("observation", &moment.observation).map_err(|v| v.at(step))?;
                finite("reward terms", &moment.terms).map_err(|v| v.at(step))?;
            }
        }
        Ok(())
    },
};

pub(super) const BUFFERS_ARE_FILLED: Check<Case> = Check {
    name: "buffers_are_filled",
    rule: "Every number of a buffer is written, and none depends on what was there before.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let episode = Episode::random(simulator.spec(), 1, case.steps);
        let expected = episode.play(simulator.as_mut())?;
        for litter in [7.5, f32::NAN] {
            expected.same(&play_into(&episode, simulator.as_mut(), litter)?)?;
        }
        Ok(())
    },
};

pub(super) const REWARDS_STAY_ABOVE_THE_FLOOR: Check<Case> = Check {
    name: "rewards_stay_above_the_floor",
    rule: "No step within the action bounds is paid less than the spec's floor, in any task tried.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let spec = simulator.spec().clone();
        for task in std::iter::once(Task::default()).chain(extremes(&spec)).chain([varied(&spec)]) {
            let prices = spec.prices(&task);
            for episode in exercises(&spec, case.steps) {
                let trace = episode.in_task(task.clone()).play(simulator.as_mut())?;
                for (step, moment) in trace.moments.iter().enumerate() {
                    let reward = price(&moment.terms, &prices);
                    if reward < spec.reward_floor {
                        let expected = format!("at least {}", spec.reward_floor);
                        let low = Violation::new(format!("reward in task {task:?}"), expected, reward);
                        return Err(low.at(step).into());
                    }
                }
            }
        }
        Ok(())
    },
};

pub(super) const STEPS_ALLOCATE_NOTHING: Check<Case> = Check {
    name: "steps_allocate_nothing",
    rule: "Once an episode has been played, the steps of playing it again allocate no memory.",
    run: |case| {
        let Some(allocations) = case.allocations else {
            return Err(Finding::Skipped("no allocator counts".to_owned()));
        };
        let mut simulator = case.simulator()?;
        let episode = Episode::random(simulator.spec(), 1, case.steps);
        episode.play(simulator.as_mut())?;
        let mut observation = vec![0.0; simulator.spec().observation_size];
        let mut terms = vec![0.0; simulator.spec().reward_terms.len()];
        granted("reset", simulator.reset(&episode.task, &episode.start, &mut observation))?;
        for (step, action) in episode.actions.iter().enumerate() {
            let before = allocations();
            let end = simulator.step(action, &mut observation, &mut terms);
            let made = allocations() - before;
            if made > 0 {
                return Err(Violation::new("allocations", 0, made).at(step).into());
            }
            if granted("step", end)? != End::Running {
                break;
            }
        }
        Ok(())
    },
};

/// Random actions from two starts, then each bound held, then both in turn.
fn exercises(spec: &SimulatorSpec, steps: usize) -> Vec<Episode> {
    let random = |seed| Episode::random(spec, seed, steps);
    let pattern = |actions: [&[f32]; 2]| Episode {
        actions: (0..steps).map(|i| actions[(i / 4) % 2].to_vec()).collect(),
        ..random(3)
    };
    let (low, high) = (&spec.action_low, &spec.action_high);
    vec![
        random(1),
        random(2),
        pattern([low, low]),
        pattern([high, high]),
        pattern([low, high]),
        pattern([&middle(spec), &middle(spec)]),
    ]
}

/// [`Episode::play`] with every buffer full of `litter` when it is handed over.
fn play_into(episode: &Episode, simulator: &mut dyn Simulator, litter: f32) -> Result<Trace, Violation> {
    let size = simulator.spec().observation_size;
    let mut first = vec![litter; size];
    granted("reset", simulator.reset(&episode.task, &episode.start, &mut first))?;
    let mut moments = Vec::new();
    for (step, action) in episode.actions.iter().enumerate() {
        let mut observation = vec![litter; size];
        let mut terms = vec![f64::from(litter); simulator.spec().reward_terms.len()];
        let end = granted("step", simulator.step(action, &mut observation, &mut terms));
        let end = end.map_err(|violation| violation.at(step))?;
        moments.push(Moment { observation, terms, end });
        if end != End::Running {
            break;
        }
    }
    Ok(Trace { first, moments })
}
