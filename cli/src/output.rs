//! The program's output: results on stdout, warnings and progress on stderr.

use crate::progress::Progress;
use crate::table::fitted;
use deltamorph::internals::{Printable, is_device, unfinished, write_replacing};
use serde::Serialize;
use std::collections::HashSet;
use std::fmt;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The reason why a command ended early. Printed after "error: ", on one line.
#[derive(Debug)]
pub enum Failure {
    /// The arguments contradict each other or the input (exit code 2).
    Usage(String),
    /// The work failed (exit code 1).
    Failed(String),
}

impl Failure {
    /// A failure of the work. Errors of the library and of serde include their causes.
    pub fn failed(error: impl fmt::Display) -> Self {
        Self::Failed(error.to_string())
    }

    /// A file that could not be read or written.
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::failed(deltamorph::Error::Io { path: path.into(), action, source })
    }
}

/// `Result` with a [`Failure`].
pub type Result<T, E = Failure> = std::result::Result<T, E>;

/// Ends a command whose arguments contradict each other or the input.
pub fn refuse<T>(why: impl Into<String>) -> Result<T> {
    Err(Failure::Usage(why.into()))
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Usage(text) | Self::Failed(text)) = self;
        // One line, even if a file name or a driver message has several.
        write!(f, "{}", Printable(text))
    }
}

impl From<deltamorph::Error> for Failure {
    fn from(error: deltamorph::Error) -> Self {
        Self::failed(error)
    }
}

/// The output of a command.
#[derive(Clone, Default)]
pub struct Output {
    quiet: bool,
    json: Option<PathBuf>,
    /// The message of the first error of writing to stdout.
    lost: OnceLock<String>,
    /// Set where a file is written to stdout.
    taken: OnceLock<()>,
}

impl Output {
    pub fn new(quiet: bool, json: Option<PathBuf>) -> Self {
        Self { quiet, json, ..Self::default() }
    }

    /// Whether stdout is reserved for JSON.
    pub fn json_to_stdout(&self) -> bool {
        self.json.as_deref() == Some(Path::new("-"))
    }

    /// Prints the result in words, on stderr where stdout is an output; with `--json -`, nothing, since stdout is
    /// reserved for JSON.
    pub fn say(&self, text: impl fmt::Display) {
        if self.quiet || self.json_to_stdout() {
            return;
        }
        let text = fitted(&text.to_string()) + "\n";
        if self.taken.get().is_some() {
            let _ = io::stderr().write_all(text.as_bytes());
        } else {
            self.print(&text);
        }
    }

    fn print(&self, text: &str) {
        let mut stdout = io::stdout().lock();
        match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
            // A reader that stops early (`| head`) is not a failure.
            Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
                drop(self.lost.set(Failure::io("stdout".as_ref(), "write", e).to_string()));
            }
            _ => {}
        }
    }

    /// Fails if writing to stdout has failed.
    pub fn finish(&self) -> Result<()> {
        self.lost.get().map_or(Ok(()), |message| Err(Failure::failed(message)))
    }

    /// Says what the user should know about the input, the device or the result.
    pub fn warn(&self, text: impl fmt::Display) {
        self.progress(format_args!("warning: {text}"));
    }

    /// Says what the program is doing.
    pub fn progress(&self, text: impl fmt::Display) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr().lock(), "{}", fitted(&Printable(text).to_string()));
        }
    }

    /// Writes the JSON, if `--json` was given.
    pub fn json(&self, value: &impl Serialize) -> Result<()> {
        match self.json.as_deref() {
            None => {}
            Some(_) if self.json_to_stdout() => self.print(&to_json(value)?),
            Some(path) => write_file(path, to_json(value)?)?,
        }
        Ok(())
    }

    /// Checks, before work begins, that every output (the JSON, `files`, and the contents of `folder`) can be written,
    /// and that none overwrites a file that is `read` or another output. Creates `folder`.
    pub fn check(&self, read: &[PathBuf], files: &[&Path], folder: Option<&Path>) -> Result<()> {
        let json = self.json.as_deref().filter(|_| !self.json_to_stdout());
        let outputs: Vec<(&Path, PathBuf)> = json.iter().chain(files).map(|path| (*path, place_of(path))).collect();
        let read: HashSet<PathBuf> = read.iter().filter_map(|path| path.canonicalize().ok()).collect();
        for (i, (path, place)) in outputs.iter().enumerate() {
            if *path == Path::new("-") {
                return refuse("-: only --json goes to stdout; name a file");
            }
            if [Path::new("/dev/stdout"), Path::new("/dev/fd/1")].contains(path) {
                let _ = self.taken.set(());
            }
            // Devices and pipes hold nothing that could be lost.
            if is_device(path) {
                continue;
            }
            let why = if read.contains(place) {
                "is an input".into()
            } else if outputs[..i].iter().any(|(_, other)| other == place) {
                "is another output, too".into()
            } else if let Some(folder) = folder.filter(|folder| place.starts_with(place_of(folder))) {
                format!("is in {}, which is also written", folder.display())
            } else {
                can_write(path)?;
                continue;
            };
            let text = format!("{}: {why}, and would be overwritten; name another file", path.display());
            return refuse(text);
        }
        folder.map_or(Ok(()), create_folder)
    }

    /// Shows that work of unknown length is being done.
    pub fn spinner(&self, message: impl Into<String>) -> Progress {
        Progress::new(self.quiet, 0, message.into())
    }

    /// Shows how much is done of `steps` steps.
    pub fn bar(&self, steps: u64) -> Progress {
        Progress::new(self.quiet, steps, String::new())
    }
}

