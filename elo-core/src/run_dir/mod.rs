//! The run directory: everything that a run has computed, so that it can be taken up again after any interruption.
//!
//! ```text
//! run.lock                 held by the process that works here
//! units/<aa>/<key>.bin     results of units of work; <aa> are the first two digits of the key
//! checkpoints/<key>.bin    where a long unit that is not finished can be taken up
//! anything else            result files for people and other programs
//! ```
//!
//! Units and checkpoints carry a footer with a hash and their key. A file that is damaged, cut short or in a wrong
//! place is never used: it is renamed to `*.corrupt`, noted as [`Quarantined`], and treated as absent. Files appear
//! under their names only once their content is on the disk, so neither a crash nor a power cut nor a full disk can
//! take back what was committed, or leave half of something.

mod error;
mod file_system;
mod lock;
mod seal;
mod store;

#[cfg(test)]
mod flaky_disk;
#[cfg(test)]
mod torn_disk;
#[cfg(test)]
mod workload;

use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::{fs, io};

pub use error::RunDirError;
pub use file_system::{FileSystem, NewFile, OsDisk};
pub use lock::{Holder, LockError};
use serde::Serialize;
pub use store::Quarantined;

use crate::key::Key;
use seal::{Content, seal};
use store::Store;

/// A run directory that this process holds. Shared by all its threads.
pub struct RunDir {
    root: PathBuf,
    store: Store,
    /// Which of the 256 directories of units this process has made sure of.
    shards: Mutex<[bool; 256]>,
    _lock: Box<dyn Send + Sync>,
}

