//! Long computations that somebody watches: the rules about interruptions and progress, for whatever trains.

use std::sync::OnceLock;

use super::check::{Finding, Violation};
use super::compare::granted;
use crate::policy::{CurvePoint, Monitor, Stopped, TrainError};
use crate::simulator::BuildError;

/// A computation that leaves checkpoints and can be stopped.
pub(super) trait Interruptible {
    /// What it gives.
    type Outcome;

    /// Does it.
    fn run(&self, monitor: &mut dyn Monitor) -> Result<Self::Outcome, TrainError>;

    /// Where the run that nothing interrupts is kept.
    fn kept(&self) -> &OnceLock<Result<Watched<Self::Outcome>, TrainError>>;

    /// Asks for the same outcome, bit for bit.
    fn same(expected: &Self::Outcome, got: &Self::Outcome) -> Result<(), Violation>;

    /// The run that nothing interrupts: done once, shared by the checks.
    fn watched(&self) -> Result<&Watched<Self::Outcome>, Finding> {
        let watched = self.kept().get_or_init(|| {
            let mut record = Stopwatch::never();
            let outcome = self.run(&mut record)?;
            Ok(Watched { outcome, checkpoints: record.checkpoints.len(), progress: record.progress })
        });
        watched.as_ref().map_err(|error| match error {
            TrainError::Build(BuildError::MissingEngine { .. }) => Finding::Skipped(error.to_string()),
            _ => Violation::new("training", "a result", error).into(),
        })
    }
}

/// A whole run and what its monitor saw.
#[derive(Debug)]
pub(super) struct Watched<T> {
    pub outcome: T,
    pub checkpoints: usize,
    pub progress: Vec<(u64, u64)>,
}

/// A monitor that keeps what it is given and stops at a given moment.
#[derive(Debug)]
pub(super) struct Stopwatch {
    resume: Option<Vec<u8>>,
    checkpoints: Vec<Vec<u8>>,
    progress: Vec<(u64, u64)>,
    stop: Stop,
    threads: usize,
}

/// When to stop; counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stop {
    Never,
    AtCheckpoint(usize),
    AtProgress(usize),
}

impl Stopwatch {
    pub fn never() -> Self {
        Self::stopping(Stop::Never)
    }

    fn stopping(stop: Stop) -> Self {
        Self { resume: None, checkpoints: Vec::new(), progress: Vec::new(), stop, threads: 1 }
    }

    fn from(checkpoint: Option<Vec<u8>>, stop: Stop) -> Self {
        Self { resume: checkpoint, ..Self::stopping(stop) }
    }

    fn go_on(&self, now: Stop) -> Result<(), Stopped> {
        if self.stop == now { Err(Stopped) } else { Ok(()) }
    }
}

impl Monitor for Stopwatch {
    fn resume(&mut self) -> Option<Vec<u8>> {
        self.resume.clone()
    }

    fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped> {
        self.checkpoints.push(bytes.to_vec());
        self.go_on(Stop::AtCheckpoint(self.checkpoints.len()))
    }

    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped> {
        self.progress.push((done, total));
        self.go_on(Stop::AtProgress(self.progress.len()))
    }

    fn threads(&self) -> usize {
        self.threads
    }
}

/// The same outcome on another thread.
pub(super) fn repeats<C: Interruptible + Sync>(case: &C) -> Result<(), Finding>
where
    C::Outcome: Send,
{
    let expected = &case.watched()?.outcome;
    let there = std::thread::scope(|scope| scope.spawn(|| case.run(&mut Stopwatch::never())).join());
    let there = there.map_err(|_| Violation::new("the other thread", "no panic", "a panic"))?;
    Ok(C::same(expected, &granted("training on another thread", there)?)?)
}

/// The same outcome with three threads to use.
pub(super) fn threads_change_nothing<C: Interruptible>(case: &C) -> Result<(), Finding> {
    let expected = &case.watched()?.outcome;
    let mut monitor = Stopwatch { threads: 3, ..Stopwatch::never() };
    Ok(C::same(expected, &granted("training by three threads", case.run(&mut monitor))?)?)
}

/// The end comes as [`Stopped`] when the monitor says so.
pub(super) fn obeys_stops<C: Interruptible>(case: &C) -> Result<(), Finding> {
    let watched = case.watched()?;
    let mut stops = vec![Stop::AtProgress(1)];
    stops.extend((watched.checkpoints > 0).then_some(Stop::AtCheckpoint(1)));
    for stop in stops {
        match case.run(&mut Stopwatch::stopping(stop)) {
            Err(TrainError::Stopped(Stopped)) => {}
            Err(error) => return Err(Violation::new(format!("{stop:?}"), Stopped, error).into()),
            Ok(_) => return Err(Violation::new(format!("{stop:?}"), Stopped, "a result").into()),
        }
    }
    Ok(())
}

