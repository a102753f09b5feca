//! Scores from Python: samples as one array.

use elo_core::metric::Reference;
use numpy::{PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;

use super::interpreter::{bridge, told};
use super::metric::PythonMetricConfig;

/// The scores of `samples`, which are of one size.
///
/// # Errors
/// An exception, or something else than one number a sample.
pub fn scores(
    config: &PythonMetricConfig,
    samples: &[Vec<f64>],
    reference: &Reference,
) -> Result<Vec<f64>, String> {
    Python::attach(|py| -> PyResult<Vec<f64>> {
        let bridge = bridge(py, "metric", config)?;
        let returns = PyArray2::from_vec2(py, samples)
            .map_err(|error| pyo3::exceptions::PyValueError::new_err(error.to_string()))?;
        let given = bridge.call_method1("scores", (returns, reference.mean, reference.standard_deviation))?;
        Ok(given.extract::<PyReadonlyArray1<'_, f64>>()?.as_slice()?.to_vec())
    })
    .map_err(|error| told(&error))
}
