//! The same options on several engines.

use elo_core::crosscheck::{Crosscheck, Pair};
use elo_core::statistics::bootstrap::Interval;
use kuva::prelude::{LinePlot, Plot, ScatterPlot};
use maud::{Markup, html};

use super::cells::{At, cell, number, number_cell, table};
use super::chart::{Chart, colour, csv, layout, nice_step, padded};
use super::sheet::{Part, Section, Sheet};
use super::tails::numbers;
use crate::format::{self, RETURN_DIGITS, SHARE_DIGITS, percent};

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let body = match &sheet.run.crosscheck {
        None => sheet.absent("The options on other engines were", Part::Crosscheck),
        Some(found) => whole(sheet, found),
    };
    Section { id: "engines", title: "Other engines", body }
}

fn whole(sheet: &mut Sheet<'_>, found: &Crosscheck) -> Markup {
    let at = At::crosscheck();
    let plots: Vec<Markup> = found.pairs.iter().map(|pair| scatter(sheet, found, pair)).collect();
    html! {
        p {
            "All " (found.candidates.len()) " candidates in " (found.contexts) " contexts that the engines share. τ-b and ρ "
            "compare the order of the candidates' mean returns; 1 is the same order. Trajectories part where observations "
            "differ by more than " (elo_core::crosscheck::PARTED) "."
        }
        (table("Engines", &["engine", "mean return of all", "best candidates", "failed", "starts"], &html! {
            @for (engine, name) in found.engines.iter().zip(found.names()) {
                tr {
                    th scope="row" { (name) small.note { (engine.engine.version) } }
                    td { (format::number(engine.scores.iter().sum::<f64>() / engine.scores.len().max(1) as f64, RETURN_DIGITS)) }
                    td.text { (numbers(&engine.best)) }
                    td {
                        (percent(engine.failures, 1)) " %"
                        @if let Some(why) = &engine.first_failure { small.note { "the first: " (why) } }
                        @if let Some(why) = &engine.unseen { small.note { "no trajectories: " (why) } }
                    }
                    td.text { (if engine.same_starts { "the same states" } else { "its own, from the same seeds" }) }
                }
            }
        }))
        (table("Each two engines", &["engines", "Kendall's τ-b", "Spearman's ρ", "of the best, in both", "earn more", "earn less", "part after"], &html! {
            @for (index, pair) in found.pairs.iter().enumerate() { (pair_row(found, pair, &at.then("pairs").then(index))) }
        }))
        p.note {
            "Candidates earn more or less on the second engine than on the first by a sign test at 5 %, after Bonferroni. "
            "Steps after which trajectories part are medians of those that do, with quartiles."
        }
        div.grid { @for plot in &plots { (plot) } }
        h3 { "Best by the worst engine" }
        (table("The set whose worst score over the engines is best", &["candidate", "worst mean return"], &html! {
            @for (index, (candidate, score)) in found.robust.iter().zip(&found.robust_scores).enumerate() {
                tr {
                    th scope="row" { (candidate) }
                    (number_cell(*score, RETURN_DIGITS, &at.then("robust_scores").then(index)))
                }
            }
        }))
    }
}

fn names(found: &Crosscheck, pair: &Pair) -> [String; 2] {
    let names = found.names();
    [pair.first, pair.second].map(|index| names[index].clone())
}

fn pair_row(found: &Crosscheck, pair: &Pair, at: &At) -> Markup {
    let [first, second] = names(found, pair);
    let level = 0.05 / found.candidates.len().max(1) as f64;
    let differ = || pair.differences.iter().filter(|difference| difference.sign_test < level);
    let correlation = |value: &Option<Interval>, field: &str| match value {
        Some(value) => cell(value, SHARE_DIGITS, &at.then(field)),
        None => html! { td { "not defined" } },
    };
    let parted = at.then("parted_after");
    html! {
        tr {
            th scope="row" { (first) " and " (second) }
            (correlation(&pair.kendall, "kendall"))
            (correlation(&pair.spearman, "spearman"))
            (number_cell(pair.shared_best as f64, 0, &at.then("shared_best")))
            td { (differ().filter(|difference| difference.mean > 0.0).count()) }
            td { (differ().filter(|difference| difference.mean <= 0.0).count()) }
            @match (pair.parted, pair.parted_after) {
                (None, _) => { td { "not compared" } }
                (_, None) => { td { "never" } }
                (_, Some([early, middle, late])) => {
                    td {
                        (number(middle, 0, &parted.then(1))) " [" (number(early, 0, &parted.then(0))) ", "
                        (number(late, 0, &parted.then(2))) "]"
                    }
                }
            }
        }
    }
}

fn scatter(sheet: &mut Sheet<'_>, found: &Crosscheck, pair: &Pair) -> Markup {
    let [first, second] = names(found, pair);
    let (x, y) = (&found.engines[pair.first].scores, &found.engines[pair.second].scores);
    let (across, up) = (padded(x.iter().copied(), 0.06), padded(y.iter().copied(), 0.06));
    let chosen: Vec<usize> =
        sheet.run.report.sets.iter().flat_map(|set| set.options.iter().map(|option| option.number)).collect();
    let points = |wanted: bool| -> Vec<(f64, f64)> {
        let all = found.candidates.iter().zip(x.iter().zip(y));
        all.filter(|(number, _)| chosen.contains(number) == wanted).map(|(_, (x, y))| (*x, *y)).collect()
    };
    let same = [across.0.max(up.0), across.1.min(up.1)].map(|value| (value, value));
    let dots = |points: Vec<(f64, f64)>| ScatterPlot::new().with_data(points);
    let mut plots: Vec<Plot> = Vec::new();
    if same[0].0 < same[1].0 {
        plots.push(
            LinePlot::new()
                .with_data(same)
                .with_color(colour("soft"))
                .with_dashed()
                .with_legend("the same return")
                .into(),
        );
    }
    plots.push(
        dots(points(false))
            .with_color(colour("c7"))
            .with_size(3.5)
            .with_marker_opacity(0.7)
            .with_legend("candidate")
            .into(),
    );
    plots.push(dots(points(true)).with_color(colour("c2")).with_size(4.5).with_legend("chosen").into());
    let rows = found.candidates.iter().zip(x.iter().zip(y)).zip(&pair.differences);
    let title = format!("{first} and {second}");
    let chart = Chart {
        id: sheet.plot_id(&format!("engines-{}-{}", pair.first + 1, pair.second + 1)),
        description: format!("Mean return of each of {} candidates on {first} and on {second}.", x.len()),
        title,
        layout: layout((420.0, 400.0), across, up)
            .with_x_tick_step(nice_step(across.1 - across.0, 5.0))
            .with_y_tick_step(nice_step(up.1 - up.0, 5.0))
            .with_x_label(format!("mean return on {first}"))
            .with_y_label(format!("mean return on {second}")),
        plots,
        rugs: Vec::new(),
        csv: csv(
            &["candidate", "first", "second", "difference", "sign_test"],
            rows.map(|((number, (x, y)), difference)| {
                let figures = [*x, *y, difference.mean, difference.sign_test];
                std::iter::once(number.to_string()).chain(figures.iter().map(ToString::to_string)).collect()
            }),
        ),
    };
    sheet.draw(chart)
}
