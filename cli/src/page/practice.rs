//! What the infant agent earned while sets of options were learned as a whole.

use kuva::prelude::{LinePlot, Plot};
use maud::Markup;

use super::chart::{Chart, csv, layout, nice_step, nth_colour, padded, steps_format};
use super::data::PracticeRow;
use super::sheet::Sheet;

/// One line a set; `None` where none was learned by practice.
pub fn plot(sheet: &mut Sheet<'_>) -> Option<Markup> {
    let rows = &sheet.run.practice;
    let last = rows.iter().map(|row| row.steps).reduce(f64::max)?;
    let up = padded(rows.iter().filter_map(|row| row.mean_return), 0.06);
    let axes = layout((860.0, 420.0), (0.0, last * 1.02), up)
        .with_x_tick_step(nice_step(last, 6.0))
        .with_y_tick_step(nice_step(up.1 - up.0, 6.0))
        .with_x_tick_format(steps_format())
        .with_x_label("steps of practice")
        .with_y_label("mean return in practice");
    let mut sets: Vec<usize> = rows.iter().map(|row| row.candidate).collect();
    sets.dedup();
    let line = |(place, set): (usize, &usize)| -> Plot {
        let of_set = rows.iter().filter(|row| row.candidate == *set);
        let points: Vec<(f64, f64)> = of_set.filter_map(|row| Some((row.steps, row.mean_return?))).collect();
        let line = LinePlot::new().with_data(points).with_color(nth_colour(place));
        line.with_stroke_width(2.0).with_legend(format!("set {set}")).into()
    };
    let chart = Chart {
        id: sheet.plot_id("practice"),
        title: "Practice of each set".to_owned(),
        description: format!("What the infant agent earned on the way of {} sets, a line each.", sets.len()),
        layout: axes,
        plots: sets.iter().enumerate().map(line).collect(),
        rugs: Vec::new(),
        csv: csv(&["candidate", "steps", "mean_return", "mean_length"], rows.iter().map(cells)),
    };
    Some(sheet.draw(chart))
}

fn cells(row: &PracticeRow) -> Vec<String> {
    let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    vec![row.candidate.to_string(), row.steps.to_string(), number(row.mean_return), number(row.mean_length)]
}
