//! Suites that every implementor of a trait runs, and the small world that they are tried on.
//!
//! # Putting an implementation under its suite
//!
//! Make the suite's `Case` (the thing, and what it needs to be tried: a tolerance, a robot, a format), call the suite's
//! `run` and ask the [`check::Report`] to be clean:
//!
//! ```
//! use elo_core::conformance::{point_mass::PointMassConfig, simulator};
//!
//! let case = simulator::Case::new(Box::new(PointMassConfig::default()));
//! simulator::run(&case).require_clean().unwrap();
//! ```
//!
//! # Adding a check
//!
//! Write a `const` [`check::Check`] whose name is a rule, add it to its suite's `CHECKS`, and add to the suite's liars an
//! implementation that is wrong in just the way that the check is meant to find. A check without a liar fails the
//! suite's own test.

pub mod check;
mod compare;
mod config;
mod damage;
mod interruptible;
#[cfg(test)]
mod liars;
pub mod metric;
pub mod option_learner;
pub mod option_policy;
pub mod point_mass;
pub mod simulator;
pub mod teacher;
