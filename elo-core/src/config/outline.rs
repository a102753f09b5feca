//! What the value of a field is not there to show: the words of a choice, the fields of a table that is left out, those of a
//! list's items.

use serde_json::Value;

use super::example::inline;
use super::expect::{expected, quote};
use super::schema::{Document, choices, description, fields, role, tag};

/// Tables within tables that are told of.
const DEEPEST: usize = 4;

/// One line of an outline, and how many others it stands below.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Line {
    pub depth: usize,
    pub text: String,
}

/// What the choices of `schema` mean, as far as they are described.
pub(super) fn of_choices(document: &Document, schema: &Value) -> Vec<Line> {
    Outline::of(document, |outline| outline.choices(schema, 1))
}

/// The fields of a table of `schema`.
pub(super) fn of_fields(document: &Document, schema: &Value) -> Vec<Line> {
    Outline::of(document, |outline| outline.fields(schema, None, 1))
}

/// The table that `schema` has in a list or under names of one's own, if its fields are known.
pub(super) fn item<'a>(document: &'a Document, schema: &'a Value) -> Option<&'a Value> {
    let schema = document.follow(schema);
    let item = document.follow(schema.get("items").or_else(|| schema.get("additionalProperties"))?);
    fields(item).is_some().then_some(item)
}

struct Outline<'a> {
    document: &'a Document,
    lines: Vec<Line>,
}

impl<'a> Outline<'a> {
    fn of(document: &'a Document, write: impl FnOnce(&mut Self)) -> Vec<Line> {
        let mut outline = Self { document, lines: Vec::new() };
        write(&mut outline);
        outline.lines
    }

    /// The fields of a table but for `tag`, each with what is below it.
    fn fields(&mut self, schema: &'a Value, tag: Option<&str>, depth: usize) {
        let schema = self.document.follow(schema);
        let required = schema.get("required").and_then(Value::as_array);
        let is_required = |name: &str| required.is_some_and(|names| names.iter().any(|n| n == name));
        let named = fields(schema).into_iter().flatten().filter(|(name, _)| Some(name.as_str()) != tag);
        for (name, field) in named {
            let default = match field.get("default") {
                _ if is_required(name) => String::new(),
                None | Some(Value::Null) => "; may be left out".to_owned(),
                Some(default) => format!("; {} by default", inline(self.document.follow(field), default)),
            };
            let allowed = capitalised(&expected(self.document, field));
            let told = description(field).map_or(String::new(), |text| text + " ");
            self.lines.push(Line { depth, text: format!("{name}: {told}{allowed}{default}.") });
            if depth < DEEPEST {
                self.choices(field, depth + 1);
                let below = item(self.document, field).unwrap_or(field);
                self.fields(below, None, depth + 1);
            }
        }
    }

    fn choices(&mut self, schema: &'a Value, depth: usize) {
        let document = self.document;
        let schema = document.follow(schema);
        let choices = choices(schema);
        if role(schema).is_some() || !choices.iter().any(|choice| description(choice).is_some()) {
            return;
        }
        let tag = tag(document, &choices);
        for (i, choice) in choices.into_iter().enumerate() {
            let table = document.follow(choice);
            // Of a table with one key, what is below the key.
            let only = fields(table).filter(|fields| fields.len() == 1).and_then(|f| f.iter().next());
            let (label, below, tag) = match (&tag, only) {
                (Some((tag, words)), _) => (format!("{tag} = {}", quote(words[i])), table, Some(*tag)),
                (None, Some((key, below))) => (format!("{{ {key} = … }}"), below, None),
                (None, None) => (expected(document, choice), table, None),
            };
            let told = description(choice).unwrap_or_default();
            self.lines.push(Line { depth, text: format!("{label}: {told}") });
            if depth < DEEPEST {
                self.fields(below, tag, depth + 1);
            }
        }
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
