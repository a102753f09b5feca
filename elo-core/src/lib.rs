//! The domain and the algorithm of early-life options (Weber et al. 2019): tasks, contexts, simulators as traits,
//! teachers, options, metrics, Algorithm 1, and the run directory in which its units of work are kept.
//!
//! This crate knows no physics engine, no learner, no Python and no command line. Those implement its traits and hand
//! it their [`plugin::Plugin`] slices.

pub mod agent;
mod candidates;
pub mod compare;
pub mod config;
pub mod conformance;
pub mod context;
pub mod crew;
pub mod crosscheck;
pub mod csv;
mod desks;
pub mod discover;
mod elsewhere;
pub mod evaluate;
pub mod experiment;
pub mod experiments;
pub mod fault;
pub mod figures;
pub mod fingerprint;
pub mod hosted;
pub mod judge;
pub mod key;
pub mod measured;
pub mod metric;
pub mod option_set;
pub mod parts;
pub mod performer;
pub mod plugin;
pub mod policy;
pub mod replay;
pub mod report;
pub mod reprice;
pub mod results;
pub mod returns;
pub mod rollout;
pub mod run_dir;
pub mod scene;
pub mod seed;
pub mod select;
pub mod simulator;
pub mod spec;
pub mod statistics;
pub mod task;
pub mod tensors;
pub mod units;
pub mod worker;
pub mod workers;
pub mod workforce;
