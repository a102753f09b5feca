//! The `K` best of scored candidates (Weber et al. 2019, Eq. 4.4).

use std::cmp::Ordering;

/// Ids of the `k` highest scores, best first; equal scores go by ascending id.
///
/// Scores compare by [`f64::total_cmp`], so `+∞` beats everything and `0.0` beats `−0.0`. A NaN score means
/// that the candidate has none: it is never chosen, not even to fill the set, so fewer than `k` ids come back
/// when fewer than `k` candidates have a score. Ids should differ; the order of the input has no influence
/// then. Costs `O(n log n)`.
pub fn top_k<Id: Ord>(scored: impl IntoIterator<Item = (Id, f64)>, k: usize) -> Vec<Id> {
    let mut ranked: Vec<(Id, f64)> = scored.into_iter().filter(|(_, score)| !score.is_nan()).collect();
    ranked.sort_by(better_first);
    ranked.into_iter().take(k).map(|(id, _)| id).collect()
}

/// [`top_k`] of candidates whose ids are their positions.
pub fn top_k_positions(scores: &[f64], k: usize) -> Vec<usize> {
    top_k(scores.iter().copied().enumerate(), k)
}

fn better_first<Id: Ord>((first, score): &(Id, f64), (second, other): &(Id, f64)) -> Ordering {
    other.total_cmp(score).then_with(|| first.cmp(second))
}

/// Share of `scores` that fall short of the greatest by at most `share` of its size, itself among them; 0 without scores.
pub fn near_best(scores: &[f64], share: f64) -> f64 {
    let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let near = scores.iter().filter(|score| **score >= best - share * best.abs()).count();
    near as f64 / scores.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn best_come_first_and_ties_go_to_the_lower_id() {
        assert_eq!(top_k_positions(&[0.5, 2.0, 1.0, 2.0, 0.5], 4), [1, 3, 2, 0]);
        assert_eq!(top_k([("c", 1.0), ("a", 1.0), ("b", 3.0)], 2), ["b", "a"]);
        assert_eq!(top_k([(9, 1.0), (2, 1.0), (4, 1.0)], 3), top_k([(4, 1.0), (9, 1.0), (2, 1.0)], 3));
    }

    #[test]
    fn nan_never_wins_and_never_fills_up() {
        // Both signs: total_cmp alone would put a positive NaN above +∞.
        let scores = [f64::NAN, 1.0, -f64::NAN, f64::NEG_INFINITY];
        assert_eq!(top_k_positions(&scores, 4), [1, 3]);
        assert_eq!(top_k_positions(&[f64::NAN], 1), [0_usize; 0]);
    }

    #[test]
    fn infinities_zeros_and_short_lists_are_ordered() {
        assert_eq!(top_k_positions(&[-0.0, 0.0, f64::INFINITY], 9), [2, 1, 0]);
        assert_eq!(top_k_positions(&[1.0, 2.0], 0), [0_usize; 0]);
        assert_eq!(top_k_positions(&[], 3), [0_usize; 0]);
    }

    #[test]
    fn near_the_best_is_within_a_share_of_its_size() {
        assert_eq!(near_best(&[1.0, 0.91, 0.89, -1.0], 0.1), 0.5);
        // Below 0 the size of the best still counts: -1.1 is the border.
        assert_eq!(near_best(&[-1.0, -1.1, -1.2], 0.1), 2.0 / 3.0);
        assert_eq!(near_best(&[], 0.1), 0.0);
    }
}
