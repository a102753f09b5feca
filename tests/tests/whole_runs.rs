//! Whole runs: the same bytes whoever did the work, however often it was killed, and nothing done twice.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use elo_core::evaluate::Evaluation;
use elo_core::report::Report;
use elo_core::seed::{Seed, Stream};
use elo_tests::folders::{assert_same, copy, identities, names};
use elo_tests::programs::{self, Ran, discover, elo, elo_with, run, write};
use elo_tests::toy::{TOY, experiment, run_here, toy_with};
use elo_tests::{preload, wayward};
use rand::RngExt as _;

/// A finished run of [`TOY`] by one worker that nothing disturbed, shared by all tests and changed by none.
struct Reference {
    _folder: tempfile::TempDir,
    config: PathBuf,
    out: PathBuf,
    ran: Ran,
    took: Duration,
}

impl Reference {
    fn get() -> &'static Self {
        static REFERENCE: OnceLock<Reference> = OnceLock::new();
        REFERENCE.get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let config = write(folder.path(), "toy.toml", TOY);
            let out = folder.path().join("run");
            elo();
            let begun = Instant::now();
            let ran = run(discover(elo(), &config, &out).args(["--workers", "1"])).expect_success();
            Self { _folder: folder, config, out, ran, took: begun.elapsed() }
        })
    }

    fn results(&self) -> PathBuf {
        self.out.join("results")
    }

    /// A copy of the finished run that may be changed.
    fn copy(&self) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("run");
        copy(&self.out, &out);
        (folder, out)
    }
}

/// Units of each stage, and how many of them were done before, as the program tells.
fn stages(ran: &Ran) -> BTreeMap<String, (usize, usize)> {
    let stage = |line: &str| {
        let (name, rest) = line.strip_prefix("elo: ")?.split_once(": ")?;
        let (units, rest) = rest.split_once(" units")?;
        let ready = rest.strip_prefix(", ").and_then(|rest| rest.strip_suffix(" done before"));
        Some((name.to_owned(), (units.parse().ok()?, ready.map_or(Ok(0), str::parse).ok()?)))
    };
    ran.stderr.lines().filter_map(stage).collect()
}

#[test]
fn any_number_of_workers_gives_the_same_bytes() {
    let reference = Reference::get();
    for workers in ["2", "5"] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("run");
        run(discover(elo(), &reference.config, &out).args(["--workers", workers])).expect_success();
        assert_same(&reference.results(), &out.join("results"), &format!("{workers} workers"));
    }
}

#[test]
fn results_are_complete_and_printed() {
    let reference = Reference::get();
    let files = names(&reference.results());
    for name in [
        "report.json",
        "candidates.csv",
        "contexts_select.csv",
        "select_terms.npy",
        "report_options_clamped.npy",
        "report_baselines_ending.npy",
        "failures.csv",
        "option_sets/maximum_mean/manifest.json",
        "option_sets/maximum_mean/options.safetensors",
    ] {
        assert!(files.contains(&PathBuf::from(name)), "{name} is not in {files:?}");
    }
    for told in
        ["random torque", "zero torque", "untrained teacher", "random K-subsets", "teachers", "maximum_mean"]
    {
        assert!(reference.ran.stdout.contains(told), "{told}: {}", reference.ran);
    }
    // Asked again, the same is printed, for scripts as JSON, and nothing is computed.
    let (_folder, out) = reference.copy();
    let ran = run(discover(elo(), &reference.config, &out).arg("--json")).expect_success();
    let printed: Report = serde_json::from_str(&ran.stdout).unwrap();
    let written: Report =
        serde_json::from_slice(&std::fs::read(out.join("results/report.json")).unwrap()).unwrap();
    assert_eq!(printed, written);
    assert!(stages(&ran).values().all(|(units, ready)| units == ready), "{ran}");
    assert_same(&reference.results(), &out.join("results"), "a second look");
}

#[test]
fn the_written_config_reproduces_the_run() {
    let reference = Reference::get();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("again");
    run(&mut discover(elo(), &reference.out.join("experiment.toml"), &out)).expect_success();
    assert_same(&reference.results(), &out.join("results"), "running experiment.toml");
    assert_eq!(
        std::fs::read(out.join("experiment.toml")).unwrap(),
        std::fs::read(reference.out.join("experiment.toml")).unwrap()
    );
}

