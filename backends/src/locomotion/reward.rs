//! The reward terms of Roboschool's walkers, as the paper uses them (§5.1, Eq. 5.1), priced by the task.

/// Name and weight of each reward term, in the order in which a step reports them; without a weight the task's
/// [`ELECTRICITY_COST`] is paid.
///
/// 1. `alive`: +1 while the robot stands, else -1 (and the episode ends).
/// 2. `progress`: forward speed of the progress points towards the target, in m/s.
/// 3. `electricity`: mean over the joints of `|a · 0.1 q̇|`, with the action before clamping and the velocity after the
///    step in rad/s.
/// 4. `stall`: mean over the joints of `a²`.
/// 5. `joints_at_limit`: how many joints are in the outer 0.5 % of their range at either end, or beyond.
/// 6. `feet_collision`: feet that touch something other than the floor; there is nothing else to touch, so 0.
pub const TERMS: [(&str, Option<f64>); 6] = [
    ("alive", Some(1.0)),
    ("progress", Some(1.0)),
    ("electricity", None),
    ("stall", Some(-0.1)),
    ("joints_at_limit", Some(-0.2)),
    ("feet_collision", Some(-1.0)),
];

/// The task parameter that prices `electricity`: the paper's `e_cost`.
pub const ELECTRICITY_COST: &str = "electricity_cost";

/// The dearest electricity that a task may have; the paper's is -2.4.
pub const DEAREST_ELECTRICITY: f64 = -10.0;

/// A lower bound on a step's reward. Random torques earn about -1.5 a step on average at the default price, and at the
/// dearest one single steps were seen to earn -14.
pub const FLOOR: f64 = -50.0;

/// Where the robot should go: so far ahead that progress is the forward speed.
pub const TARGET: [f64; 2] = [1000.0, 0.0];

/// Normalised joint positions beyond this count as at the limit.
const AT_LIMIT: f64 = 0.99;

/// The progress potential `Φ`: minus the distance (m) from `place` to [`TARGET`] over the control step (s), so that
/// `Φ' - Φ` is a speed in m/s.
pub fn potential(place: [f64; 2], control_step: f64) -> f64 {
    -(TARGET[0] - place[0]).hypot(TARGET[1] - place[1]) / control_step
}

/// `mean |a · 0.1 q̇|`; 0 without joints.
pub fn electricity(action: &[f32], velocities: &[f64]) -> f64 {
    let powers = action.iter().zip(velocities).map(|(&a, v)| (f64::from(a) * 0.1 * v).abs());
    powers.sum::<f64>() / action.len().max(1) as f64
}

/// `mean a²`; 0 without joints.
pub fn stall(action: &[f32]) -> f64 {
    action.iter().map(|&a| f64::from(a) * f64::from(a)).sum::<f64>() / action.len().max(1) as f64
}

/// How many joints are at a limit, given their normalised positions (-1 and 1 are the limits).
pub fn joints_at_limit(normalised: impl Iterator<Item = f64>) -> f64 {
    normalised.filter(|x| x.abs() > AT_LIMIT).count() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn electricity_is_the_mean_of_a_tenth_of_the_absolute_power() {
        // (|1 * 0.1 * 20| + |-2 * 0.1 * 5| + |0.5 * 0.1 * -4|) / 3 = (2 + 1 + 0.2) / 3
        assert!((electricity(&[1.0, -2.0, 0.5], &[20.0, 5.0, -4.0]) - 3.2 / 3.0).abs() < 1e-15);
        // (1 + 4 + 0.25) / 3
        assert!((stall(&[1.0, -2.0, 0.5]) - 1.75).abs() < 1e-15);
    }

    #[test]
    fn limits_count_from_ninety_nine_hundredths_outwards() {
        assert_eq!(joints_at_limit([0.99, 0.9901, -0.9901, 3.0, 0.0].into_iter()), 3.0);
    }

    #[test]
    fn progress_is_speed_towards_the_target() {
        // 1 cm forward in 0.0165 s; sideways motion by 1 m changes a distance of 1000 m by half a millimetre.
        let step = 0.0165;
        let ahead = potential([0.01, 0.0], step) - potential([0.0, 0.0], step);
        assert!((ahead - 0.01 / step).abs() < 1e-9, "{ahead}");
        let aside = potential([0.0, 1.0], step) - potential([0.0, 0.0], step);
        assert!((aside + 0.0005 / step).abs() < 1e-7, "{aside}");
    }
}
