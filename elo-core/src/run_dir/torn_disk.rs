//! A disk in memory whose power can be cut at any operation, and the promise about power cuts that it puts to the test:
//! a unit whose commit returned is there afterwards, and nothing is ever there in part.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use rand::RngExt;

use super::file_system::{FileSystem, NewFile};
use super::lock::LockError;
use crate::seed::{Seed, Stream};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Node {
    Dir,
    File(usize),
}

/// One change of a name in a directory that may not have reached the disk.
#[derive(Clone, Debug)]
struct Change {
    dir: PathBuf,
    path: PathBuf,
    node: Option<Node>,
}

#[derive(Clone, Debug, Default)]
struct Content {
    data: Vec<u8>,
    synced: Vec<u8>,
}

#[derive(Clone, Default)]
struct State {
    contents: Vec<Content>,
    names: BTreeMap<PathBuf, Node>,
    synced_names: BTreeMap<PathBuf, Node>,
    changes: Vec<Change>,
    operations: usize,
}

/// What becomes of everything that was not synced.
#[derive(Clone, Copy, Debug)]
pub(super) enum Loss {
    /// All of it is lost.
    Everything,
    /// Names are there, the files are empty.
    Data,
    /// Names are there, the files have their length and hold zeros.
    Zeros,
    /// Names are there, files are cut in half.
    Half,
    /// Names are lost, so renamed files are back under their old names.
    Names,
    /// Nothing is lost.
    Nothing,
    /// Each name and each file by chance, changes of names in any order.
    Random(u64),
}

/// The disk. Clones are the same disk.
#[derive(Clone)]
pub(super) struct TornDisk {
    state: Arc<Mutex<State>>,
    /// The number of the operation at which the power is cut, before it does anything.
    cut_at: usize,
    /// The lies of a disk that only says that it synced.
    pub(super) syncs_files: bool,
    pub(super) syncs_names: bool,
}

impl TornDisk {
    /// An empty disk with a directory `/`.
    pub(super) fn new(cut_at: usize) -> Self {
        let names = BTreeMap::from([(PathBuf::from("/"), Node::Dir)]);
        let state = State { synced_names: names.clone(), names, ..State::default() };
        Self { state: Arc::new(Mutex::new(state)), cut_at, syncs_files: true, syncs_names: true }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no test panics with it")
    }

    /// Operations begun so far.
    pub(super) fn operations(&self) -> usize {
        self.state().operations
    }

    fn begin(&self) -> io::Result<MutexGuard<'_, State>> {
        let mut state = self.state();
        if state.operations >= self.cut_at {
            return Err(io::Error::other("the power is off"));
        }
        state.operations += 1;
        Ok(state)
    }

    /// What is on the disk when the power is back.
    pub(super) fn after(&self, loss: Loss) -> Self {
        let old = self.state();
        let mut chance = Seed::root(if let Loss::Random(seed) = loss { seed } else { 0 }).stream();
        let mut changes = old.changes.clone();
        match loss {
            Loss::Everything | Loss::Names => changes.clear(),
            Loss::Random(_) => changes = some_in_any_order(changes, &mut chance),
            _ => {}
        }
        let mut names = old.synced_names.clone();
        for Change { path, node, .. } in changes {
            match node {
                Some(node) => names.insert(path, node),
                None => names.remove(&path),
            };
        }
        let all = names.clone();
        names.retain(|path, _| path.ancestors().skip(1).all(|dir| all.get(dir) == Some(&Node::Dir)));
        let contents = old.contents.iter().map(|content| {
            let data = content.survivor(loss, &mut chance);
            Content { synced: data.clone(), data }
        });
        let state =
            State { contents: contents.collect(), synced_names: names.clone(), names, ..State::default() };
        Self { state: Arc::new(Mutex::new(state)), cut_at: usize::MAX, ..self.clone() }
    }
}

fn some_in_any_order(changes: Vec<Change>, chance: &mut Stream) -> Vec<Change> {
    let mut kept: Vec<Change> = changes.into_iter().filter(|_| chance.random_bool(0.5)).collect();
    for i in (1..kept.len()).rev() {
        kept.swap(i, chance.random_range(0..=i));
    }
    kept
}

impl Content {
    fn survivor(&self, loss: Loss, chance: &mut Stream) -> Vec<u8> {
        if self.data == self.synced {
            return self.data.clone();
        }
        let loss = match loss {
            Loss::Random(_) => [Loss::Everything, Loss::Data, Loss::Zeros, Loss::Half, Loss::Nothing]
                [chance.random_range(0..5)],
            other => other,
        };
        match loss {
            Loss::Everything => self.synced.clone(),
            Loss::Data => Vec::new(),
            Loss::Zeros => vec![0; self.data.len()],
            Loss::Half => self.data[..self.data.len() / 2].to_vec(),
            _ => self.data.clone(),
        }
    }
}

impl State {
    fn change(&mut self, path: &Path, node: Option<Node>) {
        match node {
            Some(node) => self.names.insert(path.to_owned(), node),
            None => self.names.remove(path),
        };
        let dir = path.parent().expect("it is below `/`").to_owned();
        self.changes.push(Change { dir, path: path.to_owned(), node });
    }

