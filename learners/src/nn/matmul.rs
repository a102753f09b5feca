//! The one place that multiplies matrices.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// `out = left · right`, or `out += left · right`, on the calling thread. Matrices may be transposed views. Packing
/// buffers are kept per thread, so that repeated calls do not allocate.
///
/// # Panics
/// When the shapes do not fit.
pub(super) fn multiply(out: MatMut<'_, f32>, sum: Accum, left: MatRef<'_, f32>, right: MatRef<'_, f32>) {
    matmul(out, sum, left, right, 1.0, Par::Seq);
    clear_upper_halves();
}

/// The kernels of `matmul` leave the upper halves of the vector registers in use, and until they are cleared each instruction
/// without vectors waits for them on Intel's processors: what follows a product then takes up to twice as long.
#[cfg(target_arch = "x86_64")]
fn clear_upper_halves() {
    if std::arch::is_x86_feature_detected!("avx") {
        // SAFETY: the processor has the instruction, and compiled code keeps nothing in those halves across a call.
        unsafe { std::arch::x86_64::_mm256_zeroupper() };
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn clear_upper_halves() {}

/// `rows × cols` numbers, row after row, as a matrix.
pub(super) fn matrix(data: &[f32], rows: usize, cols: usize) -> MatRef<'_, f32> {
    MatRef::from_row_major_slice(data, rows, cols)
}

/// As [`matrix`], to be written.
pub(super) fn matrix_mut(data: &mut [f32], rows: usize, cols: usize) -> MatMut<'_, f32> {
    MatMut::from_row_major_slice_mut(data, rows, cols)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Three products of a layer's passes, all numbers `shift` places after the start of their allocation.
    fn layer_products(batch: usize, inputs: usize, outputs: usize, shift: usize) -> Vec<u32> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut random = |count: usize| -> Vec<f32> {
            let mut numbers = vec![0.0; shift];
            numbers.extend((0..count).map(|_| rng.random_range(-1.0_f32..1.0)));
            numbers
        };
        let (x, w, d) = (random(batch * inputs), random(inputs * outputs), random(batch * outputs));
        let (mut y, mut dw, mut dx) =
            (random(batch * outputs), random(inputs * outputs), random(batch * inputs));
        let x = matrix(&x[shift..], batch, inputs);
        let w = matrix(&w[shift..], inputs, outputs);
        let d = matrix(&d[shift..], batch, outputs);
        multiply(matrix_mut(&mut y[shift..], batch, outputs), Accum::Add, x, w);
        multiply(matrix_mut(&mut dw[shift..], inputs, outputs), Accum::Add, x.transpose(), d);
        multiply(matrix_mut(&mut dx[shift..], batch, inputs), Accum::Replace, d, w.transpose());
        [&y[shift..], &dw[shift..], &dx[shift..]].concat().iter().map(|z| z.to_bits()).collect()
    }

    #[test]
    fn the_place_in_memory_does_not_change_a_bit() {
        // A resumed training finds its buffers elsewhere. Kernels that peel off unaligned numbers first would sum in
        // another order there.
        for batch in [1, 37, 64] {
            for (inputs, outputs) in [(26, 64), (64, 64), (64, 6), (64, 1), (7, 13)] {
                let expected = layer_products(batch, inputs, outputs, 0);
                for shift in 1..17 {
                    let got = layer_products(batch, inputs, outputs, shift);
                    assert_eq!(got, expected, "batch {batch}, {inputs} → {outputs}, shifted by {shift}");
                }
            }
        }
    }
}
