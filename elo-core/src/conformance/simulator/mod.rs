//! The suite of every [`Simulator`] and its [`SimulatorConfig`].
//!
//! What the checks rely on is only what the spec says: sizes, bounds, terms, task parameters, capabilities. A simulator
//! whose state cannot be set skips the checks of restoring; one whose random episodes never end skips those of ends; one
//! that cannot be seen skips that of its scene.

mod action;
mod describe;
#[cfg(test)]
mod liars;
mod mistake;
mod number;
mod refuse;
mod replay;
mod restore;
mod scene;
mod task;
mod trace;

use std::fmt;

use super::check::{Check, Finding, Report, Violation};
use crate::simulator::{BuildError, Simulator, SimulatorConfig};

pub use replay::fingerprint;

/// Every rule, in the order in which they are tried.
pub const CHECKS: &[Check<Case>] = &[
    describe::CONFIG_IS_VALID,
    describe::CONFIG_SURVIVES_FILES,
    describe::SPEC_AGREES_WITH_THE_OBJECT,
    describe::SPEC_SURVIVES_FILES,
    describe::NAMES_IDENTIFY,
    describe::SIZES_ARE_POSITIVE,
    describe::ACTION_BOUNDS_ARE_ORDERED,
    describe::CONTROL_STEP_IS_POSITIVE,
    describe::WEIGHTS_ARE_DEFINED,
    describe::DEFAULTS_LIE_IN_THEIR_RANGES,
    describe::CAPABILITIES_ARE_HONEST,
    replay::FRESH_OBJECTS_REPEAT,
    replay::A_USED_OBJECT_REPEATS,
    replay::THE_ORDER_OF_EPISODES_IS_IMMATERIAL,
    replay::AN_ERROR_LEAVES_NOTHING,
    replay::ANOTHER_THREAD_REPEATS,
    replay::SEEDS_CHOOSE_THE_START,
    replay::EVERY_SEED_IS_ACCEPTED,
    number::NUMBERS_ARE_FINITE,
    number::BUFFERS_ARE_FILLED,
    number::REWARDS_STAY_ABOVE_THE_FLOOR,
    number::STEPS_ALLOCATE_NOTHING,
    refuse::WRONG_LENGTHS_ARE_REFUSED,
    refuse::NONFINITE_ACTIONS_ARE_REFUSED,
    refuse::STEPS_NEED_A_RESET,
    refuse::STEPS_AFTER_AN_END_ARE_REFUSED,
    refuse::AN_ERROR_ENDS_THE_EPISODE,
    refuse::UNKNOWN_TASK_PARAMETERS_ARE_REFUSED,
    refuse::TASK_VALUES_OUTSIDE_THEIR_RANGES_ARE_REFUSED,
    refuse::STATES_NEED_A_RESET,
    refuse::MALFORMED_STATES_ARE_REFUSED,
    restore::RESTORE_RESUMES,
    restore::STATES_MOVE_BETWEEN_OBJECTS,
    restore::STATES_COME_BACK_AS_THEY_WERE,
    restore::READING_THE_STATE_DISTURBS_NOTHING,
    restore::ENDS_COME_AGAIN,
    restore::FALLEN_STATES_CAN_BE_TAKEN_UP,
    restore::TIME_ALONE_IS_NO_FALL,
    task::REWARD_PARAMETERS_DO_NOT_MOVE_ANYTHING,
    task::DYNAMICS_PARAMETERS_CHANGE_SOMETHING,
    task::DEFAULTS_ARE_THOSE_OF_THE_SPEC,
    action::ACTIONS_ARE_CLAMPED,
    action::EVERY_ACTION_COMPONENT_MATTERS,
    scene::SCENE_FOLLOWS_THE_STATE,
];

/// Tries every rule on `case`.
///
/// Costs about 8,000 control steps at the default length, up to 4,500 more in a world whose episodes never end, and about
/// a hundred builds.
pub fn run(case: &Case) -> Report {
    Report::of(format!("{:?}", case.config), CHECKS, case)
}

/// A simulator to be tried, and how.
pub struct Case {
    config: Box<dyn SimulatorConfig>,
    builder: Box<Builder>,
    tolerance: Tolerance,
    steps: usize,
    allocations: Option<fn() -> u64>,
}

type Builder = dyn Fn(&dyn SimulatorConfig) -> Result<Box<dyn Simulator>, BuildError> + Send + Sync;

/// How far a restored simulation may be from the run that its state was read in, relative to the greater of 1 and the
/// numbers compared. One rounding of `f32` is always allowed in observations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// For the observation at the restored state, and for the state itself when it is read back.
    pub start: f64,
    /// For observation and reward terms one control step later. Engines whose solver starts from its last solution
    /// need more than those whose state is all there is.
    pub step: f64,
}

