//! Who does the units of work: threads for engines that are safe inside this process, worker processes for the others.
//!
//! Results go through the run directory, so what is there already is never done again, and nothing about who did a unit
//! when, or how often it had to be tried, can change a byte.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::desks::Desks;
use crate::hosted::WorkerProgram;
use crate::key::{Key, Stage};
use crate::policy::{Monitor, PolicyFormat, Stopped};
use crate::run_dir::{RunDir, RunDirError};
use crate::seed::Seed;
use crate::statistics::StatisticsError;
use crate::units::codec::Malformed;
use crate::units::loss::AfterLoss;
use crate::units::{Site, Work, WorkError};
use crate::worker::WorkerFault;
use crate::workforce::{Hosts, Job, TRIES, Undone, Workforce};

/// One unit: what is to be done, and the units whose results it needs.
#[derive(Debug)]
pub struct Unit {
    /// The description.
    pub work: Work,
    /// Keys of its inputs, which must have been completed before.
    pub inputs: Vec<Key>,
}

/// Hears how far the work is. Called from several threads.
pub trait Watcher: Sync {
    /// A stage of `units` units begins; `ready` of them were done before.
    fn begin(&self, stage: &str, units: usize, ready: usize);
    /// `done` units of the stage are done, those under way counted by their fractions.
    fn advance(&self, stage: &str, done: f64);
    /// The stage is over.
    fn end(&self, stage: &str);
    /// Something that a person should know.
    fn notice(&self, message: &str);
}

/// A [`Watcher`] that hears nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Watcher for Unwatched {
    fn begin(&self, _: &str, _: usize, _: usize) {}
    fn advance(&self, _: &str, _: f64) {}
    fn end(&self, _: &str) {}
    fn notice(&self, _: &str) {}
}

/// Why a run stopped before its end.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A signal or the caller asked for it; the run can be taken up again.
    #[error("interrupted; the same command takes it up again")]
    Interrupted,
    /// The run directory cannot be read or written.
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    /// A unit cannot be done.
    #[error("stage {stage}, unit {key}: {reason}")]
    Unit {
        /// Its stage.
        stage: String,
        /// Its key.
        key: Key,
        /// Why.
        reason: String,
    },
    /// A worker program cannot be started.
    #[error("{0}")]
    Worker(WorkerFault),
    /// The config cannot be run.
    #[error("{0}")]
    Config(String),
    /// Candidates cannot be ranked.
    #[error("{0}")]
    Select(String),
}

impl From<StatisticsError> for RunError {
    fn from(error: StatisticsError) -> Self {
        Self::Config(format!("the report's statistics are not defined: {error}"))
    }
}

impl From<Malformed> for RunError {
    fn from(error: Malformed) -> Self {
        Self::Config(error.to_string())
    }
}

/// How many work, and with what.
#[derive(Clone, Debug)]
pub struct Staff {
    /// How many units are under way at once; at least 1. Results do not depend on it.
    pub workers: usize,
    /// Formats of option policies that can be read.
    pub formats: Vec<PolicyFormat>,
    /// Name and version of this program and what else its results depend on, see [`crate::fingerprint`]; part of every
    /// key.
    pub program: String,
}

/// Some workers, one run directory, and what they tell whom.
pub struct Crew<'a> {
    /// Where results go.
    pub run_dir: &'a RunDir,
    /// Hears how far it is.
    pub watcher: &'a dyn Watcher,
    /// Becomes true when everybody is to stop.
    pub stop: &'a AtomicBool,
    /// How many work, and with what.
    pub staff: Staff,
    /// Does what must not be done in this process.
    workforce: Workforce<'a>,
}

impl<'a> Crew<'a> {
    /// A crew over `run_dir` that stops when `stop` becomes true.
    pub fn new(
        staff: Staff,
        run_dir: &'a RunDir,
        hosts: &'a dyn Hosts,
        watcher: &'a dyn Watcher,
        stop: &'a AtomicBool,
    ) -> Self {
        Self { run_dir, watcher, stop, staff, workforce: Workforce::new(hosts) }
    }

    /// A crew over the same run directory whose workers `hosts` starts.
    pub fn hosted_by<'b>(&'b self, hosts: &'b dyn Hosts) -> Crew<'b> {
        Crew::new(self.staff.clone(), self.run_dir, hosts, self.watcher, self.stop)
    }

    /// The key of a unit.
    pub fn key(&self, unit: &Unit) -> Key {
        unit.work.key(&unit.inputs, &self.staff.program)
    }

