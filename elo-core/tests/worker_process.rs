//! Workers that are real processes and misbehave in every way that an engine can. The workers are this test program
//! itself, told by a variable what to do.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::fd::AsRawFd;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use elo_core::hosted::WorkerProgram;
use elo_core::policy::{Monitor, Stopped, Unwatched};
use elo_core::run_dir::{RunDir, RunDirError};
use elo_core::worker::{
    Exit, Identity, JobError, JobErrorKind, Limits, PROTOCOL, Reply, Request, WorkerFault, WorkerProcess,
    own_pipes, serve,
};
use elo_core::workforce::{Hosts, Job, TRIES, Undone, Workforce};

const ROLE: &str = "ELO_TEST_ROLE";
const DIR: &str = "ELO_TEST_DIR";
const US: Identity<'static> = Identity { fingerprint: "elo test", engine: "toy 1" };

/// This program in a role. The test harness prints to standard output, so the pipe to the parent is handed on as 3.
fn program(role: &str) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", "exec 3>&1 1>&2; exec \"$0\" --exact child_role --nocapture"]);
    command.arg(std::env::current_exe().unwrap()).env(ROLE, role);
    command
}

fn start(role: &str) -> WorkerProcess {
    start_within(role, Limits::default())
}

fn start_within(role: &str, limits: Limits) -> WorkerProcess {
    WorkerProcess::spawn(program(role), US.fingerprint, limits).unwrap()
}

fn silence(millis: u64) -> Limits {
    Limits { silence: Some(Duration::from_millis(millis)), ..Limits::default() }
}

fn pipe_to_parent() -> File {
    OpenOptions::new().write(true).open("/dev/fd/3").unwrap()
}

/// Does nothing when it is run as a test; as a child it plays the role that it is given.
#[test]
fn child_role() {
    let Ok(role) = std::env::var(ROLE) else { return };
    match role.as_str() {
        "worker" => serve(std::io::stdin(), pipe_to_parent(), &US, &mut work).unwrap(),
        "chatty" => {
            // SAFETY: both are open.
            assert_eq!(unsafe { libc::dup2(pipe_to_parent().as_raw_fd(), 1) }, 1);
            let (input, output) = own_pipes().unwrap();
            serve(input, output, &US, &mut work).unwrap();
        }
        "silent" => sleep(Duration::from_secs(600)),
        "parent" => {
            let mut worker = start("worker");
            let _ = worker.run(b"hold", &[], &mut Unwatched);
        }
        raw => answer_raw(raw),
    }
}

/// Greets, waits for a job, and says something that makes no sense.
fn answer_raw(role: &str) {
    let mut output = pipe_to_parent();
    let mut input = std::io::stdin();
    let mut say = |reply: Reply<'_>| output.write_all(&reply.encode().unwrap()).unwrap();
    let protocol = if role == "protocol" { PROTOCOL + 1 } else { PROTOCOL };
    let hello = || Reply::Hello { protocol, fingerprint: US.fingerprint.into(), engine: US.engine.into() };
    Request::read(&mut input).unwrap();
    match role {
        "not a greeting" => say(Reply::Progress { id: 0, done: 0, total: 0 }),
        _ => say(hello()),
    }
    if role == "deaf" {
        sleep(Duration::from_secs(600));
    }
    Request::read(&mut input).unwrap();
    match role {
        "greets twice" => say(hello()),
        "wrong id" => say(Reply::Done { id: 77, bytes: b"late".as_slice().into() }),
        "text" => output.write_all(b"Loading scene ... done\n").unwrap(),
        "4 GB" => output.write_all(&[0xff, 0xff, 0xff, 0xff, 20, 0, 0]).unwrap(),
        "empty" => output.write_all(&[0, 0, 0, 0]).unwrap(),
        "unknown kind" => output.write_all(&[1, 0, 0, 0, 99]).unwrap(),
        "short fields" => output.write_all(&[5, 0, 0, 0, 20, 1, 2, 3, 4]).unwrap(),
        "short frame" => {
            output.write_all(&[100, 0, 0, 0, 20, 1, 2, 3, 4]).unwrap();
            std::process::exit(0);
        }
        "short frame and death" => {
            output.write_all(&[100, 0, 0, 0, 20, 1, 2, 3, 4]).unwrap();
            std::process::abort();
        }
        "closed output" => {
            // SAFETY: nothing uses it any more.
            unsafe { libc::close(3) };
            drop(output);
        }
        _ => {}
    }
    sleep(Duration::from_secs(600));
}

