//! The suite of every [`TeacherConfig`] and the [`crate::policy::TeacherPolicy`] that it trains.

#[cfg(test)]
mod liars;
mod policy;
mod training;

use std::fmt;
use std::sync::OnceLock;

use super::check::{Check, Report, Violation};
use super::compare::granted;
use super::config::{faultless, round_trip};
use super::interruptible::{Interruptible, Stopwatch, Watched};
use crate::context::InitialStates;
use crate::policy::{CurvePoint, Lesson, Monitor, TeacherConfig, TrainError, Trained};
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;
use crate::task::Task;

/// Every rule, in the order in which they are tried.
pub const CHECKS: &[Check<Case>] = &[
    CONFIG_IS_VALID,
    CONFIG_SURVIVES_FILES,
    training::TRAINING_REPEATS,
    training::THREADS_CHANGE_NOTHING,
    training::STOPS_ARE_OBEYED,
    training::TRAINING_RESUMES_WITH_THE_SAME_BYTES,
    training::DAMAGED_CHECKPOINTS_CHANGE_NOTHING,
    training::SNAPSHOTS_LEAD_TO_THE_POLICY,
    training::CURVES_GO_FORWARD,
    training::PROGRESS_IS_HONEST,
    policy::UNTRAINED_POLICIES_REPEAT_AND_LOAD,
    policy::ACTING_IS_PURE,
    policy::ACTIONS_ARE_FILLED,
    policy::ACTIONS_ARE_FINITE,
    policy::MISSING_TENSORS_ARE_REFUSED,
    policy::MISSHAPEN_TENSORS_ARE_REFUSED,
    policy::NONFINITE_TENSORS_ARE_REFUSED,
    policy::OTHER_ROBOTS_ARE_REFUSED,
];

/// Tries every rule on `case`. Costs about nine trainings.
pub fn run(case: &Case) -> Report {
    Report::of(format!("{:?}", case.teacher), CHECKS, case)
}

/// A way of training to be tried.
pub struct Case {
    teacher: Box<dyn TeacherConfig>,
    simulator: Box<dyn SimulatorConfig>,
    task: Task,
    initial_states: InitialStates,
    watched: OnceLock<Result<Watched<Trained>, TrainError>>,
}

impl Case {
    /// `teacher` on the default task of `simulator`, starting after up to ten random steps. Its settings should train
    /// in about a second and write a few checkpoints on the way.
    pub fn new(teacher: Box<dyn TeacherConfig>, simulator: Box<dyn SimulatorConfig>) -> Self {
        let initial_states = InitialStates { max_random_steps: 10, ..InitialStates::default() };
        Self { teacher, simulator, task: Task::default(), initial_states, watched: OnceLock::new() }
    }

    fn train(&self, teacher: &dyn TeacherConfig, monitor: &mut dyn Monitor) -> Result<Trained, TrainError> {
        let lesson = Lesson {
            simulator: self.simulator.as_ref(),
            task: &self.task,
            initial_states: &self.initial_states,
            seed: Seed::root(1),
        };
        teacher.train(&lesson, monitor)
    }
}

impl Interruptible for Case {
    type Outcome = Trained;

    fn run(&self, monitor: &mut dyn Monitor) -> Result<Trained, TrainError> {
        self.train(self.teacher.as_ref(), monitor)
    }

    fn kept(&self) -> &OnceLock<Result<Watched<Trained>, TrainError>> {
        &self.watched
    }

    fn same(expected: &Trained, got: &Trained) -> Result<(), Violation> {
        same_training(expected, got)
    }
}

impl fmt::Debug for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Case")
            .field("teacher", &self.teacher)
            .field("simulator", &self.simulator)
            .finish_non_exhaustive()
    }
}

const CONFIG_IS_VALID: Check<Case> = Check {
    name: "config_is_valid",
    rule: "The config finds no fault in itself.",
    run: |case| Ok(faultless(|faults| case.teacher.validate(faults))?),
};

const CONFIG_SURVIVES_FILES: Check<Case> = Check {
    name: "config_survives_files",
    rule: "Written as JSON or TOML and read back, the config trains the same teacher, bit for bit.",
    run: |case| {
        let expected = &case.watched()?.outcome;
        for copy in round_trip(case.teacher.as_ref())? {
            let trained =
                granted("training with the copy", case.train(copy.as_ref(), &mut Stopwatch::never()))?;
            same_training(expected, &trained)?;
        }
        Ok(())
    },
};

/// Asks for the same bytes of policy, snapshots and curve.
fn same_training(expected: &Trained, got: &Trained) -> Result<(), Violation> {
    let steps = |trained: &Trained| trained.snapshots.iter().map(|s| s.steps).collect::<Vec<_>>();
    if steps(expected) != steps(got) {
        let (expected, got) = (format!("{:?}", steps(expected)), format!("{:?}", steps(got)));
        return Err(Violation::new("steps of the snapshots", expected, got));
    }
    for (ours, theirs) in expected.snapshots.iter().zip(&got.snapshots) {
        let what = format!("digest of the snapshot after {} steps", ours.steps);
        same_text(&what, &digest(&ours.policy), &digest(&theirs.policy))?;
    }
    same_text("digest of the policy", &digest(&expected.policy), &digest(&got.policy))?;
    let point = |p: &CurvePoint| format!("{p:?}");
    let curve = |trained: &Trained| trained.curve.iter().map(point).collect::<Vec<_>>().join("; ");
    same_text("learning curve", &curve(expected), &curve(got))
}

fn digest(tensors: &crate::tensors::Tensors) -> String {
    blake3::hash(&tensors.encode()).to_string()
}

fn same_text(what: &str, expected: &str, got: &str) -> Result<(), Violation> {
    if expected == got { Ok(()) } else { Err(Violation::new(what, expected, got)) }
}
