//! Teachers that were trained elsewhere: a callable in Python gives their policies.

use std::collections::BTreeMap;
use std::path::Path;

use elo_core::fault::Faults;
use elo_core::hosted::{Hosted, WorkerProgram};
use elo_core::policy::{Lesson, Monitor, Snapshot, TeacherConfig, TeacherPolicy, TrainError, Trained};
use elo_core::seed::Seed;
use elo_core::simulator::BuildError;
use elo_core::spec::SimulatorSpec;
use elo_core::task::Task;
use elo_core::tensors::{TensorError, Tensors};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::files;

/// Policies that a callable in Python gives, for example networks that another program has trained.
///
/// The callable is asked as `callable(task=…, seed=…, **files, **kwargs)`: `task` maps the task's parameters to numbers, `seed` is an
/// integer of the teacher's own. Each unit of work in which the policy acts asks anew, several times a run in each worker, so a
/// callable that reads much should keep it, as by `functools.cache`. It gives the policy, called as
/// `policy(observation, noise)` with an array of float32 and `None` for the policy's mean action or a
/// `numpy.random.Generator` for a sample; it gives an array of actions. The same arguments must give the same policy, and
/// the same observation and generator the same action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PythonTeacherConfig {
    /// `module:callable`. It is code that is executed: name only what you trust.
    pub target: String,
    /// Files that the callable is given as keyword arguments, by their paths; relative to the config file here. What they
    /// hold is part of every result's key.
    pub files: BTreeMap<String, String>,
    /// Other keyword arguments.
    pub kwargs: serde_json::Map<String, serde_json::Value>,
    /// Versions of what the policy depends on, and hashes of its source and files. Written by the program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub described: Option<String>,
}

impl Default for PythonTeacherConfig {
    fn default() -> Self {
        Self {
            target: "teacher:load".to_owned(),
            files: BTreeMap::new(),
            kwargs: serde_json::Map::new(),
            described: None,
        }
    }
}

/// What a policy is made of, beside the config.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Call {
    pub task: Task,
    pub seed: u64,
}

/// The tensor in which a stored teacher keeps its [`Call`]: the bytes of its JSON, a number each.
const CALL: &str = "call";

/// The tensor that says for which robot: its numbers of observations and actions.
const ROBOT: &str = "robot";

impl Call {
    fn to_tensors(&self, spec: &SimulatorSpec) -> Tensors {
        let text = serde_json::to_string(self).expect("plain data");
        let mut tensors = Tensors::default();
        tensors.insert(CALL, &[text.len()], text.bytes().map(f32::from).collect());
        tensors.insert(ROBOT, &[2], sizes(spec));
        tensors
    }

    fn of(tensors: &Tensors, spec: &SimulatorSpec) -> Result<Self, TensorError> {
        let [found, expected] = [tensors.get_shaped(ROBOT, &[2])?, &sizes(spec)];
        if found != expected {
            let why = format!(
                "the teacher is of another robot: {found:?} observations and actions, expected {expected:?}"
            );
            return Err(TensorError::Unmade(why));
        }
        let numbers = tensors.get_shaped(CALL, &[tensors.get(CALL)?.data.len()])?;
        let bytes: Option<Vec<u8>> =
            numbers.iter().map(|x| (*x as u8 as f32 == *x).then_some(*x as u8)).collect();
        let read = bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        read.ok_or_else(|| TensorError::Malformed(format!("`{CALL}` holds no task and seed")))
    }
}

fn sizes(spec: &SimulatorSpec) -> Vec<f32> {
    vec![spec.observation_size as f32, spec.action_size() as f32]
}

#[typetag::serde(name = "python")]
impl TeacherConfig for PythonTeacherConfig {
    fn embed_files(&mut self, folder: &Path, faults: &mut Faults) {
        files::embed(&mut self.files, folder, faults);
    }

    fn validate(&self, faults: &mut Faults) {
        super::validate_target(&self.target, faults);
        files::validate(&self.files, &self.kwargs, faults);
        for name in self.files.keys().chain(self.kwargs.keys()) {
            let reserved = name == "task" || name == "seed";
            faults.check(!reserved, "", || format!("`{name}` is an argument that the program gives"));
        }
    }

    fn simulator_steps(&self) -> u64 {
        0
    }

    fn train(&self, lesson: &Lesson<'_>, monitor: &mut dyn Monitor) -> Result<Trained, TrainError> {
        monitor.progress(0, self.simulator_steps())?;
        let call = Call { task: lesson.task.clone(), seed: lesson.seed.number() };
        let spec = lesson.simulator.spec()?;
        let policy = call.to_tensors(&spec);
        self.load(&policy, &spec).map_err(|error| TrainError::Other(error.to_string()))?;
        let snapshots = vec![Snapshot { steps: 0, policy: policy.clone() }];
        Ok(Trained { policy, snapshots, curve: Vec::new() })
    }

    fn untrained(&self, _: &SimulatorSpec, _: &Seed) -> Option<Tensors> {
        None
    }

    #[cfg(feature = "python")]
    fn load(&self, tensors: &Tensors, spec: &SimulatorSpec) -> Result<Box<dyn TeacherPolicy>, TensorError> {
        let policy = super::policy::PythonPolicy::new(self, &Call::of(tensors, spec)?, spec);
        Ok(Box::new(policy.map_err(|error| TensorError::Unmade(error.to_string()))?))
    }

    #[cfg(not(feature = "python"))]
    fn load(&self, tensors: &Tensors, spec: &SimulatorSpec) -> Result<Box<dyn TeacherPolicy>, TensorError> {
        Call::of(tensors, spec)?;
        Err(TensorError::Unmade(super::missing().to_string()))
    }

    fn hosted(&self) -> Option<&dyn Hosted> {
        Some(self)
    }

    fn hosted_mut(&mut self) -> Option<&mut dyn Hosted> {
        Some(self)
    }
}

impl Hosted for PythonTeacherConfig {
    fn worker(&self) -> WorkerProgram {
        super::WORKER
    }

    fn describe(&self) -> Result<Vec<u8>, BuildError> {
        super::describe("teacher", self)
    }

    fn accept_description(&mut self, description: &[u8]) -> Result<(), String> {
        super::accept(&mut self.described, description)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use elo_core::conformance::point_mass::PointMassConfig;

    use super::*;

    #[test]
    fn what_a_policy_is_made_of_survives_as_tensors() {
        let call = Call { task: Task::new([("price", -1.25)]), seed: u64::MAX };
        let spec = PointMassConfig::default().description();
        let tensors = Tensors::decode(&call.to_tensors(&spec).encode()).unwrap();
        let back = Call::of(&tensors, &spec).unwrap();
        assert_eq!((back.task, back.seed), (call.task, call.seed));
        assert!(Call::of(&Tensors::default(), &spec).is_err());
        let mut other = spec.clone();
        other.observation_size += 1;
        assert!(Call::of(&tensors, &other).unwrap_err().to_string().contains("another robot"));
    }

    #[test]
    fn slips_are_named() {
        let text = r#"{"target": "teacher", "kwargs": {"seed": 1}, "files": {"model": "gone.zip"}}"#;
        let mut config: PythonTeacherConfig = serde_json::from_str(text).unwrap();
        let mut faults = Faults::new();
        config.embed_files(Path::new("/nowhere"), &mut faults);
        config.validate(&mut faults);
        let found: Vec<String> = faults.into_found().iter().map(ToString::to_string).collect();
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[0].contains("`files.model`: there is no file /nowhere/gone.zip"), "{found:?}");
        assert!(found[1].contains("module:callable") && found[2].contains("`seed`"), "{found:?}");
    }
}
