//! The worker's side: its whole main loop.

use std::borrow::Cow;
use std::io::{self, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::spawn;
use std::time::{Duration, Instant};

use super::fault::JobError;
use super::frames::FrameError;
use super::messages::{PROTOCOL, Reply, Request};
use crate::policy::{Monitor, Stopped};

/// Who a worker says that it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity<'a> {
    /// Its program and version, which must be its parent's.
    pub fingerprint: &'a str,
    /// The engine that it runs, with its version, e.g. `mujoco 3.17.0`.
    pub engine: &'a str,
}

/// What a worker does with a job: from its JSON and the results that it builds on, to its result.
pub type Handler<'a> = dyn FnMut(&[u8], &[Vec<u8>], &mut dyn Monitor) -> Result<Vec<u8>, JobError> + 'a;

/// Between two reports of progress. More would only cost time.
const PROGRESS: Duration = Duration::from_millis(50);

/// The greatest message of a failed job that is passed on.
const MESSAGE: usize = 64 << 10;

/// Answers jobs until the parent says stop or closes `input`.
///
/// A parent that is gone in the middle of a job ends the process at once, for nobody wants its result; no destructors
/// run then. A panic of `handler` is passed on, ends the process too, and the parent reports it. `output` must be
/// written by nobody else; see [`own_pipes`].
///
/// # Errors
/// A broken pipe, or a parent that is of another version or does not keep to the protocol.
pub fn serve(
    input: impl Read + Send + 'static,
    output: impl Write + Send,
    identity: &Identity<'_>,
    handler: &mut Handler<'_>,
) -> io::Result<()> {
    serve_until(input, output, identity, handler, end_at_once)
}

/// Ends the process without waiting for what other threads do.
fn end_at_once() {
    #[cfg(unix)]
    // SAFETY: ends the process; nothing runs afterwards.
    unsafe {
        libc::_exit(1)
    };
    #[cfg(not(unix))]
    std::process::exit(1);
}

/// [`serve`], with what happens when the parent is gone in the middle of a job.
fn serve_until(
    mut input: impl Read + Send + 'static,
    mut output: impl Write + Send,
    identity: &Identity<'_>,
    handler: &mut Handler<'_>,
    orphaned: impl FnOnce() + Send + 'static,
) -> io::Result<()> {
    if !greet(&mut input, &mut output, identity)? {
        return Ok(());
    }
    let (jobs, next_job) = sync_channel(1);
    let unanswered = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&unanswered);
    spawn(move || {
        forward(input, &jobs, &counted);
        if counted.load(Ordering::SeqCst) > 0 {
            orphaned();
        }
    });
    while let Ok(next) = next_job.recv() {
        let job = next.map_err(invalid_data)?;
        let answer = work(&job, &mut output, handler)?;
        // Not counted any more before it is sent: the parent may close the pipe as soon as it has the answer.
        unanswered.fetch_sub(1, Ordering::SeqCst);
        send(&mut output, &answer)?;
    }
    Ok(())
}

/// Exchanges greetings; false when the parent is gone already.
fn greet(input: &mut impl Read, output: &mut impl Write, identity: &Identity<'_>) -> io::Result<bool> {
    let parent = match Request::read(input).map_err(invalid_data)? {
        None => return Ok(false),
        Some(Request::Hello { protocol, fingerprint }) => (protocol, fingerprint),
        Some(_) => return Err(invalid_data("the parent did not greet first")),
    };
    let &Identity { fingerprint, engine } = identity;
    let hello = Reply::Hello { protocol: PROTOCOL, fingerprint: fingerprint.into(), engine: engine.into() };
    send(output, &hello.encode().map_err(invalid_data)?)?;
    if parent == (PROTOCOL, fingerprint.into()) {
        return Ok(true);
    }
    let (protocol, theirs) = parent;
    Err(invalid_data(format!(
        "the parent is `{theirs}` with protocol {protocol}, this worker `{fingerprint}` with protocol {PROTOCOL}"
    )))
}

struct Job {
    id: u64,
    job: Vec<u8>,
    inputs: Vec<Vec<u8>>,
    threads: usize,
    checkpoint: Option<Vec<u8>>,
}

/// Passes jobs on, and counts them, until the parent has no more of them or is not understood.
fn forward(mut input: impl Read, jobs: &SyncSender<Result<Job, String>>, unanswered: &AtomicUsize) {
    loop {
        let next = match Request::read(&mut input) {
            Ok(None | Some(Request::Stop)) => return,
            Ok(Some(Request::Job { id, job, inputs, threads, checkpoint })) => Ok(Job {
                id,
                job: job.into_owned(),
                inputs: inputs.into_owned(),
                threads: threads as usize,
                checkpoint: checkpoint.map(Cow::into_owned),
            }),
            Ok(Some(Request::Hello { .. })) => Err("the parent greeted twice".to_owned()),
            Err(error) => Err(error.to_string()),
        };
        let last = next.is_err();
        unanswered.fetch_add(usize::from(!last), Ordering::SeqCst);
        if jobs.send(next).is_err() || last {
            return;
        }
    }
}

