//! The network itself: its shape, its flat parameters, and inference for one input.

use std::ops::Range;

use rand::Rng;
use rten_simd::{Isa, SimdOp};

use super::backprop::Activations;
use super::init::orthogonal;
use super::tanh::tanh_in_place;

/// A fully connected network: `tanh` after every layer but the last, which is linear.
///
/// All parameters live in one vector, layer after layer, each layer's weights before its biases; optimisers, gradient
/// clipping and checkpoints see that vector, [`Self::layers`] says what lies where.
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp {
    layers: Vec<Layer>,
    params: Vec<f32>,
}

/// Where one layer lies in the flat parameters. It computes `output[o] = bias[o] + Σ_i input[i] · weight[i][o]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Width of what comes in.
    pub inputs: usize,
    /// Width of what goes out.
    pub outputs: usize,
    /// The `inputs × outputs` weights, row-major: the weights that leave one input are neighbours. (PyTorch's
    /// `Linear.weight` is the transpose.)
    pub weight: Range<usize>,
    /// The `outputs` biases.
    pub bias: Range<usize>,
}

/// Why a network cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NetworkError {
    /// Fewer than two widths, or a width of zero.
    #[error("a network needs an input and an output width and no width of zero, got {0:?}")]
    Sizes(Vec<usize>),
    /// A parameter vector of another network.
    #[error("a network of widths {sizes:?} has {expected} parameters, got {got}")]
    Parameters {
        /// The widths.
        sizes: Vec<usize>,
        /// How many parameters they ask for.
        expected: usize,
        /// How many came.
        got: usize,
    },
}

/// Working memory of [`Mlp::forward_one`]. One per thread; serves networks of any shape and grows to the widest.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    from: Vec<f32>,
    to: Vec<f32>,
}

impl Mlp {
    /// A network of zeros with these widths: input, hidden layers, output.
    ///
    /// # Errors
    /// [`NetworkError::Sizes`].
    pub fn new(sizes: &[usize]) -> Result<Self, NetworkError> {
        let layers = layers_of(sizes)?;
        let count = parameter_count(&layers);
        Ok(Self { layers, params: vec![0.0; count] })
    }

    /// A network with orthogonal weights and zero biases, the usual start of a PPO network: gain √2 in hidden layers,
    /// `output_gain` in the last (customarily 0.01 for a policy's mean, 1 for a value).
    ///
    /// # Errors
    /// [`NetworkError::Sizes`].
    pub fn orthogonal<R: Rng + ?Sized>(
        sizes: &[usize],
        output_gain: f32,
        rng: &mut R,
    ) -> Result<Self, NetworkError> {
        let mut network = Self::new(sizes)?;
        let last = network.layers.len() - 1;
        for (index, layer) in network.layers.iter().enumerate() {
            let gain = if index == last { output_gain } else { std::f32::consts::SQRT_2 };
            orthogonal(&mut network.params[layer.weight.clone()], layer.outputs, gain, rng);
        }
        Ok(network)
    }

    /// A network with given parameters, as [`Self::params`] returned them.
    ///
    /// # Errors
    /// [`NetworkError`]: bad widths, or another number of parameters than they ask for.
    pub fn from_params(sizes: &[usize], params: Vec<f32>) -> Result<Self, NetworkError> {
        let layers = layers_of(sizes)?;
        let expected = parameter_count(&layers);
        if params.len() != expected {
            return Err(NetworkError::Parameters { sizes: sizes.to_vec(), expected, got: params.len() });
        }
        Ok(Self { layers, params })
    }

    /// The widths: input, hidden layers, output.
    pub fn sizes(&self) -> Vec<usize> {
        std::iter::once(self.input_size()).chain(self.layers.iter().map(|layer| layer.outputs)).collect()
    }

    /// Width of an input.
    pub fn input_size(&self) -> usize {
        self.layers[0].inputs
    }

