//! Reads OBJ text into arrays, in the file's order.
//!
//! tobj reads the numbers of `v`, `vt` and `vn`, faces are read here: tobj has no line numbers, takes an index of 0 for
//! a missing one, and repeats texture coordinates where a corner has none. Numbers are checked before it gets them.

use crate::asset::{CUT_ALL, CUT_MOST, Corner, Faces};
use crate::error::{Error, Result, ensure};
use crate::import::kinds::refuse_others;
use crate::import::shortened;
use crate::io::{TEXT_MAX, read_bounded};
use bytemuck::cast_slice;
use glam::{DVec3, Vec2, Vec3};
use std::io::Write;
use std::path::Path;

/// The statements that are read; others are ignored. The first three list values.
const KEYWORDS: [&[u8]; 4] = [b"v", b"vt", b"vn", b"f"];
const FACE: usize = 3;
const NAMES: [&str; 3] = ["vertex", "texture coordinate", "normal"];
/// Numbers that a statement needs.
const LEAST: [usize; 3] = [3, 1, 3];

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
        Self::read_from(path, Vec3::ZERO)
    }

    /// Reads one OBJ file, with `origin` subtracted from positions before they are rounded to single precision.
    pub(super) fn read_from(path: &Path, origin: Vec3) -> Result<Self> {
        Self::scan(path, read_bounded(path, TEXT_MAX, "split the mesh")?, origin)
    }

    /// Reads one OBJ file from text in memory, like [`read`](Self::read); `path` is only for messages.
    ///
    /// # Errors
    /// [`Error::Input`] with the line if the text cannot be used; [`Error::OutOfMemory`].
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self> {
        Self::scan(path, bytes, Vec3::ZERO)
    }

    fn scan(path: &Path, bytes: Vec<u8>, origin: Vec3) -> Result<Self> {
        refuse_others(path, &bytes, "an OBJ file")?;
        let bytes = prepared(bytes);
        // Counted in advance: a face may name a vertex that is listed after it.
        let mut counts = [0; 4];
        statements(&bytes).for_each(|(_, kind, _)| counts[kind] += 1);
        let what = "no 'v' line: not an OBJ file, or one without vertices";
        ensure!(counts[0] > 0, Error::input(path, "", what, EXPORT_OBJ));
        let mut scan = Scan {
            path,
            origin: origin.as_dvec3(),
            line: 0,
            text: ordering_face(counts),
            counts,
            seen: [0; 4],
            faces: Faces::default(),
            corner_normals: vec![],
            lost: 0,
            thin: 0,
        };
        scan.text.reserve(bytes.len() + 1);
        for (line, kind, rest) in statements(&bytes) {
            scan.line = line;
            if kind == FACE {
                scan.face(rest)?;
            } else {
                scan.values(kind, rest)?;
            }
        }
        let remedy = "export the file again, with one statement on a line";
        let lost = || Error::input(path, "", "the parser lost numbers", remedy);
        let mesh = values(&scan.text, counts).ok_or_else(lost)?;
        Ok(scan.finish(&mesh))
    }
}

/// The numbers of the `v`, `vt` and `vn` statements in `text`, by tobj; `None` where one is refused, or a vertex is not
/// finite.
fn values(text: &[u8], [v, vt, vn, _]: [usize; 4]) -> Option<tobj::Mesh> {
    let options = tobj::LoadOptions::default();
    let (mut models, _) = tobj::load_obj_buf(&mut &*text, &options, |_| Ok(Default::default())).ok()?;
    let mesh = models.pop()?.mesh;
    let found = [&mesh.positions, &mesh.texcoords, &mesh.normals].map(Vec::len);
    let is_finite = mesh.positions.iter().all(|number| number.is_finite());
    (found == [3 * v, 2 * vt, 3 * vn] && is_finite).then_some(mesh)
}

/// The text in lines that end in LF, each with a whole statement.
fn prepared(mut bytes: Vec<u8>) -> Vec<u8> {
    // What was preallocated, and not written.
    while bytes.pop_if(|byte| *byte == 0).is_some() {}
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes[..3].fill(b' ');
    }
    // Lines that end in CR alone, as on old systems. Beside LF, a CR counts as white space.
    if !bytes.contains(&b'\n') {
        bytes.iter_mut().filter(|b| **b == b'\r').for_each(|b| *b = b'\n');
    }
    if bytes.contains(&b'\\') { join_lines(&bytes) } else { bytes }
}

