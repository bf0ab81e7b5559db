//! The container KTX 2.0 (Khronos), limited to delta textures: one mip level of a two-dimensional array of
//! four-component floats, without supercompression.
//!
//! Checked by reading, section by section, against Khronos' KTX File Format Specification 2.0 (ktxspec.adoc of
//! KhronosGroup/KTX-Specification, with the Data Format Specification that it cites): identifier; `typeSize` is a
//! component's bytes; `layerCount` above 0 and `pixelDepth` 0 are a 2D array; the descriptor follows the level index,
//! and keys follow it without a gap; keys ascend, each once, none begins with "KTX" but KTXwriter, whose value ends in
//! a zero byte; a value that begins with a number of 32 bits has a key of a multiple of 4 bytes, the zero byte
//! included; entries are padded to 4 bytes, the padding counts in `kvdByteLength` alone; no global data: 0 and 0; the
//! level begins at a multiple of lcm(texel, 4), a texel's 8 or 16 bytes, and ends with the file. The descriptor is of
//! version 2, RGBSDA, BT.709, linear, straight alpha, one texel a block; samples are R, G, B, A (0, 1, 2, 15), signed
//! floats from -1 to 1.
//! Two other implementations read files of both formats: ktx-parse for JavaScript, which writes them again byte for
//! byte, and the crate ktx2, in tests. The crate does not read files here, since it panics at some damaged ones.

use std::ops::Range;

const IDENTIFIER: [u8; 12] = *b"\xABKTX 20\xBB\r\n\x1A\n";
/// Offset of the descriptor: after identifier, nine numbers, the index, and one level.
const DESCRIPTOR_AT: usize = 12 + 9 * 4 + 4 * 4 + 2 * 8 + 3 * 8;
const REMEDY: &str = "write the file anew";

/// The defect, its position, and the remedy.
pub(super) type Refused = (&'static str, String, &'static str);

/// An array of images, and the keys written with it.
pub(super) struct Container<'a> {
    /// Numbers are half floats; otherwise float32.
    pub(super) half: bool,
    pub(super) size: [u32; 2],
    pub(super) layers: u32,
    /// Keys, ascending, and values.
    pub(super) values: Vec<(&'a str, &'a [u8])>,
    /// Texels by layer, then row by row.
    pub(super) texels: &'a [u8],
}

impl<'a> Container<'a> {
    pub(super) fn texel_bytes(&self) -> usize {
        if self.half { 8 } else { 16 }
    }

    pub(super) fn write(&self) -> Vec<u8> {
        let descriptor = descriptor(self.half);
        let mut values = vec![];
        for (key, value) in &self.values {
            values.extend(((key.len() + 1 + value.len()) as u32).to_le_bytes());
            values.extend(key.bytes().chain([0]).chain(value.iter().copied()));
            values.resize(values.len().next_multiple_of(4), 0);
        }
        let values_at = DESCRIPTOR_AT + descriptor.len();
        let texels_at = (values_at + values.len()).next_multiple_of(self.texel_bytes());
        let (format, component) = if self.half { (97, 2) } else { (109, 4) };
        let header = [format, component, self.size[0], self.size[1], 0, self.layers, 1, 1, 0];
        let index = [DESCRIPTOR_AT, descriptor.len(), values_at, values.len()].map(|n| n as u32);
        let mut bytes = IDENTIFIER.to_vec();
        bytes.extend(header.into_iter().chain(index).flat_map(u32::to_le_bytes));
        let (size, no_global_data) = (self.texels.len() as u64, [0, 0]);
        let level = [texels_at as u64, size, size];
        bytes.extend(no_global_data.into_iter().chain(level).flat_map(u64::to_le_bytes));
        bytes.extend(descriptor);
        bytes.extend(values);
        bytes.resize(texels_at, 0);
        bytes.extend(self.texels);
        bytes
    }

