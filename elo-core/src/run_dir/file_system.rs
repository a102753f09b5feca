//! The few operations that the run directory asks of a disk, so that tests can put a failing one in its place.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use super::lock::{FileLock, LockError};

/// A disk.
///
/// What was written, created, renamed or removed may be lost in a power cut, in any part and any order, until
/// [`NewFile::sync`] (the content of a file) or [`FileSystem::sync_dir`] (the names in a directory) has returned.
pub trait FileSystem: Send + Sync {
    /// Makes one directory; its parent must exist.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] when anything has that name, [`io::ErrorKind::NotFound`] without a parent.
    fn create_dir(&self, path: &Path) -> io::Result<()>;

    /// Makes an empty file, open for writing.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] when anything has that name.
    fn create_new(&self, path: &Path) -> io::Result<Box<dyn NewFile>>;

    /// Gives a file another name, in place of whatever file had it. Never leaves both or neither.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`] when there is no such file.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Makes the names in a directory last.
    ///
    /// # Errors
    /// Whatever kept the disk from it; then nothing is known of names that changed since the last success.
    fn sync_dir(&self, path: &Path) -> io::Result<()>;

    /// All of a file.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`] when there is no such file.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// Removes a file.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`] when there is no such file.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// The names in a directory, sorted; names that are not Unicode are left out.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`] when there is no such directory.
    fn list(&self, path: &Path) -> io::Result<Vec<String>>;

    /// Takes the lock that is the file at `path`, made if it is not there. It is let go of when what this returns is
    /// dropped, or when the process ends.
    ///
    /// # Errors
    /// [`LockError::Held`] when another has it, [`LockError::Io`] when the file cannot be written or locked.
    fn lock(&self, path: &Path) -> Result<Box<dyn Send + Sync>, LockError>;
}

/// A file that was just made.
pub trait NewFile: Send {
    /// Appends to it.
    ///
    /// # Errors
    /// Any part may have been written then.
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Makes its content last.
    ///
    /// # Errors
    /// Nothing is known of its content then, not even when a later call succeeds.
    fn sync(&mut self) -> io::Result<()>;
}

/// The operating system's files.
#[derive(Clone, Copy, Debug, Default)]
pub struct OsDisk;

impl FileSystem for OsDisk {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        fs::create_dir(path)
    }

    fn create_new(&self, path: &Path) -> io::Result<Box<dyn NewFile>> {
        Ok(Box::new(OpenOptions::new().write(true).create_new(true).open(path)?))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        // Windows has no such operation, nor have some network file systems: they log or send the change of a name
        // before they report it.
        if cfg!(not(unix)) {
            return Ok(());
        }
        match File::open(path)?.sync_all() {
            Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
            outcome => outcome,
        }
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        fs::read(path)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }

    fn list(&self, path: &Path) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        for entry in fs::read_dir(path)? {
            names.extend(entry?.file_name().into_string());
        }
        names.sort_unstable();
        Ok(names)
    }

    fn lock(&self, path: &Path) -> Result<Box<dyn Send + Sync>, LockError> {
        Ok(Box::new(FileLock::take(path)?))
    }
}

impl NewFile for File {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        Write::write_all(self, bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_all()
    }
}