    /// Width of an output.
    pub fn output_size(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Where the layers' weights and biases lie in [`Self::params`], input side first. Gradients lie the same way.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// All parameters.
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// All parameters, for an optimiser.
    pub fn params_mut(&mut self) -> &mut [f32] {
        &mut self.params
    }

    /// Buffers for [`Self::forward`] and [`Self::backward`] of this network.
    pub fn activations(&self) -> Activations {
        Activations::new(self)
    }

    /// Writes the output for one input. Allocates nothing once `scratch` has served this network; about half a
    /// microsecond at 26→64→64→6. Agrees with a row of [`Self::forward`] to rounding, not to the bit.
    ///
    /// # Panics
    /// When `input` or `output` has the wrong length.
    pub fn forward_one(&self, input: &[f32], scratch: &mut Scratch, output: &mut [f32]) {
        assert_eq!(input.len(), self.input_size(), "length of a network's input");
        assert_eq!(output.len(), self.output_size(), "length of a network's output");
        ForwardOne { network: self, input, scratch, output }.dispatch();
    }
}

fn layers_of(sizes: &[usize]) -> Result<Vec<Layer>, NetworkError> {
    if sizes.len() < 2 || sizes.contains(&0) {
        return Err(NetworkError::Sizes(sizes.to_vec()));
    }
    let mut start = 0;
    Ok(sizes
        .windows(2)
        .map(|pair| {
            let (inputs, outputs) = (pair[0], pair[1]);
            let weight = start..start + inputs * outputs;
            let bias = weight.end..weight.end + outputs;
            start = bias.end;
            Layer { inputs, outputs, weight, bias }
        })
        .collect())
}

fn parameter_count(layers: &[Layer]) -> usize {
    layers[layers.len() - 1].bias.end
}

/// The whole of [`Mlp::forward_one`] as one vector operation, so that the processor is looked up once.
struct ForwardOne<'a> {
    network: &'a Mlp,
    input: &'a [f32],
    scratch: &'a mut Scratch,
    output: &'a mut [f32],
}

impl SimdOp for ForwardOne<'_> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, isa: I) {
        let Self { network, input, scratch: Scratch { from, to }, output } = self;
        let (hidden, last) = network.layers.split_at(network.layers.len() - 1);
        for (index, layer) in hidden.iter().enumerate() {
            to.resize(layer.outputs, 0.0);
            let source = if index == 0 { input } else { from.as_slice() };
            affine(&network.params, layer, source, to);
            tanh_in_place(isa, to);
            std::mem::swap(from, to);
        }
        let source = if hidden.is_empty() { input } else { from.as_slice() };
        affine(&network.params, &last[0], source, output);
    }
}