    /// Does whatever of `units` is not in the run directory yet; gives their keys in order.
    ///
    /// # Errors
    /// The first unit that cannot be done, or an interruption; everything done until then is kept.
    pub fn complete(&self, stage: &str, units: &[Unit]) -> Result<Vec<Key>, RunError> {
        let keys: Vec<Key> = units.iter().map(|unit| self.key(unit)).collect();
        let mut missing = Vec::new();
        for (index, key) in keys.iter().enumerate() {
            if self.run_dir.read(key)?.is_none() {
                missing.push(index);
            }
        }
        self.tell_quarantined();
        let ready = units.len() - missing.len();
        self.watcher.begin(stage, units.len(), ready);
        let workers = self.staff.workers.min(missing.len());
        let shift = Shift {
            crew: self,
            stage,
            next: AtomicUsize::new(0),
            desks: Desks::new((0..workers).map(|_| Site::new(self.staff.formats.clone()))),
            over: AtomicBool::new(false),
            fractions: Mutex::new(vec![0.0; missing.len()]),
            ready,
            threads: (self.staff.workers / missing.len().max(1)).max(1),
            trouble: Mutex::new(None),
        };
        let todo: Vec<(&Unit, &Key)> = missing.iter().map(|index| (&units[*index], &keys[*index])).collect();
        std::thread::scope(|scope| {
            // While one thread commits a result, another goes on at its desk.
            for _ in 0..(2 * workers).min(todo.len()) {
                scope.spawn(|| shift.work(&todo));
            }
        });
        self.watcher.end(stage);
        let trouble = shift.trouble.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        trouble.map_or(Ok(keys), Err)
    }

    /// The result of a completed unit.
    ///
    /// # Errors
    /// The run directory's; a result that went missing since.
    pub fn result(&self, key: &Key) -> Result<Vec<u8>, RunError> {
        let bytes = self.run_dir.read(key)?;
        self.tell_quarantined();
        bytes.ok_or_else(|| RunError::Unit {
            stage: "read".to_owned(),
            key: *key,
            reason: "its result is gone; run again to compute it anew".to_owned(),
        })
    }

    /// Puts bytes that no unit made where units find them, under the hash of the bytes.
    ///
    /// # Errors
    /// The run directory's.
    pub fn import(&self, bytes: &[u8]) -> Result<Key, RunError> {
        let hash = blake3::hash(bytes).to_hex().to_string();
        let stage = Stage { name: "import", version: 1 };
        let key = Key::of(&stage, &hash, &[], &Seed::root(0), &self.staff.program);
        self.run_dir.commit(&key, bytes)?;
        Ok(key)
    }

    fn tell_quarantined(&self) {
        for damaged in self.run_dir.take_quarantined() {
            self.watcher.notice(&damaged.to_string());
        }
    }
}

/// One call of [`Crew::complete`].
struct Shift<'a> {
    crew: &'a Crew<'a>,
    stage: &'a str,
    next: AtomicUsize,
    /// One for each unit that may be under way.
    desks: Desks<Site>,
    /// Some unit cannot be done, so that none is to be begun.
    over: AtomicBool,
    fractions: Mutex<Vec<f64>>,
    ready: usize,
    /// That each unit may use, where there are fewer of them than workers.
    threads: usize,
    trouble: Mutex<Option<RunError>>,
}

