//! The experiments, the new prices and the comparison of runs: their numbers are those of the report, and nothing that is
//! there is measured again.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::path::Path;

use elo_core::compare::RunComparison;
use elo_core::experiments::Experiments;
use elo_core::experiments::curve::Crossing;
use elo_core::figures::Row;
use elo_core::report::Report;
use elo_core::reprice::Repriced;
use elo_core::returns::SetValue;
use elo_tests::folders::names;
use elo_tests::programs::{Ran, elo_with, run, write};
use elo_tests::toy::{TOY, experiment, toy_with};

/// [`TOY`] with another learner beside its own.
fn config() -> String {
    format!(
        "{TOY}\n[experiments]\nsweep = [0.1, 1.0]\n\n[[experiments.other_learners]]\nkind = \"behavior_cloning\"\n"
    )
}

fn finished(folder: &Path, name: &str, text: &str) -> (std::path::PathBuf, Report) {
    let (config, out) = (write(folder, &format!("{name}.toml"), text), folder.join(name));
    run(elo_with(&["discover"]).arg(config).arg("--out").arg(&out)).expect_success();
    let report = serde_json::from_slice(&std::fs::read(out.join("results/report.json")).unwrap()).unwrap();
    (out, report)
}

fn json<T: serde::de::DeserializeOwned>(ran: &Ran) -> T {
    serde_json::from_str(&ran.stdout).unwrap_or_else(|error| panic!("{error}\n{ran}"))
}

fn row<'a>(found: &'a Experiments, name: &str) -> &'a Row {
    let names: Vec<&String> = found.agents.iter().map(|agent| &agent.row.name).collect();
    &found.agents.iter().find(|agent| agent.row.name == name).unwrap_or_else(|| panic!("{names:?}")).row
}

#[test]
fn experiments_repeat_the_report_and_add_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let (out, report) = finished(folder.path(), "toy", &config());
    let ran = run(elo_with(&["experiments", "--json"]).arg(&out)).expect_success();
    let found: Experiments = json(&ran);

    // The same samples by the same yardstick are the same figures, to the bit.
    for set in &report.sets {
        assert_eq!(*row(&found, &set.metric), set.row);
    }
    for baseline in report.baselines.iter().filter(|row| row.name != "random K-subsets") {
        assert_eq!(row(&found, &baseline.name), baseline);
    }
    for agent in &found.agents {
        let members = agent.returns.len() / found.contexts;
        assert_eq!(agent.returns.len(), members * 60);
        let mean = agent.returns.iter().sum::<f64>() / agent.returns.len() as f64;
        assert!((mean - agent.row.mean_return.estimate).abs() < 1e-9, "{}", agent.row.name);
        assert_eq!((agent.falls.count, agent.falls.rollouts), (0, 60), "nobody falls on a line");
        // The exact bound of 0 among n is 1 - 0.05^(1/n).
        assert!((agent.falls.upper - (1.0 - 0.05_f64.powf(1.0 / 60.0))).abs() < 1e-9);
    }
    row(&found, "maximum_mean and primitive actions");
    row(&found, "behavior_cloning: negative_tail(k=0.75)");
    assert_eq!(found.curve.iter().map(|point| point.steps).collect::<Vec<_>>(), [0, 8192, 16384]);
    row(&found, "teacher after 16384 steps");

    // Two sets, the mixed agent and the two sets of the other learner; each against both ways of acting.
    assert_eq!(found.equivalents.len(), 10);
    for one in &found.equivalents {
        assert!(one.low <= one.high, "{one:?}");
        let curve = found.curve.iter().map(|point| match one.acts {
            elo_core::experiment::TeacherActs::Sample => point.sampled.mean_return.estimate,
            elo_core::experiment::TeacherActs::Mean => point.mean_action.mean_return.estimate,
        });
        let reached = curve.clone().any(|value| value >= one.level.estimate);
        assert_eq!(one.steps != Crossing::AboveCurve, reached, "{one:?}");
    }

    // Both readings of one metric with a tail; the run's own reading repeats the report's tail.
    let [own, other] = &found.tails[..] else { panic!("{:?}", found.tails) };
    assert_eq!((own.set_value, other.set_value), (SetValue::Mixture, SetValue::Average));
    let set = report.sets.iter().find(|set| set.metric == own.metric).unwrap();
    assert_eq!(own.set.area, set.row.lower_tail);
    assert_eq!(own.set.options, set.options.iter().map(|option| option.number).collect::<Vec<_>>());
    assert_eq!(found.sweep.len(), 4);
    assert_eq!(found.spreads.iter().map(|spread| spread.scores.len()).collect::<Vec<_>>(), [24, 24]);

    // Asked again, it measures nothing and says the same; the files are there.
    let before = names(&out.join("units"));
    let again = run(elo_with(&["experiments", "--json"]).arg(&out)).expect_success();
    assert_eq!(again.stdout, ran.stdout);
    assert_eq!(names(&out.join("units")), before);
    for name in ["agents", "returns", "curve", "equivalents", "tails", "sweep", "scores"] {
        let text = std::fs::read_to_string(out.join(format!("results/experiments/{name}.csv"))).unwrap();
        let columns = |line: &str| line.split(',').count();
        let header = columns(text.lines().next().unwrap());
        assert!(text.lines().count() > 1, "{name}");
        assert!(text.lines().all(|line| columns(line) == header), "{name}\n{text}");
    }
}

