//! What every config keeps, whatever it configures: its fields survive the formats that runs store them in.

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::check::Violation;
use super::compare::granted;
use crate::fault::Faults;

/// Writes `config` as JSON and as TOML, reads both back, and asks that each writes the same JSON again. Gives what was
/// read from each.
pub(super) fn round_trip<C>(config: &C) -> Result<[Box<C>; 2], Violation>
where
    C: ?Sized + Serialize,
    Box<C>: DeserializeOwned,
{
    let json = granted("the config as JSON", serde_json::to_string(config))?;
    let from_json: Box<C> = granted("reading the config's JSON", serde_json::from_str(&json))?;
    let toml = granted("the config as TOML", toml::to_string(config))?;
    let from_toml: Box<C> = granted("reading the config's TOML", toml::from_str(&toml))?;
    for (format, back) in [("JSON", &from_json), ("TOML", &from_toml)] {
        let again = granted("the config as JSON", serde_json::to_string(back.as_ref()))?;
        if again != json {
            return Err(Violation::new(format!("the config after {format}"), json, again));
        }
    }
    Ok([from_json, from_toml])
}

/// Asks that `validate` finds nothing.
pub(super) fn faultless(validate: impl FnOnce(&mut Faults)) -> Result<(), Violation> {
    let mut faults = Faults::new();
    validate(&mut faults);
    match faults.found().first() {
        None => Ok(()),
        Some(fault) => Err(Violation::new("the config under test", "no faults", fault)),
    }
}

/// Asks for a text that is not blank and fits a line.
pub(super) fn one_line(what: &str, text: &str) -> Result<(), Violation> {
    if text.trim().is_empty() || text.contains(['\n', '\r']) {
        return Err(Violation::new(what, "one line of text", format!("{text:?}")));
    }
    Ok(())
}
