//! Reading files of bounded size.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::Path;

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
