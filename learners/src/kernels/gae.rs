//! Generalised advantage estimation (Schulman et al. 2016), with the two ends of an episode kept apart.

/// What stood at the end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepEnd {
    /// The episode goes on with the next step.
    Running,
    /// The task ended the episode. Nothing can be earned after this, so the value beyond is zero.
    Terminated,
    /// The episode was cut short, by a time limit for instance. More could have been earned.
    Truncated {
        /// The critic's value of the last observation of the episode that was cut (not of the next episode's first).
        final_value: f32,
    },
}

/// Consecutive steps of one environment; episodes may end anywhere within. All slices have length `T`.
#[derive(Clone, Copy, Debug)]
pub struct Trajectory<'a> {
    /// `r_t`, the reward of step `t`.
    pub rewards: &'a [f32],
    /// `V(s_t)`, the critic's value of the observation in which step `t` was taken.
    pub values: &'a [f32],
    /// How step `t` ended.
    pub ends: &'a [StepEnd],
    /// `V(s_T)`, the critic's value of the observation after the last step. Not used when that step ended an episode.
    pub value_after: f32,
}

/// Discounting of advantages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Discount {
    /// Discount of rewards per step, in [0, 1].
    pub gamma: f64,
    /// Decay λ of the estimate, in [0, 1]: 0 trusts the critic one step ahead, 1 the rewards to the episode's end.
    pub lambda: f64,
}

/// Writes the `T` advantages `A_t = δ_t + γλ A_{t+1}`, `δ_t = r_t + γ V(s_{t+1}) − V(s_t)`. At a step that ends an
/// episode the sum stops, and `V(s_{t+1})` is zero if it terminated, `final_value` if it was truncated.
///
/// Sums are in double precision.
///
/// # Panics
/// When lengths differ.
pub fn gae(trajectory: &Trajectory<'_>, discount: Discount, advantages: &mut [f32]) {
    let Trajectory { rewards, values, ends, value_after } = *trajectory;
    assert_eq!(values.len(), rewards.len(), "values of a trajectory");
    assert_eq!(ends.len(), rewards.len(), "ends of a trajectory");
    assert_eq!(advantages.len(), rewards.len(), "advantages of a trajectory");
    let Discount { gamma, lambda } = discount;
    let mut value_next = f64::from(value_after);
    let mut advantage = 0.0;
    for t in (0..rewards.len()).rev() {
        let (value_beyond, advantage_beyond) = match ends[t] {
            StepEnd::Running => (value_next, advantage),
            StepEnd::Terminated => (0.0, 0.0),
            StepEnd::Truncated { final_value } => (f64::from(final_value), 0.0),
        };
        let value = f64::from(values[t]);
        let delta = f64::from(rewards[t]) + gamma * value_beyond - value;
        advantage = delta + gamma * lambda * advantage_beyond;
        advantages[t] = advantage as f32;
        value_next = value;
    }
}

/// Writes the critic's targets, `A_t + V(s_t)`: estimates of the discounted return from `s_t` on.
///
/// # Panics
/// When lengths differ.
pub fn value_targets(advantages: &[f32], values: &[f32], targets: &mut [f32]) {
    assert_eq!(values.len(), advantages.len(), "values for targets");
    assert_eq!(targets.len(), advantages.len(), "targets");
    for ((target, advantage), value) in targets.iter_mut().zip(advantages).zip(values) {
        *target = advantage + value;
    }
}

/// Shifts and scales advantages to mean 0 and standard deviation 1 (of the batch itself, with divisor `n`). Of fewer
/// than two, or of equal ones, only the mean is taken away.
pub fn normalize(advantages: &mut [f32]) {
    let count = advantages.len() as f64;
    let mean = advantages.iter().map(|&a| f64::from(a)).sum::<f64>() / count;
    let variance = advantages.iter().map(|&a| (f64::from(a) - mean).powi(2)).sum::<f64>() / count;
    let inverse = 1.0 / (variance.sqrt() + 1e-8);
    advantages.iter_mut().for_each(|a| *a = ((f64::from(*a) - mean) * inverse) as f32);
}

#[cfg(test)]
mod tests {
    use super::*;

    const DISCOUNT: Discount = Discount { gamma: 0.5, lambda: 0.5 };

