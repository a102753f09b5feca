//! `--set a.b=value`: changes to a config from the command line.

use serde_json::{Map, Value};

use super::error::{Finding, Place};
use super::expect::got;
use super::schema::{Document, fields, role};
use super::source::{Source, join, override_value};
use crate::fault::{Fault, Faults};

/// The deepest field that an override reaches.
const DEEPEST: usize = 32;

/// What applying overrides led to.
#[derive(Default)]
pub(super) struct Applied {
    /// Overrides that could not be applied.
    pub findings: Vec<Finding>,
    /// Fields that a new `kind` made void.
    pub notices: Vec<String>,
}

/// One step of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Step {
    Key(String),
    Item(usize),
}

/// Applies `overrides` in order. One that is malformed or addresses nothing is left out and found; whether a
/// field exists is left to the check that follows.
pub(super) fn apply(document: &Document, source: &mut Source, overrides: &[String]) -> Applied {
    let mut applied = Applied::default();
    for given in overrides {
        if let Err(fault) = apply_one(document, source, given, &mut applied.notices) {
            applied.findings.push(Finding { place: Place::Override(given.clone()), fault });
        }
    }
    applied
}

fn apply_one(
    document: &Document,
    source: &mut Source,
    given: &str,
    notices: &mut Vec<String>,
) -> Result<(), Fault> {
    let malformed = |message: &str| Fault { path: String::new(), message: message.to_owned() };
    let (path, text) = given
        .split_once('=')
        .ok_or_else(|| malformed("expected `path=value`, for example `metrics[1].k=0.3`; there is no `=`"))?;
    let path = path.trim();
    let steps = parse_path(path).map_err(|message| malformed(&message))?;
    let mut unusable = Faults::new();
    let value = override_value(text.trim(), path, &mut unusable)
        .map_err(|message| Fault { path: path.to_owned(), message })?;
    // What fails half way leaves nothing behind.
    let mut tree = source.tree.clone();
    let place = find(&mut tree, &steps)?;
    let number = source.places.add_override(given);
    let switch = matches!(steps.last(), Some(Step::Key(key)) if key == "kind");
    let before = std::mem::replace(place, value);
    source.tree = tree;
    source.overridden(path, number);
    source.unusable.extend(unusable.into_found());
    if let (true, Value::String(before)) = (switch, before) {
        notices.extend(switch_kind(document, source, &steps[..steps.len() - 1], &before, given));
    }
    Ok(())
}

/// Splits `metrics[1].k` into its steps.
fn parse_path(path: &str) -> Result<Vec<Step>, String> {
    let malformed = || format!("{path:?} is no path of a field, such as `metrics[1].k`");
    let mut steps = Vec::new();
    for part in path.split('.') {
        let (key, mut items) = part.split_at(part.find('[').unwrap_or(part.len()));
        let bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if key.is_empty() || !key.chars().all(bare) {
            return Err(malformed());
        }
        steps.push(Step::Key(key.to_owned()));
        while !items.is_empty() {
            let inner = items.strip_prefix('[').and_then(|rest| rest.split_once(']'));
            let (index, rest) = inner.ok_or_else(malformed)?;
            let digits = !index.is_empty() && index.bytes().all(|b| b.is_ascii_digit());
            steps.push(Step::Item(index.parse().ok().filter(|_| digits).ok_or_else(malformed)?));
            items = rest;
        }
    }
    if steps.len() > DEEPEST {
        return Err(format!("the path has {} steps, expected at most {DEEPEST}", steps.len()));
    }
    Ok(steps)
}

/// The value at `steps`; tables on the way, and the field itself, are made where they are missing.
fn find<'a>(tree: &'a mut Value, steps: &[Step]) -> Result<&'a mut Value, Fault> {
    let mut path = String::new();
    let mut value = tree;
    for (i, step) in steps.iter().enumerate() {
        let fault = |message| Err(Fault { path: path.clone(), message });
        value = match (step, value) {
            (Step::Key(key), Value::Object(table)) => {
                path = join(&path, key);
                let wanted = if matches!(steps.get(i + 1), Some(Step::Item(_))) {
                    Value::Array(Vec::new())
                } else {
                    Value::Object(Map::new())
                };
                table.entry(key.as_str()).or_insert(wanted)
            }
            (Step::Item(index), Value::Array(items)) => {
                let there = match items.len() {
                    0 => "the list is empty".to_owned(),
                    1 => "the list has only [0]".to_owned(),
                    n => format!("the list has [0] to [{}]", n - 1),
                };
                let Some(item) = items.get_mut(*index) else {
                    return fault(format!(
                        "has no item [{index}]: {there}; to add one give the whole list, `{path}=[…, …]`"
                    ));
                };
                path = format!("{path}[{index}]");
                item
            }
            (Step::Key(key), other) => {
                let number = other.is_array() && key.bytes().all(|byte| byte.is_ascii_digit());
                let hint = if number { format!("; did you mean `{path}[{key}]`?") } else { String::new() };
                return fault(format!("expected a table to set `{key}` in, got {}{hint}", got(other)));
            }
            (Step::Item(index), other) => {
                return fault(format!("expected a list to set item [{index}] of, got {}", got(other)));
            }
        };
    }
    Ok(value)
}

