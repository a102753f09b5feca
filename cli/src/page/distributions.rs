//! How returns are distributed: a smooth curve with every value below it, and the empirical distribution.

use elo_core::experiments::{AgentReturns, Experiments};
use elo_core::statistics::bandwidth::BandwidthRule;
use elo_core::statistics::density::{Bounds, Density};

use kuva::prelude::{BandPlot, LinePlot, Plot, ReferenceLine, TickFormat};
use maud::{Markup, html};

use super::chart::{Chart, Rug, colour, csv, layout, nice_step, nth_colour, padded};
use super::sheet::{Part, Section, Sheet};
use crate::format::{self, RETURN_DIGITS};

/// Places along x at which a curve is drawn.
const POINTS: usize = 240;
/// Steps of an empirical distribution that are drawn at most.
const STEPS: usize = 500;

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let body = match &sheet.run.experiments {
        None => sheet.absent("The distributions of returns were", Part::Experiments),
        Some(found) => {
            let (density, cumulative) = (densities(sheet, found), cumulative(sheet, found));
            html! {
                p {
                    "Every rollout in the held-out contexts. Each curve is scaled to its own peak, and each stroke below it "
                    "is one return. Dashed lines are where the tails begin: "
                    @for (place, name) in thresholds(sheet) { (name) " is a return of " (format::number(place, RETURN_DIGITS)) "; " }
                    "both are from the selecting contexts."
                }
                (density)
                (cumulative)
            }
        }
    };
    Section { id: "distributions", title: "Return distributions", body }
}

/// The colour and, for those that have no options, dashes of the agent at `index`.
fn look(sheet: &Sheet<'_>, agent: &AgentReturns, index: usize) -> (String, bool) {
    match sheet.run.report.sets.iter().position(|set| set.metric == agent.row.name) {
        Some(set) => (nth_colour(set), false),
        None => (nth_colour(index), true),
    }
}

/// Where the tails begin, as returns.
fn thresholds(sheet: &Sheet<'_>) -> [(f64, &'static str); 2] {
    let report = &sheet.run.report;
    let (mean, deviation) = (report.reference.mean, report.reference.standard_deviation);
    let back = |value: f64| value * report.scale.scale + report.scale.offset;
    [(back(mean - sheet.run.plan.report.alpha * deviation), "μ* − α σ*"), (back(mean), "μ*")]
}

fn density_of(returns: &[f64]) -> Option<Density> {
    Density::new(returns, BandwidthRule::Silverman, Bounds::default()).ok()
}

fn densities(sheet: &mut Sheet<'_>, found: &Experiments) -> Markup {
    let curves: Vec<(&AgentReturns, Density)> =
        found.agents.iter().filter_map(|agent| Some((agent, density_of(&agent.returns)?))).collect();
    let count = curves.len();
    let across = padded(found.agents.iter().flat_map(|agent| agent.returns.iter().copied()), 0.06);
    let mut plots: Vec<Plot> = Vec::new();
    let mut rugs = Vec::new();
    for (index, (agent, density)) in curves.iter().enumerate() {
        let (base, (colour, _)) = ((count - index) as f64, look(sheet, agent, index));
        let x: Vec<f64> = density.grid(POINTS);
        let heights: Vec<f64> = x.iter().map(|x| density.pdf(*x)).collect();
        let peak = heights.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let upper: Vec<f64> = heights.iter().map(|height| base + 0.68 * height / peak).collect();
        let line = LinePlot::new().with_data(x.iter().copied().zip(upper.iter().copied()));
        plots.push(
            BandPlot::new(x, vec![base; POINTS], upper).with_color(colour.clone()).with_opacity(0.25).into(),
        );
        plots.push(line.with_color(&colour).with_stroke_width(1.6).into());
        rugs.push(Rug { values: agent.returns.clone(), at: base, length: 7.0, colour });
    }
    let names: Vec<String> = curves.iter().rev().map(|(agent, _)| agent.row.name.clone()).collect();
    let mut axes = layout((860.0, 90.0 + 62.0 * count as f64), across, (0.7, count as f64 + 0.85))
        .with_y_categories(names)
        .with_x_tick_step(nice_step(across.1 - across.0, 7.0))
        .with_x_label("return of one rollout");
    for (place, _) in thresholds(sheet) {
        axes = axes.with_reference_line(ReferenceLine::vertical(place).with_color(colour("soft")));
    }
    let chart = Chart {
        id: sheet.plot_id("returns-density"),
        title: "Densities of returns (Gaussian kernel, Silverman's bandwidth)".to_owned(),
        description: format!("A density curve and all returns of each of {count} agents."),
        layout: axes,
        plots,
        rugs,
        csv: returns_csv(found),
    };
    sheet.draw(chart)
}

