//! Ctrl-C, a request to terminate and a closed terminal: finish or abandon the units under way, then stop.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

static SIGNAL: AtomicUsize = AtomicUsize::new(0);

/// Lets the first signal set the flag that is returned, and a second one end the process at once.
pub fn watch() -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGHUP, SIGINT, SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
        // SAFETY: storing to an atomic is async-signal-safe.
        unsafe {
            signal_hook::low_level::register(signal, move || SIGNAL.store(signal as usize, Ordering::Relaxed))
        }?;
    }
    Ok(stop)
}

/// 128 and the number of the signal that came; that of Ctrl-C if none did.
pub fn exit_code() -> u8 {
    match SIGNAL.load(Ordering::Relaxed) {
        0 => 130,
        signal => 128 + signal as u8,
    }
}