/// After the `kind` of the plugin at `steps` changed from `before`: drops the fields of the file that only
/// the old kind has, and returns a notice for each. Fields that other overrides wrote stay, to be found by the check.
fn switch_kind(
    document: &Document,
    source: &mut Source,
    steps: &[Step],
    before: &str,
    given: &str,
) -> Vec<String> {
    let Some((role, table)) = plugin_at(document, &mut source.tree, steps) else { return Vec::new() };
    let now = table.get("kind").and_then(Value::as_str).unwrap_or_default().to_owned();
    let known = |kind: &str| document.plugin(role, kind).and_then(fields);
    let (Some(old), Some(new)) = (known(before), known(&now)) else { return Vec::new() };
    let path = spelled(steps);
    let places = &source.places;
    let mut void = Vec::new();
    table.retain(|key, value| {
        let field = join(&path, key);
        let keep = !old.contains_key(key) || new.contains_key(key) || places.is_overridden(&field);
        // What a run wrote out for a default is nothing that anybody asked for.
        if !keep && old[key].get("default") != Some(&*value) {
            void.push(field);
        }
        keep
    });
    let notice = |field: String| {
        source.forget(&field);
        format!("`{field}` is ignored: {before} has this field and {now}, chosen by `--set {given}`, has not")
    };
    void.into_iter().map(notice).collect()
}

/// The role and the table of the plugin at `steps`, if there is a plugin.
fn plugin_at<'a>(
    document: &'a Document,
    tree: &'a mut Value,
    steps: &[Step],
) -> Option<(&'a str, &'a mut Map<String, Value>)> {
    let mut schema = document.root();
    let mut value = tree;
    for step in steps {
        let settled = document.settle(schema, value);
        (schema, value) = match step {
            Step::Key(key) => {
                let named = fields(settled).and_then(|fields| fields.get(key));
                (named.or_else(|| settled.get("additionalProperties"))?, value.get_mut(key)?)
            }
            Step::Item(index) => (settled.get("items")?, value.get_mut(index)?),
        };
    }
    Some((role(document.follow(schema))?, value.as_object_mut()?))
}

