//! What the run was made with, and what went wrong in it.

use maud::{Markup, html};

use super::cells::{At, number_cell, table};
use super::chart::data_uri;
use super::sheet::{Section, Sheet};
use super::summary::policy;
use crate::format::percent;

/// Failures that are listed; the rest is counted.
const LISTED: usize = 100;

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let run = sheet.run;
    let body = html! {
        h3 { "Teachers" }
        (teachers(sheet))
        h3 { "Failures" }
        (failures(sheet))
        h3 { "Versions" }
        (provenance(&run.provenance))
        h3 { "Config" }
        details {
            summary { "The resolved config, with every default" }
            pre.config tabindex="0" { (run.config) }
        }
        p {
            a download="experiment.toml" href=(data_uri("text/plain", &run.config)) { "experiment.toml" }
            " gives the same bytes again: " code { "elo discover experiment.toml --out FOLDER" } "."
        }
    };
    Section { id: "config", title: "Config, versions, failures", body }
}

fn teachers(sheet: &Sheet<'_>) -> Markup {
    let report = &sheet.run.report;
    table(
        "Teachers and their tasks",
        &["teacher", "task", "return at the end of training", "trainings given up"],
        &html! {
            @for (index, teacher) in report.teachers.iter().enumerate() {
                tr {
                    th scope="row" { (index) }
                    td.text {
                        @for (name, value) in teacher.task.parameters() { (name) " " (format!("{value:.3}")) " " }
                    }
                    @match teacher.training_return {
                        Some(value) => (number_cell(value, 1, &At::report().then("teachers").then(index).then("training_return"))),
                        None => td { "unknown" },
                    }
                    td { (teacher.diverged.len()) }
                }
            }
        },
    )
}

fn failures(sheet: &Sheet<'_>) -> Markup {
    let (rule, failures) = (&sheet.run.plan.failures, &sheet.run.failures);
    let takes = failures.iter().filter(|failure| failure.is_of_a_recording()).count();
    html! {
        p {
            "Rollouts that fail " (policy(rule.policy)) "; the run stops when more than "
            (percent(rule.max_share, 0)) " % of the selecting rollouts fail. "
            @if failures.is_empty() { "None failed." } @else { (failures.len() - takes) " failed." }
            @if takes > 0 { " Recordings that failed and were taken again: " (takes) "." }
        }
        @if !failures.is_empty() {
            (table("Failed rollouts", &["rollouts", "row", "context or take", "why"], &html! {
                @for failure in failures.iter().take(LISTED) {
                    tr {
                        th scope="row" { (failure.table) }
                        td { (failure.row) }
                        td { (failure.context) }
                        td.text { (failure.reason) }
                    }
                }
            }))
            @if failures.len() > LISTED {
                p.note { "The first " (LISTED) " are listed; all of them are in " code { "results/failures.csv" } "." }
            }
        }
    }
}

fn provenance(value: &serde_json::Value) -> Markup {
    let mut pairs = Vec::new();
    flatten("", value, &mut pairs);
    html! { dl.legend { @for (name, text) in &pairs { dt { (name) } dd { code { (text) } } } } }
}

fn flatten(name: &str, value: &serde_json::Value, pairs: &mut Vec<(String, String)>) {
    match value {
        serde_json::Value::Object(fields) => {
            for (field, value) in fields {
                let field = field.replace('_', " ");
                flatten(format!("{name} {field}").trim(), value, pairs);
            }
        }
        serde_json::Value::String(text) => pairs.push((name.to_owned(), text.clone())),
        other => pairs.push((name.to_owned(), other.to_string())),
    }
}