#[test]
fn new_prices_are_what_a_simulation_of_the_new_tasks_gives() {
    let folder = tempfile::tempdir().unwrap();
    let (out, report) = finished(folder.path(), "own", TOY);
    let dearer = toy_with(&[("low = -0.3\nhigh = -0.05", "low = -3.0\nhigh = -2.0")]);
    let (_, simulated) = finished(folder.path(), "dearer", &dearer);
    let before = names(&out.join("units"));
    let reprice = |range: &str| -> Repriced {
        let arguments = ["reprice", "--json", "--tasks", range];
        json(&run(elo_with(&arguments).arg(&out)).expect_success())
    };

    // The run's own range changes nothing.
    let same = reprice("effort_cost=-0.3..-0.05");
    for (set, reported) in same.sets.iter().zip(&report.sets) {
        assert_eq!(set.row, reported.row);
        assert_eq!(set.chosen, set.options);
    }

    // Random torque does not depend on teachers, so the run of the new tasks meets it in the same rollouts.
    let dear = reprice("effort_cost=-3..-2");
    let of = |rows: &[Row]| rows.iter().find(|row| row.name == "random torque").unwrap().mean_return.estimate;
    assert!((of(&dear.baselines) - of(&simulated.baselines)).abs() < 1e-12);
    assert!(of(&dear.baselines) < of(&report.baselines) - 1.0, "effort is dearer");
    assert_eq!(names(&out.join("units")), before, "nothing was simulated");
}

#[test]
fn a_run_compared_with_itself_differs_by_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (first, report) = finished(folder.path(), "first", TOY);
    let (second, _) = finished(folder.path(), "second", &toy_with(&[("seed = 7", "seed = 8")]));
    let compare = |second: &Path| -> RunComparison {
        json(&run(elo_with(&["compare", "--json"]).arg(&first).arg(second)).expect_success())
    };
    let itself = compare(&first);
    assert_eq!(itself.pairs.len(), report.sets.len());
    for (pair, set) in itself.pairs.iter().zip(&report.sets) {
        assert_eq!(pair.first.mean_return.estimate, set.row.mean_return.estimate);
        assert_eq!((pair.difference.low, pair.difference.high), (0.0, 0.0));
    }
    let other = compare(&second);
    for pair in &other.pairs {
        let difference = pair.second.mean_return.estimate - pair.first.mean_return.estimate;
        assert!((pair.difference.estimate - difference).abs() < 1e-9);
        assert!(pair.difference.low < pair.difference.high);
    }
}