/// Runs a finished run again with a changed config; asks that no unit was made again, and none was added but of rollouts
/// that report newly chosen options.
fn changed(config: &str, overrides: &[&str]) -> (tempfile::TempDir, PathBuf) {
    let reference = Reference::get();
    let (folder, out) = reference.copy();
    let before = identities(&out.join("units"));
    let config = write(folder.path(), "changed.toml", config);
    let mut command = discover(elo(), &config, &out);
    for field in overrides {
        command.args(["--set", field]);
    }
    let ran = run(&mut command).expect_success();
    let after = identities(&out.join("units"));
    for (name, identity) in &before {
        assert_eq!(after.get(name), Some(identity), "{} was touched", name.display());
    }
    let stages = stages(&ran);
    let mut new = 0;
    for (stage, (units, ready)) in &stages {
        let allowed = if stage == "report rollouts" { *units } else { *ready };
        assert!(*units <= allowed, "{stage}: {ready} of {units} were done before\n{ran}");
        new += units - ready;
    }
    assert!(stages.len() >= 8, "{stages:?}");
    assert_eq!(after.len(), before.len() + new);
    (folder, out)
}

#[test]
fn results_of_another_config_take_the_place_of_all_that_was_there() {
    let reference = Reference::get();
    let (_folder, out) = reference.copy();
    let [found, kept] = ["results/experiments.json", "results/notes.txt"].map(|name| out.join(name));
    let rerun = |seed: &str| {
        std::fs::write(&found, "{}").unwrap();
        run(discover(elo(), &reference.config, &out).args(["--set", seed])).expect_success();
    };
    std::fs::write(&kept, "mine").unwrap();
    rerun("seed=7");
    assert!(found.is_file(), "what was found about the same results stays");
    rerun("seed=8");
    assert!(!found.exists(), "what was found about results that are gone");
    assert_eq!(std::fs::read_to_string(kept).unwrap(), "mine");
    let [begun, finished] = ["experiment.toml", "results/experiment.toml"].map(|name| out.join(name));
    assert_eq!(std::fs::read(begun).unwrap(), std::fs::read(finished).unwrap());
}

#[test]
fn another_metric_trains_and_measures_nothing_again() {
    let text = format!("{TOY}\n[[metrics]]\nkind = \"positive_skew\"\nk = 0.4\n");
    let (_folder, out) = changed(&text, &[]);
    let report: Report =
        serde_json::from_slice(&std::fs::read(out.join("results/report.json")).unwrap()).unwrap();
    assert_eq!(report.sets.len(), 3);
}

#[test]
fn another_k_and_another_set_size_train_nothing_again() {
    let (_folder, out) = changed(TOY, &["metrics[1].k=0.1", "metrics[1].alpha=0.5"]);
    let sets = std::fs::read_dir(out.join("results/option_sets")).unwrap();
    let mut sets: Vec<_> = sets.map(|entry| entry.unwrap().file_name()).collect();
    sets.sort();
    assert_eq!(sets, ["maximum_mean", "negative_tail_k_0.1"], "the set of the earlier k is gone");
    let ran = run(elo_with(&["evaluate"]).arg(&out)).expect_code(2);
    assert!(ran.stderr.contains("is a run directory; its option sets are the folders in"), "{ran}");
    let (_folder, out) = changed(TOY, &["discover.set_size=2", "report.random_subsets=1"]);
    let report: Report =
        serde_json::from_slice(&std::fs::read(out.join("results/report.json")).unwrap()).unwrap();
    assert!(report.sets.iter().all(|set| set.options.len() == 2));
}

/// How a program under test is brought to its end.
enum Death {
    /// At this fsync or rename.
    Call(u64),
    /// After this time.
    Time(Duration),
}

/// What had been under way when programs were killed.
#[derive(Debug, Default)]
struct Kills {
    all: usize,
    in_training: usize,
    in_commit: usize,
    finished_runs: usize,
}

/// Kills runs again and again until `wanted` kills were done; each time that a run gets to its end, its results must be
/// those of `expected`. `death` is told how often the run at hand has been killed before.
fn kill_and_take_up(
    wanted: usize,
    expected: &Path,
    start: impl Fn(&Path) -> Command,
    mut death: impl FnMut(usize) -> Death,
) -> Kills {
    let folder = tempfile::tempdir().unwrap();
    let mut kills = Kills::default();
    let mut of_this_run = 0;
    while kills.all < wanted || kills.finished_runs == 0 {
        let out = folder.path().join(format!("run-{}", kills.finished_runs));
        let mut command = start(&out);
        // After the last kill the run goes to its end.
        let death = if kills.all < wanted { death(of_this_run) } else { Death::Call(u64::MAX) };
        if let Death::Call(call) = death {
            preload::die_at(&mut command, call);
        }
        let ran = match death {
            Death::Call(_) => run(&mut command),
            Death::Time(time) => killed_after(time, &mut command),
        };
        match ran.code {
            None => {
                kills.all += 1;
                of_this_run += 1;
                let left = names(&out);
                let is_left =
                    |test: &dyn Fn(&str) -> bool| left.iter().any(|name| test(&name.to_string_lossy()));
                kills.in_training +=
                    usize::from(is_left(&|name| name.starts_with("checkpoints/") && name.ends_with(".bin")));
                kills.in_commit += usize::from(is_left(&|name| name.ends_with(".tmp")));
            }
            Some(0) => {
                assert_same(expected, &out.join("results"), &format!("{kills:?}"));
                assert!(!names(&out).iter().any(|name| name.to_string_lossy().contains("corrupt")));
                kills.finished_runs += 1;
                of_this_run = 0;
            }
            Some(_) => panic!("{ran}"),
        }
    }
    kills
}

