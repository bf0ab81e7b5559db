//! Reads OBJ text into arrays, in the file's order.
//!
//! tobj reads the numbers of `v`, `vt` and `vn`, faces are read here: tobj has no line numbers, takes an index of 0 for a
//! missing one, and repeats texture coordinates where a corner has none. It also reads NaN as a number; where it refuses
//! numbers, or they are not finite, the lines are checked one by one.

use crate::asset::{Corner, Faces};
use crate::error::{Error, Result};
use crate::io::{TEXT_MAX, read_bounded};
use glam::{Vec2, Vec3};
use std::io::Write;
use std::path::Path;

/// The statements that list values.
const KEYWORDS: [&str; 3] = ["v", "vt", "vn"];
const NAMES: [&str; 3] = ["vertex", "texture coordinate", "normal"];
/// Numbers that each needs.
const SIZES: [usize; 3] = [3, 2, 3];

const EXPORT_AGAIN: &str = "export the file again";
const EXPORT_OBJ: &str = "export the mesh as Wavefront OBJ";
const WRITE_CORNERS: &str = "write corners as v, v/vt, v//vn or v/vt/vn";

/// One OBJ file, in the file's own order.
#[derive(Clone, Debug, Default)]
pub struct ObjFile {
    /// The `v` lines.
    pub positions: Vec<Vec3>,
    /// The `vt` lines; a third coordinate is ignored.
    pub texcoords: Vec<Vec2>,
    /// The `vn` lines, as stated.
    pub normals: Vec<Vec3>,
    /// The `f` lines, in file order, whatever object, group or material they belong to.
    pub faces: Faces,
    /// Index into `normals` of each corner of `faces`; `None` unless every corner has one.
    pub corner_normals: Option<Vec<u32>>,
    /// Whether some corners of the faces have a normal; with `corner_normals: None`, only some of them.
    pub any_normals: bool,
}

impl ObjFile {
    /// Reads one OBJ file.
    ///
    /// Polygons stay polygons, vertices stay in file order, and vertices without a face are kept. Points and lines
    /// (`p`, `l`), vertex colours, free-form surfaces, groups and materials are ignored. Lines end in LF or CR LF, or
    /// all of them in CR.
    ///
    /// Takes 300 bytes of memory at most for each byte of the file, and 1 MiB, whatever it counts.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::Input`] with the line if its text cannot be used, or if it is
    /// larger than 1 GiB; [`Error::OutOfMemory`].
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_bytes(path, read_bounded(path, TEXT_MAX, "split the mesh")?)
    }

    /// Reads one OBJ file from text in memory, like [`read`](Self::read); `path` is only for messages.
    ///
    /// # Errors
    /// [`Error::Input`] with the line if the text cannot be used; [`Error::OutOfMemory`].
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self> {
        let bytes = prepared(path, bytes)?;
        let Scan { text, counts, faces, corner_normals, without_normal, .. } = Scan::new(path, &bytes)?;
        let Some([positions, texcoords, normals]) = values(&text, counts) else {
            return Err(refused_number(path, &bytes));
        };
        let any_normals = without_normal < faces.corners.len();
        Ok(Self {
            positions: positions.as_chunks().0.iter().copied().map(Vec3::from_array).collect(),
            texcoords: texcoords.as_chunks().0.iter().copied().map(Vec2::from_array).collect(),
            normals: normals.as_chunks().0.iter().copied().map(Vec3::from_array).collect(),
            corner_normals: (any_normals && without_normal == 0).then_some(corner_normals),
            any_normals,
            faces,
        })
    }
}

/// The text in lines that end in LF, each with a whole statement.
fn prepared(path: &Path, mut bytes: Vec<u8>) -> Result<Vec<u8>> {
    if let Some(at) = bytes.iter().position(|&b| b == 0) {
        let what = format!("binary data (a zero byte at offset {at}), OBJ text expected");
        return Err(Error::input(path, "", what, EXPORT_OBJ));
    }
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes[..3].fill(b' ');
    }
    // Lines that end in CR alone, as on old systems. Beside LF, a CR counts as white space.
    if !bytes.contains(&b'\n') {
        bytes.iter_mut().filter(|b| **b == b'\r').for_each(|b| *b = b'\n');
    }
    Ok(if bytes.contains(&b'\\') { join_lines(&bytes) } else { bytes })
}

/// The numbers of the `v`, `vt` and `vn` statements in `text`, by tobj; `None` where one is refused or not finite.
fn values(text: &[u8], counts: [usize; 3]) -> Option<[Vec<f32>; 3]> {
    let options = tobj::LoadOptions::default();
    let (mut models, _) = tobj::load_obj_buf(&mut &*text, &options, |_| Ok(Default::default())).ok()?;
    let mesh = models.pop()?.mesh;
    let values = [mesh.positions, mesh.texcoords, mesh.normals];
    let [v, vt, vn] = counts;
    let is_complete = values.each_ref().map(Vec::len) == [3 * v, 2 * vt, 3 * vn];
    let is_finite = values.iter().flatten().all(|number| number.is_finite());
    (models.is_empty() && is_complete && is_finite).then_some(values)
}