impl RunDir {
    /// Opens the directory at `path`, made with its parents if it is not there, and holds it until dropped. Removes
    /// what an interrupted process left unfinished.
    ///
    /// # Errors
    /// [`RunDirError::Held`] when another process has it, [`RunDirError::Open`] when it cannot be written.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RunDirError> {
        Self::open_on(Arc::new(OsDisk), path)
    }

    /// [`Self::open`] on another disk than the operating system's.
    ///
    /// # Errors
    /// See [`Self::open`].
    pub fn open_on(disk: Arc<dyn FileSystem>, path: impl AsRef<Path>) -> Result<Self, RunDirError> {
        let root = path.as_ref().to_owned();
        let unusable = |source: io::Error| RunDirError::Open { path: root.clone(), source };
        let store = Store::new(disk);
        store.create_dir(&root).map_err(unusable)?;
        // Later processes find the lock, and then know that this was done.
        if !store.disk().list(&root).map_err(unusable)?.iter().any(|name| name == "run.lock") {
            store.sync_way_to(&root).map_err(unusable)?;
        }
        let lock = store.disk().lock(&root.join("run.lock")).map_err(|error| match error {
            LockError::Held(holder) => RunDirError::held(root.clone(), holder),
            LockError::Io(source) => unusable(source),
        })?;
        let dir = Self { root: root.clone(), store, shards: Mutex::new([false; 256]), _lock: lock };
        dir.prepare().map_err(unusable)?;
        Ok(dir)
    }

    /// Makes the directories, clears them, and makes what is in them last but for the units: a process that was killed
    /// may not have come to that.
    fn prepare(&self) -> io::Result<()> {
        let units = self.root.join("units");
        let checkpoints = self.root.join("checkpoints");
        self.store.create_dir(&units)?;
        self.store.create_dir(&checkpoints)?;
        for dir in [&self.root, &checkpoints] {
            self.store.sweep(dir)?;
            self.store.disk().sync_dir(dir)?;
        }
        let names = self.store.disk().list(&units)?;
        for name in (0..=255).map(shard_name).filter(|name| names.contains(name)) {
            self.store.sweep(&units.join(name))?;
        }
        self.store.probe(&self.root)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.root
    }

    /// The result of unit `key`, or `None` when it is still to be computed: never committed, or found damaged now.
    /// Costs a read and a hash of the file.
    ///
    /// # Errors
    /// [`RunDirError::Read`], or [`RunDirError::Quarantine`] when a damaged file stays in the way.
    pub fn read(&self, key: &Key) -> Result<Option<Vec<u8>>, RunDirError> {
        self.store.read_sealed(Content::Unit, key, &self.unit_path(key))
    }

    /// Stores the result of unit `key` and then removes its checkpoint. When this returns, the result outlasts a power
    /// cut. Committing the same result again changes nothing.
    ///
    /// # Errors
    /// [`RunDirError::Write`], after which the process should end; [`RunDirError::Differs`] when another result is
    /// there; what [`Self::read`] gives.
    pub fn commit(&self, key: &Key, result: &[u8]) -> Result<(), RunDirError> {
        let path = self.unit_path(key);
        let file = match self.read(key)? {
            Some(stored) if stored != result => return Err(RunDirError::Differs { key: *key, path }),
            Some(_) => None,
            None => Some(seal(Content::Unit, key, result)),
        };
        let bytes_needed = file.as_ref().map_or(0, |file| file.len() as u64);
        let unwritten = |source| RunDirError::Write { path: path.clone(), bytes_needed, source };
        let dir = self.shard(key).map_err(unwritten)?;
        match file {
            Some(file) => self.store.put(&dir, &path, &file)?,
            // Whoever put it there may have been killed before its name was made to last.
            None => self.store.disk().sync_dir(&dir).map_err(unwritten)?,
        }
        // It has no further use, and does no harm should it stay.
        let _ = self.store.disk().remove(&self.checkpoint_path(key));
        Ok(())
    }

    /// The newest checkpoint of unit `key`, or `None` when there is none or it was found damaged now.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_checkpoint(&self, key: &Key) -> Result<Option<Vec<u8>>, RunDirError> {
        self.store.read_sealed(Content::Checkpoint, key, &self.checkpoint_path(key))
    }

    /// Stores a checkpoint of unit `key` in place of the one before.
    ///
    /// # Errors
    /// [`RunDirError::Write`], after which the process should end.
    pub fn write_checkpoint(&self, key: &Key, bytes: &[u8]) -> Result<(), RunDirError> {
        let file = seal(Content::Checkpoint, key, bytes);
        self.store.put(&self.root.join("checkpoints"), &self.checkpoint_path(key), &file)
    }

    /// Stores a result file in place of the one before, e.g. `report.json` or `options/fast.safetensors`.
    ///
    /// # Errors
    /// [`RunDirError::Name`] for a name that is not a relative path or is the directory's own, [`RunDirError::Write`].
    pub fn write_file(&self, name: &str, bytes: &[u8]) -> Result<(), RunDirError> {
        let path = self.result_path(name)?;
        self.make_parents(&path).map_err(|source| RunDirError::Write {
            path: path.clone(),
            bytes_needed: bytes.len() as u64,
            source,
        })?;
        self.store.put(&self.root, &path, bytes)
    }

    /// [`Self::write_file`] of `value` as JSON, with a line break at its end.
    ///
    /// # Errors
    /// As there.
    ///
    /// # Panics
    /// When `value` is not plain data.
    pub fn write_json(&self, name: &str, value: &impl Serialize) -> Result<(), RunDirError> {
        let mut json = serde_json::to_vec_pretty(value).expect("results are plain data");
        json.push(b'\n');
        self.write_file(name, &json)
    }

    /// Removes a result file, or a folder with all that is in it. What is not there is removed already.
    ///
    /// # Errors
    /// [`RunDirError::Name`] as [`Self::write_file`], [`RunDirError::Write`].
    pub fn remove(&self, name: &str) -> Result<(), RunDirError> {
        let path = self.result_path(name)?;
        let removed = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        match removed {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            removed => removed.and_then(|()| self.store.disk().sync_dir(path.parent().unwrap_or(&self.root))),
        }
        .map_err(|source| RunDirError::Write { path, bytes_needed: 0, source })
    }

    /// Makes the directories between the root and a result file, so that they last.
    fn make_parents(&self, path: &Path) -> io::Result<()> {
        for dir in path.ancestors().skip(1).take_while(|dir| *dir != self.root) {
            self.store.create_dir(dir)?;
            self.store.disk().sync_dir(dir.parent().unwrap_or(&self.root))?;
        }
        Ok(())
    }

    /// A result file, or `None` when it is not there. It is as whoever changed it last left it.
    ///
    /// # Errors
    /// [`RunDirError::Name`] as [`Self::write_file`], [`RunDirError::Read`].
    pub fn read_file(&self, name: &str) -> Result<Option<Vec<u8>>, RunDirError> {
        self.store.read(&self.result_path(name)?)
    }

    /// The damaged files that were found since the last call, to be told to the user.
    pub fn take_quarantined(&self) -> Vec<Quarantined> {
        self.store.take_quarantined()
    }

    /// Where the result of unit `key` is, if it is there.
    pub fn unit_path(&self, key: &Key) -> PathBuf {
        self.shard_path(key).join(format!("{key}.bin"))
    }

    fn checkpoint_path(&self, key: &Key) -> PathBuf {
        self.root.join("checkpoints").join(format!("{key}.bin"))
    }

    fn shard_path(&self, key: &Key) -> PathBuf {
        self.root.join("units").join(shard_name(key.as_bytes()[0]))
    }

    /// The directory of unit `key`, whose name lasts when this returns.
    fn shard(&self, key: &Key) -> io::Result<PathBuf> {
        let path = self.shard_path(key);
        let mut shards = self.shards.lock().unwrap_or_else(PoisonError::into_inner);
        let made = &mut shards[usize::from(key.as_bytes()[0])];
        if !*made {
            self.store.create_dir(&path)?;
            self.store.disk().sync_dir(&self.root.join("units"))?;
            *made = true;
        }
        Ok(path)
    }

    fn result_path(&self, name: &str) -> Result<PathBuf, RunDirError> {
        let mut parts = Path::new(name).components();
        let own = ["units", "checkpoints", "run.lock"].map(|own| Some(Component::Normal(own.as_ref())));
        let own = own.contains(&parts.clone().next());
        let plain = parts.all(|part| match part {
            Component::Normal(part) => part.to_str().is_some_and(|part| !part.starts_with('.')),
            _ => false,
        });
        let is_file = plain && !own && !name.is_empty() && !name.ends_with('/');
        if is_file { Ok(self.root.join(name)) } else { Err(RunDirError::Name(name.to_owned())) }
    }
}
/// The name of the directory of all units whose key begins with this byte.
fn shard_name(first: u8) -> String {
    format!("{first:02x}")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::workload::{key, result};
    use super::*;
    use std::fs;

    fn open() -> (tempfile::TempDir, RunDir) {
        let temporary = tempfile::tempdir().unwrap();
        let dir = RunDir::open(temporary.path().join("runs/a")).unwrap();
        (temporary, dir)
    }

    #[test]
    fn units_checkpoints_and_files_are_there_after_opening_again() {
        let (_temporary, dir) = open();
        assert_eq!(dir.read(&key(1)).unwrap(), None);
        dir.commit(&key(1), &result(1)).unwrap();
        dir.commit(&key(2), &[]).unwrap();
        dir.write_checkpoint(&key(3), b"early").unwrap();
        dir.write_checkpoint(&key(3), b"late").unwrap();
        dir.write_file("options/fast.bin", b"options").unwrap();
        let path = dir.path().to_owned();
        drop(dir);
        let dir = RunDir::open(path).unwrap();
        assert_eq!(dir.read(&key(1)).unwrap(), Some(result(1)));
        assert_eq!(dir.read(&key(2)).unwrap(), Some(vec![]));
        assert_eq!(dir.read(&key(3)).unwrap(), None);
        assert_eq!(dir.read_checkpoint(&key(3)).unwrap(), Some(b"late".to_vec()));
        assert_eq!(dir.read_file("options/fast.bin").unwrap(), Some(b"options".to_vec()));
        assert_eq!(dir.read_file("options/slow.bin").unwrap(), None);
        assert_eq!(dir.take_quarantined(), []);
    }

    #[test]
    fn a_unit_is_written_once_and_a_second_result_is_refused() {
        let (_temporary, dir) = open();
        dir.commit(&key(1), b"first").unwrap();
        let written = fs::metadata(dir.unit_path(&key(1))).unwrap().modified().unwrap();
        dir.commit(&key(1), b"first").unwrap();
        assert_eq!(fs::metadata(dir.unit_path(&key(1))).unwrap().modified().unwrap(), written);
        assert!(matches!(dir.commit(&key(1), b"second"), Err(RunDirError::Differs { .. })));
        assert_eq!(dir.read(&key(1)).unwrap(), Some(b"first".to_vec()));
    }

    #[test]
    fn a_committed_unit_has_no_checkpoint() {
        let (_temporary, dir) = open();
        for _ in 0..2 {
            dir.write_checkpoint(&key(1), b"half").unwrap();
            dir.commit(&key(1), b"whole").unwrap();
            assert_eq!(dir.read_checkpoint(&key(1)).unwrap(), None);
        }
    }

    #[test]
    fn what_an_interrupted_process_left_is_swept_and_other_files_stay() {
        let (_temporary, dir) = open();
        dir.commit(&key(1), b"unit").unwrap();
        let root = dir.path().to_owned();
        drop(dir);
        let shard = root.join("units").join(&key(1).to_string()[..2]);
        let left = [root.join(".elo-0.tmp"), root.join("checkpoints/.elo-12.tmp"), shard.join(".elo-3.tmp")];
        let others = [root.join("notes.tmp"), root.join("units/README")];
        left.iter().chain(&others).for_each(|path| fs::write(path, "half").unwrap());
        let dir = RunDir::open(&root).unwrap();
        assert!(left.iter().all(|path| !path.exists()));
        assert!(others.iter().all(|path| path.exists()));
        assert_eq!(dir.read(&key(1)).unwrap(), Some(b"unit".to_vec()));
    }

    /// Puts `file` where unit 1 is and checks that it is told from the unit, kept, and replaced.
    fn refuses(dir: &RunDir, file: &[u8], what: &str) {
        let path = dir.unit_path(&key(1));
        fs::write(&path, file).unwrap();
        assert_eq!(dir.read(&key(1)).unwrap(), None, "{what}");
        let noted = dir.take_quarantined();
        assert_eq!(noted.len(), 1, "{what}");
        assert_eq!(noted[0].path, path, "{what}");
        assert_eq!(fs::read(&noted[0].moved_to).unwrap(), file, "{what}");
        assert!(!path.exists(), "{what}");
        fs::remove_file(&noted[0].moved_to).unwrap();
        dir.commit(&key(1), &result(1)).unwrap();
        assert_eq!(dir.read(&key(1)).unwrap(), Some(result(1)), "{what}");
    }

    #[test]
    fn a_unit_with_any_byte_changed_or_missing_is_never_used() {
        let (_temporary, dir) = open();
        dir.commit(&key(1), &result(1)).unwrap();
        let whole = fs::read(dir.unit_path(&key(1))).unwrap();
        for i in 0..whole.len() {
            for flip in [1, 0x80, 0xff] {
                let mut file = whole.clone();
                file[i] ^= flip;
                refuses(&dir, &file, &format!("byte {i} ^ {flip}"));
            }
            refuses(&dir, &whole[..i], &format!("{i} of {} bytes", whole.len()));
        }
        refuses(&dir, &[&whole[..], &[0]].concat(), "a byte too many");
        refuses(&dir, &[&whole[..], &whole[..]].concat(), "twice");
    }

    #[test]
    fn swapped_units_and_checkpoints_are_never_used() {
        let (_temporary, dir) = open();
        dir.commit(&key(1), &result(1)).unwrap();
        dir.commit(&key(2), &result(2)).unwrap();
        let [one, two] = [1, 2].map(|unit| dir.unit_path(&key(unit)));
        let aside = dir.path().join("aside");
        fs::rename(&one, &aside).unwrap();
        fs::rename(&two, &one).unwrap();
        fs::rename(&aside, &two).unwrap();
        assert_eq!([1, 2].map(|unit| dir.read(&key(unit)).unwrap()), [None, None]);
        assert_eq!(dir.take_quarantined().len(), 2);

        dir.write_checkpoint(&key(1), b"checkpoint").unwrap();
        fs::copy(dir.checkpoint_path(&key(1)), &one).unwrap();
        assert_eq!(dir.read(&key(1)).unwrap(), None);
        dir.commit(&key(1), &result(1)).unwrap();
        fs::copy(&one, dir.checkpoint_path(&key(1))).unwrap();
        assert_eq!(dir.read_checkpoint(&key(1)).unwrap(), None);
        assert_eq!(dir.take_quarantined().len(), 2);
    }

    #[test]
    fn damaged_files_are_kept_beside_each_other() {
        let (_temporary, dir) = open();
        dir.commit(&key(1), &result(1)).unwrap();
        let path = dir.unit_path(&key(1));
        for name in [".bin.corrupt", ".bin.corrupt-2", ".bin.corrupt-3"] {
            fs::write(&path, name).unwrap();
            assert_eq!(dir.read(&key(1)).unwrap(), None);
            let noted = dir.take_quarantined();
            assert_eq!(noted[0].reason, "shorter than its footer");
            assert!(noted[0].moved_to.to_str().unwrap().ends_with(name), "{noted:?}");
            assert!(noted[0].to_string().contains("will be computed again"), "{}", noted[0]);
        }
    }

    #[test]
    fn result_files_stay_inside_the_directory_and_out_of_its_own_files() {
        let (_temporary, dir) = open();
        let wrong =
            ["", "/etc/passwd", "../x", "a/../../x", ".hidden", "a/.b", "units/x", "run.lock", "a/", "."];
        for name in wrong {
            assert!(matches!(dir.write_file(name, b""), Err(RunDirError::Name(_))), "{name:?}");
            assert!(matches!(dir.read_file(name), Err(RunDirError::Name(_))), "{name:?}");
        }
        dir.write_file("unit", b"fine").unwrap();
    }

    #[test]
    fn a_directory_that_cannot_be_written_is_refused_before_any_work() {
        let temporary = tempfile::tempdir().unwrap();
        fs::write(temporary.path().join("file"), "").unwrap();
        let mut unusable = vec![temporary.path().join("file"), temporary.path().join("file/run")];
        if cfg!(target_os = "linux") {
            unusable.push("/proc/run".into());
        }
        for path in unusable {
            match RunDir::open(&path) {
                Err(error @ RunDirError::Open { .. }) => {
                    assert!(error.to_string().contains(path.to_str().unwrap()), "{error}");
                }
                other => panic!("{}: {:?}", path.display(), other.err()),
            }
        }
    }

    #[test]
    fn threads_share_a_directory() {
        let (_temporary, dir) = open();
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let dir = &dir;
                // Each unit is committed by two threads.
                scope.spawn(move || {
                    (0..32).for_each(|i| dir.commit(&key(i + thread / 2 * 32), &result(i)).unwrap())
                });
            }
        });
        assert!((0..64).all(|i| dir.read(&key(i)).unwrap() == Some(result(i % 32))));
        assert_eq!(dir.take_quarantined(), []);
    }
}