/// The path that `steps` were parsed from.
fn spelled(steps: &[Step]) -> String {
    steps.iter().fold(String::new(), |path, step| match step {
        Step::Key(key) => join(&path, key),
        Step::Item(index) => format!("{path}[{index}]"),
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use super::super::fixture::{ALL, Toy};
    use super::super::{Reading, read};
    use crate::config::ConfigError;

    const BASE: &str = "\
seed = 1
simulator = { kind = 'point_mass', wall = 3.0 }
[[metrics]]
kind = 'maximum_mean'
[[metrics]]
kind = 'negative_tail'
k = 0.4
alpha = 2.0
";

    fn set(overrides: &[&str]) -> Result<Reading<Toy>, ConfigError> {
        let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
        read(BASE, Path::new("x"), &overrides, ALL)
    }

    fn said(overrides: &[&str]) -> String {
        set(overrides).unwrap_err().to_string()
    }

    fn value(overrides: &[&str]) -> serde_json::Value {
        serde_json::to_value(set(overrides).unwrap().config).unwrap()
    }

    #[test]
    fn overrides_reach_every_depth_and_the_last_one_wins() {
        let value = value(&[
            "seed=0x10",
            "metrics[1].k=0.3",
            "discover.at_fall=continue",
            "discover.candidates = 7",
            "discover.candidates=8",
            "tasks.cost={ low = -2, high = -1 }",
            "metrics[0]={ kind = 'odd', inner = { name = \"a = b\" } }",
        ]);
        assert_eq!(value["seed"], 16);
        assert_eq!(value["metrics"][1]["k"], 0.3);
        assert_eq!(value["metrics"][1]["alpha"], 2.0);
        assert_eq!(value["discover"]["at_fall"], "continue");
        assert_eq!(value["discover"]["candidates"], 8);
        assert_eq!(value["tasks"]["cost"]["low"], -2.0);
        assert_eq!(value["metrics"][0]["inner"]["name"], "a = b");
    }

    #[test]
    fn bad_overrides_are_refused() {
        for (given, message) in [
            ("seed", "expected `path=value`, for example `metrics[1].k=0.3`; there is no `=`"),
            ("=3", "\"\" is no path of a field, such as `metrics[1].k`"),
            ("a..b=3", "\"a..b\" is no path of a field, such as `metrics[1].k`"),
            ("metrics[x].k=3", "\"metrics[x].k\" is no path of a field, such as `metrics[1].k`"),
            ("metrics[+1].k=3", "\"metrics[+1].k\" is no path of a field, such as `metrics[1].k`"),
            ("metrics[1.k=3", "\"metrics[1.k\" is no path of a field, such as `metrics[1].k`"),
            ("metrics[1]k=3", "\"metrics[1]k\" is no path of a field, such as `metrics[1].k`"),
            (
                "metrics[2].k=3",
                "`metrics`: has no item [2]: the list has [0] to [1]; to add one give the whole list, `metrics=[…, …]`",
            ),
            (
                "extra.layers[0]=a",
                "`extra.layers`: has no item [0]: the list is empty; to add one give the whole list, `extra.layers=[…, …]`",
            ),
            (
                "metrics.1.k=3",
                "`metrics`: expected a table to set `1` in, got a list of 2 items; did you mean `metrics[1]`?",
            ),
            ("seed.x=3", "`seed`: expected a table to set `x` in, got 1"),
            ("simulator[0]=3", "`simulator`: expected a list to set item [0] of, got a table"),
            ("seed=", "`seed`: has no value after `=`; write \"\" for empty text"),
            ("simulator.wall=inf", "`simulator.wall`: expected a finite number, got inf"),
            (
                "simulator.wal=2",
                "`simulator.wal`: is unknown; expected one of kind, wall, reset_spread; did you mean `wall`?",
            ),
            (
                "simulator.wall=far",
                "`simulator.wall`: expected a number of at least 0.01, got the text \"far\"",
            ),
            (
                "sed=2",
                "`sed`: is unknown; expected one of seed, simulator, tasks, metrics, extra, discover, selector; did you mean `seed`?",
            ),
        ] {
            assert_eq!(said(&[given]), format!("--set {given}: {message}"));
        }
        let message = said(&["seed=[1"]);
        assert!(
            message.starts_with("--set seed=[1: `seed`: is neither a TOML value nor a plain word: "),
            "{message}"
        );
        assert!(said(&[&format!("{}=1", vec!["a"; 33].join("."))]).contains("33 steps, expected at most 32"));
    }

    #[test]
    fn an_override_mends_what_the_file_has_wrong() {
        let text = BASE.replace("3.0", "inf").replace("seed = 1", "seed = 'x'");
        assert_eq!(read::<Toy>(&text, Path::new("x"), &[], ALL).unwrap_err().findings().len(), 2);
        let overrides = ["simulator.wall=3".to_owned(), "seed=2".to_owned()];
        read::<Toy>(&text, Path::new("x"), &overrides, ALL).unwrap();
    }

    #[test]
    fn another_kind_keeps_the_fields_it_has_and_says_which_it_has_not() {
        let reading = set(&["metrics[1].kind=positive_skew"]).unwrap();
        assert_eq!(reading.config.metrics[1].label(), "positive_skew(k=0.4)");
        assert_eq!(
            reading.notices,
            [
                "`metrics[1].alpha` is ignored: negative_tail has this field and positive_skew, chosen by `--set metrics[1].kind=positive_skew`, has not"
            ]
        );
        assert!(set(&["metrics[1].kind=negative_tail"]).unwrap().notices.is_empty());
        // As a run writes it out.
        let default = BASE.replace("alpha = 2.0", "alpha = 1.0");
        let overrides = ["metrics[1].kind=positive_skew".to_owned()];
        let reading = read::<Toy>(&default, Path::new("x"), &overrides, ALL).unwrap();
        assert!(reading.notices.is_empty(), "{:?}", reading.notices);
    }

    #[test]
    fn another_kind_drops_nothing_that_was_asked_for_or_is_unknown() {
        assert_eq!(
            said(&["metrics[1].alpha=3", "metrics[1].kind=positive_skew"]),
            "--set metrics[1].alpha=3: `metrics[1].alpha`: is unknown; expected one of kind, k"
        );
        assert_eq!(
            said(&["metrics[1].beta=3", "metrics[1].kind=positive_skew"]).lines().count(),
            1,
            "a field of neither kind stays a fault"
        );
        let message = said(&["metrics[1].kind=positive_skw"]);
        assert!(message.ends_with("did you mean \"positive_skew\"?"), "{message}");
    }
}
