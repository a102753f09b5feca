//! What a teacher earns while it learns, beside what the infant agent earns from the start.

use elo_core::experiment::TeacherActs;
use elo_core::experiments::Experiments;
use elo_core::experiments::curve::{Crossing, CurvePoint, Equivalent};
use elo_core::figures::Row;

use kuva::prelude::{BandPlot, LinePlot, Plot, ReferenceLine};
use maud::{Markup, html};

use super::cells::{At, cell, table};
use super::chart::{Chart, colour, csv, layout, nice_step, nth_colour, padded, steps_format};
use super::practice;
use super::sheet::{Part, Section, Sheet};
use super::summary::crossing;
use crate::format::RETURN_DIGITS;

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let practised = practice::plot(sheet);
    let of_teachers = match &sheet.run.experiments {
        None => sheet.absent("The teachers' learning curve was", Part::Experiments),
        Some(found) if found.curve.is_empty() => html! {
            p.absent { "This run has no teacher, or one that keeps no policies on its way, so there is no learning curve: `teacher.snapshots` sets how many a PPO keeps." }
        },
        Some(found) => whole(sheet, found),
    };
    let body = html! {
        @if let Some(plot) = practised {
            p { "What the infant agent earned while each set was learned, in the tasks and starts of its practice, where it acts as it does afterwards." }
            (plot)
        }
        (of_teachers)
    };
    Section { id: "curves", title: "Learning curves", body }
}

fn whole(sheet: &mut Sheet<'_>, found: &Experiments) -> Markup {
    let teacher = sheet.run.teacher_name();
    let plots = [TeacherActs::Sample, TeacherActs::Mean].map(|acts| plot(sheet, found, acts));
    html! {
        p {
            "Mean return of " (teacher) " in the held-out contexts as it learns, with intervals. Horizontal bands are the "
            "infant agents' levels, which they have from the first step on; dotted lines are where the curve reaches them."
        }
        @for plot in &plots { (plot) }
        (table("Steps of training that are worth as much", &["agent", "acting", "its return", "steps", "for the lower end", "for the upper end"], &html! {
            @for (index, equivalent) in found.equivalents.iter().enumerate() { (line(equivalent, index)) }
        }))
    }
}

fn line(equivalent: &Equivalent, index: usize) -> Markup {
    let at = At::experiments().then("equivalents").then(index);
    html! {
        tr {
            th scope="row" { (equivalent.agent) }
            td.text { (words(equivalent.acts)) }
            (cell(&equivalent.level, RETURN_DIGITS, &at.then("level")))
            @for place in [equivalent.steps, equivalent.low, equivalent.high] { td { (crossing(place)) } }
        }
    }
}

fn words(acts: TeacherActs) -> &'static str {
    match acts {
        TeacherActs::Sample => "by samples",
        TeacherActs::Mean => "by its mean",
    }
}

fn row_of(point: &CurvePoint, acts: TeacherActs) -> &Row {
    match acts {
        TeacherActs::Sample => &point.sampled,
        TeacherActs::Mean => &point.mean_action,
    }
}

fn plot(sheet: &mut Sheet<'_>, found: &Experiments, acts: TeacherActs) -> Markup {
    let points: Vec<(f64, &Row)> = found.curve.iter().map(|p| (p.steps as f64, row_of(p, acts))).collect();
    // Agents of the report's sets alone: more bands than those cannot be told apart.
    let sets = &sheet.run.report.sets;
    let position = |agent: &str| sets.iter().position(|set| set.metric == agent);
    let levels: Vec<(usize, &Equivalent)> = found
        .equivalents
        .iter()
        .filter(|equivalent| equivalent.acts == acts)
        .filter_map(|equivalent| Some((position(&equivalent.agent)?, equivalent)))
        .collect();
    let last = points.last().map_or(1.0, |(steps, _)| steps.max(1.0));
    let ends = points.iter().flat_map(|(_, row)| [row.mean_return.low, row.mean_return.high]);
    let up = padded(ends.chain(levels.iter().flat_map(|(_, e)| [e.level.low, e.level.high])), 0.06);

    let mut plots: Vec<Plot> = Vec::new();
    let mut axes = layout((860.0, 420.0), (0.0, last * 1.02), up)
        .with_x_tick_step(nice_step(last, 6.0))
        .with_y_tick_step(nice_step(up.1 - up.0, 6.0))
        .with_x_tick_format(steps_format())
        .with_x_label("steps of training")
        .with_y_label("mean return");
    for (set, equivalent) in &levels {
        let (colour, level) = (nth_colour(*set), equivalent.level);
        let ends = || vec![0.0, last * 1.02];
        plots.push(
            BandPlot::new(ends(), vec![level.low; 2], vec![level.high; 2])
                .with_color(colour.clone())
                .with_opacity(0.16)
                .into(),
        );
        let middle = LinePlot::new().with_data(ends().into_iter().map(|x| (x, level.estimate)));
        plots.push(
            middle
                .with_color(&colour)
                .with_stroke_width(1.6)
                .with_dashed()
                .with_legend(&equivalent.agent)
                .into(),
        );
        if let Crossing::At(steps) = equivalent.steps {
            axes = axes
                .with_reference_line(ReferenceLine::vertical(steps).with_color(colour).with_dasharray("2 4"));
        }
    }
    let curve = |of: fn(&Row) -> f64| points.iter().map(|(_, row)| of(row)).collect::<Vec<_>>();
    let steps: Vec<f64> = points.iter().map(|(steps, _)| *steps).collect();
    let band = BandPlot::new(steps.clone(), curve(|r| r.mean_return.low), curve(|r| r.mean_return.high));
    plots.push(band.with_color(colour("ink")).with_opacity(0.16).into());
    let line = LinePlot::new().with_data(steps.into_iter().zip(curve(|r| r.mean_return.estimate)));
    let name = format!("{}, acting {}", sheet.run.teacher_name(), words(acts));
    plots.push(line.with_color(colour("ink")).with_stroke_width(2.2).with_legend(&name).into());

    let title = format!("Learning curve of {name}");
    let chart = Chart {
        id: sheet.plot_id(if acts == TeacherActs::Sample { "curve-sampled" } else { "curve-mean-action" }),
        description: format!("{title}, and the levels of {} infant agents.", levels.len()),
        title,
        layout: axes,
        plots,
        rugs: Vec::new(),
        csv: csv(
            &["steps", "mean_return", "low", "high"],
            points.iter().map(|(steps, row)| {
                let mean = row.mean_return;
                [*steps, mean.estimate, mean.low, mean.high].iter().map(ToString::to_string).collect()
            }),
        ),
    };
    sheet.draw(chart)
}
