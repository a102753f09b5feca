//! What the three kinds of decisions were worth: generalised advantage estimation over rollouts in which the running
//! option ends with probability `ε` after each action (Eq. 6.4, 6.5).
//!
//! What follows an action is worth `U = (1 − ε) Q + ε V`, with the luck of ending and of the next draw averaged out:
//!
//! ```text
//! A_action(t) = Σ_k (γλ)^k δ_{t+k},   δ_t = r_t + γ U(s_{t+1}, o_t) − Q(s_t, o_t)
//! A_draw(t)   = Q(s_t, o_t) − V(s_t) + λ A_action(t)
//! A_end(t)    = V(s_{t+1}) − Q(s_{t+1}, o_t) + λ (b − ε)/(ε(1 − ε)) A_action(t+1)
//! ```
//!
//! where `b` is 1 if the option ended in `s_{t+1}` and 0 if it went on. With `λ = 0` they are the advantages of the
//! critic alone. With `λ = 1` the gradient that they give has the right mean *whatever the critic says*: `U(s_{t+1}, o_t)`
//! is the mean of the next `Q` however wrong it is, and the last term of `A_end` has the mean of what the critic lacks. Where a rollout
//! is cut short, by its time limit too, there is nothing but the critic to say what would have followed: there its word counts for
//! all `λ`, with the weight that `γ` leaves it.

use super::duration::Termination;
use crate::kernels::gae::Discount;

/// What a critic says of a state in which option `o` could run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Values {
    /// `Q(s,o|τ)`.
    pub option: f64,
    /// `V(s|τ) = Σ_o' π_I(o'|s) Q(s,o'|τ)`.
    pub state: f64,
}

impl Values {
    /// `U(s,o|τ) = (1 − ε) Q(s,o|τ) + ε V(s|τ)`: the option has just acted and may end here.
    pub fn continuation(self, termination: Termination) -> f64 {
        let ending = termination.probability();
        (1.0 - ending) * self.option + ending * self.state
    }
}

/// One control step of the infant agent, by option `o_t`. Steps lie in order of time, rollout after rollout.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Step {
    /// Whether `o_t` was drawn in `s_t`, rather than continued.
    pub drawn: bool,
    /// `r_t`.
    pub reward: f64,
    /// `Q(s_t, o_t)` and `V(s_t)`.
    pub here: Values,
    /// `Q(s_{t+1}, o_t)` and `V(s_{t+1})`; zeros where the task ended the episode.
    pub after: Values,
    /// Whether the rollout ends with this step, by itself or because it was cut short.
    pub last: bool,
}

/// Advantages of the decisions of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Advantages {
    /// Of `a_t` over the mean of `π_{o_t}`.
    pub action: f64,
    /// Of having drawn `o_t` over the mean of `π_I`; 0 where nothing was drawn.
    pub draw: f64,
    /// Of ending in `s_{t+1}` over continuing there.
    pub end: f64,
}

/// Writes the advantages of `steps`. The last step must be the last of its rollout.
///
/// # Panics
/// When lengths differ.
pub fn advantages(
    steps: &[Step],
    termination: Termination,
    discount: Discount,
    advantages: &mut [Advantages],
) {
    assert_eq!(advantages.len(), steps.len(), "advantages of steps");
    debug_assert!(steps.last().is_none_or(|step| step.last), "a rollout that goes on beyond the steps");
    let Discount { gamma, lambda } = discount;
    let (ending, slope) = (termination.probability(), termination.slope());
    let mut later = (0.0, false);
    for (step, to) in steps.iter().zip(advantages).rev() {
        let (action_later, ended) = if step.last { (0.0, false) } else { later };
        let Values { option, state } = step.here;
        let delta = step.reward + gamma * step.after.continuation(termination) - option;
        let action = delta + gamma * lambda * action_later;
        let surprise = (f64::from(ended) - ending) / slope * action_later;
        *to = Advantages {
            action,
            draw: if step.drawn { option - state + lambda * action } else { 0.0 },
            end: step.after.state - step.after.option + lambda * surprise,
        };
        later = (action, step.drawn);
    }
}

