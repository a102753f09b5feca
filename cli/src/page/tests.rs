#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;

use super::fixture::{PAPER, QUICK, run};
use super::{PageData, render};
use serde_json::Value;

fn page(runs: Vec<super::RunData>) -> super::Page {
    render(&PageData { runs })
}

const SECTIONS: [&str; 9] =
    ["summary", "distributions", "tables", "curves", "options", "scores", "engines", "replay", "config"];

/// The value of an attribute of a tag.
fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = tag.split_once(&format!(" {name}=\""))?;
    rest.split_once('"').map(|(value, _)| value)
}

#[test]
fn every_figure_is_the_one_of_its_file_to_the_last_digit() {
    let run = run(QUICK);
    let files: BTreeMap<&str, Value> = BTreeMap::from([
        ("report.json", serde_json::to_value(&run.report).unwrap()),
        ("experiments.json", serde_json::to_value(&run.experiments).unwrap()),
        ("crosscheck.json", serde_json::to_value(&run.crosscheck).unwrap()),
    ]);
    let html = page(vec![run]).html;
    let mut compared = 0;
    for tag in
        html.split("<span ").skip(1).filter_map(|rest| rest.split_once('>')).map(|(tag, _)| format!(" {tag}"))
    {
        let Some((file, pointer)) = attribute(&tag, "data-at").and_then(|at| at.split_once('#')) else {
            continue;
        };
        let found = files[file].pointer(pointer).unwrap_or_else(|| panic!("{file}: nothing at {pointer}"));
        let fields: &[(&str, &str)] = match found {
            Value::Object(_) => &[("data-value", "/estimate"), ("data-low", "/low"), ("data-high", "/high")],
            _ => &[("data-value", "")],
        };
        for (name, field) in fields {
            let shown: f64 = attribute(&tag, name).unwrap().parse().unwrap();
            assert_eq!(Some(shown), found.pointer(field).unwrap().as_f64(), "{file}#{pointer}");
            compared += 1;
        }
    }
    assert!(compared > 500, "{compared}");
}

#[test]
fn a_page_of_the_papers_size_is_small_enough() {
    let made = page(vec![run(PAPER)]);
    assert!(made.html.len() < 15 << 20, "{} bytes", made.html.len());
    for section in SECTIONS {
        assert!(made.html.contains(&format!("data-section=\"{section}\"")), "{section}");
    }
    assert!(made.figures.len() > 20);
}

#[test]
fn whatever_is_absent_is_named_with_its_command() {
    let mut bare = run(QUICK);
    (bare.experiments, bare.crosscheck, bare.replays) = (None, None, Vec::new());
    let html = page(vec![bare]).html;
    for command in
        ["elo experiments runs/made-up", "elo crosscheck runs/made-up --simulator KIND", "--replays 0"]
    {
        assert!(html.contains(&format!("<code>{command}</code>")), "{command}");
    }
    assert!(!html.contains("three.js Authors"), "a page without films needs no three.js");
}

#[test]
fn texts_of_a_run_are_texts_and_no_marks() {
    let html = page(vec![run(QUICK)]).html;
    assert!(html.contains("a warning with &lt;b&gt;marks&lt;/b&gt; &amp; more"));
    assert!(!html.contains("</script><b>"));
    // Only the page's own scripts end.
    assert_eq!(html.matches("<script").count(), html.matches("</script>").count());
}

#[test]
fn nothing_is_loaded_from_elsewhere() {
    let html = page(vec![run(QUICK)]).html;
    assert!(html.contains("default-src 'none'"));
    for mark in [" src=", "@import", "url(http", "href=\"http"] {
        assert!(!html.contains(mark), "{mark}");
    }
}

#[test]
fn runs_beside_each_other_share_no_names() {
    let mut second = run(QUICK);
    second.name = "another".to_owned();
    let made = page(vec![run(QUICK), second]);
    let ids: Vec<&str> =
        made.html.split(" id=\"").skip(1).filter_map(|rest| rest.split_once('"')).map(|(id, _)| id).collect();
    let mut distinct = ids.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(ids.len(), distinct.len());
    let files: std::collections::BTreeSet<&str> =
        made.figures.iter().map(|figure| figure.id.as_str()).collect();
    assert_eq!(files.len(), made.figures.len());
}
