//! Reports as tables on a terminal.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use elo_core::compare::RunComparison;
use elo_core::crosscheck::{Crosscheck, Difference};
use elo_core::evaluate::Evaluation;
use elo_core::figures::{Comparison, Row};
use elo_core::metric::Reference;
use elo_core::parts::OptionPart;
use elo_core::report::Report;
use elo_core::reprice::Repriced;
use elo_core::returns::Scale;
use elo_core::statistics::bootstrap::Interval;

use crate::format::{COLUMNS, RETURN_DIGITS, SCORE_DIGITS, SHARE_DIGITS, interval, number, percent};

/// The table that `elo discover` ends with.
pub fn report(report: &Report, confidence: f64) -> String {
    let mut text = String::new();
    let (robot, engine) = (&report.robot, &report.engine);
    let _ = writeln!(text, "\n{robot} in {} {}, seed {}", engine.name, engine.version, report.seed);
    let _ = writeln!(text, "{}, {} held-out contexts", candidates(report), report.starts.contexts);
    let _ = writeln!(
        text,
        "They begin after {:.1} random steps on average ({:.1} draws fell before a start was found).\n\
         Every figure below is from held-out contexts, with its {:.0} % interval over contexts.",
        report.starts.mean_random_steps,
        report.starts.mean_redraws,
        confidence * 100.0,
    );
    text.push_str(&normalisation(&report.scale, &report.reference));
    for set in &report.sets {
        let _ = writeln!(
            text,
            "\n{}: score {} (on the selecting contexts {:.3})",
            set.metric,
            interval(&set.score, SCORE_DIGITS),
            set.selection_score
        );
        heading(&mut text, NAMES);
        let which = set.learned_as_a_whole().map_or(String::new(), |whole| format!(" ({})", whole.row.name));
        line(&mut text, NAMES, &format!("the set{which}"), &set.row);
        for option in &set.options {
            let Some(teacher) = option.teacher else { continue };
            line(&mut text, NAMES, &format!("  {} (teacher {teacher})", option.row.name), &option.row);
        }
        text.push_str(&parts(&set.parts));
        comparisons(&mut text, &set.against);
    }
    let _ = writeln!(text, "\nin the same contexts");
    heading(&mut text, NAMES);
    for row in &report.baselines {
        line(&mut text, NAMES, &row.name, row);
    }
    for warning in &report.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    text
}

/// How a set's options divide its states, and how long they last.
fn parts(parts: &[OptionPart]) -> String {
    if parts.is_empty() {
        return String::new();
    }
    let mut sorted = parts.to_vec();
    sorted.sort_by(|a, b| b.share.total_cmp(&a.share));
    let list = |number: fn(&OptionPart) -> String| {
        let mut all: Vec<String> = sorted.iter().map(number).collect();
        if all.iter().all(|one| *one == all[0]) {
            all.truncate(1);
        }
        all.join(", ")
    };
    let shares = list(|part| format!("{} %", percent(part.share, 0)));
    let steps = list(|part| format!("{:.1}", part.steps));
    format!(
        "its options are drawn in {shares} of the states it comes through, and last {steps} steps on average\n"
    )
}

/// What the sets were chosen from.
fn candidates(report: &Report) -> String {
    let (all, usable) = (report.teachers.len(), report.candidates.usable);
    let trained = report.teachers.iter().filter(|teacher| teacher.usable).count();
    let teachers =
        if trained == all { format!("{all} teachers") } else { format!("{trained} of {all} teachers") };
    let text = match report.candidates.teacher_return {
        Some(recorded) => {
            format!(
                "{teachers} (mean return while recorded {}), {usable} candidate options",
                number(recorded, RETURN_DIGITS)
            )
        }
        None => format!("{teachers}, {usable} candidate sets learned by practice"),
    };
    match report.candidates.given_up.len() {
        0 => text,
        lost => format!("{text} ({lost} more given up: every recording fell, or every training diverged)"),
    }
}

/// What the columns of normalised returns mean.
fn normalisation(scale: &Scale, reference: &Reference) -> String {
    format!(
        "mean, IQM and score are of returns normalised as (return {:+.2}) / {:.2}; tails are Pr(V < μ* − α σ*) and\n\
         Pr(V > μ*), μ* = {:.3}, σ* = {:.3}.\n",
        -scale.offset, scale.scale, reference.mean, reference.standard_deviation
    )
}

