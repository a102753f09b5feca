//! Engines that lose their state or end their process, options that are no numbers, teachers that learn nothing.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use elo_core::crew::RunError;
use elo_core::discover::{Candidate, Origin};
use elo_core::evaluate::Evaluation;
use elo_core::report::Report;
use elo_tests::folders::assert_same;
use elo_tests::programs::{self, Ran, discover, elo, elo_with, run, write};
use elo_tests::toy::{experiment, run_here, toy_with};

use crate::{own_robot, own_robot_toy};

/// [`TOY`] with little training and 20 contexts, in the simulator that goes wrong.
fn wayward(changes: &[(&str, &str)]) -> String {
    let quick = [
        ("kind = \"point_mass\"\nreset_spread = 0.5", "kind = \"wayward\""),
        ("steps = 16_384", "steps = 4096"),
        // A checkpoint takes environments up from their states, which is where the engine can fail.
        ("checkpoint_every = 2048", "checkpoint_every = 4096"),
        ("contexts = 60\nsteps", "contexts = 20\nsteps"),
        ("contexts = 60\nrandom", "contexts = 20\nrandom"),
    ];
    toy_with(&[&quick, changes].concat())
}

/// `elo` with the plugins that go wrong; its worker lies beside it.
fn elo_wayward() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_elo-wayward"))
}

/// `table,row,context,reason` of each failed rollout.
fn failures(results: &Path) -> Vec<(String, usize, usize, String)> {
    let text = fs::read_to_string(results.join("failures.csv")).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("table,row,context,reason"));
    let fields = |line: &str| {
        let mut fields = line.splitn(4, ',');
        let mut next = || fields.next().unwrap().to_owned();
        (next(), next().parse().unwrap(), next().parse().unwrap(), next())
    };
    lines.map(fields).collect()
}

/// Shape and bytes of a file in NumPy's format.
fn npy(path: &Path) -> (Vec<usize>, Vec<u8>) {
    let bytes = fs::read(path).unwrap();
    assert!(bytes.starts_with(b"\x93NUMPY\x01"), "{}", path.display());
    let data = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[10..data]);
    let shape = header.split_once("'shape': (").unwrap().1.split_once(')').unwrap().0;
    let shape = shape.split(',').filter_map(|extent| extent.trim().parse().ok()).collect();
    (shape, bytes[data..].to_vec())
}

/// Rows of the candidates that some metric chose.
fn chosen(report: &Report, results: &Path) -> BTreeSet<usize> {
    let text = fs::read_to_string(results.join("candidates.csv")).unwrap();
    let numbers: Vec<usize> =
        text.lines().skip(1).map(|l| l.split(',').next().unwrap().parse().unwrap()).collect();
    let options = report.sets.iter().flat_map(|set| &set.options);
    options.map(|option| numbers.iter().position(|n| *n == option.number).unwrap()).collect()
}