    /// Reads a file without copying.
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self, Refused> {
        let header = |what: String| (": header", what, REMEDY);
        if !bytes.starts_with(&IDENTIFIER) || bytes.len() < DESCRIPTOR_AT {
            return Err(header("no KTX 2.0 file, or one that ends early".into()));
        }
        let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        let [format, component, width, height, depth, layers, faces, levels, compression] =
            std::array::from_fn(|i| word(12 + 4 * i));
        let half = match (format, component) {
            (97, 2) => true,
            (109, 4) => false,
            _ => {
                let what = format!("VkFormat {format} with components of {component} bytes");
                return Err((": header", what, "use R16G16B16A16_SFLOAT (97) or R32G32B32A32_SFLOAT (109)"));
            }
        };
        if [depth, faces, levels, compression] != [0, 1, 1, 0] || width == 0 || height == 0 || layers == 0 {
            let what = format!(
                "{width} × {height} × {depth} texels, {layers} layers, {faces} faces, {levels} levels, supercompression \
                 {compression}"
            );
            return Err((": header", what, "use an array of 2D images of one level, without supercompression"));
        }
        let part = |at: u64, length: u64, what: &str| {
            let range = usize::try_from(at).ok().zip(usize::try_from(length).ok());
            let range = range.and_then(|(at, length)| Some(Range { start: at, end: at.checked_add(length)? }));
            let found = range.and_then(|range| bytes.get(range));
            let end = bytes.len();
            found.ok_or_else(|| header(format!("{what}: {length} bytes at {at} of a file of {end}")))
        };
        // The descriptor repeats the format.
        part(word(48).into(), word(52).into(), "the data format descriptor")?;
        let texels = part(long(80), long(88), "the level")?;
        let bytes_of = |n: u32, of: u128| of * u128::from(n);
        let needed = [width, height, layers].into_iter().fold(if half { 8 } else { 16 }, |of, n| bytes_of(n, of));
        if texels.len() as u128 != needed || long(96) != long(88) {
            return Err(header(format!("a level of {} bytes, {needed} expected", texels.len())));
        }
        let values = values(part(word(56).into(), word(60).into(), "the keys")?)?;
        Ok(Self { half, size: [width, height], layers, values, texels })
    }

    pub(super) fn value(&self, key: &str) -> Option<&'a [u8]> {
        self.values.iter().find(|(k, _)| *k == key).map(|(_, value)| *value)
    }
}

/// Reads keys and values.
fn values(mut rest: &[u8]) -> Result<Vec<(&str, &[u8])>, Refused> {
    let bad = || (": keys", "a key or its value ends early, or keys do not ascend".to_owned(), REMEDY);
    let mut found = vec![];
    while let Some((length, after)) = rest.split_first_chunk() {
        let length = u32::from_le_bytes(*length) as usize;
        let entry = after.get(..length).ok_or_else(bad)?;
        let end = entry.iter().position(|&byte| byte == 0).ok_or_else(bad)?;
        found.push((std::str::from_utf8(&entry[..end]).map_err(|_| bad())?, &entry[end + 1..]));
        rest = after.get(length.next_multiple_of(4)..).unwrap_or_default();
    }
    let ascending = found.is_sorted_by(|a, b| a.0 < b.0);
    if rest.is_empty() && ascending { Ok(found) } else { Err(bad()) }
}

/// Makes Khronos' basic data format descriptor: RGBA, BT.709 primaries, linear, signed floats.
fn descriptor(half: bool) -> Vec<u8> {
    let (bits, texel) = if half { (16, 8) } else { (32, 16) };
    let mut words = vec![4 + 24 + 4 * 16, 0, 2 | (24 + 4 * 16) << 16, 0x01_01_01, 0, texel, 0];
    for (number, channel) in [0, 1, 2, 15].into_iter().enumerate() {
        let (at, float, signed) = (number as u32 * bits, 0x80, 0x40);
        let of_sample = at | (bits - 1) << 16 | (channel | float | signed) << 24;
        words.extend([of_sample, 0, (-1.0f32).to_bits(), 1.0f32.to_bits()]);
    }
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}
