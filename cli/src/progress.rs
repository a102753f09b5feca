//! How far a run is: a bar a stage on a terminal, plain lines elsewhere. Always on stderr.

use std::io::IsTerminal as _;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use elo_core::crew::Watcher;
use indicatif::{ProgressBar, ProgressStyle};

use crate::output::print_error;

/// Shows the stages of a run on stderr.
pub struct Progress {
    terminal: bool,
    stage: Mutex<Option<Stage>>,
}

struct Stage {
    bar: Option<ProgressBar>,
    units: usize,
    /// Done when the stage began, so that the time left is reckoned from what was done since.
    first: f64,
    done: f64,
    begun: Instant,
    told: Instant,
}

/// Resolution of the bars, so that long units move them too.
const PARTS: f64 = 1000.0;

/// Time between plain lines.
const QUIET: Duration = Duration::from_secs(10);

impl Progress {
    /// Bars where stderr is a terminal.
    pub fn new() -> Self {
        Self { terminal: std::io::stderr().is_terminal(), stage: Mutex::new(None) }
    }
}

impl Watcher for Progress {
    fn begin(&self, stage: &str, units: usize, ready: usize) {
        let bar = self.terminal.then(|| {
            let bar = ProgressBar::new((units as f64 * PARTS) as u64);
            let style =
                ProgressStyle::with_template("{prefix:>22} [{bar:40}] {percent:>3} %  {elapsed}, {eta} left")
                    .expect("the template is constant");
            bar.set_style(style);
            bar.set_prefix(stage.to_owned());
            bar.set_position((ready as f64 * PARTS) as u64);
            bar.reset_eta();
            bar
        });
        if bar.is_none() {
            let before = if ready == 0 { String::new() } else { format!(", {ready} done before") };
            let noun = if units == 1 { "unit" } else { "units" };
            print_error(&format!("{stage}: {units} {noun}{before}"));
        }
        let (now, first) = (Instant::now(), ready as f64);
        let stage = Stage { bar, units, first, done: first, begun: now, told: now };
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) = Some(stage);
    }

    fn advance(&self, name: &str, done: f64) {
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(stage) = stage.as_mut() else { return };
        stage.done = stage.done.max(done);
        if let Some(bar) = &stage.bar {
            bar.set_position((stage.done * PARTS) as u64);
        } else if stage.told.elapsed() >= QUIET && stage.done < stage.units as f64 {
            stage.told = Instant::now();
            let share = 100.0 * stage.done / stage.units.max(1) as f64;
            print_error(&format!("{name}: {share:.0} %{}", stage.left()));
        }
    }

    fn end(&self, name: &str) {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(stage) = stage else { return };
        match stage.bar {
            Some(bar) if stage.done >= stage.units as f64 => bar.finish(),
            Some(bar) => bar.abandon(),
            None if stage.done >= stage.units as f64 => {
                print_error(&format!("{name}: done in {}", duration(stage.begun.elapsed())));
            }
            None => {}
        }
    }

    fn notice(&self, message: &str) {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        match stage.as_ref().and_then(|stage| stage.bar.as_ref()) {
            Some(bar) => bar.println(format!("elo: {message}")),
            None => print_error(message),
        }
    }
}

impl Stage {
    /// `, about 40 s left`, once something was done.
    fn left(&self) -> String {
        let (done, todo) = (self.done - self.first, self.units as f64 - self.done);
        if done <= 0.0 {
            return String::new();
        }
        format!(", about {} left", duration(self.begun.elapsed().mul_f64(todo / done)))
    }
}

/// A time for people: seconds, minutes or hours.
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}
