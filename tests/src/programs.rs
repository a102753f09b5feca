//! Building, finding and running the programs.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

use crate::skipped;

/// The repository.
pub fn repository() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// The folder that cargo builds in: that of this test program.
fn target() -> PathBuf {
    let this = std::env::current_exe().expect("the system tells where a program is");
    let target =
        this.ancestors().find(|folder| folder.join("release").is_dir() || folder.join("debug").is_dir());
    target.map_or_else(|| repository().join("target"), Path::to_owned)
}

/// The program `elo`, as users build it: in release, without libmujoco. Built when it is first asked for.
///
/// # Panics
/// When it does not build.
pub fn elo() -> &'static Path {
    static ELO: OnceLock<PathBuf> = OnceLock::new();
    ELO.get_or_init(|| build("elo", &[]))
}

/// The worker `elo-mujoco`, which lies beside [`elo`]; or `None` after a note that `test` is skipped, where libmujoco
/// was not set up.
///
/// # Panics
/// When libmujoco is there and the worker does not build.
pub fn mujoco(test: &str) -> Option<&'static Path> {
    static WORKER: OnceLock<PathBuf> = OnceLock::new();
    let library = repository().join("target/mujoco/lib/libmujoco.so");
    if !library.exists() {
        skipped(test, &format!("mujoco: {} is missing; run tests/set-up", library.display()));
        return None;
    }
    elo();
    Some(WORKER.get_or_init(|| build("elo-mujoco", &["--features", "mujoco"])))
}

fn build(name: &str, features: &[&str]) -> PathBuf {
    let target = target();
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(repository()).args([
        "build",
        "--release",
        "--quiet",
        "--package",
        "elo-cli",
        "--bin",
        name,
    ]);
    command.args(features).arg("--target-dir").arg(&target);
    let output = command.output().unwrap_or_else(|error| panic!("{}: {error}", env!("CARGO")));
    assert!(output.status.success(), "{name} does not build:\n{}", String::from_utf8_lossy(&output.stderr));
    target.join("release").join(name)
}

/// How a program ended and what it said.
#[derive(Debug)]
pub struct Ran {
    /// Its exit code; `None` when a signal ended it.
    pub code: Option<i32>,
    /// What it wrote to stdout.
    pub stdout: String,
    /// What it wrote to stderr.
    pub stderr: String,
}

impl From<Output> for Ran {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

impl Ran {
    /// Asks for exit code 0.
    ///
    /// # Panics
    /// With all that the program said.
    pub fn expect_success(self) -> Self {
        assert_eq!(self.code, Some(0), "{self}");
        self
    }

    /// Asks for this exit code and no panic.
    ///
    /// # Panics
    /// With all that the program said.
    pub fn expect_code(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{self}");
        assert!(!self.stderr.contains("panicked"), "{self}");
        self
    }
}

impl std::fmt::Display for Ran {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "exit code {:?}\n--- stdout\n{}\n--- stderr\n{}", self.code, self.stdout, self.stderr)
    }
}

/// Runs a command to its end, with an empty stdin.
///
/// # Panics
/// When it cannot be started.
pub fn run(command: &mut Command) -> Ran {
    let output = command.stdin(Stdio::null()).output();
    output.unwrap_or_else(|error| panic!("{command:?}: {error}")).into()
}

/// `elo` with these arguments.
pub fn elo_with<S: AsRef<std::ffi::OsStr>>(arguments: &[S]) -> Command {
    let mut command = Command::new(elo());
    command.args(arguments);
    command
}

/// `elo discover CONFIG --out OUT`, ready for more arguments.
pub fn discover(program: &Path, config: &Path, out: &Path) -> Command {
    let mut command = Command::new(program);
    command.arg("discover").arg(config).arg("--out").arg(out);
    command
}

/// Writes `text` to a file `name` in `folder`; gives its path.
///
/// # Panics
/// When it cannot be written.
pub fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    let mut file = std::fs::File::create(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    file.write_all(text.as_bytes()).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    path
}
