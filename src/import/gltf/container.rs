//! The bytes of a file: GLB or JSON, its buffers (embedded, in data URIs or in other files), and buffer views.

use super::json::{At, parse};
use super::meshopt;
use crate::error::{Error, Result};
use crate::io::read_bounded;
use serde_json::Value;
use std::cell::{Cell, OnceCell};
use std::collections::HashMap;
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

/// Required extensions that can be read. Materials, textures and lights are not looked at.
const UNDERSTOOD: [&str; 3] = ["KHR_mesh_quantization", COMPRESSED[0], COMPRESSED[1]];
/// Extensions of a compressed buffer view. If it has both, the first is used.
const COMPRESSED: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];
const NOT_LOOKED_AT: [&str; 7] = [
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
    "KHR_animation_pointer",
];

/// A file: its JSON, and the bytes of its buffers.
#[derive(Debug)]
pub struct Container {
    pub path: PathBuf,
    json: Value,
    /// The memory with each buffer, and the buffer's length in it. `None`: a buffer without bytes, which only
    /// compressed views may name.
    buffers: Vec<Option<(Rc<Vec<u8>>, usize)>>,
    /// Decompressed buffer views.
    unpacked: Vec<OnceCell<Vec<u8>>>,
    /// Bytes of values that may still be read.
    budget: Cell<u64>,
}

