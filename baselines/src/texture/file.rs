//! Delta textures as files: KTX 2.0, which other tools can open, with the data to restore targets from them.
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
//!   first delta, followed by the others row by row (rectangles follow each other without texels between them); and for
//!   each vertex its texel of the displacement texture: 0 if no target moves it, otherwise one that no other vertex
//!   has.

use super::container::{Container, Refused};
use super::half;
use super::texels::{DeltaTexels, RECTANGLE_WORDS};
use deltamorph::glam::Vec3;
use deltamorph::internals::asset::streams::group_streams;
use deltamorph::internals::asset::{MorphMesh, MorphTarget, Semantic, StreamDeltas, StreamPlace};
use deltamorph::internals::pack::{DeltaFormat, POSE_FLOATS, PackedMesh, TARGETS_MAX};
use deltamorph::internals::read_bounded;
use deltamorph::{Error, Result};
use std::path::Path;

const NAMES: &str = "deltamorph.names";
const TEXELS: &str = "deltamorph.textures";
const WRITER: (&str, &[u8]) = ("KTXwriter", concat!("deltamorph ", env!("CARGO_PKG_VERSION"), "\0").as_bytes());
const VERSION: u32 = 1;
/// The largest image that Khronos' Android baseline promises has 8192 texels a side; devices have 16384 and more.
const SIDE: u32 = 16384;
/// No file is larger than 4 GiB.
const LARGEST_FILE: u64 = 1 << 32;

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
}

/// Makes a KTX2 file of the delta textures of a mesh.
///
/// # Errors
/// A format other than float32; a name with a zero byte; more texels than 16384 × 16384; half floats: a delta beyond
/// 65504.
pub fn write_ktx2(mesh: &PackedMesh, floats: TextureFloats) -> Result<TextureFile> {
    let (layout, single) = (mesh.layout(), floats == TextureFloats::Single);
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
    for (group, baked) in mesh.groups().iter().zip(&mut groups) {
        baked.image = size;
        words.extend(stream_words(&group.layout().streams));
        words.extend(baked.size.iter().chain(&baked.first));
        words.extend(baked.words(layout.vertex_count));
        for second in [false, true] {
            if single {
                texels.extend(baked.numbers(second).flat_map(f32::to_le_bytes));
                continue;
            }
            for value in baked.numbers(second) {
                if value.abs() > half::LARGEST {
                    let what = format!("a delta of {value}, half floats end at {}", half::LARGEST);
                    return refuse(what, "write 32-bit floats, or scale the mesh down");
                }
                texels.extend(half::from_f32(value).to_le_bytes());
            }
        }
    }
    let names: Vec<u8> = layout.targets.iter().flat_map(|t| t.name.bytes().chain([0])).collect();
    let words: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
    let values = vec![WRITER, (NAMES, &names), (TEXELS, &words)];
    let (layers, covered) = (2 * groups.len() as u32, groups.iter().map(DeltaTexels::covered).sum());
    let bytes = Container { half: !single, size, layers, values, texels: &texels }.write();
    Ok(TextureFile { bytes, size, layers, covered })
}

/// Copies `base` with the targets of a KTX2 file instead of its own. Besides the copy of `base`, it takes at most 100
/// bytes of memory per byte of the file, and 1 MiB, regardless of the counts in the file.
///
/// # Errors
/// The file cannot be read, does not match the [module](self)'s description, or is of a mesh with other vertices or
/// streams.
pub fn read_ktx2(path: &Path, base: &MorphMesh) -> Result<MorphMesh> {
    let bytes = read_bounded(path, LARGEST_FILE, "split the mesh")?;
    let targets = targets(&bytes, base).map_err(|(place, what, remedy)| Error::input(path, place, what, remedy))?;
    Ok(MorphMesh { targets, ..base.clone() })
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

/// Reads the numbers of the key in order.
struct Words<'a>(&'a [[u8; 4]]);

