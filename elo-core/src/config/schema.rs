//! The JSON Schema of a whole config, in which a field that holds a plugin stands for all plugins of its
//! role.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::{Map, Value, json};

use crate::plugin::{Plugin, Role};

/// The keyword that marks a plugin; its value is [`Role::name`].
const PLUGIN: &str = "x-elo-plugin";

/// Gives the trait objects of plugins a schema, so that config structs which hold them can derive theirs.
macro_rules! plugin_fields {
    ($($config:path: $role:ident;)*) => { $(
        impl JsonSchema for dyn $config {
            fn schema_name() -> Cow<'static, str> {
                stringify!($role).into()
            }

            /// Only a mark: the kinds are not known here.
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({ (PLUGIN): Role::$role.name() })
            }
        }
    )* };
}

plugin_fields! {
    crate::simulator::SimulatorConfig: Simulator;
    crate::policy::TeacherConfig: Teacher;
    crate::policy::OptionLearner: OptionLearner;
    crate::metric::Metric: Metric;
    crate::select::Selector: Selector;
}

/// The schema of a config together with those of all plugins.
pub(super) struct Document {
    root: Value,
}

impl Document {
    /// The schema of `T` with the kinds of `plugins`.
    pub fn of<T: JsonSchema + ?Sized>(plugins: &[&[Plugin]]) -> Self {
        let mut generator = SchemaGenerator::default();
        let mut root = T::json_schema(&mut generator).to_value();
        let plugins = plugins.iter().flat_map(|slice| slice.iter());
        let plugins: Vec<&Plugin> = plugins.filter(|plugin| plugin.format.is_none()).collect();
        let tables: Vec<(String, Value)> = plugins
            .iter()
            .map(|p| (key(p.role.name(), p.kind), with_kind(p, (p.schema)(&mut generator).to_value())))
            .collect();
        let mut definitions = generator.take_definitions(true);
        for definition in definitions.values_mut().chain([&mut root]) {
            list_kinds(definition, &plugins);
        }
        definitions.extend(tables);
        if let Value::Object(root) = &mut root {
            root.insert("$schema".to_owned(), json!("https://json-schema.org/draft/2020-12/schema"));
            root.insert("$defs".to_owned(), Value::Object(definitions));
        }
        Self { root }
    }

    /// The schema of the root table.
    pub fn root(&self) -> &Value {
        &self.root
    }

    /// The whole schema.
    pub fn into_root(self) -> Value {
        self.root
    }

    /// The schema that `schema` refers to: through references, and through the choice of a value or nothing.
    pub fn follow<'a>(&'a self, schema: &'a Value) -> &'a Value {
        let mut schema = schema;
        // A chain of references longer than this would be a circle.
        for _ in 0..64 {
            let referred = schema.get("$ref").and_then(Value::as_str);
            let next = match referred.and_then(|r| r.strip_prefix("#/$defs/")) {
                Some(name) => self.definition(name),
                None => only_choice(schema),
            };
            match next {
                Some(next) => schema = next,
                None => break,
            }
        }
        schema
    }

    /// Like [`Self::follow`], and from a plugin's mark to the fields of the kind that `table` has.
    pub fn settle<'a>(&'a self, schema: &'a Value, table: &Value) -> &'a Value {
        let schema = self.follow(schema);
        let kind = table.get("kind").and_then(Value::as_str);
        role(schema).zip(kind).and_then(|(role, kind)| self.plugin(role, kind)).unwrap_or(schema)
    }

    /// The fields of a kind, with `kind` itself.
    pub fn plugin(&self, role: &str, kind: &str) -> Option<&Value> {
        self.definition(&key(role, kind))
    }

    /// All kinds of a role, in the order of the plugin slices.
    pub fn kinds(&self, role: &str) -> Vec<&str> {
        let prefix = key(role, "");
        let definitions = self.root.get("$defs").and_then(Value::as_object);
        let names = definitions.into_iter().flat_map(Map::keys);
        names.filter_map(|name| name.strip_prefix(prefix.as_str())).collect()
    }

    fn definition(&self, name: &str) -> Option<&Value> {
        self.root.get("$defs")?.get(name)
    }
}

/// The role that `schema` marks, if it marks one.
pub(super) fn role(schema: &Value) -> Option<&str> {
    schema.get(PLUGIN)?.as_str()
}

/// The choices of `schema` that are more than nothing.
pub(super) fn choices(schema: &Value) -> Vec<&Value> {
    let listed = schema.get("oneOf").or_else(|| schema.get("anyOf")).and_then(Value::as_array);
    let nothing = |choice: &&Value| choice.get("type").and_then(Value::as_str) != Some("null");
    listed.into_iter().flatten().filter(nothing).collect()
}

