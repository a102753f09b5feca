//! `elo crosscheck`: an engine agrees with itself in everything, and two engines are compared in the same contexts, also
//! where one of them lists its reward terms in another order, cannot be put into states, or loses its workers.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

use elo_core::crew::{Crew, RunError, Staff, Unwatched};
use elo_core::crosscheck::Crosscheck;
use elo_core::discover::{Run, discover};
use elo_core::hosted::WorkerProgram;
use elo_core::run_dir::RunDir;
use elo_core::worker::{Limits, WorkerFault, WorkerProcess};
use elo_core::workforce::Hosts;
use elo_tests::programs::{self, Ran, elo_with, run, write};
use elo_tests::toy::{experiment, formats, toy_with};

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
    assert_eq!(found.names(), ["rapier", "rapier (2)"]);
    assert_eq!((own, found.contexts, found.candidates.len()), (again, 8, 8));
    let [pair] = &found.pairs[..] else { panic!("{found:?}") };
    assert!((pair.kendall.unwrap().estimate - 1.0).abs() < 1e-12, "{pair:?}");
    assert!((pair.spearman.unwrap().estimate - 1.0).abs() < 1e-12, "{pair:?}");
    assert_eq!((pair.shared_best, pair.parted, pair.parted_after), (3, Some(0.0), None));
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
    for words in ["rapier and mujoco", "Kendall's τ-b", "best by the worst engine", "of so few candidates"] {
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
    assert!(ran.stderr.contains("--simulator bullet: expected a kind of simulator"), "{ran}");
    let ran = crosscheck(&["--simulator", "rapierr"]).expect_code(2);
    assert!(ran.stderr.contains("did you mean `rapier`?"), "{ran}");
    let empty = write(folder.path(), "empty.toml", "");
    let ran = crosscheck(&["--simulator", empty.to_str().unwrap()]).expect_code(2);
    assert!(ran.stderr.contains("no table [simulator]"), "{ran}");
    let slips = [
        ("workers = 3", "`workers`: expected a table, got the integer 3"),
        ("[simulater]\nkind = \"rapier\"", "`simulater`: is unknown; expected one of seed, simulator, "),
        ("[simulater]\nkind = \"rapier\"", "did you mean `simulator`?"),
    ];
    for (slip, said) in slips {
        let text = format!("{slip}\n[simulator]\nkind = \"rapier\"\nrobot = \"ant\"\n");
        let file = write(folder.path(), "slip.toml", &text);
        let ran = crosscheck(&["--simulator", file.to_str().unwrap()]).expect_code(2);
        assert!(ran.stderr.contains(said), "{ran}");
    }
    let ran = crosscheck(&["--simulator", "rapier", "--contexts", "1"]).expect_code(2);
    assert!(ran.stderr.contains("expected at least 2"), "{ran}");
    let mut command = elo_with(&["crosscheck", "--simulator", "rapier"]);
    let ran = run(command.arg(folder.path())).expect_code(2);
    assert!(ran.stderr.contains("experiment.toml"), "{ran}");
}

/// Starts the worker of the engine that goes wrong, and counts.
#[derive(Default)]
struct Counting(AtomicUsize);

impl Counting {
    fn started(&self) -> usize {
        self.0.load(Ordering::SeqCst)
    }
}

impl Hosts for Counting {
    fn start(&self, program: &WorkerProgram) -> Result<WorkerProcess, WorkerFault> {
        assert_eq!(*program, WorkerProgram::Beside("elo-wayward-worker"));
        self.0.fetch_add(1, Ordering::SeqCst);
        let command = Command::new(env!("CARGO_BIN_EXE_elo-wayward-worker"));
        WorkerProcess::spawn(command, &elo_cli::build(), Limits::default())
    }
}

/// One of two simulators: the lines of its table, and who starts its workers.
type Side<'a> = (&'a str, &'a Counting);

/// A cross-check of a small run on `own` with `other`; all options are too strong where they are `overdriven`.
fn checked(own: Side<'_>, other: Side<'_>, overdriven: bool) -> Result<Crosscheck, RunError> {
    let learner = format!("kind = \"wayward\"\noverdriven_share = {}.0", u8::from(overdriven));
    checked_with(own, other, &[("kind = \"open_loop\"", &learner)])
}

