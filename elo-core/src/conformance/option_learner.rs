//! The suite of every [`OptionLearner`]; what it learns is put under the suite of [`super::option_policy`].

use rand::RngExt as _;

use super::check::{Check, Finding, Report, Violation};
use super::compare::{granted, refused};
use super::config::{faultless, round_trip};
use super::option_policy;
use crate::policy::{Demonstration, OptionLearner, OptionPolicy, PolicyFormat};
use crate::seed::Seed;
use crate::spec::SimulatorSpec;

/// Every rule, in the order in which they are tried.
pub const CHECKS: &[Check<Case>] = &[
    CONFIG_IS_VALID,
    CONFIG_SURVIVES_FILES,
    LEARNING_REPEATS,
    ONE_STEP_IS_ENOUGH,
    LEARNED_OPTIONS_CONFORM,
    MALFORMED_DEMONSTRATIONS_ARE_REFUSED,
];

/// Tries every rule on `case`. Costs about ten times learning from 12 control steps.
pub fn run(case: &Case) -> Report {
    Report::of(format!("{:?}", case.learner), CHECKS, case)
}

/// A learner to be tried.
#[derive(Debug)]
pub struct Case {
    /// The learner, with settings that learn from a few steps in a moment.
    pub learner: Box<dyn OptionLearner>,
    /// The robot that demonstrates.
    pub spec: SimulatorSpec,
    /// The formats in which what it learns may be stored.
    pub formats: Vec<PolicyFormat>,
}

const CONFIG_IS_VALID: Check<Case> = Check {
    name: "config_is_valid",
    rule: "The config finds no fault in itself.",
    run: |case| Ok(faultless(|faults| case.learner.validate(faults))?),
};

const CONFIG_SURVIVES_FILES: Check<Case> = Check {
    name: "config_survives_files",
    rule: "Written as JSON or TOML and read back, the config learns the same option, bit for bit.",
    run: |case| {
        let expected = learn(case, case.learner.as_ref(), 12)?;
        for copy in round_trip(case.learner.as_ref())? {
            same_record(expected.as_ref(), learn(case, copy.as_ref(), 12)?.as_ref())?;
        }
        Ok(())
    },
};

const LEARNING_REPEATS: Check<Case> = Check {
    name: "learning_repeats",
    rule: "The same demonstration and seed give the same option, bit for bit, also after another demonstration and on \
           another thread.",
    run: |case| {
        let expected = learn(case, case.learner.as_ref(), 12)?;
        learn(case, case.learner.as_ref(), 5)?;
        same_record(expected.as_ref(), learn(case, case.learner.as_ref(), 12)?.as_ref())?;
        let there = std::thread::scope(|scope| scope.spawn(|| learn(case, case.learner.as_ref(), 12)).join())
            .map_err(|_| Violation::new("the other thread", "no panic", "a panic"))?;
        same_record(expected.as_ref(), there?.as_ref()).map_err(|v| v.during("on another thread").into())
    },
};

const ONE_STEP_IS_ENOUGH: Check<Case> = Check {
    name: "one_step_is_enough",
    rule: "A demonstration of a single control step can be learned.",
    run: |case| learn(case, case.learner.as_ref(), 1).map(drop).map_err(Finding::from),
};

const LEARNED_OPTIONS_CONFORM: Check<Case> = Check {
    name: "learned_options_conform",
    rule: "What is learned names a known format and keeps every rule of option policies.",
    run: |case| {
        let policy = learn(case, case.learner.as_ref(), 12)?;
        let name = policy.record().format;
        let Some(format) = case.formats.iter().find(|format| format.name == name) else {
            let known = case.formats.iter().map(|format| format.name).collect::<Vec<_>>().join(", ");
            return Err(
                Violation::new("format of the learned option", format!("one of {known}"), name).into()
            );
        };
        let learned = option_policy::Case { policy, format: *format, spec: case.spec.clone() };
        match option_policy::run(&learned).first_failure() {
            None => Ok(()),
            Some(failure) => Err(Violation::new("the learned option", "every rule kept", failure).into()),
        }
    },
};

