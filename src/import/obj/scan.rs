//! The first look at an OBJ file: every line is checked here, so that every complaint has a line number.
//!
//! What is left is the text that tobj gets: only `v`, `vt`, `vn` and `f` lines, each known to be good. The
//! statements at which tobj would start a new model (`o`, `g`, `usemtl`) are gone, and so is what it would choke
//! on (comments in odd encodings, vertex colours on some lines only).

use super::input;
use crate::error::{Error, Result};
use std::path::Path;

/// What the scan knows of a file.
pub(super) struct Scan {
    /// The lines for tobj.
    pub text: Vec<u8>,
    /// Number of `v`, `vt` and `vn` lines.
    pub counts: [usize; 3],
    /// Number of corners of all faces.
    pub corners: usize,
    /// Corners (counted over all faces) that name no texture coordinate.
    pub without_texcoord: Vec<u32>,
    /// Number of corners that name no normal.
    pub without_normal: usize,
}

const NAMES: [&str; 3] = ["vertex", "texture coordinate", "normal"];
const KEYWORDS: [&str; 3] = ["v", "vt", "vn"];

/// One statement: where it lies in the buffer, and the line it starts on.
struct Statement {
    start: usize,
    end: usize,
    line: usize,
}

/// Cuts the buffer into statements.
struct Statements<'a> {
    at: usize,
    line: usize,
    /// Where line breaks were, see [`join_lines`].
    joins: &'a [usize],
}

impl<'a> Statements<'a> {
    fn new(joins: &'a [usize]) -> Self {
        Self { at: 0, line: 1, joins }
    }

    /// The buffer is handed in each time, since what was read is written over.
    fn next(&mut self, bytes: &[u8]) -> Option<Statement> {
        let rest = bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        let statement = Statement { start: self.at, end: self.at + length, line: self.line };
        self.at = statement.end + 1;
        let joined = self.joins.partition_point(|&j| j < self.at);
        self.joins = &self.joins[joined..];
        self.line += 1 + joined;
        Some(statement)
    }
}

/// A backslash at the end of a line joins it to the next one: overwrite both characters with spaces, and return
/// where the line breaks were, for the line numbers.
fn join_lines(bytes: &mut [u8]) -> Vec<usize> {
    let mut joins = Vec::new();
    let mut comment = None;
    for i in 0..bytes.len() {
        match bytes[i] {
            b'\n' => {
                let end = if i > 0 && bytes[i - 1] == b'\r' { i - 1 } else { i };
                // A comment ends with its line: a Windows path in one may well end in a backslash. The last
                // line break is our own, and has no line after it.
                if end > 0 && bytes[end - 1] == b'\\' && comment != Some(true) && i + 1 < bytes.len() {
                    bytes[end - 1..=i].fill(b' ');
                    joins.push(i);
                } else {
                    comment = None;
                }
            }
            b if !b.is_ascii_whitespace() => comment = comment.or(Some(b == b'#')),
            _ => {}
        }
    }
    joins
}

/// The keyword of a statement and what follows it, comment removed.
fn split(statement: &[u8]) -> (&[u8], &[u8]) {
    let statement = statement.trim_ascii_start();
    let statement = &statement[..statement.iter().position(|&b| b == b'#').unwrap_or(statement.len())];
    statement.split_at(statement.iter().position(u8::is_ascii_whitespace).unwrap_or(statement.len()))
}

