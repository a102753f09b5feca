//! What a suite is made of: named rules that give a reason when they are broken, and a report of all of them.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// One rule that every implementor of a trait keeps, and how to find out.
pub struct Check<S: ?Sized> {
    /// The rule in a few words, e.g. `restore_resumes`; unique in its suite.
    pub name: &'static str,
    /// The rule in one sentence.
    pub rule: &'static str,
    /// Tries it. It makes what it needs from the subject alone and leaves nothing behind.
    pub run: fn(&S) -> Result<(), Finding>,
}

impl<S: ?Sized> fmt::Debug for Check<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Check").field("name", &self.name).finish_non_exhaustive()
    }
}

/// Why a check did not pass.
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// The rule is broken.
    Violation(Violation),
    /// The rule does not apply, or could not be tried; the text says why.
    Skipped(String),
}

impl From<Violation> for Finding {
    fn from(violation: Violation) -> Self {
        Self::Violation(violation)
    }
}

/// How a rule was broken: two values that should agree.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// Control steps into the episode, where that means something.
    pub step: Option<usize>,
    /// What was looked at, e.g. `observation[3]`.
    pub what: String,
    /// What the rule asks for.
    pub expected: String,
    /// What came.
    pub got: String,
}

impl Violation {
    /// `what` should have been `expected` and was `got`.
    pub fn new(what: impl fmt::Display, expected: impl fmt::Display, got: impl fmt::Display) -> Self {
        Self { step: None, what: what.to_string(), expected: expected.to_string(), got: got.to_string() }
    }

    /// The same, seen after `step` control steps.
    #[must_use]
    pub fn at(self, step: usize) -> Self {
        Self { step: Some(step), ..self }
    }

    /// The same, with the circumstances put before what was looked at.
    #[must_use]
    pub fn during(self, circumstances: impl fmt::Display) -> Self {
        Self { what: format!("{circumstances}: {}", self.what), ..self }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(step) = self.step {
            write!(f, "step {step}: ")?;
        }
        write!(f, "{}: expected {}, got {}", self.what, self.expected, self.got)
    }
}

/// How one check went.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// The rule held wherever it was tried.
    Passed,
    /// The rule was not tried, for this reason.
    Skipped(String),
    /// The rule is broken, like this.
    Failed(Violation),
}

/// How each check of a suite went, in the suite's order.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// What was tried.
    pub subject: String,
    /// Name and rule of each check, and its outcome.
    pub outcomes: Vec<(&'static str, &'static str, Outcome)>,
}

impl Report {
    /// Runs every check on `subject`, also after failures. A panic inside a check is a violation of it.
    pub fn of<S: ?Sized>(name: impl Into<String>, checks: &[Check<S>], subject: &S) -> Self {
        let outcomes = checks.iter().map(|check| (check.name, check.rule, outcome(check, subject))).collect();
        Self { subject: name.into(), outcomes }
    }

    /// The names of the broken rules.
    pub fn failed(&self) -> Vec<&'static str> {
        self.named(|outcome| matches!(outcome, Outcome::Failed(_)))
    }

    /// The names of the rules that were not tried.
    pub fn skipped(&self) -> Vec<&'static str> {
        self.named(|outcome| matches!(outcome, Outcome::Skipped(_)))
    }

    /// The first broken rule, as text for one line.
    pub fn first_failure(&self) -> Option<String> {
        self.outcomes.iter().find_map(|(name, _, outcome)| match outcome {
            Outcome::Failed(violation) => Some(format!("{name}: {violation}")),
            _ => None,
        })
    }

    /// Asks that no rule is broken; skipped ones are allowed.
    ///
    /// # Errors
    /// The whole report, when one is.
    pub fn require_clean(self) -> Result<Self, Self> {
        if self.failed().is_empty() { Ok(self) } else { Err(self) }
    }

    fn named(&self, wanted: impl Fn(&Outcome) -> bool) -> Vec<&'static str> {
        self.outcomes.iter().filter(|(_, _, outcome)| wanted(outcome)).map(|(name, ..)| *name).collect()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (failed, skipped) = (self.failed().len(), self.skipped().len());
        let passed = self.outcomes.len() - failed - skipped;
        write!(f, "{}: {passed} passed, {failed} failed, {skipped} skipped", self.subject)?;
        for (name, rule, outcome) in &self.outcomes {
            match outcome {
                Outcome::Passed => {}
                Outcome::Skipped(reason) => write!(f, "\n  skipped {name}: {reason}")?,
                Outcome::Failed(violation) => {
                    write!(f, "\n  FAILED  {name}: {violation}\n          ({rule})")?
                }
            }
        }
        Ok(())
    }
}

impl std::error::Error for Report {}

fn outcome<S: ?Sized>(check: &Check<S>, subject: &S) -> Outcome {
    match catch_unwind(AssertUnwindSafe(|| (check.run)(subject))) {
        Ok(Ok(())) => Outcome::Passed,
        Ok(Err(Finding::Skipped(reason))) => Outcome::Skipped(reason),
        Ok(Err(Finding::Violation(violation))) => Outcome::Failed(violation),
        Err(panic) => {
            let text = panic
                .downcast_ref::<String>()
                .cloned()
                .or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
                .unwrap_or_else(|| "a panic without a message".to_owned());
            Outcome::Failed(Violation::new("the implementation", "no panic", text))
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const CHECKS: &[Check<i32>] = &[
        Check { name: "is_even", rule: "The number is even.", run: |n| odd(*n).map_err(Finding::from) },
        Check {
            name: "is_positive",
            rule: "The number is positive.",
            run: |n| if *n > 0 { Ok(()) } else { panic!("{n} is not") },
        },
        Check {
            name: "is_prime",
            rule: "The number is prime.",
            run: |_| Err(Finding::Skipped("tired".into())),
        },
    ];

    fn odd(n: i32) -> Result<(), Violation> {
        if n % 2 == 0 { Ok(()) } else { Err(Violation::new("remainder", 0, n % 2).at(7)) }
    }

    #[test]
    fn a_report_names_every_broken_rule_with_both_values_and_the_step() {
        let report = Report::of("-1", CHECKS, &-1);
        assert_eq!(report.failed(), ["is_even", "is_positive"]);
        assert_eq!(report.skipped(), ["is_prime"]);
        let text = report.require_clean().unwrap_err().to_string();
        assert!(text.contains("is_even: step 7: remainder: expected 0, got -1"), "{text}");
        assert!(text.contains("is_positive: the implementation: expected no panic, got -1 is not"), "{text}");
        assert!(text.starts_with("-1: 0 passed, 2 failed, 1 skipped"), "{text}");
    }

    #[test]
    fn skipped_rules_do_not_spoil_a_clean_report() {
        assert!(Report::of("2", CHECKS, &2).require_clean().is_ok());
    }
}
