//! The program with plugins of its own, from a config to an option set.

use std::path::{Path, PathBuf};
use std::process::Command;

fn run(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_own-plugins")).args(arguments).output().expect("it starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {}\n{stderr}", output.status);
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn config() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("cart-pole.toml")
}

#[test]
fn it_lists_and_explains_them_beside_the_others() {
    let list = run(&["plugins"]);
    for kind in ["cart_pole", "worst_share", "rapier", "maximum_mean", "ppo"] {
        assert!(list.lines().any(|line| line.split_whitespace().next() == Some(kind)), "{kind} in:\n{list}");
    }
    assert!(run(&["example", "cart_pole"]).contains("fall_angle = 0.7"));
}

#[test]
fn a_config_uses_both_from_teachers_to_sets() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let config = config();
    let paths = [config.to_str().expect("UTF-8"), out.to_str().expect("UTF-8")];
    let report = run(&["discover", paths[0], "--out", paths[1], "--json"]);
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["robot"], "cart-pole");
    let labels: Vec<_> = report["sets"].as_array().expect("sets").iter().map(|set| &set["metric"]).collect();
    assert_eq!(labels, ["maximum_mean", "worst_share(0.1)"]);
    assert!(out.join("results/option_sets/worst_share_0.1/options.safetensors").is_file());
}
