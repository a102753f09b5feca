//! Small fully connected networks in `f32`, trained on one thread.
//!
//! - [`Mlp`]: tanh hidden layers, linear output, all parameters in one flat vector; batch-1 inference, batch forward
//!   and backward passes, none of which allocates once its buffers ([`Scratch`], [`Activations`]) have been used.
//! - [`DiagonalGaussian`] and [`GaussianBatch`]: the action distribution of a policy whose mean an [`Mlp`] computes.
//! - [`Adam`] and [`clip_grad_norm`], over flat slices.
//!
//! Batches are row-major: sample after sample, each `features` long. The arithmetic is single-threaded and repeats to
//! the bit on one class of processor; another vector width sums in another order and so gives other last bits.
//!
//! One step of gradient descent:
//!
//! ```
//! use elo_learners::kernels::value_loss::value_loss;
//! use elo_learners::nn::{Adam, Mlp, clip_grad_norm};
//! use rand::SeedableRng;
//!
//! let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
//! let mut net = Mlp::orthogonal(&[2, 16, 1], 1.0, &mut rng)?;
//! let mut optimiser = Adam::new(net.params().len());
//! let mut gradient = vec![0.0; net.params().len()];
//! let mut activations = net.activations();
//! let mut d_values = vec![0.0; 3];
//! let (states, targets) = ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [1.0, 2.0, 3.0]);
//!
//! let mut losses = Vec::new();
//! for _ in 0..50 {
//!     let values = net.forward(&states, &mut activations);
//!     losses.push(value_loss(values, &targets, &mut d_values));
//!     gradient.fill(0.0);
//!     net.backward(&mut activations, &d_values, &mut gradient);
//!     clip_grad_norm(&mut [&mut gradient], 0.5);
//!     optimiser.step(net.params_mut(), &gradient, 1e-2);
//! }
//! assert!(losses[49] < 0.1 * losses[0]);
//! # Ok::<(), elo_learners::nn::NetworkError>(())
//! ```

mod adam;
mod backprop;
mod gaussian;
mod grad_norm;
mod init;
mod matmul;
mod mlp;
mod normal;
mod tanh;

pub use adam::{Adam, AdamState, AdamStateError};
pub use backprop::Activations;
pub(crate) use backprop::gather;
pub(crate) use gaussian::lost_aim;
pub use gaussian::{DiagonalGaussian, GaussianBatch};
pub use grad_norm::clip_grad_norm;
pub use mlp::{Layer, Mlp, NetworkError, Scratch};
pub use normal::fill_standard_normal;

#[cfg(test)]
pub(crate) mod reference;