/// The error for the first line with numbers that cannot be used.
fn refused_number(path: &Path, bytes: &[u8]) -> Error {
    for (line, (keyword, rest)) in (1..).zip(statements(bytes)) {
        let place = Line { path, line };
        let checked = kind_of(keyword).map_or(Ok(()), |kind| place.check_numbers(kind, rest));
        if let Err(error) = checked {
            return error;
        }
    }
    Error::input(path, "", "the parser lost numbers", "export the file again, with one statement on a line")
}

/// The line that a statement begins on.
#[derive(Clone, Copy)]
struct Line<'a> {
    path: &'a Path,
    line: usize,
}

impl Line<'_> {
    fn error(self, what: impl Into<String>, remedy: &str) -> Error {
        Error::input(self.path, format!(": line {}", self.line), what, remedy)
    }

    fn text(self, rest: &[u8]) -> Result<&str> {
        std::str::from_utf8(rest).map_err(|_| self.error("bytes that are not UTF-8 text", EXPORT_AGAIN))
    }

    fn number(self, word: &str) -> Result<f32> {
        let number = word.parse::<f32>();
        let number = number.map_err(|_| self.error(format!("'{}' is not a number", short(word)), EXPORT_AGAIN))?;
        let what = || format!("'{word}' is not a finite number of single precision");
        let finite = number.is_finite().then_some(number);
        finite.ok_or_else(|| self.error(what(), "repair the mesh and export it again"))
    }

    fn check_numbers(self, kind: usize, rest: &[u8]) -> Result<()> {
        let mut words = self.text(rest)?.split_whitespace();
        let expected = SIZES[kind];
        let mut numbers = vec![];
        for i in 0..expected {
            let missing =
                || self.error(format!("a {} with {i} numbers, {expected} expected", NAMES[kind]), EXPORT_AGAIN);
            numbers.push(self.number(words.next().ok_or_else(missing)?)?);
        }
        // The weight of `x y z w`; colours are not read.
        let more: Vec<&str> = words.take(2).collect();
        if let (0, [w]) = (kind, &more[..]) {
            let w = self.number(w)?;
            if !numbers.iter().all(|x| (x / w).is_finite()) {
                return Err(
                    self.error(format!("the weight {w} takes the vertex to infinity"), "remove the fourth number")
                );
            }
        }
        Ok(())
    }
}

/// Reads faces, and copies the other statements for tobj.
struct Scan<'a> {
    at: Line<'a>,
    /// The statements for tobj.
    text: Vec<u8>,
    /// Number of `v`, `vt` and `vn` statements.
    counts: [usize; 3],
    /// The numbers so far; a negative index counts back from them.
    seen: [usize; 3],
    faces: Faces,
    /// Index of the normal of each corner; 0 where it has none.
    corner_normals: Vec<u32>,
    /// Number of corners without a normal.
    without_normal: usize,
}

impl<'a> Scan<'a> {
    fn new(path: &'a Path, bytes: &[u8]) -> Result<Self> {
        // Counted in advance: a face may name a vertex that is listed after it.
        let mut counts = [0; 3];
        for (keyword, _) in statements(bytes) {
            kind_of(keyword).into_iter().for_each(|kind| counts[kind] += 1);
        }
        if counts[0] == 0 {
            let what = "no 'v' line: not an OBJ file, or one without vertices";
            return Err(Error::input(path, "", what, EXPORT_OBJ));
        }
        let mut scan = Self {
            at: Line { path, line: 0 },
            text: ordering_face(counts),
            counts,
            seen: [0; 3],
            faces: Faces::default(),
            corner_normals: vec![],
            without_normal: 0,
        };
        scan.text.reserve(bytes.len() + 1);
        for (line, (keyword, rest)) in (1..).zip(statements(bytes)) {
            scan.at.line = line;
            match kind_of(keyword) {
                Some(kind) => scan.values(kind, keyword, rest)?,
                None if keyword == b"f" => scan.face(rest)?,
                None => {}
            }
        }
        Ok(scan)
    }

    /// Copies a statement without what tobj may not read: colours that only some vertices have.
    fn values(&mut self, kind: usize, keyword: &[u8], rest: &[u8]) -> Result<()> {
        let text = self.at.text(rest)?;
        let words = if kind == 0 { text.split_whitespace().count() } else { 0 };
        let kept = match words {
            ..=4 => text.len(),
            6 | 7 => text.split_whitespace().nth(3).map_or(0, |red| red.as_ptr() as usize - text.as_ptr() as usize),
            n => {
                let what = format!("a vertex with {n} numbers, 3 expected (or 4 with a weight, 6 with a colour)");
                return Err(self.at.error(what, EXPORT_AGAIN));
            }
        };
        for part in [keyword, &text.as_bytes()[..kept], b"\n"] {
            self.text.extend_from_slice(part);
        }
        self.seen[kind] += 1;
        Ok(())
    }

