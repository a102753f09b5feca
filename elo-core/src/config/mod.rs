//! Reading configurations: TOML text to a typed config, with every fault of the file found before anything
//! runs.
//!
//! [`read`] goes through four steps, and each sees the whole file:
//!
//! 1. `source`: TOML to a tree of values that remembers where each came from;
//! 2. `overrides`: `--set a.b=value` changes the tree;
//! 3. `check`: the tree is compared with the JSON Schema of the config, in which a field that holds a plugin
//!    stands for the schemas of all plugins of its role;
//! 4. serde makes the config, which has nothing left to complain about.
//!
//! The same schema writes commented examples ([`example`], [`example_root`]) and serves editors
//! ([`json_schema`]). What needs more than one field, or a simulator's spec, is checked afterwards by the
//! `validate` methods; their faults get their lines from [`Places::error`].

use std::path::Path;

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::fault::{Fault, Faults};
use crate::plugin::Plugin;

mod check;
mod error;
mod example;
mod expect;
#[cfg(test)]
mod fixture;
mod outline;
mod overrides;
mod schema;
mod source;

pub use error::{ConfigError, Finding, Place};
pub use example::{example, example_root};
pub use source::Places;

use schema::Document;
use source::Source;

/// A config and what came with it.
#[derive(Debug)]
pub struct Reading<T> {
    /// The config.
    pub config: T,
    /// What the user should be told though nothing is wrong: fields that an override of a `kind` made void.
    pub notices: Vec<String>,
    /// Where each field came from, for faults that are found later.
    pub places: Places,
}

/// Reads a config. `file` is only named in messages; `overrides` are `a.b=value`, applied in order.
///
/// `T` and everything in it must refuse unknown fields. A field that holds a plugin is a `Box<dyn
/// SimulatorConfig>` and so on; its kinds are those of `plugins`.
///
/// # Errors
/// Every fault of syntax, or else every fault of the overrides and of structure: unknown and missing fields,
/// unknown kinds, wrong types, values out of range. In the order of the file, those of overrides last.
pub fn read<T: DeserializeOwned + JsonSchema>(
    text: &str,
    file: &Path,
    overrides: &[String],
    plugins: &[&[Plugin]],
) -> Result<Reading<T>, ConfigError> {
    let mut source = Source::parse(text, file)?;
    let document = Document::of::<T>(plugins);
    let applied = overrides::apply(&document, &mut source, overrides);
    let mut faults = Faults::new();
    check::check(&document, &source.tree, &mut faults);
    let Source { tree, places, unusable: mut found } = source;
    found.extend(faults.into_found());
    let mut findings = places.locate(found);
    findings.extend(applied.findings);
    if !findings.is_empty() {
        return Err(places.error_of(findings));
    }
    match serde_json::from_value(tree) {
        Ok(config) => Ok(Reading { config, notices: applied.notices, places }),
        Err(error) => Err(places.error(vec![Fault { path: String::new(), message: error.to_string() }])),
    }
}

/// Makes a config of a value that comes from no file, such as one table that another program wrote.
///
/// # Errors
/// Every fault of structure, as [`read`] finds it.
pub fn from_value<T: DeserializeOwned + JsonSchema>(
    value: Value,
    plugins: &[&[Plugin]],
) -> Result<T, Vec<Fault>> {
    let mut faults = Faults::new();
    check::check(&Document::of::<T>(plugins), &value, &mut faults);
    if !faults.found().is_empty() {
        return Err(faults.into_found());
    }
    serde_json::from_value(value)
        .map_err(|error| vec![Fault { path: String::new(), message: error.to_string() }])
}

/// The JSON Schema of a config with the kinds of `plugins`, for editors and for documentation.
pub fn json_schema<T: JsonSchema>(plugins: &[&[Plugin]]) -> Value {
    Document::of::<T>(plugins).into_root()
}

