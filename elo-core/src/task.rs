//! Tasks `τ` and the distribution `P` they come from (§4.1, §5.1).

use std::collections::BTreeMap;

use rand::RngExt as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fault::{Faults, meant};
use crate::seed::Stream;
use crate::spec::SimulatorSpec;

/// One MDP of the family, as the values of its named parameters. A parameter that is not mentioned has its default of
/// the simulator's spec.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Task(BTreeMap<String, f64>);

impl Task {
    /// A task with these parameter values.
    pub fn new<'a>(parameters: impl IntoIterator<Item = (&'a str, f64)>) -> Self {
        Self(parameters.into_iter().map(|(name, value)| (name.to_owned(), value)).collect())
    }

    /// The value that the task gives to `name`, if it mentions it.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name).copied()
    }

    /// The parameters that the task mentions, by name.
    pub fn parameters(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.iter().map(|(name, value)| (name.as_str(), *value))
    }
}

/// `P`: independent uniform ranges of named parameters; those without a range keep their default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct TaskDistribution(BTreeMap<String, Range>);

/// Where one task parameter is drawn from, uniformly.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// The least value; equal to `high` for a fixed value.
    pub low: f64,
    /// The greatest value.
    pub high: f64,
}

impl TaskDistribution {
    /// The distribution with these ranges.
    pub fn new<'a>(ranges: impl IntoIterator<Item = (&'a str, Range)>) -> Self {
        Self(ranges.into_iter().map(|(name, range)| (name.to_owned(), range)).collect())
    }

    /// The parameters that have a range.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// The parameters with their ranges, by name.
    pub fn ranges(&self) -> impl Iterator<Item = (&str, Range)> {
        self.0.iter().map(|(name, range)| (name.as_str(), *range))
    }

    /// These ranges, and of `other` those of parameters that have none here.
    #[must_use]
    pub fn over(mut self, other: &Self) -> Self {
        for (name, range) in &other.0 {
            self.0.entry(name.clone()).or_insert_with(|| *range);
        }
        self
    }

    /// Draws one task; parameters are drawn in the order of their names.
    pub fn draw(&self, stream: &mut Stream) -> Task {
        let value = |range: &Range, stream: &mut Stream| {
            range.low + stream.random::<f64>() * (range.high - range.low)
        };
        Task(self.0.iter().map(|(name, range)| (name.clone(), value(range, stream))).collect())
    }

    /// Checks names and ranges against what the simulator declares.
    pub fn validate(&self, spec: &SimulatorSpec, faults: &mut Faults) {
        for (name, range) in &self.0 {
            let Some(parameter) = spec.task_parameter(name) else {
                let known = spec.task_parameters.iter().map(|p| p.name.as_str());
                let meant = meant(name, known.clone(), '`');
                let list = known.collect::<Vec<_>>().join(", ");
                faults.add(name, format!("is no task parameter of {} (it has: {list}){meant}", spec.robot));
                continue;
            };
            faults.within(name, |faults| {
                faults.check(range.low <= range.high, "", || {
                    format!("expected low <= high, got low = {} and high = {}", range.low, range.high)
                });
                for (field, value) in [("low", range.low), ("high", range.high)] {
                    faults.check((parameter.low..=parameter.high).contains(&value), field, || {
                        format!("expected {} to {}, got {value}", parameter.low, parameter.high)
                    });
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::Seed;

    #[test]
    fn draws_stay_in_range_and_a_fixed_value_is_exact() {
        let p = TaskDistribution::new([
            ("cost", Range { low: -2.4, high: -1.4 }),
            ("friction", Range { low: 0.8, high: 0.8 }),
        ]);
        let mut stream = Seed::root(0).stream();
        let costs: Vec<f64> = (0..1000)
            .map(|_| {
                let task = p.draw(&mut stream);
                assert_eq!(task.get("friction"), Some(0.8));
                task.get("cost").unwrap_or(f64::NAN)
            })
            .collect();
        assert!(costs.iter().all(|cost| (-2.4..-1.4).contains(cost)));
        let mean = costs.iter().sum::<f64>() / 1000.0;
        // The standard error of the mean is 1/sqrt(12 * 1000) = 0.0091.
        assert!((mean + 1.9).abs() < 4.0 * 0.0091, "{mean}");
    }
}
