//! What can go wrong with a run directory.

use std::io;
use std::path::PathBuf;

use super::lock::Holder;
use crate::key::Key;

/// Why something could not be done with a run directory. None of these harms what is stored already.
#[derive(Debug, thiserror::Error)]
pub enum RunDirError {
    /// It cannot be made, listed, locked or written.
    #[error("cannot use `{}` as a run directory: {source}", path.display())]
    Open {
        /// The directory.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Another process works in it.
    #[error("run directory `{}` is in use by {}", path.display(), holder_text(*pid, host.as_deref()))]
    Held {
        /// The directory.
        path: PathBuf,
        /// The process that has it; `None` when its lock file does not tell.
        pid: Option<u32>,
        /// The machine of that process.
        host: Option<String>,
    },
    /// A file could not be written, e.g. because the disk is full. The process should end: after such an error the
    /// system does not tell what reached the disk. The next one finds everything that was committed before.
    #[error(
        "could not write {bytes_needed} bytes to `{}`: {source}; what was stored before is intact, and the run can be \
         taken up again once the disk accepts them",
        path.display()
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes_needed: u64,
        /// What the system says.
        source: io::Error,
    },
    /// A file that is there could not be read.
    #[error("could not read `{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A damaged file could not be moved out of the way.
    #[error("`{}` is damaged ({reason}) and could not be moved aside: {source}", path.display())]
    Quarantine {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// A unit was computed a second time, with another result: something besides its key had an influence on it.
    #[error("unit {key} was computed twice with different results; the first is kept in `{}`", path.display())]
    Differs {
        /// The unit.
        key: Key,
        /// Where the first result is.
        path: PathBuf,
    },
    /// A name that a result file cannot have.
    #[error(
        "`{0}` cannot be the name of a result file: expected a relative path without `.` and `..`, outside `units`, \
         `checkpoints` and `run.lock`, none of whose parts begins with a dot"
    )]
    Name(String),
}

fn holder_text(pid: Option<u32>, host: Option<&str>) -> String {
    let process = pid.map_or_else(|| "another process".to_owned(), |pid| format!("process {pid}"));
    match host {
        Some(host) => format!("{process} on {host}"),
        None => process,
    }
}

impl RunDirError {
    pub(super) fn held(path: PathBuf, holder: Holder) -> Self {
        Self::Held { path, pid: holder.pid, host: holder.host }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_tell_who_where_and_how_much() {
        let held = |pid, host: Option<&str>| {
            RunDirError::held("runs/a".into(), Holder { pid, host: host.map(str::to_owned) }).to_string()
        };
        assert_eq!(held(Some(7), Some("tux")), "run directory `runs/a` is in use by process 7 on tux");
        assert_eq!(held(None, None), "run directory `runs/a` is in use by another process");
        let full = RunDirError::Write {
            path: "runs/a/report.json".into(),
            bytes_needed: 1234,
            source: io::ErrorKind::StorageFull.into(),
        };
        assert_eq!(
            full.to_string(),
            "could not write 1234 bytes to `runs/a/report.json`: no storage space; what was stored before is intact, \
             and the run can be taken up again once the disk accepts them"
        );
    }
}
