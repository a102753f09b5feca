//! MuJoCo (3.17.0, through libmujoco) behind the locomotion simulator.
//!
//! The config is always compiled, so that it can be checked and printed without the engine. The engine needs the feature
//! `mujoco`; programs that must not link a library which may be absent, or which may end its process on an internal
//! error, run it in the worker `elo-mujoco`.

mod config;
#[cfg(feature = "mujoco")]
mod engine;
#[cfg(feature = "mujoco")]
mod library;

pub use config::MujocoConfig;
#[cfg(feature = "mujoco")]
pub use engine::MujocoBody;
