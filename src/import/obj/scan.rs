//! Checks the statements of an OBJ file, so that every error has a line number.
//!
//! tobj then gets what it can read: only `v`, `vt`, `vn` and `f` statements, each known to be good, on a line each. The
//! statements at which it would start a new model (`o`, `g`, `usemtl`) are left out, and so are comments in odd encodings
//! and vertex colours on some lines only.

use crate::error::{Error, Result};
use std::path::Path;

/// What the scan knows of a file.
pub(super) struct Scan {
    /// The statements for tobj.
    pub text: Vec<u8>,
    /// Number of `v`, `vt` and `vn` statements.
    pub counts: [usize; 3],
    /// Number of corners of all faces.
    pub corners: usize,
    /// Corners (counted over all faces) that name no texture coordinate.
    pub without_texcoord: Vec<u32>,
    /// Number of corners that name no normal.
    pub without_normal: usize,
}

const NAMES: [&str; 3] = ["vertex", "texture coordinate", "normal"];
const KEYWORDS: [&[u8]; 3] = [b"v", b"vt", b"vn"];
const EXPORT_AGAIN: &str = "export the file again";
const EXPORT_OBJ: &str = "export the mesh as Wavefront OBJ";
const WRITE_CORNERS: &str = "write corners as v, v/vt, v//vn or v/vt/vn";

/// Check `bytes` and keep what tobj needs. `path` is for messages.
pub(super) fn scan(path: &Path, mut bytes: Vec<u8>) -> Result<Scan> {
    if let Some(at) = bytes.iter().position(|&b| b == 0) {
        let what = format!("binary data (a zero byte at offset {at}), OBJ text expected");
        return Err(Error::input(path, "", what, EXPORT_OBJ));
    }
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes[..3].fill(b' ');
    }
    // Lines that end in CR alone, as old systems wrote them. Beside LF, a CR is white space.
    if !bytes.contains(&b'\n') {
        bytes.iter_mut().filter(|b| **b == b'\r').for_each(|b| *b = b'\n');
    }
    if bytes.contains(&b'\\') {
        bytes = join_lines(&bytes);
    }
    // Counted first: a face may name a vertex that is listed after it.
    let mut counts = [0; 3];
    for (keyword, _) in statements(&bytes) {
        KEYWORDS.iter().zip(&mut counts).for_each(|(k, count)| *count += usize::from(*k == keyword));
    }
    if counts[0] == 0 {
        let what = "no 'v' line: not an OBJ file, or one without vertices";
        return Err(Error::input(path, "", what, EXPORT_OBJ));
    }

    let text = Vec::with_capacity(bytes.len() + 1);
    let scan = Scan { text, counts, corners: 0, without_texcoord: Vec::new(), without_normal: 0 };
    let mut checker = Checker { path, line: 0, seen: [0; 3], scan };
    for (line, (keyword, rest)) in (1..).zip(statements(&bytes)) {
        checker.line = line;
        checker.statement(keyword, rest)?;
    }
    Ok(checker.scan)
}

/// A backslash at the end of a line joins it to the next one. The line breaks come after what is joined, so that the lines
/// that follow keep their numbers.
fn join_lines(bytes: &[u8]) -> Vec<u8> {
    let mut joined = Vec::with_capacity(bytes.len());
    let mut breaks = 0;
    for line in bytes.split_inclusive(|&b| b == b'\n') {
        // A comment ends with its line: a Windows path in one may well end in a backslash.
        let comment = breaks == 0 && line.trim_ascii_start().starts_with(b"#");
        let end = line.strip_suffix(b"\\\n").or_else(|| line.strip_suffix(b"\\\r\n"));
        match end.filter(|_| !comment) {
            Some(part) => {
                joined.extend_from_slice(part);
                joined.push(b' ');
                breaks += 1;
            }
            None => {
                joined.extend_from_slice(line);
                joined.resize(joined.len() + std::mem::take(&mut breaks), b'\n');
            }
        }
    }
    joined
}

/// The statements, one of each line: its keyword and what follows it, without comments.
fn statements(bytes: &[u8]) -> impl Iterator<Item = (&[u8], &[u8])> {
    bytes.split(|&b| b == b'\n').map(|line| {
        let statement = line.split(|&b| b == b'#').next().unwrap_or_default().trim_ascii_start();
        statement.split_at(statement.iter().position(u8::is_ascii_whitespace).unwrap_or(statement.len()))
    })
}

/// Checks statements, and writes the good ones down.
struct Checker<'a> {
    path: &'a Path,
    /// Where the statement starts.
    line: usize,
    /// `v`, `vt` and `vn` statements so far: what a negative index counts back from.
    seen: [usize; 3],
    scan: Scan,
}

