//! Run directories and other processes: who holds one, what is left when the holder is killed, and a disk that is
//! really full. The other processes are this test program itself, told by a variable what to do.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use elo_core::key::{Key, Stage};
use elo_core::run_dir::{RunDir, RunDirError};
use elo_core::seed::Seed;

const ROLE: &str = "ELO_TEST_ROLE";
const DIR: &str = "ELO_TEST_DIR";
/// What this program prints for its parent begins with this, among what the test harness prints.
const TELL: &str = "tell: ";

fn key(unit: u64) -> Key {
    Key::of(&Stage { name: "test", version: 1 }, &(), &[], &Seed::root(unit), "")
}

fn result(unit: u64) -> Vec<u8> {
    (0..4_u64 << 17).map(|i| (i * 31 + unit) as u8).collect()
}

/// Does nothing when it is run as a test; as a child it plays the role that it is given.
#[test]
fn child_role() {
    let Ok(role) = std::env::var(ROLE) else { return };
    let path = std::env::var(DIR).unwrap();
    match role.as_str() {
        "hold" => hold(path.as_ref()),
        "fill" => fill(path.as_ref()),
        _ => panic!("no such role: {role}"),
    }
}

/// Tells who has the directory, and keeps it until the parent closes the pipe.
fn hold(path: &Path) {
    match RunDir::open(path) {
        Ok(dir) => {
            println!("{TELL}opened");
            dir.write_checkpoint(&key(0), b"half way").unwrap();
            let _ = std::io::stdin().read_line(&mut String::new());
        }
        Err(RunDirError::Held { pid, host, .. }) => {
            println!("{TELL}held by {} on {}", pid.unwrap(), host.unwrap());
        }
        Err(error) => panic!("{error}"),
    }
    std::io::stdout().flush().unwrap();
}

fn child(role: &str, path: &Path) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "child_role", "--nocapture"]).env(ROLE, role).env(DIR, path);
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    command
}

struct Holder(Child, BufReader<ChildStdout>);

impl Holder {
    fn start(path: &Path) -> Self {
        let mut child = child("hold", path).spawn().unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        Self(child, output)
    }

    /// The next thing that it tells.
    fn told(&mut self) -> String {
        let told = self.1.by_ref().lines().map(Result::unwrap).find_map(|line| {
            // The harness may have begun the line.
            line.split_once(TELL).map(|(_, told)| told.to_owned())
        });
        told.expect("it tells something")
    }
}

#[test]
fn of_eight_processes_one_gets_the_directory_and_the_others_are_told_which() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("run");
    let mut processes: Vec<Holder> = (0..8).map(|_| Holder::start(&path)).collect();
    let told: Vec<String> = processes.iter_mut().map(Holder::told).collect();
    let opened: Vec<usize> = (0..8).filter(|i| told[*i] == "opened").collect();
    assert_eq!(opened.len(), 1, "{told:?}");
    let holder = processes[opened[0]].0.id();
    let held = format!("held by {holder} on ");
    for (i, told) in told.iter().enumerate() {
        assert!(i == opened[0] || told.starts_with(&held), "expected `{held}…`, got `{told}`");
    }
    match RunDir::open(&path) {
        Err(RunDirError::Held { pid, .. }) => assert_eq!(pid, Some(holder)),
        other => panic!("{:?}", other.err()),
    }
    for Holder(mut child, _) in processes {
        drop(child.stdin.take());
        assert!(child.wait().unwrap().success());
    }
    RunDir::open(&path).unwrap();
}

#[test]
fn a_killed_holder_leaves_the_directory_free_and_its_work_in_it() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("run");
    for _ in 0..5 {
        let mut holder = Holder::start(&path);
        assert_eq!(holder.told(), "opened");
        assert!(matches!(RunDir::open(&path), Err(RunDirError::Held { .. })));
        holder.0.kill().unwrap();
        holder.0.wait().unwrap();
        let dir = RunDir::open(&path).unwrap();
        assert_eq!(dir.take_quarantined(), []);
        let checkpoint = dir.read_checkpoint(&key(0)).unwrap();
        assert!(checkpoint.is_none_or(|bytes| bytes == b"half way"));
    }
}

#[test]
fn a_full_disk_is_told_and_takes_nothing_back() {
    let temporary = tempfile::tempdir().unwrap();
    let mount = "mount -t tmpfs -o size=8m none \"$ELO_TEST_DIR\"";
    let unshare = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--map-root-user", "--mount", "sh", "-c", script]).env(DIR, temporary.path());
        command
    };
    if !unshare(mount).output().is_ok_and(|output| output.status.success()) {
        eprintln!(
            "SKIPPED: this system does not let the test mount a tmpfs of its own with `unshare` and `mount`"
        );
        return;
    }
    let mut command = unshare(&format!("{mount} && exec \"$0\" --exact child_role --nocapture"));
    let output = command.arg(std::env::current_exe().unwrap()).env(ROLE, "fill").output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains("tell: filled after"), "{text}");
}

/// Commits units of half a MiB until 8 MiB are full, makes room and goes on.
fn fill(path: &Path) {
    let run = path.join("run");
    std::fs::write(path.join("ballast"), vec![1; 2 << 20]).unwrap();
    let dir = RunDir::open(&run).unwrap();
    let (full, error) = (0..64).find_map(|i| Some((i, dir.commit(&key(i), &result(i)).err()?))).unwrap();
    println!("{TELL}filled after {full} units: {error}");
    assert!((8..12).contains(&full), "{full} units in 6 MiB");
    match error {
        RunDirError::Write { bytes_needed, source, .. } => {
            assert_eq!(source.kind(), std::io::ErrorKind::StorageFull);
            assert_eq!(bytes_needed, (1 << 19) + 84);
        }
        other => panic!("{other}"),
    }
    drop(dir);
    let dir = RunDir::open(&run).expect("a full disk can be opened, for it has room for names");
    assert!((0..full).all(|i| dir.read(&key(i)).unwrap() == Some(result(i))));
    assert_eq!(dir.read(&key(full)).unwrap(), None);
    std::fs::remove_file(path.join("ballast")).unwrap();
    (full..full + 4).for_each(|i| dir.commit(&key(i), &result(i)).unwrap());
    assert!((0..full + 4).all(|i| dir.read(&key(i)).unwrap() == Some(result(i))));
    assert_eq!(dir.take_quarantined(), []);
}