/// The same with other changes.
fn checked_with(own: Side<'_>, other: Side<'_>, changes: &[(&str, &str)]) -> Result<Crosscheck, RunError> {
    let on = |simulator: &str| {
        let small = [
            ("kind = \"point_mass\"\nreset_spread = 0.5", simulator),
            ("steps = 16_384", "steps = 2048"),
            ("checkpoint_every = 2048", "checkpoint_every = 4096"),
            ("candidates = 24\ncontexts = 60", "candidates = 6\ncontexts = 6"),
            ("contexts = 60\nrandom", "contexts = 6\nrandom"),
        ];
        experiment(&toy_with(&[&small, changes].concat()))
    };
    let (here, there) = (on(own.0), on(other.0));
    let folder = tempfile::tempdir().unwrap();
    let run_dir = RunDir::open(folder.path().join("run"))?;
    let stop = AtomicBool::new(false);
    let staff = Staff { workers: 2, formats: formats(), program: "elo test".to_owned() };
    let crew = Crew::new(staff, &run_dir, own.1, &Unwatched, &stop);
    let discovery = discover(&here, &crew)?;
    let crew_there = crew.hosted_by(other.1);
    let others = [Run::new(&there, &crew_there)?];
    elo_core::crosscheck::crosscheck(&Run::new(&here, &crew)?, &discovery, &others, 6)
}

/// [`checked`] of two simulators in this process.
fn here(own: &str, other: &str) -> Crosscheck {
    checked((own, &Counting::default()), (other, &Counting::default()), false).unwrap()
}

const POINT_MASS: &str = "kind = \"point_mass\"\nreset_spread = 0.5";

#[test]
fn a_single_candidate_cannot_be_ranked() {
    let none = Counting::default();
    let single = [("candidates = 6", "candidates = 1"), ("set_size = 3", "set_size = 1")];
    let refused = checked_with((POINT_MASS, &none), (POINT_MASS, &none), &single).unwrap_err().to_string();
    assert!(refused.contains("needs at least 2, the run has 1: raise `discover.candidates`"), "{refused}");
}

#[test]
fn terms_are_priced_by_their_names() {
    let found = here(POINT_MASS, "kind = \"wayward\"\nreversed_terms = true");
    let [own, other] = &found.engines[..] else { panic!("{found:?}") };
    assert!(other.same_starts, "{found:?}");
    assert_eq!(own.scores, other.scores, "the same motion earns the same");
}

#[test]
fn starts_are_the_same_only_where_both_can_be_put_into_states() {
    let replayed = "kind = \"wayward\"\nreplay_only = true";
    for (own, other) in [(POINT_MASS, replayed), (replayed, POINT_MASS)] {
        let found = here(own, other);
        let [own, other] = &found.engines[..] else { panic!("{found:?}") };
        assert_eq!((own.same_starts, other.same_starts), (true, false), "{found:?}");
    }
    let [_, again] = &here(replayed, replayed).engines[..] else { panic!() };
    assert!(again.same_starts, "an engine agrees with itself");
}

#[test]
fn each_engine_has_workers_of_its_own() {
    let hosted = "kind = \"wayward\"\ndies = \"always\"";
    let reversed = format!("{hosted}\nreversed_terms = true");
    let (own, other) = (Counting::default(), Counting::default());
    checked((hosted, &own), (&reversed, &other), false).unwrap();
    assert!((1..=2).contains(&own.started()) && (1..=2).contains(&other.started()));
}

#[test]
fn lost_workers_leave_rollouts_that_failed_and_no_trajectories() {
    let (own, other) = (Counting::default(), Counting::default());
    let found = checked((POINT_MASS, &own), ("kind = \"wayward\"\ndies = \"always\"", &other), true).unwrap();
    let [here, there] = &found.engines[..] else { panic!("{found:?}") };
    assert_eq!((here.failures, &here.first_failure, &here.unseen), (0.0, &None, &None));
    assert_eq!(there.failures, 1.0);
    for why in [&there.first_failure, &there.unseen] {
        let why = why.as_ref().unwrap();
        assert!(why.contains("elo-wayward-worker was lost 3 times"), "{why}");
        assert!(why.starts_with("unit ") && why.contains("overflowed its stack"), "{why}");
    }
    let [pair] = &found.pairs[..] else { panic!("{found:?}") };
    assert_eq!((pair.parted, pair.parted_after, pair.kendall), (None, None, None));
}
