//! A teacher's policy in Python.

use std::sync::Mutex;

use elo_core::policy::TeacherPolicy;
use elo_core::seed::Stream;
use elo_core::simulator::BuildError;
use elo_core::spec::SimulatorSpec;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use rand::RngExt as _;

use super::interpreter::{known_bridge, refused, told};
use super::interruption::asked;
use super::teacher::{Call, PythonTeacherConfig};
use super::watchdog::Call as Watched;

/// See the [module](self).
pub struct PythonPolicy {
    bridge: Py<PyAny>,
    /// What the last action that could not be had failed with.
    trouble: Mutex<Option<String>>,
}

impl PythonPolicy {
    /// Asks the callable of `config` for the policy.
    ///
    /// # Errors
    /// A target that cannot be imported or is not what it was when the config was read, an exception, or something that is no
    /// policy for this robot.
    pub fn new(config: &PythonTeacherConfig, call: &Call, spec: &SimulatorSpec) -> Result<Self, BuildError> {
        let policy = Python::attach(|py| {
            let (target, described) = (&config.target, config.described.as_ref());
            let bridge = known_bridge(py, "teacher", config, target, described)?;
            let call = serde_json::to_string(call).expect("plain data");
            let policy = bridge.call_method1("policy", (call, spec.observation_size, spec.action_size()));
            Ok(policy.map_err(refused)?.unbind())
        });
        Ok(Self { bridge: policy?, trouble: Mutex::new(None) })
    }
}

impl TeacherPolicy for PythonPolicy {
    fn act(&self, observation: &[f32], noise: Option<&mut Stream>, action: &mut [f32]) {
        let seed = noise.map(|noise| noise.random::<u64>());
        let acted = asked(|py| -> PyResult<()> {
            let _call = Watched::begin();
            let given = self.bridge.bind(py).call1((PyArray1::from_slice(py, observation), seed))?;
            action.copy_from_slice(given.extract::<PyReadonlyArray1<'_, f32>>()?.as_slice()?);
            Ok(())
        });
        if let Err(error) = acted {
            action.fill(f32::NAN);
            *self.trouble.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = Some(told(&error));
        }
    }

    fn trouble(&self) -> Option<String> {
        self.trouble.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take()
    }
}