/// `output = bias + input · weight`. Four inputs at a time, so that each pass over the outputs, which the compiler
/// vectorises, loads and stores a sum once for four products.
#[inline(always)]
fn affine(params: &[f32], layer: &Layer, input: &[f32], output: &mut [f32]) {
    output.copy_from_slice(&params[layer.bias.clone()]);
    let width = layer.outputs;
    let weight = &params[layer.weight.clone()];
    let (quads, rest) = input.as_chunks::<4>();
    let mut blocks = weight.chunks_exact(4 * width);
    for (x, block) in quads.iter().zip(&mut blocks) {
        let (upper, lower) = block.split_at(2 * width);
        let ((w0, w1), (w2, w3)) = (upper.split_at(width), lower.split_at(width));
        for ((((y, w0), w1), w2), w3) in output.iter_mut().zip(w0).zip(w1).zip(w2).zip(w3) {
            *y += (x[0] * w0 + x[1] * w1) + (x[2] * w2 + x[3] * w3);
        }
    }
    for (x, row) in rest.iter().zip(blocks.remainder().chunks_exact(width)) {
        for (y, w) in output.iter_mut().zip(row) {
            *y += x * w;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::nn::reference;

    fn random(count: usize, seed: u64) -> Vec<f32> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
    }

    #[test]
    fn a_small_network_gives_the_output_worked_out_by_hand() {
        // 2 → 1 → 2. Hidden: tanh(0.5·1 + 0.25·2 + 0) = tanh(1) = 0.761594156.
        // Outputs: 0.1 + 2·0.761594156 = 1.623188312 and -0.2 - 1·0.761594156 = -0.961594156.
        let params = vec![0.5, 0.25, 0.0, 2.0, -1.0, 0.1, -0.2];
        let network = Mlp::from_params(&[2, 1, 2], params).unwrap();
        let mut output = [0.0; 2];
        network.forward_one(&[1.0, 2.0], &mut Scratch::default(), &mut output);
        assert!((output[0] - 1.623_188_3).abs() < 1e-6, "{output:?}");
        assert!((output[1] + 0.961_594_16).abs() < 1e-6, "{output:?}");
    }

    #[test]
    fn one_input_and_a_row_of_a_batch_give_the_same_output() {
        // Widths around the vector lengths and the blocks of four, no hidden layer, and one scratch for them all.
        let mut scratch = Scratch::default();
        for sizes in [vec![26, 64, 64, 6], vec![5, 7, 3, 1], vec![3, 2], vec![1, 1], vec![17, 33, 16]] {
            let network = Mlp::orthogonal(&sizes, 1.0, &mut ChaCha8Rng::seed_from_u64(7)).unwrap();
            let (inputs, outputs) = (network.input_size(), network.output_size());
            let batch = random(9 * inputs, 8);
            let mut activations = network.activations();
            let rows = network.forward(&batch, &mut activations).to_vec();
            let mut output = vec![0.0; outputs];
            for (input, row) in batch.chunks(inputs).zip(rows.chunks(outputs)) {
                network.forward_one(input, &mut scratch, &mut output);
                for (one, many) in output.iter().zip(row) {
                    assert!((one - many).abs() < 2e-6, "{sizes:?}: {one} alone, {many} in a batch");
                }
            }
        }
    }

    #[test]
    fn the_output_agrees_with_a_reference_in_double_precision() {
        let sizes = [26, 64, 64, 6];
        let mut network = Mlp::orthogonal(&sizes, 1.0, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
        let noise = random(network.params().len(), 2);
        network.params_mut().iter_mut().zip(&noise).for_each(|(p, n)| *p += 0.1 * n);
        let input = random(26, 3);
        let mut output = [0.0; 6];
        network.forward_one(&input, &mut Scratch::default(), &mut output);
        let params: Vec<f64> = network.params().iter().map(|&p| f64::from(p)).collect();
        let exact = reference::forward(&sizes, &params, &input);
        for (got, expected) in output.iter().zip(&exact) {
            assert!((f64::from(*got) - expected).abs() < 2e-6, "{got} against {expected}");
        }
    }

    #[test]
    fn layers_cover_the_parameters_without_gaps() {
        let network = Mlp::new(&[3, 5, 2]).unwrap();
        let mut end = 0;
        for layer in network.layers() {
            assert_eq!(layer.weight, end..end + layer.inputs * layer.outputs);
            assert_eq!(layer.bias, layer.weight.end..layer.weight.end + layer.outputs);
            end = layer.bias.end;
        }
        assert_eq!(network.params().len(), end);
        assert_eq!(end, 3 * 5 + 5 + 5 * 2 + 2);
        assert_eq!(network.sizes(), [3, 5, 2]);
    }

    #[test]
    fn shapes_that_make_no_network_are_refused() {
        for sizes in [vec![], vec![3], vec![3, 0, 2]] {
            assert_eq!(Mlp::new(&sizes), Err(NetworkError::Sizes(sizes)));
        }
        let error = Mlp::from_params(&[2, 1], vec![0.0; 4]).unwrap_err();
        assert_eq!(error.to_string(), "a network of widths [2, 1] has 3 parameters, got 4");
    }

    #[test]
    fn the_same_stream_gives_the_same_network() {
        let make = |seed| Mlp::orthogonal(&[4, 8, 2], 0.01, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
        assert_eq!(make(5), make(5));
        assert_ne!(make(5), make(6));
    }
}
