//! The run in words, and everybody's return at a glance.

use elo_core::experiment::TeacherActs;
use elo_core::experiments::curve::{Crossing, Equivalent};
use elo_core::figures::{Comparison, Row};
use elo_core::report::SetReport;
use elo_core::returns::FailurePolicy;
use kuva::prelude::{LinePlot, Plot, ReferenceLine, ScatterPlot};
use maud::{Markup, html};

use super::cells::{At, figure, number, share};
use super::chart::{Chart, colour, csv, layout, nice_step, nth_colour, padded};
use super::sheet::{Part, Section, Sheet};
use crate::format::{RETURN_DIGITS, percent};

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let run = sheet.run;
    let report = &run.report;
    let at = At::report();
    let plot = glance(sheet);
    let body = html! {
        p.lead {
            "A " (report.robot) " in " (report.engine.name) " " (report.engine.version) ", seed " (report.seed) ": "
            (report.teachers.len()) " teachers and " (report.candidates.usable)
            @if report.candidates.teacher_return.is_some() { " candidate options. " } @else { " candidate sets learned by practice. " }
            "The infant agent picks one option of a set at random, by interest where options have one, and runs it to its end. Unless said otherwise, what follows is "
            "from " (report.starts.contexts) " held-out contexts, which chose nothing. Brackets hold "
            (percent(run.plan.report.confidence, 0)) " % intervals over contexts."
        }
        (plot)
        div.cards {
            @for (index, set) in report.sets.iter().enumerate() { (set_in_words(sheet, set, &at.then("sets").then(index))) }
        }
        @if run.experiments.is_none() {
            (sheet.absent("How many steps of training the options are worth, and a bound of the falls, were", Part::Experiments))
        }
        (warnings(sheet))
    };
    Section { id: "summary", title: "Summary", body }
}

fn set_in_words(sheet: &Sheet<'_>, set: &SetReport, at: &At) -> Markup {
    let against = at.then("against");
    let indexed = || set.against.iter().enumerate();
    let above: Vec<_> = indexed().filter(|(_, c)| c.difference.low > 0.0).collect();
    let below: Vec<_> = indexed().filter(|(_, c)| c.difference.high < 0.0).collect();
    let between: Vec<_> =
        indexed().filter(|(_, c)| c.difference.low <= 0.0 && c.difference.high >= 0.0).collect();
    html! {
        div.card {
            h3 { (set.metric) }
            p {
                @if set.learned_as_a_whole().is_some() { "The set" } @else { "The set of " (set.options.len()) " options" }
                " that " code { (set.metric) } " chose earns "
                (figure(&set.row.mean_return, RETURN_DIGITS, &at.then("row").then("mean_return"))) " a rollout."
            }
            ul {
                (comparisons("More than", &above, &against))
                (comparisons("Less than", &below, &against))
                (comparisons("Not told apart from", &between, &against))
                @for (index, equivalent) in equivalents(sheet, &set.metric) {
                    (worth(sheet, equivalent, &At::experiments().then("equivalents").then(index)))
                }
                (falls(sheet, set, at))
            }
        }
    }
}

fn comparisons(verb: &str, found: &[(usize, &Comparison)], at: &At) -> Markup {
    html! {
        @if !found.is_empty() {
            li {
                strong { (verb) } " "
                @for (place, (index, comparison)) in found.iter().enumerate() {
                    @if place > 0 { ", " }
                    (comparison.baseline) " (difference "
                    (figure(&comparison.difference, RETURN_DIGITS, &at.then(index).then("difference"))) ")"
                }
                "."
            }
        }
    }
}

fn equivalents<'a>(sheet: &Sheet<'a>, agent: &str) -> Vec<(usize, &'a Equivalent)> {
    let all = sheet.run.experiments.iter().flat_map(|e| e.equivalents.iter().enumerate());
    all.filter(|(_, equivalent)| equivalent.agent == agent).collect()
}

fn worth(sheet: &Sheet<'_>, equivalent: &Equivalent, at: &At) -> Markup {
    let teacher = sheet.run.teacher_name();
    let acts = match equivalent.acts {
        TeacherActs::Sample => "acting by samples",
        TeacherActs::Mean => "acting by its mean",
    };
    html! {
        li {
            @match equivalent.steps {
                Crossing::At(steps) => {
                    strong { "Worth" } " " (number(steps, 0, &at.then("steps").then("at"))) " steps of training: "
                    (teacher) ", " (acts) ", needs as many to earn as much (the interval's ends: "
                    (crossing(equivalent.low)) " and " (crossing(equivalent.high)) ")."
                }
                Crossing::BelowCurve => {
                    strong { "Worth" } " no training: untrained, " (acts) ", " (teacher) " earns as much."
                }
                Crossing::AboveCurve => {
                    strong { "Worth" } " more than the whole training: " (teacher) ", " (acts) ", never earns as much."
                }
            }
        }
    }
}

