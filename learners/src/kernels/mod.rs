//! The formulas of the learners, each a pure function in a file of its own.
//!
//! Losses are means over a batch. A function that computes a loss writes its derivatives by the network's outputs as
//! well, ready for [`crate::nn::Mlp::backward`].

pub mod clipped_surrogate;
pub mod gae;
pub mod running_moments;
pub mod value_loss;
