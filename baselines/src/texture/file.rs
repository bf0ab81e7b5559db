//! Writes delta textures as KTX 2.0, which other tools can open.
//!
//! The images are an array of layers, R32G32B32A32_SFLOAT or R16G16B16A16_SFLOAT: two for each group of streams
//! ([`PackedGroup`](deltamorph::packed::PackedGroup)), of its first three numbers (positions in group 0) and of its last
//! (normals). Alpha is 0. A texel of a layer is a delta in input units; texels are counted row by row. Two keys map
//! texels to vertices and targets:
//!
//! - `deltamorph.names`: the names of the targets in UTF-8, each followed by a zero byte.
//! - `deltamorph.textures`: unsigned numbers of 32 bits, little endian. The version, 1; vertices; targets; groups. Then
//!   for each group: its number of streams, and of each the kind (0 position, 1 normal, 2 tangent, 256 + n texture
//!   coordinates n, 512 + n colours n, 768 wrinkle masks) and its first component of six; columns and rows of the
//!   *displacement texture*; targets + 1 numbers, the first rectangle of each target and the number of all; each
//!   rectangle as column, row, width and height in the displacement texture, and the texel of the layers that holds its
//!   first delta; and for each vertex its texel of the displacement texture, 0 if no target moves it.

use super::texels::DeltaTexels;
use deltamorph::internals::asset::{Semantic, StreamPlace};
use deltamorph::internals::pack::{DeltaFormat, POSE_FLOATS, PackedMesh};
use deltamorph::{Error, Result};
use half::f16;

const IDENTIFIER: [u8; 12] = *b"\xABKTX 20\xBB\r\n\x1A\n";
/// Offset of the descriptor: after identifier, nine numbers, the index, and one level.
const DESCRIPTOR_AT: usize = 12 + 9 * 4 + 4 * 4 + 2 * 8 + 3 * 8;
const WRITER: &[u8] = concat!("deltamorph ", env!("CARGO_PKG_VERSION"), "\0").as_bytes();
const VERSION: u32 = 1;
/// The largest image that Khronos' Android baseline promises has 8192 texels a side; devices have 16384 and more.
const SIDE: u32 = 16384;

/// The storage of deltas in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TextureFloats {
    /// Unchanged, in 32 bits.
    #[default]
    Single,
    /// The nearest half floats, ties to even: each number is off by at most 2^-11 of its size, or by 2^-25 if it is
    /// below 2^-14.
    Half,
}

/// The delta textures of a mesh as a file.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TextureFile {
    /// The file's contents.
    pub bytes: Vec<u8>,
    /// Columns and rows of each layer, in texels.
    pub size: [u32; 2],
    /// Two for each group of streams.
    pub layers: u32,
    /// Texels of a layer covered by rectangles of targets, for all groups together.
    pub covered: usize,
    /// For each group the largest rounding of each of its six numbers; 0 in 32 bits.
    pub rounding: Vec<[f64; POSE_FLOATS]>,
}

