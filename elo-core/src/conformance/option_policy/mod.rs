//! The suite of every [`OptionPolicy`] and the [`PolicyFormat`] that it is stored in.

#[cfg(test)]
pub(super) mod liars;
mod record;

use rand::RngExt as _;

use super::check::{Check, Finding, Report, Violation};
use super::compare::{finite, same};
use crate::policy::{OptionPolicy, PolicyFormat};
use crate::seed::Seed;
use crate::spec::SimulatorSpec;

/// Every rule, in the order in which they are tried.
pub const CHECKS: &[Check<Case>] = &[
    ACTING_IS_PURE,
    OTHER_THREADS_AGREE,
    ACTIONS_ARE_FILLED,
    ACTIONS_ARE_FINITE,
    INTEREST_IS_POSITIVE,
    TERMINATION_IS_A_PROBABILITY,
    record::RECORD_NAMES_ITS_FORMAT,
    record::RECORDS_LOAD_AS_THE_SAME_POLICY,
    record::MISSING_TENSORS_ARE_REFUSED,
    record::MISSHAPEN_TENSORS_ARE_REFUSED,
    record::NONFINITE_TENSORS_ARE_REFUSED,
    record::OTHER_ROBOTS_ARE_REFUSED,
];

/// Tries every rule on `case`.
pub fn run(case: &Case) -> Report {
    Report::of(format!("{:?}", case.policy), CHECKS, case)
}

/// An option policy to be tried.
#[derive(Debug)]
pub struct Case {
    /// The policy.
    pub policy: Box<dyn OptionPolicy>,
    /// What reads its records.
    pub format: PolicyFormat,
    /// The robot that it is for.
    pub spec: SimulatorSpec,
}

const ACTING_IS_PURE: Check<Case> = Check {
    name: "acting_is_pure",
    rule: "Interest, action and termination depend on observation, elapsed steps and the stream alone: asked again, in \
           another order, they are the same bit for bit.",
    run: |case| {
        let mut situations = Situation::all(&case.spec);
        let expected = answers(case.policy.as_ref(), &situations);
        situations.reverse();
        let mut again = answers(case.policy.as_ref(), &situations);
        again.reverse();
        Ok(same_answers(&expected, &again)?)
    },
};

const OTHER_THREADS_AGREE: Check<Case> = Check {
    name: "other_threads_agree",
    rule: "Two other threads that ask at the same time get the same answers, bit for bit.",
    run: |case| {
        let situations = Situation::all(&case.spec);
        let ask = || answers(case.policy.as_ref(), &situations);
        let expected = ask();
        let there =
            std::thread::scope(|scope| [scope.spawn(ask), scope.spawn(ask)].map(|thread| thread.join()));
        for answers in there {
            let answers = answers.map_err(|_| Violation::new("another thread", "no panic", "a panic"))?;
            same_answers(&expected, &answers)?;
        }
        Ok(())
    },
};

const ACTIONS_ARE_FILLED: Check<Case> = Check {
    name: "actions_are_filled",
    rule: "Every component of an action is written, and none depends on what the buffer held.",
    run: |case| {
        for situation in Situation::all(&case.spec) {
            let expected = situation.act(case.policy.as_ref(), 0.0);
            let littered = situation.act(case.policy.as_ref(), 7.5);
            same(&situation.named("action"), &expected, &littered)?;
        }
        Ok(())
    },
};

const ACTIONS_ARE_FINITE: Check<Case> = Check {
    name: "actions_are_finite",
    rule: "Actions are finite for observations between -10 and 10, also after the option should have ended.",
    run: |case| Ok(finite_actions(case.policy.as_ref(), &case.spec)?),
};

const INTEREST_IS_POSITIVE: Check<Case> = Check {
    name: "interest_is_positive",
    rule: "Interest is a finite number above 0.",
    run: |case| {
        for situation in Situation::all(&case.spec) {
            let interest = case.policy.interest(&situation.observation);
            if !(interest.is_finite() && interest > 0.0) {
                return Err(Violation::new(situation.named("interest"), "above 0", interest).into());
            }
        }
        Ok(())
    },
};

const TERMINATION_IS_A_PROBABILITY: Check<Case> = Check {
    name: "termination_is_a_probability",
    rule: "Termination is between 0 and 1 after one action and more.",
    run: |case| {
        for situation in Situation::all(&case.spec) {
            for elapsed in [situation.elapsed + 1, situation.elapsed + 2] {
                let probability = case.policy.termination(&situation.observation, elapsed);
                if !(0.0..=1.0).contains(&probability) {
                    let wrong = Violation::new(situation.named("termination"), "0 to 1", probability);
                    return Err(wrong.at(elapsed).into());
                }
            }
        }
        Ok(())
    },
};

/// One question to a policy.
struct Situation {
    observation: Vec<f32>,
    elapsed: usize,
    action_size: usize,
    noise: Seed,
}

/// Interest, action and termination in one situation, as numbers in a row.
type Answer = Vec<f64>;

impl Situation {
    /// Observations of zeros, and small, middling and great ones, at the option's beginning and long after it.
    fn all(spec: &SimulatorSpec) -> Vec<Self> {
        let mut found = Vec::new();
        for scale in [0.0, 0.1, 1.0, 10.0] {
            for elapsed in [0, 1, 2, 3, 10, 99, 199, 200, 1000] {
                let seed = Seed::root(1).index(found.len() as u64);
                let mut stream = seed.child("observation").stream();
                let mut number = || scale * (2.0 * stream.random::<f32>() - 1.0);
                let observation = (0..spec.observation_size).map(|_| number()).collect();
                let noise = seed.child("noise");
                found.push(Self { observation, elapsed, action_size: spec.action_size(), noise });
            }
        }
        found
    }

    /// The action in a buffer that was full of `litter`.
    fn act(&self, policy: &dyn OptionPolicy, litter: f32) -> Vec<f32> {
        let mut action = vec![litter; self.action_size];
        policy.act(&self.observation, self.elapsed, &mut self.noise.stream(), &mut action);
        action
    }

    fn named(&self, what: &str) -> String {
        format!("{what} after {} steps, observing {:?}", self.elapsed, self.observation)
    }
}

fn answers(policy: &dyn OptionPolicy, situations: &[Situation]) -> Vec<Answer> {
    let answer = |situation: &Situation| {
        let interest = policy.interest(&situation.observation);
        let termination = policy.termination(&situation.observation, situation.elapsed + 1);
        let action = situation.act(policy, 0.0);
        [f64::from(interest), termination].into_iter().chain(action.into_iter().map(f64::from)).collect()
    };
    situations.iter().map(answer).collect()
}

fn same_answers(expected: &[Answer], got: &[Answer]) -> Result<(), Violation> {
    for (i, (expected, got)) in expected.iter().zip(got).enumerate() {
        let what = format!("situation {i}: interest, termination and action");
        same(&what, expected, got)?;
    }
    Ok(())
}

fn finite_actions(policy: &dyn OptionPolicy, spec: &SimulatorSpec) -> Result<(), Violation> {
    for situation in Situation::all(spec) {
        finite(&situation.named("action"), &situation.act(policy, 0.0))?;
    }
    Ok(())
}
