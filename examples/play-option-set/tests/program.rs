//! The program on an option set that is made here, by hand.

use std::process::Command;

use elo_core::conformance::point_mass::PointMassConfig;
use elo_core::metric::Reference;
use elo_core::option_set::{Manifest, OPTION_SET_FORMAT, OptionEntry, OptionSet};
use elo_core::policy::{Demonstration, OptionLearner as _};
use elo_core::returns::Scale;
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_learners::open_loop::OpenLoopConfig;

/// One option that pushes the point mass to the right for `steps` steps.
fn push_right(steps: usize) -> OptionSet {
    let spec = PointMassConfig::default().description();
    let demonstration =
        Demonstration { observations: vec![0.0; 2 * steps], actions: vec![1.0; steps], steps };
    let option =
        OpenLoopConfig::default().learn(&demonstration, &spec, &Seed::root(0)).expect("it can be replayed");
    let record = option.record();
    let manifest = Manifest {
        format: OPTION_SET_FORMAT,
        metric: "by hand".to_owned(),
        spec,
        horizon: Horizon { steps, discount: 1.0, stop_at_fall: true },
        scale: Scale { offset: 0.0, scale: 1.0 },
        reference: Reference { mean: 0.0, standard_deviation: 0.0 },
        options: vec![OptionEntry { number: 7, policy: record.format.clone(), selection_score: 0.0 }],
        experiment: serde_json::json!({ "simulator": { "kind": "point_mass" } }),
    };
    OptionSet { manifest, options: vec![record] }
}

#[test]
fn it_plays_the_option_that_was_stored() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in push_right(10).files() {
        std::fs::write(folder.path().join(name), bytes).expect("a writable folder");
    }
    let output =
        Command::new(env!("CARGO_BIN_EXE_play-option-set")).arg(folder.path()).output().expect("it starts");
    let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{stderr}");
    // After n steps of 0.05 s at 1 m/s² the mass is 0.00125 n (n + 1) m from its start, 0.55 m summed over ten steps, and
    // the start lies within 0.1 m of 0. A step pays 1 - |x| - 0.1: all ten pay 9 less at most 0.55 + 1.
    let printed: f64 = stdout
        .strip_prefix("option 7: return ")
        .and_then(|rest| rest.strip_suffix(" in 10 steps\n"))
        .and_then(|number| number.parse().ok())
        .unwrap_or_else(|| panic!("{stdout}"));
    assert!((7.4..=9.1).contains(&printed), "{printed}");
}

#[test]
fn without_a_set_it_says_what_is_missing() {
    let output = Command::new(env!("CARGO_BIN_EXE_play-option-set")).output().expect("it starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && stderr.contains("the folder of an option set"), "{stderr}");
}
