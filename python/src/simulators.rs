//! This project's simulators, for Python programs.

use std::path::Path;

use elo_backends::python::passing;
use elo_core::config;
use elo_core::fault::{Fault, Faults};
use elo_core::hosted::Hosted;
use elo_core::simulator::{End, Simulator as CoreSimulator, SimulatorConfig, Start, State};
use elo_core::task::Task;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;

/// One simulator, from its config as JSON. `elo.gym` wraps it.
#[pyclass(module = "elo._elo", unsendable)]
pub struct Simulator {
    inner: Box<dyn CoreSimulator>,
}

type Step<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<f64>>, bool, bool);

fn failed(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

pub fn refused(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A plugin of any role, from its config as JSON, as it stands there.
pub fn plugin<T: DeserializeOwned + JsonSchema>(text: &str) -> PyResult<T> {
    let value = serde_json::from_str(text).map_err(refused)?;
    config::from_value(value, crate::PLUGINS).map_err(|faults| refused(lines(&faults)))
}

/// A fault a line.
fn lines(faults: &[Fault]) -> String {
    faults.iter().map(Fault::to_string).collect::<Vec<_>>().join("\n")
}

/// A config of a simulator, complete: it has the files that it names, by paths that are relative to the working directory, and one whose simulator
/// only its environment knows has asked it.
pub fn simulator(text: &str) -> PyResult<Box<dyn SimulatorConfig>> {
    let mut config: Box<dyn SimulatorConfig> = plugin(text)?;
    let mut faults = Faults::new();
    config.embed_files(Path::new(""), &mut faults);
    config.validate(&mut faults);
    if !faults.found().is_empty() {
        return Err(refused(lines(faults.found())));
    }
    config.hosted_mut().map_or(Ok(()), described)?;
    Ok(config)
}

/// Tells a plugin what it is, as its worker would.
pub fn described(hosted: &mut dyn Hosted) -> PyResult<()> {
    if !hosted.needs_description() {
        return Ok(());
    }
    let description = hosted.describe().map_err(refused)?;
    hosted.accept_description(&description).map_err(refused)
}

#[pymethods]
impl Simulator {
    #[new]
    fn new(config_json: &str) -> PyResult<Self> {
        passing(|| Ok(Self { inner: simulator(config_json)?.build().map_err(failed)? }))
    }

    /// The spec, as JSON.
    fn spec(&self) -> String {
        serde_json::to_string(self.inner.spec()).expect("a spec is plain data")
    }

    /// What a task, as JSON, pays for one unit of each reward term.
    fn prices(&self, task: &str) -> PyResult<Vec<f64>> {
        let task: Task = serde_json::from_str(task).map_err(refused)?;
        match self.inner.spec().task_faults(&task).first() {
            Some(fault) => Err(refused(fault)),
            None => Ok(self.inner.spec().prices(&task)),
        }
    }

    /// Begins an episode; `start` is `{"seed": …}` or `{"state": …}` as JSON. Gives the observation.
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        task: &str,
        start: &str,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let task: Task = serde_json::from_str(task).map_err(refused)?;
        let start: Start = serde_json::from_str(start).map_err(refused)?;
        let mut observation = vec![0.0; self.inner.spec().observation_size];
        passing(|| self.inner.reset(&task, &start, &mut observation).map_err(refused))?;
        Ok(observation.into_pyarray(py))
    }

    /// One control step: observation, reward terms, terminated, truncated.
    fn step<'py>(&mut self, py: Python<'py>, action: PyReadonlyArray1<'py, f32>) -> PyResult<Step<'py>> {
        let mut observation = vec![0.0; self.inner.spec().observation_size];
        let mut terms = vec![0.0; self.inner.spec().reward_terms.len()];
        let action = action.as_slice().map_err(refused)?;
        let end = passing(|| self.inner.step(action, &mut observation, &mut terms).map_err(failed))?;
        let (terminated, truncated) = (end == End::Terminated, end == End::Truncated);
        Ok((observation.into_pyarray(py), terms.into_pyarray(py), terminated, truncated))
    }

    /// The present state, as JSON.
    fn state(&self) -> PyResult<String> {
        let state: State = passing(|| self.inner.state().map_err(failed))?;
        Ok(serde_json::to_string(&state).expect("a state is plain data"))
    }
}
