//! What a user sees for each kind of bad input: the exit code and the text on stderr, word by word.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use elo_tests::folders::names;
use elo_tests::programs::{Ran, discover, elo, run, write};
use elo_tests::skipped;
use elo_tests::toy::{TOY, toy_with};

/// A folder in which `elo` is run: `toy.toml`, its finished run in `run`, a copy of the program without any worker beside
/// it in `alone/elo`, and odd files.
fn place() -> &'static Path {
    static PLACE: OnceLock<tempfile::TempDir> = OnceLock::new();
    PLACE
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let at = |name: &str| folder.path().join(name);
            let config = write(folder.path(), "toy.toml", TOY);
            run(&mut discover(elo(), &config, &at("run"))).expect_success();
            fs::create_dir(at("alone")).unwrap();
            fs::copy(elo(), at("alone/elo")).unwrap();
            fs::create_dir(at("folder.toml")).unwrap();
            fs::write(at("binary.toml"), b"seed = \xff\xfe").unwrap();
            fs::write(at("file"), "").unwrap();
            for (name, from, to) in [
                ("later", "\"format\": 2", "\"format\": 3"),
                ("walker", "\"robot\": \"point-mass\"", "\"robot\": \"walker2d\""),
                ("text", "{", "no JSON"),
            ] {
                let set = at("run/results/option_sets/maximum_mean");
                fs::create_dir(at(name)).unwrap();
                let manifest = fs::read_to_string(set.join("manifest.json")).unwrap();
                assert!(manifest.contains(from), "{from}");
                fs::write(at(name).join("manifest.json"), manifest.replacen(from, to, 1)).unwrap();
                fs::copy(set.join("options.safetensors"), at(name).join("options.safetensors")).unwrap();
            }
            folder
        })
        .path()
}

/// One kind of bad input.
struct Case {
    /// What is bad.
    what: &'static str,
    /// Replacements in [`TOY`], which is then `bad.toml`.
    changes: &'static [(&'static str, &'static str)],
    /// Arguments.
    arguments: &'static [&'static str],
    /// The exit code.
    code: i32,
    /// All of stderr but for the newline at its end.
    stderr: &'static str,
}

const BAD: &[&str] = &["discover", "bad.toml", "--out", "never"];

