//! The extension module `elo._elo`: what the package `elo` needs of this project's Rust. Its Python side, with the
//! documentation for users, is in `elo/`.

use elo_core::plugin::Plugin;
use pyo3::prelude::*;

mod conformance;
mod options;
mod simulators;

/// Everything that configs and option sets may name inside an interpreter.
pub(crate) const PLUGINS: &[&[Plugin]] =
    &[elo_core::plugin::PLUGINS, elo_backends::PLUGINS, elo_learners::PLUGINS];

#[pymodule]
mod _elo {
    use pyo3::exceptions::PySystemExit;
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::conformance::conformance;
    #[pymodule_export]
    use crate::options::Options;
    #[pymodule_export]
    use crate::simulators::Simulator;

    /// Version, processor class and sources of this build, which the program `elo` must share.
    #[pyfunction]
    fn fingerprint() -> String {
        elo_cli::build()
    }

    /// Serves units on this process's pipes until the other side closes them.
    #[pyfunction]
    fn serve(py: Python<'_>, engine: String) -> PyResult<()> {
        let code = py.detach(|| elo_cli::worker_main_with(&engine, crate::PLUGINS));
        if code == std::process::ExitCode::SUCCESS { Ok(()) } else { Err(PySystemExit::new_err(1)) }
    }
}
