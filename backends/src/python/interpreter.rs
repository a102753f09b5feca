//! Calls into the modules `elo._bridge.*` of the Python package, which know users' code.

use std::fmt::Debug;

use elo_core::simulator::BuildError;
use numpy::{Element, PyArray1, PyArrayMethods as _};
use pyo3::prelude::*;

use super::{interruption, watchdog};

/// The `Bridge` of the module `elo._bridge.NAME`, made of a config.
pub fn bridge<'py>(
    py: Python<'py>,
    name: &str,
    config: &impl serde::Serialize,
) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(config).expect("a config is plain data");
    watchdog::watch();
    py.import(format!("elo._bridge.{name}"))?.getattr("Bridge")?.call1((text,))
}

/// The [`bridge`] of a plugin whose versions are known from when the config was read: they must still be what they were.
///
/// # Errors
/// A bridge that cannot be made, and [`unchanged`].
pub fn known_bridge<'py>(
    py: Python<'py>,
    name: &str,
    config: &impl serde::Serialize,
    target: &str,
    described: Option<&String>,
) -> Result<Bound<'py, PyAny>, BuildError> {
    let bridge = interruption::asked(|_| bridge(py, name, config)).map_err(refused)?;
    if let Some(then) = described {
        let now = bridge.call_method0("versions").and_then(|versions| versions.extract());
        unchanged(target, &now.map_err(refused)?, then)?;
    }
    Ok(bridge)
}

/// Refuses code of users that says something else of itself (`now`) than it did when the config was read (`then`): its results
/// would be stored under the keys of the other code.
///
/// # Errors
/// [`BuildError::Code`].
pub fn unchanged<T: PartialEq + Debug>(target: &str, now: &T, then: &T) -> Result<(), BuildError> {
    if now == then {
        return Ok(());
    }
    let (now, then) = (format!("{now:#?}"), format!("{then:#?}"));
    let field = |line: &str| line.trim().trim_end_matches(',').to_owned();
    let differ = now.lines().zip(then.lines()).filter(|(now, then)| now != then);
    let differ: Vec<String> =
        differ.map(|(now, then)| format!("{} instead of {}", field(now), field(then))).collect();
    let differ = differ.join(", ");
    Err(BuildError::Code(format!(
        "`{target}` is not what it was when the config was read: {differ}; run again to use it as it is now"
    )))
}

/// Closes what `bridge` has made, if that can be closed. Its errors are nobody's: whoever had it is done with it.
pub fn close(bridge: &Bound<'_, PyAny>) {
    let py = bridge.py();
    if bridge.hasattr("close").unwrap_or(false) {
        let _call = watchdog::Call::begin();
        if let Err(error) = bridge.call_method0("close") {
            interruption::note(&error, py);
        }
    }
}

/// An array of a bridge that both sides see.
pub struct Shared<T>(Py<PyArray1<T>>);

impl<T: Element + Copy> Shared<T> {
    /// The attribute `name` of `bridge`.
    pub fn of(bridge: &Bound<'_, PyAny>, name: &str) -> PyResult<Self> {
        Ok(Self(bridge.getattr(name)?.cast_into::<PyArray1<T>>()?.unbind()))
    }

    pub fn len(&self, py: Python<'_>) -> PyResult<usize> {
        self.0.bind(py).len()
    }

    /// Copies what Python wrote into `to`, which has its length.
    pub fn read(&self, py: Python<'_>, to: &mut [T]) -> PyResult<()> {
        // SAFETY: this thread holds Python's lock, by which all Python code writes, and runs none before the slice is gone. Slices are
        // made here and in `write` alone, and each is gone before the next is made.
        to.copy_from_slice(unsafe { self.0.bind(py).as_slice() }?);
        Ok(())
    }

    /// Copies `from`, which has its length, to where Python reads it.
    pub fn write(&self, py: Python<'_>, from: &[T]) -> PyResult<()> {
        // SAFETY: as in `read`.
        unsafe { self.0.bind(py).as_slice_mut() }?.copy_from_slice(from);
        Ok(())
    }
}

/// An exception with its traceback; those of our own kind are for users and need none. One that is no error goes on its way too.
pub fn told(error: &PyErr) -> String {
    Python::attach(|py| {
        interruption::note(error, py);
        let formatted = || -> PyResult<String> {
            py.import("elo._bridge")?
                .getattr("tell")?
                .call1((error.value(py), error.traceback(py)))?
                .extract()
        };
        formatted().unwrap_or_else(|_| error.to_string())
    })
}

/// An exception while something was made.
pub fn refused(error: PyErr) -> BuildError {
    BuildError::Code(told(&error))
}
