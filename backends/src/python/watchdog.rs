//! Ends a worker whose environment does not come back from a step.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use elo_core::workers::STEP_SECONDS;

/// How many calls have begun and have ended: odd while one is under way. A worker does one job at a time, so calls do not overlap.
static TURNS: AtomicU64 = AtomicU64::new(0);

/// Watches from now on, if this process is a worker with a limit ([`STEP_SECONDS`] set, and above 0). Only the first call begins a
/// thread.
pub fn watch() {
    static WATCHED: OnceLock<()> = OnceLock::new();
    WATCHED.get_or_init(|| {
        let limit = std::env::var(STEP_SECONDS).ok().and_then(|text| text.parse::<f64>().ok()).unwrap_or(0.0);
        if limit > 0.0 {
            std::thread::spawn(move || patrol(limit));
        }
    });
}

/// The clock is read here alone: calls are much more frequent.
fn patrol(limit: f64) {
    let pause = Duration::from_secs_f64((limit / 10.0).clamp(0.001, 1.0));
    let (mut turn, mut since) = (0, Instant::now());
    loop {
        std::thread::sleep(pause);
        let now = TURNS.load(Ordering::Relaxed);
        if now != turn {
            (turn, since) = (now, Instant::now());
        } else if turn % 2 == 1 && since.elapsed().as_secs_f64() > limit {
            // What holds Python's lock cannot be asked to stop. The parent reads this and begins again.
            eprintln!("the environment did not come back within {limit} s (`workers.step_seconds`)");
            std::process::abort();
        }
    }
}

/// Marks the time of one step, reset, reading of a state, or action of a policy. Imports and constructors are not watched: they
/// may take long, and the parent's limit on silence is theirs.
pub struct Call;

impl Call {
    /// The call begins.
    pub fn begin() -> Self {
        TURNS.fetch_add(1, Ordering::Relaxed);
        Self
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        TURNS.fetch_add(1, Ordering::Relaxed);
    }
}
