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

fn metadata(arguments: &[&str]) -> Value {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace");
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(arguments)
        .current_dir(root)
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
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
    let arrows = arrows(&metadata(&["--no-deps"]));
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

/// The names of all packages that `package` is built from, itself among them, without what only tests and build scripts
/// need.
fn closure(metadata: &Value, package: &str) -> BTreeSet<String> {
    let names: BTreeMap<&str, &str> = list(metadata, "packages")
        .iter()
        .map(|package| (text(package, "id"), text(package, "name")))
        .collect();
    let nodes: BTreeMap<&str, &Value> =
        list(&metadata["resolve"], "nodes").iter().map(|node| (text(node, "id"), node)).collect();
    let normal =
        |dependency: &&Value| list(dependency, "dep_kinds").iter().any(|kind| kind["kind"].is_null());
    let mut open: Vec<&str> = names.iter().filter(|(_, name)| **name == package).map(|(id, _)| *id).collect();
    let mut found = BTreeSet::new();
    while let Some(id) = open.pop() {
        if found.insert(id) {
            open.extend(
                list(nodes[id], "deps").iter().filter(normal).map(|dependency| text(dependency, "pkg")),
            );
        }
    }
    found.iter().map(|id| names[id].to_owned()).collect()
}

#[test]
fn the_core_is_built_without_engines_and_the_program_without_mujoco() {
    let metadata = metadata(&[]);
    let core = closure(&metadata, "elo-core");
    assert!(core.contains("safetensors"), "{core:?}");
    for name in NOT_IN_CORE {
        assert!(!core.contains(name), "elo-core is built from {name}");
    }
    let program = closure(&metadata, "elo-cli");
    assert!(program.contains("rapier3d-f64"), "{program:?}");
    assert!(!program.contains("mujoco-rs"), "elo links libmujoco, which may be absent");
}
