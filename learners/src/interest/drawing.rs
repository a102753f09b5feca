//! Which option is begun where: `π_I(o|s) = I_o(s) / Σ_o' I_o'(s)` (Eq. 6.3), for interests `I_o = exp z_o`.
//!
//! Interests are given as logarithms, which is what networks compute: so they are positive, and nothing overflows.

/// Writes `π_I(·|s)` for the log-interests `z` of one state; both of length `K`.
///
/// # Panics
/// When lengths differ.
pub fn probabilities(log_interests: &[f64], probabilities: &mut [f64]) {
    assert_eq!(probabilities.len(), log_interests.len(), "probabilities of options");
    let greatest = log_interests.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    for (p, z) in probabilities.iter_mut().zip(log_interests) {
        *p = (z - greatest).exp();
    }
    let total: f64 = probabilities.iter().sum();
    probabilities.iter_mut().for_each(|p| *p /= total);
}

/// `log π_I(o|s)`, and writes its derivatives by the log-interests, `1[o' = o] − π_I(o'|s)`. (By the interests
/// themselves they are `1[o' = o] / I_o − 1 / Σ I`: the same over `I_o'`.)
///
/// # Panics
/// When lengths differ or there is no such option.
pub fn log_probability(log_interests: &[f64], option: usize, d_log_interests: &mut [f64]) -> f64 {
    probabilities(log_interests, d_log_interests);
    d_log_interests.iter_mut().for_each(|d| *d = -*d);
    d_log_interests[option] += 1.0;
    // Not the logarithm of the share, which may have underflowed.
    let greatest = log_interests.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = log_interests.iter().map(|z| (z - greatest).exp()).sum();
    log_interests[option] - greatest - total.ln()
}

/// `p̄ = Σ_s π_I(·|s) / n`: how often each option is drawn in the mean over some states. The table of log-interests has one row of
/// `options` numbers a state.
///
/// # Panics
/// When its length is no multiple of `options`.
pub fn usage(log_interests: &[f64], options: usize) -> Vec<f64> {
    assert!(log_interests.len().is_multiple_of(options), "log-interests of options");
    let states = (log_interests.len() / options) as f64;
    let (mut means, mut shares) = (vec![0.0; options], vec![0.0; options]);
    for z in log_interests.chunks_exact(options) {
        probabilities(z, &mut shares);
        means.iter_mut().zip(&shares).for_each(|(mean, p)| *mean += p / states);
    }
    means
}

/// `H(p̄) = −Σ_o p̄_o log p̄_o`, the entropy in nats of how often each option is drawn on the whole. It is greatest when all options
/// are drawn alike *on the whole*, also when each state has its own: an entropy state by state would ask for the opposite of that.
///
/// Writes its derivatives by the log-interests `z` of one of the `n` states that `usage` is the mean over, times `n`:
/// `−π_j(s) (log p̄_j − Σ_o π_o(s) log p̄_o)`.
///
/// # Panics
/// When lengths differ.
pub fn diversity(usage: &[f64], log_interests: &[f64], d_log_interests: &mut [f64]) -> f64 {
    probabilities(log_interests, d_log_interests);
    // An option that is drawn nowhere would have the logarithm −∞.
    let logarithms: Vec<f64> = usage.iter().map(|mean| mean.max(f64::MIN_POSITIVE).ln()).collect();
    let expected = state_value(d_log_interests, &logarithms);
    d_log_interests.iter_mut().zip(&logarithms).for_each(|(p, log)| *p *= expected - log);
    -state_value(usage, &logarithms)
}

