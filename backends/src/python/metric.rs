//! Metrics written in Python.

use elo_core::fault::Faults;
use elo_core::hosted::{Hosted, WorkerProgram};
use elo_core::metric::{Metric, Reference};
use elo_core::simulator::BuildError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A score that a function in Python gives.
///
/// It is called as `function(returns, mean=…, standard_deviation=…, **kwargs)`. `returns` is an array of float64 with a
/// row for each option (or resample) and a column for each context, normalised as `[returns]` says; `mean` and
/// `standard_deviation` are the reference `(μ*, σ*)`. It gives one score a row; higher is better.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PythonMetricConfig {
    /// `module:function`. It is code that is executed: name only what you trust.
    pub target: String,
    /// What tables call it. Empty: the function's name with its `kwargs`.
    pub label: String,
    /// Other keyword arguments.
    pub kwargs: serde_json::Map<String, serde_json::Value>,
    /// Versions of what the scores depend on, and a hash of the source. Written by the program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub described: Option<String>,
}

impl Default for PythonMetricConfig {
    fn default() -> Self {
        Self {
            target: "metrics:score".to_owned(),
            label: String::new(),
            kwargs: serde_json::Map::new(),
            described: None,
        }
    }
}

#[typetag::serde(name = "python")]
impl Metric for PythonMetricConfig {
    fn label(&self) -> String {
        if !self.label.is_empty() {
            return self.label.clone();
        }
        let name = self.target.rsplit(':').next().unwrap_or_default();
        let kwargs: Vec<String> = self.kwargs.iter().map(|(key, value)| format!("{key}={value}")).collect();
        if kwargs.is_empty() { name.to_owned() } else { format!("{name}({})", kwargs.join(",")) }
    }

    fn validate(&self, faults: &mut Faults) {
        super::validate_target(&self.target, faults);
        faults.check(!self.label.contains(['\n', '\r']), "label", || "expected one line".to_owned());
        for name in ["mean", "standard_deviation"].iter().filter(|name| self.kwargs.contains_key(**name)) {
            faults.add("kwargs", format!("`{name}` is an argument that the program gives"));
        }
    }

    /// That of a sample of one return; NaN where there is none.
    fn rollout_score(&self, value: f64, reference: &Reference) -> f64 {
        self.score(&[value], reference)
    }

    /// NaN where there is none; [`Metric::scores`] says why.
    fn score(&self, returns: &[f64], reference: &Reference) -> f64 {
        self.scores(&[returns.to_vec()], reference).map_or(f64::NAN, |scores| scores[0])
    }

    #[cfg(feature = "python")]
    fn scores(&self, samples: &[Vec<f64>], reference: &Reference) -> Result<Vec<f64>, String> {
        super::scores::scores(self, samples, reference)
    }

    #[cfg(not(feature = "python"))]
    fn scores(&self, _: &[Vec<f64>], _: &Reference) -> Result<Vec<f64>, String> {
        Err(super::missing().to_string())
    }

    fn hosted(&self) -> Option<&dyn Hosted> {
        Some(self)
    }

    fn hosted_mut(&mut self) -> Option<&mut dyn Hosted> {
        Some(self)
    }
}

impl Hosted for PythonMetricConfig {
    fn worker(&self) -> WorkerProgram {
        super::WORKER
    }

    fn describe(&self) -> Result<Vec<u8>, BuildError> {
        super::describe("metric", self)
    }

    fn accept_description(&mut self, description: &[u8]) -> Result<(), String> {
        super::accept(&mut self.described, description)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn labels_tell_metrics_apart() {
        let label = |text: &str| serde_json::from_str::<PythonMetricConfig>(text).unwrap().label();
        assert_eq!(label(r#"{"target": "risk:cvar"}"#), "cvar");
        assert_eq!(label(r#"{"target": "risk:cvar", "kwargs": {"share": 0.1}}"#), "cvar(share=0.1)");
        assert_eq!(label(r#"{"target": "risk:cvar", "label": "worst tenth"}"#), "worst tenth");
    }
}
