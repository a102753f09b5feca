//! How bytes are put on a disk so that no crash and no full disk leaves a file that is half one thing and half
//! another, and how damaged files are told and moved aside.

use std::fmt;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::RunDirError;
use super::file_system::FileSystem;
use super::seal::{Content, unseal};
use crate::key::Key;

/// A damaged file that was found, moved aside and from then on treated as absent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Quarantined {
    /// Where it was.
    pub path: PathBuf,
    /// Where it is kept for a look at it. Nothing reads it any more.
    pub moved_to: PathBuf,
    /// What is wrong with it, in a few words.
    pub reason: &'static str,
}

impl fmt::Display for Quarantined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { path, moved_to, reason } = self;
        write!(f, "`{}` is damaged ({reason}); ", path.display())?;
        write!(f, "it was moved to `{}` and will be computed again", moved_to.display())
    }
}

/// A disk, with what is needed to use it safely. Shared by all threads of a process.
pub(super) struct Store {
    disk: Arc<dyn FileSystem>,
    temporaries: AtomicU64,
    quarantined: Mutex<Vec<Quarantined>>,
}

impl Store {
    pub(super) fn new(disk: Arc<dyn FileSystem>) -> Self {
        Self { disk, temporaries: AtomicU64::new(0), quarantined: Mutex::default() }
    }

    pub(super) fn disk(&self) -> &dyn FileSystem {
        &*self.disk
    }

    /// Makes a directory and its missing parents. Their names last once the directories that hold them are synced.
    pub(super) fn create_dir(&self, path: &Path) -> io::Result<()> {
        let mut made = self.disk.create_dir(path);
        if let (Err(error), Some(parent)) = (&made, path.parent())
            && error.kind() == ErrorKind::NotFound
            && !parent.as_os_str().is_empty()
        {
            self.create_dir(parent)?;
            made = self.disk.create_dir(path);
        }
        made.or_else(|error| if error.kind() == ErrorKind::AlreadyExists { Ok(()) } else { Err(error) })
    }

    /// Makes the names of all directories on the way to `path` last, but for those that may not be looked into.
    pub(super) fn sync_way_to(&self, path: &Path) -> io::Result<()> {
        for dir in path.ancestors().skip(1) {
            let dir = if dir.as_os_str().is_empty() { Path::new(".") } else { dir };
            match self.disk.sync_dir(dir) {
                Err(error) if error.kind() != ErrorKind::PermissionDenied => return Err(error),
                _ => {}
            }
        }
        Ok(())
    }

    /// Puts a file at `path`, in place of whatever file is there, by way of a temporary file in `beside`, a directory
    /// of the same file system that is swept when the run directory is opened. When this returns, the file lasts;
    /// when it fails or never returns, the old file or none is there, or the new one, each of them whole.
    pub(super) fn put(&self, beside: &Path, path: &Path, bytes: &[u8]) -> Result<(), RunDirError> {
        let number = self.temporaries.fetch_add(1, Ordering::Relaxed);
        let temporary = beside.join(format!(".elo-{number}.tmp"));
        let put = || {
            let mut file = self.disk.create_new(&temporary)?;
            file.write_all(bytes)?;
            file.sync()?;
            drop(file);
            self.disk.rename(&temporary, path)?;
            self.disk.sync_dir(path.parent().unwrap_or(beside))
        };
        put().map_err(|source| {
            // To give a full disk its space back. The sweep at the next start removes it if this does not.
            let _ = self.disk.remove(&temporary);
            RunDirError::Write { path: path.to_owned(), bytes_needed: bytes.len() as u64, source }
        })
    }

    /// Removes what interrupted [`Self::put`]s left in a directory.
    pub(super) fn sweep(&self, dir: &Path) -> io::Result<()> {
        for name in self.disk.list(dir)? {
            if name.starts_with(".elo-") && name.ends_with(".tmp") {
                self.disk.remove(&dir.join(name))?;
            }
        }
        Ok(())
    }

    /// Finds out whether files can be made in `dir`.
    pub(super) fn probe(&self, dir: &Path) -> io::Result<()> {
        let path = dir.join(".elo-probe.tmp");
        self.disk.create_new(&path)?;
        self.disk.remove(&path)
    }

    /// All of a file, or `None` when it is not there.
    pub(super) fn read(&self, path: &Path) -> Result<Option<Vec<u8>>, RunDirError> {
        match self.disk.read(path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(source) => Err(RunDirError::Read { path: path.to_owned(), source }),
        }
    }

    /// The payload of a sealed file, or `None` when it is not there or was damaged and moved aside.
    pub(super) fn read_sealed(
        &self,
        content: Content,
        key: &Key,
        path: &Path,
    ) -> Result<Option<Vec<u8>>, RunDirError> {
        let Some(file) = self.read(path)? else { return Ok(None) };
        if let Ok(payload) = unseal(content, key, file) {
            return Ok(Some(payload));
        }
        // Whoever else found the damage may have moved the file, and a good one may have taken its place.
        let mut quarantined = self.quarantined.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(file) = self.read(path)? else { return Ok(None) };
        let reason = match unseal(content, key, file) {
            Ok(payload) => return Ok(Some(payload)),
            Err(reason) => reason,
        };
        let moved_to = self.move_aside(path).map_err(|source| RunDirError::Quarantine {
            path: path.to_owned(),
            reason,
            source,
        })?;
        quarantined.push(Quarantined { path: path.to_owned(), moved_to, reason });
        Ok(None)
    }

    /// Renames `x` to the first free one of `x.corrupt`, `x.corrupt-2`, `x.corrupt-3` …
    fn move_aside(&self, path: &Path) -> io::Result<PathBuf> {
        let (Some(dir), Some(name)) = (path.parent(), path.file_name().and_then(|name| name.to_str())) else {
            return Err(io::Error::other("it has no name"));
        };
        let taken = self.disk.list(dir)?;
        let names = (1_u64..).map(|n| match n {
            1 => format!("{name}.corrupt"),
            _ => format!("{name}.corrupt-{n}"),
        });
        let free = names.into_iter().find(|name| !taken.contains(name)).expect("some number is free");
        let moved_to = dir.join(free);
        self.disk.rename(path, &moved_to)?;
        Ok(moved_to)
    }

    /// The damaged files found since the last call.
    pub(super) fn take_quarantined(&self) -> Vec<Quarantined> {
        std::mem::take(&mut *self.quarantined.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