    fn face(&mut self, rest: &[u8]) -> Result<()> {
        let before = self.faces.corners.len();
        for word in self.at.text(rest)?.split_whitespace() {
            self.corner(word)?;
        }
        let size = self.faces.corners.len() - before;
        if size < 3 {
            let what = format!("a face with {size} corners, at least 3 expected");
            return Err(self.at.error(what, "remove it, or write points and lines as 'p' and 'l'"));
        }
        // `corner` counts all of them in 32 bits.
        self.faces.sizes.push(size as u32);
        Ok(())
    }

    fn corner(&mut self, word: &str) -> Result<()> {
        let mut named = [None; 3];
        let refuse = |what: &str| Err(self.at.error(format!("'{}' {what}", short(word)), WRITE_CORNERS));
        for (k, part) in word.split('/').enumerate() {
            if k == 3 {
                return refuse("has more than three indices");
            }
            if part.is_empty() {
                continue;
            }
            let Ok(index) = part.parse::<i64>() else { return refuse("is not a corner of a face") };
            // A positive index may refer to later lines; a negative one counts back from this line.
            let limit = if index < 0 { self.seen[k] } else { self.counts[k] } as u64;
            if index == 0 || index.unsigned_abs() > limit {
                let name = NAMES[k];
                let keyword = KEYWORDS[k];
                let what = match index {
                    0 => format!("{name} index 0, but OBJ counts from 1"),
                    1.. => format!("{name} index {index}, but the file has {limit} '{keyword}' lines"),
                    _ => format!("{name} index {index}, but only {limit} '{keyword}' lines come before it"),
                };
                return Err(self.at.error(what, EXPORT_AGAIN));
            }
            let from_0 = if index < 0 { limit - index.unsigned_abs() } else { index.unsigned_abs() - 1 };
            // Files are too small for 2^32 lines of a keyword.
            named[k] = Some(from_0 as u32);
        }
        let [Some(position), texcoord, normal] = named else { return refuse("names no vertex") };
        if u32::try_from(self.faces.corners.len()).is_err() {
            return Err(self.at.error("more than 4,294,967,295 face corners", "split the mesh"));
        }
        self.faces.corners.push(Corner { position, texcoord });
        self.corner_normals.push(normal.unwrap_or(0));
        self.without_normal += usize::from(normal.is_none());
        Ok(())
    }
}

/// Makes the one face that tobj gets, whose corners name every vertex, texture coordinate and normal in file order.
///
/// tobj numbers all three by first use and drops those that no face uses. With this face, the order of first use is the
/// order of the file.
fn ordering_face(counts: [usize; 3]) -> Vec<u8> {
    let corners = counts.into_iter().max().unwrap_or(0);
    let mut line = Vec::with_capacity(corners * 24 + 2);
    line.push(b'f');
    for i in 1..=corners {
        for (separator, n) in [b' ', b'/', b'/'].into_iter().zip(counts) {
            line.push(separator);
            if n > 0 {
                // Writing to memory cannot fail.
                let _ = write!(line, "{}", i.min(n));
            }
        }
    }
    line.push(b'\n');
    line
}

/// Joins lines that end with a backslash to the next one. The line breaks move behind the joined line, so that later
/// lines keep their numbers.
fn join_lines(bytes: &[u8]) -> Vec<u8> {
    let mut joined = Vec::with_capacity(bytes.len());
    let mut breaks = 0;
    for line in bytes.split_inclusive(|&b| b == b'\n') {
        // A comment ends with its line: a Windows path in a comment may end with a backslash.
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

/// Iterates over the statements, one per line: the keyword, and the text after it without comments.
fn statements(bytes: &[u8]) -> impl Iterator<Item = (&[u8], &[u8])> {
    bytes.split(|&b| b == b'\n').map(|line| {
        let statement = line.split(|&b| b == b'#').next().unwrap_or_default().trim_ascii_start();
        statement.split_at(statement.iter().position(u8::is_ascii_whitespace).unwrap_or(statement.len()))
    })
}

/// Returns the kind of values that a statement lists, as an index into [`KEYWORDS`] and [`NAMES`].
fn kind_of(keyword: &[u8]) -> Option<usize> {
    KEYWORDS.iter().position(|k| k.as_bytes() == keyword)
}

/// Cuts a word of the file to a length that fits a message.
fn short(word: &str) -> String {
    match word.char_indices().nth(40) {
        Some((at, _)) => format!("{}…", &word[..at]),
        None => word.to_owned(),
    }
}