    fn advantages(ends: &[StepEnd], value_after: f32) -> Vec<f32> {
        let mut advantages = vec![f32::NAN; 3];
        let trajectory =
            Trajectory { rewards: &[1.0, 2.0, 3.0], values: &[4.0, 5.0, 6.0], ends, value_after };
        gae(&trajectory, DISCOUNT, &mut advantages);
        advantages
    }

    #[test]
    fn an_episode_that_goes_on_is_bootstrapped_from_the_value_after_it() {
        // γ = λ = ½, r = 1 2 3, V = 4 5 6 and 8 after.
        // δ₂ = 3 + ½·8 − 6 = 1,      A₂ = 1
        // δ₁ = 2 + ½·6 − 5 = 0,      A₁ = 0 + ¼·1 = 0.25
        // δ₀ = 1 + ½·5 − 4 = −0.5,   A₀ = −0.5 + ¼·0.25 = −0.4375
        assert_eq!(advantages(&[StepEnd::Running; 3], 8.0), [-0.4375, 0.25, 1.0]);
    }

    #[test]
    fn termination_has_no_value_beyond_it_and_stops_the_sum() {
        // As above, but step 1 terminates: δ₁ = 2 − 5 = −3 = A₁, A₀ = −0.5 + ¼·(−3) = −1.25. A₂ is the next episode's.
        let ends = [StepEnd::Running, StepEnd::Terminated, StepEnd::Running];
        assert_eq!(advantages(&ends, 8.0), [-1.25, -3.0, 1.0]);
    }

    #[test]
    fn truncation_is_bootstrapped_from_the_final_observation_and_stops_the_sum() {
        // Step 1 is cut with V = 10 there: δ₁ = 2 + ½·10 − 5 = 2 = A₁, A₀ = −0.5 + ¼·2 = 0. Neither sees V₂ or A₂.
        let ends = [StepEnd::Running, StepEnd::Truncated { final_value: 10.0 }, StepEnd::Running];
        assert_eq!(advantages(&ends, 8.0), [0.0, 2.0, 1.0]);
    }

    #[test]
    fn the_value_after_is_not_used_when_the_last_step_ended() {
        // A₂ = 3 − 6 = −3; then A₁ = 0 + ¼·(−3) = −0.75, A₀ = −0.5 + ¼·(−0.75) = −0.6875.
        let ends = [StepEnd::Running, StepEnd::Running, StepEnd::Terminated];
        assert_eq!(advantages(&ends, f32::NAN), [-0.6875, -0.75, -3.0]);
        // Cut with V = 8 there, it is as if the episode went on to that value.
        let ends = [StepEnd::Running, StepEnd::Running, StepEnd::Truncated { final_value: 8.0 }];
        assert_eq!(advantages(&ends, f32::NAN), advantages(&[StepEnd::Running; 3], 8.0));
    }

    #[test]
    fn with_lambda_one_the_targets_are_discounted_returns() {
        // γ = ½, r = 1 2 3, terminated: returns 1 + ½·(2 + ½·3) = 2.75, 3.5, 3, whatever the critic says.
        let values = [4.0, 5.0, 6.0];
        let ends = [StepEnd::Running, StepEnd::Running, StepEnd::Terminated];
        let trajectory =
            Trajectory { rewards: &[1.0, 2.0, 3.0], values: &values, ends: &ends, value_after: 0.0 };
        let (mut advantages, mut targets) = ([0.0; 3], [0.0; 3]);
        gae(&trajectory, Discount { gamma: 0.5, lambda: 1.0 }, &mut advantages);
        value_targets(&advantages, &values, &mut targets);
        assert_eq!(targets, [2.75, 3.5, 3.0]);
    }

    #[test]
    fn normalised_advantages_have_mean_zero_and_deviation_one() {
        // Mean 3, squared differences 4 0 4, variance 8/3, deviation 1.6329932: ±2/1.6329932 = ±1.2247449.
        let mut advantages = [1.0, 3.0, 5.0];
        normalize(&mut advantages);
        assert!((advantages[0] + 1.224_744_9).abs() < 1e-6, "{advantages:?}");
        assert_eq!(advantages[1], 0.0);
        assert!((advantages[2] - 1.224_744_9).abs() < 1e-6, "{advantages:?}");
        let mut equal = [2.5; 4];
        normalize(&mut equal);
        assert_eq!(equal, [0.0; 4]);
        normalize(&mut []);
    }
}
