//! The suites of every [`OptionLearner`], one for each way of learning; what is learned is put under the suite of
//! [`super::option_policy`].

pub mod apprentice;
pub mod imitating;
pub mod practising;

use std::fmt;
use std::sync::OnceLock;

use rand::RngExt as _;

use super::check::{Check, Report, Violation};
use super::compare::granted;
use super::config::faultless;
use super::interruptible::Watched;
use super::option_policy;
use crate::policy::{Demonstration, OptionLearner, OptionPolicy, PolicyFormat, Practised, TrainError, Way};
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;
use crate::spec::SimulatorSpec;

/// Tries every rule of the learner's way on `case`.
pub fn run(case: &Case) -> Report {
    let checks = match case.learner.way() {
        Way::Imitates(_) => imitating::CHECKS,
        Way::Apprentices(_) => apprentice::CHECKS,
        Way::Practises(_) => practising::CHECKS,
    };
    Report::of(format!("{:?}", case.learner), checks, case)
}

/// A learner to be tried.
pub struct Case {
    learner: Box<dyn OptionLearner>,
    simulator: Box<dyn SimulatorConfig>,
    formats: Vec<PolicyFormat>,
    practised: OnceLock<Result<Watched<Practised>, TrainError>>,
}

impl Case {
    /// `learner` for the robot of `simulator`; what it learns may be stored in one of `formats`. With its settings it
    /// should learn from a few steps in a moment. One that practises should take a second and write a few checkpoints on
    /// the way.
    pub fn new(
        learner: Box<dyn OptionLearner>,
        simulator: Box<dyn SimulatorConfig>,
        formats: Vec<PolicyFormat>,
    ) -> Self {
        Self { learner, simulator, formats, practised: OnceLock::new() }
    }

    fn spec(&self) -> Result<SimulatorSpec, Violation> {
        granted("the simulator's description", self.simulator.spec())
    }

    /// Asks that `option` names a known format and keeps every rule of option policies.
    fn conforms(&self, option: Box<dyn OptionPolicy>) -> Result<(), Violation> {
        let name = option.record().format;
        let Some(format) = self.formats.iter().find(|format| format.name == name) else {
            let known = self.formats.iter().map(|format| format.name).collect::<Vec<_>>().join(", ");
            return Err(Violation::new("format of the learned option", format!("one of {known}"), name));
        };
        let learned = option_policy::Case { policy: option, format: *format, spec: self.spec()? };
        match option_policy::run(&learned).first_failure() {
            None => Ok(()),
            Some(failure) => Err(Violation::new("the learned option", "every rule kept", failure)),
        }
    }
}

impl fmt::Debug for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Case")
            .field("learner", &self.learner)
            .field("simulator", &self.simulator)
            .finish_non_exhaustive()
    }
}

const CONFIG_IS_VALID: Check<Case> = Check {
    name: "config_is_valid",
    rule: "The config finds no fault in itself.",
    run: |case| Ok(faultless(|faults| case.learner.validate(faults))?),
};

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

/// What an honest learner asks of a demonstration.
#[cfg(test)]
fn well_formed(demonstration: &Demonstration, spec: &SimulatorSpec) -> bool {
    let Demonstration { observations, actions, steps } = demonstration;
    *steps > 0
        && observations.len() == steps * spec.observation_size
        && actions.len() == steps * spec.action_size()
        && observations.iter().chain(actions).all(|x| x.is_finite())
}

/// Demonstrations that no learner may take, and what is wrong with each.
fn malformed(spec: &SimulatorSpec) -> Vec<(&'static str, Demonstration)> {
    let right = demonstration(spec, 3);
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
    found
}

/// Asks for the same option, bit for bit.
fn same_option(expected: &dyn OptionPolicy, got: &dyn OptionPolicy) -> Result<(), Violation> {
    let (expected, got) = (digest(expected), digest(got));
    if expected == got {
        return Ok(());
    }
    Err(Violation::new("digest of the learned option", expected, got))
}

fn digest(option: &dyn OptionPolicy) -> String {
    let record = option.record();
    format!("{} {}", record.format, blake3::hash(&record.tensors.encode()))
}
