//! TOML text as a tree of JSON values, and the memory of where each of them was written.
//!
//! JSON, because that is what plugins' schemas and defaults are made of and because it holds integers of 64
//! bits of either sign. What JSON cannot hold (infinities, dates) is a fault at once and null in the tree.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::error::{ConfigError, Finding, Place};
use super::expect::quote;
use crate::fault::{Fault, Faults};

/// Syntax errors beyond this number are not reported.
const MOST_SYNTAX_ERRORS: usize = 20;

/// A parsed file.
pub(super) struct Source {
    /// The root table.
    pub tree: Value,
    /// Where its values were written.
    pub places: Places,
    /// Values that no config can hold; they are null in the tree.
    pub unusable: Vec<Fault>,
}

/// Where the fields of a config were written.
#[derive(Clone, Debug)]
pub struct Places {
    file: PathBuf,
    /// Where each line begins, in bytes.
    lines: Vec<usize>,
    overrides: Vec<String>,
    origins: BTreeMap<String, Origin>,
}

/// Where one field was written. The order is that of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Origin {
    Nowhere,
    Byte(usize),
    Override(usize),
}

impl Source {
    /// Parses `text`; `file` is its name in messages.
    pub fn parse(text: &str, file: &Path) -> Result<Self, ConfigError> {
        let mut places = Places::new(text, file);
        let (table, errors) = DeTable::parse_recoverable(text);
        if !errors.is_empty() {
            return Err(places.syntax(text, errors));
        }
        let mut faults = Faults::new();
        let tree = {
            let mut note = |path: &str, byte: usize| {
                places.origins.insert(path.to_owned(), Origin::Byte(byte));
            };
            convert_table("", table.get_ref(), &mut note, &mut faults)
        };
        Ok(Self { tree, places, unusable: faults.into_found() })
    }

    /// Notes that override number `index` wrote `path` and everything below it.
    pub fn overridden(&mut self, path: &str, index: usize) {
        self.forget(path);
        self.places.origins.insert(path.to_owned(), Origin::Override(index));
    }

    /// Forgets what is known of `path` and everything below it.
    pub fn forget(&mut self, path: &str) {
        let below = |other: &str| {
            other.strip_prefix(path).is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
        };
        self.places.origins.retain(|other, _| !below(other));
        self.unusable.retain(|fault| !below(&fault.path));
    }
}

impl Places {
    fn new(text: &str, file: &Path) -> Self {
        let lines = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        Self { file: file.to_owned(), lines, overrides: Vec::new(), origins: BTreeMap::new() }
    }

    /// The error made of `faults` (not empty) that were found in the config after it was read.
    pub fn error(&self, faults: Vec<Fault>) -> ConfigError {
        ConfigError::new(self.file.clone(), self.locate(faults))
    }

    /// The error made of faults with their places.
    pub(super) fn error_of(&self, findings: Vec<Finding>) -> ConfigError {
        ConfigError::new(self.file.clone(), findings)
    }

    /// Each fault with the place of its field, or of the nearest table around it, in the order of the file;
    /// those of overrides last.
    pub(super) fn locate(&self, faults: Vec<Fault>) -> Vec<Finding> {
        let mut found: Vec<(Origin, Fault)> =
            faults.into_iter().map(|fault| (self.origin(&fault.path), fault)).collect();
        found.sort_by_key(|(origin, _)| *origin);
        let place = |origin| match origin {
            Origin::Nowhere => Place::File,
            Origin::Byte(byte) => Place::Line(self.line(byte)),
            Origin::Override(index) => Place::Override(self.overrides[index].clone()),
        };
        found.into_iter().map(|(origin, fault)| Finding { place: place(origin), fault }).collect()
    }

    /// Notes an override, and returns its number.
    pub(super) fn add_override(&mut self, given: &str) -> usize {
        self.overrides.push(given.to_owned());
        self.overrides.len() - 1
    }

    /// Whether an override wrote `path`.
    pub(super) fn is_overridden(&self, path: &str) -> bool {
        matches!(self.origin(path), Origin::Override(_))
    }

    fn origin(&self, path: &str) -> Origin {
        let mut path = path;
        loop {
            if let Some(origin) = self.origins.get(path) {
                return *origin;
            }
            match path.rfind(['.', '[']) {
                Some(end) => path = &path[..end],
                None => return Origin::Nowhere,
            }
        }
    }

    fn line(&self, byte: usize) -> usize {
        self.lines.partition_point(|start| *start <= byte)
    }

    /// One finding a line: what else is wrong with a line is mostly the first error's doing.
    fn syntax(&self, text: &str, mut errors: Vec<toml::de::Error>) -> ConfigError {
        let line_of = |error: &toml::de::Error| error.span().map(|span| self.line(span.start));
        errors.sort_by_key(|error| error.span().map(|span| span.start));
        errors.dedup_by_key(|error| line_of(error));
        let finding = |error: &toml::de::Error| {
            let place = error.span().map_or(Place::File, |span| {
                let line = self.line(span.start);
                let before = text.get(self.lines[line - 1]..span.start).unwrap_or_default();
                Place::Character { line, column: before.chars().count() + 1 }
            });
            let message = format!("is no valid TOML: {}", error.message().replace('\n', ", "));
            Finding { place, fault: Fault { path: String::new(), message } }
        };
        self.error_of(errors.iter().take(MOST_SYNTAX_ERRORS).map(finding).collect())
    }
}

