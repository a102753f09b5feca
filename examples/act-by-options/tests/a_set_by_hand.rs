//! The program on an option set that is made by hand.

use std::process::Command;

#[path = "../../play-option-set/tests/by_hand/mod.rs"]
mod by_hand;

#[test]
fn it_acts_by_the_option_that_was_stored() {
    let folder = by_hand::push_right(4);
    let output = Command::new(env!("CARGO_BIN_EXE_act-by-options")).arg(folder.path()).output();
    let output = output.expect("it starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // The only option begins again each time that it has ended.
    assert_eq!(String::from_utf8_lossy(&output.stdout), "[1.0]\n".repeat(10));
}

#[test]
fn a_folder_without_a_set_is_refused() {
    let output = Command::new(env!("CARGO_BIN_EXE_act-by-options")).arg("/nowhere").output();
    let stderr = String::from_utf8_lossy(&output.expect("it starts").stderr).into_owned();
    assert!(stderr.contains("manifest.json"), "{stderr}");
}