/// Does a job; the frame that answers it.
fn work(job: &Job, output: &mut (dyn Write + Send), handler: &mut Handler<'_>) -> io::Result<Vec<u8>> {
    let mut link = Link { output, job, reported: None, problem: None };
    let result = handler(&job.job, &job.inputs, &mut link);
    let id = job.id;
    let result = match (link.problem, result) {
        (Some(FrameError::Io(error)), _) => return Err(error),
        (Some(error), _) => Err(JobError::failed(format!("its checkpoint is {error}"))),
        (None, result) => result,
    };
    let done = result.and_then(|bytes| {
        let done = Reply::Done { id, bytes: bytes.into() };
        done.encode().map_err(|error| JobError::failed(format!("its result is {error}")))
    });
    done.or_else(|mut error| {
        error.message.truncate(error.message.floor_char_boundary(MESSAGE));
        Reply::Failed { id, error }.encode()
    })
    .map_err(invalid_data)
}

fn send(output: &mut (impl Write + ?Sized), frame: &[u8]) -> io::Result<()> {
    output.write_all(frame)?;
    output.flush()
}

fn invalid_data(problem: impl ToString) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, problem.to_string())
}

/// The monitor of a job: passes everything on to the parent.
struct Link<'a> {
    output: &'a mut (dyn Write + Send),
    job: &'a Job,
    /// When progress was last reported.
    reported: Option<Instant>,
    /// Why the job was told to stop.
    problem: Option<FrameError>,
}

impl Link<'_> {
    fn tell(&mut self, reply: &Reply<'_>) -> Result<(), Stopped> {
        let told = reply.encode().and_then(|frame| Ok(send(self.output, &frame)?));
        told.map_err(|error| {
            self.problem = Some(error);
            Stopped
        })
    }
}

impl Monitor for Link<'_> {
    fn resume(&mut self) -> Option<Vec<u8>> {
        self.job.checkpoint.clone()
    }

    fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped> {
        self.tell(&Reply::Checkpoint { id: self.job.id, bytes: bytes.into() })
    }

    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped> {
        if done < total && self.reported.is_some_and(|reported| reported.elapsed() < PROGRESS) {
            return Ok(());
        }
        self.reported = Some(Instant::now());
        self.tell(&Reply::Progress { id: self.job.id, done, total })
    }

    fn threads(&self) -> usize {
        self.job.threads
    }
}

/// Takes standard input and output away from the rest of the process and gives them to [`serve`]: whatever an engine
/// prints goes to standard error from then on, and it reads an empty standard input.
///
/// # Errors
/// A process without these streams.
#[cfg(unix)]
pub fn own_pipes() -> io::Result<(std::fs::File, std::fs::File)> {
    use std::os::fd::{AsFd, AsRawFd};
    io::stdout().flush()?;
    let input = io::stdin().as_fd().try_clone_to_owned()?;
    let output = io::stdout().as_fd().try_clone_to_owned()?;
    let nothing = std::fs::File::open("/dev/null")?;
    for (from, to) in [(nothing.as_raw_fd(), libc::STDIN_FILENO), (libc::STDERR_FILENO, libc::STDOUT_FILENO)]
    {
        // SAFETY: both are open, and what was open as `to` lives on as a copy.
        if unsafe { libc::dup2(from, to) } < 0 {
            return Err(io::Error::last_os_error());
        }
    }
    Ok((input.into(), output.into()))
}

