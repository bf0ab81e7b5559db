//! Reads OBJ text into arrays, in the file's order.
//!
//! tobj reads texture coordinates, which only the neutral mesh has. The rest is read here: tobj drops vertices without
//! a face, numbers the others by first use, and its errors name no line.

use crate::asset::{CUT_ALL, CUT_MOST, Corner, Faces};
use crate::error::{Error, Result, ensure};
use crate::import::kinds::refuse_others;
use crate::import::shortened;
use crate::io::{TEXT_MAX, read_bounded};
use glam::{DVec3, Vec2, Vec3};
use std::fmt::Write;
use std::path::Path;

/// The statements that are read; others are ignored.
const KEYWORDS: [&[u8]; 4] = [b"v", b"vn", b"f", b"vt"];
const VERTEX: usize = 0;
const NORMAL: usize = 1;
const FACE: usize = 2;
/// Those of a target, whose texture coordinates are not used.
const OF_TARGETS: usize = 3;
const NAMES: [&str; 4] = ["vertex", "normal", "face", "texture coordinate"];
/// Numbers that a statement needs.
const LEAST: [usize; 4] = [3, 3, 0, 1];

const SPLIT: &str = "split the mesh";
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
        Self::from_bytes(path, read_bounded(path, TEXT_MAX, SPLIT)?)
    }

    /// Reads the OBJ file of a target, without texture coordinates; `origin` is subtracted from positions before they
    /// are rounded to single precision.
    pub(super) fn read_target(path: &Path, origin: Vec3) -> Result<Self> {
        Self::scan(path, read_bounded(path, TEXT_MAX, SPLIT)?, origin, &KEYWORDS[..OF_TARGETS])
    }

    /// Reads one OBJ file from text in memory, like [`read`](Self::read); `path` is only for messages.
    ///
    /// # Errors
    /// [`Error::Input`] with the line if the text cannot be used; [`Error::OutOfMemory`].
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self> {
        Self::scan(path, bytes, Vec3::ZERO, &KEYWORDS)
    }

    fn scan(path: &Path, bytes: Vec<u8>, origin: Vec3, keywords: &[&[u8]]) -> Result<Self> {
        refuse_others(path, &bytes, "an OBJ file")?;
        let bytes = prepared(bytes);
        let mut scan = Scan {
            path,
            origin: origin.as_dvec3(),
            line: 0,
            file: Self::default(),
            texcoords: (0, String::new()),
            corner_normals: vec![],
            farthest: (0, 0),
            thin: 0,
        };
        for (line, kind, rest) in statements(&bytes, keywords) {
            scan.line = line;
            let text = std::str::from_utf8(rest);
            let text = text.map_err(|_| scan.error("bytes that are not UTF-8 text", EXPORT_AGAIN))?;
            if kind == FACE {
                scan.face(text)?;
            } else {
                scan.values(kind, text)?;
            }
        }
        let what = "no 'v' line: not an OBJ file, or one without vertices";
        ensure!(!scan.file.positions.is_empty(), Error::input(path, "", what, EXPORT_OBJ));
        scan.finish()
    }
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

struct Scan<'a> {
    path: &'a Path,
    /// Subtracted from positions.
    origin: DVec3,
    /// The line that the statement begins on.
    line: usize,
    /// Positions, normals and faces so far.
    file: ObjFile,
    /// The number of texture coordinates so far, and their statements.
    texcoords: (usize, String),
    /// Index of the normal of each corner; `u32::MAX` where it has none.
    corner_normals: Vec<u32>,
    /// The largest index of a vertex that a face names, and its line: the vertex may follow.
    farthest: (u32, usize),
    /// Number of faces of fewer than three corners.
    thin: usize,
}

