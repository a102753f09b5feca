//! Forward and backward passes over a batch.

use faer::Accum;
use rten_simd::{Isa, SimdOp};

use super::matmul::{matrix, matrix_mut, multiply};
use super::mlp::{Layer, Mlp};
use super::tanh::TanhOf;

/// What a forward pass leaves for the backward pass: the input and every layer's output, row-major. Made for one
/// network shape, any batch size; grows to the largest batch it has seen and then allocates no more.
#[derive(Clone, Debug)]
pub struct Activations {
    sizes: Vec<usize>,
    batch: usize,
    /// `values[0]` is the input, `values[l]` the output of layer `l - 1`.
    values: Vec<Vec<f32>>,
    /// Derivatives of the loss by one layer's sums, and by those of the layer before it.
    delta: Vec<f32>,
    delta_before: Vec<f32>,
}

impl Activations {
    pub(super) fn new(network: &Mlp) -> Self {
        let sizes = network.sizes();
        let values = vec![Vec::new(); sizes.len()];
        Self { sizes, batch: 0, values, delta: Vec::new(), delta_before: Vec::new() }
    }

    /// Room for `batch` inputs, for the caller to fill before [`Mlp::forward_loaded`]; what is in it before is
    /// unspecified. Saves a copy where a batch is gathered from scattered rows.
    pub fn input_mut(&mut self, batch: usize) -> &mut [f32] {
        self.batch = batch;
        for (values, size) in self.values.iter_mut().zip(&self.sizes) {
            values.resize(batch * size, 0.0);
        }
        &mut self.values[0]
    }

    /// Takes rows of a table, as wide as an input, for the next [`Mlp::forward_loaded`].
    pub(crate) fn gather(&mut self, table: &[f32], rows: &[usize]) {
        gather(table, self.sizes[0], rows, self.input_mut(rows.len()));
    }

    /// The inputs of the last forward pass, `batch × input`.
    pub fn input(&self) -> &[f32] {
        &self.values[0]
    }

    /// The outputs of the last forward pass, `batch × output`.
    pub fn output(&self) -> &[f32] {
        &self.values[self.values.len() - 1]
    }
}

/// Copies rows of a table, `width` numbers each.
pub(crate) fn gather(table: &[f32], width: usize, rows: &[usize], to: &mut [f32]) {
    for (to, &row) in to.chunks_exact_mut(width).zip(rows) {
        to.copy_from_slice(&table[row * width..][..width]);
    }
}

