//! Work lists for several instances at once: items of one block together, so that a kernel loads its deltas once.
//!
//! A tile is a block of 1, 2, 4 or 8 instances: kernels have a pipeline for each width. Its rows are the entries that any
//! of them needs, each with a coefficient for every instance. Rows of a tile begin at multiples of [`ALIGN`], so that
//! kernels can load several words at once.

use super::list::{Item, WorkList};
use crate::abi::kernels::DeviceTuning;
pub use crate::abi::numbers::ROWS;
pub use crate::abi::worklist::{ALIGN, TILE, TILE_WORDS, WIDTHS, row_words};
use crate::pack::POSE_FLOATS;
use crate::pack::blocks::BlockIndex;
use std::ops::Range;

/// A block of several instances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileItem {
    /// The block.
    pub block: u32,
    /// Index of its first row's first word in [`Tiles::rows`].
    pub first: u32,
    /// Its rows.
    pub count: u32,
    /// A bit for each instance that starts from the base pose.
    pub rebuilt: u32,
    /// Which items of the list they are.
    pub items: [u32; TILE],
}

/// What [`WorkList`] says, tile by tile.
#[derive(Clone, Debug)]
pub struct Tiles {
    /// `[kernel]`: tiles of 2^width instances for kernel number `width`. Those of rebuilt instances, where they are in
    /// tiles of their own, are for number [`WIDTHS`] + width.
    pub items: [Vec<TileItem>; 2 * WIDTHS],
    /// `[row]`: entry, then a coefficient for each instance of the tile, 0 for one that does not need the entry; see
    /// [`row_words`].
    pub rows: Vec<u32>,
    /// Rebuilt instances are in tiles of their own.
    separate: bool,
    /// How wide tiles are.
    device: DeviceTuning,
    /// Per block and part: items of the list, one after the other.
    ends: Vec<u32>,
    sorted: Vec<u32>,
    /// Per entry of a block: its coefficients, and a bit for each instance that needs it.
    table: Vec<([u32; TILE], u32)>,
}

impl Tiles {
    /// No tiles yet, with room for every block of `instances`. `separate`: instances that start from the base pose are
    /// in tiles of their own.
    pub fn new(index: &BlockIndex, instances: usize, separate: bool, device: DeviceTuning) -> Self {
        let blocks = index.count() * instances;
        Self {
            items: std::array::from_fn(|kernel| Vec::with_capacity(blocks >> (kernel % WIDTHS))),
            rows: Vec::with_capacity(Self::words_max(index, instances)),
            separate,
            device,
            ends: vec![],
            sorted: Vec::with_capacity(blocks),
            table: vec![],
        }
    }

    /// Words of rows, at most: two for an entry and instance, fewer where tiles are wide; and what pads them, which is
    /// most in tiles of one and of two.
    pub fn words_max(index: &BlockIndex, instances: usize) -> usize {
        (2 * index.entry_count() + ALIGN * index.count()) * instances
    }

    /// Forget the last update.
    pub fn clear(&mut self) {
        self.items.iter_mut().for_each(Vec::clear);
        self.rows.clear();
    }

    /// How many tiles there are for each kernel.
    pub fn counts(&self) -> [usize; 2 * WIDTHS] {
        std::array::from_fn(|kernel| self.items[kernel].len())
    }