impl Checker<'_> {
    fn error(&self, what: impl Into<String>, remedy: &str) -> Error {
        Error::input(self.path, format!(": line {}", self.line), what, remedy)
    }

    fn statement(&mut self, keyword: &[u8], rest: &[u8]) -> Result<()> {
        let kind = KEYWORDS.iter().position(|k| *k == keyword);
        if kind.is_none() && keyword != b"f" {
            return Ok(());
        }
        let text = std::str::from_utf8(rest).map_err(|_| self.error("bytes that are not UTF-8 text", EXPORT_AGAIN))?;
        let kept = match kind {
            Some(0) => self.vertex(text)?,
            Some(1) => self.numbers::<2>(1, &mut text.split_whitespace()).map(|_| text)?,
            Some(_) => self.numbers::<3>(2, &mut text.split_whitespace()).map(|_| text)?,
            None => self.face(text)?,
        };
        kind.into_iter().for_each(|k| self.seen[k] += 1);
        for part in [keyword, kept.as_bytes(), b"\n"] {
            self.scan.text.extend_from_slice(part);
        }
        Ok(())
    }

    fn number(&self, word: &str) -> Result<f32> {
        match word.parse::<f32>() {
            Ok(x) if x.is_finite() => Ok(x),
            Ok(_) => {
                let what = format!("'{word}' is not a finite number of single precision");
                Err(self.error(what, "repair the mesh and export it again"))
            }
            Err(_) => Err(self.error(format!("'{}' is not a number", short(word)), EXPORT_AGAIN)),
        }
    }

    /// The `N` numbers that a statement begins with.
    fn numbers<'t, const N: usize>(&self, kind: usize, words: &mut impl Iterator<Item = &'t str>) -> Result<[f32; N]> {
        let mut numbers = [0.0; N];
        for (i, x) in numbers.iter_mut().enumerate() {
            let missing = || self.error(format!("a {} with {i} numbers, {N} expected", NAMES[kind]), EXPORT_AGAIN);
            *x = self.number(words.next().ok_or_else(missing)?)?;
        }
        Ok(numbers)
    }

    /// `x y z [w]` or `x y z r g b [a]`, of which the colour is not kept.
    fn vertex<'t>(&self, text: &'t str) -> Result<&'t str> {
        let mut words = text.split_whitespace();
        let xyz = self.numbers::<3>(0, &mut words)?;
        let more: Vec<&str> = words.take(5).collect();
        match more[..] {
            [] => Ok(text),
            [w] => {
                let w = self.number(w)?;
                let what = || format!("the weight {w} takes the vertex to infinity");
                let finite = xyz.iter().all(|x| (x / w).is_finite());
                finite.then_some(text).ok_or_else(|| self.error(what(), "remove the fourth number"))
            }
            [red, _, _] | [red, _, _, _] => Ok(&text[..red.as_ptr() as usize - text.as_ptr() as usize]),
            _ => {
                let n = if more.len() == 5 { "more than 7".to_owned() } else { (3 + more.len()).to_string() };
                let what = format!("a vertex with {n} numbers, 3 expected (or 4 with a weight, 6 with a colour)");
                Err(self.error(what, EXPORT_AGAIN))
            }
        }
    }

    fn face<'t>(&mut self, text: &'t str) -> Result<&'t str> {
        let before = self.scan.corners;
        text.split_whitespace().try_for_each(|word| self.corner(word))?;
        let size = self.scan.corners - before;
        let what = || format!("a face with {size} corners, at least 3 expected");
        let enough = (size >= 3).then_some(text);
        enough.ok_or_else(|| self.error(what(), "remove it, or write points and lines as 'p' and 'l'"))
    }

    fn corner(&mut self, word: &str) -> Result<()> {
        let mut named = [false; 3];
        let refuse = |what: &str| Err(self.error(format!("'{}' {what}", short(word)), WRITE_CORNERS));
        for (k, part) in word.split('/').enumerate() {
            if k == 3 {
                return refuse("has more than three indices");
            }
            if part.is_empty() {
                continue;
            }
            let Ok(index) = part.parse::<i64>() else { return refuse("is not a corner of a face") };
            // A positive index may look ahead; a negative one counts back from this line.
            let limit = if index < 0 { self.seen[k] } else { self.scan.counts[k] } as u64;
            if index == 0 || index.unsigned_abs() > limit {
                let (name, keyword) = (NAMES[k], ["v", "vt", "vn"][k]);
                let what = match index {
                    0 => format!("{name} index 0, but OBJ counts from 1"),
                    1.. => format!("{name} index {index}, but the file has {limit} '{keyword}' lines"),
                    _ => format!("{name} index {index}, but only {limit} '{keyword}' lines come before it"),
                };
                return Err(self.error(what, EXPORT_AGAIN));
            }
            named[k] = true;
        }
        if !named[0] {
            return refuse("names no vertex");
        }
        let corner = u32::try_from(self.scan.corners)
            .map_err(|_| self.error("more than 4,294,967,295 face corners", "split the mesh"))?;
        if !named[1] && self.scan.counts[1] > 0 {
            self.scan.without_texcoord.push(corner);
        }
        self.scan.without_normal += usize::from(!named[2]);
        self.scan.corners += 1;
        Ok(())
    }
}

/// A word of the file, cut to a length that fits a message.
fn short(word: &str) -> String {
    match word.char_indices().nth(40) {
        Some((at, _)) => format!("{}…", &word[..at]),
        None => word.to_owned(),
    }
}
