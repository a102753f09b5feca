//! Learners that imitate: one option of one recording.

use super::super::check::{Check, Finding, Violation};
use super::super::compare::{granted, refused};
use super::super::config::round_trip;
use super::apprentice::Strict;
use super::{CONFIG_IS_VALID, Case, demonstration, malformed, same_option};
use crate::policy::{Demonstration, OptionLearner, OptionPolicy, Way};
use crate::seed::Seed;

/// Every rule, in the order in which they are tried. Costs about ten times learning from 12 control steps.
pub const CHECKS: &[Check<Case>] = &[
    CONFIG_IS_VALID,
    CONFIG_SURVIVES_FILES,
    LEARNING_REPEATS,
    ONE_STEP_IS_ENOUGH,
    LEARNED_OPTIONS_CONFORM,
    MALFORMED_DEMONSTRATIONS_ARE_REFUSED,
];

pub(super) const CONFIG_SURVIVES_FILES: Check<Case> = Check {
    name: "config_survives_files",
    rule: "Written as JSON or TOML and read back, the config learns the same option, bit for bit.",
    run: |case| {
        let expected = learn(case, case.learner.as_ref(), 12)?;
        for copy in round_trip(case.learner.as_ref())? {
            same_option(expected.as_ref(), learn(case, copy.as_ref(), 12)?.as_ref())?;
        }
        Ok(())
    },
};

pub(super) const LEARNING_REPEATS: Check<Case> = Check {
    name: "learning_repeats",
    rule: "The same demonstration and seed give the same option, bit for bit, also after another demonstration and on \
           another thread.",
    run: |case| {
        let expected = learn(case, case.learner.as_ref(), 12)?;
        learn(case, case.learner.as_ref(), 5)?;
        same_option(expected.as_ref(), learn(case, case.learner.as_ref(), 12)?.as_ref())?;
        let there = std::thread::scope(|scope| scope.spawn(|| learn(case, case.learner.as_ref(), 12)).join())
            .map_err(|_| Violation::new("the other thread", "no panic", "a panic"))?;
        same_option(expected.as_ref(), there?.as_ref()).map_err(|v| v.during("on another thread").into())
    },
};

pub(super) const ONE_STEP_IS_ENOUGH: Check<Case> = Check {
    name: "one_step_is_enough",
    rule: "A demonstration of a single control step can be learned.",
    run: |case| learn(case, case.learner.as_ref(), 1).map(drop).map_err(Finding::from),
};

pub(super) const LEARNED_OPTIONS_CONFORM: Check<Case> = Check {
    name: "learned_options_conform",
    rule: "What is learned names a known format and keeps every rule of option policies.",
    run: |case| Ok(case.conforms(learn(case, case.learner.as_ref(), 12)?)?),
};

pub(super) const MALFORMED_DEMONSTRATIONS_ARE_REFUSED: Check<Case> = Check {
    name: "malformed_demonstrations_are_refused",
    rule: "A demonstration of no steps, of other lengths than its steps ask for, or with numbers that are not finite \
           is an error.",
    run: |case| {
        for (what, wrong) in malformed(&case.spec()?) {
            refused(format!("learning from {what}"), imitate(case, case.learner.as_ref(), &wrong)?)?;
        }
        Ok(())
    },
};

fn learn(case: &Case, learner: &dyn OptionLearner, steps: usize) -> Result<Box<dyn OptionPolicy>, Violation> {
    let learned = imitate(case, learner, &demonstration(&case.spec()?, steps))?;
    granted(format!("learning from {steps} steps"), learned)
}

type Learned = Result<Box<dyn OptionPolicy>, String>;

fn imitate(
    case: &Case,
    learner: &dyn OptionLearner,
    demonstration: &Demonstration,
) -> Result<Learned, Violation> {
    match learner.way() {
        Way::Imitates(learner) => Ok(learner.learn(demonstration, &case.spec()?, &Seed::root(1))),
        Way::Apprentices(learner) => {
            Ok(learner.learn(demonstration, &mut Strict::new(case.spec()?), &Seed::root(1)))
        }
        Way::Practises(_) => Err(Violation::new("the learner's way", "imitating", "practising")),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use serde::{Deserialize, Serialize};

    use super::super::{run, well_formed};
    use super::*;
    use crate::conformance::liars::{Lie, demand_that_liars_are_caught};
    use crate::conformance::option_policy::liars::{HONEST, Script};
    use crate::conformance::point_mass::PointMassConfig;
    use crate::fault::Faults;
    use crate::policy::{Imitate, PolicyFormat};
    use crate::spec::SimulatorSpec;

    /// Repeats the demonstrated actions, but for one lie.
    #[derive(Debug, Serialize, Deserialize)]
    struct Liar {
        lie: String,
        #[serde(skip)]
        forgotten: f32,
        #[serde(skip)]
        learned: AtomicU32,
    }

    #[typetag::serde(name = "liar")]
    impl OptionLearner for Liar {
        fn validate(&self, faults: &mut Faults) {
            faults.check(self.lie != "config_is_valid", "lie", || "expected the truth".to_owned());
        }

        fn way(&self) -> Way<'_> {
            Way::Imitates(self)
        }
    }

    impl Imitate for Liar {
        fn learn(
            &self,
            demonstration: &Demonstration,
            spec: &SimulatorSpec,
            _: &Seed,
        ) -> Result<Box<dyn OptionPolicy>, String> {
            let Demonstration { actions, steps, .. } = demonstration;
            if !well_formed(demonstration, spec) && self.lie != "malformed_demonstrations_are_refused" {
                return Err("it is malformed".to_owned());
            }
            if self.lie == "one_step_is_enough" && *steps == 1 {
                return Err("it is too short".to_owned());
            }
            let before = self.learned.fetch_add(1, Ordering::Relaxed);
            let offset = match self.lie.as_str() {
                "config_survives_files" => self.forgotten,
                "learning_repeats" => before as f32,
                _ => 0.0,
            };
            let rows = actions.chunks(spec.action_size()).map(|row| row.iter().map(|a| a + offset).collect());
            let lie = if self.lie == "learned_options_conform" { "interest_is_positive" } else { "none" };
            Ok(Box::new(Script::new(rows.collect(), lie)))
        }
    }

    fn case(lie: &str) -> Case {
        with_formats(lie, vec![HONEST])
    }

    fn with_formats(lie: &str, formats: Vec<PolicyFormat>) -> Case {
        let liar = Liar { lie: lie.to_owned(), forgotten: 1.0, learned: AtomicU32::new(0) };
        Case::new(Box::new(liar), Box::new(PointMassConfig::default()), formats)
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

    #[test]
    fn options_of_an_unknown_format_do_not_conform() {
        let report = run(&with_formats("none", Vec::new()));
        assert_eq!(report.failed(), [LEARNED_OPTIONS_CONFORM.name], "{report}");
    }
}
