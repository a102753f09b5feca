//! Ends a worker whose environment does not come back from a step.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Seconds that a call may take; unset or 0 means that nobody watches.
const LIMIT: &str = "ELO_STEP_SECONDS";

/// When the present call began, in milliseconds since [`started`], plus one; 0 between calls.
static BEGAN: AtomicU64 = AtomicU64::new(0);

fn started() -> Instant {
    static STARTED: OnceLock<Instant> = OnceLock::new();
    *STARTED.get_or_init(Instant::now)
}

fn now() -> u64 {
    started().elapsed().as_millis() as u64 + 1
}

/// Watches from now on, if this process is a worker with a limit. Only the first call begins a thread.
pub fn watch() {
    static WATCHED: OnceLock<()> = OnceLock::new();
    WATCHED.get_or_init(|| {
        let limit = std::env::var(LIMIT).ok().and_then(|text| text.parse::<f64>().ok()).unwrap_or(0.0);
        if limit > 0.0 {
            started();
            std::thread::spawn(move || patrol(limit));
        }
    });
}

fn patrol(limit: f64) {
    let pause = Duration::from_secs_f64((limit / 10.0).clamp(0.001, 1.0));
    loop {
        std::thread::sleep(pause);
        let began = BEGAN.load(Ordering::Relaxed);
        if began > 0 && (now() - began) as f64 / 1000.0 > limit {
            // What holds Python's lock cannot be asked to stop. The parent reads this and begins again.
            eprintln!("the environment did not come back within {limit} s (`workers.step_seconds`)");
            std::process::abort();
        }
    }
}

/// Marks the time of one call into the environment.
pub struct Call;

impl Call {
    /// The call begins.
    pub fn begin() -> Self {
        BEGAN.store(now(), Ordering::Relaxed);
        Self
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        BEGAN.store(0, Ordering::Relaxed);
    }
}
