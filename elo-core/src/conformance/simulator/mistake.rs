//! Calls that every simulator refuses, made on one that is in the middle of an episode.

use super::trace::middle;
use crate::simulator::{Simulator, SimulatorError, Start};
use crate::task::Task;

/// One wrong call.
pub(super) struct Mistake {
    /// What is wrong with it.
    pub name: &'static str,
    /// Which call it is.
    pub kind: Kind,
    /// Makes it; where there are several ways, the first that is accepted.
    pub make: fn(&mut dyn Simulator) -> Result<(), SimulatorError>,
}

/// What a wrong call is wrong about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A buffer has another length than the spec says.
    Length,
    /// An action is not finite.
    Action,
    /// A task has a parameter that the spec does not declare.
    Unknown,
}

/// How long the buffers of a step are.
#[derive(Clone, Copy)]
struct Lengths {
    action: usize,
    observation: usize,
    terms: usize,
}

pub(super) const MISTAKES: &[Mistake] = &[
    Mistake {
        name: "reset with an observation of the wrong length",
        kind: Kind::Length,
        make: |simulator| {
            let size = simulator.spec().observation_size;
            first_accepted([size + 1, size.saturating_sub(1)], |length| {
                simulator.reset(&Task::default(), &Start::Seed(1), &mut vec![0.0; length])
            })
        },
    },
    Mistake {
        name: "step with an action of the wrong length",
        kind: Kind::Length,
        make: |simulator| {
            let right = lengths(simulator);
            first_accepted([right.action + 1, right.action.saturating_sub(1)], |action| {
                step(simulator, Lengths { action, ..right })
            })
        },
    },
    Mistake {
        name: "step with an observation of the wrong length",
        kind: Kind::Length,
        make: |simulator| {
            let right = lengths(simulator);
            first_accepted([right.observation + 1, right.observation.saturating_sub(1)], |observation| {
                step(simulator, Lengths { observation, ..right })
            })
        },
    },
    Mistake {
        name: "step with reward terms of the wrong length",
        kind: Kind::Length,
        make: |simulator| {
            let right = lengths(simulator);
            first_accepted([right.terms + 1, right.terms.saturating_sub(1)], |terms| {
                step(simulator, Lengths { terms, ..right })
            })
        },
    },
    Mistake {
        name: "step with a NaN in the action",
        kind: Kind::Action,
        make: |simulator| step_with(simulator, f32::NAN),
    },
    Mistake {
        name: "step with an infinity in the action",
        kind: Kind::Action,
        make: |simulator| step_with(simulator, f32::INFINITY),
    },
    Mistake {
        name: "step with a negative infinity in the action",
        kind: Kind::Action,
        make: |simulator| step_with(simulator, f32::NEG_INFINITY),
    },
    Mistake {
        name: "reset in a task with an unknown parameter",
        kind: Kind::Unknown,
        make: |simulator| {
            let size = simulator.spec().observation_size;
            let task = Task::new([("no parameter has this name", 1.0)]);
            simulator.reset(&task, &Start::Seed(1), &mut vec![0.0; size])
        },
    },
];

/// Tries each of `ways`; success is the first that is accepted.
fn first_accepted<T>(
    ways: impl IntoIterator<Item = T>,
    mut attempt: impl FnMut(T) -> Result<(), SimulatorError>,
) -> Result<(), SimulatorError> {
    let mut last = Err(SimulatorError::Unsupported("there is no way to make this mistake"));
    for way in ways {
        last = attempt(way);
        if last.is_ok() {
            break;
        }
    }
    last
}

fn lengths(simulator: &dyn Simulator) -> Lengths {
    let spec = simulator.spec();
    Lengths { action: spec.action_size(), observation: spec.observation_size, terms: spec.reward_terms.len() }
}

fn step(simulator: &mut dyn Simulator, lengths: Lengths) -> Result<(), SimulatorError> {
    let mut action = middle(simulator.spec());
    action.resize(lengths.action, 0.0);
    let (mut observation, mut terms) = (vec![0.0; lengths.observation], vec![0.0; lengths.terms]);
    simulator.step(&action, &mut observation, &mut terms).map(|_| ())
}

fn step_with(simulator: &mut dyn Simulator, bad: f32) -> Result<(), SimulatorError> {
    let right = lengths(simulator);
    let (mut observation, mut terms) = (vec![0.0; right.observation], vec![0.0; right.terms]);
    first_accepted(0..right.action, |component| {
        let mut action = middle(simulator.spec());
        action[component] = bad;
        simulator.step(&action, &mut observation, &mut terms).map(|_| ())
    })
}
