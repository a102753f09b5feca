//! Physics engines behind `elo-core`'s `Simulator`.
//!
//! Adding a backend: a folder with a config and an implementation (for robots with legs, implement
//! [`locomotion::body::ArticulatedBody`] and the observation, reward and reset come with it), its `mod` line below and its
//! line in [`PLUGINS`]. A Cargo feature only where it links a library that may be absent.

use elo_core::plugin::Plugin;

pub mod locomotion;
pub mod mujoco;
pub mod python;
#[cfg(feature = "rapier")]
pub mod rapier;

/// The simulators of this crate.
pub const PLUGINS: &[Plugin] = &[
    Plugin::simulator::<mujoco::MujocoConfig>(
        "mujoco",
        "robots with legs in MuJoCo 3.17.0 (needs libmujoco)",
    ),
    Plugin::simulator::<python::PythonConfig>(
        "python",
        "an environment in Python with Gymnasium's interface",
    ),
    #[cfg(feature = "rapier")]
    Plugin::simulator::<rapier::RapierConfig>(
        "rapier",
        "robots with legs in Rapier 0.36.1 (pure Rust, nothing to install)",
    ),
];
