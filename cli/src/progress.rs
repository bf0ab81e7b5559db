//! Progress of long work: a line on stderr, where that is a terminal.

use std::cell::{Cell, RefCell};
use std::io::{IsTerminal, Write, stderr};
use std::time::{Duration, Instant};

/// Time between changes of the line.
const PAUSE: Duration = Duration::from_millis(100);

/// The line: what is being done, and how much of it is. It is removed when dropped.
pub struct Progress {
    shown: bool,
    /// 0: unknown.
    steps: u64,
    done: Cell<u64>,
    begun: Instant,
    /// What is being done, and when the line was last written.
    line: RefCell<(String, Option<Instant>)>,
}

impl Progress {
    /// `steps` steps of something; hidden where `quiet`, or stderr is no terminal.
    pub fn new(quiet: bool, steps: u64, message: String) -> Self {
        let progress = Self {
            shown: !quiet && stderr().is_terminal(),
            steps,
            done: Cell::new(0),
            begun: Instant::now(),
            line: RefCell::new((message, None)),
        };
        progress.write();
        progress
    }

    pub fn set_message(&self, message: String) {
        self.line.borrow_mut().0 = message;
        self.write();
    }

    pub fn inc(&self, steps: u64) {
        self.done.set(self.done.get() + steps);
        self.write();
    }

    fn write(&self) {
        let (message, written) = &mut *self.line.borrow_mut();
        if !self.shown || written.is_some_and(|at| at.elapsed() < PAUSE) {
            return;
        }
        *written = Some(Instant::now());
        let done = self.done.get();
        let left = self.begun.elapsed().as_secs_f64() * self.steps.saturating_sub(done) as f64 / done as f64;
        let text = match (self.steps, done) {
            (0, _) => message.clone(),
            (steps, 0) => format!("0 of {steps}  {message}"),
            (steps, done) => format!("{done} of {steps}, {left:.0} s left  {message}"),
        };
        let columns = columns();
        let text: String = text.chars().take(columns).collect();
        let _ = write!(stderr(), "\r{text:columns$}");
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if self.shown {
            let _ = write!(stderr(), "\r{:1$}\r", "", columns());
        }
    }
}

/// Columns that the line fills. It is overwritten with spaces, since consoles of Windows may not know escape codes.
fn columns() -> usize {
    let width = terminal_size::terminal_size_of(stderr()).map_or(80, |(columns, _)| usize::from(columns.0));
    width.saturating_sub(1)
}