/// Standard input and output. An engine must not print there.
///
/// # Errors
/// None on this system.
#[cfg(not(unix))]
pub fn own_pipes() -> io::Result<(io::Stdin, io::Stdout)> {
    Ok((io::stdin(), io::stdout()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::sync::mpsc::channel;

    const US: Identity<'static> = Identity { fingerprint: "elo 1", engine: "toy 2" };

    fn hello(fingerprint: &'static str) -> Request<'static> {
        Request::Hello { protocol: PROTOCOL, fingerprint: fingerprint.into() }
    }

    fn job(id: u64, job: &'static str, checkpoint: Option<&'static str>) -> Request<'static> {
        Request::Job {
            id,
            job: job.as_bytes().into(),
            inputs: vec![b"in".to_vec(), b"put".to_vec()].into(),
            threads: 2,
            checkpoint: checkpoint.map(|text| text.as_bytes().into()),
        }
    }

    /// Everything that a worker answers to these requests, and how it ended. Its job is to tell what it was given.
    fn talk(requests: &[Request<'static>]) -> (Vec<Reply<'static>>, io::Result<()>) {
        let (input, mut parent) = io::pipe().unwrap();
        let mut output = Vec::new();
        let bytes: Vec<u8> = requests.iter().flat_map(|request| request.encode().unwrap()).collect();
        let feeder = spawn(move || parent.write_all(&bytes));
        let mut handler = |job: &[u8], inputs: &[Vec<u8>], monitor: &mut dyn Monitor| {
            let resumed = monitor.resume().unwrap_or_default();
            match job {
                b"fail" => return Err(JobError::invalid("no such job")),
                b"long message" => return Err(JobError::failed("ψ".repeat(MESSAGE))),
                b"great result" => return Ok(vec![0; super::super::MAX_FRAME]),
                b"great checkpoint" => monitor.checkpoint(&vec![0; super::super::MAX_FRAME])?,
                _ => {}
            }
            (0..1000).try_for_each(|done| monitor.progress(done, 1000))?;
            monitor.checkpoint(b"half")?;
            monitor.progress(1000, 1000)?;
            Ok([job, &inputs.concat(), &resumed].concat())
        };
        let outcome = serve_until(input, &mut output, &US, &mut handler, || {});
        // A worker that refused its parent may have closed the pipe before.
        let _ = feeder.join().unwrap();
        let mut output = output.as_slice();
        (std::iter::from_fn(|| Reply::read(&mut output).unwrap()).collect(), outcome)
    }

    fn greeting() -> Reply<'static> {
        Reply::Hello { protocol: PROTOCOL, fingerprint: "elo 1".into(), engine: "toy 2".into() }
    }

    #[test]
    fn jobs_are_answered_one_after_the_other() {
        let (replies, outcome) =
            talk(&[hello("elo 1"), job(7, "a", None), job(8, "b", Some("!")), Request::Stop]);
        outcome.unwrap();
        assert_eq!(replies[0], greeting());
        let done = |id, text: &'static str| Reply::Done { id, bytes: text.as_bytes().into() };
        let results: Vec<_> = replies.iter().filter(|reply| matches!(reply, Reply::Done { .. })).collect();
        assert_eq!(results, [&done(7, "ainput"), &done(8, "binput!")]);
        let first: Vec<_> = replies[1..].iter().take_while(|reply| **reply != done(7, "ainput")).collect();
        let progress = |done| Reply::Progress { id: 7, done, total: 1000 };
        assert_eq!(first[0], &progress(0));
        let half = Reply::Checkpoint { id: 7, bytes: b"half".as_slice().into() };
        assert_eq!(first[first.len() - 2..], [&half, &progress(1000)]);
    }

    #[test]
    fn progress_is_thinned_out() {
        let (replies, _) = talk(&[hello("elo 1"), job(1, "a", None)]);
        assert!(replies.len() < 200, "{} replies to a thousand reports", replies.len());
    }

    #[test]
    fn failures_are_told_and_the_next_job_is_done() {
        let jobs = ["fail", "long message", "great result", "great checkpoint", "fine"];
        for first in &jobs[..4] {
            let (replies, outcome) = talk(&[hello("elo 1"), job(1, first, None), job(2, "fine", None)]);
            outcome.unwrap();
            let Reply::Failed { id: 1, error } = &replies[1] else { panic!("{first}: {:?}", replies[1]) };
            let expected = match *first {
                "fail" => "no such job",
                "long message" => "ψψψ",
                "great result" => "its result is a frame of 67108877 bytes",
                _ => "its checkpoint is a frame of 67108877 bytes",
            };
            assert!(
                error.message.starts_with(expected) && error.message.len() <= MESSAGE,
                "{first}: {error:.100}"
            );
            assert!(matches!(replies.last().unwrap(), Reply::Done { id: 2, .. }), "{first}");
        }
    }

    #[test]
    fn a_parent_of_another_version_is_answered_and_left() {
        let (replies, outcome) = talk(&[hello("elo 2"), job(1, "a", None)]);
        assert_eq!(replies, [greeting()]);
        let message = outcome.unwrap_err().to_string();
        assert!(message.contains("`elo 2`") && message.contains("`elo 1`"), "{message}");
    }

    #[test]
    fn a_parent_that_makes_no_sense_is_left() {
        for requests in [vec![Request::Stop], vec![hello("elo 1"), hello("elo 1")]] {
            assert!(talk(&requests).1.is_err(), "{requests:?}");
        }
        assert!(talk(&[]).1.is_ok());
    }

    #[test]
    fn a_parent_that_is_gone_is_noticed_in_the_middle_of_a_job() {
        let (input, mut parent) = io::pipe().unwrap();
        let (orphaned, noticed) = channel();
        parent.write_all(&hello("elo 1").encode().unwrap()).unwrap();
        parent.write_all(&job(1, "a", None).encode().unwrap()).unwrap();
        let mut parent = Some(parent);
        let mut handler = |_: &[u8], _: &[Vec<u8>], _: &mut dyn Monitor| {
            drop(parent.take());
            noticed.recv_timeout(Duration::from_secs(20)).map_err(|_| JobError::failed("not noticed"))?;
            Ok(b"noticed".to_vec())
        };
        let mut output = Vec::new();
        serve_until(input, &mut output, &US, &mut handler, move || orphaned.send(()).unwrap()).unwrap();
        let mut output = output.as_slice();
        assert_eq!(Reply::read(&mut output).unwrap(), Some(greeting()));
        let done = Reply::Done { id: 1, bytes: b"noticed".as_slice().into() };
        assert_eq!(Reply::read(&mut output).unwrap(), Some(done));
    }
}
