//! What the program prints and where: results on stdout, remarks and progress on stderr.

use crate::args::GlobalArgs;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::fmt;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// Why a command ended early. Printed after "error: ", on one line.
#[derive(Debug)]
pub enum Failure {
    /// The arguments contradict each other or the input (exit code 2).
    Usage(String),
    /// The work failed (exit code 1).
    Failed(String),
}

impl Failure {
    /// Any failure of the work, with the chain of what caused it.
    pub fn failed(error: &dyn std::error::Error) -> Self {
        let mut text = error.to_string();
        let mut source = error.source();
        while let Some(cause) = source {
            let cause_text = cause.to_string();
            // Many messages quote their cause already.
            if !text.contains(&cause_text) {
                text = format!("{text}: {cause_text}");
            }
            source = cause.source();
        }
        Self::Failed(text)
    }

    /// A file that could not be read or written.
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::failed(&deltamorph::Error::Io { path: path.into(), action, source })
    }

    /// The exit code.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Usage(_) => 2,
            Self::Failed(_) => 1,
        })
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Usage(text) | Self::Failed(text)) = self;
        // One line, whatever a file name or a driver put into the message.
        let words = |line: &str| line.trim().to_owned();
        f.write_str(&text.lines().map(words).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(" "))
    }
}

impl From<deltamorph::Error> for Failure {
    fn from(error: deltamorph::Error) -> Self {
        Self::failed(&error)
    }
}

/// Where the output of a command goes.
#[derive(Clone, Debug)]
pub struct Output {
    quiet: bool,
    json: Option<PathBuf>,
    terminal: bool,
}

impl Output {
    /// As the global options ask for.
    pub fn new(global: &GlobalArgs) -> Self {
        Self { quiet: global.quiet, json: global.json.clone(), terminal: std::io::stderr().is_terminal() }
    }

    fn json_to_stdout(&self) -> bool {
        self.json.as_deref() == Some(Path::new("-"))
    }

    /// Print the human-readable result. With `--json -` stdout is the JSON's alone.
    pub fn say(&self, text: impl fmt::Display) {
        if !self.quiet && !self.json_to_stdout() {
            // A reader that has seen enough (`| head`) is no failure of ours.
            let _ = writeln!(std::io::stdout().lock(), "{text}");
        }
    }

    /// Print a remark.
    pub fn note(&self, text: impl fmt::Display) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr().lock(), "note: {text}");
        }
    }

    /// Write the JSON, if it was asked for.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn json(&self, value: &impl Serialize) -> Result<(), Failure> {
        match self.json.as_deref() {
            None => Ok(()),
            Some(_) if self.json_to_stdout() => {
                let text = to_json(value)?;
                std::io::stdout()
                    .lock()
                    .write_all(text.as_bytes())
                    .map_err(|e| Failure::io("stdout".as_ref(), "write", e))
            }
            Some(path) => write_file(path, to_json(value)?),
        }
    }

    /// Whether the JSON, if asked for, can be written where it was asked for.
    ///
    /// # Errors
    /// It cannot.
    pub fn check_json(&self) -> Result<(), Failure> {
        match self.json.as_deref() {
            Some(path) if !self.json_to_stdout() => {
                let opened = std::fs::OpenOptions::new().append(true).create(true).open(path);
                opened.map(drop).map_err(|e| Failure::io(path, "write", e))
            }
            _ => Ok(()),
        }
    }

    /// A spinner for work of unknown length; hidden unless a person is watching.
    pub fn spinner(&self, message: impl Into<String>) -> ProgressBar {
        if !self.watched() {
            return ProgressBar::hidden();
        }
        let bar = ProgressBar::new_spinner().with_message(message.into());
        bar.enable_steady_tick(Duration::from_millis(100));
        bar
    }

    /// A bar for `steps` of work; hidden unless a person is watching.
    pub fn bar(&self, steps: u64) -> ProgressBar {
        if !self.watched() {
            return ProgressBar::hidden();
        }
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {eta:>5} left  {wide_msg}");
        ProgressBar::new(steps).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
    }

    fn watched(&self) -> bool {
        self.terminal && !self.quiet
    }
}

fn to_json(value: &impl Serialize) -> Result<String, Failure> {
    let mut text = serde_json::to_string_pretty(value).map_err(|e| Failure::failed(&e))?;
    text.push('\n');
    Ok(text)
}

/// Write a file, naming it when that fails.
///
/// # Errors
/// The file cannot be written.
pub fn write_file(path: &Path, contents: impl AsRef<[u8]>) -> Result<(), Failure> {
    std::fs::write(path, contents).map_err(|e| Failure::io(path, "write", e))
}

/// Create a folder and those above it.
///
/// # Errors
/// A folder cannot be created.
pub fn create_folder(path: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(path).map_err(|e| Failure::io(path, "create the folder", e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_one_line_with_their_cause() {
        let missing = Failure::io(Path::new("a/b.csv"), "read", std::io::ErrorKind::NotFound.into());
        assert_eq!(missing.to_string(), "a/b.csv: cannot read: entity not found; check the path");
        assert_eq!(Failure::Failed("first\n  second\n".into()).to_string(), "first second");
    }

    #[test]
    fn exit_codes() {
        assert_eq!(format!("{:?}", Failure::Usage(String::new()).exit_code()), format!("{:?}", ExitCode::from(2)));
        assert_eq!(format!("{:?}", Failure::Failed("x".into()).exit_code()), format!("{:?}", ExitCode::from(1)));
    }
}
