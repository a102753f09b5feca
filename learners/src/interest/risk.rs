//! What is maximised of the returns `V` of rollouts: their mean, or `ψ_-`, the mean less a price on poor returns (Eq. 4.6).
//!
//! `ψ_- = E[V] − k Pr(V < c)` with `c = μ* − α σ*`. The probability of a rollout is a product of the agent's decisions and of
//! what the world does, so with `c` held
//!
//! ```text
//! ∇ Pr(V < c) = ∇ E[1[V < c]] = E[ 1[V < c] Σ_t ∇ log(decision t) ]
//! ```
//!
//! which is the gradient of a mean return in which the last step of a poor rollout costs 1 more. So `ψ_-` needs no gradient
//! of its own: its price is taken from the reward of that step, and the advantages of all decisions before it share in the
//! loss, discounted like any reward (to the letter with `γ = 1`). Whether a rollout will be poor depends on what it has
//! earned so far, which the critic does not see: as with any critic that lacks something, the estimate is without bias for
//! `gae_lambda = 1`.
//!
//! `(μ*, σ*)` are mean and deviation of the returns of the iteration's own rollouts. Eq. 4.6 takes them from the best set by
//! the mean; here the set at hand is the best that is known.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::advantages::Step;

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Risk {
    /// `E[V]`.
    Mean,
    /// `ψ_-`.
    NegativeTail {
        /// `k`: the price of a poor rollout, in units of the deviation that discounted returns have.
        #[schemars(range(min = 0.0))]
        k: f64,
        /// `α`: how many deviations below the mean a return is poor.
        #[schemars(range(min = 0.0))]
        #[serde(default = "one")]
        alpha: f64,
    },
}

/// The metric's own default.
fn one() -> f64 {
    1.0
}

/// Which rollouts of `steps`, in their order, are poor by `alpha`; rewards as the tasks pay them.
pub(super) fn poor(steps: &[Step], alpha: f64) -> Vec<bool> {
    let rollouts = steps.split_inclusive(|step| step.last);
    let returns: Vec<f64> = rollouts.map(|rollout| rollout.iter().map(|step| step.reward).sum()).collect();
    let count = returns.len() as f64;
    let mean = returns.iter().sum::<f64>() / count;
    let variance = returns.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    returns.iter().map(|value| *value < mean - alpha * variance.sqrt()).collect()
}

/// Takes `price` from the last reward of each rollout that is poor.
pub(super) fn charge(steps: &mut [Step], poor: &[bool], price: f64) {
    let ends = steps.iter_mut().filter(|step| step.last);
    for (end, _) in ends.zip(poor).filter(|(_, poor)| **poor) {
        end.reward -= price;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_step_of_a_poor_rollout_pays() {
        // Returns 3, 3, 3 and −1: mean 2, deviation √3; −1 is below 2 − √3 and above 2 − 2√3.
        let step = |reward, last| Step { reward, last, ..Step::default() };
        let rewards = [(1.0, false), (2.0, true), (3.0, true), (0.0, false), (3.0, true), (-1.0, true)];
        let mut steps = rewards.map(|(reward, last)| step(reward, last));
        assert_eq!(poor(&steps, 2.0), [false; 4]);
        let found = poor(&steps, 1.0);
        assert_eq!(found, [false, false, false, true]);
        charge(&mut steps, &found, 5.0);
        assert_eq!(steps.map(|step| step.reward), [1.0, 2.0, 3.0, 0.0, 3.0, -6.0]);
    }
}