/// The field that tells tables of `choices` apart, and its words: serde's internally tagged enums.
pub(super) fn tag<'a>(document: &'a Document, choices: &[&'a Value]) -> Option<(&'a str, Vec<&'a str>)> {
    let fields_of = |choice: &'a Value| fields(document.follow(choice));
    let word = |choice: &&'a Value, name: &str| fields_of(choice)?.get(name)?.get("const")?.as_str();
    let tag = |name: &'a String| {
        let words: Option<Vec<&str>> = choices.iter().map(|choice| word(choice, name)).collect();
        Some((name.as_str(), words?))
    };
    fields_of(choices.first()?)?.keys().find_map(tag)
}

/// What `schema` says of itself.
pub(super) fn description(schema: &Value) -> Option<String> {
    schema.get("description").and_then(Value::as_str).map(str::to_owned)
}

/// The fields that a table of `schema` can have, in the order of the struct.
pub(super) fn fields(schema: &Value) -> Option<&Map<String, Value>> {
    schema.get("properties")?.as_object()
}

fn only_choice(schema: &Value) -> Option<&Value> {
    match (role(schema), choices(schema).as_slice()) {
        (None, [only]) => Some(only),
        _ => None,
    }
}

/// Where a plugin's schema is kept; a kind is never empty, and no type's name has a dot.
fn key(role: &str, kind: &str) -> String {
    format!("{}.{kind}", role.replace(' ', "_"))
}

/// The schema of a plugin's table, `kind` first.
fn with_kind(plugin: &Plugin, schema: Value) -> Value {
    let mut schema = match schema {
        Value::Object(schema) => schema,
        _ => Map::new(),
    };
    let mut fields = Map::new();
    fields.insert("kind".to_owned(), json!({ "const": plugin.kind, "description": plugin.summary }));
    if let Some(Value::Object(own)) = schema.remove("properties") {
        fields.extend(own);
    }
    let mut required = vec![json!("kind")];
    if let Some(Value::Array(own)) = schema.remove("required") {
        required.extend(own);
    }
    schema.insert("properties".to_owned(), Value::Object(fields));
    schema.insert("required".to_owned(), Value::Array(required));
    Value::Object(schema)
}

/// Completes a plugin's mark by its kinds, for readers that do not know the mark.
fn list_kinds(schema: &mut Value, plugins: &[&Plugin]) {
    let Some(role) = role(schema).map(str::to_owned) else { return };
    let kinds = plugins.iter().filter(|p| p.role.name() == role);
    let refs: Value = kinds.map(|p| json!({ "$ref": format!("#/$defs/{}", key(&role, p.kind)) })).collect();
    if let Value::Object(schema) = schema {
        schema.insert("type".to_owned(), json!("object"));
        schema.insert("oneOf".to_owned(), refs);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::fixture::{ALL, Toy};
    use super::super::json_schema;
    use super::*;

    #[test]
    fn the_schema_lists_every_plugin_with_its_kind() {
        let schema = json_schema::<Toy>(ALL);
        assert_eq!(schema["properties"]["simulator"]["$ref"], "#/$defs/Simulator");
        assert_eq!(schema["$defs"]["Metric"]["oneOf"].as_array().unwrap().len(), 4);
        for plugin in ALL.iter().flat_map(|slice| slice.iter()) {
            let name = key(plugin.role.name(), plugin.kind);
            let table = &schema["$defs"][&name];
            assert_eq!(table["properties"]["kind"]["const"], plugin.kind);
            assert_eq!(table["required"][0], "kind");
            assert_eq!(table["additionalProperties"], false, "{name} must refuse unknown fields");
        }
    }

    #[test]
    fn every_reference_leads_somewhere() {
        fn visit(root: &Value, value: &Value) -> usize {
            let here = value.get("$ref").and_then(Value::as_str).map_or(0, |to| {
                let name = to.strip_prefix("#/$defs/").unwrap();
                assert!(root["$defs"].get(name).is_some(), "{to}");
                1
            });
            let below: Vec<&Value> = match value {
                Value::Object(table) => table.values().collect(),
                Value::Array(items) => items.iter().collect(),
                _ => Vec::new(),
            };
            here + below.into_iter().map(|value| visit(root, value)).sum::<usize>()
        }
        let schema = json_schema::<Toy>(ALL);
        assert!(visit(&schema, &schema) > 10);
    }

    #[test]
    fn fields_stand_in_the_order_of_the_struct() {
        let document = Document::of::<Toy>(ALL);
        let names: Vec<&String> = fields(document.root()).unwrap().keys().collect();
        assert_eq!(names, ["seed", "simulator", "tasks", "metrics", "extra", "discover", "selector"]);
    }
}
