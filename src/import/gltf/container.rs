//! The bytes of a file: GLB or JSON, its buffers (embedded, in data URIs or in other files), and buffer views.

use super::json::{At, parse};
use super::meshopt;
use crate::error::{Error, Result, ensure};
use crate::import::kinds::{kind, refuse_others};
use crate::import::shortened;
use crate::io::read_bounded;
use percent_encoding::percent_decode_str;
use serde_json::Value;
use std::borrow::Cow;
use std::cell::{Cell, OnceCell, RefCell};
use std::collections::HashMap;
use std::fmt::Display;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;

/// The largest file: lengths in GLB have 32 bits.
const FILE_MAX: u64 = 1 << 32;

/// Bytes of values allowed per byte of the file: a byte may be decompressed to 64 bytes, each of which becomes four in
/// single precision. Files exceed this if they name the same bytes again and again, or count values that no buffer
/// holds. A valid file could exceed it only if hardly anything changes in it, and it uses version 1 of
/// KHR_meshopt_compression, where a byte may become 1024.
const VALUES_PER_BYTE: u64 = 320;
/// Bytes of values allowed in any case.
const VALUES_MIN: u64 = 1 << 20;

/// Required extensions that can be read. Materials, textures, lights and what avatars have besides are not looked at.
const UNDERSTOOD: [&str; 3] = ["KHR_mesh_quantization", COMPRESSED[0], COMPRESSED[1]];
/// Extensions of a compressed buffer view. If it has both, the first is used.
const COMPRESSED: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];
const NOT_LOOKED_AT: [&str; 8] = [
    "VRM",
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
    "KHR_animation_pointer",
];

/// The length of a buffer, and the memory with its bytes. `None`: a buffer without bytes, which only compressed views
/// may name.
type Buffer = Option<(usize, Rc<Vec<u8>>)>;

/// A file: its JSON, and the bytes of its buffers.
#[derive(Debug)]
pub struct Container {
    pub path: PathBuf,
    json: Value,
    /// The binary chunk of a GLB file.
    chunk: Option<Rc<Vec<u8>>>,
    /// Buffers, read when a view that is used names them.
    buffers: Vec<OnceCell<Buffer>>,
    /// Files with buffers, by their real paths.
    beside: RefCell<HashMap<PathBuf, Rc<Vec<u8>>>>,
    /// Extensions that the file requires and that are not read. What uses one is left out.
    unread: Vec<String>,
    /// Decompressed buffer views.
    unpacked: Vec<OnceCell<Vec<u8>>>,
    /// Bytes of values that may still be read.
    pub budget: Cell<u64>,
    /// What was left out, or taken for something else, since the last [`take_notes`](Self::take_notes).
    notes: RefCell<Vec<String>>,
}

