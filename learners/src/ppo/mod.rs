//! Teachers by proximal policy optimisation.
//!
//! [`PpoConfig`] is what a user sets; `train` is the algorithm from top to bottom; `environment` runs episodes,
//! `experience` holds their steps, `learner` what they change; `checkpoint` is all of it as bytes;
//! [`GaussianMlpTeacher`] is the result.

mod checkpoint;
mod config;
pub(crate) mod environment;
mod experience;
mod learner;
mod policy;
mod train;

pub use config::PpoConfig;
pub use policy::GaussianMlpTeacher;
