//! The program on an option set that is made by hand.

use std::process::Command;

mod by_hand;

#[test]
fn it_plays_the_option_that_was_stored() {
    let folder = by_hand::push_right(10);
    let output =
        Command::new(env!("CARGO_BIN_EXE_play-option-set")).arg(folder.path()).output().expect("it starts");
    let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{stderr}");
    // After n steps of 0.05 s at 1 m/s² the mass is 0.00125 n (n + 1) m from its start, 0.55 m summed over ten steps, and
    // the start lies within 0.1 m of 0. A step pays 1 - |x| - 0.1: all ten pay 9 less at most 0.55 + 1.
    let printed: f64 = stdout
        .strip_prefix("option 7: return ")
        .and_then(|rest| rest.strip_suffix(" in 10 steps\n"))
        .and_then(|number| number.parse().ok())
        .unwrap_or_else(|| panic!("{stdout}"));
    assert!((7.4..=9.1).contains(&printed), "{printed}");
}

#[test]
fn without_a_set_it_says_what_is_missing() {
    let output = Command::new(env!("CARGO_BIN_EXE_play-option-set")).output().expect("it starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && stderr.contains("the folder of an option set"), "{stderr}");
}
