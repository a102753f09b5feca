//! What is maximised of the returns `V` of rollouts: their mean, or `ψ_-`, the mean less a price on poor returns (Eq. 4.6).
//!
//! `ψ_- = E[V] − k Pr(V < c)` with `c = μ* − α σ*`. The probability of a rollout is a product of the agent's decisions and of
//! what the world does, so with `c` held
//!
//! ```text
//! ∇ Pr(V < c) = ∇ E[1[V < c]] = E[ 1[V < c] Σ_t ∇ log(decision t) ]
//! ```
//!
//! where any constant may be taken from `1[V < c]`; the share `p` of poor rollouts leaves the least noise. So each decision of a
//! rollout, an action, a draw or an end alike, has `−k (1[V < c] − p)` added to its advantage; by the logit `x` of `ε` an end that
//! happened (`b = 1`) or did not has `∇ log = b − ε`. Rewards and the critic know nothing of it. Returns here are those
//! that sets are measured by: over the horizon, with the discount of `discover.discount`. A rollout that was cut short for
//! another reason has no return, and pays nothing.
//!
//! `(μ*, σ*)` are mean and deviation of the returns of the iteration's own rollouts. Eq. 4.6 takes them from the best set by
//! the mean; here the set at hand is the best that is known.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::advantages::{Advantages, Step};
use super::duration::Termination;
use super::practice::{Experience, LastState, Taken};

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

/// `−k (1[V < c] − p)` of each rollout, in their order, with returns of this discount; `None` where poor returns have no price.
pub(super) fn poor(experience: &Experience, risk: Risk, discount: f64) -> Option<Vec<f64>> {
    let Risk::NegativeTail { k, alpha } = risk else { return None };
    let rollouts = experience.steps.split_inclusive(|step: &Taken| step.last).zip(&experience.ends);
    let returns: Vec<Option<f64>> = rollouts
        .map(|(rollout, end)| {
            let whole = !matches!(end, LastState::Cut { early: true, .. });
            whole.then(|| rollout.iter().rev().fold(0.0, |later, step| step.reward + discount * later))
        })
        .collect();
    let count = returns.iter().flatten().count().max(1) as f64;
    let mean = returns.iter().flatten().sum::<f64>() / count;
    let variance = returns.iter().flatten().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    let is_poor = |value: f64| f64::from(value < mean - alpha * variance.sqrt());
    let share = returns.iter().flatten().map(|value| is_poor(*value)).sum::<f64>() / count;
    Some(returns.iter().map(|value| value.map_or(0.0, |value| -k * (is_poor(value) - share))).collect())
}

/// Adds each rollout's price to the advantages of its decisions.
pub(super) fn charge(
    advantages: &mut [Advantages],
    steps: &[Step],
    prices: &[f64],
    termination: Termination,
) {
    let mut prices = prices.iter();
    let mut price = prices.next();
    for (row, (to, step)) in advantages.iter_mut().zip(steps).enumerate() {
        let added = *price.expect("each rollout has a price");
        to.action += added;
        if step.drawn {
            to.draw += added;
        }
        if step.last {
            price = prices.next();
        } else {
            let ended = f64::from(steps[row + 1].drawn);
            to.end += added * (ended - termination.probability()) / termination.slope();
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// Rollouts of these rewards, all whole but for those that ended early.
    fn rollouts(rewards: &[(&[f64], bool)]) -> Experience {
        let mut experience = Experience::default();
        for (rewards, early) in rewards {
            let taken = |(t, reward): (usize, &f64)| Taken {
                drawn: t == 0,
                reward: *reward,
                last: t + 1 == rewards.len(),
            };
            experience.steps.extend(rewards.iter().enumerate().map(taken));
            let (observation, critic_input) = (Vec::new(), Vec::new());
            experience.ends.push(LastState::Cut { observation, critic_input, early: *early });
        }
        experience
    }

    #[test]
    fn poor_rollouts_pay_and_the_others_are_paid() {
        // Returns 3, 3, 3 and −1: mean 2, deviation √3; −1 is below 2 − √3 and above 2 − 2√3. The one cut short counts nowhere.
        let experience = rollouts(&[
            (&[1.0, 2.0], false),
            (&[3.0], false),
            (&[-9.0], true),
            (&[0.0, 3.0], false),
            (&[-1.0], false),
        ]);
        let prices =
            |alpha, discount| poor(&experience, Risk::NegativeTail { k: 4.0, alpha }, discount).unwrap();
        assert_eq!(prices(2.0, 1.0), [0.0; 5]);
        assert_eq!(prices(1.0, 1.0), [1.0, 1.0, 0.0, 1.0, -3.0]);
        // With the discount ½ they are 2, 3, 1.5 and −1: mean 1.375, deviation 1.47; again −1 alone is poor. With 0 they are 1, 3,
        // 0 and −1: mean ¾, deviation 1.48, and still −1 < −0.73; but 0.6 deviations below the mean is −0.14, and 0.4 is 0.16.
        assert_eq!(prices(1.0, 0.5), [1.0, 1.0, 0.0, 1.0, -3.0]);
        assert_eq!(prices(0.6, 0.0), [1.0, 1.0, 0.0, 1.0, -3.0]);
        assert_eq!(prices(0.4, 0.0), [2.0, 2.0, 0.0, -2.0, -2.0]);
        assert_eq!(prices(0.4, 1.0), [1.0, 1.0, 0.0, 1.0, -3.0]);
        assert_eq!(poor(&experience, Risk::Mean, 1.0), None);
    }

    #[test]
    fn every_decision_of_a_rollout_shares_in_its_price() {
        // ε = ¼: an end that happened counts (1 − ¼)·16/3 = 4, one that did not (0 − ¼)·16/3 = −4/3.
        let step = |drawn, last| Step { drawn, last, ..Step::default() };
        let steps = [step(true, false), step(false, false), step(true, true), step(true, true)];
        let mut advantages = [Advantages { action: 0.5, draw: 0.0, end: 1.0 }; 4];
        charge(&mut advantages, &steps, &[3.0, -6.0], Termination::lasting(3.0));
        let expected = [(3.5, 3.0, -3.0), (3.5, 0.0, 13.0), (3.5, 3.0, 1.0), (-5.5, -6.0, 1.0)];
        for (got, (action, draw, end)) in advantages.iter().zip(expected) {
            let differences = [got.action - action, got.draw - draw, got.end - end];
            assert!(differences.iter().all(|d| d.abs() < 1e-12), "{got:?}, expected {action} {draw} {end}");
        }
    }
}
