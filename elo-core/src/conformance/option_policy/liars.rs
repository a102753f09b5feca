//! An open-loop option that breaks any one rule of the suite, and the demand that the right check finds it.

use std::cell::Cell;
use std::sync::atomic::{AtomicU32, Ordering};

use rand::RngExt as _;

use super::{CHECKS, Case};
use crate::conformance::liars::{Lie, demand_that_liars_are_caught};
use crate::conformance::point_mass::PointMassConfig;
use crate::policy::{OptionPolicy, PolicyFormat, PolicyRecord};
use crate::seed::Stream;
use crate::spec::SimulatorSpec;
use crate::tensors::{TensorError, Tensors};

/// Repeats a list of actions, a little shaken, and ends with it.
#[derive(Debug)]
pub(in crate::conformance) struct Script {
    /// `T` rows.
    pub actions: Vec<Vec<f32>>,
    /// The greatest shake.
    pub shake: f32,
    /// The check that is meant to find what is wrong with it.
    pub lie: &'static str,
    asked: AtomicU32,
}

impl Script {
    pub fn new(actions: Vec<Vec<f32>>, lie: &'static str) -> Self {
        Self { actions, shake: 0.01, lie, asked: AtomicU32::new(0) }
    }

    fn load(tensors: &Tensors, spec: &SimulatorSpec) -> Result<Self, TensorError> {
        let tensor = tensors.get("actions")?;
        let (rows, size) = (tensor.data.len() / spec.action_size().max(1), spec.action_size());
        let shape_error = || TensorError::Shape {
            name: "actions".to_owned(),
            got: tensor.shape.clone(),
            expected: format!("[T >= 1, {size}]"),
        };
        if rows == 0 || tensor.shape != [rows, size] {
            return Err(shape_error());
        }
        let shake = tensors.get_shaped("shake", &[1])?[0];
        if !(shake.is_finite() && tensor.data.iter().all(|a| a.is_finite())) {
            return Err(TensorError::NotFinite("actions or shake".to_owned()));
        }
        Ok(Self { shake, ..Self::new(tensor.data.chunks(size).map(<[f32]>::to_vec).collect(), "none") })
    }
}

thread_local! {
    static HERE: Cell<f32> = const { Cell::new(0.0) };
}

impl OptionPolicy for Script {
    fn interest(&self, _: &[f32]) -> f32 {
        if self.lie == "interest_is_positive" { 0.0 } else { 1.0 }
    }

    fn act(&self, _: &[f32], elapsed: usize, noise: &mut Stream, action: &mut [f32]) {
        if self.lie == "actions_are_filled" && elapsed >= self.actions.len() {
            return;
        }
        action.copy_from_slice(&self.actions[elapsed.min(self.actions.len() - 1)]);
        action[0] += self.shake * noise.random::<f32>();
        match self.lie {
            "acting_is_pure" => action[0] += self.asked.fetch_add(1, Ordering::Relaxed) as f32,
            "other_threads_agree" => {
                // Right on the thread of the tests alone.
                let here = std::thread::current().name().is_some();
                HERE.set(if here { 0.0 } else { 1.0 });
                action[0] += HERE.get();
            }
            "actions_are_finite" if elapsed > 500 => action[0] = f32::NAN,
            _ => {}
        }
    }

    fn termination(&self, _: &[f32], elapsed: usize) -> f64 {
        let over = f64::from(elapsed >= self.actions.len());
        if self.lie == "termination_is_a_probability" { 2.0 * over } else { over }
    }

    fn record(&self) -> PolicyRecord {
        let mut tensors = Tensors::new();
        let rounded = |a: &f32| if self.lie == "records_load_as_the_same_policy" { a.round() } else { *a };
        let shape = [self.actions.len(), self.actions[0].len()];
        tensors.insert("actions", &shape, self.actions.iter().flatten().map(rounded).collect());
        tensors.insert("shake", &[1], vec![self.shake]);
        let format = if self.lie == "record_names_its_format" { "another" } else { "script" };
        PolicyRecord { format: format.to_owned(), tensors }
    }
}