impl Scan<'_> {
    fn error(&self, what: impl Into<String>, remedy: &str) -> Error {
        Error::input(self.path, format!(": line {}", self.line), what, remedy)
    }

    /// Reads a number, less `offset`, in single precision.
    fn number(&self, word: &str, offset: f64) -> Result<f32> {
        let number = match offset {
            0.0 => word.parse().ok(),
            _ => word.parse().ok().map(|number: f64| (number - offset) as f32),
        };
        // No numbers, as programs on Windows write them.
        let number = number.or_else(|| (word.contains(".#") || word.contains("nan(")).then_some(f32::NAN));
        let remedy =
            if word.contains(',') { "write numbers with a point, and spaces between them" } else { EXPORT_AGAIN };
        number.ok_or_else(|| self.error(format!("'{}' is not a number", shortened(word)), remedy))
    }

    fn values(&mut self, kind: usize, text: &str) -> Result<()> {
        let mut words = [""; 5];
        let mut given = 0;
        for (place, word) in words.iter_mut().zip(text.split_ascii_whitespace()) {
            *place = word;
            given += 1;
        }
        let what = || format!("a {} with {given} of {} numbers", NAMES[kind], LEAST[kind]);
        ensure!(given >= LEAST[kind], self.error(what(), EXPORT_AGAIN));
        let [x, y, z, fourth, _] = words;
        if kind == VERTEX {
            // One number more than three is a weight, several are a colour.
            let weight = if given == 4 { self.number(fourth, 0.0)? } else { 1.0 };
            let DVec3 { x: left, y: below, z: behind } = self.origin * f64::from(weight);
            let place = [self.number(x, left)?, self.number(y, below)?, self.number(z, behind)?];
            let position = Vec3::from(place) / weight;
            let what = || {
                let divided = if given == 4 { ", divided by the fourth, its weight" } else { "" };
                let vertex = shortened(text.trim());
                format!("the vertex '{vertex}' is not one of finite numbers of single precision{divided}")
            };
            ensure!(position.is_finite(), self.error(what(), "repair the mesh and export it again"));
            self.file.positions.push(position);
        } else if kind == NORMAL {
            let normal = Vec3::new(self.number(x, 0.0)?, self.number(y, 0.0)?, self.number(z, 0.0)?);
            self.file.normals.push(if normal.is_finite() { normal } else { Vec3::ZERO });
        } else {
            let second = if given > 1 { y } else { "0" };
            let is_finite = self.number(x, 0.0)?.is_finite() && self.number(second, 0.0)?.is_finite();
            let [u, v] = if is_finite { [x, second] } else { ["nan"; 2] };
            self.texcoords.0 += 1;
            // Writing to memory cannot fail.
            let _ = writeln!(self.texcoords.1, "vt {u} {v}");
        }
        Ok(())
    }

    fn face(&mut self, text: &str) -> Result<()> {
        let before = self.corner_normals.len();
        for word in text.split_ascii_whitespace() {
            let [position, texcoord, normal] = self.corner(word)?;
            let Some(position) = position else {
                return Err(self.error(format!("'{}' names no vertex", shortened(word)), WRITE_CORNERS));
            };
            let has_room = u32::try_from(self.corner_normals.len()).is_ok();
            ensure!(has_room, self.error("more than 4,294,967,295 face corners", SPLIT));
            if position >= self.farthest.0 {
                self.farthest = (position, self.line);
            }
            self.file.faces.corners.push(Corner { position, texcoord });
            self.corner_normals.push(normal.unwrap_or(u32::MAX));
        }
        match self.corner_normals.len() - before {
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

    /// The vertex, texture coordinate and normal that a corner names; the last two need not be there.
    fn corner(&self, word: &str) -> Result<[Option<u32>; 3]> {
        let mut named = [None; 3];
        let seen = [self.file.positions.len(), self.texcoords.0, self.file.normals.len()];
        for (k, part) in word.split('/').enumerate() {
            let refuse = |what: &str| self.error(format!("'{}' {what}", shortened(word)), WRITE_CORNERS);
            ensure!(k < 3, refuse("has more than three indices"));
            if part.is_empty() {
                continue;
            }
            let index: i64 = part.parse().map_err(|_| refuse("is not a corner of a face"))?;
            // A positive index may refer to later lines; a negative one counts back from this line.
            let from_0 = if index < 0 { seen[k] as i64 + index } else { index - 1 };
            if k == 0 && !(0..u32::MAX.into()).contains(&from_0) {
                let before = || format!("there are {} 'v' lines before it", seen[0]);
                let why = if index < 0 { before() } else { "vertices are counted from 1".to_owned() };
                return Err(self.unknown(index, &why));
            }
            // None is so far on.
            named[k] = Some(u32::try_from(from_0).unwrap_or(u32::MAX - 1));
        }
        Ok(named)
    }

    fn unknown(&self, index: i64, why: &str) -> Error {
        self.error(format!("vertex index {index}, but {why}"), EXPORT_AGAIN)
    }

    fn finish(mut self) -> Result<ObjFile> {
        let (farthest, line) = self.farthest;
        self.line = line;
        let count = self.file.positions.len();
        let is_there = line == 0 || (farthest as usize) < count;
        ensure!(is_there, self.unknown(i64::from(farthest) + 1, &format!("there are {count} 'v' lines")));
        let mut file = self.file;
        let (count, text) = self.texcoords;
        let texcoords = texcoords(text, count);
        file.texcoords =
            texcoords.ok_or_else(|| Error::input(self.path, "", "the parser lost numbers", EXPORT_AGAIN))?;
        let mut lost = 0;
        for corner in &mut file.faces.corners {
            let stated = corner.texcoord.take();
            corner.texcoord = stated.filter(|t| file.texcoords.get(*t as usize).is_some_and(|uv| uv.is_finite()));
            lost += usize::from(corner.texcoord != stated);
        }
        file.texcoords.iter_mut().filter(|uv| !uv.is_finite()).for_each(|uv| *uv = Vec2::ZERO);
        for normal in self.corner_normals.iter_mut().filter(|n| **n != u32::MAX && **n as usize >= file.normals.len()) {
            *normal = u32::MAX;
            lost += 1;
        }
        file.any_normals = self.corner_normals.iter().any(|normal| *normal != u32::MAX);
        let has_all = file.any_normals && !self.corner_normals.contains(&u32::MAX);
        file.corner_normals = has_all.then_some(self.corner_normals);
        let sizes = || file.faces.sizes.iter().map(|size| *size as usize);
        let many = sizes().filter(|size| (33..=CUT_MOST).contains(size)).map(|size| size.pow(3) as f64);
        if many.sum::<f64>() > CUT_ALL as f64 {
            let what = "many large faces: the last concave ones may be cut as fans from the first corner";
            file.notes.push(what.to_owned());
        }
        let large = sizes().filter(|size| *size > CUT_MOST).count();
        for (count, what) in [
            (self.thin, "faces of fewer than three corners, left out"),
            (large, &format!("faces of more than {CUT_MOST} corners, cut as fans from the first one")),
            (lost, "texture coordinates or normals of corners that are not there, or are no numbers, left out"),
        ] {
            if count > 0 {
                file.notes.push(format!("{what}: {count}"));
            }
        }
        Ok(file)
    }
}

/// The numbers of `count` statements `vt`, by tobj, which keeps only what corners of faces name, in the order of the
/// first corner that does. `None` where one is refused.
fn texcoords(mut text: String, count: usize) -> Option<Vec<Vec2>> {
    if count == 0 {
        return Some(vec![]);
    }
    text.push_str("v 0 0 0\nf");
    // Writing to memory cannot fail.
    (1..=count).for_each(|i| _ = write!(text, " 1/{i}"));
    let options = tobj::LoadOptions::default();
    let (mut models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| Ok(Default::default())).ok()?;
    let numbers = models.pop()?.mesh.texcoords;
    (numbers.len() == 2 * count).then(|| bytemuck::cast_slice(&numbers).to_vec())
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

/// Iterates over the statements that are read, one per line: the line, counted from 1; the place in `keywords`; and the
/// text after it without comments.
fn statements<'a>(bytes: &'a [u8], keywords: &[&[u8]]) -> impl Iterator<Item = (usize, usize, &'a [u8])> {
    (1..).zip(bytes.split(|&b| b == b'\n')).filter_map(|(line, text)| {
        let statement = text.trim_ascii_start();
        let end = statement.iter().position(u8::is_ascii_whitespace).unwrap_or(statement.len());
        let (keyword, rest) = statement.split_at(end);
        let kind = keywords.iter().position(|k| *k == keyword)?;
        // In 1.#QNAN no comment begins.
        let is_comment = |at: &usize| rest[*at] == b'#' && (*at == 0 || rest[*at - 1] != b'.');
        let comment = if rest.contains(&b'#') { (0..rest.len()).find(is_comment) } else { None };
        Some((line, kind, &rest[..comment.unwrap_or(rest.len())]))
    })
}
