//! One process at a time works in a run directory. The operating system holds the lock and lets go of it when the
//! process ends in whatever way, so a stale lock cannot exist. Not to be relied on over network file systems; there,
//! two processes that compute one unit still write the same bytes.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

/// Who has a lock, as its file tells. Either is `None` when the file does not tell it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Holder {
    /// Its process id on its host.
    pub pid: Option<u32>,
    /// The name of its machine.
    pub host: Option<String>,
}

/// Why a lock was not taken.
#[derive(Debug)]
pub enum LockError {
    /// Another process, or another part of this one, has it.
    Held(Holder),
    /// The file cannot be written, or its file system has no locks.
    Io(io::Error),
}

impl From<io::Error> for LockError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// A lock that was taken; let go of when dropped.
#[derive(Debug)]
pub(super) struct FileLock(File);

impl FileLock {
    /// Takes the lock that is the file at `path`, made if it is not there, and writes this process into it.
    pub(super) fn take(path: &Path) -> Result<Self, LockError> {
        let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(LockError::Held(Holder::read(&mut file).unwrap_or_default()));
            }
            Err(TryLockError::Error(error)) => return Err(error.into()),
        }
        let this = Holder { pid: Some(std::process::id()), host: host() };
        file.set_len(0)?;
        file.write_all(this.text().as_bytes())?;
        Ok(Self(file))
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        // The file stays, for removing it would race with the next process. Unlocking fails no less than closing would,
        // but holds also for copies of the handle in children that are just being started.
        let _ = self.0.set_len(0);
        let _ = self.0.unlock();
    }
}

impl Holder {
    /// Reads a lock that is held. Its holder may be about to write into it: it is given up to half a second.
    fn read(file: &mut File) -> io::Result<Self> {
        let mut holder = Self::default();
        for _ in 0..25 {
            sleep(Duration::from_millis(20));
            let mut text = String::new();
            file.rewind()?;
            Read::take(&mut *file, 4096).read_to_string(&mut text)?;
            holder = Self::parse(&text);
            if holder.pid.is_some() {
                break;
            }
        }
        Ok(holder)
    }

    fn parse(text: &str) -> Self {
        let field = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
        Self {
            pid: field("pid ").and_then(|pid| pid.parse().ok()),
            host: field("host ").filter(|host| !host.is_empty()).map(str::to_owned),
        }
    }

    /// What the file says while the lock is held.
    fn text(&self) -> String {
        let pid = self.pid.map(|pid| format!("pid {pid}\n")).unwrap_or_default();
        let host = self.host.as_ref().map(|host| format!("host {host}\n")).unwrap_or_default();
        pid + &host
    }
}

/// The name of this machine.
#[cfg(unix)]
fn host() -> Option<String> {
    let mut name = [0_u8; 256];
    // SAFETY: the buffer is valid for writes of the length that is given, and the last byte is kept as a terminator.
    let failed = unsafe { libc::gethostname(name.as_mut_ptr().cast(), name.len() - 1) } != 0;
    let name = std::ffi::CStr::from_bytes_until_nul(&name).ok()?.to_str().ok()?;
    (!failed && !name.is_empty()).then(|| name.to_owned())
}

/// The name of this machine.
#[cfg(not(unix))]
fn host() -> Option<String> {
    std::env::var("COMPUTERNAME").ok()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_text_of_a_lock_gives_its_holder_back() {
        let holder = Holder { pid: Some(17), host: Some("a host".to_owned()) };
        assert_eq!(Holder::parse(&holder.text()), holder);
        for garbage in ["", "pid", "pid x\nhost ", "\0\0\0"] {
            assert_eq!(Holder::parse(garbage), Holder::default(), "{garbage:?}");
        }
    }

    #[test]
    fn a_lock_is_had_once_and_free_again_when_dropped() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.lock");
        let first = FileLock::take(&path).unwrap();
        match FileLock::take(&path) {
            Err(LockError::Held(holder)) => {
                assert_eq!(holder, Holder { pid: Some(std::process::id()), host: host() });
            }
            other => panic!("{other:?}"),
        }
        drop(first);
        FileLock::take(&path).unwrap();
    }

    #[test]
    fn text_that_a_killed_holder_left_behind_locks_nothing_and_is_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.lock");
        std::fs::write(&path, "pid 4000000000\nhost a much longer name than any that this machine has\n")
            .unwrap();
        let _lock = FileLock::take(&path).unwrap();
        let pid = Holder::parse(&std::fs::read_to_string(&path).unwrap()).pid;
        assert_eq!(pid, Some(std::process::id()));
    }
}