/// What the critic should have said of `(s_t, o_t)`: `Q(s_t, o_t) + A_action(t)`, an estimate of the discounted return.
pub fn value_target(step: &Step, advantages: &Advantages) -> f64 {
    step.here.option + advantages.action
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `ε = ¼`.
    fn quarter() -> Termination {
        Termination::lasting(3.0)
    }

    fn steps() -> [Step; 3] {
        let values = |option, state| Values { option, state };
        [
            Step { drawn: true, reward: 1.0, here: values(4.0, 2.0), after: values(8.0, 4.0), last: false },
            Step { drawn: true, reward: 2.0, here: values(6.0, 4.0), after: values(0.0, 8.0), last: false },
            Step { drawn: false, reward: 3.0, here: values(0.0, 8.0), after: values(4.0, 8.0), last: true },
        ]
    }

    fn close(got: &[Advantages], expected: &[(f64, f64, f64)]) {
        for (got, &(action, draw, end)) in got.iter().zip(expected) {
            let difference = [got.action - action, got.draw - draw, got.end - end];
            assert!(difference.iter().all(|d| d.abs() < 1e-12), "{got:?}, expected {action} {draw} {end}");
        }
    }

    #[test]
    fn without_lambda_they_are_the_critics() {
        // γ = ½, U = ¾ Q + ¼ V: 7, 2, 5.
        // A_action: 1 + 3.5 − 4 = 0.5;  2 + 1 − 6 = −3;  3 + 2.5 − 0 = 5.5.
        // A_draw: 4 − 2, 6 − 4, none.   A_end: 4 − 8, 8 − 0, 8 − 4.
        let mut got = [Advantages::default(); 3];
        advantages(&steps(), quarter(), Discount { gamma: 0.5, lambda: 0.0 }, &mut got);
        close(&got, &[(0.5, 2.0, -4.0), (-3.0, 2.0, 8.0), (5.5, 0.0, 4.0)]);
    }

    #[test]
    fn with_lambda_the_rewards_that_followed_count_too() {
        // γ = ½, λ = 1, δ = 0.5, −3, 5.5:  A_action: 5.5;  −3 + 2.75 = −0.25;  0.5 − 0.125 = 0.375.
        // A_draw: 2 + 0.375, 2 − 0.25, none.
        // ε(1 − ε) = 3/16. After step 0 the option ended: (1 − ¼)·16/3 = 4, so A_end = −4 + 4·(−0.25) = −5.
        // After step 1 it went on: (0 − ¼)·16/3 = −4/3, so A_end = 8 − 4/3·5.5 = 2/3. After step 2 nothing is known.
        let mut got = [Advantages::default(); 3];
        advantages(&steps(), quarter(), Discount { gamma: 0.5, lambda: 1.0 }, &mut got);
        close(&got, &[(0.375, 2.375, -5.0), (-0.25, 1.75, 2.0 / 3.0), (5.5, 0.0, 4.0)]);
        assert_eq!(value_target(&steps()[0], &got[0]), 4.375);
    }

    #[test]
    fn nothing_passes_from_one_rollout_to_another() {
        let discount = Discount { gamma: 0.5, lambda: 1.0 };
        let twice = [steps(), steps()].concat();
        let (mut once, mut both) = ([Advantages::default(); 3], [Advantages::default(); 6]);
        advantages(&steps(), quarter(), discount, &mut once);
        advantages(&twice, quarter(), discount, &mut both);
        assert_eq!(both, [once, once].concat()[..]);
    }

    #[test]
    fn one_option_has_the_advantages_of_ordinary_gae() {
        use crate::kernels::gae::{StepEnd, Trajectory, gae};
        let rewards = [0.3_f32, -1.0, 2.0, 0.5];
        let values = [1.0_f32, 0.2, -0.7, 1.4];
        let ends = [StepEnd::Running, StepEnd::Terminated, StepEnd::Running, StepEnd::Running];
        let mut expected = [0.0; 4];
        let discount = Discount { gamma: 0.9, lambda: 0.8 };
        gae(
            &Trajectory { rewards: &rewards, values: &values, ends: &ends, value_after: 0.6 },
            discount,
            &mut expected,
        );

        let same = |value: f32| Values { option: f64::from(value), state: f64::from(value) };
        let after = [values[1], 0.0, values[3], 0.6];
        let steps: Vec<Step> = (0..4)
            .map(|t| Step {
                drawn: t % 2 == 0,
                reward: f64::from(rewards[t]),
                here: same(values[t]),
                after: same(after[t]),
                last: t % 2 == 1,
            })
            .collect();
        for logit in [-2.0, 0.0, 1.0] {
            let mut got = [Advantages::default(); 4];
            advantages(&steps, Termination { logit }, discount, &mut got);
            for (got, expected) in got.iter().zip(expected) {
                assert!((got.action - f64::from(expected)).abs() < 1e-6, "{got:?} against {expected}");
            }
        }
    }
}
