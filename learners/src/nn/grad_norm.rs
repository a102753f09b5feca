//! Clipping of the gradient's length.

use rten_simd::{Isa, SimdOp};

/// Scales the parts of one gradient together so that their common Euclidean norm is at most `max_norm` (positive), and
/// returns the norm that they had. A norm that is NaN or infinite is returned too and leaves the parts as they are: the
/// caller must not take the step.
pub fn clip_grad_norm(parts: &mut [&mut [f32]], max_norm: f32) -> f32 {
    let squares: f64 = parts.iter().map(|part| SumOfSquares(part).dispatch()).sum();
    let norm = squares.sqrt();
    if norm.is_finite() && norm > f64::from(max_norm) {
        let factor = (f64::from(max_norm) / norm) as f32;
        parts.iter_mut().flat_map(|part| part.iter_mut()).for_each(|g| *g *= factor);
    }
    norm as f32
}

/// Summed in double precision, in sixteen partial sums whose order does not depend on the processor.
struct SumOfSquares<'a>(&'a [f32]);

impl SimdOp for SumOfSquares<'_> {
    type Output = f64;

    #[inline(always)]
    fn eval<I: Isa>(self, _isa: I) -> f64 {
        let mut sums = [0.0_f64; 16];
        let (chunks, rest) = self.0.as_chunks::<16>();
        for chunk in chunks {
            for (sum, &g) in sums.iter_mut().zip(chunk) {
                *sum += f64::from(g) * f64::from(g);
            }
        }
        let rest: f64 = rest.iter().map(|&g| f64::from(g) * f64::from(g)).sum();
        sums.iter().sum::<f64>() + rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_scaled_together() {
        // √(1² + 2² + 2² + 4²) = 5; scaled by 2.5/5.
        let (mut a, mut b) = ([1.0, 2.0], [2.0, 4.0]);
        assert_eq!(clip_grad_norm(&mut [&mut a, &mut b], 2.5), 5.0);
        assert_eq!((a, b), ([0.5, 1.0], [1.0, 2.0]));
    }

    #[test]
    fn a_short_gradient_is_left_alone() {
        let mut gradient = [3.0, 4.0];
        assert_eq!(clip_grad_norm(&mut [&mut gradient], 5.0), 5.0);
        assert_eq!(gradient, [3.0, 4.0]);
        assert_eq!(clip_grad_norm(&mut [], 5.0), 0.0);
    }

    #[test]
    fn the_whole_length_counts_and_squares_do_not_overflow() {
        // 37 numbers of 1e25: the norm is 1e25·√37 = 6.0827625e25, whose square single precision cannot hold.
        let mut gradient = [1e25_f32; 37];
        let norm = clip_grad_norm(&mut [&mut gradient], 1.0);
        assert!((norm / 6.082_762_5e25 - 1.0).abs() < 1e-6, "{norm}");
        assert!((clip_grad_norm(&mut [&mut gradient], 2.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_gradient_that_is_not_finite_is_reported_and_left_alone() {
        let mut gradient = [f32::NAN, 1e9];
        assert!(clip_grad_norm(&mut [&mut gradient], 1.0).is_nan());
        assert_eq!(gradient[1], 1e9);
        let mut gradient = [f32::INFINITY, 1e9];
        assert_eq!(clip_grad_norm(&mut [&mut gradient], 1.0), f32::INFINITY);
        assert_eq!(gradient[1], 1e9);
    }
}