const MALFORMED_DEMONSTRATIONS_ARE_REFUSED: Check<Case> = Check {
    name: "malformed_demonstrations_are_refused",
    rule: "A demonstration of no steps, of other lengths than its steps ask for, or with numbers that are not finite \
           is an error.",
    run: |case| {
        let right = demonstration(&case.spec, 3);
        let mut found = vec![("no steps", Demonstration { observations: vec![], actions: vec![], steps: 0 })];
        let mut add = |what, change: fn(&mut Demonstration)| {
            let mut wrong = right.clone();
            change(&mut wrong);
            found.push((what, wrong));
        };
        add("more steps than rows", |d| d.steps += 1);
        add("fewer steps than rows", |d| d.steps -= 1);
        add("an action too short", |d| d.actions.truncate(d.actions.len() - 1));
        add("an observation too short", |d| d.observations.truncate(d.observations.len() - 1));
        add("a NaN in an action", |d| d.actions[0] = f32::NAN);
        add("an infinity in an observation", |d| d.observations[0] = f32::INFINITY);
        for (what, wrong) in found {
            let learned = case.learner.learn(&wrong, &case.spec, &Seed::root(1));
            refused(format!("learning from {what}"), learned)?;
        }
        Ok(())
    },
};

fn learn(case: &Case, learner: &dyn OptionLearner, steps: usize) -> Result<Box<dyn OptionPolicy>, Violation> {
    let learned = learner.learn(&demonstration(&case.spec, steps), &case.spec, &Seed::root(1));
    granted(format!("learning from {steps} steps"), learned)
}

/// Slowly turning observations, and random actions within the bounds.
fn demonstration(spec: &SimulatorSpec, steps: usize) -> Demonstration {
    let mut stream = Seed::root(steps as u64).stream();
    let observe = |step: usize, i: usize| (0.3 * step as f32 + i as f32).sin();
    let observations =
        (0..steps).flat_map(|step| (0..spec.observation_size).map(move |i| observe(step, i))).collect();
    let bounds = || spec.action_low.iter().zip(&spec.action_high);
    let actions = (0..steps)
        .flat_map(|_| bounds())
        .map(|(low, high)| low + stream.random::<f32>() * (high - low))
        .collect();
    Demonstration { observations, actions, steps }
}

fn same_record(expected: &dyn OptionPolicy, got: &dyn OptionPolicy) -> Result<(), Violation> {
    let (expected, got) = (expected.record(), got.record());
    if expected.format == got.format && expected.tensors.encode() == got.tensors.encode() {
        return Ok(());
    }
    let digest = |record: &crate::policy::PolicyRecord| {
        format!("{} {}", record.format, blake3::hash(&record.tensors.encode()))
    };
    Err(Violation::new("digest of the learned option", digest(&expected), digest(&got)))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use serde::{Deserialize, Serialize};

    use super::*;
    use crate::conformance::liars::{Lie, demand_that_liars_are_caught};
    use crate::conformance::option_policy::liars::{HONEST, Script};
    use crate::conformance::point_mass::PointMassConfig;
    use crate::fault::Faults;

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

        fn learn(
            &self,
            demonstration: &Demonstration,
            spec: &SimulatorSpec,
            _: &Seed,
        ) -> Result<Box<dyn OptionPolicy>, String> {
            let Demonstration { observations, actions, steps } = demonstration;
            let right = *steps > 0
                && observations.len() == steps * spec.observation_size
                && actions.len() == steps * spec.action_size()
                && observations.iter().chain(actions).all(|x| x.is_finite());
            if !right && self.lie != "malformed_demonstrations_are_refused" {
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
        Case {
            learner: Box::new(Liar { lie: lie.to_owned(), forgotten: 1.0, learned: AtomicU32::new(0) }),
            spec: PointMassConfig::default().description(),
            formats: vec![HONEST],
        }
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
        let report = run(&Case { formats: Vec::new(), ..case("none") });
        assert_eq!(report.failed(), [LEARNED_OPTIONS_CONFORM.name], "{report}");
    }
}
