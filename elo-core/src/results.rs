//! What a finished run leaves for people: `report.json`, option sets, and every rollout as NumPy arrays and CSV.
//!
//! | file in `results/` | shape | what |
//! | --- | --- | --- |
//! | `report.json` | | [`crate::report::Report`] |
//! | `experiment.toml` | | the whole resolved config that all of this is of; running it gives the same bytes |
//! | `provenance.json` | | the program, engine, compiler and class of processor that made it |
//! | `option_sets/<metric>/` | | [`crate::option_set::OptionSet`], one folder a metric |
//! | `candidates.csv` | N rows | number, teacher, retakes, teacher_return, then one score column a metric; sets that were learned by practice have no teacher |
//! | `practice.csv` | | candidate, steps, mean_return, mean_length: for each such set what the infant agent earned on the way, one row a point of its curve |
//! | `contexts_{select,report}.csv` | Z rows | task parameters, random_steps, redraws |
//! | `select_terms.npy` | (N, Z, terms) f64 | sums of reward terms of each candidate in each selecting context |
//! | `select_length.npy`, `select_clamped.npy` | (N, Z) u32 | control steps taken; those with a clamped action |
//! | `select_ending.npy` | (N, Z) u8 | 0 whole horizon, 1 fell, 2 cut short, 3 failed |
//! | `report_options_*.npy` | (options, Z, …) | the same for the options named in `report_options.csv` |
//! | `report_baselines_*.npy` | (rows, Z, …) | the same for the rows named in `report_baselines.csv` |
//! | `failures.csv` | | table, row, context and reason of every failed rollout; of failed recordings their number (the candidate's) and the take |
//!
//! The rows of `select_*` follow `candidates.csv`. A return is the inner product of the term sums with the prices of the
//! context's task.

use std::fmt::Write as _;

use npyz::WriterBuilder as _;

use crate::config;
use crate::crew::RunError;
use crate::csv::quoted;
use crate::discover::{Candidate, ContextSet, Discovery, Origin, Run};
use crate::option_set::{Manifest, OPTION_SET_FORMAT, OptionEntry, OptionSet};
use crate::policy::CurvePoint;
use crate::report::HeldOut;
use crate::rollout::{Ending, Rollout};
use crate::run_dir::{RunDir, RunDirError};
use crate::units::evaluate::ending_code;

/// The config that the results of a run directory are of. They are finished when it is there, because it is written last;
/// the `experiment.toml` beside `results/` is that of the work begun last, which may be another.
pub const CONFIG: &str = "results/experiment.toml";

/// What made them.
pub const PROVENANCE: &str = "results/provenance.json";

/// What is there or not by what was measured, and so would outlast results that take the place of others.
const OPTIONAL: [&str; 5] =
    ["option_sets", "practice.csv", "experiments.json", "experiments", "crosscheck.json"];

/// Writes everything below `results/` of the run directory. The same run gives the same bytes. `provenance` is JSON.
///
/// # Errors
/// See [`RunError`].
pub fn write(
    run: &Run<'_>,
    discovery: &Discovery,
    held_out: &HeldOut,
    provenance: &str,
) -> Result<(), RunError> {
    let put = |name: &str, bytes: &[u8]| run.crew.run_dir.write_file(&format!("results/{name}"), bytes);
    let config = config::show(run.experiment).map_err(|error| RunError::Config(error.to_string()))?;
    make_way(run.crew.run_dir, &config, provenance)?;
    for (index, choice) in discovery.selection.choices.iter().enumerate() {
        for (name, bytes) in option_set(run, discovery, index)?.files() {
            put(&format!("option_sets/{}/{name}", folder_name(&choice.metric)), &bytes)?;
        }
    }
    put("candidates.csv", candidates_csv(discovery).as_bytes())?;
    if let Some(text) = practice_csv(discovery) {
        put("practice.csv", text.as_bytes())?;
    }
    put("contexts_select.csv", contexts_csv(&discovery.contexts).as_bytes())?;
    put("contexts_report.csv", contexts_csv(&held_out.contexts).as_bytes())?;

    let select: Vec<&[Rollout]> = discovery.rollouts.iter().map(Vec::as_slice).collect();
    let options: Vec<&[Rollout]> = held_out.options.values().map(Vec::as_slice).collect();
    let baselines: Vec<&[Rollout]> =
        held_out.baselines.iter().flat_map(|(_, rows)| rows.iter().map(Vec::as_slice)).collect();
    let mut failures = "table,row,context,reason\n".to_owned();
    for (table, rows) in [("select", select), ("report_options", options), ("report_baselines", baselines)] {
        for (name, bytes) in arrays(table, &rows) {
            put(&name, &bytes)?;
        }
        list_failures(&mut failures, table, &rows);
    }
    for (recording, take, why) in &discovery.failed_takes {
        list_failure(&mut failures, &format!("recordings,{recording},{take}"), why);
    }
    put("report_options.csv", option_rows_csv(discovery, held_out).as_bytes())?;
    put("report_baselines.csv", baseline_rows_csv(held_out).as_bytes())?;
    put("failures.csv", failures.as_bytes())?;
    run.crew.run_dir.write_json("results/report.json", &held_out.report)?;
    run.crew.run_dir.write_file(PROVENANCE, provenance.as_bytes())?;
    Ok(run.crew.run_dir.write_file(CONFIG, config.as_bytes())?)
}