/// The bytes of a buffer view, and their stride.
#[derive(Debug)]
pub struct View<'a> {
    pub bytes: &'a [u8],
    /// Bytes from one element to the next, if the view states it.
    pub stride: Option<usize>,
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
        let text = &bytes[json];
        let json = parse(path, text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text))?;
        let mut chunk = chunk.map(|chunk| {
            bytes.truncate(chunk.end);
            bytes.drain(..chunk.start);
            bytes
        });
        let root = At { path, value: &json, place: String::new() };
        check_version(&root)?;
        let mut buffers = vec![];
        let mut beside = HashMap::new();
        for (i, buffer) in root.items("buffers")?.iter().enumerate() {
            let length = buffer.need("byteLength")?.whole()?;
            let found = match buffer.get("uri") {
                Some(uri) => Some(uri_bytes(path, &uri, &mut beside)?),
                None if i == 0 => chunk.take().map(Rc::new),
                None => None,
            };
            if let Some(bytes) = found.as_ref().filter(|bytes| bytes.len() < length) {
                let what = format!("{length} bytes, but there are {}", bytes.len());
                return Err(buffer.refuse(what, "export the file again: it is cut off"));
            }
            buffers.push(found.map(|bytes| (bytes, length)));
        }
        let total = beside.values().fold(own_size, |total, bytes| total.saturating_add(bytes.len() as u64));
        let unpacked = root.items("bufferViews")?.iter().map(|_| OnceCell::new()).collect();
        let budget = Cell::new(total.saturating_mul(VALUES_PER_BYTE).saturating_add(VALUES_MIN));
        Ok(Self { path: path.to_path_buf(), json, buffers, unpacked, budget })
    }

    /// Returns the root of the JSON.
    pub fn root(&self) -> At<'_> {
        At { path: &self.path, value: &self.json, place: String::new() }
    }

    /// Returns the bytes of values that may still be read.
    pub fn budget(&self) -> u64 {
        self.budget.get()
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

    /// Returns the buffer view that `index` names.
    pub fn view(&self, index: &At<'_>) -> Result<View<'_>> {
        let view = self.root().item("bufferViews", index)?;
        let stride = view.index("byteStride")?;
        let extensions = view.get("extensions");
        let Some(packed) = COMPRESSED.iter().find_map(|name| extensions.as_ref()?.get(name)) else {
            return Ok(View { bytes: self.bytes(&view)?, stride });
        };
        let slot = &self.unpacked[index.whole()?];
        if let Some(bytes) = slot.get() {
            return Ok(View { bytes, stride });
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
        Ok(View { bytes: slot.get_or_init(|| decoded), stride })
    }

    /// Returns the byteLength bytes from byteOffset on of the buffer that `at` names.
    fn bytes(&self, at: &At<'_>) -> Result<&[u8]> {
        let index = at.need("buffer")?;
        self.root().item("buffers", &index)?;
        let Some((bytes, length)) = &self.buffers[index.whole()?] else {
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
}

/// Returns the ranges of the JSON and of the binary chunk of a GLB file.
fn glb_chunks(path: &Path, bytes: &[u8]) -> Result<(std::ops::Range<usize>, Option<std::ops::Range<usize>>)> {
    let refuse =
        |place: &str, what: String| Err(Error::input(path, place, what, "export the file again: it is damaged"));
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return refuse("", format!("{} bytes, fewer than the 12 of a GLB header", bytes.len()));
    };
    if version != 2 {
        return refuse("", format!("GLB version {version}, only 2 is read"));
    }
    if length > bytes.len() {
        return refuse("", format!("cut off: {} of {length} bytes", bytes.len()));
    }
    let chunk = |start: usize, kind: u32| {
        let size = word(start)?;
        let found = word(start + 4)?;
        let end = (start + 8).checked_add(size).filter(|end| *end <= length);
        Some((found == kind as usize, start + 8..end?))
    };
    let Some((true, json)) = chunk(12, u32::from_le_bytes(*b"JSON")) else {
        return refuse(": byte 12", "no chunk 'JSON' that fits the file".into());
    };
    let next = json.end.next_multiple_of(4);
    let binary = match chunk(next, u32::from_le_bytes(*b"BIN\0")) {
        Some((is_binary, range)) => is_binary.then_some(range),
        None if next >= length => None,
        None => return refuse(&format!(": byte {next}"), "a chunk that does not fit the file".into()),
    };
    Ok((json, binary))
}

fn check_version(root: &At<'_>) -> Result<()> {
    let version = root.need("asset")?.need("version")?;
    if !version.text()?.starts_with("2.") {
        return Err(version.refuse(format!("version {}, only 2 is read", version.value), "export it as glTF 2.0"));
    }
    for name in root.items("extensionsRequired")? {
        let required = name.text()?;
        if !UNDERSTOOD.contains(&required) && !NOT_LOOKED_AT.iter().any(|prefix| required.starts_with(prefix)) {
            let remedy = match required {
                "KHR_draco_mesh_compression" => "decompress the file: `gltf-transform copy IN.glb OUT.glb` does",
                _ => "export the file without it (gltfpack and gltf-transform can take such extensions out)",
            };
            return Err(name.refuse(format!("the extension {required} is required, and not read"), remedy));
        }
    }
    Ok(())
}

/// Returns the bytes of a URI: a data URI, or a file beside or below this one. `beside` caches files by their real
/// paths.
fn uri_bytes(path: &Path, uri: &At<'_>, beside: &mut HashMap<PathBuf, Rc<Vec<u8>>>) -> Result<Rc<Vec<u8>>> {
    let text = uri.text()?;
    if let Some(data) = text.strip_prefix("data:") {
        let encoded = data.split_once(";base64,").map(|(_, encoded)| encoded);
        let bytes = encoded.and_then(base64).map(Rc::new);
        return bytes.ok_or_else(|| uri.refuse("a data URI that is not base64", "export the file again, or as .glb"));
    }
    let name = percent_decoded(text).filter(|name| !name.contains(':') && !name.contains('\\') && !name.contains('\0'));
    let below =
        |name: &String| Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    let Some(name) = name.filter(|name| !name.is_empty() && below(name)) else {
        let what = format!("'{}' names no file beside this one", text.chars().take(80).collect::<String>());
        return Err(uri.refuse(what, "put the buffer beside the file and name it without a path, or export as .glb"));
    };
    let file = path.parent().unwrap_or(Path::new("")).join(name);
    let real = file.canonicalize().unwrap_or_else(|_| file.clone());
    if path.canonicalize().is_ok_and(|own| own == real) {
        return Err(uri.refuse("the glTF file itself, not a buffer", "name the file that has the buffer's bytes"));
    }
    if let Some(bytes) = beside.get(&real) {
        return Ok(bytes.clone());
    }
    let bytes = Rc::new(read_bounded(&file, FILE_MAX, "split the file")?);
    beside.insert(real, bytes.clone());
    Ok(bytes)
}

fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = vec![];
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let escaped = (first == b'%').then(|| after.get(..2)).flatten();
        let code = escaped.and_then(|hex| u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok());
        bytes.push(code.unwrap_or(first));
        rest = if code.is_some() { &after[2..] } else { after };
    }
    String::from_utf8(bytes).ok()
}

/// Decodes base64 with or without padding (RFC 4648); `None` if `text` is something else.
pub fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    for four in text.chunks(4) {
        let mut bits = 0u32;
        for &c in four {
            let value = match c {
                b'A'..=b'Z' => c - b'A',
                b'a'..=b'z' => c - b'a' + 26,
                b'0'..=b'9' => c - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return None,
            };
            bits = bits << 6 | u32::from(value);
        }
        let whole = match four.len() {
            1 => return None,
            n => n - 1,
        };
        bytes.extend_from_slice(&(bits << (32 - 6 * four.len())).to_be_bytes()[..whole]);
    }
    Some(bytes)
}