#[test]
fn the_paper_is_reproduced_at_a_small_size() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("reproduced");
    let small = [
        "teacher.steps=12288",
        "teacher.snapshots=2",
        "teacher.d0_pool=4",
        "discover.candidates=6",
        "discover.contexts=6",
        "discover.steps=20",
        "discover.set_size=2",
        "discover.max_retakes=1000",
        "report.contexts=8",
        "report.random_subsets=1",
        "report.bootstrap_draws=100",
        "experiments.sweep=[]",
        "experiments.other_learners=[]",
    ];
    let mut command = elo_with(&["reproduce", "--robot", "half-cheetah", "--seeds", "2"]);
    command.arg("--out").arg(&out).args(small.iter().flat_map(|change| ["--set", change]));
    let ran = run(&mut command).expect_success();
    for figure in ["Figures 5.2, 5.3", "Table 5.1: improvement", "Table 5.2: improvement", "Figure 5.6"] {
        assert!(ran.stdout.contains(figure), "{figure}\n{ran}");
    }
    let text = std::fs::read_to_string(out.join("quick-rapier/reproduction.json")).unwrap();
    let all: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(all["changes"][0], "teacher.steps=12288");
    let share = all["robots"][0]["beside"].as_array().unwrap().last().unwrap();
    assert_eq!(share["seeds"].as_array().unwrap().len(), 2, "one value a pipeline seed\n{share}");
    assert_eq!(share["paper"], 0.0067);
    let again = run(&mut command).expect_success();
    assert_eq!(again.stdout, ran.stdout, "taken up, it says the same");
    assert!(again.stderr.contains("teachers: 2 units, 2 done before"), "{again}");
}

#[test]
fn what_cannot_be_priced_compared_or_reproduced_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (out, _) = finished(folder.path(), "toy", TOY);
    let refused = |arguments: &[&str], folders: &[&Path], expected: &str| {
        let ran = run(elo_with(arguments).args(folders)).expect_code(2);
        assert!(ran.stderr.contains(expected), "{ran}");
    };
    let nowhere = folder.path().join("nowhere");
    refused(&["reprice", "--tasks", "effort_cost=-1"], &[&out], "expected NAME=LOW..HIGH");
    refused(
        &["reprice", "--tasks", "cost=-1..0"],
        &[&out],
        "--tasks cost: is no task parameter of point-mass",
    );
    refused(&["reprice", "--tasks", "mass=1..2"], &[&out], "`mass` changes how the robot moves");
    refused(&["compare"], &[&out, &nowhere], "is no run directory");
    let steps = format!("steps = {}", experiment(TOY).discover.steps);
    let (shorter, _) = finished(folder.path(), "shorter", &toy_with(&[(&steps, "steps = 5")]));
    refused(&["compare"], &[&out, &shorter], "(of `[discover]`) are not comparable");
    refused(&["experiments"], &[&nowhere], "`elo discover CONFIG --out DIRECTORY` makes one");
    std::fs::remove_file(out.join("results/experiment.toml")).unwrap();
    refused(&["experiments"], &[&out], "this run is not finished");
    refused(
        &["reproduce", "--robot", "hopper"],
        &[],
        "expected one of ant, half-cheetah, walker2d, got hopper",
    );
    refused(&["reproduce", "--seeds", "0"], &[], "expected at least 1");
}

#[test]
fn two_learners_of_a_kind_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let once_more = "\n[[experiments.other_learners]]\nkind = \"behavior_cloning\"\nepochs = 1\n";
    let (out, _) = finished(folder.path(), "twice", &(config() + once_more));
    let found: Experiments = json(&run(elo_with(&["experiments", "--json"]).arg(&out)).expect_success());
    let [first, second] =
        [1, 2].map(|number| row(&found, &format!("behavior_cloning {number}: maximum_mean")));
    assert_ne!(first.mean_return, second.mean_return);
}
