//! Reads OBJ text into arrays, in the file's order.
//!
//! Crates that read OBJ number vertices anew, have no line numbers in errors, and refuse a file for one bad normal.

use crate::asset::{Corner, Faces};
use crate::error::{Error, Result, ensure};
use crate::io::{TEXT_MAX, read_bounded};
use glam::{Vec2, Vec3};
use std::path::Path;

/// The statements that list values.
const KEYWORDS: [&str; 3] = ["v", "vt", "vn"];
const NAMES: [&str; 3] = ["vertex", "texture coordinate", "normal"];

const EXPORT_AGAIN: &str = "export the file again";
const EXPORT_OBJ: &str = "export the mesh as Wavefront OBJ";
const WRITE_CORNERS: &str = "write corners as v, v/vt, v//vn or v/vt/vn";

/// One OBJ file, in the file's own order.
#[derive(Clone, Debug, Default)]
pub struct ObjFile {
    /// The `v` lines.
    pub positions: Vec<Vec3>,
    /// The `vt` lines: a second coordinate that is not there is 0, a third is ignored. Zero where a line has no finite
    /// numbers.
    pub texcoords: Vec<Vec2>,
    /// The `vn` lines, as stated; zero where a line has no finite numbers.
    pub normals: Vec<Vec3>,
    /// The `f` lines, in file order, whatever object, group or material they belong to.
    pub faces: Faces,
    /// Index into `normals` of each corner of `faces`; `None` unless every corner has one.
    pub corner_normals: Option<Vec<u32>>,
    /// Whether some corners of the faces have a normal; with `corner_normals: None`, only some of them.
    pub any_normals: bool,
    /// What was left out, for a person to see.
    pub notes: Vec<String>,
}

impl ObjFile {
    /// Reads one OBJ file.
    ///
    /// Polygons stay polygons, vertices stay in file order, and vertices without a face are kept. Points and lines
    /// (`p`, `l`), vertex colours, free-form surfaces, groups and materials are ignored. Lines end in LF or CR LF, or
    /// all of them in CR. Faces of fewer than three corners are left out, with a note. So are texture coordinates and
    /// normals of corners that name 0, or more than the file has, and texture coordinates that are not finite.
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
        // Counted in advance: a face may name a vertex that is listed after it.
        let mut counts = [0; 3];
        for (keyword, _) in statements(&bytes) {
            let kind = KEYWORDS.iter().position(|k| k.as_bytes() == keyword);
            kind.into_iter().for_each(|kind| counts[kind] += 1);
        }
        let what = "no 'v' line: not an OBJ file, or one without vertices";
        ensure!(counts[0] > 0, Error::input(path, "", what, EXPORT_OBJ));
        let file = Self::default();
        let mut scan = Scan { path, line: 0, counts, file, corner_normals: vec![], lost: 0, thin: 0 };
        for (line, (keyword, rest)) in (1..).zip(statements(&bytes)) {
            scan.line = line;
            match keyword {
                b"v" => scan.position(rest)?,
                b"vt" => {
                    let texcoord = scan.numbers(1, 1, scan.text(rest)?.split_whitespace())?;
                    scan.file.texcoords.push(Vec2::from_array(texcoord));
                }
                b"vn" => {
                    let normal = Vec3::from_array(scan.numbers(2, 3, scan.text(rest)?.split_whitespace())?);
                    scan.file.normals.push(if normal.is_finite() { normal } else { Vec3::ZERO });
                }
                b"f" => scan.face(rest)?,
                _ => {}
            }
        }
        Ok(scan.finish())
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

/// Reads statements, one after another.
struct Scan<'a> {
    path: &'a Path,
    /// The line that the statement begins on.
    line: usize,
    /// Number of `v`, `vt` and `vn` statements.
    counts: [usize; 3],
    file: ObjFile,
    /// Index of the normal of each corner; `u32::MAX` where it has none.
    corner_normals: Vec<u32>,
    /// Number of texture coordinates and normals that corners name, and that there are not.
    lost: usize,
    /// Number of faces of fewer than three corners.
    thin: usize,
}