impl Container {
    /// Reads the file at `path` and the buffers beside it.
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_bytes(path, read_bounded(path, FILE_MAX, "split the file")?)
    }

    /// Reads the bytes of the file at `path`, which may name buffers beside it.
    pub fn from_bytes(path: &Path, mut bytes: Vec<u8>) -> Result<Self> {
        let own_size = bytes.len() as u64;
        let (json, chunk) = if bytes.starts_with(b"glTF") { glb_chunks(path, &bytes)? } else { (0..bytes.len(), None) };
        // Chunks of JSON are padded by spaces; some exporters take zeros.
        let end = bytes[json.clone()].iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        let text = &bytes[json][..end];
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
        if !text.trim_ascii_start().starts_with(b"{") {
            refuse_others(path, text, "a glTF file")?;
            return Err(Error::input(path, "", "neither GLB nor JSON", "export the mesh as glTF 2.0"));
        }
        let json = parse(path, text)?;
        let chunk = chunk.map(|chunk| {
            bytes.truncate(chunk.end);
            bytes.drain(..chunk.start);
            Rc::new(bytes)
        });
        let root = At { path, value: &json, place: String::new() };
        check_version(&root)?;
        let required: Vec<&str> = root.items("extensionsRequired")?.iter().map(At::text).collect::<Result<_>>()?;
        let is_read = |name: &&str| UNDERSTOOD.contains(name) || NOT_LOOKED_AT.iter().any(|of| name.starts_with(of));
        let unread = required.into_iter().filter(|name| !is_read(name)).map(str::to_owned).collect();
        let file = Self {
            path: path.to_path_buf(),
            chunk,
            buffers: root.items("buffers")?.iter().map(|_| OnceCell::new()).collect(),
            beside: RefCell::default(),
            unread,
            unpacked: root.items("bufferViews")?.iter().map(|_| OnceCell::new()).collect(),
            budget: Cell::new(own_size.saturating_mul(VALUES_PER_BYTE).saturating_add(VALUES_MIN)),
            notes: RefCell::default(),
            json,
        };
        file.check_extensions(&file.root())?;
        for name in &file.unread {
            file.notes.borrow_mut().push(format!("{}; what uses it is left out", not_read(name)));
        }
        Ok(file)
    }

    /// Checks that `at` uses no extension that the file requires and that is not read.
    pub fn check_extensions(&self, at: &At<'_>) -> Result<()> {
        let Some(name) = self.unread.iter().find(|name| at.extension(name).is_some()) else { return Ok(()) };
        let remedy = match name.as_str() {
            "KHR_draco_mesh_compression" => "decompress the file: `gltf-transform copy IN.glb OUT.glb` does",
            _ => "export the file without it (gltfpack and gltf-transform can take such extensions out)",
        };
        Err(at.refuse(not_read(name), remedy))
    }

    /// Returns the root of the JSON.
    pub fn root(&self) -> At<'_> {
        At { path: &self.path, value: &self.json, place: String::new() }
    }

    /// Charges the budget before `count` values of `size` bytes are allocated for `at`; an error if the file is too
    /// small to contain them.
    pub fn charge(&self, at: &At<'_>, count: usize, size: usize) -> Result<()> {
        let bytes = (count as u64).saturating_mul(size as u64);
        let left = self.budget.get().checked_sub(bytes).ok_or_else(|| {
            let what = format!("{count} values of {size} bytes, which is more than a file of this size can hold");
            at.refuse(what, "export the file again: a count is wrong, or the same data is used many times over")
        })?;
        self.budget.set(left);
        Ok(())
    }

    /// Charges the budget for `count` values of `at`, and reserves memory for them.
    pub fn room<T>(&self, at: &At<'_>, count: usize) -> Result<Vec<T>> {
        self.charge(at, count, size_of::<T>())?;
        let mut values = vec![];
        let refuse =
            |_| Error::out_of_memory(format!("{}: {count} values", at.place), "free memory, or split the file");
        values.try_reserve_exact(count).map_err(refuse)?;
        Ok(values)
    }

    /// Tells the user something about `at`.
    pub fn note(&self, at: &At<'_>, what: impl Display) {
        self.notes.borrow_mut().push(format!("{}: {what}", at.place));
    }

    pub fn take_notes(&self) -> Vec<String> {
        self.notes.take()
    }

    /// Leaves out a part of the file that cannot be used and need not be there, with a note.
    pub fn leave_out<T>(&self, result: Result<T>, part: &str) -> Result<Option<T>> {
        self.leave_out_or_keep(result, part, &mut None)
    }

    /// Leaves out a part of the file that cannot be used, with a note. If it is the first one, `why` gets the error,
    /// for the case that nothing is left.
    pub fn leave_out_or_keep<T>(&self, result: Result<T>, part: &str, why: &mut Option<Error>) -> Result<Option<T>> {
        let Err(error) = result else { return result.map(Some) };
        let Error::Input { place, what, .. } = &error else { return Err(error) };
        let place = place.trim_start_matches(": ");
        self.notes.borrow_mut().push(format!("{place}: {what}; the {part} is left out"));
        why.get_or_insert(error);
        Ok(None)
    }

    /// Returns the bytes of the buffer view that `index` names, and those from one element to the next, if it states
    /// them.
    pub fn view(&self, index: &At<'_>) -> Result<(&[u8], Option<usize>)> {
        let view = self.root().item("bufferViews", index)?;
        self.check_extensions(&view)?;
        // Some exporters write 0 for elements that are tightly packed.
        let stride = view.index("byteStride")?.filter(|stride| *stride > 0);
        let Some(packed) = COMPRESSED.iter().find_map(|name| view.extension(name)) else {
            return Ok((self.bytes(&view)?, stride));
        };
        let slot = &self.unpacked[index.whole()?];
        if let Some(bytes) = slot.get() {
            return Ok((bytes, stride));
        }
        let count = packed.need("count")?.whole()?;
        let size = packed.need("byteStride")?.whole()?;
        let mode = packed.need("mode")?.text()?;
        let filter = packed.text_or_empty("filter");
        let compressed = self.bytes(&packed)?;
        self.charge(&packed, count, size)?;
        let decoded = meshopt::decode(compressed, count, size, mode, filter);
        let decoded =
            decoded.map_err(|what| packed.refuse(what, "compress the file again, or leave it uncompressed"))?;
        Ok((slot.get_or_init(|| decoded), stride))
    }

    /// Returns the byteLength bytes from byteOffset on of the buffer that `at` names.
    fn bytes(&self, at: &At<'_>) -> Result<&[u8]> {
        let index = at.need("buffer")?;
        let number = self.root().index_of("buffers", &index)?;
        let buffer = match self.buffers[number].get() {
            Some(buffer) => buffer,
            None => {
                let buffer = self.buffer(number, &self.root().item("buffers", &index)?)?;
                self.buffers[number].get_or_init(|| buffer)
            }
        };
        let Some((length, bytes)) = buffer else {
            return Err(index.refuse("a buffer without bytes", "export the file again, with its buffers"));
        };
        let bytes = &bytes[..*length];
        let offset = at.whole_or("byteOffset", 0)?;
        let length = at.need("byteLength")?.whole()?;
        let end = offset.checked_add(length).filter(|end| *end <= bytes.len());
        let end = end.ok_or_else(|| {
            let what = format!("{length} bytes from byte {offset} on, but the buffer has {}", bytes.len());
            at.refuse(what, "export the file again: it is cut off, or a length is wrong")
        })?;
        Ok(&bytes[offset..end])
    }

    fn buffer(&self, number: usize, at: &At<'_>) -> Result<Buffer> {
        let length = at.need("byteLength")?.whole()?;
        let found = match at.get("uri") {
            Some(uri) => Some(self.uri_bytes(&uri)?),
            None => self.chunk.clone().filter(|_| number == 0),
        };
        // The last three may be padding that is not there.
        if let Some(bytes) = found.as_ref().filter(|bytes| bytes.len() + 3 < length) {
            let what = format!("{length} bytes, but there are {}", bytes.len());
            let (kind, remedy) = kind(bytes).unwrap_or(("it is cut off", "export the file again"));
            return Err(at.refuse(format!("{what}: {kind}"), remedy));
        }
        Ok(found.map(|bytes| (length.min(bytes.len()), bytes)))
    }

    /// Returns the bytes of a URI: a data URI, or a file beside or below this one.
    fn uri_bytes(&self, uri: &At<'_>) -> Result<Rc<Vec<u8>>> {
        let path = &self.path;
        let text = uri.text()?;
        if let Some(data) = text.strip_prefix("data:") {
            let encoded = data.split_once(";base64,").map(|(_, encoded)| encoded);
            let bytes = encoded.and_then(base64).map(Rc::new);
            return bytes
                .ok_or_else(|| uri.refuse("a data URI that is not base64", "export the file again, or as .glb"));
        }
        let is_below = |name: &String| {
            let mut parts = Path::new(name).components();
            let is_plain = !name.is_empty() && !name.contains([':', '\\', '\0']);
            is_plain && parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
        };
        // Some exporters do not escape a name that has a percent sign in it.
        let decoded = percent_decode_str(text).decode_utf8().ok().map(Cow::into_owned);
        let names = decoded.into_iter().chain([text.to_owned()]).filter(is_below);
        let files: Vec<PathBuf> = names.map(|name| path.with_file_name(name)).collect();
        let Some(file) = files.iter().find(|file| file.is_file()).or(files.first()) else {
            let what = format!("'{}' names no file beside this one", shortened(text));
            let remedy = "put the buffer beside the file and name it without a path, or export as .glb";
            return Err(uri.refuse(what, remedy));
        };
        let real = file.canonicalize().unwrap_or_else(|_| file.clone());
        let is_other = path.canonicalize().map_or(true, |own| own != real);
        ensure!(
            is_other,
            uri.refuse("the glTF file itself, not a buffer", "name the file that has the buffer's bytes")
        );
        if let Some(bytes) = self.beside.borrow().get(&real) {
            return Ok(bytes.clone());
        }
        let read = read_bounded(file, FILE_MAX, "split the file");
        if let Err(Error::Io { source, .. }) = &read {
            let what = format!("{}: cannot read: {source}", file.display());
            return Err(uri.refuse(what, "put the buffer beside the file"));
        }
        let bytes = read?;
        let more = (bytes.len() as u64).saturating_mul(VALUES_PER_BYTE);
        self.budget.set(self.budget.get().saturating_add(more));
        let bytes = Rc::new(bytes);
        self.beside.borrow_mut().insert(real, bytes.clone());
        Ok(bytes)
    }
}