/// Reads faces, and copies the other statements for tobj.
struct Scan<'a> {
    path: &'a Path,
    /// Subtracted from positions.
    origin: DVec3,
    /// The line that the statement begins on.
    line: usize,
    /// The statements for tobj.
    text: Vec<u8>,
    /// Number of statements of each keyword.
    counts: [usize; 4],
    /// Their number so far; a negative index counts back from it.
    seen: [usize; 4],
    faces: Faces,
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

    fn number(&self, word: &str) -> Result<f64> {
        let number = if is_nan(word) { Ok(f64::NAN) } else { word.parse() };
        let remedy =
            if word.contains(',') { "write numbers with a point, and spaces between them" } else { EXPORT_AGAIN };
        number.map_err(|_| self.error(format!("'{}' is not a number", shortened(word)), remedy))
    }

    /// Copies the numbers that are used of a statement.
    fn values(&mut self, kind: usize, rest: &[u8]) -> Result<()> {
        let text = self.text(rest)?;
        let given = text.split_whitespace().count();
        let what = || format!("a {} with {given} of {} numbers", NAMES[kind], LEAST[kind]);
        ensure!(given >= LEAST[kind], self.error(what(), EXPORT_AGAIN));
        // One number more than three is a weight, several are a colour.
        let weight = text.split_whitespace().nth(3).filter(|_| kind == 0 && given == 4);
        let (used, divided) = if weight.is_some() { (4, ", divided by the fourth, its weight") } else { (3, "") };
        let weight = weight.map_or(Ok(1.0), |word| self.number(word))?;
        let origin = if kind == 0 { self.origin * weight } else { DVec3::ZERO };
        self.text.extend_from_slice(KEYWORDS[kind]);
        for (word, offset) in text.split_whitespace().take(used).zip(origin.extend(0.0).to_array()) {
            let number = self.number(word)? - offset;
            let is_finite = kind > 0 || ((number / weight) as f32).is_finite();
            let what = || {
                let vertex = shortened(text.trim());
                format!("the vertex '{vertex}' is not one of finite numbers of single precision{divided}")
            };
            ensure!(is_finite, self.error(what(), "repair the mesh and export it again"));
            self.text.push(b' ');
            match word {
                _ if number.is_nan() => self.text.extend_from_slice(b"nan"),
                // Writing to memory cannot fail.
                _ if offset != 0.0 => drop(write!(self.text, "{number}")),
                word => self.text.extend_from_slice(word.as_bytes()),
            }
        }
        // The second texture coordinate where there is one alone; tobj ignores what follows two.
        if kind == 1 {
            self.text.extend_from_slice(b" 0");
        }
        self.text.push(b'\n');
        self.seen[kind] += 1;
        Ok(())
    }

    fn face(&mut self, rest: &[u8]) -> Result<()> {
        let before = self.faces.corners.len();
        for word in self.text(rest)?.split_whitespace() {
            let [position, texcoord, normal] = self.corner(word)?;
            let Some(position) = position else {
                return Err(self.error(format!("'{}' names no vertex", shortened(word)), WRITE_CORNERS));
            };
            let has_room = u32::try_from(self.faces.corners.len()).is_ok();
            ensure!(has_room, self.error("more than 4,294,967,295 face corners", "split the mesh"));
            self.faces.corners.push(Corner { position, texcoord });
            self.corner_normals.push(normal.unwrap_or(u32::MAX));
        }
        match self.faces.corners.len() - before {
            ..3 => {
                self.faces.corners.truncate(before);
                self.corner_normals.truncate(before);
                self.thin += 1;
            }
            // All corners are counted in 32 bits.
            size => self.faces.sizes.push(size as u32),
        }
        Ok(())
    }

    /// The vertex, texture coordinate and normal that a corner names.
    fn corner(&mut self, word: &str) -> Result<[Option<u32>; 3]> {
        let mut named = [None; 3];
        // A positive index may refer to later lines; a negative one counts back from this line.
        for (k, part) in word.split('/').enumerate() {
            let refuse = |what: &str| self.error(format!("'{}' {what}", shortened(word)), WRITE_CORNERS);
            ensure!(k < 3, refuse("has more than three indices"));
            if part.is_empty() {
                continue;
            }
            let index: i64 = part.parse().map_err(|_| refuse("is not a corner of a face"))?;
            let limit = if index < 0 { self.seen[k] } else { self.counts[k] } as i64;
            let from_0 = if index < 0 { limit + index } else { index - 1 };
            if (0..limit).contains(&from_0) {
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

    fn finish(self, mesh: &tobj::Mesh) -> ObjFile {
        let Self { mut faces, corner_normals, mut lost, thin, .. } = self;
        let mut texcoords: Vec<Vec2> = cast_slice(&mesh.texcoords).to_vec();
        let mut normals: Vec<Vec3> = cast_slice(&mesh.normals).to_vec();
        for corner in &mut faces.corners {
            if corner.texcoord.is_some_and(|t| !texcoords[t as usize].is_finite()) {
                corner.texcoord = None;
                lost += 1;
            }
        }
        texcoords.iter_mut().filter(|texcoord| !texcoord.is_finite()).for_each(|texcoord| *texcoord = Vec2::ZERO);
        normals.iter_mut().filter(|normal| !normal.is_finite()).for_each(|normal| *normal = Vec3::ZERO);
        let any_normals = corner_normals.iter().any(|normal| *normal != u32::MAX);
        let has_all = any_normals && !corner_normals.contains(&u32::MAX);
        let mut notes = vec![];
        if thin > 0 {
            notes.push(format!("faces of fewer than three corners, left out: {thin}"));
        }
        let sizes = || faces.sizes.iter().map(|size| *size as usize);
        let many = sizes().filter(|size| (33..=CUT_MOST).contains(size));
        if many.map(|size| size.pow(3) as f64).sum::<f64>() > CUT_ALL as f64 {
            notes.push("many large faces: the last concave ones may be cut as fans from the first corner".to_owned());
        }
        let large = sizes().filter(|size| *size > CUT_MOST).count();
        if large > 0 {
            notes.push(format!("faces of more than {CUT_MOST} corners, cut as fans from the first one: {large}"));
        }
        if lost > 0 {
            let what = "texture coordinates or normals of corners that are not there, or are no numbers, left out";
            notes.push(format!("{what}: {lost}"));
        }
        ObjFile {
            positions: cast_slice(&mesh.positions).to_vec(),
            texcoords,
            normals,
            faces,
            corner_normals: has_all.then_some(corner_normals),
            any_normals,
            notes,
        }
    }
}

/// Makes the one face that tobj gets, whose corners name every vertex, texture coordinate and normal in file order.
///
/// tobj numbers all three by first use and drops those that no face uses. With this face, the order of first use is the
/// order of the file.
fn ordering_face([v, vt, vn, _]: [usize; 4]) -> Vec<u8> {
    let corners = v.max(vt).max(vn);
    let mut line = Vec::with_capacity(corners * 24 + 2);
    line.push(b'f');
    for i in 1..=corners {
        for (separator, n) in [(b' ', v), (b'/', vt), (b'/', vn)] {
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

/// Whether a word is no number as programs on Windows write it: 1.#QNAN, 1.#INF, nan(ind).
fn is_nan(word: &str) -> bool {
    word.contains(".#") || word.contains("nan(")
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

/// Iterates over the statements that are read, one per line: the line, counted from 1; the place in `KEYWORDS`; and the
/// text after it without comments.
fn statements(bytes: &[u8]) -> impl Iterator<Item = (usize, usize, &[u8])> {
    (1..).zip(bytes.split(|&b| b == b'\n')).filter_map(|(line, text)| {
        // In 1.#QNAN no comment begins.
        let comment = (0..text.len()).find(|&at| text[at] == b'#' && (at == 0 || text[at - 1] != b'.'));
        let statement = text[..comment.unwrap_or(text.len())].trim_ascii_start();
        let end = statement.iter().position(u8::is_ascii_whitespace).unwrap_or(statement.len());
        let (keyword, rest) = statement.split_at(end);
        Some((line, KEYWORDS.iter().position(|k| *k == keyword)?, rest))
    })
}