/// Check `bytes` and keep what tobj needs. `path` is for messages.
pub(super) fn scan(path: &Path, mut bytes: Vec<u8>) -> Result<Scan> {
    if let Some(at) = bytes.iter().position(|&b| b == 0) {
        return Err(input(
            path,
            "",
            format!("binary data (a zero byte at offset {at}), OBJ text expected"),
            "export the mesh as Wavefront OBJ",
        ));
    }
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes[..3].fill(b' ');
    }
    // Lines that end in CR alone, as old systems wrote them. Beside LF, a CR is white space.
    if !bytes.contains(&b'\n') {
        bytes.iter_mut().filter(|b| **b == b'\r').for_each(|b| *b = b'\n');
    }
    bytes.push(b'\n');

    let joins = if bytes.contains(&b'\\') { join_lines(&mut bytes) } else { Vec::new() };
    let counts = count(&bytes, &joins);
    if counts[0] == 0 {
        return Err(input(
            path,
            "",
            "no 'v' line: not an OBJ file, or one without vertices",
            "export the mesh as Wavefront OBJ",
        ));
    }

    let mut checker =
        Checker { path, totals: counts, seen: [0; 3], corners: 0, without_texcoord: Vec::new(), without_normal: 0 };
    let mut statements = Statements::new(&joins);
    let mut written = 0;
    while let Some(s) = statements.next(&bytes) {
        let (keyword, rest) = split(&bytes[s.start..s.end]);
        let (name, kept) = match keyword {
            b"v" => ("v", checker.vertex(rest, s.line)?),
            b"vt" => ("vt", checker.numbers(1, 2, rest, s.line)?),
            b"vn" => ("vn", checker.numbers(2, 3, rest, s.line)?),
            b"f" => ("f", checker.face(rest, s.line)?),
            _ => continue,
        };
        // Never longer than what was read: a statement is its keyword, `kept` bytes and one line end.
        let from = s.start + (rest.as_ptr() as usize - bytes[s.start..].as_ptr() as usize);
        bytes[written..written + name.len()].copy_from_slice(name.as_bytes());
        written += name.len();
        bytes.copy_within(from..from + kept, written);
        written += kept;
        bytes[written] = b'\n';
        written += 1;
    }
    bytes.truncate(written);
    let Checker { corners, without_texcoord, without_normal, .. } = checker;
    Ok(Scan { text: bytes, counts, corners, without_texcoord, without_normal })
}

/// Number of `v`, `vt` and `vn` statements: a face may name a vertex that is listed after it.
fn count(bytes: &[u8], joins: &[usize]) -> [usize; 3] {
    let mut counts = [0; 3];
    let mut statements = Statements::new(joins);
    while let Some(s) = statements.next(bytes) {
        let (keyword, _) = split(&bytes[s.start..s.end]);
        if let Some(k) = KEYWORDS.iter().position(|k| k.as_bytes() == keyword) {
            counts[k] += 1;
        }
    }
    counts
}

/// Checks statements; what it returns is how many bytes of each to keep.
struct Checker<'a> {
    path: &'a Path,
    /// `v`, `vt`, `vn` lines in the whole file.
    totals: [usize; 3],
    /// Those seen so far: what a negative index counts back from.
    seen: [usize; 3],
    corners: usize,
    without_texcoord: Vec<u32>,
    without_normal: usize,
}

