//! Files that a user's code is given as keyword arguments.

use std::collections::BTreeMap;
use std::path::Path;

use elo_core::fault::Faults;
use serde_json::{Map, Value};

/// Keyword arguments, and the paths of the files.
pub(super) type Files = BTreeMap<String, String>;

/// Makes the paths absolute: they are relative to `folder`, the config's.
pub(super) fn embed(files: &mut Files, folder: &Path, faults: &mut Faults) {
    for (name, path) in files {
        let joined = folder.join(&*path);
        faults.check(joined.is_file(), &format!("files.{name}"), || {
            format!("there is no file {}", joined.display())
        });
        *path = std::path::absolute(&joined).unwrap_or(joined).to_string_lossy().into_owned();
    }
}

/// No argument can be given twice.
pub(super) fn validate(files: &Files, kwargs: &Map<String, Value>, faults: &mut Faults) {
    for name in files.keys().filter(|name| kwargs.contains_key(*name)) {
        faults.add(
            &format!("files.{name}"),
            "is an argument in `kwargs` too; expected it in one of them".to_owned(),
        );
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn paths_are_relative_to_the_config_and_slips_are_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("gear.txt"), "1").unwrap();
        let mut files: Files = [("gear", "gear.txt"), ("model", "gone.zip")]
            .map(|(name, path)| (name.to_owned(), path.to_owned()))
            .into();
        let kwargs = serde_json::from_str(r#"{"gear": 1, "other": 2}"#).unwrap();
        let mut faults = Faults::new();
        embed(&mut files, folder.path(), &mut faults);
        validate(&files, &kwargs, &mut faults);
        assert_eq!(files["gear"], folder.path().join("gear.txt").to_str().unwrap());
        let found: Vec<String> = faults.into_found().iter().map(ToString::to_string).collect();
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(
            found[0].starts_with("`files.model`: there is no file") && found[0].ends_with("gone.zip"),
            "{found:?}"
        );
        assert!(found[1].starts_with("`files.gear`: is an argument in `kwargs` too"), "{found:?}");
    }
}
