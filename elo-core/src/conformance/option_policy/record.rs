//! Policies at rest: what is written is what is read, and what cannot be right is refused.

use super::{Case, Check, Finding, Situation, Violation, answers, finite_actions, same_answers};
use crate::conformance::compare::{granted, refused};
use crate::conformance::damage::{Damaged, demand_refusals, misshapen, missing, never, spoilt};
use crate::policy::OptionPolicy;
use crate::spec::SimulatorSpec;
use crate::tensors::Tensors;

pub(super) const RECORD_NAMES_ITS_FORMAT: Check<Case> = Check {
    name: "record_names_its_format",
    rule: "The record's format is the one that reads it.",
    run: |case| {
        let format = case.policy.record().format;
        if format == case.format.name {
            Ok(())
        } else {
            Err(Violation::new("format of the record", case.format.name, format).into())
        }
    },
};

pub(super) const RECORDS_LOAD_AS_THE_SAME_POLICY: Check<Case> = Check {
    name: "records_load_as_the_same_policy",
    rule: "Recorded, written as a file, read and loaded, the policy gives the same answers and the same record, bit \
           for bit.",
    run: |case| {
        let bytes = case.policy.record().tensors.encode();
        let tensors = granted("reading the record's file", Tensors::decode(&bytes))?;
        let loaded = granted("loading the record", (case.format.load)(&tensors, &case.spec))?;
        let situations = Situation::all(&case.spec);
        let expected = answers(case.policy.as_ref(), &situations);
        same_answers(&expected, &answers(loaded.as_ref(), &situations))?;
        Ok(same_record(loaded.as_ref(), &tensors)?)
    },
};

pub(super) const MISSING_TENSORS_ARE_REFUSED: Check<Case> = Check {
    name: "missing_tensors_are_refused",
    rule: "A record without one of its tensors is refused, unless what is left is a record of its own.",
    run: |case| refuses_or_works(case, missing),
};

pub(super) const MISSHAPEN_TENSORS_ARE_REFUSED: Check<Case> = Check {
    name: "misshapen_tensors_are_refused",
    rule: "A record with a tensor of another shape is refused, unless it is a record of its own, such as one of a \
           shorter option.",
    run: |case| refuses_or_works(case, misshapen),
};

pub(super) const NONFINITE_TENSORS_ARE_REFUSED: Check<Case> = Check {
    name: "nonfinite_tensors_are_refused",
    rule: "A record with a number that is not finite is refused.",
    run: |case| Ok(demand_refusals(spoilt(&case.policy.record().tensors), load(case), never)?),
};

pub(super) const OTHER_ROBOTS_ARE_REFUSED: Check<Case> = Check {
    name: "other_robots_are_refused",
    rule: "A robot with another action size is refused; one with another observation size is refused or observed.",
    run: |case| {
        let tensors = case.policy.record().tensors;
        let mut longer = case.spec.clone();
        longer.action_low.push(-1.0);
        longer.action_high.push(1.0);
        let mut shorter = case.spec.clone();
        shorter.action_low.pop();
        shorter.action_high.pop();
        for spec in [longer, shorter] {
            let what =
                format!("loading for {} in place of {} actions", spec.action_size(), case.spec.action_size());
            refused(what, (case.format.load)(&tensors, &spec))?;
        }
        let size = case.spec.observation_size;
        for observation_size in [size + 1, size.saturating_sub(1)] {
            let spec = SimulatorSpec { observation_size, ..case.spec.clone() };
            if let Ok(policy) = (case.format.load)(&tensors, &spec) {
                finite_actions(policy.as_ref(), &spec)?;
            }
        }
        Ok(())
    },
};

fn load(case: &Case) -> impl Fn(&Tensors) -> Result<Box<dyn OptionPolicy>, crate::tensors::TensorError> + '_ {
    |tensors| (case.format.load)(tensors, &case.spec)
}

/// Asks that each damaged copy of the record is refused, or loads as a policy of just these tensors.
fn refuses_or_works(case: &Case, damage: fn(&Tensors) -> Vec<Damaged>) -> Result<(), Finding> {
    let copies = damage(&case.policy.record().tensors);
    Ok(demand_refusals(copies, load(case), |policy, tensors| works(policy, tensors, &case.spec))?)
}

fn works(policy: &dyn OptionPolicy, tensors: &Tensors, spec: &SimulatorSpec) -> Result<(), Violation> {
    same_record(policy, tensors)?;
    finite_actions(policy, spec)
}

fn same_record(policy: &dyn OptionPolicy, expected: &Tensors) -> Result<(), Violation> {
    let again = policy.record().tensors;
    if again == *expected {
        return Ok(());
    }
    let shapes = |tensors: &Tensors| {
        let shape = |(name, tensor): (&str, &crate::tensors::Tensor)| format!("{name} {:?}", tensor.shape);
        tensors.iter().map(shape).collect::<Vec<_>>().join(", ")
    };
    let (expected, got) = (shapes(expected), shapes(&again));
    Err(Violation::new("tensors recorded by what was loaded", expected, format!("{got} (or other numbers)")))
}