/// Stopped at each checkpoint or between two and taken up again, the outcome is the same.
pub(super) fn resumes<C: Interruptible>(case: &C) -> Result<(), Finding> {
    let watched = case.watched()?;
    if watched.checkpoints == 0 {
        return Err(Finding::Skipped("it writes no checkpoints".to_owned()));
    }
    let chained = with_stops(case, watched.checkpoints)?;
    C::same(&watched.outcome, &chained).map_err(|v| v.during("stopped at every checkpoint"))?;
    for moment in [watched.progress.len() / 2, watched.progress.len()] {
        let mut broken = Stopwatch::stopping(Stop::AtProgress(moment.max(1)));
        if case.run(&mut broken).is_ok() {
            return Err(Violation::new(format!("report of progress {moment}"), Stopped, "a result").into());
        }
        let mut rest = Stopwatch::from(broken.checkpoints.pop(), Stop::Never);
        let outcome = granted("training taken up again", case.run(&mut rest))?;
        C::same(&watched.outcome, &outcome)
            .map_err(|v| v.during(format!("stopped at report of progress {moment}")))?;
    }
    Ok(())
}

/// A damaged checkpoint is an error, or changes nothing.
pub(super) fn survives_damage<C: Interruptible>(case: &C) -> Result<(), Finding> {
    let watched = case.watched()?;
    if watched.checkpoints == 0 {
        return Err(Finding::Skipped("it writes no checkpoints".to_owned()));
    }
    let mut first = Stopwatch::stopping(Stop::AtCheckpoint(1));
    let _stopped = case.run(&mut first);
    let whole = first.checkpoints.pop().unwrap_or_default();
    let cut = |length: usize| whole[..length].to_vec();
    let damaged = [
        ("an empty one", Vec::new()),
        ("half of one", cut(whole.len() / 2)),
        ("one without its last byte", cut(whole.len().saturating_sub(1))),
        ("one of other bytes", vec![0xa5; whole.len()]),
    ];
    for (what, bytes) in damaged {
        let mut monitor = Stopwatch::from(Some(bytes), Stop::Never);
        if let Ok(outcome) = case.run(&mut monitor) {
            C::same(&watched.outcome, &outcome).map_err(|v| v.during(what))?;
        }
    }
    Ok(())
}

/// The steps of a curve grow, and what it tells is finite.
pub(super) fn goes_forward(curve: &[CurvePoint]) -> Result<(), Finding> {
    growing("steps of the curve", curve.iter().map(|point| point.steps))?;
    let numbers = curve.iter().flat_map(|p| [p.mean_return, p.mean_length]).flatten();
    match numbers.into_iter().find(|x| !x.is_finite()) {
        None => Ok(()),
        Some(x) => Err(Violation::new("a number of the curve", "finite", x).into()),
    }
}

/// Progress is told, never goes back, and its total is `estimate`.
pub(super) fn tells_progress(progress: &[(u64, u64)], estimate: u64) -> Result<(), Finding> {
    let mut before = 0;
    for (done, total) in progress {
        if *total != estimate {
            return Err(Violation::new("total of the progress", estimate, total).into());
        }
        if !(before..=estimate).contains(done) {
            let expected = format!("{before} to {estimate}");
            return Err(Violation::new("steps done", expected, done).into());
        }
        before = *done;
    }
    if progress.is_empty() {
        return Err(Violation::new("reports of progress", "one or more", 0).into());
    }
    Ok(())
}

/// Asks that each of `steps` is more than the one before.
pub(super) fn growing(what: &str, steps: impl Iterator<Item = u64>) -> Result<(), Violation> {
    let mut before = None;
    for step in steps {
        if before.is_some_and(|before| step <= before) {
            return Err(Violation::new(what, format!("more than {}", before.unwrap_or(0)), step));
        }
        before = Some(step);
    }
    Ok(())
}

/// Runs to the end, stopping at each checkpoint and taking up again from it.
fn with_stops<C: Interruptible>(case: &C, checkpoints: usize) -> Result<C::Outcome, Finding> {
    let mut newest = None;
    for _ in 0..=checkpoints {
        let mut monitor = Stopwatch::from(newest.take(), Stop::AtCheckpoint(1));
        match case.run(&mut monitor) {
            Ok(outcome) => return Ok(outcome),
            Err(TrainError::Stopped(Stopped)) => newest = monitor.checkpoints.pop(),
            Err(error) => return Err(Violation::new("training taken up again", "a result", error).into()),
        }
    }
    let (expected, got) = (format!("an end after {checkpoints} checkpoints"), "one more checkpoint");
    Err(Violation::new("training taken up again", expected, got).into())
}
