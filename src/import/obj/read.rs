//! Reads OBJ text into arrays, in the file's order.
//!
//! tobj has no line numbers, accepts NaN as a number and reads an index of 0 as missing, so every statement is checked
//! first. tobj then gets only valid `v`, `vt`, `vn` and `f` statements, one on each line. Statements at which it would
//! start a new model (`o`, `g`, `usemtl`) are left out, as are comments in other encodings, and vertex colours that
//! only some lines have.

use crate::asset::{Corner, Faces};
use crate::error::{Error, Result};
use crate::io::{TEXT_MAX, read_bounded};
use glam::{Vec2, Vec3};
use std::io::Write;
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
        let Scan { text, counts, corners, without_texcoord, without_normal, .. } = Scan::new(path, bytes)?;
        let options = tobj::LoadOptions::default();
        let loaded = tobj::load_obj_buf(&mut text.as_slice(), &options, |_| Ok(Default::default()));
        drop(text);
        // The scan has refused everything that tobj refuses; a difference between the two would be reported here.
        let refuse = |what: String| Error::input(path, "", what, "export the file again, with one statement on a line");
        let (mut models, _) = loaded.map_err(|e| refuse(e.to_string()))?;
        let mesh = models.pop().map(|model| model.mesh).unwrap_or_default();
        let [v, vt, vn] = counts;
        let first = v.max(vt).max(vn);
        let complete = models.is_empty()
            && [mesh.positions.len(), mesh.texcoords.len(), mesh.normals.len()] == [3 * v, 2 * vt, 3 * vn]
            && mesh.indices.len() == first + corners;
        if !complete {
            return Err(refuse("the parser lost vertices or corners".into()));
        }

        // tobj leaves out the sizes if all faces, the first one included, are triangles.
        let sizes = mesh.face_arities.get(1..).map_or_else(|| vec![3; corners / 3], <[u32]>::to_vec);
        let texcoord = |i: usize| mesh.texcoord_indices.get(first + i).copied();
        let indices = mesh.indices[first..].iter().enumerate();
        let mut faces = Faces {
            sizes,
            corners: indices.map(|(i, &position)| Corner { position, texcoord: texcoord(i) }).collect(),
        };
        // For a corner without texture coordinate, tobj repeats that of the corner before.
        without_texcoord.iter().for_each(|&i| faces.corners[i as usize].texcoord = None);
        let any_normals = without_normal < corners;
        Ok(Self {
            positions: mesh.positions.chunks_exact(3).map(Vec3::from_slice).collect(),
            texcoords: mesh.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
            normals: mesh.normals.chunks_exact(3).map(Vec3::from_slice).collect(),
            corner_normals: (any_normals && without_normal == 0).then(|| mesh.normal_indices[first..].to_vec()),
            any_normals,
            faces,
        })
    }
}

/// Checks statements, and copies the valid ones for tobj.
struct Scan<'a> {
    path: &'a Path,
    /// The line that the statement starts on.
    line: usize,
    /// The statements for tobj.
    text: Vec<u8>,
    /// Number of `v`, `vt` and `vn` statements.
    counts: [usize; 3],
    /// The numbers so far; a negative index counts back from them.
    seen: [usize; 3],
    /// Number of corners of all faces.
    corners: usize,
    /// Corners (counted over all faces) without a texture coordinate.
    without_texcoord: Vec<u32>,
    /// Number of corners without a normal.
    without_normal: usize,
}

impl<'a> Scan<'a> {
    /// Checks `bytes` and keeps the statements that tobj needs. `path` is for messages.
    fn new(path: &'a Path, mut bytes: Vec<u8>) -> Result<Self> {
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
        if bytes.contains(&b'\\') {
            bytes = join_lines(&bytes);
        }
        // Counted in advance: a face may name a vertex that is listed after it.
        let mut counts = [0; 3];
        for (keyword, _) in statements(&bytes) {
            kind_of(keyword).into_iter().for_each(|kind| counts[kind] += 1);
        }
        if counts[0] == 0 {
            let what = "no 'v' line: not an OBJ file, or one without vertices";
            return Err(Error::input(path, "", what, EXPORT_OBJ));
        }
        let mut text = ordering_face(counts);
        text.reserve(bytes.len() + 1);
        let (without_texcoord, without_normal) = (vec![], 0);
        let mut scan = Self { path, line: 0, text, counts, seen: [0; 3], corners: 0, without_texcoord, without_normal };
        for (line, (keyword, rest)) in (1..).zip(statements(&bytes)) {
            scan.line = line;
            scan.statement(keyword, rest)?;
        }
        Ok(scan)
    }

    fn error(&self, what: impl Into<String>, remedy: &str) -> Error {
        Error::input(self.path, format!(": line {}", self.line), what, remedy)
    }

    fn statement(&mut self, keyword: &[u8], rest: &[u8]) -> Result<()> {
        let kind = kind_of(keyword);
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
        kind.into_iter().for_each(|kind| self.seen[kind] += 1);
        for part in [keyword, kept.as_bytes(), b"\n"] {
            self.text.extend_from_slice(part);
        }
        Ok(())
    }

    fn number(&self, word: &str) -> Result<f32> {
        let number = word.parse::<f32>();
        let number = number.map_err(|_| self.error(format!("'{}' is not a number", short(word)), EXPORT_AGAIN))?;
        let what = || format!("'{word}' is not a finite number of single precision");
        let finite = number.is_finite().then_some(number);
        finite.ok_or_else(|| self.error(what(), "repair the mesh and export it again"))
    }

    /// Reads the `N` numbers at the beginning of a statement.
    fn numbers<'t, const N: usize>(&self, kind: usize, words: &mut impl Iterator<Item = &'t str>) -> Result<[f32; N]> {
        let mut numbers = [0.0; N];
        for (i, x) in numbers.iter_mut().enumerate() {
            let missing = || self.error(format!("a {} with {i} numbers, {N} expected", NAMES[kind]), EXPORT_AGAIN);
            *x = self.number(words.next().ok_or_else(missing)?)?;
        }
        Ok(numbers)
    }

    /// Checks `x y z [w]` or `x y z r g b [a]`; the colour is not kept.
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
                let n = text.split_whitespace().count();
                let what = format!("a vertex with {n} numbers, 3 expected (or 4 with a weight, 6 with a colour)");
                Err(self.error(what, EXPORT_AGAIN))
            }
        }
    }

    fn face<'t>(&mut self, text: &'t str) -> Result<&'t str> {
        let before = self.corners;
        text.split_whitespace().try_for_each(|word| self.corner(word))?;
        let what = |size| format!("a face with {size} corners, at least 3 expected");
        match self.corners - before {
            3.. => Ok(text),
            size => Err(self.error(what(size), "remove it, or write points and lines as 'p' and 'l'")),
        }
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
            // A positive index may refer to later lines; a negative one counts back from this line.
            let limit = if index < 0 { self.seen[k] } else { self.counts[k] } as u64;
            if index == 0 || index.unsigned_abs() > limit {
                let (name, keyword) = (NAMES[k], KEYWORDS[k]);
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
        let corner = u32::try_from(self.corners)
            .map_err(|_| self.error("more than 4,294,967,295 face corners", "split the mesh"))?;
        if !named[1] && self.counts[1] > 0 {
            self.without_texcoord.push(corner);
        }
        self.without_normal += usize::from(!named[2]);
        self.corners += 1;
        Ok(())
    }
}

/// Makes a face whose corners name every vertex, texture coordinate and normal in file order.
///
/// tobj numbers all three by first use and drops those that no face uses. With this first face in the file, the order
/// of first use is the order of the file. The face is removed after parsing.
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
