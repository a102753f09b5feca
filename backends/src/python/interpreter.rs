//! Calls into the modules `elo._bridge.*` of the Python package, which know users' code.

use numpy::{Element, PyArray1};
use pyo3::prelude::*;

use elo_core::simulator::BuildError;

use super::watchdog::{self, Call};

/// The `Bridge` of the module `elo._bridge.NAME`, made of a config.
pub fn bridge<'py>(
    py: Python<'py>,
    name: &str,
    config: &impl serde::Serialize,
) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(config).expect("a config is plain data");
    watchdog::watch();
    let _call = Call::begin();
    py.import(format!("elo._bridge.{name}"))?.getattr("Bridge")?.call1((text,))
}

/// An array of a bridge that both sides see.
pub fn array<T: Element>(bridge: &Bound<'_, PyAny>, name: &str) -> PyResult<Py<PyArray1<T>>> {
    Ok(bridge.getattr(name)?.cast_into::<PyArray1<T>>()?.unbind())
}

/// An exception with its traceback; those of our own kind are for users and need none.
pub fn told(error: &PyErr) -> String {
    Python::attach(|py| {
        let formatted = || -> PyResult<String> {
            py.import("elo._bridge")?.getattr("tell")?.call1((error.value(py),))?.extract()
        };
        formatted().unwrap_or_else(|_| error.to_string())
    })
}

/// An exception while something was made.
pub fn refused(error: PyErr) -> BuildError {
    BuildError::Code(told(&error))
}
