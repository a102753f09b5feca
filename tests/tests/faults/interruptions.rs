//! Signals, readers that go away, two processes on one run directory, damage on the disk.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use elo_core::seed::Seed;
use elo_tests::folders::{assert_same, names};
use elo_tests::preload::{self, send, wait_until_stopped};
use elo_tests::programs::{Ran, discover, elo, elo_with, run};
use rand::RngExt as _;

use crate::reference;

/// Starts [`TOY`] and waits until it has stopped itself at an fsync amid its training.
fn stopped(out: &Path) -> Child {
    let (_, config, _) = reference();
    let mut command = discover(elo(), config, out);
    preload::stop_at(&mut command, 25);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    wait_until_stopped(&child);
    child
}

#[test]
fn signals_stop_a_run_that_can_be_taken_up() {
    let (_, config, expected) = reference();
    let folder = tempfile::tempdir().unwrap();
    for (signal, code) in [(libc::SIGINT, 130), (libc::SIGTERM, 143), (libc::SIGHUP, 129)] {
        let out = folder.path().join(code.to_string());
        let child = stopped(&out);
        send(&child, signal);
        send(&child, libc::SIGCONT);
        let ran: Ran = child.wait_with_output().unwrap().into();
        let ran = ran.expect_code(code);
        assert!(ran.stderr.contains("elo: interrupted; the same command takes it up again"), "{ran}");
        assert!(!out.join("results").exists());
        run(&mut discover(elo(), config, &out)).expect_success();
        assert_same(&expected.join("results"), &out.join("results"), &format!("signal {signal}"));
    }
    // A second signal ends it at once, even where it cannot stop by itself.
    let out = folder.path().join("twice");
    let child = stopped(&out);
    send(&child, libc::SIGINT);
    send(&child, libc::SIGTERM);
    send(&child, libc::SIGCONT);
    let ran: Ran = child.wait_with_output().unwrap().into();
    assert!(matches!(ran.code, Some(130 | 143)), "{ran}");
}

#[test]
fn a_reader_that_has_gone_is_no_fault() {
    let (_, config, expected) = reference();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let mut table = discover(elo(), config, &out);
    let commands = [
        elo_with(&["plugins"]),
        elo_with(&["example", "experiment"]),
        elo_with(&["config", "schema"]),
        elo_with(&["--help"]),
        elo_with(&["doctor"]),
    ];
    for command in commands.into_iter().chain([std::mem::replace(&mut table, Command::new("true"))]) {
        let mut command = command;
        let mut child =
            command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let ran: Ran = child.wait_with_output().unwrap().into();
        assert_eq!(ran.code, Some(0), "{command:?}: {ran}");
        assert!(!ran.stderr.contains("panicked"), "{command:?}: {ran}");
    }
    assert_same(&expected.join("results"), &out.join("results"), "a closed pipe");

    // Nobody reads what is said on stderr either.
    let mut command = discover(elo(), config, &folder.path().join("silent"));
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop((child.stdout.take(), child.stderr.take()));
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

#[test]
fn of_eight_processes_on_one_run_directory_seven_are_told_who_has_it() {
    let (_, config, expected) = reference();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let holder = stopped(&out);
    let others: Vec<Child> = (0..7)
        .map(|_| {
            let mut command = discover(elo(), config, &out);
            command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
        })
        .collect();
    for other in others {
        let ran: Ran = other.wait_with_output().unwrap().into();
        let ran = ran.expect_code(3);
        assert!(ran.stderr.contains(&format!("is in use by process {} on ", holder.id())), "{ran}");
    }
    send(&holder, libc::SIGCONT);
    let ran: Ran = holder.wait_with_output().unwrap().into();
    ran.expect_success();
    assert_same(&expected.join("results"), &out.join("results"), "seven others");

    // A killed holder leaves no lock behind.
    let out = folder.path().join("killed");
    let mut holder = stopped(&out);
    holder.kill().unwrap();
    holder.wait().unwrap();
    run(&mut discover(elo(), config, &out)).expect_success();
    assert_same(&expected.join("results"), &out.join("results"), "a killed holder");
}

#[test]
fn damaged_units_are_kept_aside_and_computed_again() {
    let (_, config, expected) = reference();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let units: Vec<PathBuf> =
        names(&expected.join("units")).into_iter().map(|name| Path::new("units").join(name)).collect();
    let mut stream = Seed::root(4).stream();
    let mut damaged = 0;
    for name in names(expected) {
        let to = out.join(&name);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        let mut bytes = fs::read(expected.join(&name)).unwrap();
        if units.contains(&name) {
            let at = stream.random_range(0..bytes.len());
            match stream.random_range(0..6) {
                0 => bytes[at] ^= 1 << stream.random_range(0..8),
                1 => bytes.truncate(at),
                2 => bytes = fs::read(expected.join(&units[stream.random_range(0..units.len())])).unwrap(),
                _ => {}
            }
            damaged += usize::from(bytes != fs::read(expected.join(&name)).unwrap());
        }
        fs::write(to, bytes).unwrap();
    }
    assert!(damaged > 10, "{damaged} of {}", units.len());
    let ran = run(&mut discover(elo(), config, &out)).expect_success();
    assert_eq!(ran.stderr.matches("will be computed again").count(), damaged, "{ran}");
    let aside = names(&out).iter().filter(|name| name.to_string_lossy().contains(".corrupt")).count();
    assert_eq!(aside, damaged);
    assert_same(&expected.join("results"), &out.join("results"), "damage");
}
