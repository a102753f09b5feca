//! What can go wrong with a worker, and with a job in it.

use std::fmt;
use std::io;
use std::time::Duration;

use super::process::Exit;
use crate::policy::Stopped;

/// Why a worker that is in order has no result for a job.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct JobError {
    /// Whether another try makes sense.
    pub kind: JobErrorKind,
    /// What happened, with the engine's own words.
    pub message: String,
}

/// Whether another try of a failed job makes sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobErrorKind {
    /// The job cannot be understood, or asks for what this worker does not have. It will never succeed.
    Invalid,
    /// The computation failed.
    Failed,
}

impl JobError {
    /// A job that can never succeed.
    pub fn invalid(message: impl Into<String>) -> Self {
        Self { kind: JobErrorKind::Invalid, message: message.into() }
    }

    /// A computation that failed.
    pub fn failed(message: impl Into<String>) -> Self {
        Self { kind: JobErrorKind::Failed, message: message.into() }
    }
}

impl From<Stopped> for JobError {
    fn from(stopped: Stopped) -> Self {
        Self::failed(stopped.to_string())
    }
}

/// Why a worker gave no result. Only after [`Self::Failed`] and [`Self::TooLarge`] can it be given another job; after
/// all others its process is gone.
#[derive(Debug, thiserror::Error)]
pub enum WorkerFault {
    /// Its program cannot be started.
    #[error("cannot start worker `{program}`: {source}")]
    Start {
        /// The program.
        program: String,
        /// What the system says.
        source: io::Error,
    },
    /// It did not answer the greeting in time.
    #[error("worker `{program}` did not answer within {} s{}", after.as_secs_f64(), Tail(stderr))]
    NoAnswer {
        /// The program.
        program: String,
        /// How long it was given.
        after: Duration,
        /// The last lines that it wrote to standard error.
        stderr: Vec<String>,
    },
    /// It is of another version.
    #[error(
        "worker `{program}` has {what} `{got}`, expected `{expected}`: program and worker must be built from the same sources; `tests/set-up` in the repository builds both"
    )]
    Mismatch {
        /// The program.
        program: String,
        /// What differs: `protocol` or `fingerprint`.
        what: &'static str,
        /// This program's.
        expected: String,
        /// The worker's.
        got: String,
    },
    /// Its process ended.
    #[error("worker `{program}` ended with {exit}{}", Tail(stderr))]
    Died {
        /// The program.
        program: String,
        /// How it ended.
        exit: Exit,
        /// The last lines that it wrote to standard error.
        stderr: Vec<String>,
    },
    /// It said something that makes no sense.
    #[error("worker `{program}` does not keep to the protocol: {problem}{}", Tail(stderr))]
    Protocol {
        /// The program.
        program: String,
        /// What it did.
        problem: String,
        /// The last lines that it wrote to standard error.
        stderr: Vec<String>,
    },
    /// It was silent for longer than [`super::Limits::silence`].
    #[error("worker `{program}` was silent for {} s (`workers.silence_seconds`) and was killed{}", after.as_secs_f64(), Tail(stderr))]
    Hung {
        /// The program.
        program: String,
        /// How long it was given.
        after: Duration,
        /// The last lines that it wrote to standard error.
        stderr: Vec<String>,
    },
    /// The job with its inputs does not fit into a message. It was not sent.
    #[error("a job of {bytes} bytes with its inputs, more than the {} that a worker takes", super::MAX_FRAME)]
    TooLarge {
        /// Its size.
        bytes: u64,
    },
    /// The job failed; the worker is in order.
    #[error(transparent)]
    Failed(#[from] JobError),
    /// The monitor asked to stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

impl WorkerFault {
    /// Whether the worker can be given another job.
    pub fn leaves_worker_usable(&self) -> bool {
        matches!(self, Self::Failed(_) | Self::TooLarge { .. })
    }

    /// Whether somebody killed it. A worker that was killed while it started can be started again; one that ended by
    /// itself would do so again.
    pub fn was_killed(&self) -> bool {
        matches!(self, Self::Died { exit: Exit::Signal(_), .. })
    }
}

/// What a worker wrote to standard error, as the end of a sentence.
struct Tail<'a>(&'a [String]);

impl fmt::Display for Tail<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            [] => Ok(()),
            lines => {
                f.write_str("; it wrote:")?;
                lines.iter().try_for_each(|line| write!(f, "\n  {line}"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_the_program_what_happened_and_what_it_said() {
        let stderr = vec!["ERROR: stack overflow".to_owned(), "bye".to_owned()];
        let program = || "elo-mujoco".to_owned();
        let died = WorkerFault::Died { program: program(), exit: Exit::Code(1), stderr };
        assert_eq!(
            died.to_string(),
            "worker `elo-mujoco` ended with exit code 1; it wrote:\n  ERROR: stack overflow\n  bye"
        );
        let after = Duration::from_millis(1500);
        let hung = WorkerFault::Hung { program: program(), after, stderr: vec![] };
        assert_eq!(
            hung.to_string(),
            "worker `elo-mujoco` was silent for 1.5 s (`workers.silence_seconds`) and was killed"
        );
        assert!(!hung.leaves_worker_usable());
        assert!(WorkerFault::from(JobError::failed("raised")).leaves_worker_usable());
    }
}
