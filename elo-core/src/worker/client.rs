//! The parent's side: one worker process.

use std::io::Write;
use std::process::{ChildStdin, ChildStdout, Command};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::thread::spawn;
use std::time::{Duration, Instant};

use super::fault::WorkerFault;
use super::frames::FrameError;
use super::messages::{PROTOCOL, Reply, Request};
use super::process::{Exit, Group, LastLines};
use crate::policy::{Monitor, Stopped};

/// How often a silent worker is looked after and its job's monitor is asked whether to stop.
const TICK: Duration = Duration::from_millis(100);

/// How long a worker that has closed its output, or was asked to stop, is given to end.
const FAREWELL: Duration = Duration::from_secs(2);

/// What is asked of a worker process besides results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// How long it may take from its start to its greeting. Default: 60 s, for programs that load large libraries.
    pub greeting: Duration,
    /// How long it may say nothing while it has a job; progress counts as a word. `None` (the default) waits forever.
    pub silence: Option<Duration>,
    /// Address space in bytes, where the system can limit it; asking for more is refused. An engine that cannot go on
    /// without then ends its process instead of slowing down the machine. `None` (the default) is no limit.
    pub memory_bytes: Option<u64>,
}

impl Default for Limits {
    fn default() -> Self {
        Self { greeting: Duration::from_secs(60), silence: None, memory_bytes: None }
    }
}

/// A worker that has greeted and has no job. It and whatever it started is killed when this is dropped.
pub struct WorkerProcess {
    program: String,
    engine: String,
    limits: Limits,
    group: Group,
    /// Frames for the thread that writes to it; a worker that does not read must not stop its parent.
    requests: Sender<Vec<u8>>,
    /// From the thread that reads from it; disconnected at the end of its output.
    replies: Receiver<Result<Reply<'static>, FrameError>>,
    stderr: LastLines,
    jobs: u64,
}

impl WorkerProcess {
    /// Starts `command` in a process group of its own and exchanges greetings.
    ///
    /// # Errors
    /// [`WorkerFault::Start`], [`WorkerFault::NoAnswer`], [`WorkerFault::Mismatch`] when its protocol or fingerprint
    /// is another, [`WorkerFault::Died`], e.g. for want of a library, [`WorkerFault::Protocol`].
    pub fn spawn(command: Command, fingerprint: &str, limits: Limits) -> Result<Self, WorkerFault> {
        let program = command.get_program().to_string_lossy().into_owned();
        let (group, pipes) = Group::spawn(command, limits.memory_bytes)
            .map_err(|source| WorkerFault::Start { program: program.clone(), source })?;
        let (requests, to_write) = channel();
        let (read, replies) = sync_channel(1);
        spawn(move || write_all(pipes.input, &to_write));
        spawn(move || read_all(pipes.output, &read));
        let stderr = LastLines::of(pipes.error);
        let mut worker =
            Self { program, engine: String::new(), limits, group, requests, replies, stderr, jobs: 0 };
        worker.greet(fingerprint)?;
        Ok(worker)
    }

    fn greet(&mut self, expected: &str) -> Result<(), WorkerFault> {
        let hello = Request::Hello { protocol: PROTOCOL, fingerprint: expected.into() };
        let frame = hello.encode().map_err(|error| self.garbled(error.to_string()))?;
        self.send(frame);
        let greeting = self.limits.greeting;
        let answer = self.next_reply(Some(greeting), &mut || Ok(())).map_err(|fault| match fault {
            WorkerFault::Hung { program, after, stderr } => WorkerFault::NoAnswer { program, after, stderr },
            other => other,
        })?;
        let Reply::Hello { protocol, fingerprint, engine } = answer else {
            return Err(self.garbled("it did not greet first".to_owned()));
        };
        let mismatch = |what, expected: String, got: String| {
            let program = self.program.clone();
            Err(WorkerFault::Mismatch { program, what, expected, got })
        };
        if protocol != PROTOCOL {
            return mismatch("protocol", PROTOCOL.to_string(), protocol.to_string());
        }
        if fingerprint != expected {
            return mismatch("fingerprint", expected.to_owned(), fingerprint.into_owned());
        }
        self.engine = engine.into_owned();
        Ok(())
    }

    /// The engine that it runs, with its version.
    pub fn engine(&self) -> &str {
        &self.engine
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.group.id()
    }

