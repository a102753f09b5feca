//! How far two rankings of the same candidates agree, and whether paired differences have a sign.

use statrs::distribution::{Binomial, DiscreteCDF as _};

/// Kendall's τ-b of two scores of the same candidates (Kendall 1945): 1 for the same order, −1 for the reverse, ties
/// accounted for. `None` when one of the scores is the same for all. Costs `O(n²)`.
///
/// # Panics
/// When the lengths differ.
pub fn kendall_tau_b(first: &[f64], second: &[f64]) -> Option<f64> {
    assert_eq!(first.len(), second.len(), "two scores of the same candidates");
    let (mut concordant, mut tied_first, mut tied_second, mut pairs) = (0_i64, 0_i64, 0_i64, 0_i64);
    for i in 0..first.len() {
        for j in 0..i {
            let (a, b) = (first[i].total_cmp(&first[j]) as i64, second[i].total_cmp(&second[j]) as i64);
            concordant += a * b;
            tied_first += i64::from(a == 0);
            tied_second += i64::from(b == 0);
            pairs += 1;
        }
    }
    let scale = ((pairs - tied_first) as f64 * (pairs - tied_second) as f64).sqrt();
    (scale > 0.0).then(|| concordant as f64 / scale)
}

/// Spearman's ρ: the correlation of the ranks, ties at their mean rank. `None` as [`kendall_tau_b`].
///
/// # Panics
/// When the lengths differ.
pub fn spearman(first: &[f64], second: &[f64]) -> Option<f64> {
    assert_eq!(first.len(), second.len(), "two scores of the same candidates");
    let (first, second) = (ranks(first), ranks(second));
    let mean = (first.len() as f64 - 1.0) / 2.0;
    let product =
        |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum() };
    let scale = (product(&first, &first) * product(&second, &second)).sqrt();
    (scale > 0.0).then(|| product(&first, &second) / scale)
}

/// Ranks from 0, ties at their mean.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut start = 0;
    for tied in order.chunk_by(|a, b| values[*a] == values[*b]) {
        let rank = start as f64 + (tied.len() as f64 - 1.0) / 2.0;
        tied.iter().for_each(|index| ranks[*index] = rank);
        start += tied.len();
    }
    ranks
}

/// Two-sided sign test: the probability that chance alone would split `positive + negative` differences at least as
/// unevenly. Differences of 0 are left out by the caller; without any the probability is 1.
pub fn sign_test(positive: u64, negative: u64) -> f64 {
    let trials = positive + negative;
    let Ok(coin) = Binomial::new(0.5, trials) else { return 1.0 };
    if trials == 0 { 1.0 } else { (2.0 * coin.cdf(positive.min(negative))).min(1.0) }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const FIRST: [f64; 8] = [3.0, 1.0, 2.0, 2.0, 5.0, 8.0, 0.5, 3.0];
    const SECOND: [f64; 8] = [2.0, 1.5, 1.5, 4.0, 4.5, 9.0, 0.1, 1.0];

    /// `scipy.stats.kendalltau`, `spearmanr` and `binomtest` of SciPy 1.17.1.
    #[test]
    fn numbers_are_scipys() {
        assert!((kendall_tau_b(&FIRST, &SECOND).unwrap() - 0.641_623_652_681_937_7).abs() < 1e-12);
        assert!((spearman(&FIRST, &SECOND).unwrap() - 0.745_468_236_456_97).abs() < 1e-12);
        assert!((sign_test(3, 12) - 0.035_156_25).abs() < 1e-12);
    }

    #[test]
    fn ends_and_degenerate_cases() {
        let up: Vec<f64> = (0..10).map(f64::from).collect();
        let down: Vec<f64> = up.iter().map(|x| -x).collect();
        assert_eq!((kendall_tau_b(&up, &up), kendall_tau_b(&up, &down)), (Some(1.0), Some(-1.0)));
        assert!((spearman(&up, &down).unwrap() + 1.0).abs() < 1e-12);
        assert_eq!((kendall_tau_b(&up, &[1.0; 10]), spearman(&up, &[1.0; 10])), (None, None));
        assert_eq!((sign_test(0, 0), sign_test(5, 5)), (1.0, 1.0));
    }
}
