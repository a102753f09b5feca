//! `elo report`: finished runs as one page.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use elo_core::experiments::EXPERIMENTS_FORMAT;
use elo_core::plugin::Plugin;
use elo_core::report::{REPORT_FORMAT, Report};
use elo_core::results::PROVENANCE;
use serde::de::DeserializeOwned;

use crate::arguments;
use crate::commands::films::films;
use crate::exit::Exit;
use crate::load::{config_of_run, read_text};
use crate::output::print;
use crate::page::{CandidateRow, Page, PageData, RunData, render};

/// Films what the replay shows, then writes the page and its plots.
pub fn run(arguments: &arguments::Report, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let out = &arguments.out;
    check_out(out)?;
    let mut runs = Vec::new();
    let mut names = BTreeSet::new();
    for folder in &arguments.runs {
        let mut run = read(folder)?;
        run.replays = films(arguments, folder, plugins)?;
        if !names.insert(run.name.clone()) {
            run.name = folder.display().to_string();
            names.insert(run.name.clone());
        }
        runs.push(run);
    }
    let page = render(&PageData { runs });
    write(out, &page)?;
    print(&format!("{} ({} plots in {})\n", out.display(), page.figures.len(), plots_folder(out).display()))
}

/// Refuses a place where no page can be, before anything is read.
fn check_out(out: &Path) -> Result<(), Exit> {
    let bad = |why: String| Err(Exit::BadInput(format!("--out {}: {why}", out.display())));
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match out {
        _ if out.is_dir() => bad("it is a folder; expected the name of a file".to_owned()),
        _ if out.file_name().is_none() => bad("expected the name of a file".to_owned()),
        _ if !folder.is_dir() => bad(format!("there is no folder {}", folder.display())),
        _ => Ok(()),
    }
}

fn plots_folder(out: &Path) -> PathBuf {
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    out.with_file_name(format!("{stem}-plots"))
}

fn write(out: &Path, page: &Page) -> Result<(), Exit> {
    let failed = |path: &Path, error: std::io::Error| {
        Exit::Failed(format!("cannot write {}: {error}", path.display()))
    };
    let folder = plots_folder(out);
    fs::create_dir_all(&folder).map_err(|error| failed(&folder, error))?;
    for figure in &page.figures {
        for (ending, text) in [("svg", figure.standalone()), ("csv", figure.csv().to_owned())] {
            let path = folder.join(format!("{}.{ending}", figure.id));
            fs::write(&path, text).map_err(|error| failed(&path, error))?;
        }
    }
    fs::write(out, &page.html).map_err(|error| failed(out, error))
}

fn read(folder: &Path) -> Result<RunData, Exit> {
    let shown = folder.display();
    if !folder.is_dir() {
        return Err(Exit::BadInput(format!("{shown}: there is no such run directory")));
    }
    let path = config_of_run(folder)?;
    let config = read_text(&path)?;
    let results = folder.join("results");
    let practice = results.join("practice.csv");
    let report: Report = json(&results.join("report.json"), Some(REPORT_FORMAT))?;
    let plan = toml::from_str(&config).map_err(|error| bad(&path, &error.message().to_owned()))?;
    let name = fs::canonicalize(folder)
        .ok()
        .and_then(|path| path.file_name().map(|n| n.to_string_lossy().into_owned()));
    Ok(RunData {
        name: name.unwrap_or_else(|| shown.to_string()),
        folder: shown.to_string(),
        plan,
        config,
        provenance: json(&folder.join(PROVENANCE), None)?,
        candidates: candidates(&results.join("candidates.csv"), report.sets.len())?,
        failures: rows(&results.join("failures.csv"))?,
        practice: if practice.exists() { rows(&practice)? } else { Vec::new() },
        experiments: optional(&results.join("experiments.json"), Some(EXPERIMENTS_FORMAT))?,
        crosscheck: optional(&results.join("crosscheck.json"), None)?,
        replays: Vec::new(),
        report,
    })
}

fn bad(path: &Path, why: &dyn std::fmt::Display) -> Exit {
    Exit::BadInput(format!("{}: {why}", path.display()))
}

fn optional<T: DeserializeOwned>(path: &Path, format: Option<u32>) -> Result<Option<T>, Exit> {
    if path.exists() { json(path, format).map(Some) } else { Ok(None) }
}

/// What a JSON file holds. A file of another format is told apart from a damaged one.
fn json<T: DeserializeOwned>(path: &Path, format: Option<u32>) -> Result<T, Exit> {
    let text = fs::read_to_string(path).map_err(|error| bad(path, &error))?;
    if let Some(known) = format {
        let value: serde_json::Value = serde_json::from_str(&text).map_err(|error| bad(path, &error))?;
        let found = value["format"].as_u64();
        if found != Some(u64::from(known)) {
            let found = found.map_or("no format".to_owned(), |found| format!("format {found}"));
            return Err(bad(path, &format!("it has {found}, and this program reads format {known}")));
        }
    }
    serde_json::from_str(&text).map_err(|error| bad(path, &error))
}

/// `candidates.csv`: number, teacher, retakes, teacher_return, then one score a metric.
fn candidates(path: &Path, metrics: usize) -> Result<Vec<CandidateRow>, Exit> {
    let mut reader = csv::Reader::from_path(path).map_err(|error| bad(path, &error))?;
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| bad(path, &error))?;
        let field = |index: usize| record.get(index).unwrap_or_default();
        let number = field(0).parse().map_err(|error| bad(path, &error))?;
        rows.push(CandidateRow { number, scores: (0..metrics).map(|i| field(4 + i).parse().ok()).collect() });
    }
    Ok(rows)
}

/// The lines of a table with a heading.
fn rows<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, Exit> {
    let mut reader = csv::Reader::from_path(path).map_err(|error| bad(path, &error))?;
    reader.deserialize().collect::<Result<_, _>>().map_err(|error| bad(path, &error))
}
