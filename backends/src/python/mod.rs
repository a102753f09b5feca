//! Environments written in Python, behind Gymnasium's interface.
//!
//! The config is always compiled. The simulator needs the feature `python` and runs where an interpreter is: in the worker
//! `python -m elo.worker`, which the package in `python/` brings. There `python/elo/_bridge.py` builds the environment,
//! checks what it gives and copies it into arrays that this side reads.
//!
//! An environment is code of the user's that is executed with the user's rights: name only such as you trust.

mod config;
#[cfg(feature = "python")]
mod simulator;
#[cfg(feature = "python")]
mod watchdog;

pub use config::{Described, InfoTerm, ParameterBinding, PythonConfig, PythonParameter, StateMethods};
#[cfg(feature = "python")]
pub use simulator::PythonSimulator;