impl Words<'_> {
    fn take(&mut self, count: usize) -> Result<Vec<u32>, Refused> {
        let taken = self.0.split_off(..count).ok_or_else(|| refused("the list ends early"))?;
        Ok(taken.iter().map(|word| u32::from_le_bytes(*word)).collect())
    }
}

fn refused(what: impl Into<String>) -> Refused {
    (": key 'deltamorph.textures'", what.into(), "write the file anew, from the same mesh")
}

/// Reads the targets of a file for `base`.
pub(super) fn targets(bytes: &[u8], base: &MorphMesh) -> Result<Vec<MorphTarget>, Refused> {
    let file = Container::read(bytes)?;
    let no_key = |key| move || (": keys", format!("no key '{key}'"), "use a file that deltamorph wrote");
    let words = file.value(TEXELS).ok_or_else(no_key(TEXELS))?;
    let names = file.value(NAMES).ok_or_else(no_key(NAMES))?;
    let bad_names = || (": key 'deltamorph.names'", "not one name for each target".into(), "write the file anew");
    let names = std::str::from_utf8(names).map_err(|_| bad_names())?;

    let (words, rest) = words.as_chunks();
    let mut words = Words(words);
    let streams = group_streams(base.streams.iter().map(|s| s.semantic));
    let head = words.take(4)?;
    let expected = [VERSION, base.vertex_count() as u32, head[2], streams.len() as u32];
    if head != expected || file.layers as usize != 2 * streams.len() {
        let [version, vertices, _, groups] = expected;
        return Err(refused(format!(
            "version {}, {} vertices, {} groups of streams, {} layers; the base mesh needs version {version}, {vertices}, \
             {groups} and {}",
            head[0],
            head[1],
            head[3],
            file.layers,
            2 * streams.len()
        )));
    }
    // Checked before any target is made: a name takes one byte, a target in memory hundreds.
    let count = head[2] as usize;
    if count > TARGETS_MAX {
        return Err(refused(format!("{count} targets; a mesh has at most {TARGETS_MAX}")));
    }
    if names.bytes().filter(|byte| *byte == 0).count() != count || !(names.is_empty() || names.ends_with('\0')) {
        return Err(bad_names());
    }
    let mut targets: Vec<MorphTarget> = names
        .split_terminator('\0')
        .map(|name| MorphTarget {
            name: name.into(),
            streams: vec![StreamDeltas::default(); base.streams.len()],
            ..Default::default()
        })
        .collect();
    let mut sorted: Vec<&str> = targets.iter().map(|t| t.name.as_str()).collect();
    sorted.sort_unstable();
    if sorted.windows(2).any(|pair| pair[0] == pair[1]) {
        return Err(bad_names());
    }
    for (group, places) in streams.iter().enumerate() {
        let found = words.take(1 + 2 * places.len())?;
        if found != stream_words(places) {
            return Err(refused(format!("group {group} has other streams than the base mesh")));
        }
        read_group(
            &file,
            &mut words,
            group,
            &mut targets,
            |target, vertex, delta| {
                if group == 0 {
                    target.vertices.push(vertex);
                    target.positions.push(Vec3::from_slice(&delta[..3]));
                    target.normals.push(Vec3::from_slice(&delta[3..]));
                    return;
                }
                for place in places {
                    let moved = &delta[place.morphing_components()];
                    let at = base.streams.iter().position(|s| s.semantic == place.semantic);
                    if let Some(at) = at.filter(|_| moved.iter().any(|&x| x != 0.0)) {
                        target.streams[at].vertices.push(vertex);
                        target.streams[at].deltas.extend_from_slice(moved);
                    }
                }
            },
            base.vertex_count(),
        )?;
    }
    if !words.0.is_empty() || !rest.is_empty() {
        return Err(refused("numbers behind the last"));
    }
    Ok(targets)
}

