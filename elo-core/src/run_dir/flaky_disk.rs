//! A disk that is in order but for some of its calls, and the promise that it puts to the test: an error is passed on,
//! takes back nothing, and leaves a run that can be finished once the disk works.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::file_system::{FileSystem, NewFile};
use super::lock::LockError;

/// Another disk, of which calls `from..to` fail with `error`. Clones count together.
#[derive(Clone)]
pub(super) struct FlakyDisk {
    pub(super) disk: Arc<dyn FileSystem>,
    pub(super) error: fn() -> io::Error,
    pub(super) fails: std::ops::Range<usize>,
    pub(super) calls: Arc<AtomicUsize>,
}

impl FlakyDisk {
    fn call(&self) -> io::Result<()> {
        let number = self.calls.fetch_add(1, Ordering::Relaxed);
        if self.fails.contains(&number) { Err((self.error)()) } else { Ok(()) }
    }
}

impl FileSystem for FlakyDisk {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        self.call()?;
        self.disk.create_dir(path)
    }

    fn create_new(&self, path: &Path) -> io::Result<Box<dyn NewFile>> {
        self.call()?;
        Ok(Box::new(FlakyFile { disk: self.clone(), file: self.disk.create_new(path)? }))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.call()?;
        self.disk.rename(from, to)
    }

    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        self.call()?;
        self.disk.sync_dir(path)
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        self.call()?;
        self.disk.read(path)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.call()?;
        self.disk.remove(path)
    }

    fn list(&self, path: &Path) -> io::Result<Vec<String>> {
        self.call()?;
        self.disk.list(path)
    }

    fn lock(&self, path: &Path) -> Result<Box<dyn Send + Sync>, LockError> {
        self.call()?;
        self.disk.lock(path)
    }
}

struct FlakyFile {
    disk: FlakyDisk,
    file: Box<dyn NewFile>,
}

impl NewFile for FlakyFile {
    /// A disk that fills up takes the first half.
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        if let Err(error) = self.disk.call() {
            self.file.write_all(&bytes[..bytes.len() / 2])?;
            return Err(error);
        }
        self.file.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.disk.call()?;
        self.file.sync()
    }
}

#[cfg(test)]
mod tests {
    use super::super::torn_disk::TornDisk;
    use super::super::workload::{Done, key, recover, result, work};
    use super::super::{RunDir, RunDirError};
    use super::*;

    fn full() -> io::Error {
        io::ErrorKind::StorageFull.into()
    }

    fn broken() -> io::Error {
        io::Error::other("input/output error")
    }

    #[test]
    fn an_error_of_any_call_is_passed_on_and_the_run_can_be_finished_later() {
        let mut calls = 0;
        for error in [full, broken] {
            for length in [1, usize::MAX] {
                let mut unseen = 0;
                calls = 0;
                loop {
                    let disk = TornDisk::new(usize::MAX);
                    let fails = calls..usize::saturating_add(calls, length);
                    let flaky =
                        FlakyDisk { disk: Arc::new(disk.clone()), error, fails, calls: Arc::default() };
                    let mut done = Done::default();
                    let outcome = work(Arc::new(flaky.clone()), &mut done);
                    let reached = flaky.calls.load(Ordering::Relaxed) > calls;
                    unseen += usize::from(reached && outcome.is_ok());
                    recover(Arc::new(disk), &done)
                        .unwrap_or_else(|broken| panic!("call {calls}, {length} in a row: {broken}"));
                    if !reached {
                        break;
                    }
                    calls += 1;
                }
                // The removals of three checkpoints that have no further use may fail alone.
                assert_eq!(unseen, if length == 1 { 3 } else { 0 });
            }
        }
        assert!(calls > 80, "only {calls} calls");
    }

    #[test]
    fn an_error_while_writing_tells_the_file_and_the_bytes_it_needs() {
        let flaky = |fails| {
            let disk = Arc::new(TornDisk::new(usize::MAX));
            FlakyDisk { disk, error: full, fails, calls: Arc::default() }
        };
        let whole = flaky(0..0);
        RunDir::open_on(Arc::new(whole.clone()), "/a").expect("no call fails");
        let opening = whole.calls.load(Ordering::Relaxed);
        // Looked for; directory made, and synced from above; file made, written, synced, renamed; directory synced.
        for call in 1..8 {
            let disk = flaky(opening + call..opening + call + 1);
            let dir = RunDir::open_on(Arc::new(disk.clone()), "/a").expect("no call fails until then");
            match dir.commit(&key(0), &result(0)) {
                Err(RunDirError::Write { path, bytes_needed, source }) => {
                    assert_eq!(path, dir.unit_path(&key(0)));
                    assert_eq!(bytes_needed, 20 + 84);
                    assert_eq!(source.kind(), io::ErrorKind::StorageFull);
                }
                other => panic!("call {call} of the commit: {other:?}"),
            }
            // What was written of it does not go on to take up space.
            let left = disk.list(dir.unit_path(&key(0)).parent().expect("a directory")).unwrap_or_default();
            assert!(!left.iter().any(|name| name.ends_with(".tmp")), "call {call}: {left:?}");
        }
    }
}
