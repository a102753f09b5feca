//! Option sets, for Python programs.

use std::path::PathBuf;

use elo_core::policy::OptionPolicy;
use elo_core::seed::Seed;
use elo_core::spec::SimulatorSpec;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;

/// The options of one set, in the order of its manifest. `elo.OptionSet` wraps it.
#[pyclass(module = "elo._elo", frozen)]
pub struct Options {
    manifest: String,
    spec: SimulatorSpec,
    policies: Vec<Box<dyn OptionPolicy>>,
}

fn refused(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

impl Options {
    fn option(&self, index: usize) -> PyResult<&dyn OptionPolicy> {
        let option = self.policies.get(index).map(AsRef::as_ref);
        option.ok_or_else(|| {
            PyIndexError::new_err(format!("option {index} of a set of {}", self.policies.len()))
        })
    }

    fn observation<'a>(&self, array: &'a PyReadonlyArray1<'_, f32>) -> PyResult<&'a [f32]> {
        let observation = array.as_slice().map_err(refused)?;
        let expected = self.spec.observation_size;
        if observation.len() == expected {
            return Ok(observation);
        }
        let got = observation.len();
        Err(PyValueError::new_err(format!(
            "the observation has {got} numbers, the set's robot has {expected}"
        )))
    }
}

#[pymethods]
impl Options {
    /// Reads the set in a folder.
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let elo_learners::Options { manifest, policies } = elo_learners::load(&path).map_err(refused)?;
        let text = serde_json::to_string(&manifest).expect("a manifest is plain data");
        Ok(Self { manifest: text, spec: manifest.spec, policies })
    }

    /// The manifest, as JSON.
    fn manifest(&self) -> &str {
        &self.manifest
    }

    fn __len__(&self) -> usize {
        self.policies.len()
    }

    /// What an option does at `observation`; `when` is its number and how many of its steps it has run. `seed` feeds options that draw.
    fn act<'py>(
        &self,
        py: Python<'py>,
        when: (usize, usize),
        observation: PyReadonlyArray1<'py, f32>,
        seed: u64,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let ((option, elapsed), mut action) = (when, vec![0.0; self.spec.action_size()]);
        let mut noise = Seed::root(seed).stream();
        self.option(option)?.act(self.observation(&observation)?, elapsed, &mut noise, &mut action);
        Ok(action.into_pyarray(py))
    }

    /// The probability that an option ends before its next action.
    fn termination(&self, when: (usize, usize), observation: PyReadonlyArray1<'_, f32>) -> PyResult<f64> {
        let (option, elapsed) = when;
        Ok(self.option(option)?.termination(self.observation(&observation)?, elapsed))
    }

    /// How much each option wants to begin at `observation`.
    fn interests(&self, observation: PyReadonlyArray1<'_, f32>) -> PyResult<Vec<f32>> {
        let observation = self.observation(&observation)?;
        Ok(self.policies.iter().map(|option| option.interest(observation)).collect())
    }
}
