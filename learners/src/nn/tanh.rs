//! `tanh` over a slice, one vector register at a time. A loop over `f32::tanh` costs some twenty times as much and
//! would take most of a training step.

use rten_simd::functional::simd_map;
use rten_simd::{Isa, SimdOp, SimdUnaryOp};
use rten_vecmath::Tanh;

/// Replaces each value by its hyperbolic tangent, within 1e-6; NaN stays NaN. For use inside a vector operation, which
/// has already chosen the instruction set `isa`.
#[inline(always)]
pub(super) fn tanh_in_place<I: Isa>(isa: I, values: &mut [f32]) {
    simd_map(
        isa.f32(),
        values,
        #[inline(always)]
        |x| Tanh {}.eval(isa, x),
    );
}

/// [`tanh_in_place`] as a vector operation of its own.
pub(super) struct TanhOf<'a>(pub(super) &'a mut [f32]);

impl SimdOp for TanhOf<'_> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, isa: I) {
        tanh_in_place(isa, self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_agrees_with_the_c_library() {
        // Steps of 1/1024 through the curve, and every power of two from the subnormal numbers to saturation.
        let mut inputs: Vec<f32> = (-12_288..=12_288).map(|i| i as f32 / 1024.0).collect();
        inputs.extend((-149..128).flat_map(|e| [2.0_f32.powi(e), -2.0_f32.powi(e)]));
        inputs.extend([0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY]);
        let mut outputs = inputs.clone();
        TanhOf(&mut outputs).dispatch();
        for (x, y) in inputs.iter().zip(&outputs) {
            let exact = x.tanh();
            assert!((y - exact).abs() <= 1e-6 * exact.abs().max(1e-3), "tanh({x}) = {exact}, got {y}");
        }
    }

    #[test]
    fn every_length_is_covered_and_nan_is_kept() {
        for length in 0..40 {
            let mut values = vec![0.5_f32; length];
            TanhOf(&mut values).dispatch();
            assert!(values.iter().all(|y| (y - 0.462_117_16).abs() < 1e-6), "{length}: {values:?}");
        }
        let mut values = [f32::NAN, 1.0];
        TanhOf(&mut values).dispatch();
        assert!(values[0].is_nan() && values[1].is_finite(), "{values:?}");
    }
}
