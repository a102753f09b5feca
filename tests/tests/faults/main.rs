//! What goes wrong in a run, and what becomes of it.

#![cfg(unix)]
#![allow(clippy::unwrap_used)]

mod engines;
mod files;
mod interruptions;

use std::path::PathBuf;
use std::sync::OnceLock;

use elo_backends::locomotion::robot;
use elo_tests::programs::{discover, elo, run, write};
use elo_tests::toy::{TOY, toy_with};

/// A finished run of [`TOY`], shared by all tests and changed by none.
fn reference() -> &'static (tempfile::TempDir, PathBuf, PathBuf) {
    static REFERENCE: OnceLock<(tempfile::TempDir, PathBuf, PathBuf)> = OnceLock::new();
    REFERENCE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let config = write(folder.path(), "toy.toml", TOY);
        let out = folder.path().join("run");
        run(&mut discover(elo(), &config, &out)).expect_success();
        (folder, config, out)
    })
}

/// Half-cheetah as a robot of the user's own: its config table, and its MJCF text.
fn own_robot() -> (String, String) {
    let mut description = robot::built_in("half-cheetah").unwrap();
    let mjcf = std::mem::replace(&mut description.mjcf, "robot.xml".to_owned());
    (toml::to_string(&description).unwrap(), mjcf)
}

/// [`TOY`] with that robot on MuJoCo; its file is `robot.xml` beside the config.
fn own_robot_toy(changes: &[(&str, &str)]) -> String {
    let (table, _) = own_robot();
    let table = table
        .replace("[alive]", "[simulator.own_robot.alive]")
        .replace("[[progress]]", "[[simulator.own_robot.progress]]");
    let simulator = format!("kind = \"mujoco\"\n[simulator.own_robot]\n{table}");
    let robot = [
        ("kind = \"point_mass\"\nreset_spread = 0.5", simulator.as_str()),
        ("tasks.effort_cost]\nlow = -0.3\nhigh = -0.05", "tasks.electricity_cost]\nlow = -2.4\nhigh = -1.4"),
    ];
    toy_with(&[&robot, changes].concat())
}
