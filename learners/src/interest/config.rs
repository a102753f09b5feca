//! What a user may set.

use elo_core::fault::Faults;
use elo_core::policy::{
    CurvePoint, Monitor, OptionLearner, OptionPolicy, Practice, Practise, Practised, TrainError, Way,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::duration::Band;
use super::risk::Risk;
use super::train::{Learned, Point, train};
use crate::fields::check_hidden;
use crate::kernels::gae::Discount;

/// Closed-loop options with interests and a learned duration, learned together from rollouts of the infant agent (Weber
/// et al. 2019, §6.2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InterestConfig {
    /// Whether the policies of the options begin as clones of recordings of teachers, one an option: then teachers are trained
    /// and recorded first. Clones act around what the teacher did with the noise of `initial_log_std`, which should be small.
    pub imitation_start: bool,
    /// How often options may continue on average without a cost: `[ρ_min, ρ_max]`.
    pub continuations: Band,
    /// `λ` of Eq. 6.1, per squared continuation; returns are in units of the deviation that discounted returns have.
    #[schemars(range(min = 0.0))]
    pub duration_weight: f64,
    /// How often options continue on average before any training.
    #[schemars(range(min = 1e-3, max = 1e6))]
    pub initial_continuations: f64,
    /// Control steps of practice; the last rollout is cut short.
    #[schemars(range(min = 1))]
    pub steps: u64,
    /// Control steps between two changes of the options, in whole rollouts of at most `discover.steps`.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub rollout_steps: u64,
    /// How many tasks are drawn from `P` before the practice, each with a start from `d0`, for rollouts to choose from. Each
    /// costs up to `initial_states.max_random_steps` control steps, times the redraws.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub context_pool: u64,
    /// Passes over the steps of one iteration.
    #[schemars(range(min = 1, max = 1000))]
    pub epochs: usize,
    /// Steps whose mean loss one gradient step descends, those of all options together.
    #[schemars(range(min = 1))]
    pub minibatch: usize,
    /// Adam's step sizes at the beginning; they fall linearly to zero.
    pub learning_rates: LearningRates,
    /// How far the probability of a decision may move in one iteration before there is no reward for moving it further.
    /// Between 0 and 1, both excluded.
    pub clip: f64,
    /// No further pass begins in an iteration once decisions have moved by this Kullback–Leibler divergence a step, in nats.
    /// Must be positive; the default allows all `epochs` always.
    pub target_kl: f64,
    /// What is maximised of returns: "mean", or `{ negative_tail = { k = 1.0, alpha = 1.0 } }` for `ψ_-` (Eq. 4.6), the mean less
    /// the price `k` of a rollout whose return is more than `alpha` deviations below the mean.
    pub risk: Risk,
    /// Weight of the options' diversity, the entropy in nats of how often each is drawn on the whole, beside advantages of
    /// deviation 1. It keeps one option from being preferred everywhere.
    #[schemars(range(min = 0.0))]
    pub diversity_weight: f64,
    /// `γ` and `λ` of the advantages.
    pub discount: Discounts,
    /// Whether step `t` of a rollout counts `γ^t`, as in the gradient of `J` to the letter. Otherwise all steps count alike, as is
    /// usual, and late steps teach as much as early ones.
    pub discounted_visits: bool,
    /// Gradients of a network that are longer are scaled down to this; must be positive.
    pub max_grad_norm: f64,
    /// Widths of the hidden layers of all networks.
    pub hidden: Vec<usize>,
    /// Natural logarithm of the action noise's standard deviation at the beginning, in units of the action.
    #[schemars(range(min = -5.0, max = 1.0))]
    pub initial_log_std: f64,
    /// Control steps between checkpoints, rounded up to whole iterations. Changes no result.
    #[schemars(range(min = 1))]
    pub checkpoint_every: u64,
}

