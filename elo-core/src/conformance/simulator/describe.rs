//! What the config and the spec say, before anything is simulated.

use std::collections::BTreeSet;

use super::trace::Episode;
use super::{Case, Check, Finding, Violation};
use crate::conformance::compare::granted;
use crate::conformance::config::{faultless, one_line, round_trip};
use crate::simulator::{Simulator, SimulatorError, Start, State};
use crate::spec::{Effect, SimulatorSpec, Weight};
use crate::task::Task;

pub(super) const CONFIG_IS_VALID: Check<Case> = Check {
    name: "config_is_valid",
    rule: "The config finds no fault in itself, and its engine has a name and a version.",
    run: |case| {
        faultless(|faults| case.config.validate(faults))?;
        one_line("engine name", &case.config.engine().name)?;
        one_line("engine version", &case.config.engine().version)?;
        Ok(())
    },
};

pub(super) const CONFIG_SURVIVES_FILES: Check<Case> = Check {
    name: "config_survives_files",
    rule: "Written as JSON or TOML and read back, the config describes and builds the same simulator.",
    run: |case| {
        let spec = granted("spec", case.config.spec())?;
        let copies = round_trip(case.config.as_ref())?;
        for copy in &copies {
            agree(&spec, &granted("spec of the copy", copy.spec())?)?;
            if copy.engine() != case.config.engine() {
                let (expected, got) = (case.config.engine(), copy.engine());
                return Err(Violation::new("engine", format!("{expected:?}"), format!("{got:?}")).into());
            }
        }
        let episode = Episode::random(&spec, 1, case.steps);
        let expected = episode.play(case.simulator()?.as_mut())?;
        for copy in &copies {
            expected.same(&episode.play(case.build(copy.as_ref())?.as_mut())?)?;
        }
        Ok(())
    },
};

pub(super) const SPEC_AGREES_WITH_THE_OBJECT: Check<Case> = Check {
    name: "spec_agrees_with_the_object",
    rule: "The object's spec is the config's, before and after an episode.",
    run: |case| {
        let spec = granted("spec", case.config.spec())?;
        let mut simulator = case.simulator()?;
        agree(&spec, simulator.spec())?;
        Episode::random(&spec, 1, 8).play(simulator.as_mut())?;
        agree(&spec, simulator.spec()).map_err(|violation| violation.during("after an episode").into())
    },
};

pub(super) const SPEC_SURVIVES_FILES: Check<Case> = Check {
    name: "spec_survives_files",
    rule: "The spec is the same after being written and read: every number in it is finite.",
    run: |case| {
        let spec = granted("spec", case.config.spec())?;
        let json = granted("the spec as JSON", serde_json::to_string(&spec))?;
        agree(&spec, &granted("reading the spec's JSON", serde_json::from_str(&json))?)?;
        Ok(())
    },
};

pub(super) const NAMES_IDENTIFY: Check<Case> = Check {
    name: "names_identify",
    rule: "Robot, reward terms and task parameters have names; no two terms and no two parameters share one.",
    run: |case| {
        let spec = granted("spec", case.config.spec())?;
        one_line("robot", &spec.robot)?;
        unique("reward term", spec.reward_terms.iter().map(|term| term.name.as_str()))?;
        unique("task parameter", spec.task_parameters.iter().map(|parameter| parameter.name.as_str()))?;
        Ok(())
    },
};

pub(super) const SIZES_ARE_POSITIVE: Check<Case> = Check {
    name: "sizes_are_positive",
    rule: "There is something to observe, to do and to be paid for, and each action component has two bounds.",
    run: |case| {
        let spec = granted("spec", case.config.spec())?;
        let sizes = [
            ("observation size", spec.observation_size),
            ("action size", spec.action_size()),
            ("number of reward terms", spec.reward_terms.len()),
        ];
        for (what, size) in sizes {
            if size == 0 {
                return Err(Violation::new(what, "at least 1", size).into());
            }
        }
        if spec.action_high.len() != spec.action_low.len() {
            let (low, high) = (spec.action_low.len(), spec.action_high.len());
            return Err(Violation::new("length of action_high", low, high).into());
        }
        Ok(())
    },
};

