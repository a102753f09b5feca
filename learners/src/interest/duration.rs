//! How long options last: the probability `ε` of ending after each action, learned as its logit `x`, and the cost `φ` of
//! durations outside a band (Eq. 6.6).
//!
//! `ρ = (1 − ε)/ε` is `e^{−x}`, which makes the derivatives by the logit short: `dε/dx = ε(1 − ε)`, `dρ/dx = −ρ`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `ε` in (0, 1), as its logit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Termination {
    /// `x = log ε − log(1 − ε)`.
    pub logit: f64,
}

impl Termination {
    /// Options that continue `continuations > 0` times on average.
    pub fn lasting(continuations: f64) -> Self {
        Self { logit: -continuations.ln() }
    }

    /// `ε`.
    pub fn probability(self) -> f64 {
        1.0 / (1.0 + (-self.logit).exp())
    }

    /// `dε/dx = ε(1 − ε)`.
    pub fn slope(self) -> f64 {
        self.probability() * (1.0 - self.probability())
    }

    /// `ρ = (1 − ε)/ε`: how often an option continues on average. It takes one action more, `1/ε`.
    pub fn continuations(self) -> f64 {
        (-self.logit).exp()
    }
}

/// The mean numbers of continuations, `[ρ_min, ρ_max]`, that cost nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Band {
    /// `ρ_min`; 0 for none.
    pub low: f64,
    /// `ρ_max`; equal to `ρ_min` for the paper's `φ`.
    pub high: f64,
}

impl Default for Band {
    fn default() -> Self {
        Self { low: 5.0, high: 50.0 }
    }
}

impl Band {
    /// `φ`: the squared distance of `ρ` from the band.
    pub fn cost(self, termination: Termination) -> f64 {
        self.excess(termination).powi(2)
    }

    /// `dφ/dx = −2 (ρ − edge) ρ`; in terms of `ε`, `dφ/dε = −2 (ρ − edge)/ε²`.
    pub fn d_cost(self, termination: Termination) -> f64 {
        -2.0 * self.excess(termination) * termination.continuations()
    }

    /// `ρ` less the edge that it is beyond.
    fn excess(self, termination: Termination) -> f64 {
        let continuations = termination.continuations();
        continuations - continuations.clamp(self.low, self.high)
    }
}

/// The termination part of the gradient for options that have just acted by `old`: the derivative by the logit of
/// `(ε − ε_old) · advantage`, where `advantage` is what `ε` is worth, `dV/dε`. As in Eq. 2.4 there is no reward for
/// moving further once ending or continuing has become `clip` more or less likely than it was.
pub fn clipped_end(termination: Termination, old: Termination, advantage: f64, clip: f64) -> f64 {
    let (now, before) = (termination.probability(), old.probability());
    let within = |now: f64, before: f64, gain: f64| {
        let ratio = now / before;
        if gain > 0.0 { ratio <= 1.0 + clip } else { ratio >= 1.0 - clip }
    };
    let free = within(now, before, advantage) && within(1.0 - now, 1.0 - before, -advantage);
    if free { termination.slope() * advantage } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::reference;

    /// `ε = 1/5`: four continuations, five actions.
    fn fifth() -> Termination {
        Termination::lasting(4.0)
    }

    #[test]
    fn probability_and_duration_are_those_worked_out_by_hand() {
        assert!((fifth().probability() - 0.2).abs() < 1e-15);
        assert!((fifth().slope() - 0.16).abs() < 1e-15);
        assert!((fifth().continuations() - 4.0).abs() < 1e-14);
        assert_eq!(Termination { logit: 0.0 }.probability(), 0.5);
    }

    #[test]
    fn the_cost_is_the_squared_distance_from_the_band() {
        // ρ = 4: band [6, 9] is missed by −2, [1, 3] by 1, [2, 5] not at all; dφ/dx = −2 · excess · 4.
        for (low, high, cost, d_cost) in [(6.0, 9.0, 4.0, 16.0), (1.0, 3.0, 1.0, -8.0), (2.0, 5.0, 0.0, 0.0)]
        {
            let band = Band { low, high };
            assert!((band.cost(fifth()) - cost).abs() < 1e-12);
            assert!((band.d_cost(fifth()) - d_cost).abs() < 1e-12);
        }
        // A band of no width is Eq. 6.6: (7 − 4)² = 9; dφ/dε = 2 · 3 / 0.04 = 150, dφ/dx = 150 · 0.16 = 24.
        let paper = Band { low: 7.0, high: 7.0 };
        assert!((paper.cost(fifth()) - 9.0).abs() < 1e-12);
        assert!((paper.d_cost(fifth()) - 24.0).abs() < 1e-12);
    }

    #[test]
    fn derivatives_agree_with_finite_differences() {
        let band = Band { low: 2.0, high: 6.0 };
        for logit in [-3.0, -2.2, -1.0, -0.2, 1.5] {
            let termination = Termination { logit };
            let slope = reference::differences(&[logit], &[0], |x| Termination { logit: x[0] }.probability());
            assert!((termination.slope() - slope[0]).abs() < 1e-9);
            let d_cost = reference::differences(&[logit], &[0], |x| band.cost(Termination { logit: x[0] }));
            let error = (band.d_cost(termination) - d_cost[0]).abs();
            assert!(error <= 1e-7 * d_cost[0].abs().max(1.0), "{error} at {logit}");
        }
    }

    #[test]
    fn an_end_is_moved_no_further_than_the_clip() {
        // ε = 0.2, clip 0.25: ε may rise to 0.25 and fall to 0.15; 1 − ε stays well within its bounds.
        let at = |probability: f64| Termination::lasting((1.0 - probability) / probability);
        assert!((clipped_end(fifth(), fifth(), 3.0, 0.25) - 0.48).abs() < 1e-14);
        assert!((clipped_end(fifth(), fifth(), -3.0, 0.25) + 0.48).abs() < 1e-14);
        for (probability, advantage, free) in [
            (0.24, 1.0, true),
            (0.26, 1.0, false),
            (0.26, -1.0, true),
            (0.16, -1.0, true),
            (0.14, -1.0, false),
        ] {
            let gradient = clipped_end(at(probability), fifth(), advantage, 0.25);
            assert_eq!(gradient != 0.0, free, "{probability} {advantage}");
        }
        // Where options nearly always end, continuing is what bounds: 1 − ε from 0.2 may fall to 0.15 and rise to 0.25.
        assert_eq!(clipped_end(at(0.86), at(0.8), 1.0, 0.25), 0.0);
        assert_eq!(clipped_end(at(0.74), at(0.8), -1.0, 0.25), 0.0);
        assert!(clipped_end(at(0.84), at(0.8), 1.0, 0.25) > 0.0);
    }
}