#[test]
fn an_option_that_loses_the_simulator_in_a_tenth_of_contexts_is_not_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let text = wayward(&[
        ("kind = \"wayward\"", "kind = \"wayward\"\nunstable = true"),
        ("contexts = 20\nsteps", "contexts = 60\nsteps"),
    ]);
    let out = folder.path().join("run");
    let (discovery, report) = run_here(&experiment(&text), &out, "elo test").unwrap();
    let results = out.join("results");
    let listed = failures(&results);
    let in_selection: Vec<_> = listed.iter().filter(|(table, ..)| table == "select").collect();
    let fragile: BTreeSet<usize> = in_selection.iter().map(|(_, row, ..)| *row).collect();
    let sound = discovery.candidates.len() - fragile.len();
    assert!(fragile.len() >= 3 && sound >= 3, "{fragile:?} of {}", discovery.candidates.len());
    assert!(chosen(&report, &results).is_disjoint(&fragile), "{fragile:?}");
    // Each fails in some of the contexts, which are the same for all.
    for row in &fragile {
        let share = discovery.selection.failure_shares[*row];
        assert!(share > 0.01 && share < 0.25, "candidate {row} fails in {share} of the contexts");
    }
    assert!(
        listed.iter().all(|(.., reason)| reason.contains("the simulation is unstable: pushed to the right"))
    );
    let (shape, endings) = npy(&results.join("select_ending.npy"));
    assert_eq!(shape, [discovery.candidates.len(), 60]);
    assert_eq!(endings.iter().filter(|code| **code == 3).count(), in_selection.len());

    let takes = discovery.failed_takes.iter().map(|(number, take, _)| (*number, *take as usize));
    let recordings = listed.iter().filter(|(table, ..)| table == "recordings");
    assert!(recordings.map(|(_, number, take, _)| (*number, *take)).eq(takes));
    assert!(!discovery.failed_takes.is_empty());

    // The other policies, on what has been measured already.
    let with = |policy: &str| experiment(&format!("{text}\n[failures]\npolicy = \"{policy}\"\n"));
    let (excluding, _) = run_here(&with("exclude_option"), &out, "elo test").unwrap();
    let unscored = |choice: &elo_core::select::Choice| -> BTreeSet<usize> {
        choice.scores.iter().enumerate().filter(|(_, score)| score.is_none()).map(|(row, _)| row).collect()
    };
    assert!(excluding.selection.choices.iter().all(|choice| unscored(choice) == fragile));
    match run_here(&with("abort"), &out, "elo test") {
        Err(RunError::Select(message)) => {
            let failed = in_selection.len();
            assert!(
                message.starts_with(&format!("{failed} of {}", 60 * discovery.candidates.len())),
                "{message}"
            );
        }
        other => panic!("{:?}", other.err()),
    }
}

#[test]
fn options_that_are_no_numbers_fail_and_options_that_are_too_strong_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let learner = "kind = \"wayward\"\noverdriven_share = 0.3\nnot_a_number_share = 0.3";
    let text = wayward(&[("kind = \"open_loop\"", learner)]) + "\n[failures]\nmax_share = 0.9\n";
    let out = folder.path().join("run");
    let (_, report) = run_here(&experiment(&text), &out, "elo test").unwrap();
    let results = out.join("results");

    let (shape, endings) = npy(&results.join("select_ending.npy"));
    let (_, clamped) = npy(&results.join("select_clamped.npy"));
    let (_, lengths) = npy(&results.join("select_length.npy"));
    let numbers = |bytes: &[u8]| -> Vec<u32> {
        bytes.chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    let (clamped, lengths) = (numbers(&clamped), numbers(&lengths));
    let (mut failed, mut overdriven) = (BTreeSet::new(), 0);
    for row in 0..shape[0] {
        let cells = row * shape[1]..(row + 1) * shape[1];
        if endings[cells.start] == 3 {
            assert!(endings[cells].iter().all(|code| *code == 3));
            failed.insert(row);
        } else if clamped[cells.start] > 0 {
            // Each step of an overdriven option is clamped, the last one before the wall too.
            assert_eq!(clamped[cells.clone()], lengths[cells]);
            overdriven += 1;
        } else {
            assert!(clamped[cells].iter().all(|steps| *steps == 0));
        }
    }
    assert!(failed.len() >= 3 && overdriven >= 3, "{} of NaN, {overdriven} overdriven", failed.len());
    assert!(chosen(&report, &results).is_disjoint(&failed));
    let listed = failures(&results);
    assert!(listed.iter().all(|(.., reason)| reason.contains("action component 0 is NaN")), "{listed:?}");
    let rows: BTreeSet<usize> =
        listed.iter().filter(|(table, ..)| table == "select").map(|(_, row, ..)| *row).collect();
    assert_eq!(rows, failed);
}