/// A TOML value as JSON. `note` gets the path and the first byte of every field.
fn convert(
    path: &str,
    value: &Spanned<DeValue<'_>>,
    note: &mut dyn FnMut(&str, usize),
    faults: &mut Faults,
) -> Value {
    match value.get_ref() {
        DeValue::String(text) => Value::from(text.as_ref()),
        DeValue::Boolean(truth) => Value::from(*truth),
        DeValue::Integer(number) => {
            let signed = i64::from_str_radix(number.as_str(), number.radix()).map(Value::from);
            let any =
                signed.or_else(|_| u64::from_str_radix(number.as_str(), number.radix()).map(Value::from));
            any.unwrap_or_else(|_| {
                faults.add(path, format!("{number} is too large for any integer"));
                Value::Null
            })
        }
        DeValue::Float(number) => {
            let parsed = number.as_str().parse().ok().and_then(serde_json::Number::from_f64);
            parsed.map_or_else(
                || {
                    faults.add(path, format!("expected a finite number, got {number}"));
                    Value::Null
                },
                Value::Number,
            )
        }
        DeValue::Datetime(date) => {
            faults.add(path, format!("no field holds a date; write \"{date}\" where text is meant"));
            Value::Null
        }
        DeValue::Array(items) => items
            .iter()
            .enumerate()
            .map(|(i, item)| {
                let path = format!("{path}[{i}]");
                note(&path, item.span().start);
                convert(&path, item, note, faults)
            })
            .collect(),
        DeValue::Table(table) => convert_table(path, table, note, faults),
    }
}

fn convert_table(
    path: &str,
    table: &DeTable<'_>,
    note: &mut dyn FnMut(&str, usize),
    faults: &mut Faults,
) -> Value {
    let mut fields = Map::new();
    for (key, value) in table {
        let name = key.get_ref().as_ref();
        let path = join(path, name);
        note(&path, key.span().start);
        fields.insert(name.to_owned(), convert(&path, value, note, faults));
    }
    Value::Object(fields)
}

/// The path of field `key` of the table at `path`.
pub(super) fn join(path: &str, key: &str) -> String {
    let key = quoted(key);
    if path.is_empty() { key } else { format!("{path}.{key}") }
}

/// `key` as TOML writes it: bare where it can be.
pub(super) fn quoted(key: &str) -> String {
    let bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !key.is_empty() && key.chars().all(bare) { key.to_owned() } else { quote(key) }
}

/// The value of one override: any TOML value, or else a bare word, which is text.
///
/// # Errors
/// A message about text that is neither.
pub(super) fn override_value(text: &str, path: &str, faults: &mut Faults) -> Result<Value, String> {
    let bare = !text.is_empty()
        && !text.starts_with(['"', '\'', '[', '{'])
        && !text.contains(|c: char| c.is_control() || c == '"' || c == '#');
    match DeValue::parse(text) {
        Ok(value) => Ok(convert(path, &value, &mut |_, _| {}, faults)),
        Err(_) if bare => Ok(Value::from(text)),
        Err(_) if text.is_empty() => Err("has no value after `=`; write \"\" for empty text".to_owned()),
        Err(error) => {
            Err(format!("is neither a TOML value nor a plain word: {}", error.message().replace('\n', ", ")))
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn said(text: &str) -> String {
        Source::parse(text, Path::new("examples/x.toml")).err().unwrap().to_string()
    }

    #[test]
    fn syntax_errors_name_line_and_column() {
        let message = said("seed = 3\nλ = 1");
        assert!(message.starts_with("examples/x.toml:2:1: is no valid TOML: "), "{message}");
        let message = said("seed = 3\nname = \"é\" x");
        assert!(message.starts_with("examples/x.toml:2:12: is no valid TOML: "), "{message}");
        assert_eq!(said("a = 1\nb = 2\na = 3"), "examples/x.toml:3:1: is no valid TOML: duplicate key");
    }

    #[test]
    fn every_line_with_a_syntax_error_is_reported_once() {
        let message = said("a = \nb = 1 2 3 4\nc = 1\nc = 2");
        let places: Vec<&str> = message.lines().filter_map(|line| line.get(..19)).collect();
        assert_eq!(places, ["examples/x.toml:1:5", "examples/x.toml:2:5", "examples/x.toml:4:1"]);
        assert_eq!(said(&"a = \n".repeat(1000)).lines().count(), MOST_SYNTAX_ERRORS);
    }

    #[test]
    fn endless_nesting_is_refused() {
        for text in ["a=".to_owned() + &"[".repeat(100_000), vec!["a"; 100_000].join(".") + " = 1"] {
            let message = said(&text);
            assert!(message.contains("recurs") && message.lines().count() == 1, "{}", &message[..100]);
        }
    }

    #[test]
    fn fields_are_found_on_their_lines() {
        let text = "# x\n[a]\nb = { c = 1,\n d = 2 }\n[[e]]\n[[e]]\nf.g = [\n1,\n2]\n";
        let places = Source::parse(text, Path::new("x")).unwrap().places;
        for (path, line) in
            [("a", 2), ("a.b", 3), ("a.b.c", 3), ("a.b.d", 4), ("e[0]", 5), ("e[1]", 6), ("e[1].f.g[1]", 9)]
        {
            let fault = Fault { path: path.to_owned(), message: String::new() };
            assert_eq!(places.locate(vec![fault])[0].place, Place::Line(line), "{path}");
        }
        // What is not there is found at the table that lacks it.
        let fault = Fault { path: "e[1].f.x".to_owned(), message: String::new() };
        assert_eq!(places.locate(vec![fault])[0].place, Place::Line(7));
        let fault = Fault { path: "nowhere".to_owned(), message: String::new() };
        assert_eq!(places.locate(vec![fault])[0].place, Place::File);
    }
}