/// Takes away what was found by another config or another program: nothing of it may stand beside the new results.
fn make_way(run_dir: &RunDir, config: &str, provenance: &str) -> Result<(), RunDirError> {
    let holds = |name: &str, text: &str| Ok(run_dir.read_file(name)?.is_some_and(|b| b == text.as_bytes()));
    if holds(CONFIG, config)? && holds(PROVENANCE, provenance)? {
        return Ok(());
    }
    run_dir.remove(CONFIG)?;
    OPTIONAL.iter().try_for_each(|name| run_dir.remove(&format!("results/{name}")))
}

/// A metric's label as the name of a folder: letters, digits, `.`, `-` and `_` stay, other runs become one `_`.
pub fn folder_name(label: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
    let words: Vec<&str> = label.split(|c| !plain(c)).filter(|word| !word.is_empty()).collect();
    words.join("_")
}

fn option_set(run: &Run<'_>, discovery: &Discovery, index: usize) -> Result<OptionSet, RunError> {
    let choice = &discovery.selection.choices[index];
    let chosen: Vec<&Candidate> = choice.chosen.iter().map(|id| &discovery.candidates[*id]).collect();
    let of_candidates =
        chosen.iter().map(|candidate| run.options(candidate)).collect::<Result<Vec<_>, _>>()?;
    let entries = choice.chosen.iter().zip(&of_candidates).flat_map(|(id, options)| {
        options.iter().map(|option| OptionEntry {
            number: discovery.candidates[*id].number,
            policy: option.format.clone(),
            selection_score: choice.scores[*id].unwrap_or(f64::MIN),
        })
    });
    let manifest = Manifest {
        format: OPTION_SET_FORMAT,
        tensors_blake3: None,
        metric: choice.metric.clone(),
        spec: discovery.spec.clone(),
        horizon: run.experiment.discover.horizon(),
        scale: discovery.selection.scale,
        reference: discovery.selection.reference,
        options: entries.collect(),
        experiment: serde_json::to_value(run.experiment).expect("a config is plain data"),
    };
    Ok(OptionSet { manifest, options: of_candidates.concat() })
}

fn candidates_csv(discovery: &Discovery) -> String {
    let choices = &discovery.selection.choices;
    let mut text = "number,teacher,retakes,teacher_return".to_owned();
    for choice in choices {
        let _ = write!(text, ",{}", quoted(&choice.metric));
    }
    text.push('\n');
    for (id, candidate) in discovery.candidates.iter().enumerate() {
        let _ = write!(text, "{},", candidate.number);
        let _ = match candidate.origin {
            Origin::Recording { teacher, retakes, teacher_return } => {
                write!(text, "{teacher},{retakes},{teacher_return}")
            }
            Origin::Practice { .. } => write!(text, ",,"),
        };
        for choice in choices {
            let _ = write!(text, ",{}", choice.scores[id].map_or(String::new(), |score| score.to_string()));
        }
        text.push('\n');
    }
    text
}

/// One row a point of each set's curve; `None` where no candidate was learned by practice.
fn practice_csv(discovery: &Discovery) -> Option<String> {
    let mut text = "candidate,steps,mean_return,mean_length\n".to_owned();
    let mut found = false;
    for candidate in &discovery.candidates {
        let Origin::Practice { story, .. } = &candidate.origin else { continue };
        found = true;
        for CurvePoint { steps, mean_return, mean_length } in &story.curve {
            let number = |value: &Option<f64>| value.map_or(String::new(), |value| value.to_string());
            let (mean_return, mean_length) = (number(mean_return), number(mean_length));
            let _ = writeln!(text, "{},{steps},{mean_return},{mean_length}", candidate.number);
        }
    }
    found.then_some(text)
}

