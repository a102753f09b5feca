//! Learners: what trains teachers and turns their trajectories into options. They see the simulators only through the
//! traits of `elo-core`.
//!
//! [`nn`] holds the small networks and their optimiser; [`kernels`] the formulas of the losses and estimates, as pure
//! functions, each with a test whose numbers are worked out by hand.

pub mod kernels;
pub mod nn;
