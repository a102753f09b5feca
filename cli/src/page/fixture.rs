//! Runs that were never made, of any size, with films of a walker that swings its legs.

#![allow(clippy::unwrap_used)]

use elo_core::crosscheck::{Crosscheck, Difference, EngineScores, Pair};
use elo_core::experiment::TeacherActs;
use elo_core::experiments::curve::{Crossing, CurvePoint, Equivalent};
use elo_core::experiments::tails::{SweepPoint, TailFigures, TailTable};
use elo_core::experiments::{AgentReturns, Bound, Experiments, ScoreSpread};
use elo_core::figures::{Comparison, Row, Tail};
use elo_core::metric::Reference;
use elo_core::replay::{FilmOf, Replay};
use elo_core::report::{CandidateCounts, OptionReport, REPORT_FORMAT, Report, SetReport, StartReport};
use elo_core::returns::{Scale, SetValue};
use elo_core::scene::{Film, Pose, Scene, Shape, Solid};
use elo_core::simulator::Engine;
use elo_core::statistics::bootstrap::Interval;

use super::data::{CandidateRow, FailureRow, RunData};

/// How much there is of everything.
#[derive(Clone, Copy)]
pub struct Sizes {
    pub candidates: usize,
    pub contexts: usize,
    pub set_size: usize,
    pub steps: usize,
}

/// As large as the quick configs' runs.
pub const QUICK: Sizes = Sizes { candidates: 40, contexts: 20, set_size: 2, steps: 30 };
/// As large as the paper's.
pub const PAPER: Sizes = Sizes { candidates: 600, contexts: 300, set_size: 5, steps: 200 };

const METRICS: [&str; 3] = ["maximum_mean", "negative_tail(k=0.75)", "positive_skew(k=0.05)"];
const CONFIG: &str = "seed = 1\n[teacher]\nkind = \"ppo\"\n[report]\nconfidence = 0.95\nalpha = 1.0\n[failures]\npolicy = \"worst_possible\"\nmax_share = 0.2\n";