/// Makes a KTX2 file of the delta textures of a mesh.
///
/// # Errors
/// A format other than float32; a name with a zero byte; more texels than 16384 × 16384; half floats: a delta beyond
/// 65504.
pub fn write_ktx2(mesh: &PackedMesh, floats: TextureFloats) -> Result<TextureFile> {
    let layout = mesh.layout();
    let refuse = |what: String, remedy: &str| Err(Error::invalid(format!("mesh '{}': {what}", layout.name), remedy));
    if layout.format != DeltaFormat::Float32 {
        return refuse("its deltas are not packed as float32".into(), "pack it with DeltaFormat::Float32");
    }
    if let Some(target) = layout.targets.iter().find(|t| t.name.contains('\0')) {
        return refuse(format!("target '{}' has a zero byte in its name", target.name), "rename it");
    }
    let mut groups = mesh.groups().iter().map(|g| DeltaTexels::bake(g, SIDE)).collect::<Result<Vec<_>>>()?;
    // All layers are of one size, that of the group with the most texels.
    let size = groups.iter().map(|g| g.image).max_by_key(|size| size[0] * size[1]).unwrap_or([1, 1]);
    let mut words = vec![VERSION, layout.vertex_count as u32, layout.targets.len() as u32, groups.len() as u32];
    let mut texels = vec![];
    let mut rounding = vec![[0.0f64; POSE_FLOATS]; groups.len()];
    for ((group, baked), rounding) in mesh.groups().iter().zip(&mut groups).zip(&mut rounding) {
        baked.image = size;
        words.extend(stream_words(&group.layout().streams));
        words.extend(baked.size.iter().chain(&baked.first));
        words.extend(baked.words(layout.vertex_count));
        for (first, second) in [(0, false), (3, true)] {
            for (i, value) in baked.numbers(second).enumerate() {
                if floats == TextureFloats::Single {
                    texels.extend(value.to_le_bytes());
                    continue;
                }
                if value.abs() > f16::MAX.to_f32() {
                    let what = format!("a delta of {value}, half floats end at {}", f16::MAX);
                    return refuse(what, "write 32-bit floats, or scale the mesh down");
                }
                let rounded = f16::from_f32(value);
                texels.extend(rounded.to_le_bytes());
                // Alpha, the fourth number, is 0 and exact.
                if let Some(largest) = rounding.get_mut(first + i % 4) {
                    *largest = largest.max((f64::from(rounded) - f64::from(value)).abs());
                }
            }
        }
    }
    let names: Vec<u8> = layout.targets.iter().flat_map(|t| t.name.bytes().chain([0])).collect();
    let words: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
    let values = [("KTXwriter", WRITER), ("deltamorph.names", &names), ("deltamorph.textures", &words)];
    let layers = 2 * groups.len() as u32;
    let covered = groups.iter().map(DeltaTexels::covered).sum();
    let bytes = container(floats == TextureFloats::Half, size, layers, &values, &texels);
    Ok(TextureFile { bytes, size, layers, covered, rounding })
}

fn stream_words(streams: &[StreamPlace]) -> Vec<u32> {
    let places = streams.iter().flat_map(|s| [kind(s.semantic), s.first as u32]);
    [streams.len() as u32].into_iter().chain(places).collect()
}

/// Returns the kind of a stream in files, from its number in packed files: 1 to 3 for positions, normals and tangents;
/// 4 for texture coordinates, 5 for colours, with the set × 256; 6 for wrinkle masks.
fn kind(semantic: Semantic) -> u32 {
    match (semantic.id() & 0xff, semantic.id() >> 8) {
        (id @ 1..=3, _) => id - 1,
        (id, set) => (id - 3) << 8 | set,
    }
}

/// One mip level of a two-dimensional array of four-component floats, without supercompression (Khronos' KTX File Format
/// Specification 2.0): the descriptor follows the level index, and keys, which ascend, the descriptor; keys and their
/// values are padded to 4 bytes, and the level begins at a multiple of its texel.
fn container(half: bool, size: [u32; 2], layers: u32, values: &[(&str, &[u8])], texels: &[u8]) -> Vec<u8> {
    let (format, component) = if half { (97, 2) } else { (109, 4) };
    let descriptor = descriptor(8 * component);
    let mut listed = vec![];
    for (key, value) in values {
        listed.extend(((key.len() + 1 + value.len()) as u32).to_le_bytes());
        listed.extend(key.bytes().chain([0]).chain(value.iter().copied()));
        listed.resize(listed.len().next_multiple_of(4), 0);
    }
    let values_at = DESCRIPTOR_AT + descriptor.len();
    let texels_at = (values_at + listed.len()).next_multiple_of(4 * component as usize);
    let header = [format, component, size[0], size[1], 0, layers, 1, 1, 0];
    let index = [DESCRIPTOR_AT, descriptor.len(), values_at, listed.len()].map(|n| n as u32);
    // Offset and length of global data, of which there is none; then the level, with its length twice.
    let level = [0, 0, texels_at, texels.len(), texels.len()].map(|n| n as u64);
    let mut bytes = IDENTIFIER.to_vec();
    bytes.extend(header.into_iter().chain(index).flat_map(u32::to_le_bytes));
    bytes.extend(level.into_iter().flat_map(u64::to_le_bytes));
    bytes.extend(descriptor);
    bytes.extend(listed);
    bytes.resize(texels_at, 0);
    bytes.extend(texels);
    bytes
}

