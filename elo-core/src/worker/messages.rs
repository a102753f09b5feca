//! What parent and worker say to each other; the table in the [module above](super) gives the bytes.

use std::borrow::Cow;
use std::io::Read;

use super::fault::{JobError, JobErrorKind};
use super::frames::{FrameError, FrameReader, FrameWriter, read_frame};

/// The number of this version of the protocol, raised also when the stages of [`crate::units::Work`] or their checkpoints change.
pub const PROTOCOL: u32 = 4;

/// What the parent says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request<'a> {
    /// The first message.
    Hello {
        /// The parent's [`PROTOCOL`].
        protocol: u32,
        /// The parent's program and version, as in the keys of units.
        fingerprint: Cow<'a, str>,
    },
    /// Something to compute.
    Job {
        /// To be repeated in each answer.
        id: u64,
        /// What to compute, as JSON.
        job: Cow<'a, [u8]>,
        /// The results of the units that it builds on.
        inputs: Cow<'a, [Vec<u8>]>,
        /// How many threads it may use.
        threads: u32,
        /// Where to take it up, if it was interrupted.
        checkpoint: Option<Cow<'a, [u8]>>,
    },
    /// The worker is to end; its job, if any, is no longer wanted.
    Stop,
}

/// What the worker says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply<'a> {
    /// The answer to the parent's greeting.
    Hello {
        /// The worker's [`PROTOCOL`].
        protocol: u32,
        /// The worker's program and version, which must be the parent's.
        fingerprint: Cow<'a, str>,
        /// The engine that it runs, with its version.
        engine: Cow<'a, str>,
    },
    /// It has come this far.
    Progress {
        /// The job.
        id: u64,
        /// Simulator steps done.
        done: u64,
        /// Simulator steps in all.
        total: u64,
    },
    /// The job can be taken up from here.
    Checkpoint {
        /// The job.
        id: u64,
        /// For [`Request::Job::checkpoint`].
        bytes: Cow<'a, [u8]>,
    },
    /// The job is done.
    Done {
        /// The job.
        id: u64,
        /// Its result.
        bytes: Cow<'a, [u8]>,
    },
    /// The job has no result.
    Failed {
        /// The job.
        id: u64,
        /// Why.
        error: JobError,
    },
}

impl Request<'_> {
    /// The message as a frame.
    ///
    /// # Errors
    /// [`FrameError::Length`] when it is longer than a frame may be.
    pub fn encode(&self) -> Result<Vec<u8>, FrameError> {
        match self {
            Self::Hello { protocol, fingerprint } => {
                FrameWriter::new(1).u32(*protocol).bytes(fingerprint.as_bytes()).finish()
            }
            Self::Job { id, job, inputs, threads, checkpoint } => {
                let mut frame =
                    FrameWriter::new(2).u64(*id).u32(*threads).bytes(job).u32(inputs.len() as u32);
                for input in inputs.iter() {
                    frame = frame.bytes(input);
                }
                match checkpoint {
                    Some(bytes) => frame.byte(1).bytes(bytes).finish(),
                    None => frame.byte(0).finish(),
                }
            }
            Self::Stop => FrameWriter::new(3).finish(),
        }
    }

    /// The next message, or `None` at the end of the input.
    ///
    /// # Errors
    /// [`FrameError`]. Nothing can be read from `input` after one.
    pub fn read(input: &mut impl Read) -> Result<Option<Self>, FrameError> {
        let Some((kind, fields)) = read_frame(input)? else { return Ok(None) };
        let mut fields = FrameReader::new(kind, &fields);
        let message = match kind {
            1 => Self::Hello { protocol: fields.u32()?, fingerprint: fields.text()? },
            2 => {
                let (id, threads) = (fields.u64()?, fields.u32()?);
                let job = fields.bytes()?.into();
                let count = fields.u32()?;
                let inputs = (0..count).map(|_| fields.bytes()).collect::<Result<Vec<_>, _>>()?.into();
                let checkpoint = match fields.byte()? {
                    0 => None,
                    1 => Some(fields.bytes()?.into()),
                    _ => return Err(fields.malformed("neither has nor lacks a checkpoint")),
                };
                Self::Job { id, job, inputs, threads, checkpoint }
            }
            3 => Self::Stop,
            _ => return Err(FrameError::Kind(kind)),
        };
        fields.finish()?;
        Ok(Some(message))
    }
}

