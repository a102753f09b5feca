//! The bytes of a unit's result: a JSON part and any number of binary sections.
//!
//! Layout, all integers little-endian: `u32` number of parts, `u64` length of each, then the parts. The first part is
//! the JSON.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Why a result could not be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("malformed unit result: {0}")]
pub struct Malformed(pub String);

/// Writes `head` and the `sections`.
pub fn encode(head: &impl Serialize, sections: &[&[u8]]) -> Vec<u8> {
    let head = serde_json::to_vec(head).expect("results are plain data with finite numbers");
    let parts: Vec<&[u8]> = std::iter::once(head.as_slice()).chain(sections.iter().copied()).collect();
    let mut bytes = (parts.len() as u32).to_le_bytes().to_vec();
    bytes.extend(parts.iter().flat_map(|part| (part.len() as u64).to_le_bytes()));
    bytes.extend(parts.concat());
    bytes
}

/// Reads what [`encode`] wrote.
///
/// # Errors
/// [`Malformed`]; lengths are checked before anything is copied.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<(T, Vec<&[u8]>), Malformed> {
    let cut = || Malformed("cut short".to_owned());
    let (count, mut rest) = bytes.split_first_chunk::<4>().ok_or_else(cut)?;
    let count = u32::from_le_bytes(*count) as usize;
    if count == 0 || count > rest.len() / 8 {
        return Err(Malformed(format!("{count} parts")));
    }
    let lengths: Vec<usize> = rest[..8 * count]
        .as_chunks::<8>()
        .0
        .iter()
        .map(|length| usize::try_from(u64::from_le_bytes(*length)).map_err(|_| cut()))
        .collect::<Result<_, _>>()?;
    rest = &rest[8 * count..];
    let mut parts = Vec::with_capacity(count);
    for length in lengths {
        let (part, after) = rest.split_at_checked(length).ok_or_else(cut)?;
        parts.push(part);
        rest = after;
    }
    if !rest.is_empty() {
        return Err(Malformed("bytes left over".to_owned()));
    }
    let head = serde_json::from_slice(parts.remove(0)).map_err(|error| Malformed(error.to_string()))?;
    Ok((head, parts))
}

/// Rows of numbers, each as `bytes` writes them.
pub fn encode_rows<T>(rows: &[Vec<T>], bytes: fn(&[T]) -> Vec<u8>) -> Vec<u8> {
    let sections: Vec<Vec<u8>> = rows.iter().map(|row| bytes(row)).collect();
    encode(&rows.len(), &sections.iter().map(Vec::as_slice).collect::<Vec<_>>())
}

/// Reads what [`encode_rows`] wrote, each row by `numbers`.
///
/// # Errors
/// [`Malformed`].
pub fn decode_rows<T>(
    bytes: &[u8],
    numbers: fn(&[u8], usize) -> Result<Vec<T>, Malformed>,
) -> Result<Vec<Vec<T>>, Malformed> {
    let (count, sections): (usize, _) = decode(bytes)?;
    if count != sections.len() {
        return Err(Malformed(format!("{} rows of {count}", sections.len())));
    }
    sections.iter().map(|section| numbers(section, section.len() / size_of::<T>())).collect()
}

/// Little-endian bytes of numbers.
pub fn f64_bytes(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// The numbers of [`f64_bytes`].
///
/// # Errors
/// [`Malformed`] unless there are exactly `count`.
pub fn f64_numbers(bytes: &[u8], count: usize) -> Result<Vec<f64>, Malformed> {
    exact(bytes.len(), count * 8)?;
    Ok(bytes.as_chunks::<8>().0.iter().map(|x| f64::from_le_bytes(*x)).collect())
}

/// Little-endian bytes of numbers.
pub fn f32_bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// The numbers of [`f32_bytes`].
///
/// # Errors
/// [`Malformed`] unless there are exactly `count`.
pub fn f32_numbers(bytes: &[u8], count: usize) -> Result<Vec<f32>, Malformed> {
    exact(bytes.len(), count * 4)?;
    Ok(bytes.as_chunks::<4>().0.iter().map(|x| f32::from_le_bytes(*x)).collect())
}

/// Little-endian bytes of numbers.
pub fn u32_bytes(numbers: &[u32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// The numbers of [`u32_bytes`].
///
/// # Errors
/// [`Malformed`] unless there are exactly `count`.
pub fn u32_numbers(bytes: &[u8], count: usize) -> Result<Vec<u32>, Malformed> {
    exact(bytes.len(), count * 4)?;
    Ok(bytes.as_chunks::<4>().0.iter().map(|x| u32::from_le_bytes(*x)).collect())
}

fn exact(got: usize, expected: usize) -> Result<(), Malformed> {
    if got == expected {
        Ok(())
    } else {
        Err(Malformed(format!("{got} bytes in a section, expected {expected}")))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn parts_come_back_and_every_truncation_is_noticed() {
        let bytes = encode(&vec![1.5, -0.1], &[&[1, 2, 3], &[]]);
        let (head, sections) = decode::<Vec<f64>>(&bytes).unwrap();
        assert_eq!((head, sections), (vec![1.5, -0.1], vec![&[1u8, 2, 3][..], &[]]));
        for length in 0..bytes.len() {
            assert!(decode::<Vec<f64>>(&bytes[..length]).is_err(), "{length}");
        }
        assert!(decode::<Vec<f64>>(&[bytes.as_slice(), &[0]].concat()).is_err());
        assert!(decode::<Vec<f64>>(&[0xff; 64]).is_err());
    }

    #[test]
    fn rows_of_any_lengths_come_back_whole_or_not_at_all() {
        let rows = vec![vec![0.5_f32, -3.0], vec![], vec![f32::MAX]];
        let bytes = encode_rows(&rows, f32_bytes);
        assert_eq!(decode_rows(&bytes, f32_numbers), Ok(rows));
        assert!(decode_rows(&bytes, f64_numbers).is_err());
        assert!(decode_rows(&encode(&2, &[&[0; 8]]), f32_numbers).is_err());
    }
}