#[test]
fn fewer_sound_options_than_asked_for_are_said_and_none_at_all_ends_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let with = |share: &str| {
        let learner = format!("kind = \"wayward\"\nnot_a_number_share = {share}");
        let text = wayward(&[("kind = \"open_loop\"", &learner), ("set_size = 3", "set_size = 6")]);
        experiment(&(text + "\n[failures]\nmax_share = 1.0\npolicy = \"exclude_option\"\n"))
    };
    let out = folder.path().join("run");
    let (_, report) = run_here(&with("0.9"), &out, "elo test").unwrap();
    let got = report.sets[0].options.len();
    assert!((1..6).contains(&got), "{got}");
    let said = format!("only {got} of 6 options could be chosen");
    assert!(report.warnings.iter().any(|warning| warning.contains(&said)), "{:?}", report.warnings);
    let text = fs::read_to_string(out.join("results/report.json")).unwrap();
    assert_eq!(serde_json::from_str::<Report>(&text).unwrap(), report);

    let none =
        run_here(&with("1.0"), &folder.path().join("none"), "elo test").map(|(_, report)| report.warnings);
    let message = none.unwrap_err().to_string();
    assert!(message.contains("no candidate can be chosen"), "{message}");
}

#[test]
fn equal_options_give_a_defined_result_and_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let text = toy_with(&[
        ("reset_spread = 0.5", "reset_spread = 0.0"),
        ("[tasks.effort_cost]\nlow = -0.3\nhigh = -0.05\n", ""),
        ("max_random_steps = 10", "max_random_steps = 0"),
        ("steps = 16_384", "steps = 4096"),
        ("teachers = 2", "teachers = 1"),
        ("contexts = 60\nsteps", "contexts = 20\nsteps"),
        ("contexts = 60\nrandom", "contexts = 20\nrandom"),
    ]);
    let config = write(folder.path(), "equal.toml", &text);
    let out = folder.path().join("run");
    let ran = run(&mut discover(elo(), &config, &out)).expect_success();
    assert!(ran.stdout.contains("warning: maximum_mean: 21 more candidates score the same"), "{ran}");
    // JSON has no NaN: it would have become a null, which a number cannot be read from.
    let text = fs::read_to_string(out.join("results/report.json")).unwrap();
    let report: Report = serde_json::from_str(&text).unwrap();
    assert_eq!(report.reference.standard_deviation, 0.0);
    assert!(report.sets.iter().all(|set| set.options.iter().map(|o| o.number).eq(0..3)), "{:?}", report.sets);
    assert!(!ran.stdout.contains("NaN") && !ran.stdout.contains("inf"), "{ran}");
}

