//! What a file is by its first bytes, where its name says something else.

use crate::error::{Error, Result};
use std::path::Path;

const EXPORT: &str = "export it as glTF or OBJ, and weights as CSV";
const UNPACK: &str = "unpack it, and give the file that is in it";
const DOWNLOAD: &str = "download or copy the file again";
const TRACKER: &str = "convert it to CSV: a header of target names, then a row of weights for each frame";

/// How files begin after white space, what they are, and what to do.
const BEGINNINGS: [(&[u8], &str, &str); 18] = [
    (b"", "an empty file", DOWNLOAD),
    (b"version https://git-lfs", "a Git LFS pointer", "fetch the file that it stands for: `git lfs pull`"),
    (b"<", "HTML or XML, such as the error page of a download", DOWNLOAD),
    (b"404: Not Found", "the error page of a download", DOWNLOAD),
    (b"{", "JSON", EXPORT),
    (b"[", "JSON", EXPORT),
    (b"glTF", "a glTF file", "name it .glb"),
    (b"DMORPH", "a packed mesh", "name it .dmorph"),
    (b"Kaydara FBX", "an FBX file", EXPORT),
    (b"; FBX", "an FBX file", EXPORT),
    (b"BLENDER", "a Blender file", EXPORT),
    (b"HIERARCHY", "a BVH recording, of joints", TRACKER),
    (b"\x1f\x8b", "compressed by gzip", UNPACK),
    (b"\x28\xb5\x2f\xfd", "compressed by Zstandard", UNPACK),
    (b"7z\xbc\xaf", "a 7z archive", UNPACK),
    (b"PK\x03\x04", "a ZIP archive, or a spreadsheet (.xlsx)", "unpack it, or save the sheet as CSV"),
    (b"\xff\xfe", "text in UTF-16", "save it in UTF-8"),
    (b"\xfe\xff", "text in UTF-16", "save it in UTF-8"),
];

/// What a file of these bytes is, and what to do; `None` if it does not look like another kind than those that are
/// read.
pub fn kind(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let start = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    let text = String::from_utf8_lossy(&start[..start.len().min(4096)]);
    if text.contains("|=head#") {
        return Some(("a recording of iFacialMocap", TRACKER));
    }
    if text.starts_with("info,") && text.contains("\nbs,") {
        return Some(("a recording of Face Cap", TRACKER));
    }
    let begins = |beginning: &[u8]| start.starts_with(beginning) && beginning.is_empty() == start.is_empty();
    let found = BEGINNINGS.iter().find(|(beginning, ..)| begins(beginning));
    found.map(|(_, what, remedy)| (*what, *remedy))
}

/// Refuses what is another kind of file than `expected`, if it is one that is known.
pub fn refuse_others(path: &Path, bytes: &[u8], expected: &str) -> Result<()> {
    let Some((what, remedy)) = kind(bytes).filter(|(what, _)| *what != expected) else { return Ok(()) };
    Err(Error::input(path, "", format!("{what}, where {expected} is expected"), remedy))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_other_kinds_are_named() {
        for (bytes, what) in [
            (&b"version https://git-lfs.github.com/spec/v1\noid sha256:0"[..], "a Git LFS pointer"),
            (b"\xef\xbb\xbf\r\n <!DOCTYPE html>", "HTML or XML"),
            (b" \n\t", "an empty file"),
            (b"\xff\xfev\0 \0", "text in UTF-16"),
            (b"PK\x03\x04", "a ZIP archive"),
            (b"\x1f\x8b\x08", "compressed by gzip"),
            (b"Kaydara FBX Binary  \0", "an FBX file"),
            (b"HIERARCHY\nROOT Hips", "a BVH recording"),
            (b"glTF\x02\0\0\0", "a glTF file"),
            (b"jawOpen-12|eyeBlink_L-3|=head#-21,0,0,0,0,0|\n", "a recording of iFacialMocap"),
            (b"info,1\nbs,jawOpen\nk,0,0.5\n", "a recording of Face Cap"),
        ] {
            assert!(kind(bytes).is_some_and(|(found, _)| found.starts_with(what)), "{what}: {:?}", kind(bytes));
        }
        for known in [&b"# a comment\nv 0 0 0\n"[..], b"info,jawOpen\n1,0.5\n", b"jawOpen,a|b\n0,1\n"] {
            assert_eq!(kind(known), None);
        }
    }
}
