//! What training gives is a pure policy that loads where it fits and nowhere else.

use rand::RngExt as _;

use super::{Case, Check, Violation, digest, same_text};
use crate::conformance::check::Finding;
use crate::conformance::compare::{finite, granted, refused, same};
use crate::conformance::damage::{demand_refusals, misshapen, missing, never, spoilt};
use crate::conformance::interruptible::Interruptible as _;
use crate::policy::TeacherPolicy;
use crate::seed::Seed;
use crate::spec::SimulatorSpec;
use crate::tensors::{TensorError, Tensors};

pub(super) const UNTRAINED_POLICIES_REPEAT_AND_LOAD: Check<Case> = Check {
    name: "untrained_policies_repeat_and_load",
    rule: "The policy before training is the same for the same seed, loads, and acts with finite numbers.",
    run: |case| {
        let spec = spec(case)?;
        let untrained = || case.teacher.untrained(&spec, &Seed::root(1));
        let (Some(tensors), Some(again)) = (untrained(), untrained()) else {
            return Err(Finding::Skipped("it has no policy before training".to_owned()));
        };
        same_text("digest of the untrained policy", &digest(&tensors), &digest(&again))?;
        let policy = granted("loading the untrained policy", case.teacher.load(&tensors, &spec))?;
        for question in Question::all(&spec) {
            finite("action of the untrained policy", &question.ask(policy.as_ref(), 0.0))?;
        }
        Ok(())
    },
};

pub(super) const ACTING_IS_PURE: Check<Case> = Check {
    name: "acting_is_pure",
    rule: "Actions depend on observation and stream alone: asked again in another order, or of a second copy, they are \
           the same bit for bit.",
    run: |case| {
        let spec = spec(case)?;
        let (policy, copy) = (policy(case, &spec)?, policy(case, &spec)?);
        let questions = Question::all(&spec);
        let expected: Vec<_> = questions.iter().map(|question| question.ask(policy.as_ref(), 0.0)).collect();
        for (question, expected) in questions.iter().zip(&expected).rev() {
            same("action, asked again", expected, &question.ask(policy.as_ref(), 0.0))?;
            same("action of a second copy", expected, &question.ask(copy.as_ref(), 0.0))?;
        }
        Ok(())
    },
};

pub(super) const ACTIONS_ARE_FILLED: Check<Case> = Check {
    name: "actions_are_filled",
    rule: "Every component of an action is written, and none depends on what the buffer held.",
    run: |case| {
        let spec = spec(case)?;
        let policy = policy(case, &spec)?;
        for question in Question::all(&spec) {
            let expected = question.ask(policy.as_ref(), 0.0);
            same("action into a buffer of 7.5", &expected, &question.ask(policy.as_ref(), 7.5))?;
        }
        Ok(())
    },
};

pub(super) const ACTIONS_ARE_FINITE: Check<Case> = Check {
    name: "actions_are_finite",
    rule: "The trained policy's actions are finite for observations between -10 and 10.",
    run: |case| {
        let spec = spec(case)?;
        let policy = policy(case, &spec)?;
        for question in Question::all(&spec) {
            finite(
                &format!("action observing {:?}", question.observation),
                &question.ask(policy.as_ref(), 0.0),
            )?;
        }
        Ok(())
    },
};

pub(super) const MISSING_TENSORS_ARE_REFUSED: Check<Case> = Check {
    name: "missing_tensors_are_refused",
    rule: "A policy without one of its tensors is refused.",
    run: |case| refuses(case, missing),
};

pub(super) const MISSHAPEN_TENSORS_ARE_REFUSED: Check<Case> = Check {
    name: "misshapen_tensors_are_refused",
    rule: "A policy with a tensor of another shape is refused.",
    run: |case| refuses(case, misshapen),
};

pub(super) const NONFINITE_TENSORS_ARE_REFUSED: Check<Case> = Check {
    name: "nonfinite_tensors_are_refused",
    rule: "A policy with a number that is not finite is refused.",
    run: |case| refuses(case, spoilt),
};

pub(super) const OTHER_ROBOTS_ARE_REFUSED: Check<Case> = Check {
    name: "other_robots_are_refused",
    rule: "A robot with another observation size or another action size is refused.",
    run: |case| {
        let spec = spec(case)?;
        let tensors = &case.watched()?.outcome.policy;
        let with = |change: fn(&mut SimulatorSpec)| {
            let mut other = spec.clone();
            change(&mut other);
            other
        };
        let others = [
            with(|spec| spec.observation_size += 1),
            with(|spec| spec.observation_size -= 1),
            with(|spec| {
                spec.action_low.push(-1.0);
                spec.action_high.push(1.0);
            }),
            with(|spec| {
                spec.action_low.pop();
                spec.action_high.pop();
            }),
        ];
        for other in others {
            let sizes = (other.observation_size, other.action_size());
            let what = format!("loading for {} observations and {} actions", sizes.0, sizes.1);
            refused(what, case.teacher.load(tensors, &other))?;
        }
        Ok(())
    },
};

/// An observation, and the noise to sample with if any.
struct Question {
    observation: Vec<f32>,
    action_size: usize,
    noise: Option<Seed>,
}

impl Question {
    /// Observations of zeros, and small, middling and great ones, each for the mean action and for samples.
    fn all(spec: &SimulatorSpec) -> Vec<Self> {
        let mut found = Vec::new();
        for scale in [0.0, 0.1, 1.0, 10.0] {
            for sampling in [false, true, true] {
                let seed = Seed::root(1).index(found.len() as u64);
                let mut stream = seed.child("observation").stream();
                let mut number = || scale * (2.0 * stream.random::<f32>() - 1.0);
                let observation = (0..spec.observation_size).map(|_| number()).collect();
                let noise = sampling.then(|| seed.child("noise"));
                found.push(Self { observation, action_size: spec.action_size(), noise });
            }
        }
        found
    }

    /// The action in a buffer that was full of `litter`.
    fn ask(&self, policy: &dyn TeacherPolicy, litter: f32) -> Vec<f32> {
        let mut action = vec![litter; self.action_size];
        let mut stream = self.noise.as_ref().map(Seed::stream);
        policy.act(&self.observation, stream.as_mut(), &mut action);
        action
    }
}

fn spec(case: &Case) -> Result<SimulatorSpec, Violation> {
    granted("spec of the simulator", case.simulator.spec())
}

fn policy(case: &Case, spec: &SimulatorSpec) -> Result<Box<dyn TeacherPolicy>, Finding> {
    let tensors = &case.watched()?.outcome.policy;
    Ok(granted("loading the trained policy", case.teacher.load(tensors, spec))?)
}

fn refuses(case: &Case, damage: fn(&Tensors) -> Vec<(String, Tensors)>) -> Result<(), Finding> {
    let spec = spec(case)?;
    let load = |tensors: &Tensors| -> Result<Box<dyn TeacherPolicy>, TensorError> {
        case.teacher.load(tensors, &spec)
    };
    Ok(demand_refusals(damage(&case.watched()?.outcome.policy), load, never)?)
}
