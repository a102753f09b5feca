//! Commented configs, written from schemas and default values.

use serde::Serialize;
use serde_json::{Map, Value};

use schemars::JsonSchema;

use super::expect::{expected, quote};
use super::outline::{self, Line};
use super::schema::{Document, description, fields, role};
use super::source::{join, quoted};
use crate::plugin::{Plugin, Role};

/// The widest comment, in characters.
const WIDTH: usize = 100;

/// What an example does not say of a field, because its value shows it.
const PLAIN: &[&str] = &[
    "an integer",
    "an integer of at least 0",
    "a number",
    "text",
    "a list",
    "a table",
    "true or false",
    "another value",
];

/// The part of a config that chooses `plugin`, with every field's description and default; `None` for policy
/// formats, which no config names. Reading it gives the plugin's default config.
pub fn example(plugin: &Plugin, plugins: &[&[Plugin]]) -> Option<String> {
    let section = match plugin.role {
        Role::Simulator => "simulator",
        Role::Teacher => "teacher",
        Role::OptionLearner => "option_learner",
        Role::Metric => "metrics",
        Role::Selector => "selector",
        Role::PolicyFormat => return None,
    };
    let own = [*plugin];
    let all: Vec<&[Plugin]> = plugins.iter().copied().chain([own.as_slice()]).collect();
    let document = Document::of::<serde_json::Map<String, Value>>(&all);
    let schema = document.plugin(plugin.role.name(), plugin.kind)?;
    let default = (plugin.default_config)();
    let mut writer = Writer { document: &document, text: String::new() };
    writer.comment(&description(schema).unwrap_or_else(|| plugin.summary.to_owned()));
    let brackets = if plugin.role == Role::Metric { ("[[", "]]") } else { ("[", "]") };
    writer.header(section, brackets);
    writer.table(section, schema, default.as_object()?);
    Some(writer.finish())
}

/// `config` as a commented TOML file: every field with its description and its value here, in the order of
/// the struct. Reading it gives `config`, except for fields that are `None` here and not by default.
pub fn example_root<T: JsonSchema + Serialize>(
    config: &T,
    plugins: &[&[Plugin]],
) -> Result<String, serde_json::Error> {
    let document = Document::of::<T>(plugins);
    let value = serde_json::to_value(config)?;
    let mut writer = Writer { document: &document, text: String::new() };
    writer.comment(&description(document.root()).unwrap_or_default());
    writer.text.push('\n');
    if let Value::Object(table) = &value {
        writer.table("", document.root(), table);
    }
    Ok(writer.finish())
}

struct Writer<'a> {
    document: &'a Document,
    text: String,
}