impl Scan<'_> {
    fn error(&self, what: impl Into<String>, remedy: &str) -> Error {
        Error::input(self.path, format!(": line {}", self.line), what, remedy)
    }

    fn text<'t>(&self, rest: &'t [u8]) -> Result<&'t str> {
        std::str::from_utf8(rest).map_err(|_| self.error("bytes that are not UTF-8 text", EXPORT_AGAIN))
    }

    fn number(&self, word: &str) -> Result<f32> {
        // As programs on Windows write it: 1.#QNAN, 1.#INF, nan(ind).
        let is_nan = || word.contains(".#") || word.contains("nan(");
        let number = word.parse().ok().or_else(|| is_nan().then_some(f32::NAN));
        let remedy =
            if word.contains(',') { "write numbers with a point, and spaces between them" } else { EXPORT_AGAIN };
        number.ok_or_else(|| self.error(format!("'{}' is not a number", short(word)), remedy))
    }

    /// The first `N` numbers of a statement; those that it may leave out, after the first `least`, are 0.
    fn numbers<'t, const N: usize>(
        &self,
        kind: usize,
        least: usize,
        mut words: impl Iterator<Item = &'t str>,
    ) -> Result<[f32; N]> {
        let mut numbers = [0.0; N];
        for (i, number) in numbers.iter_mut().enumerate() {
            let word = words.next();
            let what = || format!("a {} with {i} numbers, {least} expected", NAMES[kind]);
            ensure!(word.is_some() || i >= least, self.error(what(), EXPORT_AGAIN));
            *number = word.map_or(Ok(0.0), |word| self.number(word))?;
        }
        Ok(numbers)
    }

    fn position(&mut self, rest: &[u8]) -> Result<()> {
        let text = self.text(rest)?;
        let mut words = text.split_whitespace();
        let stated = Vec3::from_array(self.numbers(0, 3, &mut words)?);
        // One more number is a weight, several are a colour.
        let position = match words.next() {
            Some(weight) if words.next().is_none() => stated / self.number(weight)?,
            _ => stated,
        };
        let what = || format!("the vertex '{}' is not one of finite numbers of single precision", short(text.trim()));
        ensure!(position.is_finite(), self.error(what(), "repair the mesh and export it again"));
        self.file.positions.push(position);
        Ok(())
    }

    fn face(&mut self, rest: &[u8]) -> Result<()> {
        let before = self.file.faces.corners.len();
        for word in self.text(rest)?.split_whitespace() {
            let [position, texcoord, normal] = self.corner(word)?;
            let Some(position) = position else {
                return Err(self.error(format!("'{}' names no vertex", short(word)), WRITE_CORNERS));
            };
            let has_room = u32::try_from(self.file.faces.corners.len()).is_ok();
            ensure!(has_room, self.error("more than 4,294,967,295 face corners", "split the mesh"));
            self.file.faces.corners.push(Corner { position, texcoord });
            self.corner_normals.push(normal.unwrap_or(u32::MAX));
        }
        match self.file.faces.corners.len() - before {
            ..3 => {
                self.file.faces.corners.truncate(before);
                self.corner_normals.truncate(before);
                self.thin += 1;
            }
            // All corners are counted in 32 bits.
            size => self.file.faces.sizes.push(size as u32),
        }
        Ok(())
    }

    /// The vertex, texture coordinate and normal that a corner names.
    fn corner(&mut self, word: &str) -> Result<[Option<u32>; 3]> {
        let mut named = [None; 3];
        // A positive index may refer to later lines; a negative one counts back from this line.
        let seen = [self.file.positions.len(), self.file.texcoords.len(), self.file.normals.len()];
        for (k, part) in word.split('/').enumerate() {
            let refuse = |what: &str| self.error(format!("'{}' {what}", short(word)), WRITE_CORNERS);
            ensure!(k < 3, refuse("has more than three indices"));
            if part.is_empty() {
                continue;
            }
            let index: i64 = part.parse().map_err(|_| refuse("is not a corner of a face"))?;
            let limit = if index < 0 { seen[k] } else { self.counts[k] } as u64;
            if (1..=limit).contains(&index.unsigned_abs()) {
                let from_0 = if index < 0 { limit - index.unsigned_abs() } else { index.unsigned_abs() - 1 };
                // Files are too small for 2^32 lines of a keyword.
                named[k] = Some(from_0 as u32);
            } else if k > 0 {
                self.lost += 1;
            } else {
                let place = if index < 0 { " before it" } else { "" };
                let what = format!("vertex index {index}, but there are {limit} 'v' lines{place}, counted from 1");
                return Err(self.error(what, EXPORT_AGAIN));
            }
        }
        Ok(named)
    }

    fn finish(self) -> ObjFile {
        let Self { mut file, corner_normals, mut lost, thin, .. } = self;
        for corner in &mut file.faces.corners {
            if corner.texcoord.is_some_and(|t| !file.texcoords[t as usize].is_finite()) {
                corner.texcoord = None;
                lost += 1;
            }
        }
        file.texcoords.iter_mut().filter(|texcoord| !texcoord.is_finite()).for_each(|texcoord| *texcoord = Vec2::ZERO);
        file.any_normals = corner_normals.iter().any(|normal| *normal != u32::MAX);
        let has_all = file.any_normals && !corner_normals.contains(&u32::MAX);
        file.corner_normals = has_all.then_some(corner_normals);
        if thin > 0 {
            file.notes.push(format!("{thin} faces have fewer than three corners: left out"));
        }
        if lost > 0 {
            let what = "texture coordinates or normals of corners are not there, or are no numbers: left out";
            file.notes.push(format!("{lost} {what}"));
        }
        file
    }
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
        // In 1.#QNAN no comment begins.
        let comment = (0..line.len()).find(|&at| line[at] == b'#' && (at == 0 || line[at - 1] != b'.'));
        let statement = line[..comment.unwrap_or(line.len())].trim_ascii_start();
        statement.split_at(statement.iter().position(u8::is_ascii_whitespace).unwrap_or(statement.len()))
    })
}

/// Cuts a word of the file to a length that fits a message.
fn short(word: &str) -> String {
    match word.char_indices().nth(40) {
        Some((at, _)) => format!("{}…", &word[..at]),
        None => word.to_owned(),
    }
}