fn not_read(extension: &str) -> String {
    format!("the extension {extension} is required, and not read")
}

/// Returns the ranges of the JSON and of the binary chunk of a GLB file. Chunks are padded to four bytes, but some
/// exporters leave the padding out, or do not count it.
fn glb_chunks(path: &Path, bytes: &[u8]) -> Result<(Range<usize>, Option<Range<usize>>)> {
    let refuse = |place: &str, what: String| Error::input(path, place, what, "export the file again: it is damaged");
    let word = |at: usize| Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?) as usize);
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(refuse("", format!("{} bytes, fewer than the 12 of a GLB header", bytes.len())));
    };
    ensure!(version == 2, refuse("", format!("GLB version {version}, only 2 is read")));
    let longest = bytes.len() + 3;
    ensure!(length <= longest, refuse("", format!("cut off: {} of {length} bytes", bytes.len())));
    let chunk = |start: usize, kind: [u8; 4]| {
        let end = (start + 8).saturating_add(word(start)?);
        let is_it = word(start + 4)? == u32::from_le_bytes(kind) as usize && end <= longest;
        is_it.then(|| start + 8..end.min(bytes.len()))
    };
    let Some(json) = chunk(12, *b"JSON") else {
        return Err(refuse(": byte 12", "no chunk 'JSON' that fits the file".into()));
    };
    let binary = [json.end.next_multiple_of(4), json.end].into_iter().find_map(|start| chunk(start, *b"BIN\0"));
    Ok((json, binary))
}

fn check_version(root: &At<'_>) -> Result<()> {
    let version = root.need("asset")?.need("version")?;
    // Text, but some exporters write a number, or no minor version.
    let text = version.value.to_string();
    let what = || format!("version {text}, only 2 is read");
    ensure!(text.trim_matches('"').split('.').next() == Some("2"), version.refuse(what(), "export it as glTF 2.0"));
    Ok(())
}

/// Decodes base64 with or without padding (RFC 4648) and with line breaks anywhere; `None` if `text` is something else.
pub fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches(|c: char| c == '=' || c.is_ascii_whitespace());
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    let mut bits = 0u32;
    let mut count = 0;
    for c in text.bytes().filter(|c| !c.is_ascii_whitespace()) {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    (count < 6).then_some(bytes)
}