impl Mlp {
    /// The outputs for a batch of inputs (`batch × input`, row-major), `batch × output`.
    ///
    /// # Panics
    /// When the length of `inputs` is no multiple of the input width, or `activations` were made for another shape.
    pub fn forward<'a>(&self, inputs: &[f32], activations: &'a mut Activations) -> &'a [f32] {
        assert!(inputs.len().is_multiple_of(self.input_size()), "length of a batch of inputs");
        activations.input_mut(inputs.len() / self.input_size()).copy_from_slice(inputs);
        self.forward_loaded(activations)
    }

    /// As [`Self::forward`], for inputs that were written to [`Activations::input_mut`].
    ///
    /// # Panics
    /// When `activations` were made for another shape.
    pub fn forward_loaded<'a>(&self, activations: &'a mut Activations) -> &'a [f32] {
        self.check_shape(activations);
        let batch = activations.batch;
        let last = self.layers().len() - 1;
        for (index, layer) in self.layers().iter().enumerate() {
            let (before, after) = activations.values.split_at_mut(index + 1);
            let (input, output) = (&before[index], &mut after[0]);
            let bias = &self.params()[layer.bias.clone()];
            output.chunks_exact_mut(layer.outputs).for_each(|row| row.copy_from_slice(bias));
            let weight = matrix(&self.params()[layer.weight.clone()], layer.inputs, layer.outputs);
            let input = matrix(input, batch, layer.inputs);
            multiply(matrix_mut(output, batch, layer.outputs), Accum::Add, input, weight);
            if index < last {
                TanhOf(output).dispatch();
            }
        }
        activations.output()
    }

    /// Adds to `gradient`, which lies like [`Self::params`], the gradient of a loss whose derivatives by the outputs of
    /// the last forward pass are `d_output` (`batch × output`). May be called again for another loss of that pass.
    ///
    /// # Panics
    /// When a length is wrong, or `activations` were made for another shape.
    pub fn backward(&self, activations: &mut Activations, d_output: &[f32], gradient: &mut [f32]) {
        self.check_shape(activations);
        assert_eq!(d_output.len(), activations.output().len(), "length of the derivatives by the outputs");
        assert_eq!(gradient.len(), self.params().len(), "length of a gradient");
        let Activations { batch, values, delta, delta_before, .. } = activations;
        for (index, layer) in self.layers().iter().enumerate().rev() {
            let d_sums = if index + 1 == self.layers().len() { d_output } else { delta.as_slice() };
            let input = matrix(&values[index], *batch, layer.inputs).transpose();
            let d_weight = matrix_mut(&mut gradient[layer.weight.clone()], layer.inputs, layer.outputs);
            multiply(d_weight, Accum::Add, input, matrix(d_sums, *batch, layer.outputs));
            AddRows { rows: d_sums, sum: &mut gradient[layer.bias.clone()] }.dispatch();
            if index > 0 {
                back_through_weights(self.params(), layer, d_sums, delta_before);
                BackThroughTanh { outputs: &values[index], delta: delta_before }.dispatch();
                std::mem::swap(delta, delta_before);
            }
        }
    }

    /// As [`Self::backward`]; returns also the derivatives by the inputs, `batch × input`.
    ///
    /// # Panics
    /// As [`Self::backward`].
    pub fn backward_to_input<'a>(
        &self,
        activations: &'a mut Activations,
        d_output: &[f32],
        gradient: &mut [f32],
    ) -> &'a [f32] {
        self.backward(activations, d_output, gradient);
        let Activations { delta, delta_before, .. } = activations;
        // The pass above ended with the first layer's derivatives in `delta`.
        let d_sums = if self.layers().len() == 1 { d_output } else { delta.as_slice() };
        back_through_weights(self.params(), &self.layers()[0], d_sums, delta_before);
        delta_before
    }

    fn check_shape(&self, activations: &Activations) {
        let outputs = self.layers().iter().map(|layer| layer.outputs);
        let fits =
            activations.sizes[0] == self.input_size() && activations.sizes[1..].iter().copied().eq(outputs);
        assert!(
            fits,
            "activations of widths {:?} for a network of widths {:?}",
            activations.sizes,
            self.sizes()
        );
    }
}

/// `out = d_sums · weightᵀ`: the derivatives by a layer's inputs.
fn back_through_weights(params: &[f32], layer: &Layer, d_sums: &[f32], out: &mut Vec<f32>) {
    let batch = d_sums.len() / layer.outputs;
    out.resize(batch * layer.inputs, 0.0);
    let weight = matrix(&params[layer.weight.clone()], layer.inputs, layer.outputs).transpose();
    let d_sums = matrix(d_sums, batch, layer.outputs);
    multiply(matrix_mut(out, batch, layer.inputs), Accum::Replace, d_sums, weight);
}

/// `delta *= 1 - tanh²`.
struct BackThroughTanh<'a> {
    outputs: &'a [f32],
    delta: &'a mut [f32],
}

impl SimdOp for BackThroughTanh<'_> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, _isa: I) {
        for (delta, output) in self.delta.iter_mut().zip(self.outputs) {
            *delta *= 1.0 - output * output;
        }
    }
}

/// `sum += Σ rows`.
struct AddRows<'a> {
    rows: &'a [f32],
    sum: &'a mut [f32],
}

