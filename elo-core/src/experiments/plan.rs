//! What a user may set of the experiments.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fault::Faults;
use crate::policy::OptionLearner;

/// What `elo experiments` measures of a finished run: `[experiments]`. Changes nothing of the run itself.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExperimentsPlan {
    /// Probability that a decision of the mixed agent is one uniformly random primitive action rather than an option. The
    /// paper does not give it.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub primitive_probability: f64,
    /// Control steps of training after which a teacher stands beside the infant agent; the policy kept nearest to it is
    /// taken. The paper uses 500,000 (Figures 5.2 and 5.3).
    #[schemars(range(min = 1))]
    pub trained_steps: u64,
    /// Values of `k` for which the metrics with a tail each select a set.
    pub sweep: Vec<f64>,
    /// Option learners whose sets are measured beside the run's own: where that imitates, others that learn from the same
    /// recordings; where it practises, others that practise.
    pub other_learners: Vec<Box<dyn OptionLearner>>,
}

impl Default for ExperimentsPlan {
    fn default() -> Self {
        Self {
            primitive_probability: 0.5,
            trained_steps: 500_000,
            sweep: vec![0.05, 0.10, 0.25, 0.50, 0.75, 1.0],
            other_learners: Vec::new(),
        }
    }
}

impl ExperimentsPlan {
    /// Finds every fault of the fields.
    pub fn validate(&self, faults: &mut Faults) {
        for (i, k) in self.sweep.iter().enumerate() {
            faults.check(k.is_finite() && *k >= 0.0, &format!("sweep[{i}]"), || {
                format!("expected a number of at least 0, got {k}")
            });
        }
        for (i, learner) in self.other_learners.iter().enumerate() {
            faults.within(&format!("other_learners[{i}]"), |faults| learner.validate(faults));
        }
    }
}
