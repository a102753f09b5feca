//! Whole runs with an option learner that practises: the same bytes whoever did the work and however often it was killed,
//! sets that stay together in every command, and configs that say what is missing.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use elo_core::compare::RunComparison;
use elo_core::crosscheck::Crosscheck;
use elo_core::evaluate::Evaluation;
use elo_core::experiments::Experiments;
use elo_core::option_set::OptionSet;
use elo_core::report::Report;
use elo_core::seed::Seed;
use elo_tests::folders::{assert_same, copy, names};
use elo_tests::preload;
use elo_tests::programs::{Ran, discover, elo, elo_with, run, write};
use elo_tests::toy::{TOY, toy_with};
use rand::RngExt as _;

/// Three sets of two options, without a teacher.
const LEARNER: &str = r#"[option_learner]
kind = "interest"
steps = 640
rollout_steps = 80
context_pool = 6
epochs = 2
hidden = [8]
checkpoint_every = 160
continuations = { low = 2.0, high = 6.0 }
"#;

/// [`TOY`] with sets that are learned by practice and no `[teacher]`.
fn config() -> String {
    let text = toy_with(&[
        ("[option_learner]\nkind = \"open_loop\"\n", LEARNER),
        ("candidates = 24\n", "candidates = 3\n"),
        ("set_size = 3\n", "set_size = 2\n"),
    ]);
    let (before, rest) = text.split_once("[teacher]").unwrap();
    let (_, after) = rest.split_once("[option_learner]").unwrap();
    format!("{before}[option_learner]{after}")
}

/// A finished run of [`config`] by one worker that nothing disturbed, shared by all tests and changed by none.
fn finished() -> &'static (PathBuf, PathBuf, Ran) {
    static RUN: OnceLock<(tempfile::TempDir, (PathBuf, PathBuf, Ran))> = OnceLock::new();
    let (_, run) = RUN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let (config, out) = (write(folder.path(), "sets.toml", &config()), folder.path().join("run"));
        let ran = run(discover(elo(), &config, &out).args(["--workers", "1"])).expect_success();
        (folder, (config, out, ran))
    });
    run
}