fn killed_after(time: Duration, command: &mut Command) -> Ran {
    let mut child: Child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(time);
    let _ = child.kill();
    child.wait_with_output().unwrap().into()
}

fn some_time(stream: &mut Stream, longest: Duration) -> Duration {
    longest.mul_f64(stream.random::<f64>())
}

#[test]
fn fifty_five_kills_change_no_byte() {
    let reference = Reference::get();
    let mut stream = Seed::root(50).stream();
    let mut workers = Seed::root(51).stream();
    let workers = std::cell::RefCell::new(&mut workers);
    let start = |out: &Path| {
        let mut command = discover(elo(), &reference.config, out);
        command.args(["--workers", if workers.borrow_mut().random::<bool>() { "1" } else { "3" }]);
        command
    };
    let death = |before| {
        // A run's first 15 calls open its directory; a checkpoint of training makes 3, and there are 16 of them.
        if before < 5 {
            Death::Call(stream.random_range(16..20))
        } else if stream.random::<f64>() < 0.6 {
            Death::Call(stream.random_range(1..80))
        } else {
            Death::Time(some_time(&mut stream, reference.took / 2))
        }
    };
    let kills = kill_and_take_up(55, &reference.results(), start, death);
    assert!(kills.in_training >= 5 && kills.in_commit >= 10, "{kills:?}");
}

#[test]
fn kills_of_a_run_on_mujoco_change_no_byte() {
    let Some(_) = programs::mujoco("kills_of_a_run_on_mujoco_change_no_byte") else { return };
    let folder = tempfile::tempdir().unwrap();
    let text = toy_with(&[
        ("kind = \"point_mass\"\nreset_spread = 0.5", "kind = \"mujoco\"\nrobot = \"half-cheetah\""),
        (
            "[tasks.effort_cost]\nlow = -0.3\nhigh = -0.05",
            "[tasks.electricity_cost]\nlow = -2.4\nhigh = -1.4",
        ),
        ("steps = 16_384", "steps = 4096"),
        ("checkpoint_every = 2048", "checkpoint_every = 1024"),
        ("candidates = 24\ncontexts = 60", "candidates = 12\ncontexts = 12"),
        ("contexts = 60\nrandom", "contexts = 12\nrandom"),
    ]);
    let config = write(folder.path(), "half-cheetah.toml", &text);
    let expected = folder.path().join("expected");
    let begun = Instant::now();
    run(discover(elo(), &config, &expected).args(["--workers", "1"])).expect_success();
    let took = begun.elapsed();

    let mut stream = Seed::root(52).stream();
    let death = |before| match before {
        // Calls are counted in the program and in its worker alike; only the program makes any.
        0 => Death::Call(20),
        1 => Death::Time(took / 3),
        _ => Death::Time(some_time(&mut stream, took)),
    };
    let kills = kill_and_take_up(5, &expected.join("results"), |out| discover(elo(), &config, out), death);
    assert!(kills.in_training >= 1, "{kills:?}");
}

#[test]
fn a_clock_that_jumps_by_days_changes_no_byte() {
    let reference = Reference::get();
    let folder = tempfile::tempdir().unwrap();
    // That the clock does jump.
    let mut command = Command::new("date");
    preload::jumping_clock(command.arg("+%s"));
    let told: Vec<String> = (0..2).map(|_| run(&mut command).expect_success().stdout).collect();
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs();
    assert!(told[0].trim().parse::<u64>().unwrap().abs_diff(now) > 80_000, "{told:?} {now}");

    let out = folder.path().join("run");
    // Interrupted on the way, so that it is also taken up under such a clock.
    let mut command = discover(elo(), &reference.config, &out);
    preload::jumping_clock(&mut command);
    preload::die_at(&mut command, 60);
    assert_eq!(run(&mut command).code, None);
    let mut command = discover(elo(), &reference.config, &out);
    preload::jumping_clock(&mut command);
    run(&mut command).expect_success();
    assert_same(&reference.results(), &out.join("results"), "jumps of the clock");
}

