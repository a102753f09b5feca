//! What the experiments leave for people, in `results/` of the run directory.
//!
//! | file | rows |
//! | --- | --- |
//! | `experiments.json` | [`Experiments`] |
//! | `experiments/agents.csv` | one an agent, its figures |
//! | `experiments/returns.csv` | one a return: agent, context, return |
//! | `experiments/curve.csv` | one a policy of the learning curve and way of acting |
//! | `experiments/equivalents.csv` | one an agent with options and way of acting; empty ends lie outside the curve |
//! | `experiments/tails.csv` | Tables 5.1 and 5.2 |
//! | `experiments/sweep.csv` | one a `k` and tail |
//! | `experiments/scores.csv` | Figure 5.6: one a candidate and metric |

use std::fmt::Write as _;

use serde::Serialize;

use super::curve::Crossing;
use super::tails::TailFigures;
use super::{Bound, Experiments};
use crate::csv::quoted;
use crate::figures::Row;
use crate::run_dir::{RunDir, RunDirError};
use crate::statistics::bootstrap::Interval;

/// Writes everything below `results/` of the run directory, the JSON last. The same experiments give the same bytes.
///
/// # Errors
/// What keeps a file from being written.
pub fn write(run_dir: &RunDir, found: &Experiments) -> Result<(), RunDirError> {
    for (name, text) in [
        ("agents", agents(found)),
        ("returns", returns(found)),
        ("curve", curve(found)),
        ("equivalents", equivalents(found)),
        ("tails", tails(found)),
        ("sweep", sweep(found)),
        ("scores", scores(found)),
    ] {
        run_dir.write_file(&format!("results/experiments/{name}.csv"), text.as_bytes())?;
    }
    run_dir.write_json("results/experiments.json", found)
}

/// Column names of an interval.
fn ends(name: &str) -> String {
    format!("{name},{name}_low,{name}_high")
}

fn interval(Interval { estimate, low, high }: &Interval) -> String {
    format!("{estimate},{low},{high}")
}

/// The name of an enum's variant, as JSON has it.
fn word(variant: &impl Serialize) -> String {
    serde_json::to_value(variant).ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
}

fn figure_names() -> String {
    let intervals = ["return", "mean", "iqm", "lower_tail", "upper_tail", "falls"].map(ends).join(",");
    format!("{intervals},failures,length")
}

fn figures(row: &Row) -> String {
    let Row { mean_return, mean, iqm, lower_tail, upper_tail, falls, failures, mean_length, .. } = row;
    let intervals = [mean_return, mean, iqm, lower_tail, upper_tail, falls].map(interval).join(",");
    format!("{intervals},{failures},{mean_length}")
}

fn agents(found: &Experiments) -> String {
    let mut text = format!(
        "agent,{},fell,fell_of,fell_upper,low_returns,low_returns_of,low_returns_upper\n",
        figure_names()
    );
    let bound = |Bound { count, rollouts, upper }: &Bound| format!("{count},{rollouts},{upper}");
    for agent in &found.agents {
        let (name, row) = (quoted(&agent.row.name), figures(&agent.row));
        let _ = writeln!(text, "{name},{row},{},{}", bound(&agent.falls), bound(&agent.low_returns));
    }
    text
}

fn returns(found: &Experiments) -> String {
    let mut text = "agent,context,return\n".to_owned();
    for agent in &found.agents {
        let members = agent.returns.len() / found.contexts.max(1);
        for (index, value) in agent.returns.iter().enumerate() {
            let _ = writeln!(text, "{},{},{value}", quoted(&agent.row.name), index / members.max(1));
        }
    }
    text
}

fn curve(found: &Experiments) -> String {
    let mut text = format!("steps,acts,{}\n", figure_names());
    for point in &found.curve {
        for (acts, row) in [("sample", &point.sampled), ("mean", &point.mean_action)] {
            let _ = writeln!(text, "{},{acts},{}", point.steps, figures(row));
        }
    }
    text
}

fn equivalents(found: &Experiments) -> String {
    let mut text = format!("agent,acts,{},where,steps,steps_low,steps_high\n", ends("return"));
    let number = |crossing: &Crossing| match crossing {
        Crossing::At(steps) => steps.to_string(),
        Crossing::BelowCurve | Crossing::AboveCurve => String::new(),
    };
    for one in &found.equivalents {
        let place = match one.steps {
            Crossing::BelowCurve => "below the curve",
            Crossing::At(_) => "on the curve",
            Crossing::AboveCurve => "above the curve",
        };
        let _ = writeln!(
            text,
            "{},{},{},{place},{},{},{}",
            quoted(&one.agent),
            word(&one.acts),
            interval(&one.level),
            number(&one.steps),
            number(&one.low),
            number(&one.high)
        );
    }
    text
}

fn tail_names(prefix: &str) -> String {
    let (mean, area) = (ends(&format!("{prefix}mean")), ends(&format!("{prefix}area")));
    format!("{prefix}options,{mean},{area},{prefix}smooth_area")
}

fn tail_figures(TailFigures { options, mean, area, smooth }: &TailFigures) -> String {
    let options = options.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
    format!("{options},{},{},{smooth}", interval(mean), interval(area))
}

fn tails(found: &Experiments) -> String {
    let (baseline, set, gain) = (tail_names("baseline_"), tail_names(""), ends("improvement"));
    let mut text = format!("metric,set_value,tail,threshold,{baseline},{set},{gain}\n");
    for table in &found.tails {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{}",
            quoted(&table.metric),
            word(&table.set_value),
            word(&table.tail),
            table.threshold,
            tail_figures(&table.baseline),
            tail_figures(&table.set),
            table.improvement.as_ref().map_or(",,".to_owned(), interval)
        );
    }
    text
}

fn sweep(found: &Experiments) -> String {
    let mut text = format!("tail,k,{}\n", tail_names(""));
    for point in &found.sweep {
        let _ = writeln!(text, "{},{},{}", word(&point.tail), point.k, tail_figures(&point.set));
    }
    text
}

fn scores(found: &Experiments) -> String {
    let mut text = "metric,candidate,score\n".to_owned();
    for spread in &found.spreads {
        for (candidate, score) in spread.candidates.iter().zip(&spread.scores) {
            let _ = writeln!(text, "{},{candidate},{score}", quoted(&spread.metric));
        }
    }
    text
}
