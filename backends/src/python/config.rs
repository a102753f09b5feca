//! What a user says about an environment in Python.

use std::collections::BTreeMap;
use std::path::Path;

use elo_core::fault::Faults;
use elo_core::hosted::{Hosted, WorkerProgram};
use elo_core::simulator::{BuildError, Engine, Simulator, SimulatorConfig};
use elo_core::spec::{Capabilities, Effect, RewardTerm, SimulatorSpec, TaskParameter, Weight};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::files;

/// An environment in Python with Gymnasium's interface and `Box` spaces. It is code that is executed: name only what you
/// trust.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PythonConfig {
    /// A Gymnasium id such as `Pendulum-v1`, or `module:callable` whose call with `kwargs` gives the environment. Modules
    /// are found in `workers.python_path` and where the interpreter finds its own.
    pub target: String,
    /// Keyword arguments of the callable or of `gymnasium.make`.
    pub kwargs: serde_json::Map<String, serde_json::Value>,
    /// Files that the callable is given as keyword arguments, by their paths; relative to the config file here. What they hold is
    /// part of every result's key, which it is not where `kwargs` name a path.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// What the robot is called; options of one robot are refused by another. Empty: the target.
    pub robot: String,
    /// Simulated seconds between two actions. Without it the environment is asked: its attribute `control_step` or `dt`,
    /// else one by `metadata["render_fps"]`, else 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub control_step: Option<f64>,
    /// What `info` tells of the reward. Empty: the reward itself is the only term.
    pub reward_terms: Vec<InfoTerm>,
    /// What may differ between tasks.
    pub task_parameters: Vec<PythonParameter>,
    /// A lower bound on one step's reward, which a failed rollout is given at every step.
    pub reward_floor: f64,
    /// How its state is read and set. Without it, starts are reached by repeating their seed and actions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state: Option<StateMethods>,
    /// What the environment said of itself when the config was read. Written by the program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub described: Option<Described>,
}

/// One reward term: `info["reward_terms"][name]` where there is such a table, else `info[name]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InfoTerm {
    /// Its key.
    pub name: String,
    /// What every task pays for one unit. Exactly one of `weight` and `parameter` is set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weight: Option<f64>,
    /// The task parameter that is the price of one unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameter: Option<String>,
}

/// One task parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PythonParameter {
    /// Its name in tasks, and in Python.
    pub name: String,
    /// Its value in a task that does not mention it.
    pub default: f64,
    /// The least value that makes sense.
    pub low: f64,
    /// The greatest value that makes sense.
    pub high: f64,
    /// How the environment learns of it.
    pub binding: ParameterBinding,
}

/// How an environment learns of a task's parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ParameterBinding {
    /// A keyword argument: the environment is made anew when it changes.
    Constructor,
    /// An attribute of the unwrapped environment, set before each reset.
    Attribute,
    /// An entry of `reset`'s `options`. An episode that begins in a state is reset with them first.
    Option,
    /// Not at all: it is the price of a reward term.
    Price,
}

/// Methods of the environment, or of the outermost wrapper that has both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StateMethods {
    /// Takes nothing; gives a mapping with `positions`, `velocities` and `memory`, or one array.
    pub get: String,
    /// Takes the same: a mapping with arrays of these names, or one array, in the shapes that `get` gave. Gives the observation
    /// there, which then passes through the method `observation` of each wrapper around.
    pub set: String,
}

impl Default for StateMethods {
    fn default() -> Self {
        Self { get: "get_state".to_owned(), set: "set_state".to_owned() }
    }
}

/// What the environment says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Described {
    /// Numbers in an observation, flattened.
    pub observation_size: usize,
    /// Least value of each action component, flattened.
    pub action_low: Vec<f32>,
    /// Greatest value of each action component.
    pub action_high: Vec<f32>,
    /// Simulated seconds between two actions.
    pub control_step: f64,
    /// Versions of Python, NumPy, Gymnasium and the target's packages, and hashes of source files: of the module that the target
    /// names, of those in which it, the environment, its wrappers and their base classes are written, and of `files`. They are
    /// part of every result's key. What these import besides is not.
    pub versions: String,
}

impl Default for PythonConfig {
    fn default() -> Self {
        Self {
            target: "Pendulum-v1".to_owned(),
            kwargs: serde_json::Map::new(),
            files: BTreeMap::new(),
            robot: String::new(),
            control_step: None,
            reward_terms: Vec::new(),
            task_parameters: Vec::new(),
            reward_floor: -1000.0,
            state: None,
            described: None,
        }
    }
}

impl PythonConfig {
    /// The spec, given what the environment says.
    pub fn spec_with(&self, described: &Described) -> SimulatorSpec {
        let robot = if self.robot.is_empty() { &self.target } else { &self.robot };
        let weight = |term: &InfoTerm| match &term.parameter {
            Some(name) => Weight::Parameter(name.clone()),
            None => Weight::Constant(term.weight.unwrap_or(1.0)),
        };
        let mut reward_terms: Vec<RewardTerm> = self
            .reward_terms
            .iter()
            .map(|term| RewardTerm { name: term.name.clone(), weight: weight(term) })
            .collect();
        if reward_terms.is_empty() {
            reward_terms.push(RewardTerm { name: "reward".to_owned(), weight: Weight::Constant(1.0) });
        }
        let parameter = |p: &PythonParameter| TaskParameter {
            name: p.name.clone(),
            default: p.default,
            low: p.low,
            high: p.high,
            effect: if p.binding == ParameterBinding::Price { Effect::Reward } else { Effect::Dynamics },
        };
        SimulatorSpec {
            robot: robot.clone(),
            observation_size: described.observation_size,
            action_low: described.action_low.clone(),
            action_high: described.action_high.clone(),
            control_step: described.control_step,
            reward_terms,
            task_parameters: self.task_parameters.iter().map(parameter).collect(),
            reward_floor: self.reward_floor,
            capabilities: Capabilities { settable_state: self.state.is_some() },
        }
    }