#[test]
fn another_version_of_the_program_or_of_the_engine_takes_nothing_from_the_one_before() {
    let experiment = experiment(&toy_with(&[
        ("kind = \"point_mass\"", "kind = \"wayward\""),
        ("steps = 16_384", "steps = 2048"),
        ("candidates = 24\ncontexts = 60", "candidates = 10\ncontexts = 10"),
        ("contexts = 60\nrandom", "contexts = 10\nrandom"),
    ]));
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let units = || names(&out.join("units")).len();
    let (_, first) = run_here(&experiment, &out, "elo 1").unwrap();
    let one = units();
    let (_, again) = run_here(&experiment, &out, "elo 1").unwrap();
    assert_eq!((units(), &again), (one, &first));
    let (_, second) = run_here(&experiment, &out, "elo 2").unwrap();
    assert_eq!((units(), &second), (2 * one, &first));

    wayward::ENGINE_VERSION.store(2, Ordering::SeqCst);
    let (_, upgraded) = run_here(&experiment, &out, "elo 2").unwrap();
    wayward::ENGINE_VERSION.store(1, Ordering::SeqCst);
    // What no engine has a part in, the options made of recordings, has the recordings' keys among its inputs.
    assert_eq!(units(), 3 * one);
    assert_eq!(upgraded.engine.version, "2");
    assert_eq!(upgraded.sets, first.sets);
}

#[test]
fn an_option_set_is_measured_again_and_by_its_own_robot_alone() {
    let reference = Reference::get();
    let set = reference.results().join("option_sets/maximum_mean");
    let folder = tempfile::tempdir().unwrap();
    let evaluate = |more: &[&str]| {
        let out = folder.path().join("evaluation");
        let mut command = elo_with(&["evaluate"]);
        command.arg(&set).arg("--out").arg(out).args(["--json", "--set", "report.contexts=40"]).args(more);
        run(&mut command)
    };
    let evaluation = |more: &[&str]| -> Evaluation {
        serde_json::from_str(&evaluate(more).expect_success().stdout).unwrap()
    };
    let first = evaluation(&[]);
    assert_eq!((first.contexts, first.options.len(), first.seed), (40, 3, 8));
    assert_eq!(evaluation(&["--workers", "1"]), first);
    assert_ne!(evaluation(&["--seed", "9"]).set, first.set);

    // On the terminal it says what its columns mean, as the run's own table does.
    let mut command = elo_with(&["evaluate", "--set", "report.contexts=40"]);
    let told = run(command.arg(&set).arg("--out").arg(folder.path().join("evaluation"))).expect_success();
    for words in
        ["maximum_mean set of point-mass", "40 fresh contexts, seed 8", "are of returns normalised as"]
    {
        assert!(told.stdout.contains(words), "{words}: {told}");
    }

    // Another world with the same robot: heavier masses move otherwise.
    let heavy = evaluation(&["--set", "tasks.mass.low=9.0", "--set", "tasks.mass.high=10.0"]);
    assert_ne!(heavy.set, first.set);

    let ran =
        evaluate(&["--set", "simulator.kind=rapier", "--set", "simulator.robot=ant", "--set", "tasks={}"])
            .expect_code(2);
    assert!(ran.stderr.contains("robot point-mass against ant"), "{ran}");
}

#[test]
fn a_plan_of_a_hundred_thousand_candidates_is_quick_and_small() {
    let folder = tempfile::tempdir().unwrap();
    let config = write(folder.path(), "toy.toml", TOY);
    // 1 GiB of address space holds the program and little else; a table of all rollouts would take 60 GB.
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -v 1048576 && exec \"$@\"", "sh"]).arg(elo()).arg("discover").arg(&config);
    command.args(["--plan", "--set", "discover.candidates=100000", "--set", "discover.contexts=100000"]);
    let begun = Instant::now();
    let ran = run(&mut command).expect_success();
    assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());
    assert!(ran.stdout.contains("200 000 000 000 simulator steps"), "{ran}");
    assert!(ran.stdout.contains("MiB at most"), "{ran}");
    assert!(!Path::new("runs/toy").exists(), "a plan leaves nothing");
}

#[test]
fn a_plan_measures_time_where_the_engine_runs() {
    let quick = programs::repository().join("examples/half-cheetah-quick.toml");
    let time = |engine: &str| {
        let mut command = elo_with(&["discover", "--plan", "--set", &format!("simulator.kind={engine}")]);
        let ran = run(command.arg(&quick)).expect_success();
        assert!(ran.stdout.lines().any(|line| line.starts_with("time ") && line.contains("about")), "{ran}");
    };
    time("rapier");
    if programs::mujoco("a_plan_measures_time_where_the_engine_runs").is_some() {
        time("mujoco");
    }
}