/// What the workers that are in order do.
fn work(job: &[u8], inputs: &[Vec<u8>], monitor: &mut dyn Monitor) -> Result<Vec<u8>, JobError> {
    match job {
        b"count" => {
            let from = monitor.resume().map_or(0, |bytes| u64::from_le_bytes(bytes.try_into().unwrap()));
            for i in from..10 {
                monitor.checkpoint(&i.to_le_bytes())?;
                monitor.progress(i + 1, 10)?;
            }
            Ok(format!("{from} to 10 with {}", String::from_utf8_lossy(&inputs.concat())).into_bytes())
        }
        b"print" => {
            println!("WARNING: an engine that prints");
            let mut line = String::new();
            let read = std::io::stdin().read_line(&mut line).unwrap();
            Ok(format!("read {read} bytes").into_bytes())
        }
        b"big" => Ok(inputs.concat()),
        b"fail" => Err(JobError::failed("Traceback: ZeroDivisionError")),
        b"exit 1" => {
            eprintln!("ERROR: mj_stackAlloc: stack overflow");
            std::process::exit(1)
        }
        b"exit 0" => std::process::exit(0),
        b"panic" => panic!("at the disco"),
        b"abort" => std::process::abort(),
        b"SIGKILL" => {
            // SAFETY: ends this process.
            unsafe { libc::raise(libc::SIGKILL) };
            Ok(vec![])
        }
        b"allocate" => {
            // Hidden from the optimiser, which may leave out memory that nobody looks at.
            let much = std::hint::black_box(Vec::<u8>::with_capacity(8 << 30));
            Ok(much.capacity().to_le_bytes().to_vec())
        }
        b"pause" => {
            sleep(Duration::from_millis(300));
            Ok(vec![])
        }
        b"child keeps the pipe" => {
            Command::new("sleep").arg("600").stdout(pipe_to_parent()).spawn().unwrap();
            std::process::exit(3)
        }
        b"hold" => {
            // The test looks whether it is held, and so may hold it for a moment itself.
            let dir =
                std::iter::repeat_with(|| RunDir::open(std::env::var(DIR).unwrap())).find_map(Result::ok);
            sleep(Duration::from_secs(600));
            drop(dir);
            Ok(vec![])
        }
        _ => loop {
            sleep(Duration::from_secs(1));
        },
    }
}

/// Notes what it is told, resumes with what it is given, and stops after so many words.
#[derive(Default)]
struct Notes {
    resume: Option<Vec<u8>>,
    checkpoints: Vec<Vec<u8>>,
    progress: Vec<(u64, u64)>,
    stop_after: Option<usize>,
}

impl Notes {
    fn go_on(&self) -> Result<(), Stopped> {
        let words = self.checkpoints.len() + self.progress.len();
        if self.stop_after.is_some_and(|limit| words >= limit) { Err(Stopped) } else { Ok(()) }
    }
}

impl Monitor for Notes {
    fn resume(&mut self) -> Option<Vec<u8>> {
        self.resume.take()
    }
    fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped> {
        self.checkpoints.push(bytes.to_vec());
        self.go_on()
    }
    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped> {
        self.progress.push((done, total));
        self.go_on()
    }
}

fn is_gone(pid: u32) -> bool {
    // SAFETY: signal 0 only asks whether there is such a process.
    unsafe { libc::kill(pid as libc::pid_t, 0) != 0 }
}