/// Reads a group, and passes each delta to `keep`, ascending by vertex in each target.
fn read_group(
    file: &Container<'_>,
    words: &mut Words<'_>,
    group: usize,
    targets: &mut [MorphTarget],
    mut keep: impl FnMut(&mut MorphTarget, u32, [f32; POSE_FLOATS]),
    vertices: usize,
) -> Result<(), Refused> {
    let size = words.take(2)?;
    let all = u64::from(size[0]) * u64::from(size[1]);
    let first = words.take(targets.len() + 1)?;
    let count = first[targets.len()] as usize;
    if first[0] != 0 || first.windows(2).any(|pair| pair[0] > pair[1]) {
        return Err(refused(format!("group {group}: rectangles of targets do not ascend")));
    }
    let length = count.checked_mul(RECTANGLE_WORDS).ok_or_else(|| refused("too many rectangles"))?;
    let rectangles = words.take(length)?;
    let texels = words.take(vertices)?;
    let mut owners: Vec<(u32, u32)> = texels.iter().copied().zip(0..).filter(|(texel, _)| *texel != 0).collect();
    owners.sort_unstable();
    if owners.windows(2).any(|pair| pair[0].0 == pair[1].0) || owners.last().is_some_and(|o| u64::from(o.0) >= all) {
        return Err(refused(format!("group {group}: a vertex's texel is that of another, or outside")));
    }
    let (held, mut next) = (u64::from(file.size[0]) * u64::from(file.size[1]), 0);
    let mut number = 0..;
    for (target, range) in targets.iter_mut().zip(first.windows(2)) {
        let mut moved = vec![];
        for r in rectangles[range[0] as usize * RECTANGLE_WORDS..range[1] as usize * RECTANGLE_WORDS]
            .as_chunks::<RECTANGLE_WORDS>()
            .0
        {
            let [x, y, width, height, at] = r.map(u64::from);
            let number: u32 = number.next().unwrap_or_default();
            let inside = x + width <= size[0].into() && y + height <= size[1].into() && width * height > 0;
            // Rectangles follow each other, so all of them together take no more work than the image's size.
            if !inside || at != next || u128::from(at) + u128::from(width) * u128::from(height) > u128::from(held) {
                return Err(refused(format!("group {group}: rectangle {number} {r:?} is outside, or out of order")));
            }
            next = at + width * height;
            for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
                let texel = (y + row) * u64::from(size[0]) + x + column;
                let delta = delta(file, group, at + row * width + column);
                if !delta.iter().all(|x| x.is_finite()) {
                    let what = format!("group {group}: {delta:?} in rectangle {number}");
                    return Err((": texels", what, "replace values that are not a number or infinite"));
                }
                let owner = owners.binary_search_by_key(&texel, |(texel, _)| u64::from(*texel));
                match owner {
                    _ if delta == [0.0; POSE_FLOATS] => {}
                    Ok(owner) => moved.push((owners[owner].1, delta)),
                    Err(_) => {
                        return Err(refused(format!("group {group}: a delta of no vertex in rectangle {number}")));
                    }
                }
            }
        }
        moved.sort_unstable_by_key(|(vertex, _)| *vertex);
        if moved.windows(2).any(|pair| pair[0].0 == pair[1].0) {
            return Err(refused(format!("group {group}: two deltas of one vertex in target '{}'", target.name)));
        }
        moved.into_iter().for_each(|(vertex, delta)| keep(target, vertex, delta));
    }
    Ok(())
}

/// Reads both triples at a texel of a group's layers.
fn delta(file: &Container<'_>, group: usize, texel: u64) -> [f32; POSE_FLOATS] {
    let (layer, stride) = (file.size[0] as usize * file.size[1] as usize, file.texel_bytes());
    std::array::from_fn(|c| {
        let at = ((2 * group + c / 3) * layer + texel as usize) * stride + c % 3 * (stride / 4);
        match file.half {
            true => half::to_f32(u16::from_le_bytes([file.texels[at], file.texels[at + 1]])),
            false => f32::from_le_bytes(std::array::from_fn(|byte| file.texels[at + byte])),
        }
    })
}

#[cfg(test)]
#[path = "file_tests.rs"]
mod tests;