/// Merges the JSON of both into one object.
#[derive(Serialize)]
pub struct With<T, U> {
    #[serde(flatten)]
    pub fields: T,
    #[serde(flatten)]
    pub more: U,
}

pub fn to_json(value: &impl Serialize) -> Result<String> {
    let mut text = serde_json::to_string_pretty(value).map_err(Failure::failed)?;
    text.push('\n');
    Ok(text)
}

/// Refuses an output whose name says that it is something else than what is written: `what`, which ends in one of
/// `endings`. Devices and pipes may have any name.
pub fn check_ending(path: &Path, what: &str, endings: &[&str]) -> Result<()> {
    // What cannot be written at all is refused elsewhere.
    if path == Path::new("-")
        || endings.iter().any(|ending| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending)))
        || is_device(path)
    {
        return Ok(());
    }
    let names = endings.iter().map(|ending| format!("*.{ending}")).collect::<Vec<_>>().join(" or ");
    refuse(format!("-o {}: {what} is written; name it {names}", path.display()))
}

/// Canonical path of `path`, which need not exist.
fn place_of(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let there =
        path.ancestors().find_map(|there| Some(there.canonicalize().ok()?.join(path.strip_prefix(there).ok()?)));
    there.unwrap_or(path)
}

/// Checks that `path` can be written, without changing anything.
fn can_write(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let tried = if path.exists() {
        std::fs::OpenOptions::new().append(true).open(path).map(drop)
    } else {
        tempfile::tempfile_in(folder).map(drop)
    };
    tried.map_err(|e| Failure::io(path, "write", e))
}

/// Writes a file; errors name it. The old contents stay until the new ones are complete.
pub fn write_file(path: &Path, contents: impl AsRef<[u8]>) -> Result<()> {
    Ok(write_replacing(path, |out| out.write_all(contents.as_ref()))?)
}

/// Prefix of the folders that [`publish`] prepares files in.
const PREPARED: &str = ".deltamorph-";

/// Writes files into `folder` through `write`, which gets a temporary folder: old files stay until all new ones are
/// complete. Then the old files that are `ours`, and were not replaced, are deleted.
pub fn publish(folder: &Path, ours: impl Fn(&str) -> bool, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    create_folder(folder)?;
    let failed = |e| Failure::io(folder, "write", e);
    let prepared = tempfile::Builder::new().prefix(PREPARED).tempdir_in(folder).map_err(failed)?;
    unfinished().insert(prepared.path().to_path_buf());
    write(prepared.path())?;
    let new = names_in(prepared.path())?;
    for name in &new {
        std::fs::rename(prepared.path().join(name), folder.join(name)).map_err(failed)?;
    }
    for name in names_in(folder)?.iter().filter(|name| ours(name) && !new.contains(*name)) {
        std::fs::remove_file(folder.join(name)).map_err(failed)?;
    }
    Ok(())
}

/// The names in `folder`. Names that are not UTF-8 contain U+FFFD, which none of ours does.
fn names_in(folder: &Path) -> Result<Vec<String>> {
    let io = |e| Failure::io(folder, "read the folder", e);
    let entries = std::fs::read_dir(folder).map_err(io)?.collect::<Result<Vec<_>, _>>().map_err(io)?;
    Ok(entries.iter().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect())
}

/// Ensures that `folder` exists, and is empty or `ours`; otherwise the error's text is `complaint`, with the remedy.
pub fn claim(folder: &Path, complaint: &str, ours: impl FnOnce() -> bool) -> Result<()> {
    create_folder(folder)?;
    // Ignores folders left by `publish`.
    if names_in(folder)?.iter().all(|name| name.starts_with(PREPARED)) || ours() {
        return Ok(());
    }
    refuse(format!("{}: the folder {complaint}", folder.display()))
}

pub fn create_folder(path: &Path) -> Result<()> {
    if path.exists() && !path.is_dir() {
        return refuse(format!("{}: is not a folder; name another one", path.display()));
    }
    std::fs::create_dir_all(path).map_err(|e| Failure::io(path, "create the folder", e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_one_line_with_their_cause() {
        let missing = Failure::io(Path::new("a/b.csv"), "read", std::io::ErrorKind::NotFound.into());
        assert_eq!(missing.to_string(), "a/b.csv: cannot read: entity not found; check the path");
        assert_eq!(Failure::Failed("first\n\x1b[2Jsecond".into()).to_string(), "first\\n\\u{1b}[2Jsecond");
    }
}
