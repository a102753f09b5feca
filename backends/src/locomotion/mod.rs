//! What all engines share about robots with legs.

pub mod body;
