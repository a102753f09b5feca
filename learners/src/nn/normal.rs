//! Standard normal numbers.

use std::f64::consts::TAU;

use rand::{Rng, RngExt};

/// Fills `values` with independent standard normal numbers. Takes two draws of the stream for each two values begun, so
/// that how much of a stream is used depends only on the lengths asked for.
pub fn fill_standard_normal<R: Rng + ?Sized>(rng: &mut R, values: &mut [f32]) {
    for pair in values.chunks_mut(2) {
        let normals = two_standard_normals(rng);
        pair.iter_mut().zip(normals).for_each(|(value, normal)| *value = normal as f32);
    }
}

/// As [`fill_standard_normal`], in double precision.
pub(super) fn fill_standard_normal_f64<R: Rng + ?Sized>(rng: &mut R, values: &mut [f64]) {
    for pair in values.chunks_mut(2) {
        let normals = two_standard_normals(rng);
        pair.iter_mut().zip(normals).for_each(|(value, normal)| *value = normal);
    }
}

/// The Box–Muller transform of two uniform draws.
fn two_standard_normals<R: Rng + ?Sized>(rng: &mut R) -> [f64; 2] {
    // From (0, 1]: the logarithm of zero is not finite.
    let uniform = 1.0 - rng.random::<f64>();
    let radius = (-2.0 * uniform.ln()).sqrt();
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn moments_and_tails_are_those_of_the_normal_distribution() {
        let mut values = vec![0.0; 100_001];
        fill_standard_normal_f64(&mut ChaCha8Rng::seed_from_u64(1), &mut values);
        let count = values.len() as f64;
        let moment = |power: i32| values.iter().map(|x| x.powi(power)).sum::<f64>() / count;
        let beyond = |x: f64| values.iter().filter(|v| **v > x).count() as f64 / count;
        // About four standard errors each; the exact values are 0, 1, 0, 3 and Pr(X > 2) = 0.02275.
        assert!(moment(1).abs() < 0.013, "{}", moment(1));
        assert!((moment(2) - 1.0).abs() < 0.018, "{}", moment(2));
        assert!(moment(3).abs() < 0.05, "{}", moment(3));
        assert!((moment(4) - 3.0).abs() < 0.13, "{}", moment(4));
        assert!((beyond(2.0) - 0.022_75).abs() < 0.0019, "{}", beyond(2.0));
        // The two of a pair do not move together: the correlation of neighbours is within four standard errors of 0.
        let together = values.chunks_exact(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / (count / 2.0);
        assert!(together.abs() < 0.018, "{together}");
    }

    #[test]
    fn an_odd_length_uses_as_much_of_the_stream_as_the_next_even_one() {
        let rest = |length: usize| {
            let mut rng = ChaCha8Rng::seed_from_u64(2);
            fill_standard_normal(&mut rng, &mut vec![0.0; length]);
            rng.next_u64()
        };
        assert_eq!(rest(3), rest(4));
        assert_ne!(rest(2), rest(3));
    }
}
