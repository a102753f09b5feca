//! Code of users in Python: environments behind Gymnasium's interface, engines that move a robot's bodies, teachers and
//! metrics.
//!
//! The configs are always compiled. What runs needs the feature `python` and an interpreter: the worker
//! `python -m elo.worker`, which the package in `python/` brings. There the modules `python/elo/_bridge/` find the user's
//! code, check what it gives and copy it into arrays that this side reads.
//!
//! All of this is code that is executed with the user's rights: name only such as you trust.

use elo_core::fault::Faults;
use elo_core::hosted::WorkerProgram;
use elo_core::simulator::BuildError;

#[cfg(feature = "python")]
mod body;
mod body_config;
mod config;
mod files;
#[cfg(feature = "python")]
mod interpreter;
#[cfg(feature = "python")]
mod interruption;
mod metric;
#[cfg(feature = "python")]
mod policy;
#[cfg(feature = "python")]
mod scores;
#[cfg(feature = "python")]
mod simulator;
mod teacher;
#[cfg(feature = "python")]
mod watchdog;

#[cfg(feature = "python")]
pub use body::PythonBody;
pub use body_config::PythonBodyConfig;
pub use config::{Described, InfoTerm, ParameterBinding, PythonConfig, PythonParameter, StateMethods};
#[cfg(feature = "python")]
pub use interruption::passing;
pub use metric::PythonMetricConfig;
#[cfg(feature = "python")]
pub use simulator::PythonSimulator;
pub use teacher::PythonTeacherConfig;

/// Where all of it runs.
const WORKER: WorkerProgram = WorkerProgram::Interpreter("python");

#[cfg(not(feature = "python"))]
fn missing() -> BuildError {
    BuildError::MissingEngine {
        engine: "Python".to_owned(),
        remedy:
            "what is written in Python runs in `python -m elo.worker`; install it with `pip install './python[gym]'`"
                .to_owned(),
    }
}

/// What a simulator in Python is called beside other engines: its id, or the module that it comes from.
fn engine_name(target: &str) -> String {
    format!("python:{}", target.split(':').next().unwrap_or_default())
}

fn validate_target(target: &str, faults: &mut Faults) {
    faults.check(target.contains(':'), "target", || format!("expected `module:callable`, got {target:?}"));
}

/// What the bridge of a user's code says of it: versions of what its results depend on, or more.
#[cfg(feature = "python")]
fn describe(bridge: &str, config: &impl serde::Serialize) -> Result<Vec<u8>, BuildError> {
    use pyo3::prelude::*;
    let text = interruption::asked(|py| {
        let bridge = interpreter::bridge(py, bridge, config)?;
        let text = bridge.call_method0("describe").and_then(|text| text.extract::<String>());
        interpreter::close(&bridge);
        text
    });
    text.map(String::into_bytes).map_err(interpreter::refused)
}

#[cfg(not(feature = "python"))]
fn describe(_: &str, _: &impl serde::Serialize) -> Result<Vec<u8>, BuildError> {
    Err(missing())
}

/// Takes up the versions that [`describe`] gave.
fn accept(described: &mut Option<String>, description: &[u8]) -> Result<(), String> {
    *described = Some(String::from_utf8_lossy(description).into_owned());
    Ok(())
}
