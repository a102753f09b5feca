//! `elo crosscheck`: an engine agrees with itself in everything, and two engines are compared in the same contexts.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

use elo_core::crosscheck::Crosscheck;
use elo_tests::programs::{self, Ran, elo_with, run, write};

/// A small run of the half-cheetah on Rapier, shared by all tests.
fn finished() -> &'static Path {
    static RUN: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, out) = RUN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("run");
        let mut command = elo_with(&["discover"]);
        command.arg(programs::repository().join("examples/half-cheetah-quick.toml")).arg("--out").arg(&out);
        for size in [
            "teacher.steps=4096",
            "discover.candidates=8",
            "discover.contexts=6",
            "discover.steps=12",
            "discover.set_size=3",
            "report.contexts=6",
        ] {
            command.args(["--set", size]);
        }
        run(&mut command).expect_success();
        (folder, out)
    });
    out
}

/// One at a time: a run directory has one process.
fn crosscheck(arguments: &[&str]) -> Ran {
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let mut command = elo_with(&["crosscheck"]);
    run(command.arg(finished()).args(arguments))
}

fn found(ran: Ran) -> Crosscheck {
    serde_json::from_str(&ran.expect_success().stdout).unwrap()
}

#[test]
fn an_engine_agrees_with_itself() {
    let found = found(crosscheck(&["--simulator", "rapier", "--contexts", "8", "--json"]));
    let [own, again] = &found.engines[..] else { panic!("{found:?}") };
    assert_eq!((own, found.contexts, found.candidates.len()), (again, 8, 8));
    let [pair] = &found.pairs[..] else { panic!("{found:?}") };
    assert!((pair.kendall.unwrap().estimate - 1.0).abs() < 1e-12, "{pair:?}");
    assert!((pair.spearman.unwrap().estimate - 1.0).abs() < 1e-12, "{pair:?}");
    assert_eq!((pair.shared_best, pair.parted, pair.parted_after), (3, 0.0, None));
    assert!(pair.differences.iter().all(|d| d.mean == 0.0 && d.sign_test == 1.0), "{pair:?}");
    assert_eq!(found.robust, own.best);
    let stored = std::fs::read(finished().join("results/crosscheck.json")).unwrap();
    assert!(serde_json::from_slice::<Crosscheck>(&stored).is_ok());
}

#[test]
fn two_engines_are_compared_from_the_same_starts() {
    if programs::mujoco("two_engines_are_compared_from_the_same_starts").is_none() {
        return;
    }
    let file = write(
        &std::env::temp_dir(),
        &format!("crosscheck-{}.toml", std::process::id()),
        "[simulator]\nkind = \"mujoco\"\nrobot = \"half-cheetah\"\n",
    );
    let by_file = found(crosscheck(&["--simulator", file.to_str().unwrap(), "--contexts", "8", "--json"]));
    let by_kind = found(crosscheck(&["--simulator", "mujoco", "--contexts", "8", "--json"]));
    std::fs::remove_file(file).unwrap();
    assert_eq!(by_file, by_kind);
    let [rapier, mujoco] = &by_kind.engines[..] else { panic!("{by_kind:?}") };
    assert_eq!((rapier.engine.name.as_str(), mujoco.engine.name.as_str()), ("rapier", "mujoco"));
    assert!(mujoco.same_starts && mujoco.failures == 0.0, "{mujoco:?}");
    assert_ne!(rapier.scores, mujoco.scores);
    // Each robust candidate's score is the worse of its two, and no other candidate has a better one.
    let worst = |id: usize| rapier.scores[id].min(mujoco.scores[id]);
    let all: Vec<f64> = (0..8).map(worst).collect();
    let mut ranked = all.clone();
    ranked.sort_by(|a, b| b.total_cmp(a));
    assert_eq!(by_kind.robust_scores, ranked[..3]);
    let told = crosscheck(&["--simulator", "mujoco", "--contexts", "8"]).expect_success().stdout;
    for words in ["rapier and mujoco", "Kendall's τ-b", "best by the worst engine"] {
        assert!(told.contains(words), "{words}: {told}");
    }
}

#[test]
fn what_cannot_be_compared_is_told_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), "ant.toml", "[simulator]\nkind = \"rapier\"\nrobot = \"ant\"\n");
    let ran = crosscheck(&["--simulator", file.to_str().unwrap()]).expect_code(2);
    assert!(ran.stderr.contains("the options do not fit: robot half-cheetah against ant"), "{ran}");
    let ran = crosscheck(&["--simulator", "bullet"]).expect_code(2);
    assert!(ran.stderr.contains("expected a kind of simulator"), "{ran}");
    let empty = write(folder.path(), "empty.toml", "");
    let ran = crosscheck(&["--simulator", empty.to_str().unwrap()]).expect_code(2);
    assert!(ran.stderr.contains("no table [simulator]"), "{ran}");
    let ran = crosscheck(&["--simulator", "rapier", "--contexts", "1"]).expect_code(2);
    assert!(ran.stderr.contains("expected at least 2"), "{ran}");
    let mut command = elo_with(&["crosscheck", "--simulator", "rapier"]);
    let ran = run(command.arg(folder.path())).expect_code(2);
    assert!(ran.stderr.contains("experiment.toml"), "{ran}");
}
