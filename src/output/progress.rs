//! How much of a recording has been read, on stderr: for those who wait before a terminal.

use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A line of progress stands where the next one on stderr will.
static SHOWN: AtomicBool = AtomicBool::new(false);

/// What takes less is nothing to wait for.
const PATIENCE: Duration = Duration::from_secs(1);
const REDRAWN: Duration = Duration::from_millis(100);

/// Counts what has been read.
pub(crate) struct Progress {
    name: String,
    /// Bytes in all, where that is known.
    total: Option<u64>,
    done: u64,
    due: Instant,
    wanted: bool,
    cycles: bool,
}

impl Progress {
    /// Shown on a terminal only, and not where records go to one: they show themselves how far they are.
    pub(crate) fn new(name: &str, total: Option<u64>, quiet: bool) -> Progress {
        Progress {
            name: name.to_owned(),
            total,
            done: 0,
            due: Instant::now() + PATIENCE,
            wanted: !quiet && io::stderr().is_terminal() && !io::stdout().is_terminal(),
            cycles: false,
        }
    }

    /// Of cycles that are looked at before any is shown, wherever that goes.
    pub(crate) fn cycles(total: Option<u64>, quiet: bool) -> Progress {
        let mut progress = Progress::new("", total, quiet);
        progress.wanted = !quiet && io::stderr().is_terminal();
        progress.cycles = true;
        progress
    }

    /// So many bytes or cycles more.
    pub(crate) fn add(&mut self, bytes: usize) {
        self.done += bytes as u64;
        if self.wanted && Instant::now() >= self.due {
            self.due = Instant::now() + REDRAWN;
            self.show();
        }
    }

    fn show(&self) {
        let line = format!("\r\x1b[Kbiss: {}", self.said());
        SHOWN.store(true, Ordering::Relaxed);
        let _ = io::stderr().lock().write_all(line.as_bytes());
    }

    fn said(&self) -> String {
        let (done, name) = (self.done, &self.name);
        if self.cycles {
            return match self.total {
                Some(total) => format!("{done} of {total} cycles looked at"),
                None => format!("{done} cycles looked at"),
            };
        }
        let much = match self.total.filter(|total| *total > 0) {
            // A session's parts may be read twice.
            Some(total) => format!(
                "{} %",
                (100 * u128::from(done) / u128::from(total)).min(100)
            ),
            None => format!("{:.1} MB", done as f64 / 1e6),
        };
        format!("{much} of {name} read")
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        let _ = io::stderr().lock().write_all(gone().as_bytes());
    }
}

/// What takes a line of progress away before something else is said.
pub(super) fn gone() -> &'static str {
    if SHOWN.swap(false, Ordering::Relaxed) {
        "\r\x1b[K"
    } else {
        ""
    }
}