    fn add(&mut self, path: &Path, node: Node) -> io::Result<()> {
        if self.names.contains_key(path) {
            return Err(ErrorKind::AlreadyExists.into());
        }
        if path.parent().and_then(|dir| self.names.get(dir)) != Some(&Node::Dir) {
            return Err(ErrorKind::NotFound.into());
        }
        self.change(path, Some(node));
        Ok(())
    }

    fn file(&self, path: &Path) -> io::Result<usize> {
        match self.names.get(path) {
            Some(Node::File(id)) => Ok(*id),
            Some(Node::Dir) => Err(ErrorKind::IsADirectory.into()),
            None => Err(ErrorKind::NotFound.into()),
        }
    }
}

impl FileSystem for TornDisk {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        self.begin()?.add(path, Node::Dir)
    }

    fn create_new(&self, path: &Path) -> io::Result<Box<dyn NewFile>> {
        let mut state = self.begin()?;
        let id = state.contents.len();
        state.add(path, Node::File(id))?;
        state.contents.push(Content::default());
        Ok(Box::new(TornFile { disk: self.clone(), id }))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut state = self.begin()?;
        let id = state.file(from)?;
        state.change(to, Some(Node::File(id)));
        state.change(from, None);
        Ok(())
    }

    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        let mut state = self.begin()?;
        if self.syncs_names {
            let (done, left): (Vec<_>, _) =
                std::mem::take(&mut state.changes).into_iter().partition(|change| change.dir == path);
            state.changes = left;
            for Change { path, node, .. } in done {
                match node {
                    Some(node) => state.synced_names.insert(path, node),
                    None => state.synced_names.remove(&path),
                };
            }
        }
        Ok(())
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let state = self.begin()?;
        Ok(state.contents[state.file(path)?].data.clone())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        let mut state = self.begin()?;
        state.file(path)?;
        state.change(path, None);
        Ok(())
    }

    fn list(&self, path: &Path) -> io::Result<Vec<String>> {
        let state = self.begin()?;
        let inside = state.names.keys().filter(|name| name.parent() == Some(path));
        Ok(inside.filter_map(|name| Some(name.file_name()?.to_str()?.to_owned())).collect())
    }

    /// Makes the file and locks nothing: there is one process to a disk here.
    fn lock(&self, path: &Path) -> Result<Box<dyn Send + Sync>, LockError> {
        match self.create_new(path) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(error.into()),
            _ => Ok(Box::new(())),
        }
    }
}

struct TornFile {
    disk: TornDisk,
    id: usize,
}

impl NewFile for TornFile {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.disk.begin()?.contents[self.id].data.extend_from_slice(bytes);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        let mut state = self.disk.begin()?;
        if self.disk.syncs_files {
            let content = &mut state.contents[self.id];
            content.synced = content.data.clone();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::workload::{Done, recover, work};
    use super::*;

    const LOSSES: [Loss; 6] =
        [Loss::Everything, Loss::Data, Loss::Zeros, Loss::Half, Loss::Names, Loss::Nothing];

    /// Cuts the power at every operation of the workload, with every kind of loss, and gives the first broken promise.
    fn cut_everywhere(disk: impl Fn(usize) -> TornDisk) -> Result<usize, String> {
        let whole = disk(usize::MAX);
        work(Arc::new(whole.clone()), &mut Done::default()).map_err(|error| error.to_string())?;
        let operations = whole.operations();
        for cut_at in 0..=operations {
            let torn = disk(cut_at);
            let mut done = Done::default();
            let outcome = work(Arc::new(torn.clone()), &mut done);
            assert_eq!(outcome.is_ok(), cut_at == operations, "operation {cut_at} of {operations}");
            for loss in LOSSES.into_iter().chain((0..24).map(Loss::Random)) {
                recover(Arc::new(torn.after(loss)), &done)
                    .map_err(|broken| format!("power cut at {cut_at} of {operations}, {loss:?}: {broken}"))?;
            }
        }
        Ok(operations)
    }

    #[test]
    fn a_power_cut_at_any_operation_takes_nothing_back_and_leaves_nothing_half() {
        let operations = cut_everywhere(TornDisk::new).unwrap_or_else(|broken| panic!("{broken}"));
        assert!(operations > 80, "only {operations} operations");
    }

    #[test]
    fn a_process_that_goes_on_after_a_killed_one_makes_the_work_of_both_last() {
        let whole = TornDisk::new(usize::MAX);
        let mut done = Done::default();
        work(Arc::new(whole.clone()), &mut done).unwrap();
        for killed_at in 0..whole.operations() {
            let disk = TornDisk::new(killed_at);
            work(Arc::new(disk.clone()), &mut Done::default()).unwrap_err();
            let disk = TornDisk { cut_at: usize::MAX, ..disk };
            work(Arc::new(disk.clone()), &mut Done::default()).unwrap();
            recover(Arc::new(disk.after(Loss::Everything)), &done)
                .unwrap_or_else(|broken| panic!("killed at {killed_at}: {broken}"));
        }
    }

    #[test]
    fn a_disk_that_lies_about_syncing_breaks_the_promise_and_this_is_seen() {
        let no_files = |cut_at| TornDisk { syncs_files: false, ..TornDisk::new(cut_at) };
        let no_names = |cut_at| TornDisk { syncs_names: false, ..TornDisk::new(cut_at) };
        let broken = [cut_everywhere(no_files), cut_everywhere(no_names)].map(Result::unwrap_err);
        assert!(broken.iter().all(|promise| promise.ends_with("is lost")), "{broken:?}");
    }
}
