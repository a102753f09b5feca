//! Robots in Rapier.

mod builder;
mod config;
mod coordinates;
mod engine;
mod inertia;
mod motors;
mod segment;
mod settings;
mod shape;
mod skeleton;
mod unsupported;

pub use config::RapierConfig;
pub use engine::RapierBody;
pub use settings::Division;
