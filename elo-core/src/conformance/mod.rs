//! Suites that every implementor of a trait runs, and the small world that they are tried on.

pub mod point_mass;
