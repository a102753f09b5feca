//! Writing to the terminal without panicking when it is gone.

use std::io::{ErrorKind, Write as _};

use serde::Serialize;

use crate::exit::Exit;

/// Writes `text` to stdout.
pub fn print(text: &str) -> Result<(), Exit> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Err(Exit::ReaderGone),
        Err(error) => Err(Exit::Failed(format!("cannot write to stdout: {error}"))),
    }
}

/// Writes `value` to stdout as indented JSON.
pub fn print_json(value: &impl Serialize) -> Result<(), Exit> {
    let text = serde_json::to_string_pretty(value).expect("plain data");
    print(&format!("{text}\n"))
}

/// Writes a line to stderr; nobody can be told when that fails.
pub fn print_error(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "elo: {line}");
}
