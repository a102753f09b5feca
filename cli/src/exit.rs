//! How a command ends: one table of exit codes and messages.

use std::fmt;
use std::io::ErrorKind;
use std::process::ExitCode;

use elo_core::crew::RunError;
use elo_core::run_dir::RunDirError;

use crate::interrupt;
use crate::output::print_error;

/// Why a command did not do what was asked.
#[derive(Debug)]
pub enum Exit {
    /// 1: the run failed.
    Failed(String),
    /// 2: bad input; nothing was started.
    BadInput(String),
    /// 3: another process holds the run directory.
    Held(String),
    /// 128 and the signal's number.
    Interrupted(String),
    /// 0: whoever read our output has gone.
    ReaderGone,
}

impl Exit {
    /// Bad input with another line that says what to do; anything else as it is.
    pub fn with_hint(self, hint: &str) -> Self {
        match self {
            Self::BadInput(message) => Self::BadInput(format!("{message}\n{hint}")),
            other => other,
        }
    }

    /// Prints the message, if any, and gives the process's code.
    pub fn code(done: Result<(), Self>) -> ExitCode {
        let Err(exit) = done else { return ExitCode::SUCCESS };
        let code = match &exit {
            Self::Failed(_) => 1,
            Self::BadInput(_) => 2,
            Self::Held(_) => 3,
            Self::Interrupted(_) => interrupt::exit_code(),
            Self::ReaderGone => 0,
        };
        if !matches!(exit, Self::ReaderGone) {
            print_error(&exit.to_string());
        }
        ExitCode::from(code)
    }
}

impl std::error::Error for Exit {}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Failed(message)
            | Self::BadInput(message)
            | Self::Held(message)
            | Self::Interrupted(message) => f.write_str(message),
            Self::ReaderGone => f.write_str("the reader of the output has gone"),
        }
    }
}

impl From<RunError> for Exit {
    fn from(error: RunError) -> Self {
        let message = error.to_string();
        match error {
            RunError::Interrupted => Self::Interrupted(message),
            RunError::RunDir(error) => error.into(),
            RunError::Config(_) | RunError::Unit { .. } | RunError::Worker(_) | RunError::Select(_) => {
                Self::Failed(message)
            }
        }
    }
}

impl From<RunDirError> for Exit {
    fn from(error: RunDirError) -> Self {
        let message = error.to_string();
        match error {
            RunDirError::Held { .. } => Self::Held(message),
            // A part of the path is a file: nothing can have been begun there.
            RunDirError::Open { source, .. } if source.kind() == ErrorKind::NotADirectory => {
                Self::BadInput(message)
            }
            _ => Self::Failed(message),
        }
    }
}