fn json<T: serde::de::DeserializeOwned>(path: &Path) -> T {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// A copy of the finished run, for commands that write into it.
fn copied(folder: &Path) -> PathBuf {
    let (_, out, _) = finished();
    let to = folder.join("run");
    copy(out, &to);
    to
}

#[test]
fn any_number_of_workers_gives_the_same_sets() {
    let (config, out, _) = finished();
    for workers in ["2", "5"] {
        let folder = tempfile::tempdir().unwrap();
        let again = folder.path().join("run");
        run(discover(elo(), config, &again).args(["--workers", workers])).expect_success();
        assert_same(&out.join("results"), &again.join("results"), &format!("{workers} workers"));
    }
}

#[test]
fn kills_in_practice_and_elsewhere_change_no_byte() {
    let (config, out, _) = finished();
    let folder = tempfile::tempdir().unwrap();
    let mut stream = Seed::root(60).stream();
    let (mut kills, mut in_practice, mut finished_runs) = (0, 0, 0);
    while kills < 25 || in_practice < 5 || finished_runs == 0 {
        assert!(kills < 100, "{in_practice} of {kills} kills left a checkpoint");
        let again = folder.path().join(format!("run-{finished_runs}"));
        let mut command = discover(elo(), config, &again);
        command.args(["--workers", if stream.random::<bool>() { "1" } else { "3" }]);
        // The first ones meet practice that has left a checkpoint, however threads take turns; the others come anywhere.
        if in_practice < 5 {
            preload::die_at_rename_into(&mut command, "/checkpoints/", 2);
        } else if kills < 25 {
            preload::die_at(&mut command, stream.random_range(1..60));
        }
        match run(&mut command) {
            ran if ran.code == Some(0) => {
                assert_same(&out.join("results"), &again.join("results"), &format!("{kills} kills"));
                finished_runs += 1;
            }
            ran => {
                assert_eq!(ran.code, None, "{ran}");
                kills += 1;
                let left = names(&again.join("checkpoints"));
                in_practice +=
                    usize::from(left.iter().any(|name| name.extension().is_some_and(|end| end == "bin")));
            }
        }
    }
}

#[test]
fn each_metric_picks_one_set_and_files_keep_it_together() {
    let (_, out, ran) = finished();
    let report: Report = json(&out.join("results/report.json"));
    assert_eq!((report.candidates.usable, report.candidates.teacher_return), (3, None));
    assert!(report.teachers.is_empty());
    let baselines: Vec<&str> = report.baselines.iter().map(|row| row.name.as_str()).collect();
    assert_eq!(baselines, ["random torque", "zero torque"]);
    for set in &report.sets {
        let [chosen] = &set.options[..] else { panic!("{set:?}") };
        assert_eq!((chosen.row.name.clone(), chosen.teacher), (format!("set {}", chosen.number), None));
        assert_eq!(chosen.row.mean_return, set.row.mean_return);
        assert_eq!(set.selection_score, chosen.selection_score);
    }
    let best = &report.sets[0].options[0];
    let stored = OptionSet::read(&out.join("results/option_sets/maximum_mean")).unwrap();
    assert_eq!(stored.manifest.candidates(), [(best.number, 0..2)]);
    for option in &stored.manifest.options {
        assert_eq!((option.policy.as_str(), option.selection_score), ("interest", best.selection_score));
    }
    assert!(ran.stdout.contains("3 candidate sets learned by practice"), "{ran}");
    let parts = &report.sets[0].parts;
    assert!(parts.len() == 2 && parts.iter().all(|part| part.steps >= 1.0), "{parts:?}");
    assert!((parts.iter().map(|part| part.share).sum::<f64>() - 1.0).abs() < 1e-9, "{parts:?}");
    assert_eq!(ran.stdout.matches("its options are drawn in").count(), report.sets.len(), "{ran}");

    let practice = std::fs::read_to_string(out.join("results/practice.csv")).unwrap();
    assert_eq!(practice.lines().count(), 1 + 3 * 8, "{practice}");
}

#[test]
fn commands_on_a_finished_run_take_the_set_as_one_agent() {
    let folder = tempfile::tempdir().unwrap();
    let out = copied(folder.path());
    let report: Report = json(&out.join("results/report.json"));
    let own = &report.sets[0].row;

    // In the contexts of its own report.
    let set = out.join("results/option_sets/maximum_mean");
    let evaluated = folder.path().join("evaluated");
    let ran = run(elo_with(&["evaluate", "--json", "--seed", "7"]).arg(&set).arg("--out").arg(&evaluated));
    let evaluation: Evaluation = serde_json::from_str(&ran.expect_success().stdout).unwrap();
    let [row] = &evaluation.options[..] else { panic!("{evaluation:?}") };
    assert_eq!(row.name, report.sets[0].options[0].row.name);
    assert_eq!(row.mean_return, own.mean_return);

    let ran = run(elo_with(&["experiments", "--json"]).arg(&out)).expect_success();
    let experiments: Experiments = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(experiments.agents[0].row, *own);
    assert!(experiments.curve.is_empty() && experiments.equivalents.is_empty());
    assert!(experiments.agents.iter().any(|agent| agent.row.name.ends_with("and primitive actions")));

    let ran =
        run(elo_with(&["crosscheck", "--json", "--simulator", "point_mass", "--contexts", "6"]).arg(&out));
    let crosscheck: Crosscheck = serde_json::from_str(&ran.expect_success().stdout).unwrap();
    assert_eq!((crosscheck.candidates.len(), crosscheck.robust.len()), (3, 1));

    run(elo_with(&["report"]).arg(&out).arg("--out").arg(folder.path().join("page.html"))).expect_success();

    // Against options that replay.
    let (toy, toys) = (write(folder.path(), "toy.toml", TOY), folder.path().join("toy"));
    run(&mut discover(elo(), &toy, &toys)).expect_success();
    let ran = run(elo_with(&["compare", "--json"]).arg(&out).arg(&toys)).expect_success();
    let comparison: RunComparison = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(comparison.pairs[0].first.mean_return, own.mean_return);
}

#[test]
fn sets_that_begin_from_recordings_have_teachers_and_recordings_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let text = toy_with(&[
        ("[option_learner]\nkind = \"open_loop\"\n", LEARNER),
        (
            "checkpoint_every = 160\n",
            "checkpoint_every = 160\nimitation_start = true\ninitial_log_std = -1.0\n",
        ),
        ("steps = 16_384", "steps = 2048"),
        ("candidates = 24\n", "candidates = 3\n"),
        ("set_size = 3\n", "set_size = 2\n"),
    ]);
    let (config, out) = (write(folder.path(), "sets.toml", &text), folder.path().join("run"));
    let ran = run(&mut discover(elo(), &config, &out)).expect_success();
    for stage in ["teachers: 2 units", "recordings: 3 units", "option sets: 3 units"] {
        assert!(ran.stderr.contains(&format!("elo: {stage}")), "{stage}: {ran}");
    }
    let report: Report = json(&out.join("results/report.json"));
    assert_eq!((report.teachers.len(), report.candidates.usable), (2, 3));
    assert!(report.baselines.iter().any(|row| row.name == "teachers"));
    assert!(!report.baselines.iter().any(|row| row.name == "random K-subsets"));

    let ran = run(elo_with(&["discover", "--plan"]).arg(&config)).expect_success();
    // Six recordings of 20 steps after 5 random ones on average.
    let line =
        ran.stdout.lines().find(|line| line.starts_with("recordings")).unwrap_or_else(|| panic!("{ran}"));
    assert!(line.contains(" 150 simulator steps"), "{ran}");
}

