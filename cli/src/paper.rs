//! What Weber et al. 2019 report, and how our figures stand beside theirs.
//!
//! Their returns are normalised in a way that the paper does not give, so means of different normalisations are no
//! comparison of level; areas, improvements, shares and training steps are.

use elo_core::experiment::TeacherActs;
use elo_core::experiments::Experiments;
use elo_core::experiments::curve::{Crossing, Equivalent};
use elo_core::experiments::tails::TailTable;
use elo_core::figures::Tail;
use elo_core::statistics::bootstrap::Interval;
use elo_core::statistics::proportion::clopper_pearson_upper;
use elo_core::statistics::student::mean_interval;
use serde::Serialize;

/// One robot's figures in the paper.
pub struct PaperFigures {
    /// PPO steps whose mean return the infant agent's is comparable to (section 5.2, about Figures 5.2 and 5.3).
    ppo_steps: Option<f64>,
    /// Table 5.1.
    lower: PaperTail,
    /// Table 5.2.
    upper: PaperTail,
}

struct PaperTail {
    baseline: (f64, f64),
    set: (f64, f64),
    improvement: f64,
}

/// Share of candidates within 10 % of the best by `ψ_+` (Figure 5.6; the paper does not say of which robot).
const NEAR_BEST: f64 = 0.0067;

/// What the paper reports of a robot.
pub fn figures_of(robot: &str) -> Option<PaperFigures> {
    let tail = |baseline, set, improvement| PaperTail { baseline, set, improvement };
    let (ppo_steps, lower, upper) = match robot {
        "ant" => (
            Some(200_000.0),
            tail((0.328, 0.133), (0.332, 0.097), 0.270),
            tail((0.328, 0.533), (0.334, 0.597), 0.120),
        ),
        "half-cheetah" => (
            Some(190_000.0),
            tail((0.082, 0.143), (0.079, 0.127), 0.111),
            tail((0.082, 0.550), (0.082, 0.550), 0.0),
        ),
        "walker2d" => {
            (None, tail((0.122, 0.243), (0.115, 0.192), 0.209), tail((0.122, 0.563), (0.125, 0.595), 0.057))
        }
        _ => return None,
    };
    Some(PaperFigures { ppo_steps, lower, upper })
}

/// One of our figures beside the paper's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Beside {
    /// Where the paper has it, and what it is.
    pub figure: String,
    /// Each pipeline seed's estimate.
    pub seeds: Vec<f64>,
    /// Ours: over contexts for one seed; for two the mean with their range; over seeds (Student's t) for more. `None` where no
    /// seed has it.
    pub ours: Option<Interval>,
    /// What to know of ours, e.g. that it lies outside the learning curve.
    pub note: Option<String>,
    /// The paper's, if it has one.
    pub paper: Option<f64>,
    /// Pipeline seeds that were run, also those that do not have it.
    #[serde(skip)]
    pub runs: usize,
    /// Digits after the point when shown.
    #[serde(skip)]
    pub digits: usize,
    /// Whether the two may be compared: not where returns are normalised in another way.
    pub comparable: bool,
}

impl Beside {
    /// How ours stands to the paper's, in words.
    pub fn remark(&self) -> &'static str {
        match (&self.ours, self.paper) {
            (None, Some(_)) => "not defined here",
            _ if !self.comparable => "another normalisation",
            (Some(_), Some(_)) if self.seeds.len() == 2 => "two seeds are too few to tell",
            (Some(_), Some(_)) if self.seeds.len() < self.runs => "one seed is too few to tell",
            (Some(ours), Some(paper)) if ours.contains(paper) => "the paper's is within",
            (Some(ours), Some(paper)) if ours.low > paper => "above the paper's",
            (Some(_), Some(_)) => "below the paper's",
            (_, None) => "",
        }
    }
}

/// Every figure of the paper that the runs have, one run a pipeline seed of one robot.
pub fn beside(runs: &[Experiments], confidence: f64) -> Vec<Beside> {
    let Some(paper) = runs.first().and_then(|run| figures_of(&run.robot)) else { return Vec::new() };
    let over = Over { runs, confidence };
    let mut all = vec![over.steps(paper.ppo_steps)];
    for (table, tail, figures) in
        [("Table 5.1", Tail::Lower, &paper.lower), ("Table 5.2", Tail::Upper, &paper.upper)]
    {
        all.extend(over.tail(table, tail, figures));
    }
    let spread = |run: &Experiments| {
        let spread = run.spreads.iter().find(|spread| spread.metric.starts_with("positive_skew"))?;
        Some(Interval { estimate: spread.near_best, low: spread.near_best, high: spread.near_best })
    };
    let near = "Figure 5.6: share within 10 % of the best by ψ+";
    let mut near = over.figure(near, (Some(NEAR_BEST), 3, true), spread);
    over.bound(&mut near);
    all.push(near);
    all
}

