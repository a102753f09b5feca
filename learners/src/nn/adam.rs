//! The Adam optimiser (Kingma & Ba 2015, Algorithm 1).

use rten_simd::{Isa, SimdOp};
use serde::{Deserialize, Serialize};

/// Decay rate of the running mean of the gradient.
const BETA1: f64 = 0.9;

/// Decay rate of the running mean of the squared gradient.
const BETA2: f64 = 0.999;

/// What bounds the step of numbers whose gradient is nearly zero: that of the usual PPO programs; the optimiser's own paper has 1e-8.
const EPSILON: f64 = 1e-5;

/// Adam with β₁ = 0.9, β₂ = 0.999 and ε = 1e-5, over one flat parameter vector. Each number is treated alone, so several
/// vectors may share a schedule and have an optimiser each.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    state: AdamState,
}

/// What a checkpoint must keep of an [`Adam`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdamState {
    /// Steps taken.
    pub steps: u64,
    /// Running means of the gradient.
    pub first_moments: Vec<f32>,
    /// Running means of the squared gradient.
    pub second_moments: Vec<f32>,
}

/// A state whose two moment vectors differ in length.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("an Adam state has {first} first moments but {second} second moments")]
pub struct AdamStateError {
    /// Length of the first moments.
    pub first: usize,
    /// Length of the second moments.
    pub second: usize,
}

impl Adam {
    /// For `parameters` numbers.
    pub fn new(parameters: usize) -> Self {
        let zeros = vec![0.0; parameters];
        let state = AdamState { steps: 0, first_moments: zeros.clone(), second_moments: zeros };
        Self { state }
    }

    /// Goes on from a checkpoint.
    ///
    /// # Errors
    /// When the two moment vectors differ in length.
    pub fn from_state(state: AdamState) -> Result<Self, AdamStateError> {
        let (first, second) = (state.first_moments.len(), state.second_moments.len());
        if first == second { Ok(Self { state }) } else { Err(AdamStateError { first, second }) }
    }

    /// What to keep in a checkpoint.
    pub fn state(&self) -> &AdamState {
        &self.state
    }

    /// Moves `params` against `gradient`: `p −= rate · m̂ / (√v̂ + ε)`. The corrections for the zero start of the running
    /// means are computed in double precision: near one, `1 − βᵗ` has too few digits in single.
    ///
    /// A gradient that is not finite spoils the state; look at what [`super::clip_grad_norm`] returns first.
    ///
    /// # Panics
    /// When a length is not the one that the optimiser was made for.
    pub fn step(&mut self, params: &mut [f32], gradient: &[f32], rate: f64) {
        let state = &mut self.state;
        assert_eq!(params.len(), state.first_moments.len(), "number of parameters of an Adam optimiser");
        assert_eq!(gradient.len(), params.len(), "length of a gradient");
        state.steps += 1;
        let steps = i32::try_from(state.steps).unwrap_or(i32::MAX);
        let correction1 = 1.0 - BETA1.powi(steps);
        let correction2 = 1.0 - BETA2.powi(steps);
        let factors = Factors {
            keep1: BETA1 as f32,
            add1: (1.0 - BETA1) as f32,
            keep2: BETA2 as f32,
            add2: (1.0 - BETA2) as f32,
            rate: (rate / correction1) as f32,
            scale2: (1.0 / correction2.sqrt()) as f32,
            epsilon: EPSILON as f32,
        };
        let (first, second) = (&mut state.first_moments, &mut state.second_moments);
        Update { params, gradient, first, second, factors }.dispatch();
    }
}

struct Factors {
    keep1: f32,
    add1: f32,
    keep2: f32,
    add2: f32,
    rate: f32,
    scale2: f32,
    epsilon: f32,
}

/// Numbers updated at a time: a few vector registers of each kind, all read before any is written, because otherwise the
/// time depends on where the four vectors lie in memory.
const BLOCK: usize = 32;

impl Factors {
    #[inline(always)]
    fn update(&self, p: f32, g: f32, m: f32, v: f32) -> (f32, f32, f32) {
        let m = self.keep1 * m + self.add1 * g;
        let v = self.keep2 * v + self.add2 * (g * g);
        (p - self.rate * m / (v.sqrt() * self.scale2 + self.epsilon), m, v)
    }

    #[inline(always)]
    fn update_block(
        &self,
        mut p: [f32; BLOCK],
        g: [f32; BLOCK],
        mut m: [f32; BLOCK],
        mut v: [f32; BLOCK],
    ) -> ([f32; BLOCK], [f32; BLOCK], [f32; BLOCK]) {
        for i in 0..BLOCK {
            (p[i], m[i], v[i]) = self.update(p[i], g[i], m[i], v[i]);
        }
        (p, m, v)
    }
}

