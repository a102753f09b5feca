//! The bytes on the pipes: frames with a length that is checked before anything is made for it, and their fields.

use std::borrow::Cow;
use std::io::{self, ErrorKind, Read};

/// The greatest length that a frame may have, without the four bytes that tell it: 64 MiB.
pub const MAX_FRAME: usize = 64 << 20;

/// Why a frame could not be read or made.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// The pipe broke.
    #[error("the pipe broke: {0}")]
    Io(#[from] io::Error),
    /// The other side ended in the middle of a frame.
    #[error("the data end inside a frame")]
    Ended,
    /// A frame that is empty or longer than [`MAX_FRAME`].
    #[error("a frame of {0} bytes, expected 1 to {MAX_FRAME}")]
    Length(u64),
    /// A kind that the other side does not send.
    #[error("a frame of unknown kind {0}")]
    Kind(u8),
    /// The fields of a frame are not those of its kind.
    #[error("a frame of kind {kind} {problem}")]
    Malformed {
        /// Its kind.
        kind: u8,
        /// What is wrong with it.
        problem: &'static str,
    },
}

/// A frame that is being made.
pub(super) struct FrameWriter(Vec<u8>);

impl FrameWriter {
    pub(super) fn new(kind: u8) -> Self {
        Self(vec![0, 0, 0, 0, kind])
    }

    pub(super) fn byte(mut self, byte: u8) -> Self {
        self.0.push(byte);
        self
    }

    pub(super) fn u32(mut self, number: u32) -> Self {
        self.0.extend_from_slice(&number.to_le_bytes());
        self
    }

    pub(super) fn u64(mut self, number: u64) -> Self {
        self.0.extend_from_slice(&number.to_le_bytes());
        self
    }

    /// Bytes that are too long for their length to be told make a frame that [`Self::finish`] refuses.
    pub(super) fn bytes(self, bytes: &[u8]) -> Self {
        let mut told = self.u32(u32::try_from(bytes.len()).unwrap_or(u32::MAX));
        told.0.extend_from_slice(bytes);
        told
    }

    /// The frame with its length, or [`FrameError::Length`].
    pub(super) fn finish(mut self) -> Result<Vec<u8>, FrameError> {
        let length = self.0.len() - 4;
        if length > MAX_FRAME {
            return Err(FrameError::Length(length as u64));
        }
        self.0[..4].copy_from_slice(&(length as u32).to_le_bytes());
        Ok(self.0)
    }
}

/// Kind and fields of the next frame, or `None` when the other side has ended. Memory grows with what arrives, not
/// with the length that is told.
pub(super) fn read_frame(input: &mut impl Read) -> Result<Option<(u8, Vec<u8>)>, FrameError> {
    let mut length = [0; 4];
    let mut got = 0;
    while got < length.len() {
        match input.read(&mut length[got..]) {
            Ok(0) if got == 0 => return Ok(None),
            Ok(0) => return Err(FrameError::Ended),
            Ok(more) => got += more,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error.into()),
        }
    }
    let length = u32::from_le_bytes(length);
    if length == 0 || length as usize > MAX_FRAME {
        return Err(FrameError::Length(length.into()));
    }
    let mut kind = [0];
    let mut fields = Vec::new();
    let mut frame = input.take(length.into());
    frame.read_exact(&mut kind).map_err(|error| match error.kind() {
        ErrorKind::UnexpectedEof => FrameError::Ended,
        _ => error.into(),
    })?;
    frame.read_to_end(&mut fields)?;
    if fields.len() + 1 < length as usize {
        return Err(FrameError::Ended);
    }
    Ok(Some((kind[0], fields)))
}

/// The fields of a frame that are still to be read.
pub(super) struct FrameReader<'a> {
    kind: u8,
    rest: &'a [u8],
}

impl<'a> FrameReader<'a> {
    pub(super) fn new(kind: u8, fields: &'a [u8]) -> Self {
        Self { kind, rest: fields }
    }

    pub(super) fn malformed(&self, problem: &'static str) -> FrameError {
        FrameError::Malformed { kind: self.kind, problem }
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], FrameError> {
        let (taken, rest) = self.rest.split_at_checked(length).ok_or(self.malformed("is too short"))?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], FrameError> {
        Ok(self.take(N)?.try_into().expect("it has the length that was asked for"))
    }

    pub(super) fn byte(&mut self) -> Result<u8, FrameError> {
        Ok(self.array::<1>()?[0])
    }

    pub(super) fn u32(&mut self) -> Result<u32, FrameError> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, FrameError> {
        self.array().map(u64::from_le_bytes)
    }

    pub(super) fn bytes(&mut self) -> Result<Vec<u8>, FrameError> {
        let length = self.u32()?;
        self.take(length as usize).map(<[u8]>::to_vec)
    }

    pub(super) fn text(&mut self) -> Result<Cow<'static, str>, FrameError> {
        let bytes = self.bytes()?;
        String::from_utf8(bytes).map(Cow::Owned).map_err(|_| self.malformed("has text that is not UTF-8"))
    }

    pub(super) fn finish(self) -> Result<(), FrameError> {
        if self.rest.is_empty() { Ok(()) } else { Err(self.malformed("is too long")) }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Input that notes the greatest buffer that it was asked to fill.
    struct Watched<'a> {
        bytes: &'a [u8],
        greatest: usize,
    }

    impl Read for Watched<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            self.greatest = self.greatest.max(buffer.len());
            self.bytes.read(buffer)
        }
    }

    #[test]
    fn frames_follow_each_other_until_the_end() {
        let mut bytes = FrameWriter::new(7).u64(1).bytes(b"ab").finish().unwrap();
        assert_eq!(bytes, [15, 0, 0, 0, 7, 1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, b'a', b'b']);
        bytes.extend(FrameWriter::new(8).finish().unwrap());
        let mut input = bytes.as_slice();
        assert_eq!(read_frame(&mut input).unwrap(), Some((7, bytes[5..19].to_vec())));
        assert_eq!(read_frame(&mut input).unwrap(), Some((8, vec![])));
        assert_eq!(read_frame(&mut input).unwrap(), None);
    }

    #[test]
    fn lengths_are_refused_before_any_memory_is_taken_for_them() {
        for length in [0, MAX_FRAME as u32 + 1, u32::MAX] {
            let bytes = [&length.to_le_bytes()[..], &[7; 100]].concat();
            let mut input = Watched { bytes: &bytes, greatest: 0 };
            assert!(
                matches!(read_frame(&mut input), Err(FrameError::Length(told)) if told == u64::from(length))
            );
            assert_eq!(input.greatest, 4);
        }
    }

    #[test]
    fn memory_grows_with_what_arrives_and_not_with_what_is_told() {
        let bytes = [&(MAX_FRAME as u32).to_le_bytes()[..], &[7; 100]].concat();
        let mut input = Watched { bytes: &bytes, greatest: 0 };
        assert!(matches!(read_frame(&mut input), Err(FrameError::Ended)));
        assert!(input.greatest < 1 << 16, "{} bytes", input.greatest);
    }

    #[test]
    fn the_greatest_frame_passes_and_a_byte_more_is_refused() {
        let greatest = MAX_FRAME - 5;
        let frame = FrameWriter::new(7).bytes(&vec![1; greatest]).finish().unwrap();
        assert_eq!(read_frame(&mut frame.as_slice()).unwrap().unwrap().1.len(), greatest + 4);
        let longer = FrameWriter::new(7).bytes(&vec![1; greatest + 1]).finish();
        assert!(matches!(longer, Err(FrameError::Length(length)) if length == MAX_FRAME as u64 + 1));
    }
}
