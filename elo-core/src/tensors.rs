//! Named `f32` arrays, stored as safetensors: what trained things are made of.

use std::collections::BTreeMap;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

/// Named arrays in the order of their names.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tensors(BTreeMap<String, Tensor>);

/// One array, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Its extents; their product is the length of `data`.
    pub shape: Vec<usize>,
    /// Its numbers.
    pub data: Vec<f32>,
}

/// Why tensors could not be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TensorError {
    /// Not safetensors, or cut short.
    #[error("not a safetensors file: {0}")]
    Malformed(String),
    /// A tensor that is not `f32`.
    #[error("tensor `{0}` is {1}, expected F32")]
    Dtype(String, String),
    /// A tensor that should be there is not.
    #[error("tensor `{0}` is missing")]
    Missing(String),
    /// A tensor has other extents than expected.
    #[error("tensor `{name}` has shape {got:?}, expected {expected}")]
    Shape {
        /// Its name.
        name: String,
        /// Its extents.
        got: Vec<usize>,
        /// What was expected.
        expected: String,
    },
    /// A number is NaN or infinite.
    #[error("tensor `{0}` has a number that is not finite")]
    NotFinite(String),
    /// More than a reader is willing to hold.
    #[error("{0} bytes of tensors, more than the {1} allowed")]
    TooLarge(usize, usize),
    /// What the tensors stand for cannot be made.
    #[error("{0}")]
    Unmade(String),
}

impl Tensors {
    /// The greatest file that [`Self::decode`] accepts: 256 MiB.
    pub const MAX_BYTES: usize = 256 << 20;

    /// No tensors.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds or replaces a tensor.
    ///
    /// # Panics
    /// When `data` does not have the product of `shape` many numbers: a mistake of the caller.
    pub fn insert(&mut self, name: &str, shape: &[usize], data: Vec<f32>) {
        assert_eq!(shape.iter().product::<usize>(), data.len(), "shape {shape:?} of tensor `{name}`");
        self.0.insert(name.to_owned(), Tensor { shape: shape.to_vec(), data });
    }

    /// The tensor called `name`.
    ///
    /// # Errors
    /// [`TensorError::Missing`].
    pub fn get(&self, name: &str) -> Result<&Tensor, TensorError> {
        self.0.get(name).ok_or_else(|| TensorError::Missing(name.to_owned()))
    }

    /// The numbers of tensor `name`, which must have exactly these extents.
    ///
    /// # Errors
    /// [`TensorError::Missing`] or [`TensorError::Shape`].
    pub fn get_shaped(&self, name: &str, shape: &[usize]) -> Result<&[f32], TensorError> {
        let tensor = self.get(name)?;
        if tensor.shape == shape {
            Ok(&tensor.data)
        } else {
            let expected = format!("{shape:?}");
            Err(TensorError::Shape { name: name.to_owned(), got: tensor.shape.clone(), expected })
        }
    }

    /// Names and tensors, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.0.iter().map(|(name, tensor)| (name.as_str(), tensor))
    }

    /// All tensors of `other` under `prefix` + their name.
    pub fn extend_prefixed(&mut self, prefix: &str, other: &Self) {
        for (name, tensor) in &other.0 {
            self.0.insert(format!("{prefix}{name}"), tensor.clone());
        }
    }

    /// The tensors whose name starts with `prefix`, without it.
    pub fn with_prefix(&self, prefix: &str) -> Self {
        let below = self.0.range(prefix.to_owned()..).take_while(|(name, _)| name.starts_with(prefix));
        Self(below.map(|(name, tensor)| (name[prefix.len()..].to_owned(), tensor.clone())).collect())
    }

    /// The safetensors file. The same tensors give the same bytes.
    pub fn encode(&self) -> Vec<u8> {
        let bytes: Vec<(&String, &Tensor, Vec<u8>)> = self
            .0
            .iter()
            .map(|(name, tensor)| (name, tensor, tensor.data.iter().flat_map(|x| x.to_le_bytes()).collect()))
            .collect();
        let views = bytes.iter().map(|(name, tensor, data)| {
            let view =
                TensorView::new(Dtype::F32, tensor.shape.clone(), data).expect("insert checked the length");
            (name.as_str(), view)
        });
        safetensors::serialize(views, None).expect("names and shapes are plain")
    }

    /// Reads a safetensors file of finite `f32` tensors.
    ///
    /// # Errors
    /// [`TensorError`]: malformed, too large, of another type, or with a number that is not finite.
    pub fn decode(bytes: &[u8]) -> Result<Self, TensorError> {
        if bytes.len() > Self::MAX_BYTES {
            return Err(TensorError::TooLarge(bytes.len(), Self::MAX_BYTES));
        }
        let file =
            SafeTensors::deserialize(bytes).map_err(|error| TensorError::Malformed(error.to_string()))?;
        let mut tensors = Self::new();
        for (name, view) in file.iter() {
            if view.dtype() != Dtype::F32 {
                return Err(TensorError::Dtype(name.to_owned(), format!("{:?}", view.dtype())));
            }
            let data: Vec<f32> =
                view.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
            if !data.iter().all(|x| x.is_finite()) {
                return Err(TensorError::NotFinite(name.to_owned()));
            }
            tensors.insert(name, view.shape(), data);
        }
        Ok(tensors)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Tensors {
        let mut tensors = Tensors::new();
        tensors.insert("b/weight", &[2, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.5]);
        tensors.insert("a", &[0], vec![]);
        tensors
    }

    #[test]
    fn a_file_gives_back_what_was_written_and_the_same_bytes() {
        let bytes = sample().encode();
        assert_eq!(Tensors::decode(&bytes), Ok(sample()));
        assert_eq!(sample().encode(), bytes);
    }

    #[test]
    fn files_that_are_cut_short_or_hold_nan_are_refused() {
        let bytes = sample().encode();
        for length in 0..bytes.len() {
            assert!(Tensors::decode(&bytes[..length]).is_err(), "{length} of {} bytes", bytes.len());
        }
        let mut tensors = sample();
        tensors.insert("c", &[1], vec![f32::NAN]);
        assert_eq!(Tensors::decode(&tensors.encode()), Err(TensorError::NotFinite("c".to_owned())));
    }

    #[test]
    fn prefixes_nest() {
        let mut outer = Tensors::new();
        outer.extend_prefixed("option.3.", &sample());
        outer.insert("option.4", &[1], vec![0.0]);
        assert_eq!(outer.with_prefix("option.3."), sample());
    }
}