/// The config with every field written out, as TOML that reads back to the same value. A field that is `None`
/// is left out, so it reads back only where `None` is its default.
///
/// # Errors
/// A config that TOML cannot hold, such as one with `None` inside a list.
pub fn show<T: Serialize>(config: &T) -> Result<String, toml::ser::Error> {
    toml::to_string(config)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::fixture::{ALL, Toy};
    use super::*;

    fn toy(text: &str) -> Result<Reading<Toy>, ConfigError> {
        read(text, Path::new("x.toml"), &[], ALL)
    }

    #[test]
    fn what_is_shown_reads_back_to_the_same_value() {
        for config in [
            Toy::default(),
            Toy { seed: u64::MAX, extra: Some(Box::new(crate::metric::MaximumMean {})), ..Toy::default() },
        ] {
            let text = show(&config).unwrap();
            let again = toy(&text).unwrap().config;
            assert_eq!(serde_json::to_value(&again).unwrap(), serde_json::to_value(&config).unwrap());
            assert_eq!(show(&again).unwrap(), text);
        }
    }

    #[test]
    fn a_value_from_no_file_is_checked_in_the_same_way() {
        use crate::simulator::SimulatorConfig;
        let config = |value| from_value::<Box<dyn SimulatorConfig>>(value, ALL);
        let sound = serde_json::json!({"kind": "point_mass", "wall": 3.0});
        assert!(config(sound).is_ok());
        let told = config(serde_json::json!({"kind": "point_mas"})).unwrap_err();
        assert!(told[0].to_string().contains("did you mean \"point_mass\"?"), "{told:?}");
        let told = config(serde_json::json!({"kind": "point_mass", "wal": 1.0, "reset_spread": "wide"}))
            .unwrap_err();
        assert_eq!(told.len(), 2, "{told:?}");
    }

    #[test]
    fn later_faults_get_their_lines_too() {
        let text = "seed = 1\n[simulator]\nkind = 'point_mass'\nwall = 0.05\n[[metrics]]\nkind = 'positive_skew'\nk = -1.0\n";
        let overrides = ["simulator.reset_spread=0.1".to_owned()];
        let reading = read::<Toy>(text, Path::new("x.toml"), &overrides, ALL).unwrap();
        let mut faults = Faults::new();
        faults.within("metrics", |faults| {
            faults.within("[0]", |faults| reading.config.metrics[0].validate(faults));
        });
        faults.within("simulator", |faults| reading.config.simulator.validate(faults));
        faults.add("simulator.reset_spread", "is set");
        assert_eq!(
            reading.places.error(faults.into_found()).to_string(),
            "x.toml:4: `simulator.wall`: expected more than reset_spread = 0.1, got 0.05\n\
             x.toml:7: `metrics[0].k`: expected a number of at least 0, got -1\n\
             --set simulator.reset_spread=0.1: `simulator.reset_spread`: is set"
        );
    }

    /// Serde's own complaints have no path, so whatever it would refuse must have been found before.
    #[test]
    fn no_mutilated_config_panics_or_gets_as_far_as_a_complaint_of_serde() {
        let text = example_root(&Toy::default(), ALL).unwrap();
        let code: String =
            text.lines().filter(|line| !line.starts_with('#')).map(|l| format!("{l}\n")).collect();
        let mut refused = 0;
        for at in 0..code.len() {
            for insert in ["", "-", "1", "x", "]"] {
                let Some((before, after)) = code.split_at_checked(at) else { continue };
                let rest = after.char_indices().nth(1).map_or("", |(next, _)| &after[next..]);
                let Err(error) = toy(&format!("{before}{insert}{rest}")) else { continue };
                refused += 1;
                for Finding { place, fault } in error.findings() {
                    assert!(
                        *place != Place::File || !fault.path.is_empty(),
                        "{before}{insert}{rest}\n{error}"
                    );
                }
            }
        }
        assert!(refused > code.len(), "{refused} of {}", code.len());
    }
}
