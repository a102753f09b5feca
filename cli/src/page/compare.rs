//! Several runs side by side.

use maud::{Markup, html};

use super::data::RunData;
use super::tails::numbers;
use crate::format::{RETURN_DIGITS, interval};

/// Baselines that the table shows, if a run has them.
const SHOWN: [&str; 2] = ["random K-subsets", "teachers"];

/// The comparing table, and the switcher.
pub fn section(runs: &[RunData]) -> Markup {
    let mut metrics: Vec<&str> = Vec::new();
    for set in runs.iter().flat_map(|run| &run.report.sets) {
        if !metrics.contains(&set.metric.as_str()) {
            metrics.push(&set.metric);
        }
    }
    html! {
        section #compare {
            h2 { "The runs" }
            div.scroll tabindex="0" role="region" aria-label="The runs side by side" {
                table {
                    caption { "Mean return in each run's own held-out contexts. Runs of other robots, tasks or lengths pay in other units." }
                    thead {
                        tr {
                            th scope="col" { "run" } th scope="col" { "robot" } th scope="col" { "engine" } th scope="col" { "seed" }
                            @for name in metrics.iter().chain(&SHOWN) { th scope="col" { (name) } }
                        }
                    }
                    tbody { @for (index, run) in runs.iter().enumerate() { (row(run, index, &metrics)) } }
                }
            }
            div.switch role="group" aria-label="Which run is shown" hidden {
                @for (index, run) in runs.iter().enumerate() {
                    button type="button" data-show={ "run-" (index + 1) } aria-pressed="false" { (run.name) }
                }
                button type="button" data-show="all" aria-pressed="true" { "All" }
            }
        }
    }
}

fn row(run: &RunData, index: usize, metrics: &[&str]) -> Markup {
    let report = &run.report;
    let set = |metric: &&str| report.sets.iter().find(|set| set.metric == **metric);
    let baseline = |name: &str| report.baselines.iter().find(|row| row.name == name);
    html! {
        tr {
            th scope="row" { a href={ "#run-" (index + 1) } { (run.name) } }
            td.text { (report.robot) }
            td.text { (report.engine.name) " " (report.engine.version) }
            td { (report.seed) }
            @for metric in metrics {
                td {
                    @if let Some(set) = set(metric) {
                        span.figure { (interval(&set.row.mean_return, RETURN_DIGITS)) }
                        br;
                        small { "options " (numbers(&set.options.iter().map(|option| option.number).collect::<Vec<_>>())) }
                    }
                }
            }
            @for name in SHOWN {
                td { @if let Some(row) = baseline(name) { span.figure { (interval(&row.mean_return, RETURN_DIGITS)) } } }
            }
        }
    }
}
