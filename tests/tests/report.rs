//! `elo report` from outside: its page, and what it says to bad input.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use elo_tests::folders::{copy, names};
use elo_tests::programs::{Ran, discover, elo, run, write};
use elo_tests::toy::TOY;

/// A folder with a finished run in `run`, one that another config was begun in since in `other`, an unfinished one in `begun`,
/// one of a later program in `later` and one with a damaged report in `damaged`.
fn place() -> &'static Path {
    static PLACE: OnceLock<tempfile::TempDir> = OnceLock::new();
    PLACE
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let at = |name: &str| folder.path().join(name);
            let config = write(folder.path(), "toy.toml", TOY);
            run(&mut discover(elo(), &config, &at("run"))).expect_success();
            fs::create_dir(at("begun")).unwrap();
            fs::copy(&config, at("begun/experiment.toml")).unwrap();
            copy(&at("run"), &at("other"));
            let begun =
                fs::read_to_string(at("other/experiment.toml")).unwrap().replacen("seed = 7", "seed = 8", 1);
            fs::write(at("other/experiment.toml"), begun).unwrap();
            let report = fs::read_to_string(at("run/results/report.json")).unwrap();
            for (name, text) in
                [("later", report.replacen("\"format\": 1", "\"format\": 2", 1)), ("damaged", "{".to_owned())]
            {
                copy(&at("run"), &at(name));
                fs::write(at(name).join("results/report.json"), text).unwrap();
            }
            folder
        })
        .path()
}

fn report(arguments: &[&str]) -> Ran {
    let mut command = std::process::Command::new(elo());
    run(command.current_dir(place()).arg("report").args(arguments))
}

#[test]
fn bad_input_is_told_and_nothing_is_written() {
    let cases: [(&[&str], &str); 7] = [
        (&["none"], "elo: none: there is no such run directory\n"),
        (
            &["begun"],
            "elo: begun: this run is not finished: take it up with `elo discover DIRECTORY/experiment.toml --out \
             DIRECTORY`\n",
        ),
        (&["later"], "elo: later/results/report.json: it has format 2, and this program reads format 1\n"),
        (&["damaged"], "elo: damaged/results/report.json: EOF while parsing an object at line 1 column 1\n"),
        (
            &["run", "--out", "nowhere/page.html"],
            "elo: --out nowhere/page.html: there is no folder nowhere\n",
        ),
        (&["run", "--out", "run"], "elo: --out run: it is a folder; expected the name of a file\n"),
        (&["run", "--out", ".."], "elo: --out ..: it is a folder; expected the name of a file\n"),
    ];
    let before = names(place());
    for (arguments, stderr) in cases {
        let ran = report(arguments).expect_code(2);
        assert_eq!(ran.stderr, stderr, "{arguments:?}");
        assert_eq!(ran.stdout, "", "{arguments:?}");
    }
    assert_eq!(names(place()), before);
}

#[test]
fn a_finished_run_becomes_a_page_with_its_plots_beside_it() {
    let out = tempfile::tempdir().unwrap();
    let page = out.path().join("page.html");
    let ran = report(&["run", "--replays", "0", "--out", page.to_str().unwrap()]).expect_success();
    assert_eq!(ran.stderr, "");
    assert!(!fs::read_to_string(&page).unwrap().contains("class=\"films\""), "no replay was asked for");
    report(&["run", "--replays", "2", "--out", page.to_str().unwrap()]).expect_success();
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.starts_with("<!DOCTYPE html>"));
    assert!(html.contains("class=\"films\""), "a mass on a line can be seen");
    // The terminal's table and the page hold the same figures.
    let config = place().join("toy.toml");
    let table = run(&mut discover(elo(), &config, &place().join("run"))).expect_success().stdout;
    let set = table.lines().find(|line| line.starts_with("the set")).unwrap();
    let figures = set.trim_start_matches("the set").split("   ").map(str::trim).filter(|f| f.ends_with(']'));
    let figures: Vec<&str> = figures.collect();
    assert!(figures.len() > 2, "{set}");
    for figure in figures {
        let (estimate, range) = figure.split_once(' ').unwrap();
        let markup = format!(">{estimate} <span class=\"range\">{range}</span></span>");
        assert!(html.contains(&markup), "{figure}");
    }
    let plots = names(&out.path().join("page-plots"));
    assert!(plots.iter().any(|name| name == "mean-return.svg"), "{plots:?}");
}

#[test]
fn a_page_is_about_the_results_whatever_was_begun_since() {
    let out = tempfile::tempdir().unwrap();
    let page = out.path().join("page.html");
    let ran = report(&["other", "--out", page.to_str().unwrap()]).expect_success();
    let told = "other: another config was begun here since and is not finished; this is about the results that are there";
    assert_eq!(ran.stderr.matches(told).count(), 1, "{ran}");
    let (stages, todo) =
        ran.stderr.lines().filter_map(|line| line.split_once(" units")).fold((0, 0), |n, stage| {
            let (name, done) = stage;
            let count = name.rsplit(' ').next().unwrap();
            (n.0 + 1, n.1 + usize::from(done != format!(", {count} done before")))
        });
    assert!(stages > 3 && todo == 1, "nothing is done but the films: {ran}");
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("seed = 7\n") && !html.contains("seed = 8\n"), "the config of the results");
}

#[test]
fn a_run_of_another_program_has_no_replay_and_is_not_done_again() {
    let folder = tempfile::tempdir().unwrap();
    let (out, page) = (folder.path().join("run"), folder.path().join("page.html"));
    let config = place().join("toy.toml");
    run(&mut discover(elo(), &config, &out)).expect_success();
    let provenance = fs::read_to_string(out.join("results/provenance.json")).unwrap();
    let mut value: serde_json::Value = serde_json::from_str(&provenance).unwrap();
    value["program"] = "elo 0.0.1".into();
    fs::write(out.join("results/provenance.json"), value.to_string()).unwrap();
    let before = names(&out);
    let ran = report(&[out.to_str().unwrap(), "--out", page.to_str().unwrap()]).expect_success();
    assert!(ran.stderr.contains("no replay, because elo 0.0.1 made it"), "{ran}");
    assert!(!fs::read_to_string(&page).unwrap().contains("class=\"films\""));
    assert_eq!(names(&out), before, "nothing was done in the run directory");
}
