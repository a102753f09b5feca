//! Both programs run, at the smallest sizes that mean anything.

use std::process::Command;

fn lines(program: &str, arguments: &[&str]) -> Vec<String> {
    let output = Command::new(program).args(arguments).output().expect("cargo built it");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).lines().map(str::to_owned).collect()
}

#[test]
fn learning_curves() {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../half-cheetah-quick.toml");
    let sizes = ["teacher.steps=4096", "teacher.snapshots=2", "teacher.d0_pool=2"];
    let arguments = [&[config, "2"], &sizes[..]].concat();
    let lines = lines(env!("CARGO_BIN_EXE_learning-curves"), &arguments);
    assert_eq!(lines[0], "engine,robot,seed,steps,mean_return,standard_deviation,mean_length,falls");
    let mut begins: Vec<&str> = lines[1..].iter().map(|line| &line[..26]).collect();
    begins.sort_unstable();
    let of = |seed, steps| format!("rapier,half-cheetah,{seed},{steps}");
    assert_eq!(begins, [of(1, "2048"), of(1, "4096"), of(2, "2048"), of(2, "4096")]);
}

#[test]
fn random_policy() {
    let lines = lines(env!("CARGO_BIN_EXE_random-policy"), &["rapier", "walker2d", "10"]);
    let value = |figure: &str| {
        let line = lines.iter().find_map(|line| line.strip_prefix(&format!("{figure},")));
        line.and_then(|value| value.parse::<f64>().ok()).unwrap_or_else(|| panic!("no {figure} in {lines:?}"))
    };
    // The robot stands for some steps and falls.
    assert_eq!((value("falls"), value("alive_after_5"), value("alive_after_200")), (1.0, 1.0, 0.0));
    assert!(value("mean_length") > 5.0 && value("alive_a_step") > 0.5, "{lines:?}");
}
