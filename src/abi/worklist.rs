//! Work lists word by word: items with masks and elements (blocks.comp), tiles with rows (crowd.comp, plan.comp).

use super::numbers::REBUILT;
pub use super::numbers::{ALIGN, ITEM_WORDS, ITEMS_MAX, TILE, TILE_WORDS, WIDTHS};

/// Bytes of an element.
pub const ELEMENT_BYTES: usize = size_of::<Element>();
/// Poses that a list can name: 16 bits each for source and destination.
pub const POSES_MAX: u64 = 1 << 16;

/// An entry, and the coefficient it is added with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Element {
    /// The entry of the mesh.
    pub entry: u32,
    /// Bits of a float32 (weights) or of an integer (steps of the weight grid).
    pub coefficient: u32,
}

/// Words of a row in a tile of 2^width instances: an entry, a coefficient for each, and zeros up to a multiple of
/// [`ALIGN`]; two rows of a single instance share that many.
pub const fn row_words(width: usize) -> usize {
    if width == 0 { 2 } else { (1 + (1usize << width)).next_multiple_of(ALIGN) }
}

/// Numbers of the poses that are read and written, below [`POSES_MAX`].
pub const fn poses(source: u32, destination: u32) -> u32 {
    source | destination << 16
}

/// An item: a block of one instance, and its first element and their number.
pub const fn item(block: u32, from_base: bool, poses: u32, first: u32, count: u32) -> [u32; ITEM_WORDS] {
    [if from_base { block | REBUILT } else { block }, poses, first, count]
}

/// Write a tile: a block of several instances, index of the first row's first word, number of rows, a bit for each
/// instance that starts from the base pose, and the [`poses`] of each.
pub fn write_tile(out: &mut [u32], head: [u32; 4], poses: impl Iterator<Item = u32>) {
    let (words, places) = out.split_at_mut(head.len());
    words.copy_from_slice(&head);
    places.iter_mut().zip(poses).for_each(|(out, poses)| *out = poses);
}
