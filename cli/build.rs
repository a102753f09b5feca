//! Notes what the program was built from, for `provenance.json` and for the greeting of its workers.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The crates whose code decides what a unit's result is.
const SOURCES: [&str; 3] = ["../elo-core/src", "../learners/src", "../backends/src"];

fn main() {
    println!("cargo:rerun-if-changed=../Cargo.lock");
    println!("cargo:rerun-if-changed=../.git/HEAD");
    let lock = std::fs::read("../Cargo.lock").unwrap_or_default();
    println!("cargo:rustc-env=ELO_LOCK_HASH={}", blake3::hash(&lock).to_hex());
    println!("cargo:rustc-env=ELO_SOURCES={}", sources());
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

/// A hash of these crates' files, or `unknown` where they do not lie beside this one.
fn sources() -> String {
    let mut hasher = blake3::Hasher::new();
    for folder in SOURCES.map(Path::new) {
        if !folder.is_dir() {
            return "unknown".to_owned();
        }
        println!("cargo:rerun-if-changed={}", folder.display());
        let mut files = Vec::new();
        gather(folder, &mut files);
        files.sort();
        for file in files {
            let text = std::fs::read(&file).expect("a file of this repository can be read");
            hasher.update(file.to_string_lossy().as_bytes());
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(&text);
        }
    }
    hasher.finalize().to_hex()[..16].to_owned()
}

fn gather(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder of this repository can be read").flatten() {
        let path = entry.path();
        if path.is_dir() {
            gather(&path, files);
        } else {
            files.push(path);
        }
    }
}
