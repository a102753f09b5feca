//! An option set that is made here, by hand, for the tests of the programs that load one.

use elo_core::conformance::point_mass::PointMassConfig;
use elo_core::metric::Reference;
use elo_core::option_set::{Manifest, OPTION_SET_FORMAT, OptionEntry, OptionSet};
use elo_core::policy::{Demonstration, Imitate as _};
use elo_core::returns::Scale;
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_learners::open_loop::OpenLoopConfig;
use tempfile::TempDir;

/// A folder with a set of one option, which pushes the point mass to the right for `steps` steps.
pub fn push_right(steps: usize) -> TempDir {
    let spec = PointMassConfig::default().description();
    let demonstration =
        Demonstration { observations: vec![0.0; 2 * steps], actions: vec![1.0; steps], steps };
    let option =
        OpenLoopConfig::default().learn(&demonstration, &spec, &Seed::root(0)).expect("it can be replayed");
    let record = option.record();
    let manifest = Manifest {
        format: OPTION_SET_FORMAT,
        tensors_blake3: None,
        metric: "by hand".to_owned(),
        spec,
        horizon: Horizon { steps, discount: 1.0, stop_at_fall: true },
        scale: Scale { offset: 0.0, scale: 1.0 },
        reference: Reference { mean: 0.0, standard_deviation: 0.0 },
        options: vec![OptionEntry { number: 7, policy: record.format.clone(), selection_score: 0.0 }],
        experiment: serde_json::json!({ "simulator": { "kind": "point_mass" } }),
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in (OptionSet { manifest, options: vec![record] }).files() {
        std::fs::write(folder.path().join(name), bytes).expect("a writable folder");
    }
    folder
}
