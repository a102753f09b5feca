//! Looking at the files that programs leave.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Every file below `folder`: its relative path and its bytes. Nothing, where there is no such folder.
///
/// # Panics
/// When a file cannot be read.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let read = |path: PathBuf| {
        let bytes =
            fs::read(folder.join(&path)).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        (path, bytes)
    };
    names(folder).into_iter().map(read).collect()
}

/// Copies everything below `from` to a new folder `to`.
///
/// # Panics
/// When a file cannot be read or written.
pub fn copy(from: &Path, to: &Path) {
    for (name, bytes) in contents(from) {
        let to = to.join(&name);
        let written = to.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(&to, bytes));
        written.unwrap_or_else(|error| panic!("{}: {error}", to.display()));
    }
}

/// The relative paths of all files below `folder`, in order.
pub fn names(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut todo) = (Vec::new(), vec![PathBuf::new()]);
    while let Some(below) = todo.pop() {
        for entry in fs::read_dir(folder.join(&below)).into_iter().flatten().flatten() {
            let path = below.join(entry.file_name());
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => todo.push(path),
                _ => found.push(path),
            }
        }
    }
    found.sort();
    found
}

/// Asks that two folders hold the same files with the same bytes.
///
/// # Panics
/// Naming the first file that differs.
pub fn assert_same(expected: &Path, got: &Path, after: &str) {
    let (expected, got) = (contents(expected), contents(got));
    let names = |files: &BTreeMap<PathBuf, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&expected), names(&got), "files after {after}");
    assert!(!expected.is_empty(), "nothing to compare after {after}");
    for (name, bytes) in &expected {
        let differs = bytes.iter().zip(&got[name]).position(|(a, b)| a != b);
        let lengths = (bytes.len(), got[name].len());
        assert!(
            differs.is_none() && lengths.0 == lengths.1,
            "{} differs after {after}: first at byte {differs:?}, lengths {lengths:?}",
            name.display()
        );
    }
}

/// Which file it is and when it was last written, so that a file that was put there again is told from one that stayed.
#[cfg(unix)]
pub fn identities(folder: &Path) -> BTreeMap<PathBuf, (u64, i64, i64)> {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |path: PathBuf| {
        let data = fs::metadata(folder.join(&path)).ok()?;
        Some((path, (data.ino(), data.mtime(), data.mtime_nsec())))
    };
    names(folder).into_iter().filter_map(identity).collect()
}
