//! A child process in a process group of its own, so that it can be ended with everything that it started, and what
//! it says on standard error.

use std::collections::VecDeque;
use std::fmt;
use std::io::{self, Read};
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// By itself, with this code.
    Code(i32),
    /// By this signal.
    Signal(i32),
}

impl From<ExitStatus> for Exit {
    fn from(status: ExitStatus) -> Self {
        #[cfg(unix)]
        if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
            return Self::Signal(signal);
        }
        Self::Code(status.code().unwrap_or(-1))
    }
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Code(code) => write!(f, "exit code {code}"),
            Self::Signal(signal) => match signal_name(*signal) {
                Some(name) => write!(f, "signal {signal} ({name})"),
                None => write!(f, "signal {signal}"),
            },
        }
    }
}

#[cfg(unix)]
fn signal_name(signal: i32) -> Option<&'static str> {
    let names = [
        (libc::SIGABRT, "SIGABRT"),
        (libc::SIGBUS, "SIGBUS"),
        (libc::SIGFPE, "SIGFPE"),
        (libc::SIGHUP, "SIGHUP"),
        (libc::SIGILL, "SIGILL"),
        (libc::SIGINT, "SIGINT"),
        (libc::SIGKILL, "SIGKILL, also sent when memory runs out"),
        (libc::SIGPIPE, "SIGPIPE"),
        (libc::SIGSEGV, "SIGSEGV"),
        (libc::SIGTERM, "SIGTERM"),
        (libc::SIGTRAP, "SIGTRAP"),
        (libc::SIGXCPU, "SIGXCPU"),
    ];
    names.into_iter().find_map(|(number, name)| (number == signal).then_some(name))
}

#[cfg(not(unix))]
fn signal_name(_: i32) -> Option<&'static str> {
    None
}

/// The pipes to a child.
pub(super) struct Pipes {
    pub(super) input: ChildStdin,
    pub(super) output: ChildStdout,
    pub(super) error: ChildStderr,
}

/// A child and its process group; ended when dropped.
pub(super) struct Group {
    child: Child,
    ended: Option<Exit>,
}

impl Group {
    /// Starts `command` with pipes and, if given, at most that much address space.
    pub(super) fn spawn(mut command: Command, memory_bytes: Option<u64>) -> io::Result<(Self, Pipes)> {
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        #[cfg(unix)]
        prepare(&mut command, memory_bytes);
        #[cfg(not(unix))]
        let _ = memory_bytes;
        let mut child = command.spawn()?;
        let pipes = Pipes {
            input: child.stdin.take().expect("it was asked for"),
            output: child.stdout.take().expect("it was asked for"),
            error: child.stderr.take().expect("it was asked for"),
        };
        Ok((Self { child, ended: None }, pipes))
    }

    /// The child's process id.
    pub(super) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Whether the child has ended by now. Leaves its id in use, so that [`Self::end`] cannot meet another's.
    #[cfg(unix)]
    pub(super) fn has_ended(&mut self) -> bool {
        if self.ended.is_some() {
            return true;
        }
        // An error means that there is no such child any more: the system reaps them itself for a parent that asked.
        // SAFETY: all-zero is a valid `siginfo_t`, which `waitid` is given to fill in.
        unsafe {
            let mut info: libc::siginfo_t = std::mem::zeroed();
            let options = libc::WEXITED | libc::WNOHANG | libc::WNOWAIT;
            libc::waitid(libc::P_PID, self.child.id(), &mut info, options) != 0 || info.si_signo != 0
        }
    }

    /// Whether the child has ended by now.
    #[cfg(not(unix))]
    pub(super) fn has_ended(&mut self) -> bool {
        self.ended.is_some() || self.child.try_wait().is_ok_and(|status| status.is_some())
    }

    /// Waits at most so long for the child to end; whether it did.
    pub(super) fn wait(&mut self, at_most: Duration) -> bool {
        let start = Instant::now();
        while !self.has_ended() {
            if start.elapsed() >= at_most {
                return false;
            }
            sleep(Duration::from_millis(2));
        }
        true
    }

