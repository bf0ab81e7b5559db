//! Access to files: bounded reads, atomic replacement, folder listings.

use crate::error::{Error, Result};
use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The largest text file that is read: it is held in memory, and the arrays made from it take a few times its size.
pub const TEXT_MAX: u64 = 1 << 30;

/// Reads a regular file, or a pipe that is open already (`<(...)` of a shell), of at most `limit` bytes; `remedy` is
/// the advice for a larger one.
pub fn read_bounded(path: &Path, limit: u64, remedy: &str) -> Result<Vec<u8>> {
    let io = Error::io(path, "read");
    // Checked before the file is opened: opening a pipe without a writer blocks for ever.
    let kind = std::fs::metadata(path).map_err(&io)?;
    let is_open = ["/dev/stdin", "/dev/fd"].iter().any(|open| path.starts_with(open));
    if !kind.is_file() && (kind.is_dir() || !is_open) {
        let kind = if kind.is_dir() { "a folder" } else { "a pipe, socket or device" };
        let what = format!("{kind}, where a regular file is expected");
        return Err(Error::input(path, "", what, "give the path of a regular file"));
    }
    let file = File::open(path).map_err(&io)?;
    let size = file.metadata().map_err(&io)?.len();
    let mut bytes = Vec::new();
    if size <= limit {
        bytes = room(path, size.saturating_add(2))?;
        // The size is only a hint: a file may grow while it is read.
        file.take(limit + 1).read_to_end(&mut bytes).map_err(&io)?;
    }
    if size.max(bytes.len() as u64) > limit {
        let what = format!("more than {} MiB, the most that is read", limit >> 20);
        return Err(Error::input(path, "", what, remedy));
    }
    Ok(bytes)
}

/// Allocates room for `size` bytes of a file, or of copies of it. A failed allocation is an error; it does not end the
/// process.
pub fn room(path: &Path, size: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if usize::try_from(size).is_ok_and(|size| bytes.try_reserve_exact(size).is_ok()) {
        return Ok(bytes);
    }
    let what = format!("{}: no memory for its {} MiB", path.display(), size.div_ceil(1 << 20));
    Err(Error::out_of_memory(what, "free memory, or use a smaller file"))
}

/// The paths in a folder, sorted by name.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    let mut paths: Vec<PathBuf> = entries.map_err(Error::io(folder, "read the folder"))?;
    paths.sort();
    Ok(paths)
}

/// Whether a name ends in `.extension`, in upper or lower case.
pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// Whether a path names a device or a pipe, such as a terminal, which is written to and not replaced. Windows knows no
/// metadata of `nul`, but opens it.
pub fn is_device(path: &Path) -> bool {
    match path.metadata() {
        Ok(metadata) => !metadata.is_file() && !metadata.is_dir(),
        Err(_) => cfg!(windows) && OpenOptions::new().write(true).open(path).is_ok(),
    }
}

/// Writes a file under a temporary name beside `path`, then renames it to `path`: the old content stays until the new
/// file is complete.
pub fn write_replacing(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    let io = Error::io(path, "write");
    let flushed = |file: File| {
        let mut out = BufWriter::new(file);
        write(&mut out)?;
        out.into_inner().map_err(io::IntoInnerError::into_error)
    };
    if is_device(path) {
        return OpenOptions::new().write(true).open(path).and_then(flushed).map(drop).map_err(io);
    }
    // A symbolic link stays one: what it names is written, whether it is there or not.
    let mut place = path.to_path_buf();
    for _ in 0..40 {
        let Ok(to) = place.read_link() else { break };
        place.set_file_name(to);
    }
    let path = &place;
    let part = part_of(path);
    let write = || {
        unfinished().insert(part.clone());
        let file = File::create_new(&part)?;
        if let Ok(old) = path.metadata() {
            // Without permission to write the old file, it must not be replaced either.
            OpenOptions::new().append(true).open(path)?;
            file.set_permissions(old.permissions())?;
        }
        flushed(file)?.sync_all()?;
        std::fs::rename(&part, path)
    };
    let written = write();
    unfinished().remove(&part);
    written.map_err(|source| {
        if source.kind() != io::ErrorKind::AlreadyExists {
            let _ = std::fs::remove_file(&part);
        }
        io(source)
    })
}

/// Temporary files and folders that are being written. A program that is interrupted removes them, and keeps the lock
/// until it ends, so that no further one is begun.
pub fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    static PATHS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    PATHS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary path beside `path` that is unique to this process and call.
fn part_of(path: &Path) -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let process = std::process::id();
    let name = path.file_name().unwrap_or_default().display();
    path.with_file_name(format!(".{name}.{process}-{count}.part"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn what_is_too_large_or_no_regular_file_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("big.obj");
        std::fs::write(&path, vec![b' '; 3 << 20]).unwrap();
        assert_eq!(read_bounded(&path, 3 << 20, "").unwrap().len(), 3 << 20);
        let cases = [
            (path.as_path(), "big.obj: more than 2 MiB, the most that is read; split it"),
            (dir.path(), ": a folder, where a regular file"),
            (Path::new("/dev/zero"), "/dev/zero: a pipe, socket or device"),
        ];
        for (path, text) in &cases[..if cfg!(unix) { 3 } else { 2 }] {
            let message = read_bounded(path, 2 << 20, "split it").unwrap_err().to_string();
            assert!(message.starts_with(&path.display().to_string()) && message.contains(text), "{message}");
        }
    }

    #[test]
    fn what_there_is_no_memory_for_is_an_error() {
        let error = room(Path::new("a/huge.dmorph"), u64::MAX).unwrap_err();
        assert!(matches!(error, Error::OutOfMemory { .. }));
        assert!(error.to_string().starts_with("a/huge.dmorph: "), "{error}");
    }

    #[test]
    fn a_file_is_replaced_at_once_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.dmorph");
        for bytes in [&b"first"[..], b"2"] {
            write_replacing(&path, |out| out.write_all(bytes)).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), bytes);
        }
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        crate::testing::says(
            write_replacing(&dir.path().join("no/b.dmorph"), |_| Ok(())),
            &["b.dmorph: cannot write", "check the path"],
        );
        assert!(write_replacing(dir.path(), |_| Ok(())).is_err());
        let full = |_: &mut BufWriter<File>| Err(io::ErrorKind::StorageFull.into());
        assert!(write_replacing(&path, full).unwrap_err().to_string().contains("a.dmorph: cannot write"));
        assert_eq!(std::fs::read(&path).unwrap(), b"2", "what was there stays");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
