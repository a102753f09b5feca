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
fn it_acts_by_the_option_that_was_stored() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in push_right(4).files() {
        std::fs::write(folder.path().join(name), bytes).expect("a writable folder");
    }
    let output = Command::new(env!("CARGO_BIN_EXE_act-by-options")).arg(folder.path()).output();
    let output = output.expect("it starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // The only option begins again each time that it has ended.
    assert_eq!(String::from_utf8_lossy(&output.stdout), "[1.0]\n".repeat(10));
}

#[test]
fn a_folder_without_a_set_is_refused() {
    let output = Command::new(env!("CARGO_BIN_EXE_act-by-options")).arg("/nowhere").output();
    let stderr = String::from_utf8_lossy(&output.expect("it starts").stderr).into_owned();
    assert!(stderr.contains("manifest.json"), "{stderr}");
}