/// See [`InterestConfig::learning_rates`]. The networks of a part whose rate is 0 stay as they begin, and so does `ε`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LearningRates {
    /// Of the option policies.
    #[schemars(range(min = 0.0))]
    pub policies: f64,
    /// Of the interests; with 0 options are drawn uniformly.
    #[schemars(range(min = 0.0))]
    pub interests: f64,
    /// Of the logit of `ε`; with 0 options last as long as `initial_continuations` says.
    #[schemars(range(min = 0.0))]
    pub termination: f64,
    /// Of the critic.
    #[schemars(range(min = 0.0))]
    pub critic: f64,
}

/// See [`InterestConfig::discount`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Discounts {
    /// `γ`, the discount of rewards per control step.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gamma: f64,
    /// `λ` of generalised advantage estimation: 0 trusts the critic, 1 the rewards to the rollout's end.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gae_lambda: f64,
}

impl Default for InterestConfig {
    fn default() -> Self {
        Self {
            imitation_start: false,
            continuations: Band::default(),
            duration_weight: 0.1,
            initial_continuations: 10.0,
            steps: 2_000_000,
            rollout_steps: 8192,
            context_pool: 1000,
            epochs: 10,
            minibatch: 256,
            learning_rates: LearningRates::default(),
            clip: 0.2,
            target_kl: 1000.0,
            risk: Risk::Mean,
            diversity_weight: 0.0,
            discount: Discounts::default(),
            discounted_visits: false,
            max_grad_norm: 0.5,
            hidden: vec![64, 64],
            initial_log_std: 0.0,
            checkpoint_every: 100_000,
        }
    }
}

impl Default for LearningRates {
    fn default() -> Self {
        Self { policies: 3e-4, interests: 3e-4, termination: 0.01, critic: 3e-4 }
    }
}

impl Default for Discounts {
    fn default() -> Self {
        Self { gamma: 0.98, gae_lambda: 0.95 }
    }
}

impl From<Discounts> for Discount {
    fn from(Discounts { gamma, gae_lambda }: Discounts) -> Self {
        Self { gamma, lambda: gae_lambda }
    }
}

#[typetag::serde(name = "interest")]
impl OptionLearner for InterestConfig {
    fn validate(&self, faults: &mut Faults) {
        let counts = [
            ("steps", self.steps),
            ("rollout_steps", self.rollout_steps),
            ("context_pool", self.context_pool),
            ("epochs", self.epochs as u64),
            ("minibatch", self.minibatch as u64),
            ("checkpoint_every", self.checkpoint_every),
        ];
        for (field, count) in counts {
            faults.check(count > 0, field, || "expected at least 1, got 0".to_owned());
        }
        let Band { low, high } = self.continuations;
        faults.check(0.0 <= low && low <= high && 0.0 < high && high.is_finite(), "continuations", || {
            format!("expected 0 <= low <= high and 0 < high, got low = {low} and high = {high}")
        });
        let positive = [("max_grad_norm", self.max_grad_norm), ("target_kl", self.target_kl)];
        for (field, value) in positive {
            faults.check(value > 0.0 && value.is_finite(), field, || {
                format!("expected a positive number, got {value}")
            });
        }
        let LearningRates { policies, interests, termination, critic } = self.learning_rates;
        let (k, alpha) = match self.risk {
            Risk::Mean => (0.0, 0.0),
            Risk::NegativeTail { k, alpha } => (k, alpha),
        };
        let not_negative = [
            ("risk.negative_tail.k", k),
            ("risk.negative_tail.alpha", alpha),
            ("diversity_weight", self.diversity_weight),
            ("duration_weight", self.duration_weight),
            ("learning_rates.policies", policies),
            ("learning_rates.interests", interests),
            ("learning_rates.termination", termination),
            ("learning_rates.critic", critic),
        ];
        for (field, value) in not_negative {
            faults.check(value >= 0.0 && value.is_finite(), field, || {
                format!("expected 0 or more, got {value}")
            });
        }
        faults.check(self.clip > 0.0 && self.clip < 1.0, "clip", || {
            format!("expected a number between 0 and 1, got {}", self.clip)
        });
        for (field, value) in
            [("discount.gamma", self.discount.gamma), ("discount.gae_lambda", self.discount.gae_lambda)]
        {
            faults.check((0.0..=1.0).contains(&value), field, || format!("expected 0 to 1, got {value}"));
        }
        faults.check((1e-3..=1e6).contains(&self.initial_continuations), "initial_continuations", || {
            format!("expected 0.001 to 1000000, got {}", self.initial_continuations)
        });
        check_hidden(faults, &self.hidden);
        faults.check((-5.0..=1.0).contains(&self.initial_log_std), "initial_log_std", || {
            format!("expected -5 to 1, got {}", self.initial_log_std)
        });
    }

