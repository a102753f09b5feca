//! Exceptions that no program should take for an error, such as Ctrl-C's, on their way from Python code that is called here to the
//! Python code that called us.
//!
//! What lies between them knows errors as text. So such an exception is kept aside for [`passing`], whatever becomes of its text, and
//! nothing more is asked of Python on the way.

use std::cell::RefCell;

use pyo3::exceptions::PyException;
use pyo3::prelude::*;

thread_local! {
    /// Of the innermost [`passing`] of this thread. Python raises Ctrl-C's in the main thread alone, in which it was called.
    static AWAITED: RefCell<Awaited> = const { RefCell::new(Awaited::Nothing) };
}

enum Awaited {
    /// Nobody could raise it again: a worker, in which code of users may exit like any other failure.
    Nothing,
    Any,
    Came(PyErr),
}

/// Does `call`. Where code in Python under it raised what is no `Exception`, that is the result.
///
/// # Errors
/// That, or the error of `call`.
pub fn passing<T>(call: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
    let outer = AWAITED.replace(Awaited::Any);
    let done = call();
    match AWAITED.replace(outer) {
        Awaited::Came(error) => Err(error),
        Awaited::Nothing | Awaited::Any => done,
    }
}

/// Keeps `error` if it is to pass.
pub(super) fn note(error: &PyErr, py: Python<'_>) {
    AWAITED.with_borrow_mut(|awaited| {
        if matches!(awaited, Awaited::Any) && !error.is_instance_of::<PyException>(py) {
            *awaited = Awaited::Came(error.clone_ref(py));
        }
    });
}

/// Calls Python, unless something is passing already.
pub(super) fn asked<T>(call: impl FnOnce(Python<'_>) -> PyResult<T>) -> PyResult<T> {
    Python::attach(|py| {
        let came = AWAITED.with_borrow(|awaited| match awaited {
            Awaited::Came(error) => Some(error.clone_ref(py)),
            Awaited::Nothing | Awaited::Any => None,
        });
        came.map_or_else(|| call(py), Err)
    })
}
