//! Reading files of bounded size, and replacing files at once.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// The bytes of a regular file of at most `limit` bytes; `remedy` is for one that is larger.
pub(crate) fn read_bounded(path: &Path, limit: u64, remedy: &str) -> Result<Vec<u8>> {
    let io = |source| Error::Io { path: path.to_path_buf(), action: "read", source };
    let input = |what: String, remedy: &str| Error::Input {
        path: path.to_path_buf(),
        place: String::new(),
        what,
        remedy: remedy.to_owned(),
    };
    // Looked at before it is opened: opening a pipe that nobody writes to waits for ever.
    let kind = std::fs::metadata(path).map_err(io)?;
    if !kind.is_file() {
        let kind = if kind.is_dir() { "a folder" } else { "a pipe, socket or device" };
        return Err(input(format!("{kind}, where a regular file is expected"), "give the path of a regular file"));
    }
    let file = File::open(path).map_err(io)?;
    let size = file.metadata().map_err(io)?.len();
    let mut bytes = Vec::new();
    if size <= limit {
        bytes.reserve_exact(size as usize + 2);
        // The size is only a hint: a file may grow while it is read.
        file.take(limit + 1).read_to_end(&mut bytes).map_err(io)?;
    }
    if size.max(bytes.len() as u64) > limit {
        let what = format!("more than {} MiB, the most that is read", limit >> 20);
        return Err(input(what, remedy));
    }
    Ok(bytes)
}

/// Write `bytes` beside `path`, and then in its place: a full disk leaves the old file as it was.
pub(crate) fn write_replacing(path: &Path, bytes: &[u8]) -> Result<()> {
    let io = |source| Error::Io { path: path.to_path_buf(), action: "write", source };
    // A pipe or a terminal has no place to take.
    if path.metadata().is_ok_and(|m| !m.is_file()) {
        return std::fs::write(path, bytes).map_err(io);
    }
    let mut part = path.to_path_buf().into_os_string();
    part.push(".part");
    let part = PathBuf::from(part);
    let write = || {
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    write().map_err(|source| {
        let _ = std::fs::remove_file(&part);
        io(source)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_above_the_limit_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("big.obj");
        std::fs::write(&path, vec![b' '; 3 << 20]).unwrap();
        let message = read_bounded(&path, 2 << 20, "split it").unwrap_err().to_string();
        assert!(message.contains("big.obj") && message.contains("2 MiB") && message.contains("split it"), "{message}");
        assert_eq!(read_bounded(&path, 3 << 20, "").unwrap().len(), 3 << 20);
    }

    #[test]
    fn a_file_is_replaced_at_once_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.dmorph");
        for bytes in [&b"first"[..], b"2"] {
            write_replacing(&path, bytes).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), bytes);
        }
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        let message = write_replacing(&dir.path().join("no/b.dmorph"), b"").unwrap_err().to_string();
        assert!(message.contains("b.dmorph: cannot write") && message.contains("check the path"), "{message}");
        assert!(write_replacing(dir.path(), b"").is_err());
    }

    #[test]
    fn what_is_no_regular_file_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let message = read_bounded(dir.path(), 1, "").unwrap_err().to_string();
        let path = dir.path().display().to_string();
        assert!(message.starts_with(&path) && message.contains("a folder, where a regular file"), "{message}");
        #[cfg(unix)]
        {
            let message = read_bounded(Path::new("/dev/zero"), 1, "").unwrap_err().to_string();
            assert!(message.contains("/dev/zero: a pipe, socket or device"), "{message}");
        }
    }
}
