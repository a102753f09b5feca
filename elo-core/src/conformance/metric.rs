//! The suite of every [`Metric`]: what holds for any score of a return distribution, whatever it prefers.

use rand::RngExt as _;

use super::check::{Check, Finding, Report, Violation};
use super::compare::{finite, near, same};
use super::config::{faultless, one_line, round_trip};
use crate::metric::{Metric, Reference};
use crate::seed::Seed;

/// Every rule, in the order in which they are tried.
pub const CHECKS: &[Check<dyn Metric>] = &[
    CONFIG_IS_VALID,
    CONFIG_SURVIVES_FILES,
    LABEL_IS_ONE_LINE,
    SCORES_ARE_FINITE,
    SCORES_REPEAT,
    ORDER_OF_RETURNS_IS_IMMATERIAL,
];

/// Tries every rule on `metric`.
pub fn run(metric: &(dyn Metric + 'static)) -> Report {
    Report::of(format!("{metric:?}"), CHECKS, metric)
}

const CONFIG_IS_VALID: Check<dyn Metric> = Check {
    name: "config_is_valid",
    rule: "The metric's config finds no fault in itself.",
    run: |metric| Ok(faultless(|faults| metric.validate(faults))?),
};

const CONFIG_SURVIVES_FILES: Check<dyn Metric> = Check {
    name: "config_survives_files",
    rule: "Written as JSON or TOML and read back, the metric has the same label and gives the same scores.",
    run: |metric| {
        for copy in round_trip(metric)? {
            if copy.label() != metric.label() {
                return Err(Violation::new("label of the copy", metric.label(), copy.label()).into());
            }
            for (name, returns) in samples() {
                same(name, &scores(metric, &returns), &scores(copy.as_ref(), &returns))?;
            }
        }
        Ok(())
    },
};

const LABEL_IS_ONE_LINE: Check<dyn Metric> = Check {
    name: "label_is_one_line",
    rule: "The label is one line of text and always the same.",
    run: |metric| {
        let label = metric.label();
        one_line("label", &label)?;
        metric.score(&[1.0, 2.0], &REFERENCES[0]);
        if metric.label() == label {
            Ok(())
        } else {
            Err(Violation::new("label after scoring", label, metric.label()).into())
        }
    },
};

const SCORES_ARE_FINITE: Check<dyn Metric> = Check {
    name: "scores_are_finite",
    rule: "Scores are finite for one return, for equal returns, for great ones, and for a reference without spread.",
    run: |metric| {
        for (name, returns) in samples() {
            finite(&format!("scores of {name}"), &scores(metric, &returns))?;
            for reference in &REFERENCES {
                let each: Vec<f64> = returns.iter().map(|v| metric.rollout_score(*v, reference)).collect();
                finite(&format!("rollout scores of {name}"), &each)?;
            }
        }
        Ok(())
    },
};

const SCORES_REPEAT: Check<dyn Metric> = Check {
    name: "scores_repeat",
    rule: "The score of a sample is the same, bit for bit, whatever was scored before and on whichever thread.",
    run: |metric| {
        let samples = samples();
        let all = || samples.iter().flat_map(|(_, returns)| scores(metric, returns)).collect::<Vec<f64>>();
        let expected = all();
        for (i, (name, returns)) in samples.iter().enumerate().rev() {
            let first = i * REFERENCES.len();
            let before = &expected[first..first + REFERENCES.len()];
            same(&format!("scores of {name}"), before, &scores(metric, returns))?;
        }
        let there = std::thread::scope(|scope| scope.spawn(all).join())
            .map_err(|_| Violation::new("the other thread", "no panic", "a panic"))?;
        same("scores on another thread", &expected, &there)?;
        Ok(())
    },
};

const ORDER_OF_RETURNS_IS_IMMATERIAL: Check<dyn Metric> = Check {
    name: "order_of_returns_is_immaterial",
    rule: "A sample in any other order has the same score, to within 1e-9 of the greatest return in it.",
    run: |metric| {
        for (name, returns) in samples() {
            let expected = scores(metric, &returns);
            let greatest = returns.iter().fold(1.0_f64, |greatest, value| greatest.max(value.abs()));
            let mut other = returns.clone();
            for order in ["reversed", "sorted", "rotated"] {
                match order {
                    "reversed" => other.reverse(),
                    "sorted" => other.sort_by(f64::total_cmp),
                    _ => other.rotate_left(returns.len() / 3),
                }
                near(
                    &format!("scores of {name}, {order}"),
                    &expected,
                    &scores(metric, &other),
                    1e-9 * greatest,
                )?;
            }
        }
        Ok::<(), Finding>(())
    },
};

const REFERENCES: [Reference; 4] = [
    Reference { mean: 0.25, standard_deviation: 0.5 },
    Reference { mean: 0.0, standard_deviation: 0.0 },
    Reference { mean: -40.0, standard_deviation: 3.0 },
    Reference { mean: 1e6, standard_deviation: 1e-6 },
];

fn scores(metric: &dyn Metric, returns: &[f64]) -> Vec<f64> {
    REFERENCES.iter().map(|reference| metric.score(returns, reference)).collect()
}

fn samples() -> Vec<(&'static str, Vec<f64>)> {
    let mut stream = Seed::root(1).stream();
    let mut drawn = |count: usize, scale: f64| -> Vec<f64> {
        (0..count).map(|_| scale * (stream.random::<f64>() - 0.5)).collect()
    };
    vec![
        ("one return", vec![0.3]),
        ("one return of zero", vec![0.0]),
        ("two returns", vec![-1.0, 2.0]),
        ("equal returns", vec![0.25; 300]),
        ("small returns", drawn(301, 2.0)),
        ("great returns", drawn(300, 2e6)),
    ]
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use serde::{Deserialize, Serialize};

    use super::*;
    use crate::conformance::liars::{Lie, demand_that_liars_are_caught};
    use crate::fault::Faults;
    use crate::metric::{MaximumMean, NegativeTail, PositiveSkew};

    /// The mean, but for one lie.
    #[derive(Debug, Serialize, Deserialize)]
    struct Liar {
        lie: String,
        #[serde(skip)]
        forgotten: f64,
        #[serde(skip)]
        scored: AtomicU32,
    }

    impl Liar {
        fn is(&self, lie: &str) -> bool {
            self.lie == lie
        }
    }

    #[typetag::serde(name = "liar")]
    impl Metric for Liar {
        fn label(&self) -> String {
            if self.is("label_is_one_line") { "\n".to_owned() } else { "liar".to_owned() }
        }

        fn validate(&self, faults: &mut Faults) {
            faults.check(!self.is("config_is_valid"), "lie", || "expected the truth".to_owned());
        }

        fn rollout_score(&self, value: f64, _: &Reference) -> f64 {
            value + if self.is("config_survives_files") { self.forgotten } else { 0.0 }
        }

        fn score(&self, returns: &[f64], reference: &Reference) -> f64 {
            let before = self.scored.fetch_add(1, Ordering::Relaxed);
            let mean =
                returns.iter().map(|v| self.rollout_score(*v, reference)).sum::<f64>() / returns.len() as f64;
            match self.lie.as_str() {
                "scores_are_finite" if reference.standard_deviation == 0.0 => f64::INFINITY,
                "scores_repeat" => mean + 1e-12 * f64::from(before),
                "order_of_returns_is_immaterial" => mean + returns[0],
                _ => mean,
            }
        }
    }

    #[test]
    fn the_metrics_of_the_paper_keep_every_rule() {
        let metrics: [Box<dyn Metric>; 3] =
            [Box::new(MaximumMean {}), Box::new(NegativeTail::default()), Box::new(PositiveSkew::default())];
        for report in metrics.map(|metric| run(metric.as_ref())) {
            assert!(report.failed().is_empty() && report.skipped().is_empty(), "{report}");
        }
    }

    #[test]
    fn each_liar_is_caught_by_the_check_that_is_meant_for_it() {
        let lies: Vec<Lie<Box<dyn Metric>>> = CHECKS
            .iter()
            .map(|check| {
                let lie = check.name.to_owned();
                let subject = Box::new(Liar { lie, forgotten: 1.0, scored: AtomicU32::new(0) });
                // The copy's count of scores begins anew, so it scores otherwise than the original.
                let also: &[_] = if check.name == "scores_repeat" { &["config_survives_files"] } else { &[] };
                Lie { caught_by: check.name, also, subject: subject as Box<dyn Metric> }
            })
            .collect();
        demand_that_liars_are_caught(CHECKS, &lies);
    }
}