impl Reply<'_> {
    /// The job that it is about.
    pub fn id(&self) -> Option<u64> {
        match self {
            Self::Hello { .. } => None,
            Self::Progress { id, .. }
            | Self::Checkpoint { id, .. }
            | Self::Done { id, .. }
            | Self::Failed { id, .. } => Some(*id),
        }
    }

    /// The message as a frame.
    ///
    /// # Errors
    /// [`FrameError::Length`] when it is longer than a frame may be.
    pub fn encode(&self) -> Result<Vec<u8>, FrameError> {
        match self {
            Self::Hello { protocol, fingerprint, engine } => {
                FrameWriter::new(17).u32(*protocol).bytes(fingerprint.as_bytes()).bytes(engine.as_bytes())
            }
            Self::Progress { id, done, total } => FrameWriter::new(18).u64(*id).u64(*done).u64(*total),
            Self::Checkpoint { id, bytes } => FrameWriter::new(19).u64(*id).bytes(bytes),
            Self::Done { id, bytes } => FrameWriter::new(20).u64(*id).bytes(bytes),
            Self::Failed { id, error } => {
                let kind = match error.kind {
                    JobErrorKind::Invalid => 0,
                    JobErrorKind::Failed => 1,
                };
                FrameWriter::new(21).u64(*id).byte(kind).bytes(error.message.as_bytes())
            }
        }
        .finish()
    }

    /// The next message, or `None` at the end of the input.
    ///
    /// # Errors
    /// [`FrameError`]. Nothing can be read from `input` after one.
    pub fn read(input: &mut impl Read) -> Result<Option<Self>, FrameError> {
        let Some((kind, fields)) = read_frame(input)? else { return Ok(None) };
        let mut fields = FrameReader::new(kind, &fields);
        let message = match kind {
            17 => {
                Self::Hello { protocol: fields.u32()?, fingerprint: fields.text()?, engine: fields.text()? }
            }
            18 => Self::Progress { id: fields.u64()?, done: fields.u64()?, total: fields.u64()? },
            19 => Self::Checkpoint { id: fields.u64()?, bytes: fields.bytes()?.into() },
            20 => Self::Done { id: fields.u64()?, bytes: fields.bytes()?.into() },
            21 => {
                let id = fields.u64()?;
                let kind = match fields.byte()? {
                    0 => JobErrorKind::Invalid,
                    1 => JobErrorKind::Failed,
                    _ => return Err(fields.malformed("has an unknown kind of failure")),
                };
                Self::Failed { id, error: JobError { kind, message: fields.text()?.into_owned() } }
            }
            _ => return Err(FrameError::Kind(kind)),
        };
        fields.finish()?;
        Ok(Some(message))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::seed::Seed;
    use rand::RngExt;

    fn requests() -> Vec<Request<'static>> {
        let job = |inputs: Vec<Vec<u8>>, checkpoint: Option<&'static [u8]>| Request::Job {
            id: 9,
            job: Cow::Borrowed(b"{\"unit\":\"teacher\"}"),
            inputs: inputs.into(),
            threads: 3,
            checkpoint: checkpoint.map(Cow::Borrowed),
        };
        vec![
            Request::Hello { protocol: 1, fingerprint: "elo 0.1.0 ψ".into() },
            job(vec![], None),
            job(vec![b"one".to_vec(), vec![], b"three".to_vec()], Some(b"checkpoint")),
            Request::Stop,
        ]
    }

    fn replies() -> Vec<Reply<'static>> {
        let failed =
            |kind, message: &str| Reply::Failed { id: 5, error: JobError { kind, message: message.into() } };
        vec![
            Reply::Hello { protocol: 2, fingerprint: "".into(), engine: "mujoco 3.17.0".into() },
            Reply::Progress { id: 1, done: 2, total: u64::MAX },
            Reply::Checkpoint { id: 3, bytes: Cow::Borrowed(b"bytes") },
            Reply::Done { id: 4, bytes: Cow::Borrowed(b"") },
            failed(JobErrorKind::Invalid, "no such unit"),
            failed(JobErrorKind::Failed, ""),
        ]
    }

    fn frames() -> Vec<Vec<u8>> {
        let requests = requests().into_iter().map(|message| message.encode().unwrap());
        requests.chain(replies().into_iter().map(|message| message.encode().unwrap())).collect()
    }

    #[test]
    fn messages_come_out_as_they_went_in() {
        let bytes: Vec<u8> = requests().iter().flat_map(|message| message.encode().unwrap()).collect();
        let mut input = bytes.as_slice();
        for message in requests() {
            assert_eq!(Request::read(&mut input).unwrap(), Some(message));
        }
        assert_eq!(Request::read(&mut input).unwrap(), None);
        let bytes: Vec<u8> = replies().iter().flat_map(|message| message.encode().unwrap()).collect();
        let mut input = bytes.as_slice();
        for message in replies() {
            assert_eq!(Reply::read(&mut input).unwrap(), Some(message));
        }
        assert_eq!(Reply::read(&mut input).unwrap(), None);
    }

    #[test]
    fn a_message_that_ends_anywhere_is_refused() {
        for frame in frames() {
            for length in 1..frame.len() {
                assert!(matches!(Request::read(&mut &frame[..length]), Err(FrameError::Ended)));
                assert!(matches!(Reply::read(&mut &frame[..length]), Err(FrameError::Ended)));
            }
        }
    }

    /// With the length of the frame changed to fit, the fields are short or long of what the kind has.
    #[test]
    fn a_message_with_fields_missing_or_left_over_is_refused() {
        let malformed = |frame: &[u8]| {
            let length = ((frame.len() - 4) as u32).to_le_bytes();
            let frame = [&length, &frame[4..]].concat();
            let request = matches!(Request::read(&mut frame.as_slice()), Err(FrameError::Malformed { .. }));
            request || matches!(Reply::read(&mut frame.as_slice()), Err(FrameError::Malformed { .. }))
        };
        for frame in frames() {
            for length in 5..frame.len() {
                assert!(malformed(&frame[..length]), "{length} of {frame:?}");
            }
            assert!(malformed(&[&frame[..], &[0]].concat()), "{frame:?} and one more");
        }
    }

    #[test]
    fn what_one_side_says_is_not_understood_as_the_other() {
        for message in requests() {
            let frame = message.encode().unwrap();
            assert!(matches!(Reply::read(&mut frame.as_slice()), Err(FrameError::Kind(1..=3))));
        }
        for message in replies() {
            let frame = message.encode().unwrap();
            assert!(matches!(Request::read(&mut frame.as_slice()), Err(FrameError::Kind(17..=21))));
        }
    }

    #[test]
    fn garbage_is_refused_or_read_as_something_no_greater_than_itself() {
        let mut chance = Seed::root(23).stream();
        let frames = frames();
        let mut understood = 0;
        for _ in 0..20_000 {
            let mut frame = frames[chance.random_range(0..frames.len())].clone();
            for _ in 0..chance.random_range(1..4) {
                let at = chance.random_range(0..frame.len());
                match chance.random_range(0..4) {
                    0 => frame[at] = chance.random(),
                    1 => frame[at] ^= 1 << chance.random_range(0..8),
                    2 => frame.insert(at, chance.random()),
                    _ => drop(frame.remove(at)),
                }
            }
            if let Ok(Some(message)) = Request::read(&mut frame.as_slice()) {
                understood += 1;
                assert!(message.encode().unwrap().len() <= frame.len());
            }
            if let Ok(Some(message)) = Reply::read(&mut frame.as_slice()) {
                understood += 1;
                assert!(message.encode().unwrap().len() <= frame.len());
            }
        }
        assert!(understood > 100, "the mutations never make another message: {understood}");
    }
}
