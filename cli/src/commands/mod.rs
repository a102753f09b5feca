//! One file a command.

pub mod compare;
pub mod config;
pub mod crosscheck;
pub mod discover;
pub mod doctor;
pub mod evaluate;
pub mod example;
pub mod experiments;
pub mod films;
pub mod plan;
pub mod plugins;
pub mod report;
pub mod reprice;
pub mod reproduce;