fn contexts_csv(contexts: &ContextSet) -> String {
    let names: Vec<&str> =
        contexts.tasks.first().map(|t| t.parameters().map(|(name, _)| name).collect()).unwrap_or_default();
    let mut text = [names.as_slice(), &["random_steps", "redraws"]].concat().join(",");
    text.push('\n');
    for ((task, steps), redraws) in contexts.tasks.iter().zip(&contexts.random_steps).zip(&contexts.redraws) {
        for (_, value) in task.parameters() {
            let _ = write!(text, "{value},");
        }
        let _ = writeln!(text, "{steps},{redraws}");
    }
    text
}

fn option_rows_csv(discovery: &Discovery, held_out: &HeldOut) -> String {
    let numbers = held_out.options.keys().map(|id| discovery.candidates[*id].number.to_string());
    std::iter::once("candidate".to_owned()).chain(numbers).map(|line| line + "\n").collect()
}

fn baseline_rows_csv(held_out: &HeldOut) -> String {
    let names = held_out.baselines.iter().flat_map(|(name, rows)| rows.iter().map(move |_| name.clone()));
    std::iter::once("baseline".to_owned()).chain(names).map(|line| line + "\n").collect()
}

fn list_failures(text: &mut String, table: &str, rows: &[&[Rollout]]) {
    for (row, rollouts) in rows.iter().enumerate() {
        for (context, rollout) in rollouts.iter().enumerate() {
            if let Some(reason) = rollout.ending.trouble() {
                list_failure(text, &format!("{table},{row},{context}"), reason);
            }
        }
    }
}

/// One line, whatever an engine wrote.
fn list_failure(text: &mut String, place: &str, reason: &str) {
    let reason = reason.lines().map(str::trim).collect::<Vec<_>>().join(" | ");
    let _ = writeln!(text, "{place},{}", quoted(&reason));
}

/// The arrays of one table of rollouts. Rows of different lengths (a selector that eliminates) are filled up with NaN
/// sums, length 0 and ending 3.
fn arrays(table: &str, rows: &[&[Rollout]]) -> Vec<(String, Vec<u8>)> {
    let columns = rows.iter().map(|row| row.len()).max().unwrap_or(0);
    let terms = rows.iter().flat_map(|row| row.first()).map(|r| r.term_sums.len()).next().unwrap_or(0);
    let missing = Rollout {
        term_sums: vec![f64::NAN; terms],
        length: 0,
        ending: Ending::Failed("not measured".to_owned()),
        clamped: 0,
    };
    let cells: Vec<&Rollout> =
        rows.iter().flat_map(|row| (0..columns).map(|j| row.get(j).unwrap_or(&missing))).collect();
    let (n, z, k) = (rows.len() as u64, columns as u64, terms as u64);
    let sums: Vec<f64> = cells.iter().flat_map(|r| r.term_sums.iter().copied()).collect();
    let lengths: Vec<u32> = cells.iter().map(|r| r.length).collect();
    let clamped: Vec<u32> = cells.iter().map(|r| r.clamped).collect();
    let endings: Vec<u8> = cells.iter().map(|r| ending_code(&r.ending)).collect();
    vec![
        (format!("{table}_terms.npy"), npy(&[n, z, k], &sums)),
        (format!("{table}_length.npy"), npy(&[n, z], &lengths)),
        (format!("{table}_clamped.npy"), npy(&[n, z], &clamped)),
        (format!("{table}_ending.npy"), npy(&[n, z], &endings)),
    ]
}

fn npy<T: npyz::AutoSerialize + Copy>(shape: &[u64], values: &[T]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(shape)
        .writer(&mut bytes)
        .begin_nd()
        .expect("writing to memory cannot fail");
    writer.extend(values.iter().copied()).expect("writing to memory cannot fail");
    writer.finish().expect("as many values as the shape says");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_become_folder_names() {
        assert_eq!(folder_name("negative_tail(k=0.75)"), "negative_tail_k_0.75");
        assert_eq!(folder_name("../../etc"), ".._.._etc");
    }
}
