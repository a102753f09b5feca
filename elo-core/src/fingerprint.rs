//! What results depend on besides the config: this program's version and the processor's class.
//!
//! Matrix kernels and libmujoco choose their code by the processor's vector instructions, so results computed on one
//! class of machine are not mixed with those of another: the class is part of every unit's key.

/// Version and processor class, e.g. `elo 0.1.0 x86_64+avx2+fma`.
pub fn fingerprint() -> String {
    let features = cpu_features();
    let features = if features.is_empty() { String::new() } else { format!("+{}", features.join("+")) };
    format!("elo {} {}{features}", env!("CARGO_PKG_VERSION"), std::env::consts::ARCH)
}

#[cfg(target_arch = "x86_64")]
fn cpu_features() -> Vec<&'static str> {
    let known = [
        ("avx", std::arch::is_x86_feature_detected!("avx")),
        ("avx2", std::arch::is_x86_feature_detected!("avx2")),
        ("fma", std::arch::is_x86_feature_detected!("fma")),
        ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
    ];
    known.into_iter().filter(|(_, there)| *there).map(|(name, _)| name).collect()
}

#[cfg(not(target_arch = "x86_64"))]
fn cpu_features() -> Vec<&'static str> {
    Vec::new()
}
