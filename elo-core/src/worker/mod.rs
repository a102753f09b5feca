//! Units of work in programs of their own, for engines that may end their process, hang, or not be installed.
//!
//! The parent starts a worker with [`WorkerProcess`] and talks to it on its standard input and output; a worker's
//! `main` is [`own_pipes`] and [`serve`]. A worker has one job at a time and may have any number one after the other.
//!
//! # The protocol, for workers in other languages
//!
//! Both sides send **frames**: a `u32` length of what follows (1 to 64 MiB), one byte that tells the kind, and the
//! fields of that kind. Integers are little-endian; *bytes* are a `u32` length and that many bytes, *text* is bytes
//! in UTF-8. A frame has exactly its fields.
//!
//! | from | kind | fields |
//! | --- | --- | --- |
//! | parent | 1 Hello | `u32` protocol, text fingerprint |
//! | parent | 2 Job | `u64` id, `u32` threads, bytes job (JSON), `u32` count of inputs, each as bytes, `u8` 1 and bytes of a checkpoint, or `u8` 0 |
//! | parent | 3 Stop | |
//! | worker | 17 Hello | `u32` protocol, text fingerprint, text engine |
//! | worker | 18 Progress | `u64` id, `u64` done, `u64` total |
//! | worker | 19 Checkpoint | `u64` id, bytes |
//! | worker | 20 Done | `u64` id, bytes result |
//! | worker | 21 Failed | `u64` id, `u8` kind (0 invalid, 1 failed), text message |
//!
//! The parent greets first and the worker always answers with its own greeting; the layout of both greetings is the
//! same in all versions of the protocol. Fingerprints must be equal. Each job is answered by any number of Progress
//! and Checkpoint and then one Done or Failed, all with its id. The end of its input tells a worker that its parent
//! is gone: it must end at once, in the middle of a job too. Standard error is free for messages to people.

mod client;
mod fault;
mod frames;
mod messages;
mod process;
mod server;

pub use client::{Limits, WorkerProcess};
pub use fault::{JobError, JobErrorKind, WorkerFault};
pub use frames::{FrameError, MAX_FRAME};
pub use messages::{PROTOCOL, Reply, Request};
pub use process::Exit;
pub use server::{Handler, Identity, own_pipes, serve};