    /// Has it do a job, taken up from what `monitor` resumes with, and waits for the result.
    ///
    /// `monitor` gets the checkpoints and the progress. While the worker is silent its last progress is repeated about
    /// ten times a second (0 of 0 before the first), so that the monitor can stop the job; then the worker is killed.
    ///
    /// # Errors
    /// [`WorkerFault`]. Unless it [leaves the worker usable](WorkerFault::leaves_worker_usable), its process has ended,
    /// and any further job fails with [`WorkerFault::Died`].
    pub fn run(
        &mut self,
        job: &[u8],
        inputs: &[Vec<u8>],
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkerFault> {
        let id = self.jobs;
        let checkpoint = monitor.resume();
        let request = Request::Job {
            id,
            job: job.into(),
            inputs: inputs.into(),
            threads: monitor.threads() as u32,
            checkpoint: checkpoint.as_deref().map(Into::into),
        };
        let frame = request.encode().map_err(|error| match error {
            FrameError::Length(bytes) => WorkerFault::TooLarge { bytes },
            other => self.garbled(other.to_string()),
        })?;
        self.jobs += 1;
        self.send(frame);
        let result = self.follow(id, monitor);
        if result.as_ref().is_err_and(|fault| !fault.leaves_worker_usable()) {
            self.group.end();
        }
        result
    }

    fn follow(&mut self, job: u64, monitor: &mut dyn Monitor) -> Result<Vec<u8>, WorkerFault> {
        let (mut done, mut total) = (0, 0);
        loop {
            let reply = self.next_reply(self.limits.silence, &mut || monitor.progress(done, total))?;
            if let Some(id) = reply.id().filter(|id| *id != job) {
                return Err(self.garbled(format!("it answered job {id} while it had job {job}")));
            }
            match reply {
                Reply::Progress { done: now, total: of, .. } => {
                    (done, total) = (now, of);
                    monitor.progress(done, total)?;
                }
                Reply::Checkpoint { bytes, .. } => monitor.checkpoint(&bytes)?,
                Reply::Done { bytes, .. } => return Ok(bytes.into_owned()),
                Reply::Failed { error, .. } => return Err(error.into()),
                Reply::Hello { .. } => return Err(self.garbled("it greeted twice".to_owned())),
            }
        }
    }

    /// Asks it to end and gives it two seconds, so that it can clean up; then it is killed.
    pub fn stop(self) {
        Self::stop_all([self]);
    }

    /// [`Self::stop`] for several workers, which have the two seconds together.
    pub fn stop_all(workers: impl IntoIterator<Item = Self>) {
        let ask = |worker: Self| {
            if let Ok(frame) = Request::Stop.encode() {
                worker.send(frame);
            }
            worker
        };
        let (start, asked) = (Instant::now(), workers.into_iter().map(ask).collect::<Vec<_>>());
        for mut worker in asked {
            worker.group.wait(FAREWELL.saturating_sub(start.elapsed()));
        }
    }

    fn send(&self, frame: Vec<u8>) {
        // A worker that does not take it has ended or will be silent, and both are told from its replies.
        let _ = self.requests.send(frame);
    }

    /// Waits for its next word, at most so long; `tick` may stop the waiting.
    fn next_reply(
        &mut self,
        at_most: Option<Duration>,
        tick: &mut dyn FnMut() -> Result<(), Stopped>,
    ) -> Result<Reply<'static>, WorkerFault> {
        let start = Instant::now();
        let mut ended = false;
        loop {
            let left = at_most.map_or(TICK, |at_most| at_most.saturating_sub(start.elapsed()));
            match self.replies.recv_timeout(TICK.min(left)) {
                Ok(Ok(reply)) => return Ok(reply),
                Ok(Err(FrameError::Ended | FrameError::Io(_))) => return Err(self.ended(true)),
                Ok(Err(error)) => return Err(self.garbled(error.to_string())),
                Err(RecvTimeoutError::Disconnected) => return Err(self.ended(false)),
                Err(RecvTimeoutError::Timeout) => {}
            }
            tick()?;
            // A process that it started may keep its output open. What it said itself was read by the second tick.
            if ended {
                return Err(self.ended(false));
            }
            ended = self.group.has_ended();
            if let Some(after) = at_most.filter(|at_most| start.elapsed() >= *at_most) {
                self.group.end();
                let (program, stderr) = self.last_words();
                return Err(WorkerFault::Hung { program, after, stderr });
            }
        }
    }

    /// What became of a worker whose output ended.
    fn ended(&mut self, inside_frame: bool) -> WorkerFault {
        let by_itself = self.group.wait(FAREWELL);
        let exit = self.group.end();
        if !by_itself {
            return self.garbled("it closed its output and went on".to_owned());
        }
        if inside_frame && exit == Exit::Code(0) {
            return self.garbled("its output ended inside a frame".to_owned());
        }
        let (program, stderr) = self.last_words();
        WorkerFault::Died { program, exit, stderr }
    }

    fn garbled(&mut self, problem: String) -> WorkerFault {
        self.group.end();
        let (program, stderr) = self.last_words();
        WorkerFault::Protocol { program, problem, stderr }
    }

    fn last_words(&self) -> (String, Vec<String>) {
        (self.program.clone(), self.stderr.at_end())
    }
}

fn write_all(mut input: ChildStdin, frames: &Receiver<Vec<u8>>) {
    while let Ok(frame) = frames.recv() {
        if input.write_all(&frame).is_err() {
            return;
        }
    }
}

fn read_all(mut output: ChildStdout, replies: &SyncSender<Result<Reply<'static>, FrameError>>) {
    loop {
        let reply = match Reply::read(&mut output) {
            Ok(Some(reply)) => Ok(reply),
            Ok(None) => return,
            Err(error) => Err(error),
        };
        let last = reply.is_err();
        if replies.send(reply).is_err() || last {
            return;
        }
    }
}