#[test]
fn a_worker_that_ends_costs_a_retry_and_then_one_rollout() {
    let folder = tempfile::tempdir().unwrap();
    let config = |name: &str, dies: &str| {
        let learner = "kind = \"wayward\"\noverdriven_share = 0.1";
        let simulator = format!("kind = \"wayward\"\ndies = {dies}");
        let text = wayward(&[
            ("kind = \"open_loop\"", learner),
            ("kind = \"wayward\"\n\n[tasks", &(simulator + "\n\n[tasks")),
        ]);
        write(folder.path(), name, &(text + "\n[failures]\nmax_share = 0.9\n"))
    };
    let lost = |ran: &Ran| ran.stderr.matches("ended with exit code 1").count();

    let marker = folder.path().join("died");
    let once = config("once.toml", &format!("{{ once = {marker:?} }}"));
    let tried_again = folder.path().join("tried again");
    let ran = run(&mut discover(elo_wayward(), &once, &tried_again)).expect_success();
    assert_eq!(lost(&ran), 1, "{ran}");
    assert!(ran.stderr.contains("ERROR: the engine overflowed its stack"), "{ran}");
    assert!(marker.exists());
    let undisturbed = folder.path().join("undisturbed");
    let ran = run(&mut discover(elo_wayward(), &once, &undisturbed)).expect_success();
    assert_eq!(lost(&ran), 0, "{ran}");
    assert_same(&undisturbed.join("results"), &tried_again.join("results"), "a worker that ended once");
    assert_eq!(failures(&undisturbed.join("results")), []);

    let always = config("always.toml", "\"always\"");
    let out = folder.path().join("always");
    let ran = run(&mut discover(elo_wayward(), &always, &out)).expect_success();
    let listed = failures(&out.join("results"));
    assert!(!listed.is_empty() && lost(&ran) >= 3, "{ran}");
    // It dies in the options that are too strong, wherever they are, and in nothing else.
    let never = config("never.toml", "\"never\"");
    let sound = folder.path().join("never");
    run(&mut discover(elo_wayward(), &never, &sound)).expect_success();
    let (there, here) = (sound.join("results"), out.join("results"));
    let (shape, clamped) = npy(&there.join("select_clamped.npy"));
    let (_, endings) = npy(&here.join("select_ending.npy"));
    let [(_, returns), (_, sound_returns)] =
        [&here, &there].map(|results| npy(&results.join("select_terms.npy")));
    let bytes = returns.len() / endings.len();
    let mut strong = BTreeSet::new();
    for cell in 0..endings.len() {
        let too_strong = clamped[4 * cell..4 * cell + 4] != [0; 4];
        assert_eq!(endings[cell] == 3, too_strong, "rollout {cell} of {shape:?}");
        if too_strong {
            strong.insert((cell / shape[1], cell % shape[1]));
        } else {
            let cell = bytes * cell..bytes * (cell + 1);
            assert_eq!(
                returns[cell.clone()],
                sound_returns[cell],
                "the others are what they would have been"
            );
        }
    }
    let in_selection = listed.iter().filter(|(table, ..)| table == "select");
    assert_eq!(in_selection.map(|(_, row, context, _)| (*row, *context)).collect::<BTreeSet<_>>(), strong);
    let reason = "elo-wayward-worker was lost 3 times";
    assert!(
        listed.iter().all(|(.., text)| text.contains(reason) && text.contains("exit code 1")),
        "{listed:?}"
    );
    // Each names the unit that was given up, as the notices do.
    let unit = |text: &str| text.trim_matches('"').split_once(": ").unwrap().0.to_owned();
    assert!(listed.iter().all(|(.., text)| ran.stderr.contains(&unit(text))), "{listed:?}");
    let report: Report = serde_json::from_slice(&fs::read(out.join("results/report.json")).unwrap()).unwrap();
    let rows: BTreeSet<usize> =
        listed.iter().filter(|(table, ..)| table == "select").map(|(_, row, ..)| *row).collect();
    assert!(chosen(&report, &out.join("results")).is_disjoint(&rows));
    // What was recorded stays: nobody dies for it again.
    let ran = run(&mut discover(elo_wayward(), &always, &out)).expect_success();
    assert_eq!(lost(&ran), 0, "{ran}");
}