pub(super) const ACTION_BOUNDS_ARE_ORDERED: Check<Case> = Check {
    name: "action_bounds_are_ordered",
    rule: "Each action component has a finite lower bound below a finite upper one.",
    run: |case| {
        let spec = granted("spec", case.config.spec())?;
        for (i, (low, high)) in spec.action_low.iter().zip(&spec.action_high).enumerate() {
            if !(low.is_finite() && high.is_finite() && low < high) {
                let got = format!("{low} and {high}");
                return Err(Violation::new(format!("bounds of action[{i}]"), "finite low < high", got).into());
            }
        }
        Ok(())
    },
};

pub(super) const CONTROL_STEP_IS_POSITIVE: Check<Case> = Check {
    name: "control_step_is_positive",
    rule: "A control step takes a positive, finite number of seconds.",
    run: |case| {
        let step = granted("spec", case.config.spec())?.control_step;
        if step.is_finite() && step > 0.0 {
            Ok(())
        } else {
            Err(Violation::new("control step in s", "a positive number", step).into())
        }
    },
};

pub(super) const WEIGHTS_ARE_DEFINED: Check<Case> = Check {
    name: "weights_are_defined",
    rule: "Each weight names a declared task parameter, and each parameter that only prices is named by a weight.",
    run: |case| {
        let spec = granted("spec", case.config.spec())?;
        let named: BTreeSet<&str> = spec
            .reward_terms
            .iter()
            .filter_map(|term| match &term.weight {
                Weight::Parameter(name) => Some(name.as_str()),
                Weight::Constant(_) => None,
            })
            .collect();
        if let Some(name) = named.iter().find(|name| spec.task_parameter(name).is_none()) {
            return Err(Violation::new("weight of a reward term", "a task parameter", name).into());
        }
        let idle = |p: &&_| priced_only(p) && !named.contains(p.name.as_str());
        match spec.task_parameters.iter().find(idle) {
            None => Ok(()),
            Some(p) => {
                Err(Violation::new("reward terms priced by a parameter", "one or more", &p.name).into())
            }
        }
    },
};

pub(super) const DEFAULTS_LIE_IN_THEIR_RANGES: Check<Case> = Check {
    name: "defaults_lie_in_their_ranges",
    rule: "Each task parameter has a finite range with its default inside.",
    run: |case| {
        for p in &granted("spec", case.config.spec())?.task_parameters {
            let ordered = p.low <= p.default && p.default <= p.high;
            if !(ordered && p.low.is_finite() && p.high.is_finite()) {
                let expected = format!("{} to {}", p.low, p.high);
                return Err(Violation::new(format!("default of {}", p.name), expected, p.default).into());
            }
        }
        Ok(())
    },
};

pub(super) const CAPABILITIES_ARE_HONEST: Check<Case> = Check {
    name: "capabilities_are_honest",
    rule: "States can be read and set exactly where the spec says so; elsewhere both are called unsupported.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let claimed = simulator.spec().capabilities.settable_state;
        let first = Episode::random(simulator.spec(), 1, 0).play(simulator.as_mut())?.first;
        let read = simulator.state();
        let set = set_state(simulator.as_mut(), read.clone().unwrap_or_default(), first.len());
        for (what, error) in [("reading a state", read.err()), ("setting a state", set.err())] {
            let unsupported = matches!(error, Some(SimulatorError::Unsupported(_)));
            let honest = if claimed { error.is_none() } else { unsupported };
            if !honest {
                let got = error.map_or("success".to_owned(), |error| error.to_string());
                let expected =
                    if claimed { "success" } else { "an error that says that it is not supported" };
                return Err(Violation::new(what, expected, got).into());
            }
        }
        Ok(())
    },
};

fn set_state(
    simulator: &mut dyn Simulator,
    state: State,
    observation_size: usize,
) -> Result<(), SimulatorError> {
    simulator.reset(&Task::default(), &Start::State(state), &mut vec![0.0; observation_size])
}

fn priced_only(parameter: &crate::spec::TaskParameter) -> bool {
    parameter.effect == Effect::Reward
}

fn agree(expected: &SimulatorSpec, got: &SimulatorSpec) -> Result<(), Violation> {
    if expected == got {
        Ok(())
    } else {
        Err(Violation::new("spec", format!("{expected:?}"), format!("{got:?}")))
    }
}

fn unique<'a>(what: &str, names: impl Iterator<Item = &'a str>) -> Result<(), Finding> {
    let mut seen = BTreeSet::new();
    for name in names {
        one_line(&format!("name of a {what}"), name)?;
        if !seen.insert(name) {
            return Err(Violation::new(format!("names of {what}s"), "no two alike", name).into());
        }
    }
    Ok(())
}
