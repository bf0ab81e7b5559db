//! Layout of work lists: tiles with rows (crowd.comp, plan.glsl).

pub use super::numbers::{ALIGN, ITEMS_MAX, TILE, TILE_WORDS, WIDTHS};

/// Bytes of an element.
pub const ELEMENT_BYTES: usize = size_of::<Element>();
/// Most poses of a list: source and destination have 16 bits each.
pub const POSES_MAX: u64 = 1 << 16;

/// An entry and its coefficient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Element {
    /// The entry of the mesh.
    pub entry: u32,
    /// Bits of a float32 (weight) or an integer (steps of the weight grid).
    pub coefficient: u32,
}

/// Words per row in a tile of 2^width instances: an entry, a coefficient per instance, zeros up to a multiple of
/// [`ALIGN`]. Rows of a single instance take 2 words.
pub const fn row_words(width: usize) -> usize {
    if width == 0 { 2 } else { (1 + (1usize << width)).next_multiple_of(ALIGN) }
}

/// Packs the numbers of the source and destination poses, each below [`POSES_MAX`].
pub const fn poses(source: u32, destination: u32) -> u32 {
    source | destination << 16
}

/// Writes a tile, a block of several instances: `header` is block, first row word, number of rows and the mask of
/// instances that start from the base pose; [`poses`] of each instance follow.
pub fn write_tile(out: &mut [u32], header: [u32; 4], poses: impl Iterator<Item = u32>) {
    let (words, members) = out.split_at_mut(header.len());
    words.copy_from_slice(&header);
    members.iter_mut().zip(poses).for_each(|(out, poses)| *out = poses);
}
