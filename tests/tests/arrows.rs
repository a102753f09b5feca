//! Dependencies point one way: `elo-core` knows nobody, backends and learners know only `elo-core`, and only the command
//! line, the tests and the examples see both. `elo` itself links no engine that may be absent.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// The packages of this workspace that each library package may name, in any kind of dependency.
const ALLOWED: [(&str, &[&str]); 4] = [
    ("elo-core", &[]),
    ("elo-backends", &["elo-core"]),
    ("elo-learners", &["elo-core"]),
    ("elo-cli", &["elo-backends", "elo-core", "elo-learners"]),
];

/// Physics engines, robot files, linear algebra, command lines: nothing for `elo-core`, however indirectly.
const NOT_IN_CORE: [&str; 8] =
    ["rapier3d-f64", "mujoco-rs", "mjcf-rs", "nalgebra", "faer", "clap", "indicatif", "pyo3"];

/// What cargo prints when run in the workspace.
fn cargo(arguments: &[&str]) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace");
    let output = Command::new(env!("CARGO"))
        .args(arguments)
        .args(["--locked", "--offline"])
        .current_dir(root)
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn list<'a>(value: &'a Value, field: &str) -> &'a [Value] {
    value[field].as_array().map_or(&[], Vec::as_slice)
}

fn text<'a>(value: &'a Value, field: &str) -> &'a str {
    value[field].as_str().unwrap_or_default()
}

/// The packages of the workspace that each of them names, as `cargo metadata --no-deps` has them.
fn arrows(metadata: &Value) -> BTreeMap<String, BTreeSet<String>> {
    let packages = list(metadata, "packages");
    let members: BTreeSet<&str> = packages.iter().map(|package| text(package, "name")).collect();
    let named = |package| list(package, "dependencies").iter().map(|dependency| text(dependency, "name"));
    packages
        .iter()
        .map(|package| {
            let own = named(package).filter(|name| members.contains(name)).map(str::to_owned).collect();
            (text(package, "name").to_owned(), own)
        })
        .collect()
}

/// Every arrow that must not be there.
fn wrong(arrows: &BTreeMap<String, BTreeSet<String>>) -> Vec<String> {
    let allowed: BTreeMap<&str, &[&str]> = ALLOWED.into();
    let of = |(from, to): (&String, &BTreeSet<String>)| -> Vec<String> {
        // Tests and examples may see everything, and nothing may see them.
        let may = |name: &str| match allowed.get(from.as_str()) {
            Some(names) => names.contains(&name),
            None => from == "elo-tests" || allowed.contains_key(name),
        };
        to.iter().filter(|name| !may(name)).map(|name| format!("{from} -> {name}")).collect()
    };
    arrows.iter().flat_map(of).collect()
}

#[test]
fn arrows_point_to_the_core() {
    let metadata = cargo(&["metadata", "--format-version", "1", "--no-deps"]);
    let arrows = arrows(&serde_json::from_str(&metadata).expect("JSON"));
    for (package, _) in ALLOWED {
        assert!(arrows.contains_key(package), "{package} is gone: {arrows:?}");
    }
    assert_eq!(wrong(&arrows), Vec::<String>::new());
}

#[test]
fn arrows_that_point_the_wrong_way_are_seen() {
    let package = |name: &str, to: &[&str]| {
        let dependencies: Vec<Value> = to.iter().map(|name| serde_json::json!({ "name": name })).collect();
        serde_json::json!({ "name": name, "dependencies": dependencies })
    };
    let packages = [
        package("elo-core", &["serde", "elo-learners"]),
        package("elo-backends", &["elo-core", "elo-learners"]),
        package("elo-learners", &["elo-core", "elo-backends"]),
        package("elo-cli", &["elo-core", "an-example"]),
        package("an-example", &["elo-cli", "elo-core"]),
        package("elo-tests", &["elo-core", "an-example"]),
    ];
    let found = wrong(&arrows(&serde_json::json!({ "packages": packages })));
    let expected = [
        "elo-backends -> elo-learners",
        "elo-cli -> an-example",
        "elo-core -> elo-learners",
        "elo-learners -> elo-backends",
    ];
    assert_eq!(found, expected);
}

/// The names of all packages that are linked into `package` with its default features, itself among them.
fn closure(package: &str) -> BTreeSet<String> {
    let tree =
        cargo(&["tree", "--package", package, "--edges", "normal", "--prefix", "none", "--format", "{p}"]);
    tree.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
}

#[test]
fn the_core_is_built_without_engines_and_the_program_without_mujoco() {
    let core = closure("elo-core");
    assert!(core.contains("safetensors"), "{core:?}");
    for name in NOT_IN_CORE {
        assert!(!core.contains(name), "elo-core is built from {name}");
    }
    let program = closure("elo-cli");
    assert!(program.contains("rapier3d-f64"), "{program:?}");
    assert!(!program.contains("mujoco-rs"), "elo links libmujoco, which may be absent");
}
