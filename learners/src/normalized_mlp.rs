//! A network behind an observation normaliser: what every policy of this crate computes its actions with.

use std::cell::RefCell;

use elo_core::tensors::{TensorError, Tensors};

use crate::kernels::running_moments::Normalizer;
use crate::nn::{Mlp, Scratch};

/// `y = mlp(clamp((x − mean) · scale, ±10))`.
///
/// As tensors: `observation_mean` and `observation_scale` `[inputs]`, then for layer `i` from 0
/// `layer{i}.weight` `[inputs, outputs]` (the transpose of PyTorch's) and `layer{i}.bias` `[outputs]`. All layers but
/// the last are followed by `tanh`.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalizedMlp {
    normalizer: Normalizer,
    network: Mlp,
}

/// Working memory of one thread.
#[derive(Default)]
struct Memory {
    normalized: Vec<f32>,
    scratch: Scratch,
}

thread_local! {
    static MEMORY: RefCell<Memory> = RefCell::default();
}

impl NormalizedMlp {
    /// Joins the two.
    ///
    /// # Panics
    /// When the normaliser has another size than the network's input.
    pub fn new(normalizer: Normalizer, network: Mlp) -> Self {
        assert_eq!(normalizer.means.len(), network.input_size(), "size of a normaliser");
        Self { normalizer, network }
    }

    /// Writes the output for one observation. After the first call on a thread it allocates nothing.
    ///
    /// # Panics
    /// When `observation` or `output` has the wrong length.
    pub fn evaluate(&self, observation: &[f32], output: &mut [f32]) {
        MEMORY.with_borrow_mut(|Memory { normalized, scratch }| {
            normalized.resize(observation.len(), 0.0);
            self.normalizer.apply(observation, normalized);
            self.network.forward_one(normalized, scratch, output);
        });
    }

    /// Width of each layer's output but the last's.
    pub fn hidden(&self) -> Vec<usize> {
        let sizes = self.network.sizes();
        sizes[1..sizes.len() - 1].to_vec()
    }

    /// At rest, see the type.
    pub fn to_tensors(&self) -> Tensors {
        let Self { normalizer, network } = self;
        let mut tensors = Tensors::new();
        let inputs = network.input_size();
        tensors.insert("observation_mean", &[inputs], normalizer.means.clone());
        tensors.insert("observation_scale", &[inputs], normalizer.scales.clone());
        for (index, layer) in network.layers().iter().enumerate() {
            let (weight, bias) =
                (&network.params()[layer.weight.clone()], &network.params()[layer.bias.clone()]);
            tensors.insert(&weight_name(index), &[layer.inputs, layer.outputs], weight.to_vec());
            tensors.insert(&bias_name(index), &[layer.outputs], bias.to_vec());
        }
        tensors
    }

    /// Reads what [`Self::to_tensors`] wrote, of any depth and width within; tensors that are no part of a network are
    /// ignored.
    ///
    /// # Errors
    /// A tensor is missing, does not fit its neighbours, `inputs` or `outputs`, or holds a number that is not finite.
    pub fn from_tensors(tensors: &Tensors, inputs: usize, outputs: usize) -> Result<Self, TensorError> {
        let finite = |name: &str, shape: &[usize]| {
            let data = tensors.get_shaped(name, shape)?;
            if data.iter().all(|x| x.is_finite()) {
                Ok(data.to_vec())
            } else {
                Err(TensorError::NotFinite(name.to_owned()))
            }
        };
        let normalizer = Normalizer {
            means: finite("observation_mean", &[inputs])?,
            scales: finite("observation_scale", &[inputs])?,
        };
        let mut sizes = vec![inputs];
        let mut params = Vec::new();
        while sizes.len() == 1 || tensors.get(&weight_name(sizes.len() - 1)).is_ok() {
            let index = sizes.len() - 1;
            let before = sizes[index];
            let shape = &tensors.get(&weight_name(index))?.shape;
            let last = tensors.get(&weight_name(index + 1)).is_err();
            let width = match shape[..] {
                [rows, columns] if rows == before && columns > 0 && (!last || columns == outputs) => columns,
                _ => {
                    let columns = if last { outputs.to_string() } else { "at least 1".to_owned() };
                    let expected = format!("[{before}, {columns}]");
                    return Err(TensorError::Shape {
                        name: weight_name(index),
                        got: shape.clone(),
                        expected,
                    });
                }
            };
            params.extend(finite(&weight_name(index), &[before, width])?);
            params.extend(finite(&bias_name(index), &[width])?);
            sizes.push(width);
        }
        // A bias after the last layer belongs to a layer whose weight was lost.
        if tensors.get(&bias_name(sizes.len() - 1)).is_ok() {
            return Err(TensorError::Missing(weight_name(sizes.len() - 1)));
        }
        let network = Mlp::from_params(&sizes, params).expect("every width was checked above");
        Ok(Self { normalizer, network })
    }
}