impl Writer<'_> {
    fn finish(self) -> String {
        let mut text = self.text.trim().to_owned();
        text.push('\n');
        text
    }

    /// The fields of the table at `path`: plain values first, as TOML wants it, then a section for each
    /// table.
    fn table(&mut self, path: &str, schema: &Value, table: &Map<String, Value>) {
        let document = self.document;
        let schema = document.settle(schema, &Value::Object(table.clone()));
        let others = schema.get("additionalProperties");
        let named = fields(schema).into_iter().flatten();
        let named = named.map(|(key, field)| (key, field, table.get(key).unwrap_or(&Value::Null)));
        let is_named = |key: &str| fields(schema).is_some_and(|fields| fields.contains_key(key));
        let more = table.iter().filter(|(key, _)| !is_named(key));
        let more = more.map(|(key, value)| (key, others.unwrap_or(&Value::Null), value));
        let (sections, plain): (Vec<_>, Vec<_>) =
            named.partition(|(_, field, value)| self.is_section(field, value));
        for (key, field, value) in plain.into_iter().chain(more) {
            self.field(key, field, value);
        }
        for (key, field, value) in sections {
            self.section(&join(path, key), field, value);
        }
    }

    /// Whether a value gets a header of its own: a struct, a plugin, or a list of them.
    fn is_section(&self, schema: &Value, value: &Value) -> bool {
        let schema = self.document.settle(schema, value);
        match value {
            Value::Object(_) => fields(schema).is_some() || schema.get("additionalProperties").is_some(),
            Value::Array(items) => {
                let each = schema.get("items");
                let section =
                    |item: &Value| item.is_object() && each.is_some_and(|each| self.is_section(each, item));
                !items.is_empty() && items.iter().all(section)
            }
            _ => false,
        }
    }

    fn section(&mut self, path: &str, schema: &Value, value: &Value) {
        let own = description(schema);
        let comment = own.or_else(|| description(self.document.settle(schema, value))).unwrap_or_default();
        self.text.push('\n');
        self.comment(&comment);
        match value {
            Value::Object(table) => {
                self.items("value", self.document.settle(schema, value));
                self.header(path, ("[", "]"));
                self.table(path, schema, table);
            }
            Value::Array(items) => {
                let document = self.document;
                let schema = document.follow(schema).get("items").unwrap_or(&Value::Null);
                for (i, table) in items.iter().filter_map(Value::as_object).enumerate() {
                    if i > 0 {
                        self.text.push('\n');
                    }
                    self.header(path, ("[[", "]]"));
                    self.table(path, schema, table);
                }
            }
            _ => {}
        }
    }

    fn header(&mut self, path: &str, (open, close): (&str, &str)) {
        self.text.push_str(&format!("{open}{path}{close}\n"));
    }

    /// One line `key = value` below its description and what it may be.
    fn field(&mut self, key: &str, schema: &Value, value: &Value) {
        let document = self.document;
        if let Some(text) = description(schema) {
            self.comment(&text);
        }
        let followed = document.follow(schema);
        let allowed = expected(document, schema);
        if value.is_null() {
            match fields(followed) {
                Some(fields) => {
                    self.comment("Not set; to set it, write a table with these fields:");
                    self.outline(&outline::of_fields(document, followed));
                    let blank = blank(followed, fields.keys().map(String::as_str));
                    self.text.push_str(&format!("# {} = {blank}\n", quoted(key)));
                }
                None => {
                    self.comment(&format!("Not set; to set it, write {allowed}:"));
                    self.outline(&outline::of_choices(document, followed));
                    self.text.push_str(&format!("# {} =\n", quoted(key)));
                }
            }
            return;
        }
        if !PLAIN.contains(&allowed.as_str()) && followed.get("const").is_none() {
            self.comment(&format!("Allowed: {allowed}."));
        }
        self.outline(&outline::of_choices(document, followed));
        self.items("item", followed);
        self.text.push_str(&format!("{} = {}\n", quoted(key), inline(followed, value)));
    }

    /// What the items of a list, or the values under any names, are made of, if they are tables.
    fn items(&mut self, what: &str, schema: &Value) {
        let document = self.document;
        let plugin =
            schema.get("items").map(|each| document.follow(each)).filter(|each| role(each).is_some());
        if let Some(plugin) = plugin {
            self.comment(&format!("Each {what} is {}.", expected(document, plugin)));
        } else if let Some(item) = outline::item(document, schema) {
            self.comment(&format!("Each {what} is a table with these fields:"));
            self.outline(&outline::of_fields(document, item));
        }
    }

    /// `text` as comment lines, wrapped; blank lines stay.
    fn comment(&mut self, text: &str) {
        for paragraph in text.split("\n\n").filter(|paragraph| !paragraph.trim().is_empty()) {
            self.wrapped(paragraph, 0, 0);
        }
    }

    /// Comment lines, each further to the right the deeper it is.
    fn outline(&mut self, lines: &[Line]) {
        for Line { depth, text } in lines {
            self.wrapped(text, 2 * depth, 2 * depth + 2);
        }
    }

    /// One paragraph as comment lines: the first has `first` spaces more before it, the others `rest`.
    fn wrapped(&mut self, paragraph: &str, first: usize, rest: usize) {
        // Links to other items mean nothing outside rustdoc.
        let paragraph = paragraph.replace("[`", "`").replace("`]", "`");
        let start = |spaces: usize| format!("#{}", " ".repeat(spaces));
        let (mut line, mut empty) = (start(first), true);
        for word in paragraph.split_whitespace() {
            if !empty && line.chars().count() + 1 + word.chars().count() > WIDTH {
                self.text.push_str(&line);
                self.text.push('\n');
                line = start(rest);
            }
            line.push(' ');
            line.push_str(word);
            empty = false;
        }
        self.text.push_str(&line);
        self.text.push('\n');
    }
}