    /// All tiles, with their widths, in the order of lists.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &TileItem)> {
        let kernels = self.items.iter().enumerate();
        kernels.flat_map(|(kernel, tiles)| tiles.iter().map(move |tile| (kernel % WIDTHS, tile)))
    }

    /// Append tiles of these items of `list`, which are ascending by instance, then block.
    pub fn fill(&mut self, index: &BlockIndex, list: &WorkList, items: Range<usize>) {
        let part = |item: &Item| 2 * item.block as usize + usize::from(self.separate && item.source.is_none());
        // A counting sort by block: for each part, first its size, then where it begins, in the end where it ends.
        self.ends.clear();
        self.ends.resize(2 * index.count() + 1, 0);
        list.items[items.clone()].iter().for_each(|item| self.ends[part(item) + 1] += 1);
        for i in 1..self.ends.len() {
            self.ends[i] += self.ends[i - 1];
        }
        self.sorted.clear();
        self.sorted.resize(items.len(), 0);
        for i in items {
            let end = &mut self.ends[part(&list.items[i])];
            self.sorted[*end as usize] = i as u32;
            *end += 1;
        }
        let mut first = 0;
        for part in 0..2 * index.count() {
            let end = self.ends[part] as usize;
            while first < end {
                let width = (end - first).min(self.device.widest_tile as usize).ilog2() as usize;
                let instances = 1 << width;
                self.push(index, list, part, first..first + instances, width);
                first += instances;
            }
        }
    }

    /// Append items `sorted` of a part: as one tile, or where that takes less, as two.
    fn push(&mut self, index: &BlockIndex, list: &WorkList, part: usize, sorted: Range<usize>, width: usize) {
        let members = &self.sorted[sorted.clone()];
        let block = part / 2;
        let entries = index.entries(block);
        let mut tile = TileItem { block: block as u32, first: self.rows.len() as u32, ..TileItem::default() };
        if let [only] = members {
            // Its elements are rows already.
            let elements = list.elements_of(&list.items[*only as usize]);
            self.rows.extend_from_slice(bytemuck::cast_slice(elements));
            tile.count = elements.len() as u32;
        } else {
            self.table.clear();
            self.table.resize(entries.len(), ([0; TILE], 0));
            for (place, &i) in members.iter().enumerate() {
                for element in list.elements_of(&list.items[i as usize]) {
                    let (row, needed) = &mut self.table[element.entry as usize - entries.start];
                    (row[place], *needed) = (element.coefficient, *needed | 1 << place);
                }
            }
            let half = members.len() / 2;
            let first = (1 << half) - 1;
            let rows = |places: u32| self.table.iter().filter(|(_, needed)| needed & places != 0).count();
            let [all, one, other] = [u32::MAX, first, !first].map(rows);
            let load = self.device.load_cost as usize;
            if (one + other) * (load + half) < all * (load + 2 * half) {
                let middle = sorted.start + half;
                self.push(index, list, part, sorted.start..middle, width - 1);
                self.push(index, list, part, middle..sorted.end, width - 1);
                return;
            }
            tile.count = all as u32;
            for (entry, (row, _)) in entries.clone().zip(&self.table).filter(|(_, (_, needed))| *needed != 0) {
                let end = self.rows.len() + row_words(width);
                self.rows.push(entry as u32);
                self.rows.extend_from_slice(&row[..members.len()]);
                self.rows.resize(end, 0);
            }
        }
        let multiple = if members.len() > 1 { ROWS } else { 1 };
        while tile.count == 0 || !tile.count.is_multiple_of(multiple) {
            // Of a block that no target touches: any entry.
            let end = self.rows.len() + row_words(width);
            self.rows.push(entries.start.min(index.entry_count().saturating_sub(1)) as u32);
            self.rows.resize(end, 0);
            tile.count += 1;
        }
        self.rows.resize(self.rows.len().next_multiple_of(ALIGN), 0);
        for (place, &i) in members.iter().enumerate() {
            tile.items[place] = i;
            tile.rebuilt |= u32::from(list.items[i as usize].source.is_none()) << place;
        }
        self.items[part % 2 * WIDTHS + width].push(tile);
    }

    /// Bytes that kernels load and store for these tiles, and those that are not of lists.
    pub fn bytes(&self, index: &BlockIndex, exact: bool) -> [u64; 2] {
        let (mut moved, mut floor) = (0, 0);
        for (width, tile) in self.iter() {
            let (instances, stride) = (1u64 << width, row_words(width));
            // Exact: base in, integers in and out, poses out.
            let pose = if exact { 4 + 12 * instances } else { 8 * instances };
            let rows = &self.rows[tile.first as usize..][..tile.count as usize * stride];
            let deltas: u64 = rows.chunks_exact(stride).map(|row| u64::from(index.costs[row[0] as usize].bytes)).sum();
            let least = deltas + (index.size() * POSE_FLOATS) as u64 * pose;
            floor += least;
            moved += least + 4 * (4 + instances + rows.len() as u64);
        }
        [moved, floor]
    }
}