fn weight_name(layer: usize) -> String {
    format!("layer{layer}.weight")
}

fn bias_name(layer: usize) -> String {
    format!("layer{layer}.bias")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::seed::Seed;

    use super::*;

    fn sample() -> NormalizedMlp {
        let network = Mlp::orthogonal(&[3, 5, 4, 2], 1.0, &mut Seed::root(1).stream()).unwrap();
        NormalizedMlp::new(Normalizer { means: vec![1.0, 2.0, 3.0], scales: vec![0.5, 1.0, 2.0] }, network)
    }

    #[test]
    fn the_observation_is_normalised_first() {
        // One layer that adds its inputs: (3 − 1)·½ + (2 − 2)·1 = 1; a far observation is cut to 10.
        let network = Mlp::from_params(&[2, 1], vec![1.0, 1.0, 0.0]).unwrap();
        let policy =
            NormalizedMlp::new(Normalizer { means: vec![1.0, 2.0], scales: vec![0.5, 1.0] }, network);
        let mut output = [0.0];
        policy.evaluate(&[3.0, 2.0], &mut output);
        assert_eq!(output, [1.0]);
        policy.evaluate(&[1e6, 2.0], &mut output);
        assert_eq!(output, [10.0]);
    }

    #[test]
    fn stored_and_read_again_it_is_the_same() {
        let tensors = Tensors::decode(&sample().to_tensors().encode()).unwrap();
        assert_eq!(NormalizedMlp::from_tensors(&tensors, 3, 2).unwrap(), sample());
        assert_eq!(sample().hidden(), [5, 4]);
    }

    #[test]
    fn tensors_that_do_not_fit_are_refused_by_name() {
        let whole = sample().to_tensors();
        let refused = |tensors: &Tensors, inputs, outputs| {
            NormalizedMlp::from_tensors(tensors, inputs, outputs).unwrap_err().to_string()
        };
        assert_eq!(refused(&whole, 4, 2), "tensor `observation_mean` has shape [3], expected [4]");
        assert_eq!(refused(&whole, 3, 6), "tensor `layer2.weight` has shape [4, 2], expected [4, 6]");
        assert_eq!(refused(&Tensors::new(), 3, 2), "tensor `observation_mean` is missing");
        for (name, tensor) in whole.iter() {
            let mut longer = whole.clone();
            let shape: Vec<usize> = tensor.shape.iter().map(|extent| extent + 1).collect();
            longer.insert(name, &shape, vec![0.0; shape.iter().product()]);
            refused(&longer, 3, 2);
            let mut spoilt = whole.clone();
            let mut data = tensor.data.clone();
            data[0] = f32::NAN;
            spoilt.insert(name, &tensor.shape, data);
            assert_eq!(refused(&spoilt, 3, 2), format!("tensor `{name}` has a number that is not finite"));
        }
    }
}
