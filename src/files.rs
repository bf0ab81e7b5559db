//! Reading files of bounded size.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The bytes of a file of at most `limit` bytes; `remedy` is for one that is larger.
pub(crate) fn read_bounded(path: &Path, limit: u64, remedy: &str) -> Result<Vec<u8>> {
    let io = |source| Error::Io { path: path.to_path_buf(), action: "read", source };
    let file = File::open(path).map_err(io)?;
    let size = file.metadata().map_err(io)?.len();
    let mut bytes = Vec::new();
    if size <= limit {
        bytes.reserve_exact(size as usize + 2);
        // The size is only a hint: a file may grow while it is read, and a pipe has none.
        file.take(limit + 1).read_to_end(&mut bytes).map_err(io)?;
    }
    if size.max(bytes.len() as u64) > limit {
        let what = format!("more than {} MiB, the most that is read", limit >> 20);
        return Err(Error::Input { path: path.to_path_buf(), place: String::new(), what, remedy: remedy.to_owned() });
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
}