const CASES: &[Case] = &[
    Case {
        what: "unknown plugin kind",
        changes: &[("point_mass", "bullet")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:5: `simulator.kind`: expected a kind of simulator (point_mass, mujoco, python, python_body, rapier), got the text \
                 \"bullet\"",
    },
    Case {
        what: "misspelt plugin kind",
        changes: &[("\"negative_tail\"", "\"negativ_tail\"")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:47: `metrics[1].kind`: expected a kind of metric (maximum_mean, negative_tail, \
                 positive_skew, python), got the text \"negativ_tail\"; did you mean \"negative_tail\"?",
    },
    Case {
        what: "misspelt key",
        changes: &[("max_episode_steps", "max_episode_stops")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:24: `teacher.max_episode_stops`: is unknown; expected one of kind, steps, rollout_steps, \
                 environments, minibatch, epochs, learning_rate, learning_rate_end, clip, gamma, gae_lambda, \
                 entropy_coefficient, value_coefficient, max_grad_norm, target_kl, hidden, initial_log_std, d0_share, \
                 d0_pool, max_episode_steps, snapshots, checkpoint_every; did you mean `max_episode_steps`?",
    },
    Case {
        what: "wrong type",
        changes: &[("set_size = 3", "set_size = \"three\"")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:36: `discover.set_size`: expected an integer of at least 1, got the text \"three\"",
    },
    Case {
        what: "value out of the range of its field",
        changes: &[("bootstrap_draws = 200", "bootstrap_draws = 20")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:41: `report.bootstrap_draws`: expected an integer from 100 to 100000, got 20",
    },
    Case {
        what: "value that the plugin refuses",
        changes: &[("learning_rate = 1e-3", "learning_rate = -1.0")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:22: `teacher.learning_rate`: expected a positive number, got -1",
    },
    Case {
        what: "values that contradict each other",
        changes: &[("reset_spread = 0.5", "reset_spread = 3.0")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:4: `simulator.wall`: expected more than reset_spread = 3, got 2",
    },
    Case {
        what: "K > N",
        changes: &[("candidates = 24", "candidates = 2")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:36: `discover.set_size`: K = 3 options cannot be chosen from N = 2 candidates",
    },
    Case {
        what: "T = 0",
        changes: &[("steps = 20\n", "steps = 0\n")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:35: `discover.steps`: expected an integer from 1 to 100000, got 0",
    },
    Case {
        what: "Z < K",
        changes: &[("contexts = 60\nsteps", "contexts = 2\nsteps")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:34: `discover.contexts`: expected at least set_size = 3 contexts, got 2",
    },
    Case {
        what: "unknown task parameter",
        changes: &[("effort_cost", "efort_cost")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:8: `tasks.efort_cost`: is no task parameter of point-mass (it has: effort_cost, mass); did \
                 you mean `effort_cost`?",
    },
    Case {
        what: "task range outside the simulator's",
        changes: &[("low = -0.3", "low = -30.0")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:9: `tasks.effort_cost.low`: expected -10 to 0, got -30",
    },
    Case {
        what: "task range the wrong way round",
        changes: &[("low = -0.3", "low = 0.0")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:8: `tasks.effort_cost`: expected low <= high, got low = 0 and high = -0.05",
    },
    Case {
        what: "unknown robot",
        changes: &[(
            "kind = \"point_mass\"\nreset_spread = 0.5",
            "kind = \"rapier\"\nrobot = \"half-cheeta\"",
        )],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:6: `simulator.robot`: `half-cheeta` is no robot (expected one of ant, half-cheetah, \
                 walker2d); did you mean `half-cheetah`?",
    },
    Case {
        what: "several faults at once",
        changes: &[
            ("seed = 7", "sed = 7"),
            ("point_mass", "pointmass"),
            ("hidden = [16]", "hidden = \"16\""),
            ("steps = 20\n", "steps = 0\n"),
        ],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml: `seed`: is missing; expected an integer of at least 0\n\
                 bad.toml:2: `sed`: is unknown; expected one of seed, simulator, tasks, initial_states, teacher, \
                 option_learner, discover, metrics, selector, returns, failures, report, experiments, workers; did you mean `seed`?\n\
                 bad.toml:5: `simulator.kind`: expected a kind of simulator (point_mass, mujoco, python, python_body, rapier), got the text \
                 \"pointmass\"; did you mean \"point_mass\"?\n\
                 bad.toml:21: `teacher.hidden`: expected a list, got the text \"16\"\n\
                 bad.toml:35: `discover.steps`: expected an integer from 1 to 100000, got 0",
    },
    Case {
        what: "several contradictions at once",
        changes: &[
            ("learning_rate = 1e-3", "learning_rate = -1.0"),
            ("effort_cost", "effort"),
            ("set_size = 3", "set_size = 100"),
        ],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:8: `tasks.effort`: is no task parameter of point-mass (it has: effort_cost, mass)\n\
                 bad.toml:22: `teacher.learning_rate`: expected a positive number, got -1\n\
                 bad.toml:34: `discover.contexts`: expected at least set_size = 100 contexts, got 60\n\
                 bad.toml:36: `discover.set_size`: K = 100 options cannot be chosen from N = 24 candidates",
    },
    Case {
        what: "no TOML",
        changes: &[("seed = 7", "seed = ")],
        arguments: BAD,
        code: 2,
        stderr: "elo: bad.toml:2:8: is no valid TOML: string values must be quoted, expected literal string",
    },
    Case {
        what: "missing config",
        changes: &[],
        arguments: &["discover", "missing.toml"],
        code: 2,
        stderr: "elo: cannot read the config missing.toml: No such file or directory (os error 2)",
    },
    Case {
        what: "config is a directory",
        changes: &[],
        arguments: &["discover", "folder.toml"],
        code: 2,
        stderr: "elo: cannot read the config folder.toml: it is not a regular file",
    },
    Case {
        what: "config is no text",
        changes: &[],
        arguments: &["config", "check", "binary.toml"],
        code: 2,
        stderr: "elo: cannot read the config binary.toml: it is not UTF-8 text",
    },
    Case {
        what: "override without a value",
        changes: &[],
        arguments: &["discover", "toy.toml", "--out", "never", "--set", "discover.set_size"],
        code: 2,
        stderr: "elo: --set discover.set_size: expected `path=value`, for example `metrics[1].k=0.3`; there is no `=`",
    },
    Case {
        what: "override of an unknown field",
        changes: &[],
        arguments: &["discover", "toy.toml", "--out", "never", "--set", "report.context=5"],
        code: 2,
        stderr: "elo: --set report.context=5: `report.context`: is unknown; expected one of contexts, random_subsets, \
                 alpha, bootstrap_draws, confidence; did you mean `contexts`?",
    },
    Case {
        what: "override of an item that is not there",
        changes: &[],
        arguments: &["discover", "toy.toml", "--out", "never", "--set", "metrics[7].k=1"],
        code: 2,
        stderr: "elo: --set metrics[7].k=1: `metrics`: has no item [7]: the list has [0] to [1]; to add one give the \
                 whole list, `metrics=[…, …]`",
    },
    Case {
        what: "no workers",
        changes: &[],
        arguments: &["discover", "toy.toml", "--out", "never", "--workers", "0"],
        code: 2,
        stderr: "elo: `--workers`: expected at least 1, got 0",
    },
    Case {
        what: "workers that are no number",
        changes: &[],
        arguments: &["discover", "toy.toml", "--out", "never", "--workers", "many"],
        code: 2,
        stderr: "error: invalid value 'many' for '--workers <WORKERS>': invalid digit found in string\n\n\
                 For more information, try '--help'.",
    },
    Case {
        what: "run directory in a file",
        changes: &[],
        arguments: &["discover", "toy.toml", "--out", "file/run"],
        code: 2,
        stderr: "elo: cannot use `file/run` as a run directory: Not a directory (os error 20)",
    },
    Case {
        what: "run directory is a file",
        changes: &[],
        arguments: &["discover", "toy.toml", "--out", "file"],
        code: 2,
        stderr: "elo: --out: file is no folder",
    },
    Case {
        what: "missing option set",
        changes: &[],
        arguments: &["evaluate", "nowhere"],
        code: 2,
        stderr: "elo: nowhere: is no option set: it has no manifest.json; `elo discover` writes option sets to \
                 RUN/results/option_sets/METRIC",
    },
    Case {
        what: "option set of a later format",
        changes: &[],
        arguments: &["evaluate", "later"],
        code: 2,
        stderr: "elo: later/manifest.json: option-set format 3, this program reads formats 1 to 2",
    },
    Case {
        what: "option set of another robot",
        changes: &[],
        arguments: &["evaluate", "walker"],
        code: 2,
        stderr: "elo: walker/manifest.json: the option set does not fit this simulator: robot walker2d against point-mass \
                 (set against simulator)",
    },
    Case {
        what: "option set that is no JSON",
        changes: &[],
        arguments: &["evaluate", "text"],
        code: 2,
        stderr: "elo: text/manifest.json: not JSON: expected ident at line 1 column 2",
    },
    Case {
        what: "unknown kind of example",
        changes: &[],
        arguments: &["example", "negativ_tail"],
        code: 2,
        stderr: "elo: no plugin has the kind `negativ_tail`; did you mean `negative_tail`? (`elo plugins` lists them)",
    },
    Case {
        what: "unknown command",
        changes: &[],
        arguments: &["discower", "toy.toml"],
        code: 2,
        stderr: "error: unrecognized subcommand 'discower'\n\n  tip: a similar subcommand exists: 'discover'\n\n\
                 Usage: elo <COMMAND>\n\nFor more information, try '--help'.",
    },
];

#[test]
fn each_fault_has_its_exit_code_and_its_words() {
    let mut wrong = String::new();
    for case in CASES {
        write(place(), "bad.toml", &toy_with(case.changes));
        let mut command = Command::new(elo());
        let ran = run(command.args(case.arguments).current_dir(place()));
        if ran.code != Some(case.code) || ran.stderr.trim_end() != case.stderr || !ran.stdout.is_empty() {
            wrong +=
                &format!("{}: expected exit code {} and\n{}\ngot {ran}\n", case.what, case.code, case.stderr);
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
    assert!(!place().join("never").exists() && !place().join("runs").exists(), "nothing was begun");
}

#[test]
fn a_missing_engine_is_told_with_what_to_run() {
    let robot = [("kind = \"point_mass\"\nreset_spread = 0.5", "kind = \"mujoco\"\nrobot = \"ant\"")];
    let tasks = [("effort_cost]\nlow = -0.3\nhigh = -0.05", "electricity_cost]\nlow = -2.4\nhigh = -1.4")];
    write(place(), "mujoco.toml", &toy_with(&[robot, tasks].concat()));
    let alone = place().join("alone/elo");
    let ran = run(Command::new(&alone).args(["discover", "mujoco.toml"]).current_dir(place())).expect_code(2);
    assert_eq!(
        ran.stderr,
        format!(
            "elo: {} is missing: run `tests/set-up` in the repository, which places MuJoCo under target/ and builds the \
             worker\n",
            fs::canonicalize(&alone).unwrap().with_file_name("elo-mujoco").display()
        )
    );
}

/// A shell in which file systems can be mounted that nobody else sees; `None` where the system does not let us.
fn with_mounts(test: &str, mount: &str, script: &str) -> Option<Ran> {
    let shell = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--map-root-user", "--mount", "sh", "-c", script]).current_dir(place());
        command.arg("sh").arg(elo());
        run(&mut command)
    };
    fs::create_dir_all(place().join("mounted")).unwrap();
    if Command::new("unshare").arg("--version").output().is_err() || shell(mount).code != Some(0) {
        skipped(test, &format!("`unshare` cannot do `{mount}` here"));
        return None;
    }
    Some(shell(&format!("{mount} && {script}")))
}

#[test]
fn a_read_only_folder_is_told_before_any_work() {
    let mount = "mount -t tmpfs -o ro none mounted";
    let script = "exec \"$1\" discover toy.toml --out mounted/run";
    let Some(ran) = with_mounts("a_read_only_folder_is_told_before_any_work", mount, script) else { return };
    let ran = ran.expect_code(1);
    assert_eq!(
        ran.stderr,
        "elo: cannot use `mounted/run` as a run directory: Read-only file system (os error 30)\n"
    );
}

#[test]
fn a_full_disk_is_told_with_what_it_needs_and_the_run_goes_on_when_there_is_room() {
    let test = "a_full_disk_is_told_with_what_it_needs_and_the_run_goes_on_when_there_is_room";
    let mount = "mount -t tmpfs -o size=200k none mounted";
    let script = "\"$1\" discover toy.toml --out mounted/run; echo code $? >&2; \
                  mount -o remount,size=20m mounted && \"$1\" discover toy.toml --out mounted/run > table && \
                  diff -r mounted/run/results run/results && echo the same results";
    let Some(ran) = with_mounts(test, mount, script) else { return };
    let ran = ran.expect_code(0);
    let lines: Vec<&str> = ran.stderr.lines().collect();
    let end = lines.iter().position(|line| *line == "code 1").unwrap_or_else(|| panic!("{ran}"));
    let told = lines[end - 1];
    assert!(told.starts_with("elo: could not write ") && told.contains(" bytes to `mounted/run/"), "{told}");
    let rest = "No space left on device (os error 28); what was stored before is intact, and the run can be taken up again \
                once the disk accepts them";
    assert!(told.ends_with(rest), "{told}");
    // What was done before was not done again.
    assert!(
        lines[end..].iter().any(|line| line.starts_with("elo: teachers: 2 units, 2 done before")),
        "{ran}"
    );
    assert_eq!(ran.stdout, "the same results\n");
}

#[test]
fn a_kept_run_is_not_harmed_by_bad_input() {
    let before: Vec<PathBuf> = names(&place().join("run"));
    let results = |name: &str| fs::read(place().join("run/results").join(name)).unwrap();
    let report = results("report.json");
    write(place(), "worse.toml", &toy_with(&[("set_size = 3", "set_size = 300")]));
    let mut command = Command::new(elo());
    run(command.args(["discover", "worse.toml", "--out", "run"]).current_dir(place())).expect_code(2);
    assert_eq!(names(&place().join("run")), before);
    assert_eq!(results("report.json"), report);
}