/// Numbers from -1 to 1 that look random.
fn noise(seed: usize) -> f64 {
    let mixed = (seed as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

fn interval(seed: usize, middle: f64) -> Interval {
    let estimate = middle + noise(seed) * 0.1 * middle.abs().max(0.1);
    Interval {
        estimate,
        low: estimate - 0.1 - noise(seed + 1).abs(),
        high: estimate + 0.1 + noise(seed + 2).abs(),
    }
}

fn row(name: &str, seed: usize) -> Row {
    Row {
        name: name.to_owned(),
        mean_return: interval(seed, 12.0),
        mean: interval(seed + 3, 0.3),
        iqm: interval(seed + 6, 0.3),
        lower_tail: interval(seed + 9, 0.1),
        upper_tail: interval(seed + 12, 0.5),
        falls: Interval { estimate: 0.995, low: 0.97, high: 1.0 },
        failures: if seed.is_multiple_of(7) { 0.012 } else { 0.0 },
        mean_length: 21.5,
    }
}

fn engine(name: &str) -> Engine {
    Engine { name: name.to_owned(), version: "1.2.3".to_owned() }
}

const BASELINES: [&str; 4] = ["random K-subsets", "random torque", "zero torque", "teachers"];

fn report(sizes: Sizes) -> Report {
    let option = |set: usize, place: usize| {
        let number = (set * 7 + place * 13) % sizes.candidates;
        let row = row(&format!("option {number}"), 100 * set + place);
        OptionReport { number, teacher: Some(place % 2), selection_score: 0.3 - 0.01 * place as f64, row }
    };
    let sets = METRICS.iter().enumerate().map(|(set, metric)| SetReport {
        metric: (*metric).to_owned(),
        options: (0..sizes.set_size).map(|place| option(set, place)).collect(),
        selection_score: 0.31,
        score: interval(set + 50, 0.3),
        row: row(metric, set + 60),
        against: BASELINES
            .iter()
            .enumerate()
            .map(|(i, baseline)| Comparison {
                baseline: (*baseline).to_owned(),
                difference: interval(i + 70, [6.0, 11.0, 0.0, -100.0][i]),
            })
            .collect(),
        parts: Vec::new(),
    });
    Report {
        format: REPORT_FORMAT,
        robot: "walker2d".to_owned(),
        engine: engine("rapier"),
        seed: 1,
        teachers: Vec::new(),
        candidates: CandidateCounts {
            usable: sizes.candidates,
            given_up: vec![3],
            retakes: 9,
            teacher_return: Some(241.6),
        },
        starts: StartReport { contexts: sizes.contexts, mean_random_steps: 9.9, mean_redraws: 5.2 },
        scale: Scale { offset: -45.83, scale: 200.29 },
        reference: Reference { mean: 0.299, standard_deviation: 0.143 },
        sets: sets.collect(),
        baselines: BASELINES.iter().enumerate().map(|(i, name)| row(name, i + 80)).collect(),
        warnings: vec!["a warning with <b>marks</b> & more".to_owned()],
    }
}

fn experiments(sizes: Sizes) -> Experiments {
    let agent = |index: usize, name: &str, members: usize| AgentReturns {
        row: row(name, index + 90),
        returns: (0..sizes.contexts * members)
            .map(|i| 10.0 + 4.0 * index as f64 + 9.0 * noise(i * 31 + index))
            .collect(),
        falls: Bound { count: 2, rollouts: sizes.contexts as u64, upper: 0.02 },
        low_returns: Bound { count: 1, rollouts: sizes.contexts as u64, upper: 0.01 },
    };
    let sets = METRICS.iter().enumerate().map(|(index, name)| agent(index, name, sizes.set_size));
    let others = BASELINES.iter().enumerate().map(|(index, name)| agent(index + 3, name, 1 + index));
    let equivalent = |(index, name): (usize, &&str)| {
        [TeacherActs::Sample, TeacherActs::Mean].map(|acts| Equivalent {
            agent: (*name).to_owned(),
            acts,
            level: Interval { estimate: 14.0 + index as f64, low: 12.0, high: 17.0 },
            steps: [Crossing::At(190_000.5), Crossing::BelowCurve, Crossing::AboveCurve][index],
            low: Crossing::At(90_000.0),
            high: Crossing::AboveCurve,
        })
    };
    let point = |i: u64| CurvePoint { steps: i * 20_000, sampled: grown(i, 2.0), mean_action: grown(i, 2.6) };
    Experiments {
        format: 1,
        robot: "walker2d".to_owned(),
        engine: engine("rapier"),
        seed: 1,
        contexts: sizes.contexts,
        steps: sizes.steps,
        agents: sets.chain(others).collect(),
        curve: (0..=20).map(point).collect(),
        equivalents: METRICS.iter().enumerate().flat_map(equivalent).collect(),
        tails: [Tail::Lower, Tail::Upper].map(tail).to_vec(),
        sweep: [Tail::Lower, Tail::Upper].into_iter().flat_map(sweep).collect(),
        spreads: METRICS
            .iter()
            .map(|m| ScoreSpread {
                metric: (*m).to_owned(),
                candidates: vec![0, 3],
                scores: vec![0.1, 0.2],
                near_best: 0.25,
            })
            .collect(),
    }
}

fn grown(i: u64, pace: f64) -> Row {
    let level = pace * i as f64;
    Row {
        mean_return: Interval { estimate: level, low: level - 2.0, high: level + 2.0 },
        ..row("teacher", 5)
    }
}

fn tail(tail: Tail) -> TailTable {
    TailTable {
        metric: METRICS[1].to_owned(),
        set_value: SetValue::Mixture,
        tail,
        threshold: 0.156,
        baseline: tail_figures(1),
        set: tail_figures(3),
        improvement: (tail == Tail::Lower).then(|| interval(5, 0.4)),
    }
}

fn tail_figures(seed: usize) -> TailFigures {
    let (mean, area) = (interval(seed, 0.3), interval(seed + 1, 0.2));
    TailFigures { options: vec![1, 2], mean, area, smooth: 0.21 }
}

fn sweep(tail: Tail) -> Vec<SweepPoint> {
    (0..5).map(|i| SweepPoint { tail, k: 0.25 * i as f64, set: tail_figures(i) }).collect()
}

fn crosscheck(sizes: Sizes) -> Crosscheck {
    let scores =
        |shift: usize| (0..sizes.candidates).map(|i| 20.0 * noise(i) + 6.0 * noise(i * 3 + shift)).collect();
    let on = |name: &str, shift: usize| EngineScores {
        engine: engine(name),
        same_starts: shift == 0,
        scores: scores(shift),
        failures: 0.001,
        first_failure: Some("</td><b>it blew up".to_owned()),
        unseen: None,
        best: (0..sizes.set_size).collect(),
    };
    Crosscheck {
        robot: "walker2d".to_owned(),
        contexts: 30,
        candidates: (0..sizes.candidates).collect(),
        engines: vec![on("rapier", 0), on("mujoco", 1)],
        pairs: vec![Pair {
            first: 0,
            second: 1,
            kendall: Some(interval(1, 0.7)),
            spearman: None,
            shared_best: 1,
            differences: (0..sizes.candidates)
                .map(|i| Difference { mean: noise(i), sign_test: 0.5 })
                .collect(),
            parted: Some(0.9),
            parted_after: Some([1.0, 2.0, 5.0]),
        }],
        robust: vec![3, 4],
        robust_scores: vec![11.5, 9.25],
    }
}

/// A trunk and two legs that swing as it walks along.
fn walking(engine_name: &str, who: &[String], sizes: Sizes, pace: f64) -> Replay {
    let about_y = |angle: f64| [(angle / 2.0).cos(), 0.0, (angle / 2.0).sin(), 0.0];
    let at = |position: [f64; 3], angle: f64| Pose { position, rotation: about_y(angle) };
    let limb = |body: usize, length: f64| Solid {
        body,
        pose: at([0.0, 0.0, -length], 0.0),
        shape: Shape::Capsule { radius: 0.05, half_length: length },
    };
    let mut solids = vec![
        Solid { body: 0, pose: at([0.0; 3], 0.0), shape: Shape::Box { half_size: [0.25, 0.1, 0.12] } },
        Solid { body: 0, pose: at([0.32, 0.0, 0.1], 0.0), shape: Shape::Sphere { radius: 0.1 } },
    ];
    solids.extend((1..9).map(|body| limb(body, 0.2)));
    let step = |i: usize| -> Vec<Pose> {
        let (x, phase) = (pace * i as f64 / 60.0, i as f64 * 0.15);
        let swing = |body: usize| 0.6 * (phase + body as f64 * std::f64::consts::PI).sin();
        let leg =
            |body: usize| at([x + 0.2 - 0.05 * body as f64, 0.1 - 0.02 * body as f64, 0.46], swing(body));
        std::iter::once(at([x, 0.0, 0.55], 0.0)).chain((1..9).map(leg)).collect()
    };
    let film = |who: &String| FilmOf {
        who: who.clone(),
        context: 0,
        film: Film { steps: (0..=sizes.steps).map(step).collect(), returns: 17.25 * pace },
    };
    let bodies = (0..9).map(|i| format!("body {i}")).collect();
    let scene = Scene { bodies, solids, floor: true };
    Replay {
        engine: engine(engine_name),
        control_step: 1.0 / 60.0,
        scene,
        films: who.iter().map(film).collect(),
    }
}

/// A run with everything.
pub fn run(sizes: Sizes) -> RunData {
    let report = report(sizes);
    let options = report.sets.iter().flat_map(|set| set.options.iter().map(|option| option.row.name.clone()));
    let who: Vec<String> = options.collect();
    RunData {
        name: "made up".to_owned(),
        folder: "runs/made-up".to_owned(),
        plan: toml::from_str(CONFIG).unwrap(),
        config: CONFIG.to_owned(),
        provenance: serde_json::json!({"program": "elo </script><b>", "engine": {"name": "rapier"}}),
        candidates: (0..sizes.candidates)
            .map(|number| CandidateRow {
                number,
                scores: vec![Some(0.2 + 0.1 * noise(number)); METRICS.len()],
            })
            .collect(),
        practice: Vec::new(),
        failures: vec![FailureRow {
            table: "select".to_owned(),
            row: 1,
            context: 2,
            reason: "lost".to_owned(),
        }],
        experiments: Some(experiments(sizes)),
        crosscheck: Some(crosscheck(sizes)),
        replays: vec![walking("rapier", &who, sizes, 1.0), walking("mujoco", &who, sizes, 0.7)],
        report,
    }
}