    fn way(&self) -> Way<'_> {
        Way::Practises(self)
    }
}

impl Practise for InterestConfig {
    fn simulator_steps(&self) -> u64 {
        self.steps
    }

    fn starts(&self) -> u64 {
        self.context_pool
    }

    fn begins_from_recordings(&self) -> bool {
        self.imitation_start
    }

    fn practise(&self, practice: &Practice<'_>, monitor: &mut dyn Monitor) -> Result<Practised, TrainError> {
        let Learned { options, curve } = train(self, practice, monitor)?;
        let seen = |point: Point| CurvePoint {
            steps: point.steps,
            mean_return: Some(point.mean_return),
            mean_length: Some(point.mean_length),
        };
        Ok(Practised {
            options: options.into_iter().map(|option| Box::new(option) as Box<dyn OptionPolicy>).collect(),
            curve: curve.into_iter().map(seen).collect(),
        })
    }
}

impl InterestConfig {
    /// The learning rates of an iteration after `steps`.
    pub(super) fn rates(&self, steps: u64) -> LearningRates {
        let left = 1.0 - steps as f64 / self.steps as f64;
        let LearningRates { policies, interests, termination, critic } = self.learning_rates;
        LearningRates {
            policies: policies * left,
            interests: interests * left,
            termination: termination * left,
            critic: critic * left,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_found_at_once() {
        let mut faults = Faults::new();
        InterestConfig::default().validate(&mut faults);
        assert!(faults.found().is_empty(), "{:?}", faults.found());
        let wrong = -1.0;
        let config = InterestConfig {
            imitation_start: false,
            continuations: Band { low: 6.0, high: 5.0 },
            duration_weight: f64::NAN,
            initial_continuations: 0.0,
            steps: 0,
            rollout_steps: 0,
            context_pool: 0,
            epochs: 0,
            minibatch: 0,
            learning_rates: LearningRates {
                policies: wrong,
                interests: wrong,
                termination: wrong,
                critic: wrong,
            },
            clip: 1.0,
            target_kl: 0.0,
            risk: Risk::NegativeTail { k: wrong, alpha: wrong },
            diversity_weight: wrong,
            discount: Discounts { gamma: 1.1, gae_lambda: wrong },
            discounted_visits: false,
            max_grad_norm: 0.0,
            hidden: vec![3, 0],
            initial_log_std: 2.0,
            checkpoint_every: 0,
        };
        config.validate(&mut faults);
        let found: Vec<String> = faults.into_found().into_iter().map(|fault| fault.path).collect();
        let tops = |prefix: &str| found.iter().filter(|field| field.starts_with(prefix)).count();
        assert_eq!(
            (tops("learning_rates."), tops("risk.negative_tail."), tops("discount.")),
            (4, 2, 2),
            "{found:?}"
        );
        let mut found: Vec<&str> = found.iter().filter_map(|field| field.split('.').next()).collect();
        found.sort_unstable();
        found.dedup();
        // All fields but the two that can only be yes or no.
        let serde_json::Value::Object(all) = serde_json::to_value(&config).expect("plain data") else {
            panic!("no table")
        };
        let mut all: Vec<&str> = all.keys().map(String::as_str).collect();
        all.retain(|field| !["imitation_start", "discounted_visits"].contains(field));
        all.sort_unstable();
        assert_eq!(found, all);
    }
}
