//! The work list: which blocks an update writes, with which entries, and which components of them.

pub use crate::abi::worklist::{ELEMENT_BYTES, Element, ITEM_WORDS};
use crate::pack::blocks::BlockIndex;

/// A block of an instance that is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Item {
    /// The instance.
    pub instance: u32,
    /// The block.
    pub block: u32,
    /// The slot that is read; `None`: the base pose.
    pub source: Option<u32>,
    /// The slot that is written.
    pub destination: u32,
    /// Its elements: the first in [`WorkList::elements`], and how many.
    pub first: u32,
    /// Number of elements.
    pub count: u32,
}

/// What one update does: carried out by the GPU or the CPU as it is.
#[derive(Clone, Debug, Default)]
pub struct WorkList {
    /// Blocks to write, ascending by instance, then block.
    pub items: Vec<Item>,
    /// `[item][component][word]`: which vertices' components are loaded and stored.
    pub masks: Vec<u32>,
    /// `[instance][entry]`: the elements of a block lie where its entries do, the first ones being in use.
    pub elements: Vec<Element>,
}

impl WorkList {
    /// Empty, with room for every block of `instances`: filling it never allocates.
    pub fn new(index: &BlockIndex, instances: usize) -> Self {
        let blocks = index.count() * instances;
        Self {
            items: Vec::with_capacity(blocks),
            masks: Vec::with_capacity(blocks * 6 * index.mask_words()),
            elements: vec![Element::default(); index.entry_count() * instances],
        }
    }

    /// Forget the last update.
    pub fn clear(&mut self) {
        self.items.clear();
        self.masks.clear();
    }

    /// The elements of an item.
    pub fn elements_of(&self, item: &Item) -> &[Element] {
        &self.elements[item.first as usize..][..item.count as usize]
    }
}

/// Bytes that the kernels load and store for a component of a vertex. Float32: the pose in and out. Exact: the integer
/// in (not in a rebuild) and out, the base pose in, the pose out; a block that only catches up copies the pose.
pub const fn component_bytes(exact: bool, rebuilt: bool, touched: bool) -> u64 {
    match (exact, rebuilt, touched) {
        (true, true, _) => 12,
        (true, false, true) => 16,
        _ => 8,
    }
}