type Load = fn(&Tensors, &SimulatorSpec) -> Result<Box<dyn OptionPolicy>, TensorError>;

pub(in crate::conformance) const HONEST: PolicyFormat = PolicyFormat {
    name: "script",
    summary: "actions [T, A], shake [1]",
    load: |t, s| boxed(Script::load(t, s)),
};

fn boxed(script: Result<Script, TensorError>) -> Result<Box<dyn OptionPolicy>, TensorError> {
    script.map(|script| Box::new(script) as Box<dyn OptionPolicy>)
}

/// How the format of the liar with this lie loads.
fn load_of(lie: &str) -> Load {
    match lie {
        "missing_tensors_are_refused" => |tensors, spec| {
            let mut tensors = tensors.clone();
            if tensors.get("shake").is_err() {
                tensors.insert("shake", &[1], vec![0.0]);
            }
            boxed(Script::load(&tensors, spec))
        },
        "misshapen_tensors_are_refused" => |tensors, spec| {
            let mut tensors = tensors.clone();
            let data = tensors.get("actions")?.data.clone();
            let rows = data.len() / spec.action_size().max(1);
            tensors.insert("actions", &[rows, data.len() / rows.max(1)], data);
            boxed(Script::load(&tensors, spec))
        },
        "nonfinite_tensors_are_refused" => |tensors, spec| {
            let mut finite = tensors.clone();
            for (name, tensor) in tensors.iter() {
                let data = tensor.data.iter().map(|x| if x.is_finite() { *x } else { 0.0 }).collect();
                finite.insert(name, &tensor.shape, data);
            }
            boxed(Script::load(&finite, spec))
        },
        "other_robots_are_refused" => |tensors, spec| {
            let one = SimulatorSpec { action_low: vec![-1.0], action_high: vec![1.0], ..spec.clone() };
            boxed(Script::load(tensors, &one))
        },
        _ => HONEST.load,
    }
}

fn case(lie: &'static str) -> Case {
    let actions = (0..12).map(|i| vec![0.1 * i as f32 - 0.5]).collect();
    Case {
        policy: Box::new(Script::new(actions, lie)),
        format: PolicyFormat { load: load_of(lie), ..HONEST },
        spec: PointMassConfig::default().description(),
    }
}

/// The liars, one for each check, with the checks that cannot help finding them too.
const LIES: &[(&str, &[&str])] = &[
    ("acting_is_pure", &["other_threads_agree", "actions_are_filled", "records_load_as_the_same_policy"]),
    ("other_threads_agree", &[]),
    ("actions_are_filled", &["records_load_as_the_same_policy"]),
    ("actions_are_finite", &["records_load_as_the_same_policy"]),
    ("interest_is_positive", &["records_load_as_the_same_policy"]),
    ("termination_is_a_probability", &["records_load_as_the_same_policy"]),
    ("record_names_its_format", &[]),
    ("records_load_as_the_same_policy", &[]),
    ("missing_tensors_are_refused", &[]),
    ("misshapen_tensors_are_refused", &["other_robots_are_refused"]),
    ("nonfinite_tensors_are_refused", &[]),
    ("other_robots_are_refused", &[]),
];

#[test]
fn an_honest_option_keeps_every_rule() {
    let report = super::run(&case("none"));
    assert!(report.failed().is_empty() && report.skipped().is_empty(), "{report}");
}

#[test]
fn each_liar_is_caught_by_the_check_that_is_meant_for_it() {
    let lies: Vec<_> = LIES
        .iter()
        .map(|(caught_by, also)| Lie { caught_by, also, subject: Box::new(case(caught_by)) })
        .collect();
    demand_that_liars_are_caught(CHECKS, &lies);
}
