//! What is wrong with a configuration: one [`Fault`] a finding, all findings at once.

use std::fmt;

/// One thing wrong with one field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The field's path, e.g. `simulator.robot` or `metrics[1].k`.
    pub path: String,
    /// What is wrong, what was expected and what came, in one sentence.
    pub message: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.path.is_empty() {
            f.write_str(&self.message)
        } else {
            write!(f, "`{}`: {}", self.path, self.message)
        }
    }
}

/// A list of faults being gathered, with the path of the field that is being looked at.
///
/// `validate` methods of plugins get one of these that already points at their own table, so the paths that they give
/// are their own field names.
#[derive(Debug, Default)]
pub struct Faults {
    prefix: String,
    found: Vec<Fault>,
}

impl Faults {
    /// An empty list at the root.
    pub fn new() -> Self {
        Self::default()
    }

    /// Notes a fault of `field`; an empty name means the table itself.
    pub fn add(&mut self, field: &str, message: impl Into<String>) {
        let path = join(&self.prefix, field);
        self.found.push(Fault { path, message: message.into() });
    }

    /// Notes a fault unless `holds`.
    pub fn check(&mut self, holds: bool, field: &str, message: impl FnOnce() -> String) {
        if !holds {
            self.add(field, message());
        }
    }

    /// Runs `look` with every path put below `field`.
    pub fn within(&mut self, field: &str, look: impl FnOnce(&mut Self)) {
        let below = join(&self.prefix, field);
        let before = std::mem::replace(&mut self.prefix, below);
        look(self);
        self.prefix = before;
    }

    /// Everything found so far.
    pub fn found(&self) -> &[Fault] {
        &self.found
    }

    /// Everything found.
    pub fn into_found(self) -> Vec<Fault> {
        self.found
    }
}

fn join(prefix: &str, field: &str) -> String {
    match (prefix.is_empty(), field.is_empty()) {
        (true, _) => field.to_owned(),
        (_, true) => prefix.to_owned(),
        _ if field.starts_with('[') => format!("{prefix}{field}"),
        _ => format!("{prefix}.{field}"),
    }
}

/// The hint that ends a message about an unknown name: the one among `known` that `given` was probably meant to be, in marks `mark`, or
/// nothing.
pub fn meant<'a>(given: &str, known: impl IntoIterator<Item = &'a str>, mark: char) -> String {
    nearest(given, known).map_or(String::new(), |name| format!("; did you mean {mark}{name}{mark}?"))
}

/// At most a third of its letters are wrong.
fn nearest<'a>(given: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    known
        .into_iter()
        .map(|name| (strsim::damerau_levenshtein(given, name), name))
        .filter(|(distance, name)| *distance <= name.len().max(given.len()).div_ceil(3))
        .min()
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_joined_as_toml_writes_them() {
        let mut faults = Faults::new();
        faults.within("metrics", |f| f.within("[1]", |f| f.add("k", "is negative")));
        faults.within("simulator", |f| f.add("", "is missing"));
        let text: Vec<String> = faults.into_found().iter().map(ToString::to_string).collect();
        assert_eq!(text, ["`metrics[1].k`: is negative", "`simulator`: is missing"]);
    }

    #[test]
    fn nearest_name_forgives_slips_and_not_other_words() {
        let known = ["rapier", "mujoco"];
        assert_eq!(nearest("mujcoo", known), Some("mujoco"));
        assert_eq!(nearest("bullet", known), None);
        assert_eq!(meant("mujcoo", known, '`'), "; did you mean `mujoco`?");
        assert_eq!(meant("bullet", known, '`'), "");
    }
}
