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
}

/// `rows × cols` numbers, row after row, as a matrix.
pub(super) fn matrix(data: &[f32], rows: usize, cols: usize) -> MatRef<'_, f32> {
    MatRef::from_row_major_slice(data, rows, cols)
}

/// As [`matrix`], to be written.
pub(super) fn matrix_mut(data: &mut [f32], rows: usize, cols: usize) -> MatMut<'_, f32> {
    MatMut::from_row_major_slice_mut(data, rows, cols)
}
