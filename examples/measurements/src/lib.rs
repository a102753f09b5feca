//! What the programs of this package share. Each measures something of the robots through the library and prints CSV.

use std::error::Error;

use elo_core::simulator::SimulatorConfig;
use serde_json::{Value, json};

/// Whatever stops a measurement.
pub type Failure = Box<dyn Error + Send + Sync>;

/// A plugin's config: its kind and its other fields.
///
/// # Errors
/// An unknown kind or field, or a value of another type.
pub fn plugin<T: serde::de::DeserializeOwned>(kind: &str, fields: &[(&str, Value)]) -> Result<T, Failure> {
    // Plugins are found by their kind, so their crates must be linked.
    let _linked = [elo_backends::PLUGINS, elo_learners::PLUGINS];
    let mut table = json!({ "kind": kind });
    for (field, value) in fields {
        table[*field] = value.clone();
    }
    Ok(serde_json::from_value(table)?)
}

/// A robot of ours in an engine.
///
/// # Errors
/// See [`plugin`].
pub fn robot(engine: &str, robot: &str) -> Result<Box<dyn SimulatorConfig>, Failure> {
    plugin(engine, &[("robot", robot.into())])
}
