//! Robots in Rapier.

mod builder;
mod coordinates;
mod engine;
mod inertia;
mod motors;
mod segment;
mod shape;
mod skeleton;
mod unsupported;

pub use engine::{Division, RapierBody};