#[test]
fn teachers_that_diverge_are_reported_and_dropped_or_end_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let config =
        write(folder.path(), "fast.toml", &toy_with(&[("learning_rate = 1e-3", "learning_rate = 1e3")]));
    let ran = run(&mut discover(elo(), &config, &folder.path().join("fast"))).expect_code(1);
    assert!(ran.stderr.contains("only 0 of 2 teachers could be trained"), "{ran}");
    assert!(ran.stderr.contains("`discover.min_teachers` asks for 1: after "), "{ran}");

    let simulator =
        "kind = \"wayward\"\nheavy_is_not_a_number = true\n\n[tasks.mass]\nlow = 0.1\nhigh = 10.0\n\n[tasks";
    let some = |least: &str| {
        let text = wayward(&[
            ("kind = \"wayward\"\n\n[tasks", simulator),
            ("teachers = 2", &format!("teachers = 6\nmin_teachers = {least}")),
        ]);
        experiment(&(text + "\n[failures]\nmax_share = 1.0\n"))
    };
    let out = folder.path().join("some");
    let (discovery, report) = run_here(&some("1"), &out, "elo test").unwrap();
    let heavy: Vec<bool> = report
        .teachers
        .iter()
        .map(|teacher| teacher.task.get("mass").is_some_and(|mass| mass > 5.0))
        .collect();
    let diverged: Vec<bool> = report.teachers.iter().map(|teacher| teacher.diverged.len() == 3).collect();
    assert_eq!(heavy, diverged, "{:?}", report.teachers);
    assert!(heavy.contains(&true) && heavy.contains(&false), "{heavy:?}");
    let light = |candidate: &Candidate| matches!(candidate.origin, Origin::Recording { teacher, .. } if !heavy[teacher]);
    assert!(discovery.candidates.iter().all(light));
    let reason = &report.teachers[heavy.iter().position(|h| *h).unwrap()].diverged[0];
    assert!(reason.contains("not finite"), "{reason}");
    let given_up =
        |m: usize| report.warnings.iter().any(|w| w.starts_with(&format!("teacher {m} was given up")));
    assert_eq!((0..heavy.len()).map(given_up).collect::<Vec<_>>(), heavy, "{:?}", report.warnings);

    let message = run_here(&some("6"), &out, "elo test").err().unwrap().to_string();
    assert!(message.contains("`discover.min_teachers` asks for 6"), "{message}");
}

#[test]
fn recordings_that_fail_are_told_with_their_reason() {
    let folder = tempfile::tempdir().unwrap();
    let raising = |steps: &str| {
        experiment(&wayward(&[
            ("kind = \"wayward\"", "kind = \"wayward\"\nraises_at = 15"),
            // Teachers never come so far while they are trained.
            ("max_episode_steps = 100", "max_episode_steps = 10"),
            ("steps = 20\n", &format!("steps = {steps}\n")),
        ]))
    };
    let out = folder.path().join("run");
    let message = run_here(&raising("20"), &out, "elo test").err().unwrap().to_string();
    let expected = "every recording of every teacher ended before 20 steps; 504 of 504 failed, the first one: \
                    ValueError: step 15";
    assert_eq!(message, expected);
    let (discovery, _) = run_here(&raising("14"), &out, "elo test").unwrap();
    assert_eq!((discovery.candidates.len(), discovery.failed_takes.len()), (24, 0));
}

#[test]
fn without_libmujoco_the_program_runs_and_says_what_to_install() {
    let folder = tempfile::tempdir().unwrap();
    let alone = folder.path().join("elo");
    fs::copy(elo(), &alone).unwrap();
    let here = |arguments: &[&str]| {
        let mut command = Command::new(&alone);
        command.args(arguments).current_dir(folder.path()).env_clear().env("LD_LIBRARY_PATH", "/nonexistent");
        run(&mut command)
    };
    let ran = here(&["doctor"]).expect_success();
    let line = ran.stdout.lines().find(|line| line.starts_with("mujoco")).unwrap();
    assert!(line.contains("missing") && line.contains("run `tests/set-up`"), "{ran}");
    assert!(ran.stdout.lines().any(|line| line.starts_with("rapier") && line.contains("ready")), "{ran}");
    let config = write(folder.path(), "there.toml", "[workers]\npython = \"/nowhere/python\"\n");
    let ran = here(&["doctor", config.to_str().unwrap()]).expect_success();
    assert!(
        ran.stdout.lines().any(|line| line.starts_with("python ") && line.contains("/nowhere/python")),
        "{ran}"
    );
    assert!(here(&["plugins"]).expect_success().stdout.contains("mujoco"));
    let ran = here(&["example", "experiment"]).expect_success();
    write(folder.path(), "run.toml", &ran.stdout);
    here(&["config", "check", "run.toml", "--set", "simulator.kind=mujoco"]).expect_success();
    let ran = here(&["discover", "run.toml", "--set", "simulator.kind=mujoco"]).expect_code(2);
    assert!(ran.stderr.contains("elo-mujoco is missing: run `tests/set-up`"), "{ran}");
    let ran = here(&["discover", "run.toml", "--plan", "--set", "simulator.kind=mujoco"]).expect_success();
    assert!(
        ran.stdout.contains("No time was measured: ") && ran.stdout.contains("run `tests/set-up`"),
        "{ran}"
    );
    assert!(!folder.path().join("runs").exists(), "nothing was begun");

    // A worker that cannot find its library says so through `elo`.
    let Some(worker) = programs::mujoco("without_libmujoco_the_program_runs_and_says_what_to_install") else {
        return;
    };
    fs::copy(worker, folder.path().join("elo-mujoco")).unwrap();
    let ran = here(&["doctor"]).expect_success();
    assert!(ran.stdout.contains("libmujoco.so.3.17.0"), "{ran}");
    let ran = here(&["discover", "run.toml", "--set", "simulator.kind=mujoco"]).expect_code(1);
    assert!(ran.stderr.contains("libmujoco.so.3.17.0"), "{ran}");
}

