//! Tables 5.1 and 5.2, and the sweep over `k`.

use elo_core::experiments::Experiments;
use elo_core::experiments::tails::{SweepPoint, TailTable};
use elo_core::figures::Tail;
use elo_core::returns::SetValue;
use kuva::prelude::{BandPlot, LinePlot, Plot, ScatterPlot};
use maud::{Markup, html};

use super::cells::{At, cell, number_cell, table};
use super::chart::{Chart, colour, csv, layout, nice_step, padded};
use super::sheet::Sheet;
use crate::format::{SCORE_DIGITS, SHARE_DIGITS};

/// All of them.
pub fn tables(sheet: &mut Sheet<'_>, found: &Experiments) -> Markup {
    let plots: Vec<Markup> = if found.sweep.is_empty() {
        Vec::new()
    } else {
        [Tail::Lower, Tail::Upper].iter().map(|tail| sweep_plot(sheet, *tail, &found.sweep)).collect()
    };
    html! {
        h3 { "Table 5.1: the lower tail" }
        (tail_table(found, Tail::Lower))
        h3 { "Table 5.2: the upper tail" }
        (tail_table(found, Tail::Upper))
        @if !found.sweep.is_empty() {
            h3 { "What other values of k choose" }
            (sweep_table(&found.sweep))
            div.grid { @for plot in &plots { (plot) } }
        }
    }
}

fn tail_table(found: &Experiments, tail: Tail) -> Markup {
    let headings = [
        "metric",
        "value of a set",
        "threshold",
        "mean of the baseline",
        "its tail",
        "smooth",
        "mean of the set",
        "its tail",
        "smooth",
        "improvement",
    ];
    let lines: Vec<(usize, &TailTable)> =
        found.tails.iter().enumerate().filter(|(_, t)| t.tail == tail).collect();
    let caption = match tail {
        Tail::Lower => "Returns below μ* − α σ*; less is better",
        Tail::Upper => "Returns above μ*; more is better",
    };
    if lines.is_empty() {
        return html! { p { "No metric of this run looks at this tail." } };
    }
    table(
        caption,
        &headings,
        &html! {
            @for (index, line) in &lines {
                @let at = At::experiments().then("tails").then(index);
                tr {
                    th scope="row" { (line.metric) small.note { "against maximum_mean" } }
                    td { (reading(line.set_value)) }
                    (number_cell(line.threshold, SCORE_DIGITS, &at.then("threshold")))
                    @for (name, set) in [("baseline", &line.baseline), ("set", &line.set)] {
                        (cell(&set.mean, SCORE_DIGITS, &at.then(name).then("mean")))
                        (cell(&set.area, SHARE_DIGITS, &at.then(name).then("area")))
                        (number_cell(set.smooth, SHARE_DIGITS, &at.then(name).then("smooth")))
                    }
                    @match &line.improvement {
                        Some(improvement) => { (cell(improvement, SHARE_DIGITS, &at.then("improvement"))) }
                        None => { td { "not defined: the baseline has no such tail" } }
                    }
                }
            }
        },
    )
}

fn reading(value: SetValue) -> &'static str {
    match value {
        SetValue::Mixture => "mixture",
        SetValue::Average => "average",
    }
}

fn sweep_table(sweep: &[SweepPoint]) -> Markup {
    table(
        "Sets that other values of k choose",
        &["metric", "k", "options", "mean", "tail"],
        &html! {
            @for (index, point) in sweep.iter().enumerate() {
                @let at = At::experiments().then("sweep").then(index);
                tr {
                    th scope="row" { (swept(point.tail)) }
                    (number_cell(point.k, SHARE_DIGITS, &at.then("k")))
                    td.text { (numbers(&point.set.options)) }
                    (cell(&point.set.mean, SCORE_DIGITS, &at.then("set").then("mean")))
                    (cell(&point.set.area, SHARE_DIGITS, &at.then("set").then("area")))
                }
            }
        },
    )
}

/// Numbers of options, separated by spaces.
pub fn numbers(options: &[usize]) -> String {
    options.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

/// The metric whose `k` is swept, which looks at this tail.
fn swept(tail: Tail) -> &'static str {
    match tail {
        Tail::Lower => "negative_tail",
        Tail::Upper => "positive_skew",
    }
}

fn sweep_plot(sheet: &mut Sheet<'_>, tail: Tail, sweep: &[SweepPoint]) -> Markup {
    let kind = swept(tail);
    let points: Vec<&SweepPoint> = sweep.iter().filter(|point| point.tail == tail).collect();
    let (x, lows, highs): (Vec<f64>, Vec<f64>, Vec<f64>) =
        points.iter().map(|p| (p.k, p.set.area.low, p.set.area.high)).collect();
    let line: Vec<(f64, f64)> = points.iter().map(|p| (p.k, p.set.area.estimate)).collect();
    let across = padded(x.iter().copied(), 0.04);
    let up = padded(lows.iter().chain(&highs).copied(), 0.08);
    let plots: Vec<Plot> = vec![
        BandPlot::new(x, lows, highs).with_color(colour("c1")).with_opacity(0.2).into(),
        LinePlot::new().with_data(line.clone()).with_color(colour("c1")).with_stroke_width(2.0).into(),
        ScatterPlot::new().with_data(line).with_color(colour("c1")).with_size(4.0).into(),
    ];
    let title = format!("Tail by k: {kind}");
    let chart = Chart {
        id: sheet.plot_id(&format!("sweep-{kind}")),
        description: format!("{title}, with intervals, for {} values of k.", points.len()),
        title,
        layout: layout((420.0, 280.0), across, up)
            .with_x_tick_step(nice_step(across.1 - across.0, 5.0))
            .with_y_tick_step(nice_step(up.1 - up.0, 5.0))
            .with_x_label("k")
            .with_y_label("share of returns in the tail"),
        plots,
        rugs: Vec::new(),
        csv: csv(
            &["k", "mean", "mean_low", "mean_high", "tail", "tail_low", "tail_high", "options"],
            points.iter().map(|p| {
                let figures = [
                    p.k,
                    p.set.mean.estimate,
                    p.set.mean.low,
                    p.set.mean.high,
                    p.set.area.estimate,
                    p.set.area.low,
                    p.set.area.high,
                ];
                figures.iter().map(ToString::to_string).chain([numbers(&p.set.options)]).collect()
            }),
        ),
    };
    sheet.draw(chart)
}
