//! Learners that imitate and are corrected by the teacher: the rules of those that imitate, and what they owe to the teacher.

use super::super::check::{Check, Violation};
use super::super::compare::{granted, refused};
use super::imitating::{
    CONFIG_SURVIVES_FILES, LEARNED_OPTIONS_CONFORM, LEARNING_REPEATS, MALFORMED_DEMONSTRATIONS_ARE_REFUSED,
    ONE_STEP_IS_ENOUGH,
};
use super::{CONFIG_IS_VALID, Case, demonstration, same_option};
use crate::policy::{self, Demonstration, OptionPolicy, Tutor, Way};
use crate::seed::Seed;
use crate::spec::SimulatorSpec;

/// Every rule, in the order in which they are tried. Costs about 15 times learning from 12 control steps.
pub const CHECKS: &[Check<Case>] = &[
    CONFIG_IS_VALID,
    CONFIG_SURVIVES_FILES,
    LEARNING_REPEATS,
    ONE_STEP_IS_ENOUGH,
    LEARNED_OPTIONS_CONFORM,
    MALFORMED_DEMONSTRATIONS_ARE_REFUSED,
    THE_TEACHER_IS_HEARD,
    CORRECTIONS_ARE_COUNTED,
    NO_CORRECTION_IS_AN_ERROR,
    EMPTY_CORRECTIONS_ARE_TAKEN,
];

/// `T` of the tutor's rollouts.
const STEPS: usize = 12;

/// A tutor whose corrections are known: the same states whatever the apprentice does, and one action in all of them.
pub(super) struct Strict {
    spec: SimulatorSpec,
    /// What the teacher does, from 0, the lower bound, to 1, the upper one.
    does: f32,
    /// Steps of each correction.
    steps: usize,
    /// Whether there is none.
    absent: bool,
    /// Corrections that were asked for.
    asked: u64,
}

impl Strict {
    pub fn new(spec: SimulatorSpec) -> Self {
        Self { spec, does: 0.75, steps: STEPS, absent: false, asked: 0 }
    }
}

impl Tutor for Strict {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn correct(&mut self, _: &dyn OptionPolicy, _: &Seed) -> Result<Demonstration, String> {
        if self.absent {
            return Err("no start could be drawn".to_owned());
        }
        self.asked += 1;
        let bounds = self.spec.action_low.iter().zip(&self.spec.action_high);
        let action: Vec<f32> = bounds.map(|(low, high)| low + self.does * (high - low)).collect();
        let Demonstration { observations, .. } = demonstration(&self.spec, self.steps);
        Ok(Demonstration { observations, actions: action.repeat(self.steps), steps: self.steps })
    }
}

fn learner(case: &Case) -> Result<&dyn policy::Apprentice, Violation> {
    match case.learner.way() {
        Way::Apprentices(learner) => Ok(learner),
        _ => Err(Violation::new("the learner's way", "an apprentice's", "another")),
    }
}

fn learn(case: &Case, tutor: &mut Strict) -> Result<Result<Box<dyn OptionPolicy>, String>, Violation> {
    Ok(learner(case)?.learn(&demonstration(&case.spec()?, STEPS), tutor, &Seed::root(1)))
}

const THE_TEACHER_IS_HEARD: Check<Case> = Check {
    name: "the_teacher_is_heard",
    rule: "With a teacher who does something else in the same states, another option is learned.",
    run: |case| {
        let mut options = Vec::new();
        for does in [0.75, 0.25] {
            let learned = learn(case, &mut Strict { does, ..Strict::new(case.spec()?) })?;
            options.push(granted("learning with corrections", learned)?);
        }
        match same_option(options[0].as_ref(), options[1].as_ref()) {
            Err(_) => Ok(()),
            Ok(()) => {
                Err(Violation::new("learning from another teacher", "another option", "the same").into())
            }
        }
    },
};

const CORRECTIONS_ARE_COUNTED: Check<Case> = Check {
    name: "corrections_are_counted",
    rule: "No more corrections are asked for than the config's own estimate says.",
    run: |case| {
        let mut tutor = Strict::new(case.spec()?);
        granted("learning with corrections", learn(case, &mut tutor)?)?;
        let estimate = learner(case)?.corrections();
        if tutor.asked <= estimate {
            return Ok(());
        }
        Err(Violation::new("corrections asked for", format!("at most {estimate}"), tutor.asked).into())
    },
};

const NO_CORRECTION_IS_AN_ERROR: Check<Case> = Check {
    name: "no_correction_is_an_error",
    rule: "Where the apprentice cannot be tried at all, nothing is learned.",
    run: |case| {
        let mut absent = Strict { absent: true, ..Strict::new(case.spec()?) };
        Ok(refused("learning without corrections", learn(case, &mut absent)?)?)
    },
};