#[test]
fn apprentices_learn_the_same_options_whoever_does_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let learner = "[option_learner]\nkind = \"dagger\"\nrounds = 2\nrollouts = 2\ncloning = { epochs = 20, hidden = [8] }\n";
    let text = toy_with(&[
        ("[option_learner]\nkind = \"open_loop\"\n", learner),
        ("steps = 16_384", "steps = 2048"),
        ("candidates = 24\n", "candidates = 12\n"),
    ]);
    let config = write(folder.path(), "apprentices.toml", &text);
    let [one, three] = ["1", "3"].map(|workers| {
        let out = folder.path().join(workers);
        run(discover(elo(), &config, &out).args(["--workers", workers])).expect_success();
        out.join("results")
    });
    assert_same(&one, &three, "three workers");
    let report: Report = json(&one.join("report.json"));
    assert!(report.baselines.iter().any(|row| row.name == "random K-subsets"));

    let ran = run(elo_with(&["discover", "--plan"]).arg(&config)).expect_success();
    // Each of 12 tries itself in 2 times 2 rollouts of 20 steps, after 5 random ones on average.
    let line =
        ran.stdout.lines().find(|line| line.starts_with("options ")).unwrap_or_else(|| panic!("{ran}"));
    assert!(line.contains(" 1 200 simulator steps"), "{ran}");
}

#[test]
fn a_run_says_what_its_way_of_learning_needs() {
    let folder = tempfile::tempdir().unwrap();
    let said = |text: &str, overrides: &[&str]| {
        let config = write(folder.path(), "bad.toml", text);
        let mut command: Command = elo_with(&["config", "check"]);
        command.arg(config);
        for field in overrides {
            command.args(["--set", field]);
        }
        run(&mut command).expect_code(2).stderr
    };
    let imitating = config().replace(LEARNER, "[option_learner]\nkind = \"open_loop\"\n");
    let text = said(&imitating, &[]);
    assert!(text.contains("`teacher`: is missing; expected a table [teacher]"), "{text}");
    let text = said(&config(), &["discover.tasks=W", "returns.normaliser=teacher"]);
    assert!(text.contains("`discover.tasks`: expected \"P\", got \"W\""), "{text}");
    assert!(
        text.contains("`returns.normaliser`: expected \"min_max\" or \"none\", got \"teacher\""),
        "{text}"
    );
    let other = format!("{}\n[[experiments.other_learners]]\nkind = \"open_loop\"\n", config());
    let text = said(&other, &[]);
    assert!(text.contains("`experiments.other_learners[0]`: imitates recordings; expected"), "{text}");
}

#[test]
fn a_plan_counts_the_steps_of_practice_and_no_teacher() {
    let (config, _, _) = finished();
    let ran = run(elo_with(&["discover", "--plan"]).arg(config)).expect_success();
    // 3 sets of 640 steps, and 6 starts of 5 random ones on average.
    let line =
        ran.stdout.lines().find(|line| line.starts_with("option sets")).unwrap_or_else(|| panic!("{ran}"));
    assert!(line.contains(" 2 010 simulator steps"), "{ran}");
    let stages = |name: &str| ran.stdout.lines().any(|line| line.starts_with(name));
    assert!(!stages("teachers") && !stages("recordings"), "{ran}");
}
