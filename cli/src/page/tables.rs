//! Every figure of the report as a table, then Tables 5.1 and 5.2 and the sweep over `k`.

use elo_core::report::SetReport;
use maud::{Markup, html};

use super::cells::{At, cell, figure, number, row, row_headings, table};
use super::sheet::{Part, Section, Sheet};
use super::tails;
use crate::format::{RETURN_DIGITS, SCORE_DIGITS, percent};

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let report = &sheet.run.report;
    let at = At::report();
    let experiments = match &sheet.run.experiments {
        Some(found) => tails::tables(sheet, found),
        None => sheet.absent("Tables 5.1 and 5.2 and the sweep over k were", Part::Experiments),
    };
    let body = html! {
        (legend(sheet))
        @for (index, set) in report.sets.iter().enumerate() { (set_tables(set, &at.then("sets").then(index))) }
        h3 { "In the same contexts" }
        (table("Baselines", &row_headings("baseline"), &html! {
            @for (index, baseline) in report.baselines.iter().enumerate() {
                (row(&html! { (baseline.name) }, baseline, &at.then("baselines").then(index)))
            }
        }))
        (experiments)
    };
    Section { id: "tables", title: "Tables", body }
}

fn legend(sheet: &Sheet<'_>) -> Markup {
    let (report, plan, at) = (&sheet.run.report, &sheet.run.plan.report, At::report());
    html! {
        dl.legend {
            dt { "return" } dd { "what the tasks pay" }
            dt { "mean, IQM, score" }
            dd {
                "of returns normalised as (return " (format!("{:+.2}", -report.scale.offset)) ") / "
                (number(report.scale.scale, 2, &at.then("scale").then("scale"))) "; IQM is the mean of the middle half"
            }
            dt { "lower tail" }
            dd { "share of normalised returns below μ* − " (plan.alpha) " σ*" }
            dt { "upper tail" }
            dd {
                "share above μ*; μ* = " (number(report.reference.mean, 3, &at.then("reference").then("mean"))) ", σ* = "
                (number(report.reference.standard_deviation, 3, &at.then("reference").then("standard_deviation")))
            }
            dt { "falls, steps" } dd { "share of rollouts that end with a fall, and their mean length in control steps" }
            dt { "[low, high]" } dd { (percent(plan.confidence, 0)) " % bootstrap interval over contexts" }
            dt { "starts" }
            dd {
                "contexts begin after " (number(report.starts.mean_random_steps, 1, &at.then("starts").then("mean_random_steps")))
                " random steps on average; " (number(report.starts.mean_redraws, 1, &at.then("starts").then("mean_redraws")))
                " draws fell before a start was found"
            }
        }
    }
}

fn set_tables(set: &SetReport, at: &At) -> Markup {
    html! {
        h3 { (set.metric) }
        p {
            "Score " (figure(&set.score, SCORE_DIGITS, &at.then("score"))) "; on the selecting contexts "
            (number(set.selection_score, SCORE_DIGITS, &at.then("selection_score")))
            ", which is biased upwards, because they chose the set."
        }
        (table(&format!("The set of {} and its options", set.metric), &row_headings("who"), &html! {
            @let whole = set.learned_as_a_whole().map(|whole| whole.row.name.as_str());
            (row(&html! { strong { "the set" } " " small { (whole.unwrap_or_default()) } }, &set.row, &at.then("row")))
            @for (index, option) in set.options.iter().enumerate() {
                @if let Some(teacher) = option.teacher {
                    @let name = html! { (option.row.name) " " small { "teacher " (teacher) } };
                    (row(&name, &option.row, &at.then("options").then(index).then("row")))
                }
            }
        }))
        (table(&format!("{} less each baseline, in the same contexts", set.metric), &["baseline", "difference of returns"], &html! {
            @for (index, comparison) in set.against.iter().enumerate() {
                tr {
                    th scope="row" { "set minus " (comparison.baseline) }
                    (cell(&comparison.difference, RETURN_DIGITS, &at.then("against").then(index).then("difference")))
                }
            }
        }))
    }
}
