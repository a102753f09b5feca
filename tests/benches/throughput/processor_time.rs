//! Time that was spent computing. On a machine with other work, elapsed time would measure that work.

/// Seconds that this thread has had a processor; elapsed time where the system does not tell.
pub fn of_thread() -> f64 {
    #[cfg(unix)]
    {
        let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
        // SAFETY: the call fills in the structure that it is given.
        unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut time) };
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    }
    #[cfg(not(unix))]
    {
        elapsed()
    }
}

/// Seconds that this process and its children that have ended had processors; elapsed time where the system does not
/// tell.
pub fn of_family() -> f64 {
    #[cfg(unix)]
    {
        let spent = |who| {
            // SAFETY: all-zero is a valid `rusage`, which the call fills in.
            let usage = unsafe {
                let mut usage: libc::rusage = std::mem::zeroed();
                libc::getrusage(who, &mut usage);
                usage
            };
            [usage.ru_utime, usage.ru_stime]
                .iter()
                .map(|t| t.tv_sec as f64 + t.tv_usec as f64 * 1e-6)
                .sum::<f64>()
        };
        spent(libc::RUSAGE_SELF) + spent(libc::RUSAGE_CHILDREN)
    }
    #[cfg(not(unix))]
    {
        elapsed()
    }
}

#[cfg(not(unix))]
fn elapsed() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}

/// How many programs wanted a processor in the last minutes, and how many processors there are.
pub fn load_average() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_else(|_| "unknown".to_owned());
    let three: Vec<&str> = text.split_whitespace().take(3).collect();
    let processors = std::thread::available_parallelism().map_or(0, std::num::NonZero::get);
    format!("{} on {processors} processors", three.join(" "))
}