impl SimdOp for AddRows<'_> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, _isa: I) {
        for row in self.rows.chunks_exact(self.sum.len()) {
            for (sum, x) in self.sum.iter_mut().zip(row) {
                *sum += x;
            }
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

    fn network(sizes: &[usize]) -> Mlp {
        let mut network = Mlp::orthogonal(sizes, 1.0, &mut ChaCha8Rng::seed_from_u64(11)).unwrap();
        for layer in network.layers().to_vec() {
            let bias = random(layer.outputs, layer.bias.start as u64);
            network.params_mut()[layer.bias].copy_from_slice(&bias);
        }
        network
    }

    /// Sum of outputs weighted by `d_output`, in double precision: its gradient is what `backward` adds.
    fn weighted_output(sizes: &[usize], params: &[f64], inputs: &[f64], d_output: &[f32]) -> f64 {
        let inputs: Vec<f64> = inputs.to_vec();
        inputs
            .chunks(sizes[0])
            .flat_map(|input| reference::forward_f64(sizes, params, input))
            .zip(d_output)
            .map(|(y, &w)| y * f64::from(w))
            .sum()
    }

    #[test]
    fn gradients_agree_with_finite_differences_of_a_double_precision_reference() {
        for sizes in [vec![5, 8, 7, 3], vec![4, 6, 1], vec![3, 2], vec![26, 64, 64, 6]] {
            let network = network(&sizes);
            let batch = 5;
            let inputs = random(batch * sizes[0], 1);
            let d_output = random(batch * network.output_size(), 2);
            let mut activations = network.activations();
            network.forward(&inputs, &mut activations);
            let mut gradient = vec![0.0; network.params().len()];
            let d_input = network.backward_to_input(&mut activations, &d_output, &mut gradient).to_vec();

            let params: Vec<f64> = network.params().iter().map(|&p| f64::from(p)).collect();
            let inputs: Vec<f64> = inputs.iter().map(|&x| f64::from(x)).collect();
            // Every 13th parameter of the large network: each costs two passes of the slow reference.
            let stride = if params.len() > 1000 { 13 } else { 1 };
            for layer in network.layers() {
                for tensor in [layer.weight.clone(), layer.bias.clone()] {
                    let indices: Vec<usize> = tensor.step_by(stride).collect();
                    let exact = reference::differences(&params, &indices, |params| {
                        weighted_output(&sizes, params, &inputs, &d_output)
                    });
                    let got: Vec<f32> = indices.iter().map(|&i| gradient[i]).collect();
                    let error = reference::relative_error(&got, &exact);
                    assert!(error < 1e-5, "{sizes:?}, {layer:?}: relative error {error}");
                }
            }
            let all: Vec<usize> = (0..inputs.len()).collect();
            let exact = reference::differences(&inputs, &all, |inputs| {
                weighted_output(&sizes, &params, inputs, &d_output)
            });
            let error = reference::relative_error(&d_input, &exact);
            assert!(error < 1e-5, "{sizes:?}, inputs: relative error {error}");
        }
    }

    #[test]
    fn a_second_backward_pass_adds_the_same_gradient_again() {
        let network = network(&[3, 4, 2]);
        let (inputs, d_output) = (random(6, 3), random(4, 4));
        let mut activations = network.activations();
        network.forward(&inputs, &mut activations);
        let mut once = vec![0.0; network.params().len()];
        network.backward(&mut activations, &d_output, &mut once);
        let mut twice = once.clone();
        network.backward(&mut activations, &d_output, &mut twice);
        for (once, twice) in once.iter().zip(&twice) {
            assert!((twice - 2.0 * once).abs() < 1e-6, "{once} once, {twice} twice");
        }
    }

    #[test]
    fn rows_of_a_table_are_inputs_in_the_order_asked_for() {
        let network = network(&[2, 3]);
        let mut activations = network.activations();
        activations.gather(&[0.0, 1.0, 10.0, 11.0, 20.0, 21.0], &[2, 0, 2]);
        assert_eq!(activations.input(), [20.0, 21.0, 0.0, 1.0, 20.0, 21.0]);
        let expected =
            network.forward(&[20.0, 21.0, 0.0, 1.0, 20.0, 21.0], &mut network.activations()).to_vec();
        assert_eq!(network.forward_loaded(&mut activations), expected);
        activations.gather(&[0.0, 1.0], &[]);
        assert!(network.forward_loaded(&mut activations).is_empty());
    }

    #[test]
    fn one_set_of_buffers_serves_batches_of_any_size() {
        let network = network(&[3, 4, 2]);
        let inputs = random(3 * 7, 5);
        let mut reused = network.activations();
        for batch in [7, 2, 0, 5] {
            let expected = network.forward(&inputs[..3 * batch], &mut network.activations()).to_vec();
            assert_eq!(network.forward(&inputs[..3 * batch], &mut reused), expected);
            let d_output = random(2 * batch, 6);
            let mut gradient = vec![0.0; network.params().len()];
            network.backward(&mut reused, &d_output, &mut gradient);
            assert_eq!(gradient.iter().all(|&g| g == 0.0), batch == 0);
        }
    }

    #[test]
    #[should_panic(expected = "activations of widths [3, 4, 2] for a network of widths [3, 5, 2]")]
    fn buffers_of_another_shape_are_refused() {
        network(&[3, 5, 2]).forward(&[0.0; 3], &mut network(&[3, 4, 2]).activations());
    }
}
