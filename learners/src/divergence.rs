//! When a training by gradients has nothing to go on with.

use crate::nn::lost_aim;

/// An iteration that moved decisions by more, in nats of Kullback–Leibler divergence, has lost the policy that the advantages
/// are about. Without a limit on the move, iterations of Ants that went on to learn moved it by up to 6.
const MAX_KL: f32 = 100.0;

/// Why these networks' parameters and policies' log standard deviations are nothing to go on with, after an iteration that moved
/// decisions by `kl` nats.
pub(crate) fn divergence<'a>(
    params: impl IntoIterator<Item = &'a [f32]>,
    log_stds: impl IntoIterator<Item = &'a [f32]>,
    kl: f32,
) -> Option<String> {
    if !params.into_iter().flatten().all(|p| p.is_finite()) {
        return Some("a parameter is not finite".to_owned());
    }
    log_stds.into_iter().find_map(|log_std| lost_aim(log_std, "a policy")).or_else(|| {
        // Written so that NaN is caught.
        let kept = kl <= MAX_KL;
        (!kept).then(|| format!("one iteration moved decisions by {kl:.2} nats, more than {MAX_KL}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_way_to_diverge_is_named() {
        let after = |param: f32, log_std: f32, kl: f32| divergence([&[0.0, param][..]], [&[log_std][..]], kl);
        assert_eq!(after(1.0, 0.0, 6.1), None);
        assert_eq!(after(f32::NAN, 0.0, 0.02).as_deref(), Some("a parameter is not finite"));
        for log_std in [-9.0, 3.5, f32::NAN] {
            assert!(after(1.0, log_std, 0.02).is_some_and(|reason| reason.contains("standard deviation")));
        }
        for kl in [101.0, f32::INFINITY, f32::NAN] {
            assert!(after(1.0, 0.0, kl).is_some_and(|reason| reason.contains("nats")));
        }
    }
}