/// How long PPO, acting by samples, trains until it earns what the set of `ψ_μ` earns.
fn mean_set(run: &Experiments) -> Option<&Equivalent> {
    run.equivalents.iter().find(|e| e.agent == "maximum_mean" && e.acts == TeacherActs::Sample)
}

struct Over<'a> {
    runs: &'a [Experiments],
    confidence: f64,
}

impl Over<'_> {
    fn figure(
        &self,
        figure: &str,
        (paper, digits, comparable): (Option<f64>, usize, bool),
        of: impl Fn(&Experiments) -> Option<Interval>,
    ) -> Beside {
        let found: Vec<Interval> = self.runs.iter().filter_map(of).collect();
        let seeds: Vec<f64> = found.iter().map(|interval| interval.estimate).collect();
        let ours = match found.as_slice() {
            [] => None,
            [one] => Some(*one),
            [a, b] => {
                let (a, b) = (a.estimate, b.estimate);
                Some(Interval { estimate: (a + b) / 2.0, low: a.min(b), high: a.max(b) })
            }
            _ => mean_interval(&seeds, self.confidence).ok(),
        };
        let runs = self.runs.len();
        let missing = runs - found.len();
        let note =
            (0 < missing && missing < runs).then(|| format!("not defined in {missing} of {runs} runs"));
        Beside { figure: figure.to_owned(), seeds, ours, note, paper, runs, digits, comparable }
    }

    /// Training steps of PPO, acting by samples, that earn what the set of `ψ_μ` earns.
    fn steps(&self, paper: Option<f64>) -> Beside {
        let of = |run: &Experiments| {
            let found = mean_set(run)?;
            let last = run.curve.last()?.steps as f64;
            // An end outside the curve is shown as the curve's own end, and the note says so.
            let end = |crossing| match crossing {
                Crossing::BelowCurve => 0.0,
                Crossing::At(steps) => steps,
                Crossing::AboveCurve => last,
            };
            let inside = matches!(found.steps, Crossing::At(_));
            inside.then(|| Interval {
                estimate: end(found.steps),
                low: end(found.low),
                high: end(found.high),
            })
        };
        let mut beside = self.figure("Figures 5.2, 5.3: PPO steps that earn as much", (paper, 0, true), of);
        let places: Vec<Crossing> =
            self.runs.iter().filter_map(mean_set).map(|equivalent| equivalent.steps).collect();
        let notes = [
            (Crossing::BelowCurve, "no more than the untrained policy"),
            (Crossing::AboveCurve, "more than every policy of the curve"),
        ];
        let notes: Vec<String> = notes
            .iter()
            .filter_map(|(place, words)| {
                let count = places.iter().filter(|found| *found == place).count();
                (count > 0)
                    .then(|| format!("the infant agent earns {words} in {count} of {} runs", places.len()))
            })
            .collect();
        beside.note = (!notes.is_empty()).then(|| notes.join("; "));
        beside
    }

    /// Shares lie between 0 and 1. A single run's share of 0 or 1 has a bootstrap interval without width; the exact bound
    /// of as many contexts is put in its place.
    fn bound(&self, share: &mut Beside) {
        let Some(ours) = &mut share.ours else { return };
        (ours.low, ours.high) = (ours.low.clamp(0.0, 1.0), ours.high.clamp(0.0, 1.0));
        if let [run] = self.runs {
            let trials = run.contexts as u64;
            if ours.high == 0.0 {
                ours.high = clopper_pearson_upper(0, trials, self.confidence).unwrap_or(1.0);
            }
            if ours.low == 1.0 {
                ours.low = 1.0 - clopper_pearson_upper(0, trials, self.confidence).unwrap_or(1.0);
            }
        }
    }

    fn tail(&self, name: &str, tail: Tail, paper: &PaperTail) -> Vec<Beside> {
        let of = |pick: fn(&TailTable) -> Option<Interval>| {
            move |run: &Experiments| run.tails.iter().find(|table| table.tail == tail).and_then(pick)
        };
        let (symbol, area) = match tail {
            Tail::Lower => ("ψ-", "Pr(V < μ* − α σ*)"),
            Tail::Upper => ("ψ+", "Pr(V > μ*)"),
        };
        let row = |what: String, paper, comparable, pick| {
            self.figure(&format!("{name}: {what}"), (Some(paper), 3, comparable), of(pick))
        };
        let mut rows = vec![
            row("mean under ψμ".to_owned(), paper.baseline.0, false, |t| Some(t.baseline.mean)),
            row(format!("{area} under ψμ"), paper.baseline.1, true, |t| Some(t.baseline.area)),
            row(format!("mean under {symbol}"), paper.set.0, false, |t| Some(t.set.mean)),
            row(format!("{area} under {symbol}"), paper.set.1, true, |t| Some(t.set.area)),
            row("improvement of the area".to_owned(), paper.improvement, true, |t| t.improvement),
        ];
        for area in [1, 3] {
            self.bound(&mut rows[area]);
        }
        rows
    }
}