impl Default for Tolerance {
    /// `1e-9` for both: exact but for the last digits.
    fn default() -> Self {
        Self { start: 1e-9, step: 1e-9 }
    }
}

impl Case {
    /// The simulators that `config` builds, with the default tolerance and episodes of up to 60 control steps.
    pub fn new(config: Box<dyn SimulatorConfig>) -> Self {
        Self {
            config,
            builder: Box::new(|config| config.build()),
            tolerance: Tolerance::default(),
            steps: 60,
            allocations: None,
        }
    }

    /// Makes simulators with `builder` rather than [`SimulatorConfig::build`], e.g. in a worker process.
    #[must_use]
    pub fn built_by(
        self,
        builder: impl Fn(&dyn SimulatorConfig) -> Result<Box<dyn Simulator>, BuildError> + Send + Sync + 'static,
    ) -> Self {
        Self { builder: Box::new(builder), ..self }
    }

    /// Sets what the engine states about its restored states.
    #[must_use]
    pub fn within(self, tolerance: Tolerance) -> Self {
        Self { tolerance, ..self }
    }

    /// Sets the length of the episodes in control steps, at least 8.
    #[must_use]
    pub fn lasting(self, steps: usize) -> Self {
        Self { steps: steps.max(8), ..self }
    }

    /// Lets the suite see how many allocations the calling thread made so far; without it, the check of `step`'s
    /// allocations is skipped. The number comes from the test program's global allocator.
    #[must_use]
    pub fn counting(self, allocations: fn() -> u64) -> Self {
        Self { allocations: Some(allocations), ..self }
    }

    /// A new simulator. A missing engine skips the check.
    fn simulator(&self) -> Result<Box<dyn Simulator>, Finding> {
        self.build(self.config.as_ref())
    }

    fn build(&self, config: &dyn SimulatorConfig) -> Result<Box<dyn Simulator>, Finding> {
        (self.builder)(config).map_err(|error| match error {
            BuildError::MissingEngine { .. } => Finding::Skipped(error.to_string()),
            BuildError::Robot(_) | BuildError::Code(_) => {
                Violation::new("build", "a simulator", error).into()
            }
        })
    }

    /// A new simulator whose state can be set; skips the check where none can.
    fn settable(&self) -> Result<Box<dyn Simulator>, Finding> {
        let simulator = self.simulator()?;
        if simulator.spec().capabilities.settable_state {
            Ok(simulator)
        } else {
            Err(Finding::Skipped("its state cannot be set".to_owned()))
        }
    }
}

impl fmt::Debug for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Case")
            .field("config", &self.config)
            .field("tolerance", &self.tolerance)
            .field("steps", &self.steps)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::liars::allocations;
    use crate::conformance::point_mass::{PointMassConfig, replay_only};

    fn point_mass() -> Case {
        Case::new(Box::new(PointMassConfig::default())).counting(allocations)
    }

    #[test]
    fn the_point_mass_keeps_every_rule_and_skips_none() {
        let report = run(&point_mass());
        assert!(report.failed().is_empty() && report.skipped().is_empty(), "{report}");
    }

    #[test]
    fn a_world_without_settable_states_keeps_the_rules_that_remain() {
        let report = run(&point_mass().built_by(|_| Ok(replay_only(PointMassConfig::default()))));
        // Its config still describes the settable world, so the two specs differ: that is the one broken rule.
        assert_eq!(report.failed(), [describe::SPEC_AGREES_WITH_THE_OBJECT.name], "{report}");
        let skipped = [
            refuse::STATES_NEED_A_RESET.name,
            refuse::MALFORMED_STATES_ARE_REFUSED.name,
            restore::RESTORE_RESUMES.name,
            restore::STATES_MOVE_BETWEEN_OBJECTS.name,
            restore::STATES_COME_BACK_AS_THEY_WERE.name,
            restore::READING_THE_STATE_DISTURBS_NOTHING.name,
            restore::ENDS_COME_AGAIN.name,
            restore::FALLEN_STATES_CAN_BE_TAKEN_UP.name,
            restore::TIME_ALONE_IS_NO_FALL.name,
        ];
        assert_eq!(report.skipped(), skipped, "{report}");
    }

    #[test]
    fn a_missing_engine_skips_what_needs_it_and_nothing_else() {
        let missing =
            || BuildError::MissingEngine { engine: "e".to_owned(), remedy: "install it".to_owned() };
        let report = run(&point_mass().built_by(move |_| Err(missing())));
        assert!(report.failed().is_empty(), "{report}");
        assert_eq!(report.skipped().len(), CHECKS.len() - 8, "{report}");
    }
}