#[test]
fn jobs_are_done_one_after_the_other_with_progress_and_checkpoints() {
    let mut worker = start("worker");
    assert_eq!(worker.engine(), "toy 1");
    let mut notes = Notes::default();
    let inputs = [b"in".to_vec(), b"put".to_vec()];
    assert_eq!(worker.run(b"count", &inputs, &mut notes).unwrap(), b"0 to 10 with input");
    let checkpoints: Vec<Vec<u8>> = (0..10_u64).map(|i| i.to_le_bytes().to_vec()).collect();
    assert_eq!(notes.checkpoints, checkpoints);
    assert_eq!(notes.progress.last(), Some(&(10, 10)));

    let mut resumed = Notes { resume: Some(checkpoints[7].clone()), ..Notes::default() };
    assert_eq!(worker.run(b"count", &[], &mut resumed).unwrap(), b"7 to 10 with ");
    assert_eq!(resumed.checkpoints, checkpoints[7..]);

    let bytes: Vec<u8> = (0..20_u32 << 20).map(|i| (i % 251) as u8).collect();
    assert_eq!(worker.run(b"big", &[bytes.clone(), bytes.clone()], &mut Unwatched).unwrap(), bytes.repeat(2));
    worker.stop();
}

#[test]
fn a_failed_job_and_one_that_is_too_large_leave_the_worker_in_order() {
    let mut worker = start("worker");
    match worker.run(b"fail", &[], &mut Unwatched) {
        Err(WorkerFault::Failed(error)) => {
            assert_eq!(error.kind, JobErrorKind::Failed);
            assert_eq!(error.message, "Traceback: ZeroDivisionError");
        }
        other => panic!("{other:?}"),
    }
    let fault = worker.run(b"big", &[vec![0; 64 << 20]], &mut Unwatched).unwrap_err();
    assert!(matches!(fault, WorkerFault::TooLarge { bytes } if bytes > 64 << 20), "{fault}");
    assert!(fault.leaves_worker_usable());
    assert_eq!(worker.run(b"count", &[], &mut Unwatched).unwrap(), b"0 to 10 with ");
}