/// The table that `elo evaluate` ends with.
pub fn evaluation(evaluation: &Evaluation) -> String {
    let mut text = String::new();
    let Evaluation { metric, robot, engine, seed, made_with_seed, contexts, scale, reference, .. } =
        evaluation;
    let kind = if seed == made_with_seed { "held-out contexts of the run's own" } else { "fresh contexts" };
    let (name, version) = (&engine.name, &engine.version);
    let _ = writeln!(text, "\n{metric} set of {robot} in {name} {version}: {contexts} {kind}, seed {seed}");
    text.push_str(&normalisation(scale, reference));
    heading(&mut text, NAMES);
    line(&mut text, NAMES, "the set", &evaluation.set);
    for row in &evaluation.options {
        line(&mut text, NAMES, &format!("  {}", row.name), row);
    }
    for row in &evaluation.baselines {
        line(&mut text, NAMES, &row.name, row);
    }
    comparisons(&mut text, &evaluation.against);
    text
}

/// Fewer candidates than this have rank correlations that jump with each of them.
const FEW: usize = 10;

/// The table that `elo crosscheck` ends with.
pub fn crosscheck(found: &Crosscheck) -> String {
    let Crosscheck { robot, contexts, candidates, engines, pairs, robust, robust_scores } = found;
    let mut text = format!("\n{robot}: {} candidates in {contexts} shared contexts\n", candidates.len());
    let list = |numbers: &[usize]| numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
    let names = found.names();
    for (engine, name) in engines.iter().zip(&names) {
        let average = engine.scores.iter().sum::<f64>() / engine.scores.len().max(1) as f64;
        let _ = writeln!(
            text,
            "{name:<12} mean return of all candidates {}, best {}, {:.1} % of rollouts failed{}",
            number(average, RETURN_DIGITS),
            list(&engine.best),
            engine.failures * 100.0,
            if engine.same_starts {
                ""
            } else {
                "; its starts are its own, for want of states that can be set"
            }
        );
        for (what, why) in
            [("the first of those", &engine.first_failure), ("no trajectories", &engine.unseen)]
        {
            if let Some(why) = why {
                let why = why.lines().map(str::trim).collect::<Vec<_>>().join(" | ");
                let _ = writeln!(text, "{:<12} {what}: {why}", "");
            }
        }
    }
    if candidates.len() < FEW {
        let _ = writeln!(
            text,
            "Rank correlations of so few candidates, and their intervals, say little: 30 are better."
        );
    }
    let correlation = |found: &Option<Interval>| {
        found.map_or("not defined".to_owned(), |found| interval(&found, SHARE_DIGITS))
    };
    for pair in pairs {
        let (first, second) = (&names[pair.first], &names[pair.second]);
        let differ = pair.differences.iter().filter(|d| d.sign_test < 0.05 / candidates.len() as f64);
        let (more, less): (Vec<&Difference>, Vec<&Difference>) = differ.partition(|d| d.mean > 0.0);
        let _ = writeln!(text, "\n{first} and {second}");
        let _ = writeln!(text, "  Kendall's τ-b of the mean returns  {}", correlation(&pair.kendall));
        let _ = writeln!(text, "  Spearman's ρ                       {}", correlation(&pair.spearman));
        let _ = writeln!(text, "  of the best {}, in both            {}", robust.len(), pair.shared_best);
        let _ = writeln!(
            text,
            "  candidates that earn more on {second}: {}, less: {} (sign test at 5 %, Bonferroni)",
            more.len(),
            less.len()
        );
        let _ = match (pair.parted, pair.parted_after) {
            (None, _) => writeln!(text, "  trajectories were not compared"),
            (_, None) => writeln!(text, "  none of the best options' trajectories parts"),
            (Some(parted), Some([early, middle, late])) => writeln!(
                text,
                "  {} % of the best options' trajectories part, after {middle:.0} steps (quartiles {early:.0} and \
                 {late:.0})",
                percent(parted, 0)
            ),
        };
    }
    let scores: Vec<String> = robust_scores.iter().map(|score| number(*score, RETURN_DIGITS)).collect();
    let _ = writeln!(
        text,
        "\nbest by the worst engine: {} (worst mean returns {})",
        list(robust),
        scores.join(" ")
    );
    text
}