fn returns_csv(found: &Experiments) -> String {
    let rows = found.agents.iter().flat_map(|agent| {
        let members = (agent.returns.len() / found.contexts.max(1)).max(1);
        agent.returns.iter().enumerate().map(move |(index, value)| {
            let place = [index / members, index % members];
            let [context, member] = place.map(|number| number.to_string());
            vec![agent.row.name.clone(), context, member, value.to_string()]
        })
    });
    csv(&["who", "context", "member", "return"], rows)
}

fn cumulative(sheet: &mut Sheet<'_>, found: &Experiments) -> Markup {
    let across = padded(found.agents.iter().flat_map(|agent| agent.returns.iter().copied()), 0.02);
    let mut plots: Vec<Plot> = Vec::new();
    let mut rows = Vec::new();
    for (index, agent) in found.agents.iter().enumerate() {
        let (colour, dashed) = look(sheet, agent, index);
        let steps = empirical(&agent.returns);
        rows.extend(steps.iter().map(|(x, y)| vec![agent.row.name.clone(), x.to_string(), y.to_string()]));
        let first = steps.first().map(|(x, _)| (*x, 0.0));
        let line = LinePlot::new().with_data(first.into_iter().chain(steps)).with_step();
        let line = line.with_color(colour).with_stroke_width(1.8).with_legend(&agent.row.name);
        plots.push(if dashed { line.with_dashed() } else { line }.into());
    }
    let chart = Chart {
        id: sheet.plot_id("returns-cumulative"),
        title: "Empirical distributions of returns".to_owned(),
        description: "For each agent the share of rollouts whose return is at most the one on the axis."
            .to_owned(),
        layout: layout((860.0, 440.0), across, (0.0, 1.0))
            .with_x_tick_step(nice_step(across.1 - across.0, 7.0))
            .with_y_tick_step(0.25)
            .with_x_label("return of one rollout")
            .with_y_label("share of rollouts"),
        plots,
        rugs: Vec::new(),
        csv: csv(&["who", "return", "share"], rows),
    };
    sheet.draw(chart)
}

/// The steps of the empirical distribution, thinned evenly where there are very many.
fn empirical(returns: &[f64]) -> Vec<(f64, f64)> {
    let mut sorted = returns.to_vec();
    sorted.sort_by(f64::total_cmp);
    let count = sorted.len();
    let stride = count.div_ceil(STEPS).max(1);
    let kept = (0..count).filter(|index| (index + 1) % stride == 0 || index + 1 == count);
    kept.map(|index| (sorted[index], (index + 1) as f64 / count as f64)).collect()
}

/// A small density plot of one option's returns.
pub fn small(id: String, who: &str, returns: &[f64], across: (f64, f64)) -> Option<Chart> {
    let density = density_of(returns)?;
    let x: Vec<f64> =
        density.grid(POINTS / 2).into_iter().filter(|x| *x >= across.0 && *x <= across.1).collect();
    let heights: Vec<f64> = x.iter().map(|x| density.pdf(*x)).collect();
    let peak = heights.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let line = LinePlot::new().with_data(x.iter().copied().zip(heights.iter().copied()));
    let band = BandPlot::new(x.clone(), vec![0.0; x.len()], heights);
    let rows =
        returns.iter().enumerate().map(|(context, value)| vec![context.to_string(), value.to_string()]);
    Some(Chart {
        id,
        title: format!("Returns of {who}"),
        description: format!("Density and all {} returns of {who} in the held-out contexts.", returns.len()),
        layout: layout((300.0, 150.0), across, (-0.12 * peak, 1.1 * peak))
            .with_x_tick_step(nice_step(across.1 - across.0, 4.0))
            .with_y_tick_step(10.0 * peak)
            .with_y_tick_format(TickFormat::Custom(std::sync::Arc::new(|_| String::new())))
            .with_force_margins(10.0, 14.0)
            .with_force_margins_y(6.0, 26.0)
            .with_show_grid(false),
        plots: vec![
            band.with_color(colour("c1")).with_opacity(0.25).into(),
            line.with_color(colour("c1")).with_stroke_width(1.6).into(),
        ],
        rugs: vec![Rug { values: returns.to_vec(), at: 0.0, length: 8.0, colour: colour("c1") }],
        csv: csv(&["context", "return"], rows),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empirical_distributions_end_at_one_however_long_they_are() {
        assert_eq!(empirical(&[3.0, 1.0]), [(1.0, 0.5), (3.0, 1.0)]);
        let many: Vec<f64> = (0..1501).map(f64::from).collect();
        let steps = empirical(&many);
        assert!(steps.len() <= STEPS + 1);
        assert_eq!(steps.last(), Some(&(1500.0, 1.0)));
        assert!(empirical(&[]).is_empty());
    }
}