#[test]
fn a_worker_that_dies_is_told_how_with_its_last_words() {
    let deaths = [
        ("exit 1", Exit::Code(1), "ERROR: mj_stackAlloc: stack overflow"),
        ("exit 0", Exit::Code(0), ""),
        ("panic", Exit::Code(101), "at the disco"),
        ("abort", Exit::Signal(libc::SIGABRT), ""),
        ("SIGKILL", Exit::Signal(libc::SIGKILL), ""),
        ("child keeps the pipe", Exit::Code(3), ""),
    ];
    for (job, expected, said) in deaths {
        let mut worker = start("worker");
        worker.run(b"count", &[], &mut Unwatched).unwrap();
        let fault = worker.run(job.as_bytes(), &[], &mut Unwatched).unwrap_err();
        assert!(!fault.leaves_worker_usable());
        match &fault {
            WorkerFault::Died { exit, stderr, .. } => {
                assert_eq!(*exit, expected, "{job}");
                assert!(stderr.iter().any(|line| line.contains(said)), "{job}: {stderr:?}");
            }
            other => panic!("{job}: {other}"),
        }
        assert!(is_gone(worker.id()));
        assert!(
            matches!(worker.run(b"count", &[], &mut Unwatched), Err(WorkerFault::Died { exit, .. }) if exit == expected)
        );
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_worker_that_wants_too_much_memory_dies_alone() {
    let limits = Limits { memory_bytes: Some(4 << 30), ..Limits::default() };
    let fault = start_within("worker", limits).run(b"allocate", &[], &mut Unwatched).unwrap_err();
    assert!(matches!(fault, WorkerFault::Died { exit: Exit::Signal(libc::SIGABRT), .. }), "{fault}");
}

#[test]
fn a_worker_that_hangs_is_killed_after_the_silence_it_is_granted() {
    for (role, job) in [("worker", "hang"), ("deaf", "hang")] {
        let mut worker = start_within(role, silence(400));
        let start = Instant::now();
        // More than the pipe holds, so that a worker that does not read would block its parent.
        let fault = worker.run(job.as_bytes(), &[vec![0; 4 << 20]], &mut Unwatched).unwrap_err();
        assert!(
            matches!(fault, WorkerFault::Hung { after, .. } if after == Duration::from_millis(400)),
            "{fault}"
        );
        assert!(start.elapsed() >= Duration::from_millis(400));
        assert!(is_gone(worker.id()), "{role}");
    }
}

#[test]
fn a_worker_that_is_only_slow_is_left_alone() {
    let mut worker = start_within("worker", silence(20_000));
    let mut notes = Notes::default();
    worker.run(b"pause", &[], &mut notes).unwrap();
    assert!(
        !notes.progress.is_empty() && notes.progress.iter().all(|told| *told == (0, 0)),
        "{:?}",
        notes.progress
    );
}

#[test]
fn a_monitor_can_stop_a_job_that_reports_and_one_that_does_not() {
    for (job, stop_after) in [("count", 3), ("hang", 1)] {
        let mut worker = start("worker");
        let mut notes = Notes { stop_after: Some(stop_after), ..Notes::default() };
        let fault = worker.run(job.as_bytes(), &[], &mut notes).unwrap_err();
        assert!(matches!(fault, WorkerFault::Stopped(Stopped)), "{job}: {fault}");
        assert!(is_gone(worker.id()), "{job}");
    }
}

#[test]
fn a_worker_that_makes_no_sense_is_killed() {
    let nonsense = [
        ("greets twice", "greeted twice"),
        ("wrong id", "answered job 77 while it had job 0"),
        ("text", "a frame of 1684107084 bytes"),
        ("4 GB", "a frame of 4294967295 bytes"),
        ("empty", "a frame of 0 bytes"),
        ("unknown kind", "unknown kind 99"),
        ("short fields", "kind 20 is too short"),
        ("short frame", "ended inside a frame"),
        ("closed output", "closed its output and went on"),
    ];
    for (role, expected) in nonsense {
        let mut worker = start(role);
        match worker.run(b"any", &[], &mut Unwatched).unwrap_err() {
            WorkerFault::Protocol { problem, .. } => assert!(problem.contains(expected), "{role}: {problem}"),
            other => panic!("{role}: {other}"),
        }
        assert!(is_gone(worker.id()), "{role}");
    }
    let fault = start("short frame and death").run(b"any", &[], &mut Unwatched).unwrap_err();
    assert!(matches!(fault, WorkerFault::Died { exit: Exit::Signal(libc::SIGABRT), .. }), "{fault}");
}

#[test]
fn a_worker_of_another_version_is_refused_with_both_named() {
    let fault = WorkerProcess::spawn(program("worker"), "elo next", Limits::default()).err().unwrap();
    assert!(matches!(fault, WorkerFault::Mismatch { what: "fingerprint", .. }), "{fault}");
    let text = fault.to_string();
    assert!(text.contains("`elo test`") && text.contains("`elo next`"), "{text}");
    let fault = WorkerProcess::spawn(program("protocol"), US.fingerprint, Limits::default()).err().unwrap();
    assert!(matches!(fault, WorkerFault::Mismatch { what: "protocol", .. }), "{fault}");
    let fault =
        WorkerProcess::spawn(program("not a greeting"), US.fingerprint, Limits::default()).err().unwrap();
    assert!(matches!(fault, WorkerFault::Protocol { .. }), "{fault}");
}

#[test]
fn a_worker_that_cannot_start_or_does_not_greet_is_told() {
    let limits = Limits { greeting: Duration::from_millis(300), ..Limits::default() };
    let fault = WorkerProcess::spawn(program("silent"), US.fingerprint, limits).err().unwrap();
    assert!(matches!(fault, WorkerFault::NoAnswer { .. }), "{fault}");
    let missing = Command::new("/nonexistent/elo-mujoco");
    let fault = WorkerProcess::spawn(missing, US.fingerprint, limits).err().unwrap();
    assert!(
        matches!(&fault, WorkerFault::Start { program, .. } if program.ends_with("elo-mujoco")),
        "{fault}"
    );
    let mut broken = Command::new("sh");
    broken.args(["-c", "echo 'error while loading shared libraries: libmujoco.so.3.17.0' >&2; exit 127"]);
    let fault = WorkerProcess::spawn(broken, US.fingerprint, Limits::default()).err().unwrap();
    assert!(matches!(fault, WorkerFault::Died { exit: Exit::Code(127), .. }), "{fault}");
    assert!(fault.to_string().contains("libmujoco.so.3.17.0"), "{fault}");
}

#[test]
fn an_engine_that_prints_and_reads_does_not_disturb_the_protocol() {
    let mut worker = start("chatty");
    assert_eq!(worker.run(b"print", &[], &mut Unwatched).unwrap(), b"read 0 bytes");
    match worker.run(b"exit 1", &[], &mut Unwatched).unwrap_err() {
        WorkerFault::Died { stderr, .. } => {
            assert!(stderr.iter().any(|line| line.contains("an engine that prints")), "{stderr:?}");
        }
        other => panic!("{other}"),
    }
}

#[test]
fn a_dropped_worker_is_gone() {
    let worker = start("worker");
    let id = worker.id();
    assert!(!is_gone(id));
    drop(worker);
    assert!(is_gone(id));
}

#[test]
fn a_worker_whose_parent_was_killed_ends_in_the_middle_of_its_job() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("run");
    let mut parent = program("parent").env(DIR, &path).stdin(Stdio::null()).spawn().unwrap();
    let held = |path: &Path| matches!(RunDir::open(path), Err(RunDirError::Held { .. }));
    wait_until("the worker holds the directory", || path.join("run.lock").exists() && held(&path));
    parent.kill().unwrap();
    parent.wait().unwrap();
    wait_until("the worker is gone", || !held(&path));
}

/// Starts this program as a worker, after some starts during which it is killed.
struct Starts {
    killed: usize,
    begun: AtomicUsize,
}

impl Hosts for Starts {
    fn start(&self, asked: &WorkerProgram) -> Result<WorkerProcess, WorkerFault> {
        let command = match asked {
            WorkerProgram::Interpreter(_) => Command::new("/nowhere"),
            _ if self.begun.fetch_add(1, Ordering::Relaxed) < self.killed => {
                let mut command = Command::new("sh");
                command.args(["-c", "kill -KILL $$"]);
                command
            }
            WorkerProgram::Beside(role) => program(role),
        };
        WorkerProcess::spawn(command, US.fingerprint, Limits::default())
    }
}

#[test]
fn workers_are_used_again_until_they_are_lost_and_replaced_so_many_times() {
    let lost_over = |hosts: &Starts, jobs: &[&str]| {
        let (workforce, mut lost) = (Workforce::new(hosts), 0);
        let mut run = |work: &&str| {
            let program = WorkerProgram::Beside("worker");
            let job = Job { program, work: work.as_bytes(), inputs: &[], workers: TRIES };
            workforce.run(job, &mut Unwatched, &mut |_| lost += 1)
        };
        let done: Vec<_> = jobs.iter().map(&mut run).collect();
        (done, lost, hosts.begun.load(Ordering::Relaxed))
    };
    let hosts = Starts { killed: 0, begun: AtomicUsize::new(0) };
    let (done, lost, begun) = lost_over(&hosts, &["count", "fail", "count", "abort", "count"]);
    assert!(matches!(
        done.as_slice(),
        [Ok(_), Err(Undone::Failed(_)), Ok(_), Err(Undone::Lost(WorkerFault::Died { .. })), Ok(_)]
    ));
    assert_eq!((lost, begun), (TRIES, TRIES + 1));

    // Killed as they start they are begun again, and nobody is told.
    let hosts = Starts { killed: TRIES - 1, begun: AtomicUsize::new(0) };
    let (done, lost, begun) = lost_over(&hosts, &["count"]);
    assert!(matches!(done.as_slice(), [Ok(_)]), "{done:?}");
    assert_eq!((lost, begun), (0, TRIES));
    let hosts = Starts { killed: TRIES, begun: AtomicUsize::new(0) };
    assert!(matches!(lost_over(&hosts, &["count"]).0.as_slice(), [Err(Undone::Lost(_))]));

    // What is not there is not tried again.
    let job =
        Job { program: WorkerProgram::Interpreter("nowhere"), work: b"count", inputs: &[], workers: TRIES };
    let done = Workforce::new(&hosts).run(job, &mut Unwatched, &mut |_| panic!("nothing was lost"));
    assert!(matches!(done, Err(Undone::Start(WorkerFault::Start { .. }))));
}

fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < Duration::from_secs(30), "waited in vain until {what}");
        sleep(Duration::from_millis(20));
    }
}