/// Makes Khronos' basic data format descriptor: RGBA, BT.709 primaries, linear, signed floats of `bits` bits.
fn descriptor(bits: u32) -> Vec<u8> {
    let mut words = vec![4 + 24 + 4 * 16, 0, 2 | (24 + 4 * 16) << 16, 0x01_01_01, 0, bits / 2, 0];
    for (number, channel) in [0, 1, 2, 15].into_iter().enumerate() {
        let at = number as u32 * bits;
        let float_and_signed = 0x80 | 0x40;
        let of_sample = at | (bits - 1) << 16 | (channel | float_and_signed) << 24;
        words.extend([of_sample, 0, (-1.0f32).to_bits(), 1.0f32.to_bits()]);
    }
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use deltamorph::MorphMesh;
    use deltamorph::internals::pack::PackDesc;

    fn packed(mesh: &MorphMesh) -> PackedMesh {
        PackedMesh::pack(mesh, &PackDesc::new(DeltaFormat::Float32)).expect("a mesh")
    }

    /// Another implementation reads headers, descriptors, keys and texels: those of the technique, rounded in 16 bits.
    #[test]
    fn others_read_what_is_written() {
        let mesh = packed(&testing::with_streams(testing::mesh(300, 7)));
        for (floats, format) in [
            (TextureFloats::Single, ktx2::Format::R32G32B32A32_SFLOAT),
            (TextureFloats::Half, ktx2::Format::R16G16B16A16_SFLOAT),
        ] {
            let file = write_ktx2(&mesh, floats).expect("a file");
            let reader = ktx2::Reader::new(&file.bytes[..]).expect("a KTX2 file");
            let (descriptor, type_size) = ktx2::dfd::Basic::from_format(format).expect("a descriptor");
            let header = reader.header();
            assert_eq!(
                (header.format, header.type_size, header.supercompression_scheme),
                (Some(format), type_size, None)
            );
            let counts = [header.pixel_width, header.pixel_height, header.layer_count];
            assert_eq!(counts, [file.size[0], file.size[1], file.layers]);
            assert_eq!([header.pixel_depth, header.face_count, header.level_count], [0, 1, 1]);
            assert_eq!(reader.basic_dfd(), Some(&descriptor));
            assert!(reader.writer().is_some_and(|writer| writer.starts_with("deltamorph")));
            let keys: Vec<&str> = reader.key_value_data().map(|(key, _)| key).collect();
            assert_eq!(keys, ["KTXwriter", "deltamorph.names", "deltamorph.textures"]);
            let levels: Vec<_> = reader.levels().collect();
            assert_eq!(levels.len(), 1);
            let mut found = levels[0].data.chunks_exact(type_size as usize).map(|number| match *number {
                [a, b] => f16::from_le_bytes([a, b]).to_f32(),
                [a, b, c, d] => f32::from_le_bytes([a, b, c, d]),
                _ => panic!("{type_size} bytes"),
            });
            for (group, rounding) in mesh.groups().iter().zip(&file.rounding) {
                let mut baked = DeltaTexels::bake(group, SIDE).expect("texels");
                baked.image = file.size;
                let largest = rounding.iter().copied().fold(0.0, f64::max);
                assert_eq!(largest > 0.0, floats == TextureFloats::Half);
                for expected in baked.numbers(false).chain(baked.numbers(true)) {
                    let off = f64::from(found.next().expect("a number")) - f64::from(expected);
                    assert!(off.abs() <= largest, "{expected} is off by {off}");
                }
            }
            assert_eq!(found.next(), None);
        }
    }

    #[test]
    fn streams_have_the_numbers_that_the_module_states() {
        let streams = [Semantic::Position, Semantic::Normal, Semantic::Tangent, Semantic::Mask];
        assert_eq!(streams.map(kind), [0, 1, 2, 768]);
        assert_eq!([0, 3, 255].map(|set| kind(Semantic::TexCoord(set))), [256, 259, 511]);
        assert_eq!([0, 3, 255].map(|set| kind(Semantic::Color(set))), [512, 515, 767]);
    }

    #[test]
    fn what_half_floats_do_not_reach_is_refused() {
        let mut large = testing::mesh(12, 3);
        large.targets[0].positions[0].x = 65505.0;
        let text = write_ktx2(&packed(&large), TextureFloats::Half).expect_err("too large").to_string();
        assert!(text.contains("65505") && text.contains("32-bit"), "{text}");
    }
}