    /// Kills whatever of the group is left and tells how the child ended: by itself, or killed now.
    pub(super) fn end(&mut self) -> Exit {
        if let Some(exit) = self.ended {
            return exit;
        }
        #[cfg(unix)]
        // SAFETY: sends a signal. The group is the child's own, whose id is in use until it is waited for below.
        unsafe {
            libc::kill(-(self.child.id() as libc::pid_t), libc::SIGKILL);
        }
        #[cfg(not(unix))]
        let _ = self.child.kill();
        let exit = self.child.wait().map_or(Exit::Code(-1), Exit::from);
        self.ended = Some(exit);
        exit
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(unix)]
fn prepare(command: &mut Command, memory_bytes: Option<u64>) {
    use std::os::unix::process::CommandExt;
    command.process_group(0);
    if let Some(bytes) = memory_bytes {
        let limit = libc::rlimit { rlim_cur: bytes, rlim_max: bytes };
        // SAFETY: between fork and exec only `setrlimit` runs, which may be called there and touches no memory of ours.
        unsafe {
            command.pre_exec(move || match libc::setrlimit(libc::RLIMIT_AS, &limit) {
                0 => Ok(()),
                _ => Err(io::Error::last_os_error()),
            });
        }
    }
}

/// The last lines of a stream, gathered by a thread.
pub(super) struct LastLines {
    lines: Arc<Mutex<Lines>>,
    /// Disconnected at the end of the stream.
    end: Receiver<()>,
}

impl LastLines {
    pub(super) fn of(mut stream: impl Read + Send + 'static) -> Self {
        let lines = Arc::new(Mutex::new(Lines::default()));
        let (ending, end) = channel();
        let gathered = Arc::clone(&lines);
        spawn(move || {
            let _ending = ending;
            let mut buffer = [0; 4096];
            loop {
                match stream.read(&mut buffer) {
                    Ok(0) => break,
                    Ok(more) => gathered.lock().unwrap_or_else(PoisonError::into_inner).add(&buffer[..more]),
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(_) => break,
                }
            }
        });
        Self { lines, end }
    }

    /// The lines so far, after waiting at most a second for the end of the stream.
    pub(super) fn at_end(&self) -> Vec<String> {
        let _ = self.end.recv_timeout(Duration::from_secs(1));
        self.lines.lock().unwrap_or_else(PoisonError::into_inner).get()
    }
}

/// The last [`Self::COUNT`] lines, each cut to [`Self::LENGTH`] bytes.
#[derive(Default)]
struct Lines {
    whole: VecDeque<Vec<u8>>,
    last: Vec<u8>,
}

impl Lines {
    const COUNT: usize = 40;
    const LENGTH: usize = 1000;

    fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if byte == b'\n' {
                if self.whole.len() == Self::COUNT {
                    self.whole.pop_front();
                }
                self.whole.push_back(std::mem::take(&mut self.last));
            } else if self.last.len() < Self::LENGTH {
                self.last.push(byte);
            }
        }
    }

    fn get(&self) -> Vec<String> {
        let unfinished = (!self.last.is_empty()).then_some(&self.last);
        let all: Vec<&Vec<u8>> = self.whole.iter().chain(unfinished).collect();
        let last = &all[all.len().saturating_sub(Self::COUNT)..];
        last.iter().map(|line| String::from_utf8_lossy(line).trim_end_matches('\r').to_owned()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_lines_are_kept_and_none_is_long() {
        let text: String = (0..1000).map(|i| format!("line {i}\n")).collect();
        let mut lines = Lines::default();
        lines.add(text.as_bytes());
        lines.add(&[b'x'; 5000]);
        lines.add(b"\r\n");
        lines.add(b"the end");
        let lines = lines.get();
        assert_eq!(lines.len(), 40);
        assert_eq!(lines[0], "line 962");
        assert_eq!(lines[38], "x".repeat(1000));
        assert_eq!(lines[39], "the end");
    }

    #[cfg(unix)]
    #[test]
    fn exits_are_named() {
        assert_eq!(Exit::Code(3).to_string(), "exit code 3");
        assert_eq!(Exit::Signal(libc::SIGSEGV).to_string(), "signal 11 (SIGSEGV)");
        assert_eq!(Exit::Signal(60).to_string(), "signal 60");
    }

    #[cfg(unix)]
    #[test]
    fn a_group_ends_with_everything_that_it_started() {
        let mut command = Command::new("sh");
        command.args(["-c", "sleep 600 & echo $!; sleep 600"]);
        let (mut group, pipes) = Group::spawn(command, None).expect("there is a shell");
        let mut output = pipes.output;
        let mut first = [0; 64];
        let length = output.read(&mut first).expect("the id of the first sleep");
        assert!(length > 1 && !group.has_ended());
        assert_eq!(group.end(), Exit::Signal(libc::SIGKILL));
        // The first sleep had the pipe too: it ends only when that is killed as well.
        let mut rest = Vec::new();
        assert_eq!(output.read_to_end(&mut rest).expect("the pipe closes"), 0);
    }
}
