//! How all candidates score by each metric (Figure 5.6).

use elo_core::report::SetReport;
use kuva::prelude::{Histogram, Plot};
use maud::{Markup, html};

use super::cells::{At, number};
use super::chart::{Chart, Rug, colour, csv, layout, nice_step, nth_colour, padded};
use super::sheet::{Section, Sheet};

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let run = sheet.run;
    let plots: Vec<Markup> =
        run.report.sets.iter().enumerate().map(|(index, set)| plot(sheet, set, index)).collect();
    let body = html! {
        p {
            "Scores of all candidates on the selecting contexts (Figure 5.6). Strokes below the axis are the chosen ones."
        }
        div.grid { @for plot in &plots { (plot) } }
        @if let Some(found) = &run.experiments {
            ul {
                @for (index, spread) in found.spreads.iter().enumerate() {
                    li {
                        (spread.metric) ": a share of "
                        (number(spread.near_best, 3, &At::experiments().then("spreads").then(index).then("near_best")))
                        " of the candidates scores within 10 % of the best."
                    }
                }
            }
        }
    };
    Section { id: "scores", title: "Candidates' scores", body }
}

fn plot(sheet: &mut Sheet<'_>, set: &SetReport, index: usize) -> Markup {
    let scored: Vec<(usize, f64)> = sheet
        .run
        .candidates
        .iter()
        .filter_map(|candidate| Some((candidate.number, (*candidate.scores.get(index)?)?)))
        .collect();
    let chosen: Vec<f64> = set.options.iter().map(|option| option.selection_score).collect();
    let is_chosen = |number: usize| set.options.iter().any(|option| option.number == number);
    let values = || scored.iter().map(|(_, score)| *score);
    let (low, high) = padded(values(), 0.02);
    let bin = nice_step(high - low, 24.0);
    let range = ((low / bin).floor() * bin, (high / bin).ceil() * bin);
    let bins = (((range.1 - range.0) / bin).round() as usize).max(1);
    let bars =
        Histogram::new().with_data(values()).with_range(range).with_bins(bins).with_color(nth_colour(index));
    let tallest = bars.compute_bins().map_or(1.0, |bins| bins.max_y).max(1.0);
    let title = format!("Scores by {}", set.metric);
    let chart = Chart {
        id: sheet.plot_id(&format!("scores-{}", index + 1)),
        description: format!(
            "{title}: a histogram of {} candidates, with the chosen ones marked.",
            scored.len()
        ),
        title,
        layout: layout((420.0, 300.0), range, (-0.06 * tallest, 1.06 * tallest))
            .with_x_tick_step(nice_step(range.1 - range.0, 5.0))
            .with_y_tick_step(nice_step(tallest, 5.0).max(1.0))
            .with_x_label("score")
            .with_y_label("candidates"),
        plots: vec![Plot::Histogram(bars)],
        rugs: vec![Rug { values: chosen, at: 0.0, length: 9.0, colour: colour("ink") }],
        csv: csv(
            &["candidate", "score", "chosen"],
            scored.iter().map(|(n, score)| vec![n.to_string(), score.to_string(), is_chosen(*n).to_string()]),
        ),
    };
    sheet.draw(chart)
}
