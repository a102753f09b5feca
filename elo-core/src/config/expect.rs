//! What a schema asks for and what a value is, in words for messages.

use std::ops::RangeInclusive;

use serde_json::Value;

use super::schema::{Document, choices, fields, role, tag};

/// The longest piece of a value that a message repeats, in characters.
const LONGEST: usize = 60;

/// The words that `schema` allows, if it allows only words.
pub(super) fn words<'a>(document: &'a Document, schema: &'a Value) -> Option<Vec<&'a str>> {
    let schema = document.follow(schema);
    if let Some(word) = schema.get("const") {
        return word.as_str().map(|word| vec![word]);
    }
    if let Some(listed) = schema.get("enum").and_then(Value::as_array) {
        return listed.iter().filter(|word| !word.is_null()).map(Value::as_str).collect();
    }
    let choices = choices(schema);
    if choices.is_empty() || role(schema).is_some() {
        return None;
    }
    let words: Option<Vec<_>> = choices.into_iter().map(|choice| words(document, choice)).collect();
    words.map(|words| words.concat())
}

/// What `schema` asks for, as in "expected …".
pub(super) fn expected(document: &Document, schema: &Value) -> String {
    let schema = document.follow(schema);
    if let Some(role) = role(schema) {
        let article = if role.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
        return format!("a table with the `kind` of {article} {role} ({})", document.kinds(role).join(", "));
    }
    if let Some(words) = words(document, schema) {
        return one_of(&words);
    }
    let choices = choices(schema);
    if let Some((tag, words)) = tag(document, &choices) {
        return format!("a table with `{tag}`, {}", one_of(&words));
    }
    if !choices.is_empty() {
        let each: Vec<String> = choices.iter().map(|choice| variant(document, choice)).collect();
        return each.join(" or ");
    }
    match type_name(schema) {
        Some("integer") => format!("an integer{}", interval(schema)),
        Some("number") => format!("a number{}", interval(schema)),
        Some("boolean") => "true or false".to_owned(),
        Some("string") => format!("text{}", lengths(schema, "Length", "character")),
        Some("array") => format!("a list{}", lengths(schema, "Items", "item")),
        Some("object") => "a table".to_owned(),
        _ => "another value".to_owned(),
    }
}

/// One of several choices; of a table with one field, that field.
fn variant(document: &Document, choice: &Value) -> String {
    let only =
        fields(document.follow(choice)).filter(|fields| fields.len() == 1).and_then(|f| f.keys().next());
    only.map_or_else(|| expected(document, choice), |field| format!("{{ {field} = … }}"))
}

/// A choice of words.
pub(super) fn one_of(words: &[&str]) -> String {
    let quoted: Vec<String> = words.iter().map(|word| format!("\"{word}\"")).collect();
    match quoted.as_slice() {
        [only] => only.clone(),
        _ => format!("one of {}", quoted.join(", ")),
    }
}

/// What `value` is, as in "got …".
pub(super) fn got(value: &Value) -> String {
    match value {
        Value::Object(_) => "a table".to_owned(),
        Value::Array(items) => match items.len() {
            1 => "a list of 1 item".to_owned(),
            n => format!("a list of {n} items"),
        },
        Value::String(_) => format!("the text {}", shown(value)),
        _ => shown(value),
    }
}

/// A short rendering of a number, truth or text in which no character can disturb a terminal.
pub(super) fn shown(value: &Value) -> String {
    let text = match value {
        Value::String(text) => quote(text),
        other => other.to_string(),
    };
    if text.chars().count() <= LONGEST {
        return text;
    }
    text.chars().take(LONGEST).chain(['…']).collect()
}

/// `text` as TOML writes it on one line; what is no letter, digit or ASCII is escaped.
pub(super) fn quote(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            '\n' => quoted.push_str("\\n"),
            '\t' => quoted.push_str("\\t"),
            ' '..='~' => quoted.push(c),
            _ if c.is_alphanumeric() => quoted.push(c),
            _ => quoted.push_str(&format!("\\U{:08X}", u32::from(c))),
        }
    }
    quoted.push('"');
    quoted
}

/// The `type` of a schema, null aside.
pub(super) fn type_name(schema: &Value) -> Option<&str> {
    match schema.get("type")? {
        Value::String(name) => Some(name),
        Value::Array(names) => names.iter().filter_map(Value::as_str).find(|name| *name != "null"),
        _ => None,
    }
}

/// The integers that the schema's format can hold, where JSON Schema does not say so by itself.
pub(super) fn width(schema: &Value) -> Option<RangeInclusive<i128>> {
    Some(match schema.get("format")?.as_str()? {
        "int8" => i8::MIN.into()..=i8::MAX.into(),
        "uint8" => 0..=u8::MAX.into(),
        "int16" => i16::MIN.into()..=i16::MAX.into(),
        "uint16" => 0..=u16::MAX.into(),
        "int32" => i32::MIN.into()..=i32::MAX.into(),
        "uint32" => 0..=u32::MAX.into(),
        "int" | "int64" => i64::MIN.into()..=i64::MAX.into(),
        "uint" | "uint64" => 0..=u64::MAX.into(),
        _ => return None,
    })
}

/// The bounds of a number, as in "a number…".
fn interval(schema: &Value) -> String {
    let bound = |name: &str| schema.get(name).filter(|value| value.is_number());
    match (bound("minimum"), bound("exclusiveMinimum"), bound("maximum"), bound("exclusiveMaximum")) {
        (Some(low), _, Some(high), _) => format!(" from {low} to {high}"),
        (Some(low), _, None, Some(high)) => format!(" at least {low} and below {high}"),
        (Some(low), _, None, None) => format!(" of at least {low}"),
        (None, Some(low), Some(high), _) => format!(" above {low} and at most {high}"),
        (None, Some(low), None, Some(high)) => format!(" above {low} and below {high}"),
        (None, Some(low), None, None) => format!(" above {low}"),
        (None, None, Some(high), _) => format!(" of at most {high}"),
        (None, None, None, Some(high)) => format!(" below {high}"),
        (None, None, None, None) => String::new(),
    }
}

/// The bounds of a length, as in "a list…".
fn lengths(schema: &Value, of: &str, unit: &str) -> String {
    let bound = |side: &str| schema.get(format!("{side}{of}")).and_then(Value::as_u64);
    let plural = |n: u64| if n == 1 { format!("{n} {unit}") } else { format!("{n} {unit}s") };
    match (bound("min"), bound("max")) {
        (Some(low), Some(high)) if low == high => format!(" of {}", plural(low)),
        (Some(low), Some(high)) => format!(" of {low} to {}", plural(high)),
        (Some(low), None) => format!(" of at least {}", plural(low)),
        (None, Some(high)) => format!(" of at most {}", plural(high)),
        (None, None) => String::new(),
    }
}
