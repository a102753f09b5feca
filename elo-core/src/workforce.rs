//! Worker processes that are started when they are needed, lent, taken back, and replaced when they are lost.

use std::sync::Mutex;

use crate::hosted::WorkerProgram;
use crate::policy::{Monitor, Stopped};
use crate::worker::{WorkerFault, WorkerProcess};

/// What workers are lost over is tried this often in all, each time in a new worker.
pub const TRIES: usize = 3;

/// Starts worker programs.
pub trait Hosts: Sync {
    /// Starts `program` and shakes hands.
    ///
    /// # Errors
    /// Why it does not run, in words that say what to do.
    fn start(&self, program: &WorkerProgram) -> Result<WorkerProcess, WorkerFault>;
}

/// Why a job has no result.
#[derive(Debug, thiserror::Error)]
pub enum Undone {
    /// The program does not start.
    #[error(transparent)]
    Start(WorkerFault),
    /// The worker is in order and cannot do the job.
    #[error(transparent)]
    Failed(WorkerFault),
    /// As many workers were lost as may be; how the last one was.
    #[error(transparent)]
    Lost(WorkerFault),
    /// The monitor asked to stop.
    #[error(transparent)]
    Stopped(Stopped),
}

/// A job for some worker.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// Which program does it.
    pub program: WorkerProgram,
    /// What is to be done, in the worker's words.
    pub work: &'a [u8],
    /// What it needs for that.
    pub inputs: &'a [Vec<u8>],
    /// How many workers may be lost over it, at least 1; [`TRIES`] where nothing speaks against it.
    pub workers: usize,
}

/// See the [module](self). Several threads may have jobs done at once, each by a worker of its own. When it is dropped, workers are
/// asked to end, so that they can clean up.
pub struct Workforce<'a> {
    hosts: &'a dyn Hosts,
    /// Workers that nobody uses just now.
    idle: Mutex<Vec<(WorkerProgram, WorkerProcess)>>,
}

impl<'a> Workforce<'a> {
    /// Nobody yet; `hosts` starts them.
    pub fn new(hosts: &'a dyn Hosts) -> Self {
        Self { hosts, idle: Mutex::default() }
    }

    /// Has a worker do the job. One that is lost is replaced, and the job begun again from its last checkpoint; `lost`
    /// hears why, unless it was killed while it started.
    ///
    /// # Errors
    /// See [`Undone`].
    pub fn run(
        &self,
        job: Job<'_>,
        monitor: &mut dyn Monitor,
        lost: &mut dyn FnMut(&WorkerFault),
    ) -> Result<Vec<u8>, Undone> {
        let mut tries = 0;
        loop {
            tries += 1;
            let fault = match self.lend(&job.program) {
                Ok(mut worker) => match worker.run(job.work, job.inputs, monitor) {
                    Err(WorkerFault::Stopped(stopped)) => return Err(Undone::Stopped(stopped)),
                    Err(fault) if !fault.leaves_worker_usable() => {
                        lost(&fault);
                        fault
                    }
                    done => {
                        self.take_back(job.program, worker);
                        return done.map_err(Undone::Failed);
                    }
                },
                Err(fault) if fault.was_killed() => fault,
                Err(fault) => return Err(Undone::Start(fault)),
            };
            if tries >= job.workers {
                return Err(Undone::Lost(fault));
            }
        }
    }

    fn lend(&self, program: &WorkerProgram) -> Result<WorkerProcess, WorkerFault> {
        let mut idle = self.idle.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let place = idle.iter().position(|(theirs, _)| theirs == program);
        let free = place.map(|place| idle.swap_remove(place).1);
        drop(idle);
        free.map_or_else(|| self.hosts.start(program), Ok)
    }

    fn take_back(&self, program: WorkerProgram, worker: WorkerProcess) {
        self.idle.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).push((program, worker));
    }
}

impl Drop for Workforce<'_> {
    fn drop(&mut self) {
        let idle = self.idle.get_mut().unwrap_or_else(|poisoned| poisoned.into_inner());
        WorkerProcess::stop_all(idle.drain(..).map(|(_, worker)| worker));
    }
}