/// Width of the column of names.
const NAMES: usize = 34;

/// The heading of [`line`]s whose names have a column of `names` characters.
pub fn heading(text: &mut String, names: usize) {
    let _ = write!(text, "{:<names$}", "");
    for column in &COLUMNS {
        let _ = write!(text, " {:>width$}", column.heading, width = column.width);
    }
    let _ = writeln!(text, " {:>6} {:>6}", "falls", "steps");
}

/// One row of figures.
pub fn line(text: &mut String, names: usize, name: &str, row: &Row) {
    let _ = write!(text, "{name:<names$}");
    for column in &COLUMNS {
        let figure = interval((column.of)(row), column.digits);
        let _ = write!(text, " {figure:>width$}", width = column.width);
    }
    let _ = writeln!(text, " {:>4} % {:>6.0}", percent(row.falls.estimate, 0), row.mean_length);
    if row.failures > 0.0 {
        let _ = writeln!(text, "{:<names$} {} % of these rollouts failed", "", percent(row.failures, 1));
    }
}

fn comparisons(text: &mut String, against: &[Comparison]) {
    for comparison in against {
        let name = format!("set minus {}", comparison.baseline);
        let _ = writeln!(text, "{name:<34} {:>24}", interval(&comparison.difference, RETURN_DIGITS));
    }
}

/// The table that `elo reprice` ends with.
pub fn repriced(found: &Repriced) -> String {
    let Repriced { robot, engine, seed, contexts, sets, baselines, .. } = found;
    let (name, version) = (&engine.name, &engine.version);
    let mut text = format!(
        "\n{robot} in {name} {version}, seed {seed}: {contexts} held-out contexts with tasks of the new ranges; nothing was \
         simulated\n{}",
        normalisation(&found.scale, &found.reference)
    );
    let list = |numbers: &[usize]| numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
    heading(&mut text, NAMES);
    for set in sets {
        line(&mut text, NAMES, &set.metric, &set.row);
        let same = |of: &[usize]| of.iter().copied().collect::<BTreeSet<_>>();
        if same(&set.chosen) == same(&set.options) {
            let _ = writeln!(text, "  the same options would be chosen: {}", list(&set.options));
            continue;
        }
        let _ =
            writeln!(text, "  its options {}; now {} would be chosen", list(&set.options), list(&set.chosen));
        match &set.chosen_row {
            Some(row) => line(&mut text, NAMES, "  those", row),
            None => text.push_str(
                "  some of those have no held-out rollouts: `elo discover` with these ranges measures them\n",
            ),
        }
    }
    for row in baselines {
        line(&mut text, NAMES, &row.name, row);
    }
    text
}

/// The table that `elo compare` ends with.
pub fn compared(found: &RunComparison, names: &[String; 2]) -> String {
    let RunComparison { robot, engine, contexts, seed, pairs } = found;
    let (name, version) = (&engine.name, &engine.version);
    let mut text = format!(
        "\n{robot} in {name} {version}: {contexts} common contexts, the held-out ones of seed {seed}\n"
    );
    let [first, second] = names;
    for pair in pairs {
        let (ours, theirs) = (&pair.first.name, &pair.second.name);
        let metrics = if ours == theirs { ours.clone() } else { format!("{ours} and {theirs}") };
        let _ = writeln!(text, "\n{metrics}");
        text.push_str(&normalisation(&pair.scale, &pair.reference));
        heading(&mut text, NAMES);
        line(&mut text, NAMES, &format!("1: {first}"), &pair.first);
        line(&mut text, NAMES, &format!("2: {second}"), &pair.second);
        let (returns, falls) =
            (interval(&pair.difference, RETURN_DIGITS), interval(&pair.falls, SCORE_DIGITS));
        let _ = writeln!(text, "{:<NAMES$} {returns:>24}", "return, 2 minus 1");
        let _ = writeln!(text, "{:<NAMES$} {falls:>24}", "share of falls, 2 minus 1");
    }
    text
}