/// Options of the user's own robot on MuJoCo, of one run that all tests share; `None` after a note that `test` is skipped.
fn own_options(test: &str) -> Option<&'static Path> {
    static RUN: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    programs::mujoco(test)?;
    let (_, set) = RUN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "robot.xml", &own_robot().1);
        let small = own_robot_toy(&[
            ("max_random_steps = 10", "max_random_steps = 0"),
            ("steps = 16_384", "steps = 2048"),
            ("candidates = 24\ncontexts = 60", "candidates = 5\ncontexts = 5"),
            ("contexts = 60\nrandom", "contexts = 5\nrandom"),
        ]);
        let config = write(folder.path(), "own.toml", &small);
        let out = folder.path().join("run");
        run(&mut discover(elo(), &config, &out)).expect_success();
        (folder, out.join("results/option_sets/maximum_mean"))
    });
    Some(set)
}

/// The figures of `elo evaluate` with one field changed, and all that it said.
fn evaluated(set: &Path, change: &str) -> (Evaluation, Ran) {
    let ran = run(elo_with(&["evaluate", "--json", "--set", change]).arg(set)).expect_success();
    (serde_json::from_str(&ran.stdout).unwrap(), ran)
}

#[test]
fn an_exploding_robot_on_mujoco_fails() {
    let Some(set) = own_options("an_exploding_robot_on_mujoco_fails") else { return };
    let (whole, _) = evaluated(set, "seed=3");
    assert_eq!(whole.set.failures, 0.0);
    // Motors a million times as strong tear it apart at the first step: no return; or it lands before the engine notices.
    let (torn, _) = evaluated(set, "simulator.own_robot.torque_scale=1e6");
    let set = &torn.set;
    assert!((set.failures + set.falls.estimate - 1.0).abs() < 1e-9, "{torn:?}");
    assert!(set.failures > 0.8 && set.mean_length < 1.0, "{torn:?}");
    assert_eq!(torn.baselines[0].failures, 1.0, "{torn:?}");
    assert_eq!(torn.baselines[1].failures, 0.0, "no torque tears nothing");
}

#[test]
fn a_fatal_error_of_mujoco_costs_units_and_not_the_run() {
    let Some(set) = own_options("a_fatal_error_of_mujoco_costs_units_and_not_the_run") else { return };
    // Enough memory to begin an episode and too little for all contacts of a fall: MuJoCo ends its process then.
    let (_, mjcf) = own_robot();
    let starved = mjcf.replacen("<worldbody>", "<size memory='14K'/><worldbody>", 1);
    let (lost, ran) = evaluated(set, &format!("simulator.own_robot.mjcf={starved:?}"));
    let random = &lost.baselines[0];
    assert_eq!((random.name.as_str(), random.failures), ("random torque", 1.0), "{ran}");
    assert!(ran.stderr.contains("ended with exit code 1") && ran.stderr.contains("mj_stackAlloc"), "{ran}");
}
