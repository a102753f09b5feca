//! A small C library that is put before libc in a program under test: it ends or stops the process at a chosen system
//! call, or makes the calendar clock jump.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Compiled when it is first asked for, by the C compiler that also links Rust programs.
///
/// # Panics
/// When it does not compile.
pub fn library() -> &'static Path {
    static LIBRARY: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = LIBRARY.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("preload.so");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/src/preload.c");
        let mut command = Command::new("cc");
        command.args(["-shared", "-fPIC", "-O1", "-Wall", "-o"]).arg(&path).arg(source);
        let output = command.output().expect("cc runs, for it also links Rust programs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        (folder, path)
    });
    path
}

/// Has `command` end by SIGKILL right before its `call`-th fsync or rename, counted from 1 over all threads.
pub fn die_at(command: &mut Command, call: u64) {
    command.env("LD_PRELOAD", library()).env("ELO_TEST_DIE_AT", call.to_string());
}

/// Has `command` end by SIGKILL right before its `call`-th rename to a path that contains `into`, counted from 1 over all threads.
pub fn die_at_rename_into(command: &mut Command, into: &str, call: u64) {
    die_at(command, call);
    command.env("ELO_TEST_DIE_INTO", into);
}

/// Has `command` stop itself (SIGSTOP) right before its `call`-th fsync or rename; [`wait_until_stopped`] waits for that.
pub fn stop_at(command: &mut Command, call: u64) {
    command.env("LD_PRELOAD", library()).env("ELO_TEST_STOP_AT", call.to_string());
}

/// Has the calendar clock of `command` jump a day forward or back at every look.
pub fn jumping_clock(command: &mut Command) {
    command.env("LD_PRELOAD", library()).env("ELO_TEST_CLOCK", "jump");
}

/// Waits until a child of this process has stopped itself.
///
/// # Panics
/// When it ended instead.
#[cfg(unix)]
pub fn wait_until_stopped(child: &std::process::Child) {
    let (pid, mut status) = (child.id().cast_signed(), 0);
    // SAFETY: `status` is a place for the answer, and the child is not waited for elsewhere meanwhile.
    let waited = unsafe { libc::waitpid(pid, &raw mut status, libc::WUNTRACED) };
    assert!(
        waited == pid && libc::WIFSTOPPED(status),
        "the program ended before it stopped: status {status}"
    );
}

/// Sends a signal to a child of this process.
///
/// # Panics
/// When the system refuses.
#[cfg(unix)]
pub fn send(child: &std::process::Child, signal: i32) {
    // SAFETY: kill has no memory to mistake; the child has not been waited for, so its number is still its own.
    assert_eq!(unsafe { libc::kill(child.id().cast_signed(), signal) }, 0, "signal {signal}");
}
