//! Notes what the program was built from, for `provenance.json`.

use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=../Cargo.lock");
    println!("cargo:rerun-if-changed=../.git/HEAD");
    let lock = std::fs::read("../Cargo.lock").unwrap_or_default();
    println!("cargo:rustc-env=ELO_LOCK_HASH={}", blake3::hash(&lock).to_hex());
    println!("cargo:rustc-env=ELO_COMMIT={}", first_line("git", &["rev-parse", "HEAD"]));
    let compiler = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    println!("cargo:rustc-env=ELO_COMPILER={}", first_line(&compiler, &["--version"]));
}

/// The first line that a program prints, or `unknown`.
fn first_line(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().ok().filter(|output| output.status.success());
    let text = output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default();
    text.lines().next().unwrap_or("unknown").to_owned()
}
