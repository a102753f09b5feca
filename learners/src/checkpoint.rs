//! The bytes of checkpoints: `u64` little-endian length of a JSON head, the head, a safetensors file of the numbers.

use elo_core::tensors::Tensors;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The bytes.
///
/// # Panics
/// When the head cannot be JSON.
pub(crate) fn write(head: &impl Serialize, tensors: &Tensors) -> Vec<u8> {
    let head = serde_json::to_vec(head).expect("counts, finite numbers and short names");
    let length = (head.len() as u64).to_le_bytes();
    [length.as_slice(), &head, &tensors.encode()].concat()
}

/// What [`write`] was given.
///
/// # Errors
/// Bytes that it did not write, or with another head.
pub(crate) fn read<H: DeserializeOwned>(bytes: &[u8]) -> Result<(H, Tensors), String> {
    let cut = || "cut short".to_owned();
    let (length, rest) = bytes.split_first_chunk::<8>().ok_or_else(cut)?;
    let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| cut())?;
    let (head, tensors) = rest.split_at_checked(length).ok_or_else(cut)?;
    let head = serde_json::from_slice(head).map_err(|error| error.to_string())?;
    Ok((head, Tensors::decode(tensors).map_err(|error| error.to_string())?))
}