/// `V(s) = Σ_o π_I(o|s) Q(s,o)`.
///
/// # Panics
/// When lengths differ.
pub fn state_value(probabilities: &[f64], option_values: &[f64]) -> f64 {
    assert_eq!(option_values.len(), probabilities.len(), "values of options");
    probabilities.iter().zip(option_values).map(|(p, q)| p * q).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::reference;

    #[test]
    fn probabilities_are_shares_of_the_interest() {
        // I = 1, 2, 5: shares 1/8, 2/8, 5/8; Q = 8, 4, −8: V = 1 + 1 − 5 = −3.
        let log_interests = [1.0_f64, 2.0, 5.0].map(f64::ln);
        let mut shares = [0.0; 3];
        probabilities(&log_interests, &mut shares);
        for (share, expected) in shares.iter().zip([0.125, 0.25, 0.625]) {
            assert!((share - expected).abs() < 1e-15, "{shares:?}");
        }
        assert!((state_value(&shares, &[8.0, 4.0, -8.0]) + 3.0).abs() < 1e-14);
        // A common factor of all interests, even one beyond every float, changes nothing.
        let mut scaled = [0.0; 3];
        probabilities(&log_interests.map(|z| z + 1000.0), &mut scaled);
        for (a, b) in scaled.iter().zip(shares) {
            assert!((a - b).abs() < 1e-12);
        }
    }

    #[test]
    fn the_gradient_of_a_log_probability_is_that_worked_out_by_hand() {
        // I = 1, 2, 5, option 1: log ¼; derivatives 0 − 1/8, 1 − 1/4, 0 − 5/8.
        let log_interests = [1.0_f64, 2.0, 5.0].map(f64::ln);
        let mut derivatives = [0.0; 3];
        let log_probability = log_probability(&log_interests, 1, &mut derivatives);
        assert!((log_probability - 0.25_f64.ln()).abs() < 1e-15);
        // An option that is never drawn still has a logarithm.
        assert!((super::log_probability(&[0.0, -1000.0], 1, &mut [0.0; 2]) + 1000.0).abs() < 1e-12);
        for (got, expected) in derivatives.iter().zip([-0.125, 0.75, -0.625]) {
            assert!((got - expected).abs() < 1e-15, "{derivatives:?}");
        }
    }

    #[test]
    fn the_gradient_agrees_with_finite_differences() {
        let point = [0.3, -1.2, 0.8, 2.0];
        for option in 0..4 {
            let mut derivatives = [0.0; 4];
            log_probability(&point, option, &mut derivatives);
            let exact =
                reference::differences(&point, &[0, 1, 2, 3], |z| log_probability(z, option, &mut [0.0; 4]));
            for (got, expected) in derivatives.iter().zip(exact) {
                assert!((got - expected).abs() < 1e-9, "{got} against {expected}");
            }
        }
    }

    /// The diversity of a table, and its derivatives.
    fn diversity_of(log_interests: &[f64], options: usize) -> (f64, Vec<f64>) {
        let usage = usage(log_interests, options);
        let mut derivatives = vec![0.0; log_interests.len()];
        let states = (log_interests.len() / options) as f64;
        let mut found = 0.0;
        for (z, d) in log_interests.chunks_exact(options).zip(derivatives.chunks_exact_mut(options)) {
            found = diversity(&usage, z, d);
            d.iter_mut().for_each(|d| *d /= states);
        }
        (found, derivatives)
    }

    #[test]
    fn diversity_is_of_the_mean_over_states() {
        let sure = 1000.0;
        // Two states, each with an option of its own: ln 2. One option everywhere: 0. Uniform everywhere: ln 2.
        for (log_interests, expected) in
            [([sure, 0.0, 0.0, sure], 2.0_f64.ln()), ([sure, 0.0, sure, 0.0], 0.0), ([0.0; 4], 2.0_f64.ln())]
        {
            let (got, derivatives) = diversity_of(&log_interests, 2);
            assert!((got - expected).abs() < 1e-12, "{got} of {log_interests:?}");
            assert!(derivatives.iter().all(|d| d.abs() < 1e-12), "{derivatives:?} is no extremum");
        }
    }

    #[test]
    fn the_gradient_of_diversity_agrees_with_finite_differences() {
        let point = [0.3, -1.2, 0.8, 2.0, 0.1, -0.4];
        let (_, derivatives) = diversity_of(&point, 3);
        let exact = reference::differences(&point, &[0, 1, 2, 3, 4, 5], |z| diversity_of(z, 3).0);
        for (got, expected) in derivatives.iter().zip(exact) {
            assert!((got - expected).abs() < 1e-9, "{got} against {expected}");
        }
    }
}
