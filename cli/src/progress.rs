//! Progress of long work: a line on stderr, where that is a terminal.

use std::io::{IsTerminal, Write, stderr};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Time between changes of the line.
const PAUSE: Duration = Duration::from_millis(100);

/// The line: what is being done, and how much of it is. It is removed when dropped.
pub struct Progress {
    shown: bool,
    /// 0: unknown.
    steps: u64,
    done: AtomicU64,
    begun: Instant,
    /// What is being done, and when the line was last written.
    line: Mutex<(String, Option<Instant>)>,
}

impl Progress {
    /// `steps` steps of something; hidden where `quiet`, or stderr is no terminal.
    pub fn new(quiet: bool, steps: u64, message: String) -> Self {
        let progress = Self {
            shown: !quiet && stderr().is_terminal(),
            steps,
            done: AtomicU64::new(0),
            begun: Instant::now(),
            line: Mutex::new((message, None)),
        };
        progress.write();
        progress
    }

    pub fn set_message(&self, message: String) {
        if let Ok(mut line) = self.line.lock() {
            line.0 = message;
        }
        self.write();
    }

    pub fn inc(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
        self.write();
    }

    fn write(&self) {
        let Ok(mut line) = self.line.lock() else { return };
        let (message, written) = &mut *line;
        if !self.shown || written.is_some_and(|at| at.elapsed() < PAUSE) {
            return;
        }
        *written = Some(Instant::now());
        let done = self.done.load(Ordering::Relaxed);
        let left = self.begun.elapsed().as_secs_f64() * self.steps.saturating_sub(done) as f64 / done as f64;
        let text = match (self.steps, done) {
            (0, _) => message.clone(),
            (steps, 0) => format!("0 of {steps}  {message}"),
            (steps, done) => format!("{done} of {steps}, {left:.0} s left  {message}"),
        };
        let columns = terminal_size::terminal_size_of(stderr()).map_or(80, |(columns, _)| usize::from(columns.0));
        let text: String = text.chars().take(columns.saturating_sub(1)).collect();
        let _ = write!(stderr(), "\r\x1b[2K{text}");
    }

    /// Removes the line.
    pub fn finish_and_clear(self) {}
}

impl Drop for Progress {
    fn drop(&mut self) {
        if self.shown {
            let _ = write!(stderr(), "\r\x1b[2K");
        }
    }
}
