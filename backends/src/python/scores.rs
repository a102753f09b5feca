//! Scores from Python: samples as one array.

use elo_core::metric::Reference;
use numpy::{PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;

use super::interpreter::{known_bridge, told};
use super::metric::PythonMetricConfig;

/// The scores of `samples`, which are of one size.
///
/// # Errors
/// An exception, a function that is not what it was when the config was read, or something else than one number a sample.
pub fn scores(
    config: &PythonMetricConfig,
    samples: &[Vec<f64>],
    reference: &Reference,
) -> Result<Vec<f64>, String> {
    Python::attach(|py| {
        let (target, described) = (&config.target, config.described.as_ref());
        let bridge =
            known_bridge(py, "metric", config, target, described).map_err(|error| error.to_string())?;
        let returns = PyArray2::from_vec2(py, samples).map_err(|error| error.to_string())?;
        scored(&bridge, &returns, reference).map_err(|error| told(&error))
    })
}

fn scored(
    bridge: &Bound<'_, PyAny>,
    returns: &Bound<'_, PyArray2<f64>>,
    reference: &Reference,
) -> PyResult<Vec<f64>> {
    let given = bridge.call_method1("scores", (returns, reference.mean, reference.standard_deviation))?;
    Ok(given.extract::<PyReadonlyArray1<'_, f64>>()?.as_slice()?.to_vec())
}
