//! What goes wrong in a run, and what becomes of it: engines that lose their state or end their process, options that are
//! no numbers, teachers that learn nothing, signals, damaged files, hostile files.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use elo_backends::locomotion::robot;
use elo_core::config;
use elo_core::crew::RunError;
use elo_core::evaluate::Evaluation;
use elo_core::experiment::Experiment;
use elo_core::option_set::OptionSet;
use elo_core::report::Report;
use elo_core::seed::Seed;
use elo_tests::PLUGINS;
use elo_tests::folders::{assert_same, names};
use elo_tests::preload::{self, send, wait_until_stopped};
use elo_tests::programs::{self, Ran, discover, elo, elo_with, run, write};
use elo_tests::toy::{TOY, experiment, formats, run_here, toy_with};
use rand::RngExt as _;

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
fn a_worker_that_ends_costs_a_retry_and_then_one_unit() {
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
    let reason = "elo-wayward-worker was lost 3 times";
    assert!(
        listed.iter().all(|(.., text)| text.contains(reason) && text.contains("exit code 1")),
        "{listed:?}"
    );
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
    assert!(discovery.candidates.iter().all(|candidate| !heavy[candidate.teacher]));
    let reason = &report.teachers[heavy.iter().position(|h| *h).unwrap()].diverged[0];
    assert!(reason.contains("not finite"), "{reason}");

    let message = run_here(&some("6"), &out, "elo test").err().unwrap().to_string();
    assert!(message.contains("`discover.min_teachers` asks for 6"), "{message}");
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
    assert!(here(&["plugins"]).expect_success().stdout.contains("mujoco"));
    let ran = here(&["example", "experiment"]).expect_success();
    write(folder.path(), "run.toml", &ran.stdout);
    here(&["config", "check", "run.toml", "--set", "simulator.kind=mujoco"]).expect_success();
    let ran = here(&["discover", "run.toml", "--set", "simulator.kind=mujoco"]).expect_code(2);
    assert!(ran.stderr.contains("elo-mujoco is missing: run `tests/set-up`"), "{ran}");
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

/// A finished run of [`TOY`], shared by all tests and changed by none.
fn reference() -> &'static (tempfile::TempDir, PathBuf, PathBuf) {
    static REFERENCE: OnceLock<(tempfile::TempDir, PathBuf, PathBuf)> = OnceLock::new();
    REFERENCE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let config = write(folder.path(), "toy.toml", TOY);
        let out = folder.path().join("run");
        run(&mut discover(elo(), &config, &out)).expect_success();
        (folder, config, out)
    })
}

/// Starts [`TOY`] and waits until it has stopped itself at an fsync amid its training.
fn stopped(out: &Path) -> Child {
    let (_, config, _) = reference();
    let mut command = discover(elo(), config, out);
    preload::stop_at(&mut command, 25);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    wait_until_stopped(&child);
    child
}

#[test]
fn signals_stop_a_run_that_can_be_taken_up() {
    let (_, config, expected) = reference();
    let folder = tempfile::tempdir().unwrap();
    for (signal, code) in [(libc::SIGINT, 130), (libc::SIGTERM, 143), (libc::SIGHUP, 129)] {
        let out = folder.path().join(code.to_string());
        let child = stopped(&out);
        send(&child, signal);
        send(&child, libc::SIGCONT);
        let ran: Ran = child.wait_with_output().unwrap().into();
        let ran = ran.expect_code(code);
        assert!(ran.stderr.contains("elo: interrupted; the same command takes it up again"), "{ran}");
        assert!(!out.join("results").exists());
        run(&mut discover(elo(), config, &out)).expect_success();
        assert_same(&expected.join("results"), &out.join("results"), &format!("signal {signal}"));
    }
    // A second signal ends it at once, even where it cannot stop by itself.
    let out = folder.path().join("twice");
    let child = stopped(&out);
    send(&child, libc::SIGINT);
    send(&child, libc::SIGTERM);
    send(&child, libc::SIGCONT);
    let ran: Ran = child.wait_with_output().unwrap().into();
    assert!(matches!(ran.code, Some(130 | 143)), "{ran}");
}