/// A place on a learning curve, in words.
pub fn crossing(place: Crossing) -> String {
    match place {
        Crossing::At(steps) => format!("{steps:.0}"),
        Crossing::BelowCurve => "below the whole curve".to_owned(),
        Crossing::AboveCurve => "above the whole curve".to_owned(),
    }
}

fn falls(sheet: &Sheet<'_>, set: &SetReport, at: &At) -> Markup {
    let agents = sheet.run.experiments.iter().flat_map(|e| e.agents.iter().enumerate());
    let bound =
        agents.filter(|(_, agent)| agent.row.name == set.metric).map(|(i, agent)| (i, agent.falls)).next();
    html! {
        li {
            strong { "Falls" } " in " (share(&set.row.falls, &at.then("row").then("falls"))) " of its rollouts"
            @if let Some((index, bound)) = bound {
                " (" (bound.count) " of " (bound.rollouts) " with one rollout a context; the upper bound of Clopper and "
                "Pearson is " (number(bound.upper, 3, &At::experiments().then("agents").then(index).then("falls").then("upper"))) ")"
            }
            "."
        }
    }
}

fn warnings(sheet: &Sheet<'_>) -> Markup {
    let (report, failures) = (&sheet.run.report, &sheet.run.failures);
    let takes = failures.iter().filter(|failure| failure.is_of_a_recording()).count();
    let rollouts = failures.len() - takes;
    let (given_up, diverged) = (
        report.candidates.given_up.len(),
        report.teachers.iter().map(|teacher| teacher.diverged.len()).sum::<usize>(),
    );
    html! {
        h3 { "Warnings" }
        @if report.warnings.is_empty() && failures.is_empty() && given_up == 0 && diverged == 0 {
            p { "There were none." }
        } @else {
            ul.warnings {
                @for warning in &report.warnings { li { (warning) } }
                @if takes > 0 { li { "Recordings that failed and were taken again: " (takes) "; see the last section." } }
                @if rollouts > 0 { li { "Rollouts that failed: " (rollouts) ". Such rollouts " (policy(sheet.run.plan.failures.policy)) "; see the last section." } }
                @if given_up > 0 { li { "Candidates that were given up, because every recording fell or failed or every training diverged: " (given_up) "." } }
                @if diverged > 0 { li { "Trainings that diverged and were given up: " (diverged) "." } }
            }
        }
    }
}

/// What a failed rollout counts as, after "such rollouts".
pub fn policy(policy: FailurePolicy) -> &'static str {
    match policy {
        FailurePolicy::WorstPossible => "count as the worst possible return",
        FailurePolicy::ExcludeOption => "exclude their options from being chosen",
        FailurePolicy::Abort => "stop the run",
    }
}

/// Everybody's mean return with its interval.
fn glance(sheet: &mut Sheet<'_>) -> Markup {
    let report = &sheet.run.report;
    let sets = report.sets.iter().enumerate().map(|(i, set)| (set.metric.as_str(), &set.row, nth_colour(i)));
    let baselines = report.baselines.iter().map(|row| (row.name.as_str(), row, colour("soft")));
    let rows: Vec<(&str, &Row, String)> = sets.chain(baselines).collect();
    let ends = rows.iter().flat_map(|(_, row, _)| [row.mean_return.low, row.mean_return.high, 0.0]);
    let (low, high) = padded(ends, 0.04);
    let count = rows.len();
    let mut plots: Vec<Plot> = Vec::new();
    for (index, (_, row, colour)) in rows.iter().enumerate() {
        let (y, mean) = ((count - index) as f64, row.mean_return);
        let line = LinePlot::new().with_data([(mean.low, y), (mean.high, y)]);
        plots.push(line.with_color(colour).with_stroke_width(3.0).into());
        plots.push(
            ScatterPlot::new().with_data([(mean.estimate, y)]).with_color(colour).with_size(6.0).into(),
        );
    }
    let names: Vec<String> = rows.iter().rev().map(|(name, ..)| (*name).to_owned()).collect();
    let title = "Mean return and its interval";
    let chart = Chart {
        id: sheet.plot_id("mean-return"),
        title: title.to_owned(),
        description: format!(
            "{title} of {}.",
            rows.iter().map(|(name, ..)| *name).collect::<Vec<_>>().join(", ")
        ),
        layout: layout((860.0, 70.0 + 32.0 * count as f64), (low, high), (0.4, count as f64 + 0.6))
            .with_y_categories(names)
            .with_x_tick_step(nice_step(high - low, 7.0))
            .with_reference_line(ReferenceLine::vertical(0.0).with_color(colour("soft")))
            .with_x_label("mean return in the held-out contexts"),
        plots,
        rugs: Vec::new(),
        csv: csv(
            &["who", "mean_return", "low", "high"],
            rows.iter().map(|(name, row, _)| {
                let mean = row.mean_return;
                vec![
                    (*name).to_owned(),
                    mean.estimate.to_string(),
                    mean.low.to_string(),
                    mean.high.to_string(),
                ]
            }),
        ),
    };
    sheet.draw(chart)
}