impl Checker<'_> {
    fn error(&self, line: usize, what: String, remedy: &str) -> Error {
        input(self.path, format!(": line {line}"), what, remedy)
    }

    fn text<'t>(&self, bytes: &'t [u8], line: usize) -> Result<&'t str> {
        std::str::from_utf8(bytes)
            .map_err(|_| self.error(line, "bytes that are not UTF-8 text".into(), "export the file again"))
    }

    fn number(&self, word: &str, line: usize) -> Result<f32> {
        match word.parse::<f32>() {
            Ok(x) if x.is_finite() => Ok(x),
            Ok(_) => Err(self.error(
                line,
                format!("'{word}' is not a finite number of single precision"),
                "repair the mesh and export it again",
            )),
            Err(_) => Err(self.error(line, format!("'{}' is not a number", short(word)), "export the file again")),
        }
    }

    /// `v x y z [w]` or `v x y z r g b [a]`, of which the colour is not kept.
    fn vertex(&mut self, rest: &[u8], line: usize) -> Result<usize> {
        let text = self.text(rest, line)?;
        let mut words = text.split_whitespace();
        let mut xyz = [0.0; 3];
        let mut kept = 0;
        for (i, x) in xyz.iter_mut().enumerate() {
            let Some(word) = words.next() else {
                let what = format!("a vertex with {i} numbers, 3 expected");
                return Err(self.error(line, what, "export the file again"));
            };
            *x = self.number(word, line)?;
            kept = word.as_ptr() as usize - text.as_ptr() as usize + word.len();
        }
        let more: Vec<&str> = words.by_ref().take(5).collect();
        match more.len() {
            0 | 3 | 4 => {}
            1 => {
                let w = self.number(more[0], line)?;
                if !xyz.iter().all(|x| (x / w).is_finite()) {
                    let what = format!("the weight {w} takes the vertex to infinity");
                    return Err(self.error(line, what, "remove the fourth number"));
                }
                kept = rest.len();
            }
            n => {
                let n = if n == 5 { "more than 7".to_owned() } else { (3 + n).to_string() };
                let what = format!("a vertex with {n} numbers, 3 expected (or 4 with a weight, 6 with a colour)");
                return Err(self.error(line, what, "export the file again"));
            }
        }
        self.seen[0] += 1;
        Ok(kept)
    }

    /// A `vt` or `vn` line of at least `n` numbers.
    fn numbers(&mut self, kind: usize, n: usize, rest: &[u8], line: usize) -> Result<usize> {
        let text = self.text(rest, line)?;
        let mut words = text.split_whitespace();
        for i in 0..n {
            let Some(word) = words.next() else {
                let what = format!("a {} with {i} numbers, {n} expected", NAMES[kind]);
                return Err(self.error(line, what, "export the file again"));
            };
            self.number(word, line)?;
        }
        self.seen[kind] += 1;
        Ok(rest.len())
    }

    fn face(&mut self, rest: &[u8], line: usize) -> Result<usize> {
        let text = self.text(rest, line)?;
        let mut size = 0;
        for word in text.split_whitespace() {
            self.corner(word, line)?;
            size += 1;
        }
        if size < 3 {
            let what = format!("a face with {size} corners, at least 3 expected");
            return Err(self.error(line, what, "remove it, or write points and lines as 'p' and 'l'"));
        }
        Ok(rest.len())
    }

    fn corner(&mut self, word: &str, line: usize) -> Result<()> {
        let mut named = [false; 3];
        for (k, part) in word.split('/').enumerate() {
            if k == 3 {
                let what = format!("'{}' has more than three indices", short(word));
                return Err(self.error(line, what, "write corners as v, v/vt, v//vn or v/vt/vn"));
            }
            if part.is_empty() {
                continue;
            }
            let Ok(index) = part.parse::<i64>() else {
                let what = format!("'{}' is not a corner of a face", short(word));
                return Err(self.error(line, what, "write corners as v, v/vt, v//vn or v/vt/vn"));
            };
            // A positive index may look ahead; a negative one counts back from this line.
            let limit = if index < 0 { self.seen[k] } else { self.totals[k] } as u64;
            if index == 0 || index.unsigned_abs() > limit {
                let (name, keyword) = (NAMES[k], KEYWORDS[k]);
                let what = match index {
                    0 => format!("{name} index 0, but OBJ counts from 1"),
                    1.. => format!("{name} index {index}, but the file has {limit} '{keyword}' lines"),
                    _ => format!("{name} index {index}, but only {limit} '{keyword}' lines come before it"),
                };
                return Err(self.error(line, what, "export the file again"));
            }
            named[k] = true;
        }
        if !named[0] {
            let what = format!("'{}' names no vertex", short(word));
            return Err(self.error(line, what, "write corners as v, v/vt, v//vn or v/vt/vn"));
        }
        let corner = u32::try_from(self.corners)
            .map_err(|_| self.error(line, "more than 4,294,967,295 face corners".into(), "split the mesh"))?;
        if !named[1] && self.totals[1] > 0 {
            self.without_texcoord.push(corner);
        }
        self.without_normal += usize::from(!named[2]);
        self.corners += 1;
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
