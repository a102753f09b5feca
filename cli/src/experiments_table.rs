//! The paper's figures and tables on a terminal.

use std::fmt::Write as _;

use elo_core::experiment::TeacherActs;
use elo_core::experiments::curve::{Crossing, Equivalent};
use elo_core::experiments::tails::{TailFigures, TailTable};
use elo_core::experiments::{Bound, Experiments};
use elo_core::figures::Tail;
use elo_core::returns::SetValue;

use crate::format::interval;
use crate::paper::Beside;
use crate::table::{heading, line};

/// Width of the column of names.
const NAMES: usize = 42;

/// Everything that the experiments found.
pub fn experiments(found: &Experiments, confidence: f64) -> String {
    let Experiments { robot, engine, seed, contexts, steps, .. } = found;
    let (name, version) = (&engine.name, &engine.version);
    let mut text = format!(
        "\n{robot} in {name} {version}, seed {seed}: {contexts} held-out contexts of {steps} steps, {:.0} % intervals over \
         contexts\n\nFigures 5.2 and 5.3: everybody in the same contexts\n",
        confidence * 100.0
    );
    heading(&mut text, NAMES);
    for agent in &found.agents {
        line(&mut text, NAMES, &agent.row.name, &agent.row);
    }
    let _ = writeln!(
        text,
        "\n{:<NAMES$} {:>16} {:>12} {:>16} {:>12}",
        "of one rollout a context", "fell", "at most", "V < μ* − α σ*", "at most"
    );
    text.push_str("(at most: Clopper and Pearson's upper bound of the probability, one-sided)\n");
    for agent in &found.agents {
        let (falls, low) = (bound(&agent.falls), bound(&agent.low_returns));
        let _ = writeln!(text, "{:<NAMES$} {falls} {low}", agent.row.name);
    }
    equivalents(&mut text, found);
    tails(&mut text, found);
    if !found.sweep.is_empty() {
        text.push_str("\nother values of k select\n");
        for point in &found.sweep {
            let metric = match point.tail {
                Tail::Lower => "ψ-",
                Tail::Upper => "ψ+",
            };
            let _ = writeln!(text, "{metric} k = {:<6} {}", point.k, figures(&point.set));
        }
    }
    text.push_str("\nFigure 5.6: candidates that score within 10 % of the best\n");
    for spread in &found.spreads {
        let (share, count) = (spread.near_best * 100.0, spread.scores.len());
        let _ = writeln!(text, "{:<34} {share:.2} % of {count}", spread.metric);
    }
    text
}

fn bound(Bound { count, rollouts, upper }: &Bound) -> String {
    format!("{:>16} {:>10.1} %", format!("{count} of {rollouts}"), upper * 100.0)
}

fn equivalents(text: &mut String, found: &Experiments) {
    let Some(last) = found.curve.last() else { return };
    let _ = writeln!(
        text,
        "\nhow many steps a teacher for the default task trains until it earns as much; it acts by samples as while it learns \
         (what the paper\nis compared with), or by its mean, which needs fewer ({} policies up to {} steps)",
        found.curve.len(),
        last.steps
    );
    for one in &found.equivalents {
        let acts = match one.acts {
            TeacherActs::Sample => "by samples",
            TeacherActs::Mean => "by its mean",
        };
        let _ = writeln!(text, "{:<NAMES$} {acts:<12} {}", one.agent, crossing(one, last.steps));
    }
}

fn crossing(one: &Equivalent, last: u64) -> String {
    let place = |crossing: Crossing| match crossing {
        Crossing::BelowCurve => "0".to_owned(),
        Crossing::At(steps) => format!("{steps:.0}"),
        Crossing::AboveCurve => format!("more than {last}"),
    };
    let words = match one.steps {
        Crossing::BelowCurve => ": the untrained one earns as much",
        Crossing::At(_) | Crossing::AboveCurve => "",
    };
    format!("{} [{}, {}]{words}", place(one.steps), place(one.low), place(one.high))
}

fn tails(text: &mut String, found: &Experiments) {
    let first = found.tails.first().map(|table| table.set_value);
    for (name, tail, area) in
        [("Table 5.1", Tail::Lower, "V < μ* − α σ*"), ("Table 5.2", Tail::Upper, "V > μ*")]
    {
        for table in found.tails.iter().filter(|table| table.tail == tail) {
            let TailTable { metric, set_value, threshold, baseline, set, improvement, .. } = table;
            let reading = match set_value {
                SetValue::Mixture => "one option at random",
                SetValue::Average => "the options' mean in each context",
            };
            let other = if Some(*set_value) == first { "" } else { ", the other reading" };
            let _ = writeln!(text, "\n{name} ({area}, from {threshold:.3}; V of a set: {reading}{other})");
            let _ = writeln!(text, "{:<34} {}", "ψμ (the paper's heading says ψ+)", figures(baseline));
            let _ = writeln!(text, "{metric:<34} {}", figures(set));
            let gain = improvement.map_or("not defined".to_owned(), |gain| interval(&gain, 3));
            let _ = writeln!(text, "{:<34} {gain}", "improvement of the area");
        }
    }
}

fn figures(TailFigures { options, mean, area, smooth }: &TailFigures) -> String {
    let options = options.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
    let (mean, area) = (interval(mean, 3), interval(area, 3));
    format!("mean {mean:>22}  area {area:>22}  smoothed {smooth:.3}  options {options}")
}

/// Our figures beside the paper's, with a remark where they differ.
pub fn beside(all: &[Beside]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let mut text =
        "\nbeside Weber et al. 2019 (its contact model, normalisation and M are not those of here)\n"
            .to_owned();
    for one in all {
        let digits = one.digits;
        let ours = one.ours.map_or("-".to_owned(), |ours| interval(&ours, digits));
        let paper = one.paper.map_or("-".to_owned(), |paper| format!("{paper:.digits$}"));
        let note = one.note.as_deref().map_or(String::new(), |note| format!(" ({note})"));
        let _ = writeln!(text, "{:<58} {ours:>26}   paper {paper:>7}   {}{note}", one.figure, one.remark());
    }
    text
}