#[test]
fn a_reader_that_has_gone_is_no_fault() {
    let (_, config, expected) = reference();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let mut table = discover(elo(), config, &out);
    let commands = [
        elo_with(&["plugins"]),
        elo_with(&["example", "experiment"]),
        elo_with(&["config", "schema"]),
        elo_with(&["--help"]),
        elo_with(&["doctor"]),
    ];
    for command in commands.into_iter().chain([std::mem::replace(&mut table, Command::new("true"))]) {
        let mut command = command;
        let mut child =
            command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let ran: Ran = child.wait_with_output().unwrap().into();
        assert_eq!(ran.code, Some(0), "{command:?}: {ran}");
        assert!(!ran.stderr.contains("panicked"), "{command:?}: {ran}");
    }
    assert_same(&expected.join("results"), &out.join("results"), "a closed pipe");

    // Nobody reads what is said on stderr either.
    let mut command = discover(elo(), config, &folder.path().join("silent"));
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop((child.stdout.take(), child.stderr.take()));
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

#[test]
fn of_eight_processes_on_one_run_directory_seven_are_told_who_has_it() {
    let (_, config, expected) = reference();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let holder = stopped(&out);
    let others: Vec<Child> = (0..7)
        .map(|_| {
            let mut command = discover(elo(), config, &out);
            command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
        })
        .collect();
    for other in others {
        let ran: Ran = other.wait_with_output().unwrap().into();
        let ran = ran.expect_code(3);
        assert!(ran.stderr.contains(&format!("is in use by process {} on ", holder.id())), "{ran}");
    }
    send(&holder, libc::SIGCONT);
    let ran: Ran = holder.wait_with_output().unwrap().into();
    ran.expect_success();
    assert_same(&expected.join("results"), &out.join("results"), "seven others");

    // A killed holder leaves no lock behind.
    let out = folder.path().join("killed");
    let mut holder = stopped(&out);
    holder.kill().unwrap();
    holder.wait().unwrap();
    run(&mut discover(elo(), config, &out)).expect_success();
    assert_same(&expected.join("results"), &out.join("results"), "a killed holder");
}

#[test]
fn damaged_units_are_kept_aside_and_computed_again() {
    let (_, config, expected) = reference();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let units: Vec<PathBuf> =
        names(&expected.join("units")).into_iter().map(|name| Path::new("units").join(name)).collect();
    let mut stream = Seed::root(4).stream();
    let mut damaged = 0;
    for name in names(expected) {
        let to = out.join(&name);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        let mut bytes = fs::read(expected.join(&name)).unwrap();
        if units.contains(&name) {
            let at = stream.random_range(0..bytes.len());
            match stream.random_range(0..6) {
                0 => bytes[at] ^= 1 << stream.random_range(0..8),
                1 => bytes.truncate(at),
                2 => bytes = fs::read(expected.join(&units[stream.random_range(0..units.len())])).unwrap(),
                _ => {}
            }
            damaged += usize::from(bytes != fs::read(expected.join(&name)).unwrap());
        }
        fs::write(to, bytes).unwrap();
    }
    assert!(damaged > 10, "{damaged} of {}", units.len());
    let ran = run(&mut discover(elo(), config, &out)).expect_success();
    assert_eq!(ran.stderr.matches("will be computed again").count(), damaged, "{ran}");
    let aside = names(&out).iter().filter(|name| name.to_string_lossy().contains(".corrupt")).count();
    assert_eq!(aside, damaged);
    assert_same(&expected.join("results"), &out.join("results"), "damage");
}

/// Half-cheetah as a robot of the user's own: its config table, and its MJCF text.
fn own_robot() -> (String, String) {
    let mut description = robot::built_in("half-cheetah").unwrap();
    let mjcf = std::mem::replace(&mut description.mjcf, "robot.xml".to_owned());
    (toml::to_string(&description).unwrap(), mjcf)
}

#[test]
fn hostile_mjcf_files_are_refused_by_the_name_of_the_element() {
    let folder = tempfile::tempdir().unwrap();
    let (table, good) = own_robot();
    let table = table
        .replace("[alive]", "[simulator.own_robot.alive]")
        .replace("[[progress]]", "[[simulator.own_robot.progress]]");
    let text = toy_with(&[
        (
            "kind = \"point_mass\"\nreset_spread = 0.5",
            &format!("kind = \"mujoco\"\n[simulator.own_robot]\n{table}"),
        ),
        ("tasks.effort_cost]\nlow = -0.3\nhigh = -0.05", "tasks.electricity_cost]\nlow = -2.4\nhigh = -1.4"),
    ]);
    let config = write(folder.path(), "own.toml", &text);
    let path = folder.path().join("robot.xml");
    let check = || {
        let begun = Instant::now();
        let mut command = elo_with(&["config", "check"]);
        let ran = run(command.arg(&config));
        assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
        ran
    };
    fs::write(&path, &good).unwrap();
    check().expect_success();

    let inside = |element: &str| good.replacen("<worldbody>", &format!("<worldbody>{element}"), 1);
    let before = |element: &str| good.replacen("<worldbody>", &format!("{element}<worldbody>"), 1);
    let bomb = "<!DOCTYPE m [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;&a;&a;\">]>";
    let xxe = "<!DOCTYPE m [<!ENTITY x SYSTEM \"file:///etc/passwd\">]>";
    let nested = "<replicate count='1000'>".repeat(3) + &"</replicate>".repeat(3);
    let deep = "<body>".repeat(50_000) + &"</body>".repeat(50_000);
    let many = "<site/>".repeat(20_000);
    let corpus: Vec<(&str, String, &str)> = vec![
        ("include of an absolute path", inside("<include file='/etc/passwd'/>"), "<include>"),
        ("include of a path upwards", before("<include file='../../secret.xml'/>"), "<include>"),
        ("a hundred million copies", inside("<replicate count='1e8'><geom/></replicate>"), "<replicate>"),
        ("copies of copies", inside(&nested), "<replicate>"),
        ("a composite", inside("<composite type='grid' count='1000 1000 1000'/>"), "<composite>"),
        ("a flexible grid", inside("<flexcomp name='x' count='999 999 999'/>"), "<flexcomp"),
        ("time that stands still", before("<option timestep='0'/>"), "<option>"),
        ("time that is not a number", before("<option timestep='nan'/>"), "<option>"),
        ("time that goes back", before("<option timestep='-0.01'/>"), "<option>"),
        ("two billion iterations", before("<option iterations='2000000000'/>"), "<option>"),
        ("a terabyte of memory", before("<size memory='1T'/>"), "<size>"),
        ("more than a machine word of memory", before("<size memory='99999999999999999999G'/>"), "<size>"),
        ("a mesh from a file", before("<asset><mesh name='m' file='/dev/zero'/></asset>"), "<mesh"),
        (
            "a height field from a file",
            before("<asset><hfield name='h' file='/dev/zero'/></asset>"),
            "<hfield",
        ),
        ("a texture from a file", before("<asset><texture name='t' file='/dev/zero'/></asset>"), "<texture"),
        ("a folder of meshes", before("<compiler meshdir='/'/>"), "<compiler>"),
        ("a plugin", before("<extension><plugin plugin='x'/></extension>"), "<extension>"),
        ("a number too large", inside("<geom type='sphere' size='1e300'/>"), "<geom>"),
        ("a geom of a mesh", inside("<geom type='mesh' mesh='m'/>"), "<geom>"),
        ("fifty thousand bodies inside one another", inside(&deep), "elements"),
        ("twenty thousand elements", inside(&many), "<site>"),
        ("entities of entities", format!("{bomb}{good}"), "DTD"),
        ("an entity of another file", format!("{xxe}{good}"), "DTD"),
        ("half a file", good[..good.len() / 2].to_owned(), "no MJCF"),
        ("another root", "<robot name='urdf'/>".to_owned(), "<robot"),
        ("nothing", String::new(), "does not begin with `<`"),
        ("no text", "\u{0}MJB\u{1}".repeat(100), "does not begin with `<`"),
        ("more than a megabyte", format!("{good}<!--{}-->", "x".repeat(1 << 20)), "larger than"),
    ];
    for (what, text, named) in &corpus {
        fs::write(&path, text).unwrap();
        let ran = check().expect_code(2);
        assert!(ran.stderr.contains("own_robot") && ran.stderr.contains(named), "{what}: {ran}");
    }

    let refused = |what: &str, named: &str| {
        let ran = check().expect_code(2);
        assert!(
            ran.stderr.contains("simulator.own_robot.mjcf") && ran.stderr.contains(named),
            "{what}: {ran}"
        );
        let _ = fs::remove_file(&path);
    };
    fs::remove_file(&path).unwrap();
    refused("no file", "No such file");
    std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
    refused("a link to a device", "no regular file");
    assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
    refused("a pipe", "no regular file");
    fs::write(&path, b"<mujoco \xff\xfe>").unwrap();
    refused("bytes that are no text", "UTF-8");
    fs::create_dir(&path).unwrap();
    refused("a folder", "no regular file");
}

#[test]
fn damaged_option_sets_are_read_or_refused_and_never_panic() {
    let (_, _, out) = reference();
    let set = out.join("results/option_sets/maximum_mean");
    let folder = tempfile::tempdir().unwrap();
    let spec = experiment(TOY).simulator.spec().unwrap();
    let formats = formats();
    let originals: Vec<(&str, Vec<u8>)> = ["manifest.json", "options.safetensors"]
        .map(|name| (name, fs::read(set.join(name)).unwrap()))
        .to_vec();
    let restore =
        || originals.iter().for_each(|(name, bytes)| fs::write(folder.path().join(name), bytes).unwrap());
    restore();
    let whole = OptionSet::read(folder.path()).unwrap();
    whole.policies(&spec, &formats).unwrap();

    // What `elo evaluate` does with a set before it runs anything.
    let take = || -> Result<(), String> {
        let set = OptionSet::read(folder.path()).map_err(|error| error.to_string())?;
        let text = toml::to_string(&set.manifest.experiment).map_err(|error| error.to_string())?;
        config::read::<Experiment>(&text, Path::new("manifest"), &[], PLUGINS)
            .map_err(|error| error.to_string())?;
        set.policies(&spec, &formats).map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(take(), Ok(()));
    let mut stream = Seed::root(27).stream();
    let (mut refused, mut tried) = (0, 0);
    for (name, original) in &originals {
        for _ in 0..2500 {
            let mut bytes = original.clone();
            let at = stream.random_range(0..bytes.len());
            match stream.random_range(0..4) {
                0 => bytes.truncate(at),
                1 => {
                    // A stretch from elsewhere in the file.
                    let from = stream.random_range(0..bytes.len());
                    let length = stream.random_range(0..64).min(bytes.len() - at.max(from));
                    bytes.copy_within(from..from + length, at);
                }
                2 => bytes[at] = b"0123456789-eE\"{}[],:"[stream.random_range(0..20)],
                _ => bytes[at] ^= 1 << stream.random_range(0..8),
            }
            fs::write(folder.path().join(name), &bytes).unwrap();
            let outcome = catch_unwind(AssertUnwindSafe(take));
            refused += usize::from(outcome.unwrap_or_else(|_| panic!("{name}, {at}: a panic")).is_err());
            tried += 1;
        }
        restore();
    }
    assert!(refused > tried / 4, "{refused} of {tried} were refused");
}

#[test]
fn numbers_that_are_not_finite_and_missing_options_are_refused() {
    let (_, _, out) = reference();
    let set = out.join("results/option_sets/maximum_mean");
    let spec = experiment(TOY).simulator.spec().unwrap();
    let said = |change: &dyn Fn(&mut OptionSet)| {
        let folder = tempfile::tempdir().unwrap();
        let mut changed = OptionSet::read(&set).unwrap();
        change(&mut changed);
        for (name, bytes) in changed.files() {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        let mut command = elo_with(&["evaluate"]);
        let ran = run(command.arg(folder.path())).expect_code(2);
        // The library refuses what the program refuses.
        let read = OptionSet::read(folder.path()).and_then(|set| set.policies(&spec, &formats()).map(drop));
        assert!(read.is_err(), "{ran}");
        ran.stderr
    };
    let text = said(&|set| {
        let shape = set.options[1].tensors.get("actions").unwrap().shape.clone();
        let mut data = set.options[1].tensors.get("actions").unwrap().data.clone();
        data[3] = f32::INFINITY;
        set.options[1].tensors.insert("actions", &shape, data);
    });
    assert!(text.contains("tensor `1.actions` has a number that is not finite"), "{text}");
    let text = said(&|set| set.options.truncate(1));
    assert!(text.contains("option 1: tensor `actions` is missing"), "{text}");
    let text = said(&|set| set.options[0].tensors.insert("actions", &[5, 4], vec![0.0; 20]));
    assert!(text.contains("option 0: tensor `actions` has shape [5, 4]"), "{text}");
    let text = said(&|set| set.manifest.options[2].policy = "pickle".to_owned());
    assert!(text.contains("no plugin reads policies of format `pickle`"), "{text}");
    let text = said(&|set| set.manifest.format = 2);
    assert!(text.contains("option-set format 2, this program reads format 1"), "{text}");
}

#[test]
fn an_exploding_robot_on_mujoco_fails() {
    let test = "an_exploding_robot_on_mujoco_fails";
    let Some(_) = programs::mujoco(test) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (table, mjcf) = own_robot();
    let table = table
        .replace("[alive]", "[simulator.own_robot.alive]")
        .replace("[[progress]]", "[[simulator.own_robot.progress]]");
    let text = toy_with(&[
        (
            "kind = \"point_mass\"\nreset_spread = 0.5",
            &format!("kind = \"mujoco\"\n[simulator.own_robot]\n{table}"),
        ),
        ("tasks.effort_cost]\nlow = -0.3\nhigh = -0.05", "tasks.electricity_cost]\nlow = -2.4\nhigh = -1.4"),
        ("max_random_steps = 10", "max_random_steps = 0"),
        ("steps = 16_384", "steps = 2048"),
        ("candidates = 24\ncontexts = 60", "candidates = 5\ncontexts = 5"),
        ("contexts = 60\nrandom", "contexts = 5\nrandom"),
    ]);
    write(folder.path(), "robot.xml", &mjcf);
    let config = write(folder.path(), "own.toml", &text);
    let out = folder.path().join("run");
    run(&mut discover(elo(), &config, &out)).expect_success();
    let evaluate = |field: &str| {
        let mut command = elo_with(&["evaluate", "--json", "--set", field]);
        run(command.arg(out.join("results/option_sets/maximum_mean")))
    };
    let whole: Evaluation = serde_json::from_str(&evaluate("seed=3").expect_success().stdout).unwrap();
    assert_eq!(whole.set.failures, 0.0);

    // Motors a million times as strong tear it apart: no return, and not a plausible number either.
    let torn: Evaluation =
        serde_json::from_str(&evaluate("simulator.own_robot.torque_scale=1e6").expect_success().stdout)
            .unwrap();
    assert_eq!((torn.set.failures, torn.baselines[0].failures), (1.0, 1.0), "{torn:?}");
    assert_eq!(torn.baselines[1].failures, 0.0, "no torque tears nothing");
}
