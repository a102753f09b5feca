//! Physics engines behind `elo-core`'s `Simulator`, and whatever users write in Python.
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

/// The simulators of this crate, and what else is written in Python.
pub const PLUGINS: &[Plugin] = &[
    Plugin::simulator::<mujoco::MujocoConfig>(
        "mujoco",
        "robots with legs in MuJoCo 3.17.0 (needs libmujoco)",
    ),
    Plugin::simulator::<python::PythonConfig>(
        "python",
        "an environment in Python with Gymnasium's interface",
    ),
    Plugin::simulator::<python::PythonBodyConfig>(
        "python_body",
        "robots with legs in a physics engine in Python",
    ),
    Plugin::teacher::<python::PythonTeacherConfig>("python", "policies that a callable in Python gives"),
    Plugin::metric::<python::PythonMetricConfig>(
        "python",
        "a function in Python that scores arrays of returns",
    ),
    #[cfg(feature = "rapier")]
    Plugin::simulator::<rapier::RapierConfig>(
        "rapier",
        "robots with legs in Rapier 0.36.1 (pure Rust, nothing to install)",
    ),
];