const EMPTY_CORRECTIONS_ARE_TAKEN: Check<Case> = Check {
    name: "empty_corrections_are_taken",
    rule: "Corrections without a step, of rollouts that the simulator failed in, do no harm.",
    run: |case| {
        let mut empty = Strict { steps: 0, ..Strict::new(case.spec()?) };
        granted("learning from empty corrections", learn(case, &mut empty)?)?;
        Ok(())
    },
};

#[cfg(test)]
mod tests {
    use serde::{Deserialize, Serialize};

    use super::super::{run, well_formed};
    use super::*;
    use crate::conformance::liars::{Lie, demand_that_liars_are_caught};
    use crate::conformance::option_policy::liars::{HONEST, Script};
    use crate::conformance::point_mass::PointMassConfig;
    use crate::fault::Faults;
    use crate::policy::OptionLearner;

    /// Repeats the demonstrated actions, drawn half-way to what the teacher does, but for one lie.
    #[derive(Debug, Serialize, Deserialize)]
    struct Liar {
        lie: String,
        #[serde(skip)]
        forgotten: f32,
        #[serde(skip)]
        learned: std::sync::atomic::AtomicU32,
    }

    impl Liar {
        fn is(&self, check: &str) -> bool {
            self.lie == check
        }
    }

    #[typetag::serde(name = "lying_apprentice")]
    impl OptionLearner for Liar {
        fn validate(&self, faults: &mut Faults) {
            faults.check(!self.is("config_is_valid"), "lie", || "expected the truth".to_owned());
        }

        fn way(&self) -> Way<'_> {
            Way::Apprentices(self)
        }
    }

    impl policy::Apprentice for Liar {
        fn corrections(&self) -> u64 {
            if self.is("corrections_are_counted") { 1 } else { 2 }
        }

        fn learn(
            &self,
            demonstration: &Demonstration,
            tutor: &mut dyn Tutor,
            seed: &Seed,
        ) -> Result<Box<dyn OptionPolicy>, String> {
            let spec = tutor.spec().clone();
            let Demonstration { actions, steps, .. } = demonstration;
            if !well_formed(demonstration, &spec) && !self.is("malformed_demonstrations_are_refused") {
                return Err("it is malformed".to_owned());
            }
            if self.is("one_step_is_enough") && *steps == 1 {
                return Err("it is too short".to_owned());
            }
            let before = self.learned.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            let lie = if self.is("learned_options_conform") { "interest_is_positive" } else { "none" };
            let mut rows: Vec<Vec<f32>> = actions.chunks(spec.action_size()).map(<[f32]>::to_vec).collect();
            for round in 0..2 {
                let corrected = tutor.correct(&Script::new(rows.clone(), "none"), &seed.index(round));
                let corrected = match corrected {
                    Err(_) if self.is("no_correction_is_an_error") => break,
                    corrected => corrected?,
                };
                if corrected.steps == 0 && self.is("empty_corrections_are_taken") {
                    return Err("there is nothing to learn".to_owned());
                }
                if self.is("the_teacher_is_heard") {
                    continue;
                }
                for (row, taught) in rows.iter_mut().zip(corrected.actions.chunks(spec.action_size())) {
                    row.iter_mut().zip(taught).for_each(|(a, t)| *a = 0.5 * (*a + t));
                }
            }
            let offset = match self.lie.as_str() {
                "config_survives_files" => self.forgotten,
                "learning_repeats" => before as f32,
                _ => 0.0,
            };
            rows.iter_mut().flatten().for_each(|a| *a += offset);
            Ok(Box::new(Script::new(rows, lie)))
        }
    }

    fn case(lie: &str) -> Case {
        let liar =
            Liar { lie: lie.to_owned(), forgotten: 1.0, learned: std::sync::atomic::AtomicU32::new(0) };
        Case::new(Box::new(liar), Box::new(PointMassConfig::default()), vec![HONEST])
    }

    #[test]
    fn an_honest_learner_keeps_every_rule() {
        let report = run(&case("none"));
        assert!(report.failed().is_empty() && report.skipped().is_empty(), "{report}");
    }

    #[test]
    fn each_liar_is_caught_by_the_check_that_is_meant_for_it() {
        let lies: Vec<Lie<Box<Case>>> = CHECKS
            .iter()
            .map(|check| Lie { caught_by: check.name, also: &[], subject: Box::new(case(check.name)) })
            .collect();
        demand_that_liars_are_caught(CHECKS, &lies);
    }
}
