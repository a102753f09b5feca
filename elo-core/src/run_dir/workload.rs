//! A short run of everything that a run directory is used for, with a record of what it was promised, for the tests
//! that take its disk away.

use std::sync::Arc;

use super::file_system::FileSystem;
use super::{RunDir, RunDirError};
use crate::key::{Key, Stage};
use crate::seed::Seed;

/// What the workload may rely on so far.
#[derive(Clone, Debug, Default)]
pub(super) struct Done {
    /// Units `0..committed` are committed.
    pub committed: u64,
    /// The unit and the number of the newest checkpoint that was stored, and of the newest that was begun.
    pub checkpoint: Option<(u64, u64)>,
    /// Reports `0..=n` were written, or perhaps `n + 1` too.
    pub report: Option<u64>,
}

const UNITS: u64 = 3;
const CHECKPOINTS: u64 = 2;

pub(super) fn key(unit: u64) -> Key {
    Key::of(&Stage { name: "test", version: 1 }, &(), &[], &Seed::root(unit), "")
}

/// The result of a unit; not all of one length.
pub(super) fn result(unit: u64) -> Vec<u8> {
    (0..20 + 7 * unit).map(|i| (i * 31 + unit) as u8).collect()
}

fn checkpoint(unit: u64, number: u64) -> Vec<u8> {
    format!("checkpoint {number} of unit {unit}").into_bytes()
}

fn report(number: u64) -> Vec<u8> {
    format!("{{\"report\": {number}, \"units\": \"{}\"}}", "x".repeat(number as usize)).into_bytes()
}

/// Units with two checkpoints each, and a report after each.
pub(super) fn work(disk: Arc<dyn FileSystem>, done: &mut Done) -> Result<(), RunDirError> {
    let dir = RunDir::open_on(disk, "/runs/a")?;
    for unit in 0..UNITS {
        for number in 0..CHECKPOINTS {
            dir.write_checkpoint(&key(unit), &checkpoint(unit, number))?;
            done.checkpoint = Some((unit, number));
        }
        dir.commit(&key(unit), &result(unit))?;
        done.committed = unit + 1;
        done.checkpoint = None;
        dir.write_file("reports/report.json", &report(unit))?;
        done.report = Some(unit);
    }
    Ok(())
}

/// Opens the directory again, checks every promise, finishes the work and checks the end. The error is the first
/// promise that was broken.
pub(super) fn recover(disk: Arc<dyn FileSystem>, done: &Done) -> Result<(), String> {
    let text = |error: RunDirError| error.to_string();
    let dir = RunDir::open_on(disk.clone(), "/runs/a").map_err(text)?;
    for unit in 0..UNITS {
        match dir.read(&key(unit)).map_err(text)? {
            Some(stored) if stored != result(unit) => return Err(format!("unit {unit} is wrong")),
            None if unit < done.committed => return Err(format!("unit {unit} is lost")),
            _ => {}
        }
        let stored = dir.read_checkpoint(&key(unit)).map_err(text)?;
        let numbers: Vec<u64> = (0..CHECKPOINTS).filter(|n| stored == Some(checkpoint(unit, *n))).collect();
        if stored.is_some() && numbers.is_empty() {
            return Err(format!("the checkpoint of unit {unit} is wrong"));
        }
        let finished = dir.read(&key(unit)).map_err(text)?.is_some();
        match done.checkpoint {
            Some((of, least)) if of == unit && !finished && numbers.iter().all(|n| *n < least) => {
                return Err(format!("checkpoint {least} of unit {unit} is lost"));
            }
            _ => {}
        }
    }
    let stored = dir.read_file("reports/report.json").map_err(text)?;
    let next = done.report.map_or(0, |n| n + 1);
    let allowed = done.report.map(report).into_iter().chain((next < UNITS).then(|| report(next)));
    match stored {
        Some(stored) if !allowed.into_iter().any(|one| one == stored) => {
            return Err("the report is wrong".to_owned());
        }
        None if done.report.is_some() => return Err("the report is lost".to_owned()),
        _ => {}
    }
    drop(dir);
    work(disk.clone(), &mut Done::default()).map_err(text)?;
    let dir = RunDir::open_on(disk.clone(), "/runs/a").map_err(text)?;
    let whole = (0..UNITS).all(|unit| dir.read(&key(unit)).ok().flatten() == Some(result(unit)));
    let left = disk.list("/runs/a/checkpoints".as_ref()).map_err(|error| error.to_string())?;
    match (whole, left.iter().find(|name| !name.contains(".corrupt"))) {
        (false, _) => Err("the run could not be finished".to_owned()),
        (true, Some(name)) => Err(format!("`{name}` is left over")),
        (true, None) => Ok(()),
    }
}
