//! Each chosen option by itself.

use elo_core::parts::OptionPart;
use elo_core::report::{OptionReport, SetReport};
use maud::{Markup, html};

use super::cells::{At, figure, number, number_cell, share, table};
use super::chart::padded;
use super::distributions::small;
use super::sheet::{Part, Section, Sheet};
use crate::format::{RETURN_DIGITS, SCORE_DIGITS, SHARE_DIGITS};

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let run = sheet.run;
    let at = At::report().then("sets");
    let sets: Vec<Markup> =
        run.report.sets.iter().enumerate().map(|(index, set)| of_set(sheet, set, &at.then(index))).collect();
    let body = html! {
        p { "Each set's options in the order of their scores when they were chosen; the other figures are from the held-out contexts." }
        @if run.experiments.is_none() { (sheet.absent("Plots of each option's returns are left out; they were", Part::Experiments)) }
        @for (set, markup) in run.report.sets.iter().zip(&sets) {
            h3 { (set.metric) }
            div.gallery { (markup) }
        }
    };
    Section { id: "options", title: "Options", body }
}

fn of_set(sheet: &mut Sheet<'_>, set: &SetReport, at: &At) -> Markup {
    let returns: Vec<Option<Vec<f64>>> =
        (0..set.options.len()).map(|position| sheet.run.option_returns(&set.metric, position)).collect();
    let across = padded(returns.iter().flatten().flatten().copied(), 0.08);
    let place = sheet.run.report.sets.iter().position(|other| other.metric == set.metric).unwrap_or(0);
    let cards: Vec<Markup> = set
        .options
        .iter()
        .zip(&returns)
        .enumerate()
        .map(|(position, (option, returns))| {
            let id = sheet.plot_id(&format!("set-{}-option-{}", place + 1, option.number));
            let plot = returns.as_ref().and_then(|returns| small(id, &option.row.name, returns, across));
            let plot = plot.map(|chart| sheet.draw(chart));
            card(sheet, option, plot.as_ref(), &at.then("options").then(position))
        })
        .collect();
    html! {
        @for card in &cards { (card) }
        @if !set.parts.is_empty() { (parts(&set.parts, &at.then("parts"))) }
    }
}

/// What the options of a set that was learned as a whole do in it.
fn parts(parts: &[OptionPart], at: &At) -> Markup {
    table(
        "Its options",
        &["option", "share of draws", "steps it lasts"],
        &html! {
            @for (option, part) in parts.iter().enumerate() {
                tr {
                    th scope="row" { (option) }
                    (number_cell(part.share, SHARE_DIGITS, &at.then(option).then("share")))
                    (number_cell(part.steps, 1, &at.then(option).then("steps")))
                }
            }
        },
    )
}

fn card(sheet: &Sheet<'_>, option: &OptionReport, plot: Option<&Markup>, at: &At) -> Markup {
    let row = at.then("row");
    html! {
        div.card {
            h4 { (option.row.name) }
            dl {
                @if let Some(teacher) = option.teacher { dt { "teacher" } dd { (teacher) } }
                dt { "return" } dd { (figure(&option.row.mean_return, RETURN_DIGITS, &row.then("mean_return"))) }
                dt { "mean" } dd { (figure(&option.row.mean, SCORE_DIGITS, &row.then("mean"))) }
                dt { "falls" } dd { (share(&option.row.falls, &row.then("falls"))) }
                dt { "steps" } dd { (number(option.row.mean_length, 0, &row.then("mean_length"))) }
                dt { "score" } dd { (number(option.selection_score, SCORE_DIGITS, &at.then("selection_score"))) " when chosen" }
            }
            @if let Some(plot) = plot { (plot) }
            @if has_film(sheet, &option.row.name) {
                button.play type="button" data-play=(option.row.name) data-replay=(sheet.section_id("replay")) {
                    "Play " (option.row.name)
                }
            }
        }
    }
}

fn has_film(sheet: &Sheet<'_>, who: &str) -> bool {
    sheet.run.replays.iter().flat_map(|replay| &replay.films).any(|film| film.who == who)
}
