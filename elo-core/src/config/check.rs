//! The structural check: a tree of values against the schema, with every fault of it found.
//!
//! It knows the keywords that schemars derives from structs, enums, maps, lists, tuples and
//! `#[schemars(range, length)]`. Tables are closed: a key that the schema does not name is a fault.

use serde_json::{Map, Value};

use super::expect::{expected, got, one_of, type_name, width, words};
use super::schema::{Document, choices, fields, role, tag};
use super::source::quoted;
use crate::fault::{Faults, meant};

/// Finds every fault of the config `tree`. Nulls are what `Source` could not convert and has reported.
pub(super) fn check(document: &Document, tree: &Value, faults: &mut Faults) {
    Check { document, faults }.value(document.root(), tree);
}

struct Check<'a> {
    document: &'a Document,
    faults: &'a mut Faults,
}

impl Check<'_> {
    fn value(&mut self, schema: &Value, value: &Value) {
        if value.is_null() {
            return;
        }
        let schema = self.document.follow(schema);
        if let Some(role) = role(schema) {
            return self.plugin(role, schema, value);
        }
        if let Some(words) = words(self.document, schema) {
            return self.word(&words, value);
        }
        if !choices(schema).is_empty() {
            return self.choice(schema, value);
        }
        match (type_name(schema), value) {
            (Some("integer"), Value::Number(number)) if !number.is_f64() => self.number(schema, value),
            (Some("number"), Value::Number(_)) => self.number(schema, value),
            (Some("string"), Value::String(text)) => {
                self.length(schema, "Length", text.chars().count(), value);
            }
            (Some("array"), Value::Array(items)) => self.list(schema, value, items),
            (Some("object"), Value::Object(table)) => self.table(schema, table),
            (Some("boolean"), Value::Bool(_)) | (None, _) => {}
            _ => self.mismatch(schema, value),
        }
    }

    /// "expected …, got …"
    fn mismatch(&mut self, schema: &Value, value: &Value) {
        let mut message = format!("expected {}, got {}", expected(self.document, schema), got(value));
        if value.is_object() && type_name(schema) == Some("array") {
            message.push_str("; write the table's header in two pairs of brackets, one table an item");
        }
        self.faults.add("", message);
    }

    fn word(&mut self, words: &[&str], value: &Value) {
        match value.as_str() {
            Some(word) if words.contains(&word) => {}
            word => {
                let meant = word.map_or(String::new(), |word| meant(word, words.iter().copied(), '"'));
                self.faults.add("", format!("expected {}, got {}{meant}", one_of(words), got(value)));
            }
        }
    }

    fn number(&mut self, schema: &Value, value: &Value) {
        let bound = |name: &str| schema.get(name).and_then(Value::as_f64);
        let number = value.as_f64().unwrap_or(f64::NAN);
        let inside = bound("minimum").is_none_or(|low| number >= low)
            && bound("maximum").is_none_or(|high| number <= high)
            && bound("exclusiveMinimum").is_none_or(|low| number > low)
            && bound("exclusiveMaximum").is_none_or(|high| number < high);
        if !inside {
            return self.mismatch(schema, value);
        }
        let integer = value.as_i64().map(i128::from).or_else(|| value.as_u64().map(i128::from));
        if schema.get("format").and_then(Value::as_str) == Some("float") && (number as f32).is_infinite() {
            self.faults.add("", format!("expected a number between -3.4e38 and 3.4e38, got {number:e}"));
        }
        if let Some((integer, width)) = integer.zip(width(schema))
            && !width.contains(&integer)
        {
            let (low, high) = width.into_inner();
            self.faults.add("", format!("expected an integer from {low} to {high}, got {integer}"));
        }
    }

    fn length(&mut self, schema: &Value, of: &str, length: usize, value: &Value) {
        let bound = |side: &str| schema.get(format!("{side}{of}")).and_then(Value::as_u64);
        let length = length as u64;
        if bound("min").is_some_and(|low| length < low) || bound("max").is_some_and(|high| length > high) {
            self.mismatch(schema, value);
        }
    }

    fn list(&mut self, schema: &Value, value: &Value, items: &[Value]) {
        self.length(schema, "Items", items.len(), value);
        let places = schema.get("prefixItems").and_then(Value::as_array);
        let each = schema.get("items");
        for (i, item) in items.iter().enumerate() {
            let schema = places.and_then(|places| places.get(i)).or(each);
            if let Some(schema) = schema {
                self.below(&format!("[{i}]"), schema, item);
            }
        }
        let repeats = items.iter().enumerate().skip(1).filter(|(i, item)| items[..*i].contains(item));
        if schema.get("uniqueItems").and_then(Value::as_bool) == Some(true) {
            for (i, item) in repeats {
                self.faults.add(&format!("[{i}]"), format!("repeats {} of the same list", got(item)));
            }
        }
    }

    fn table(&mut self, schema: &Value, table: &Map<String, Value>) {
        let none = Map::new();
        let named = fields(schema);
        // A struct that forgot to refuse unknown fields refuses them here all the same.
        let closed = if named.is_some() { &Value::Bool(false) } else { &Value::Bool(true) };
        let others = schema.get("additionalProperties").unwrap_or(closed);
        let named = named.unwrap_or(&none);
        for (key, value) in table {
            match (named.get(key), others) {
                (Some(field), _) => self.below(&quoted(key), field, value),
                (None, Value::Bool(false)) => self.unknown(key, named, table),
                (None, Value::Bool(true)) => {}
                (None, schema) => self.below(&quoted(key), schema, value),
            }
        }
        let required = schema.get("required").and_then(Value::as_array);
        for key in required.into_iter().flatten().filter_map(Value::as_str) {
            if !table.contains_key(key) {
                let what =
                    named.get(key).map_or("a value".to_owned(), |field| expected(self.document, field));
                self.faults.add(key, format!("is missing; expected {what}"));
            }
        }
    }

    /// A key that no field has; the best hint is a field that the table does not have yet.
    fn unknown(&mut self, key: &str, named: &Map<String, Value>, table: &Map<String, Value>) {
        let free = named.keys().filter(|name| !table.contains_key(*name));
        let mut hint = meant(key, free.map(String::as_str), '`');
        if hint.is_empty() {
            hint = meant(key, named.keys().map(String::as_str), '`');
        }
        let known: Vec<&str> = named.keys().map(String::as_str).collect();
        let message = match known.as_slice() {
            [] => "is unknown; this table has no fields".to_owned(),
            ["kind"] => "is unknown; this `kind` has no fields of its own".to_owned(),
            [only] => format!("is unknown; expected only {only}"),
            _ => format!("is unknown; expected one of {}", known.join(", ")),
        };
        self.faults.add(&quoted(key), message + &hint);
    }

    fn plugin(&mut self, role: &str, schema: &Value, value: &Value) {
        let Value::Object(table) = value else { return self.mismatch(schema, value) };
        let kinds = self.document.kinds(role);
        let list = if kinds.is_empty() { "none in this program".to_owned() } else { kinds.join(", ") };
        match table.get("kind") {
            None => self.faults.add("kind", format!("is missing; the kinds of {role} are: {list}")),
            Some(Value::String(kind)) => match self.document.plugin(role, kind) {
                Some(fields) => self.table(fields, table),
                None => {
                    let meant = meant(kind, kinds, '"');
                    let kind = got(&table["kind"]);
                    self.faults.add("kind", format!("expected a kind of {role} ({list}), got {kind}{meant}"));
                }
            },
            Some(Value::Null) => {}
            Some(other) => {
                let other = got(other);
                self.faults.add("kind", format!("expected a kind of {role} ({list}), got {other}"));
            }
        }
    }

    /// Checks against the choice that `value` is closest to: the one with the fewest faults, the first of
    /// equals.
    fn choice(&mut self, schema: &Value, value: &Value) {
        let document = self.document;
        let fits = |choice: &&Value| {
            let choice = document.follow(choice);
            match value {
                Value::Object(_) => type_name(choice) == Some("object") || role(choice).is_some(),
                Value::Array(_) => type_name(choice) == Some("array"),
                _ => true,
            }
        };
        let faults_of = |choice: &&Value| {
            let mut trial = Faults::new();
            Check { document, faults: &mut trial }.value(choice, value);
            trial.found().len()
        };
        let choices = choices(schema);
        if let (Some((tag, words)), Value::Object(table)) = (tag(document, &choices), value) {
            let given = table.get(tag);
            return match words.iter().position(|word| given.and_then(Value::as_str) == Some(word)) {
                Some(index) => self.value(choices[index], value),
                None => match given {
                    Some(other) => {
                        self.faults.within(tag, |faults| Check { document, faults }.word(&words, other));
                    }
                    None => self.faults.add(tag, format!("is missing; expected {}", one_of(&words))),
                },
            };
        }
        let best = choices.into_iter().filter(fits).min_by_key(faults_of);
        match best {
            Some(best) if value.is_object() || value.is_array() || faults_of(&best) == 0 => {
                self.value(best, value);
            }
            _ => self.mismatch(schema, value),
        }
    }

    fn below(&mut self, field: &str, schema: &Value, value: &Value) {
        let document = self.document;
        self.faults.within(field, |faults| Check { document, faults }.value(schema, value));
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use super::super::fixture::{ALL, Toy};
    use super::super::read;

    /// What is said of a config with this seed, simulator and metrics, without the file's name.
    fn said(text: &str) -> Vec<String> {
        let error = read::<Toy>(text, Path::new("x"), &[], ALL).unwrap_err();
        error.to_string().lines().map(|line| line.strip_prefix("x:").unwrap_or(line).to_owned()).collect()
    }

    /// The message about the one fault of an otherwise good config in which `odd` has this field.
    fn said_of_odd(field: &str) -> String {
        let text = format!(
            "seed = 1\nsimulator = {{ kind = 'point_mass' }}\nmetrics = [{{ kind = 'odd', {field} }}]\n"
        );
        let said = said(&text);
        assert_eq!(said.len(), 1, "{field}: {said:?}");
        said[0].strip_prefix("3: `metrics[0].").unwrap().to_owned()
    }

    #[test]
    fn each_fault_says_what_was_expected_and_what_came() {
        for (field, message) in [
            (
                "clop = 1",
                "clop`: is unknown; expected one of kind, clip, limit, pair, layers, weights, inner, rule, start, quick; did you mean `clip`?",
            ),
            (
                "\"a.b\\u001b\" = 1",
                "\"a.b\\U0000001B\"`: is unknown; expected one of kind, clip, limit, pair, layers, weights, inner, rule, start, quick",
            ),
            ("clip = true", "clip`: expected a number above 0.0, got true"),
            ("clip = 0", "clip`: expected a number above 0.0, got 0"),
            ("clip = 1e300", "clip`: expected a number between -3.4e38 and 3.4e38, got 1e300"),
            ("clip = nan", "clip`: expected a finite number, got nan"),
            ("limit = 11", "limit`: expected an integer from 0 to 10, got 11"),
            ("limit = 1.0", "limit`: expected an integer from 0 to 10, got 1.0"),
            ("limit = 99999999999999999999", "limit`: 99999999999999999999 is too large for any integer"),
            ("pair = [1]", "pair`: expected a list of 2 items, got a list of 1 item"),
            ("pair = [1, '2']", "pair[1]`: expected a number, got the text \"2\""),
            ("layers = []", "layers`: expected a list of at least 1 item, got a list of 0 items"),
            (
                "layers = { a = 1 }",
                "layers`: expected a list of at least 1 item, got a table; write the table's header in two pairs of brackets, one table an item",
            ),
            ("weights = { 'b c' = 'x' }", "weights.\"b c\"`: expected a number, got the text \"x\""),
            ("inner = 3", "inner`: expected a table, got 3"),
            (
                "inner = { nam = 'x' }",
                "inner.nam`: is unknown; expected one of name, offset; did you mean `name`?",
            ),
            (
                "inner = { offset = 3000000000 }",
                "inner.offset`: expected an integer from -2147483648 to 2147483647, got 3000000000",
            ),
            (
                "rule = 'after'",
                "rule`: expected a table with `rule`, one of \"never\", \"after\", got the text \"after\"",
            ),
            ("rule = {}", "rule.rule`: is missing; expected one of \"never\", \"after\""),
            (
                "rule = { rule = 'aftr' }",
                "rule.rule`: expected one of \"never\", \"after\", got the text \"aftr\"; did you mean \"after\"?",
            ),
            ("rule = { rule = 'after' }", "rule.steps`: is missing; expected an integer of at least 0"),
            ("rule = { rule = 'never', steps = 1 }", "rule.steps`: is unknown; expected only rule"),
            ("start = 'x'", "start`: expected \"standard\" or { seed = … }, got the text \"x\""),
            ("start = { seed = -1 }", "start.seed`: expected an integer of at least 0, got -1"),
            ("quick = 1979-05-27", "quick`: no field holds a date; write \"1979-05-27\" where text is meant"),
            (
                "quick = 'a long text that goes on and on, far beyond what anyone wants to read again'",
                "quick`: expected true or false, got the text \"a long text that goes on and on, far beyond what anyone wan…",
            ),
        ] {
            assert_eq!(said_of_odd(field), message);
        }
    }

    #[test]
    fn kinds_are_named_where_one_is_missing_or_wrong() {
        let with = |simulator: &str| said(&format!("seed = 1\nmetrics = []\n[simulator]\n{simulator}\n"));
        let list = "the kinds of simulator are: point_mass";
        assert_eq!(with(""), [format!("3: `simulator.kind`: is missing; {list}")]);
        let unknown = "expected a kind of simulator (point_mass), got";
        let hint = "did you mean \"point_mass\"?";
        assert_eq!(
            with("kind = 'pointmass'"),
            [format!("4: `simulator.kind`: {unknown} the text \"pointmass\"; {hint}")]
        );
        assert_eq!(with("kind = 'bullet'"), [format!("4: `simulator.kind`: {unknown} the text \"bullet\"")]);
        assert_eq!(with("kind = 3"), [format!("4: `simulator.kind`: {unknown} 3")]);
        assert_eq!(
            said("seed = 1\nmetrics = []\nsimulator = 'point_mass'"),
            [
                "3: `simulator`: expected a table with the `kind` of a simulator (point_mass), got the text \"point_mass\""
            ]
        );
    }

    #[test]
    fn all_faults_come_at_once_in_the_order_of_the_file() {
        let text = "\
sed = 3
[discover]
set_size = 5_000_000_000
discount = 1.5
candidates = 0
at_fall = 'stp'
[simulator]
kind = 'point_mass'
wall = 'far'
[[metrics]]
kind = 'negative_tail'
beta = 1
[[metrics]]
k = 0.3
[tasks]
cost = { low = 1 }
[extra]
kind = 'odd'
limit = 300
";
        assert_eq!(
            said(text),
            [
                " `seed`: is missing; expected an integer of at least 0",
                "1: `sed`: is unknown; expected one of seed, simulator, tasks, metrics, extra, discover, selector; did you mean `seed`?",
                "3: `discover.set_size`: expected an integer from 0 to 4294967295, got 5000000000",
                "4: `discover.discount`: expected a number from 0.0 to 1.0, got 1.5",
                "5: `discover.candidates`: expected an integer from 1 to 1000, got 0",
                "6: `discover.at_fall`: expected one of \"stop\", \"continue\", got the text \"stp\"; did you mean \"stop\"?",
                "9: `simulator.wall`: expected a number of at least 0.01, got the text \"far\"",
                "12: `metrics[0].beta`: is unknown; expected one of kind, k, alpha",
                "13: `metrics[1].kind`: is missing; the kinds of metric are: maximum_mean, negative_tail, positive_skew, odd",
                "16: `tasks.cost.high`: is missing; expected a number",
                "19: `extra.limit`: expected an integer from 0 to 10, got 300",
            ]
        );
    }

    #[test]
    fn an_integer_is_a_number_and_nothing_else_is() {
        let text = "seed = 1\nmetrics = [{ kind = 'odd', pair = [1, 2], clip = 3 }]\n[simulator]\nkind = 'point_mass'\nwall = 3";
        let config = read::<Toy>(text, Path::new("x"), &[], ALL).unwrap().config;
        let value = serde_json::to_value(&config).unwrap();
        assert_eq!(value["simulator"]["wall"], 3.0);
        assert_eq!(value["metrics"][0]["pair"], serde_json::json!([1.0, 2.0]));
    }
}