struct Update<'a> {
    params: &'a mut [f32],
    gradient: &'a [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
    factors: Factors,
}

impl SimdOp for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, _isa: I) {
        let Self { params, gradient, first, second, factors } = self;
        let (params, params_rest) = params.as_chunks_mut::<BLOCK>();
        let (gradient, gradient_rest) = gradient.as_chunks::<BLOCK>();
        let (first, first_rest) = first.as_chunks_mut::<BLOCK>();
        let (second, second_rest) = second.as_chunks_mut::<BLOCK>();
        for (((p, g), m), v) in params.iter_mut().zip(gradient).zip(first).zip(second) {
            (*p, *m, *v) = factors.update_block(*p, *g, *m, *v);
        }
        let moments = first_rest.iter_mut().zip(second_rest);
        for ((p, g), (m, v)) in params_rest.iter_mut().zip(gradient_rest).zip(moments) {
            (*p, *m, *v) = factors.update(*p, *g, *m, *v);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn two_steps_give_the_numbers_worked_out_by_hand() {
        // β₁ = 0.9, β₂ = 0.999, ε = 1e-5, rate 0.1, from p = 1.
        // Step 1, g = 0.5: m = 0.05, v = 0.00025; m̂ = 0.05/0.1 = 0.5, v̂ = 0.00025/0.001 = 0.25;
        //   p = 1 − 0.1·0.5/(0.5 + 1e-5) = 0.9000020.
        // Step 2, g = −1: m = 0.9·0.05 − 0.1 = −0.055, v = 0.999·0.00025 + 0.001 = 0.00124975;
        //   m̂ = −0.055/0.19 = −0.28947368, v̂ = 0.00124975/0.001999 = 0.62518759, √v̂ = 0.79068805;
        //   p = 0.9000020 + 0.1·0.28947368/0.79069805 = 0.9366117.
        let mut adam = Adam::new(1);
        let mut p = [1.0];
        adam.step(&mut p, &[0.5], 0.1);
        assert!((p[0] - 0.900_002).abs() < 2e-7, "{p:?}");
        adam.step(&mut p, &[-1.0], 0.1);
        assert!((p[0] - 0.936_611_7).abs() < 2e-7, "{p:?}");
        let state = adam.state();
        assert_eq!(state.steps, 2);
        assert!((state.first_moments[0] + 0.055).abs() < 1e-8, "{state:?}");
        assert!((state.second_moments[0] - 0.001_249_75).abs() < 1e-9, "{state:?}");
    }

    #[test]
    fn thousands_of_steps_stay_with_double_precision() {
        let gradient = |t: i32| (f64::from(t) * 0.7).sin() as f32;
        let (mut p, mut m, mut v) = (0.0_f64, 0.0_f64, 0.0_f64);
        let mut adam = Adam::new(20);
        let mut params = [0.0; 20];
        for t in 1..=3000 {
            adam.step(&mut params, &[gradient(t); 20], 1e-3);
            let g = f64::from(gradient(t));
            m = 0.9 * m + 0.1 * g;
            v = 0.999 * v + 0.001 * g * g;
            let (m_hat, v_hat) = (m / (1.0 - 0.9_f64.powi(t)), v / (1.0 - 0.999_f64.powi(t)));
            p -= 1e-3 * m_hat / (v_hat.sqrt() + 1e-5);
        }
        // The same for numbers in vector registers and for those left over at the end.
        for param in params {
            assert!((f64::from(param) - p).abs() < 1e-6, "{param} against {p}");
        }
    }

    #[test]
    fn going_on_from_a_stored_state_is_going_on() {
        let mut straight = Adam::new(3);
        let mut params = [1.0, 2.0, 3.0];
        straight.step(&mut params, &[0.1, -0.2, 0.3], 1e-2);
        let text = serde_json::to_string(straight.state()).unwrap();
        let mut resumed = Adam::from_state(serde_json::from_str(&text).unwrap()).unwrap();
        let mut resumed_params = params;
        straight.step(&mut params, &[0.3, 0.1, -0.7], 1e-2);
        resumed.step(&mut resumed_params, &[0.3, 0.1, -0.7], 1e-2);
        assert_eq!(params, resumed_params);
        assert_eq!(straight, resumed);
    }

    #[test]
    fn a_state_of_two_lengths_is_refused() {
        let state = AdamState { steps: 1, first_moments: vec![0.0; 2], second_moments: vec![0.0; 3] };
        assert_eq!(Adam::from_state(state), Err(AdamStateError { first: 2, second: 3 }));
    }
}