/// A table to be filled in, with those of the fields `names` that must be there.
fn blank<'a>(schema: &Value, names: impl Iterator<Item = &'a str>) -> String {
    let required = schema.get("required").and_then(Value::as_array);
    let is_required = |name: &&str| required.is_some_and(|required| required.iter().any(|r| r == name));
    let fields: Vec<String> = names.filter(is_required).map(|name| format!("{} = …", quoted(name))).collect();
    if fields.is_empty() { "{}".to_owned() } else { format!("{{ {} }}", fields.join(", ")) }
}

/// A value on one line of TOML, in the fewest digits that read back to it.
pub(super) fn inline(schema: &Value, value: &Value) -> String {
    match value {
        Value::Number(number) => match number.as_f64().filter(|_| number.is_f64()) {
            Some(number) if schema.get("format").and_then(Value::as_str) == Some("float") => {
                format!("{:?}", number as f32)
            }
            Some(number) => format!("{number:?}"),
            None => number.to_string(),
        },
        Value::String(text) => quote(text),
        Value::Array(items) => {
            let each = schema.get("items").unwrap_or(&Value::Null);
            let items: Vec<String> = items.iter().map(|item| inline(each, item)).collect();
            format!("[{}]", items.join(", "))
        }
        Value::Object(table) => {
            let fields = table.iter().filter(|(_, value)| !value.is_null());
            let fields: Vec<String> = fields
                .map(|(key, value)| format!("{} = {}", quoted(key), inline(&Value::Null, value)))
                .collect();
            if fields.is_empty() { "{}".to_owned() } else { format!("{{ {} }}", fields.join(", ")) }
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::collections::BTreeMap;
    use std::path::Path;

    use super::super::fixture::{ALL, AtFall, Inner, Toy};
    use super::super::read;
    use super::*;

    fn json_of(text: &str) -> Value {
        let reading = read::<Toy>(text, Path::new("x"), &[], ALL).map_err(|error| panic!("{error}\n{text}"));
        serde_json::to_value(reading.unwrap().config).unwrap()
    }

    #[test]
    fn the_example_of_every_plugin_reads_as_its_default() {
        for plugin in ALL.iter().flat_map(|slice| slice.iter()) {
            let text = example(plugin, ALL).unwrap();
            let default = (plugin.default_config)();
            let (before, at) = match plugin.role {
                Role::Simulator => ("metrics = []", "/simulator"),
                Role::Metric => ("simulator.kind = 'point_mass'", "/metrics/0"),
                Role::Selector => ("metrics = []\nsimulator.kind = 'point_mass'", "/selector"),
                other => panic!("the toy has no field for {other:?}"),
            };
            let value = json_of(&format!("seed = 1\n{before}\n{text}"));
            assert_eq!(value.pointer(at), Some(&default), "{}", plugin.kind);
        }
    }

    #[test]
    fn an_example_explains_every_field() {
        let text = example(&ALL[1][0], ALL).unwrap();
        let expected = "\
# Every shape of field.
[[metrics]]
# a metric with fields of every shape
kind = \"odd\"
# A number that a `f64` prints with too many digits. This sentence is here to make the comment
# longer than one line may be.
# Allowed: a number above 0.0.
clip = 0.2
# May be left out.
# Not set; to set it, write an integer from 0 to 10:
# limit =
# Exactly two.
# Allowed: a list of 2 items.
pair = [0.9, 1e-8]
# Words.
# Allowed: a list of at least 1 item.
layers = [\"tanh\"]
# A choice with fields.
# Allowed: a table with `rule`, one of \"never\", \"after\".
#   rule = \"never\": No fields.
#   rule = \"after\": One field.
#     steps: Control steps. An integer of at least 0.
rule = { rule = \"after\", steps = 3 }
# A choice around fields.
# Allowed: \"standard\" or { seed = … }.
#   \"standard\": No fields.
#   { seed = … }: Numbered.
start = { seed = 18446744073709551615 }
# A truth.
quick = true

# Any names.
[metrics.weights]
\"a b\" = 1.0

# A table in a table.
[metrics.inner]
# A text with all that needs escapes.
name = \"π \\\"x\\\" \\\\ \\n\\U0000007F\\U0000202E\"
# A signed integer.
offset = -3
";
        assert_eq!(text, expected);
    }

    /// A config whose values show little.
    #[derive(Serialize, JsonSchema)]
    struct Sparse {
        /// Made of these.
        parts: Vec<Part>,
        /// One more, or none.
        spare: Option<Part>,
        /// By any names.
        named: BTreeMap<String, Part>,
        /// What of a table that has all it needs.
        inner: Option<Inner>,
    }

    /// A part.
    #[derive(Serialize, JsonSchema)]
    struct Part {
        /// What it is called.
        name: String,
        /// In kg.
        #[serde(default = "half")]
        #[schemars(range(min = 0.0))]
        mass: f64,
        /// Parts of it.
        #[serde(default)]
        limits: Vec<Limit>,
        /// What to do with it at a fall.
        at_fall: Option<AtFall>,
    }

    #[derive(Serialize, JsonSchema)]
    struct Limit {
        /// The greatest value.
        high: f64,
    }

    fn half() -> f64 {
        0.5
    }

    #[test]
    fn what_is_left_out_is_explained_by_its_schema() {
        let config = Sparse { parts: Vec::new(), spare: None, named: BTreeMap::new(), inner: None };
        let text = example_root(&config, ALL).unwrap();
        let part = "\
#   name: What it is called. Text.
#   mass: In kg. A number of at least 0.0; 0.5 by default.
#   limits: Parts of it. A list; [] by default.
#     high: The greatest value. A number.
#   at_fall: What to do with it at a fall. One of \"stop\", \"continue\"; may be left out.
#     \"stop\": End.
#     \"continue\": Do not.
";
        let expected = format!(
            "\
# A config whose values show little.

# Made of these.
# Each item is a table with these fields:
{part}parts = []
# One more, or none.
# Not set; to set it, write a table with these fields:
{part}# spare = {{ name = … }}
# What of a table that has all it needs.
# Not set; to set it, write a table with these fields:
#   name: A text with all that needs escapes. Text; \"π \\\"x\\\" \\\\ \\n\\U0000007F\\U0000202E\" by default.
#   offset: A signed integer. An integer; -3 by default.
# inner = {{}}

# By any names.
# Each value is a table with these fields:
{part}[named]
"
        );
        assert_eq!(text, expected);
        text.parse::<toml::Table>().unwrap();
    }

    #[test]
    fn a_whole_example_reads_as_the_config_and_keeps_the_order_of_the_struct() {
        let config = Toy::default();
        let text = example_root(&config, ALL).unwrap();
        assert_eq!(json_of(&text), serde_json::to_value(&config).unwrap());
        let headers: Vec<&str> = text.lines().filter(|line| line.starts_with('[')).collect();
        assert_eq!(
            headers,
            [
                "[simulator]",
                "[tasks]",
                "[[metrics]]",
                "[[metrics]]",
                "[[metrics]]",
                "[metrics.weights]",
                "[metrics.inner]",
                "[discover]"
            ]
        );
        assert!(text.contains("\n[tasks]\ncost = { low = -2.4, high = -1.4 }\n"), "{text}");
        assert!(text.contains("# `K`, at most all of them.\nset_size = 5\n"), "{text}");
    }
}
