//! What all engines share about robots with legs: the robots' MJCF files, what may be loaded, observation, reward terms,
//! reset and ends. An engine implements [`body::ArticulatedBody`] and gets the rest through [`simulator::Locomotion`].
//!
//! The three robots carry the masses, inertias, torques and reward of Roboschool's Ant, HalfCheetah and Walker2d, which
//! the paper uses. Known differences from those environments: there is no restitution and no built-in drag of links, Ant's
//! ankle axes have unit length, and two things differ by engine:
//!
//! - Joint limits are absorbing stops that bring a joint which starts outside back at half its excess per second: strongly
//!   damped springs in MuJoCo, soft constraints in Rapier.
//! - A body touches the floor when one of its geoms penetrates it in MuJoCo, is within 1 mm of it in Rapier, and is within
//!   some millimetres of it in Roboschool.

pub mod body;
#[cfg(all(test, any(feature = "mujoco", feature = "rapier")))]
pub(crate) mod laws;
#[cfg(all(test, any(feature = "mujoco", feature = "rapier")))]
pub(crate) mod laws_flight;
#[cfg(all(test, any(feature = "mujoco", feature = "rapier")))]
mod laws_pendulum;
#[cfg(all(test, any(feature = "mujoco", feature = "rapier")))]
pub(crate) mod liars;
pub mod model;
pub mod observation;
pub mod prescan;
mod read;
pub mod reward;
pub mod robot;
mod scene;
pub mod simulator;
mod vocabulary;
