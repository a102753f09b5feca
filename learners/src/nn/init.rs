//! Orthogonal initial weights.

use rand::Rng;

use super::normal::fill_standard_normal_f64;

/// Fills a row-major matrix of width `cols` with a random one whose rows (or columns, whichever are fewer) are
/// orthogonal and of length `gain`, uniform over all such matrices: Gaussian vectors, orthonormalised in double
/// precision.
pub(super) fn orthogonal<R: Rng + ?Sized>(matrix: &mut [f32], cols: usize, gain: f32, rng: &mut R) {
    let rows = matrix.len() / cols;
    let (count, length) = if rows < cols { (rows, cols) } else { (cols, rows) };
    let basis = orthonormal(count, length, rng);
    for (index, weight) in matrix.iter_mut().enumerate() {
        let (row, col) = (index / cols, index % cols);
        let entry = if rows < cols { basis[row * length + col] } else { basis[col * length + row] };
        *weight = (f64::from(gain) * entry) as f32;
    }
}

/// `count ≤ length` orthonormal vectors, one after the other, by Gram–Schmidt. Each projection is done twice: once
/// leaves an error that grows with how nearly a vector lay in the span of those before it.
fn orthonormal<R: Rng + ?Sized>(count: usize, length: usize, rng: &mut R) -> Vec<f64> {
    let mut basis: Vec<f64> = Vec::with_capacity(count * length);
    let mut vector = vec![0.0; length];
    while basis.len() < count * length {
        fill_standard_normal_f64(rng, &mut vector);
        for _ in 0..2 {
            for known in basis.chunks_exact(length) {
                let along = dot(known, &vector);
                vector.iter_mut().zip(known).for_each(|(v, k)| *v -= along * k);
            }
        }
        let norm = dot(&vector, &vector).sqrt();
        // A draw from within the span of the others has no direction left; drawing again keeps the distribution.
        if norm > 1e-9 {
            basis.extend(vector.iter().map(|v| v / norm));
        }
    }
    basis
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn the_fewer_of_rows_and_columns_are_orthogonal_and_as_long_as_the_gain() {
        let gain = 1.5_f32;
        for (rows, cols) in [(64, 64), (26, 64), (64, 6), (1, 5), (5, 1), (1, 1)] {
            let mut matrix = vec![0.0; rows * cols];
            orthogonal(&mut matrix, cols, gain, &mut ChaCha8Rng::seed_from_u64(3));
            let entry = |vector: usize, index: usize| {
                let at = if rows < cols { vector * cols + index } else { index * cols + vector };
                f64::from(matrix[at])
            };
            let (count, length) = (rows.min(cols), rows.max(cols));
            for a in 0..count {
                for b in 0..count {
                    let product: f64 = (0..length).map(|i| entry(a, i) * entry(b, i)).sum();
                    let expected = if a == b { 2.25 } else { 0.0 };
                    assert!((product - expected).abs() < 1e-6, "{rows}×{cols}, {a}·{b} = {product}");
                }
            }
        }
    }

    #[test]
    fn directions_are_uniform() {
        // The first entry of a uniform unit vector in three dimensions is uniform in [-1, 1]: mean 0, variance 1/3.
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let draws = 4000;
        let firsts: Vec<f64> = (0..draws)
            .map(|_| {
                let mut matrix = [0.0; 9];
                orthogonal(&mut matrix, 3, 1.0, &mut rng);
                f64::from(matrix[8])
            })
            .collect();
        let mean = firsts.iter().sum::<f64>() / f64::from(draws);
        let variance = firsts.iter().map(|x| x * x).sum::<f64>() / f64::from(draws);
        // Four standard errors: sqrt(1/3/4000) = 0.0091, and sqrt((1/5 - 1/9)/4000) = 0.0047.
        assert!(mean.abs() < 0.037, "mean {mean}");
        assert!((variance - 1.0 / 3.0).abs() < 0.019, "variance {variance}");
    }
}