impl Shift<'_> {
    fn work(&self, todo: &[(&Unit, &Key)]) {
        loop {
            let index = self.next.fetch_add(1, Ordering::Relaxed);
            let Some((unit, key)) = todo.get(index) else { return };
            if let Err(error) = self.do_one(index, unit, key) {
                self.over.store(true, Ordering::SeqCst);
                let mut trouble = self.trouble.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                // An interruption makes every other worker fail too: keep the cause.
                if !matches!(*trouble, Some(ref kept) if !matches!(kept, RunError::Interrupted)) {
                    *trouble = Some(error);
                }
                return;
            }
        }
    }

    fn do_one(&self, index: usize, unit: &Unit, key: &Key) -> Result<(), RunError> {
        let inputs = unit.inputs.iter().map(|key| self.crew.result(key)).collect::<Result<Vec<_>, _>>()?;
        // An interpreter runs one thread at a time.
        let alone = unit.work.worker().is_some_and(|program| program.is_interpreter());
        let threads = if alone { 1 } else { self.threads };
        let mut monitor = UnitMonitor { shift: self, index, key, threads, trouble: None };
        let done = self.at_a_desk(unit, &inputs, &mut monitor);
        if let Some(trouble) = monitor.trouble {
            return Err(trouble);
        }
        match done {
            Ok(bytes) => self.crew.run_dir.commit(key, &bytes)?,
            Err(WorkError::Stopped(_)) => return Err(RunError::Interrupted),
            Err(error) => return Err(self.failed(key, error.to_string())),
        }
        self.tell(index, 1.0);
        Ok(())
    }

    fn at_a_desk(
        &self,
        unit: &Unit,
        inputs: &[Vec<u8>],
        monitor: &mut UnitMonitor<'_>,
    ) -> Result<Vec<u8>, WorkError> {
        let mut site = self.desks.sit();
        if self.over.load(Ordering::SeqCst) {
            return Err(Stopped.into());
        }
        let done = match unit.work.worker() {
            None => unit.work.perform(inputs, &mut site, monitor),
            Some(program) => self.send(&program, unit, inputs, monitor),
        };
        // Told before the desk is free, where somebody waits.
        self.over.fetch_or(done.is_err(), Ordering::SeqCst);
        done
    }

    /// Has a worker process do the unit. A worker that dies is replaced, and what it was at is tried again with the same
    /// seeds.
    fn send(
        &self,
        program: &WorkerProgram,
        unit: &Unit,
        inputs: &[Vec<u8>],
        monitor: &mut UnitMonitor<'_>,
    ) -> Result<Vec<u8>, WorkError> {
        let work = serde_json::to_vec(&unit.work).expect("descriptions are plain data");
        let job = Job { program: *program, work: &work, inputs, workers: unit.work.workers() };
        let key = monitor.key;
        let mut lost = |fault: &WorkerFault| {
            self.crew.watcher.notice(&format!("{program}, unit {key}: {fault}"));
        };
        loop {
            let fault = match self.crew.workforce.run(job, monitor, &mut lost) {
                Ok(bytes) => return Ok(bytes),
                Err(Undone::Stopped(stopped)) => return Err(stopped.into()),
                Err(Undone::Failed(fault)) => return Err(WorkError::Failed(fault.to_string())),
                Err(Undone::Lost(fault)) => fault,
                Err(Undone::Start(fault)) => {
                    monitor.trouble = Some(RunError::Worker(fault));
                    return Err(Stopped.into());
                }
            };
            let kept = monitor.resume();
            monitor.go_on()?;
            let reason = format!("{program} was lost {TRIES} times: {fault}");
            let next = unit.work.after_loss(inputs, kept.as_deref(), &format!("unit {key}: {reason}"))?;
            match next {
                Some(AfterLoss::TakeUp(kept)) => monitor.checkpoint(&kept)?,
                Some(AfterLoss::Result(bytes)) => return Ok(bytes),
                None => return Err(WorkError::Failed(reason)),
            }
        }
    }

    fn failed(&self, key: &Key, reason: String) -> RunError {
        RunError::Unit { stage: self.stage.to_owned(), key: *key, reason }
    }

    fn tell(&self, index: usize, fraction: f64) {
        let mut fractions = self.fractions.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        fractions[index] = fraction;
        let done = self.ready as f64 + fractions.iter().sum::<f64>();
        drop(fractions);
        self.crew.watcher.advance(self.stage, done);
    }
}

/// What a unit under way sees of its shift.
struct UnitMonitor<'a> {
    shift: &'a Shift<'a>,
    index: usize,
    key: &'a Key,
    threads: usize,
    trouble: Option<RunError>,
}

impl UnitMonitor<'_> {
    fn go_on(&self) -> Result<(), Stopped> {
        let stop = self.trouble.is_some() || self.shift.crew.stop.load(Ordering::Relaxed);
        if stop { Err(Stopped) } else { Ok(()) }
    }
}

impl Monitor for UnitMonitor<'_> {
    fn resume(&mut self) -> Option<Vec<u8>> {
        match self.shift.crew.run_dir.read_checkpoint(self.key) {
            Ok(bytes) => bytes,
            Err(error) => {
                self.trouble = Some(error.into());
                None
            }
        }
    }

    fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped> {
        match self.shift.crew.run_dir.write_checkpoint(self.key, bytes) {
            Ok(()) => Ok(()),
            Err(error) => {
                self.trouble = Some(error.into());
                Err(Stopped)
            }
        }
    }

    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped> {
        self.go_on()?;
        self.shift.tell(self.index, done as f64 / total.max(1) as f64);
        Ok(())
    }

    fn threads(&self) -> usize {
        self.threads
    }
}