    fn validate_terms(&self, faults: &mut Faults) {
        for (i, term) in self.reward_terms.iter().enumerate() {
            faults.within(&format!("reward_terms[{i}]"), |faults| {
                faults.check(term.weight.is_some() != term.parameter.is_some(), "", || {
                    "expected either `weight` or `parameter`".to_owned()
                });
                if let Some(name) = &term.parameter {
                    let known = self.task_parameters.iter().any(|p| p.name == *name);
                    faults.check(known, "parameter", || format!("`{name}` is none of `task_parameters`"));
                }
                let again = self.reward_terms[..i].iter().any(|other| other.name == term.name);
                faults.check(!again, "name", || format!("`{}` is there twice", term.name));
            });
        }
        for (i, parameter) in self.task_parameters.iter().enumerate() {
            faults.within(&format!("task_parameters[{i}]"), |faults| {
                let PythonParameter { name, default, low, high, binding } = parameter;
                let sensible = low.is_finite() && high.is_finite() && low <= default && default <= high;
                faults.check(sensible, "", || {
                    format!("expected low <= default <= high, got {low}, {default}, {high}")
                });
                let priced = self.reward_terms.iter().any(|t| t.parameter.as_ref() == Some(name));
                faults.check(*binding != ParameterBinding::Price || priced, "binding", || {
                    format!("`{name}` is the price of no reward term")
                });
            });
        }
    }
}

#[typetag::serde(name = "python")]
impl SimulatorConfig for PythonConfig {
    fn embed_files(&mut self, folder: &Path, faults: &mut Faults) {
        files::embed(&mut self.files, folder, faults);
    }

    fn validate(&self, faults: &mut Faults) {
        faults.check(!self.target.is_empty(), "target", || {
            "expected a Gymnasium id or `module:callable`, got \"\"".to_owned()
        });
        faults.check(self.reward_floor.is_finite(), "reward_floor", || {
            format!("expected a finite number, got {}", self.reward_floor)
        });
        if let Some(step) = self.control_step {
            faults.check(step.is_finite() && step > 0.0, "control_step", || {
                format!("expected a positive number of seconds, got {step}")
            });
        }
        files::validate(&self.files, &self.kwargs, faults);
        self.validate_terms(faults);
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        let described = self
            .described
            .as_ref()
            .ok_or_else(|| BuildError::Code(format!("`{}` has not been asked what it is", self.target)))?;
        Ok(self.spec_with(described))
    }

    fn engine(&self) -> Engine {
        let versions = self.described.as_ref().map_or("unknown", |described| &described.versions);
        Engine { name: super::engine_name(&self.target), version: versions.to_owned() }
    }

    fn hosted(&self) -> Option<&dyn Hosted> {
        Some(self)
    }

    fn hosted_mut(&mut self) -> Option<&mut dyn Hosted> {
        Some(self)
    }

    #[cfg(feature = "python")]
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        Ok(Box::new(super::simulator::PythonSimulator::new(self)?))
    }

    #[cfg(not(feature = "python"))]
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        Err(super::missing())
    }
}

impl Hosted for PythonConfig {
    fn worker(&self) -> WorkerProgram {
        super::WORKER
    }

    fn describe(&self) -> Result<Vec<u8>, BuildError> {
        super::describe("environment", self)
    }

    fn accept_description(&mut self, description: &[u8]) -> Result<(), String> {
        let described = serde_json::from_slice(description).map_err(|error| error.to_string())?;
        self.described = Some(described);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn faults(text: &str) -> Vec<String> {
        let config: PythonConfig = serde_json::from_str(text).unwrap();
        let mut faults = Faults::new();
        config.validate(&mut faults);
        faults.into_found().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn slips_are_named() {
        assert_eq!(faults("{}"), Vec::<String>::new());
        let found = faults(r#"{"target": "", "control_step": 0, "reward_terms": [{"name": "a"}]}"#);
        assert_eq!(found.len(), 3, "{found:?}");
        let found = faults(
            r#"{"reward_terms": [{"name": "a", "parameter": "p"}, {"name": "a", "weight": 1.0}],
                "task_parameters": [{"name": "q", "default": 3, "low": 0, "high": 1, "binding": "price"}]}"#,
        );
        assert_eq!(found.len(), 4, "{found:?}");
    }

    #[test]
    fn a_description_makes_the_spec() {
        let mut config: PythonConfig = serde_json::from_str(
            r#"{"target": "m:E", "reward_terms": [{"name": "work", "parameter": "price"}],
                "task_parameters": [{"name": "price", "default": -1, "low": -2, "high": 0, "binding": "price"}]}"#,
        )
        .unwrap();
        assert!(config.spec().is_err());
        let described = Described {
            observation_size: 3,
            action_low: vec![-2.0],
            action_high: vec![2.0],
            control_step: 0.05,
            versions: "python 3.11".to_owned(),
        };
        config.accept_description(&serde_json::to_vec(&described).unwrap()).unwrap();
        let spec = config.spec().unwrap();
        assert_eq!((spec.robot.as_str(), spec.observation_size, spec.action_size()), ("m:E", 3, 1));
        assert_eq!(spec.prices(&elo_core::task::Task::new([("price", -1.5)])), [-1.5]);
        assert_eq!(spec.task_parameters[0].effect, Effect::Reward);
        assert_eq!(config.engine().version, "python 3.11");
    }
}
