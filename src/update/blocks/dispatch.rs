//! Dispatches of a group's work list on a device, and tiles for kernels that process several instances at once.
//!
//! A tile is a block of 1, 2, 4 or 8 instances whose deltas are loaded once; there is a pipeline for each width. Its
//! rows are the entries that any of them needs, each with a coefficient per instance. The rows of a tile start at a
//! multiple of [`ALIGN`], so that kernels can load several words at once.

use super::group::{GroupPlan, Item, WorkList};
use crate::abi::worklist::{ALIGN, TILE, WIDTHS, row_words};
use crate::gpu::tuning::DeviceTuning;
use crate::pack::PoseFormat;
use crate::pack::blocks::BlockIndex;
use crate::plan::steps::{Resource, Steps, Use, Work};
use std::ops::Range;

/// How a device executes work lists.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dispatching {
    /// Instances per descriptor set.
    pub group: u32,
    /// Number of tile widths.
    pub widths: u32,
    /// Limits and costs of tiles.
    pub tuning: DeviceTuning,
    /// Most workgroups per dispatch.
    pub most: u32,
    /// Tiles per workgroup.
    pub items: u32,
    /// Each dispatch is a step. They write different blocks, and a storage buffer in common tells synchronization
    /// validation as much; as texels, poses are loaded through one descriptor and stored through another, for which it
    /// asks for a barrier. Software drivers, the only ones, run one dispatch after the other anyway.
    pub texels: bool,
}

impl Dispatching {
    /// Most padding tiles of a kernel, which fill up workgroups, for `instances`.
    pub fn padding(&self, instances: usize) -> usize {
        (self.items as usize - 1) * instances.div_ceil(self.group as usize)
    }
}

/// Memory that dispatches of blocks use.
const USES: &[Use] = &[Use::read(Resource::Asset), Use::read(Resource::Poses), Use::write(Resource::Poses)];

/// Number of tile kernels: each width, with instances that start from the base pose or not.
pub(super) const KERNELS: usize = 2 * WIDTHS;

/// The dispatches of an update of a group.
pub(crate) struct Dispatches {
    how: Dispatching,
    group: u32,
    works: Vec<Work>,
    pub tiles: Tiles,
}

impl Dispatches {
    /// `group` is the index of the group of `plan`.
    pub fn new(how: Dispatching, group: u32, plan: &GroupPlan, instances: usize) -> Self {
        let tiles = Tiles::new(&plan.index, instances, how.tuning, how.padding(instances));
        Self { how, group, works: vec![], tiles }
    }

    /// Creates the dispatches of a planned work list, and counts loads and stores of tiles, which instances share.
    /// Returns whether there are any.
    pub fn fill(&mut self, plan: &mut GroupPlan) -> bool {
        let pose = plan.pose();
        let GroupPlan { index, list, stats, .. } = plan;
        self.works.clear();
        self.tiles.clear();
        let size = self.how.group;
        let mut first = 0;
        for run in list.items.chunk_by(|a, b| a.instance / size == b.instance / size) {
            let end = first + run.len();
            let before = self.tiles.counts();
            self.tiles.sort(index, list, first..end);
            self.tiles.fill(index, list);
            self.tiles.fill_workgroups(before, self.how.items as usize);
            for (kernel, (before, after)) in before.into_iter().zip(self.tiles.counts()).enumerate() {
                self.dispatch(kernel, run[0].instance / size, before..after);
            }
            first = end;
        }
        [stats.bytes_moved, stats.bytes_floor] = self.tiles.bytes(index, pose);
        !self.works.is_empty()
    }

    fn dispatch(&mut self, kernel: usize, instance: u32, items: Range<usize>) {
        let most = self.how.most as usize * self.how.items as usize;
        let end = items.end;
        let group = self.group;
        for first in items.step_by(most) {
            let items = first as u32..end.min(first + most) as u32;
            self.works.push(Work { kernel: kernel as u32, group, instance, items, ..Work::default() });
        }
    }

    /// Appends the dispatches of all groups to `steps`.
    pub fn append<'a>(groups: impl Iterator<Item = &'a Self> + Clone, steps: &mut Steps) {
        // Groups share no memory: their k-th dispatches can always form one step.
        let most = groups.clone().map(|group| group.works.len()).max().unwrap_or(0);
        let size = if groups.clone().any(|group| group.how.texels) { 1 } else { most.max(1) };
        for first in (0..most).step_by(size) {
            steps.step(USES);
            for group in groups.clone() {
                group.works.iter().skip(first).take(size).for_each(|work| steps.push(work.clone()));
            }
        }
    }

    /// Index in the list of a work's first item.
    pub fn place(&self, work: &Work) -> usize {
        let before = self.tiles.items[..work.kernel as usize].iter().map(Vec::len);
        before.sum::<usize>() + work.items.start as usize
    }

    /// The items of a work.
    pub fn items_of<'a>(&'a self, list: &'a WorkList, work: &Work) -> impl Iterator<Item = &'a Item> {
        let kernel = work.kernel as usize;
        let tiles = &self.tiles.items[kernel][work.items.start as usize..work.items.end as usize];
        tiles.iter().flat_map(move |tile| tile.members(kernel % WIDTHS)).map(|&i| &list.items[i as usize])
    }
}

/// A block of several instances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileItem {
    /// The block.
    pub block: u32,
    /// Index of its first row's first word in [`Tiles::rows`].
    pub first: u32,
    /// Number of rows; 0: padding of a workgroup.
    pub count: u32,
    /// Mask of instances that start from the base pose.
    pub rebuilt: u32,
    /// Indices of its items in the list.
    pub items: [u32; TILE],
}

impl TileItem {
    /// Indices of the items in a tile of 2^width instances.
    pub fn members(&self, width: usize) -> &[u32] {
        &self.items[..if self.count == 0 { 0 } else { 1 << width }]
    }
}

/// A [`WorkList`], arranged in tiles.
#[derive(Clone, Debug)]
pub struct Tiles {
    /// `[kernel]`: tiles of 2^width instances at index `width`; tiles of rebuilt instances at [`WIDTHS`] + width.
    pub items: [Vec<TileItem>; 2 * WIDTHS],
    /// `[row]`: an entry, then a coefficient per instance of the tile, 0 if it does not need the entry; see
    /// [`row_words`].
    pub rows: Vec<u32>,
    /// Limits and costs of tiles.
    device: DeviceTuning,
    /// By half (block, rebuilt or not): end of its items in `sorted`.
    ends: Vec<u32>,
    sorted: Vec<u32>,
    /// By entry of a block: coefficients, and mask of instances that need it.
    table: Vec<([u32; TILE], u32)>,
}

impl Tiles {
    /// Reserves room for every block of `instances`, and `padding` tiles per kernel.
    pub fn new(index: &BlockIndex, instances: usize, device: DeviceTuning, padding: usize) -> Self {
        let blocks = index.count().saturating_mul(instances);
        Self {
            items: std::array::from_fn(|kernel| Vec::with_capacity((blocks >> (kernel % WIDTHS)) + padding)),
            rows: Vec::with_capacity(Self::words_max(index, instances)),
            device,
            ends: vec![],
            sorted: Vec::with_capacity(blocks),
            table: vec![],
        }
    }

    /// Most words of rows: two per entry and instance (fewer in wide tiles), plus alignment, which is largest in tiles
    /// of one and two.
    pub fn words_max(index: &BlockIndex, instances: usize) -> usize {
        (2 * index.entry_count() + ALIGN * index.count()).saturating_mul(instances)
    }

    /// Removes all tiles.
    pub fn clear(&mut self) {
        self.items.iter_mut().for_each(Vec::clear);
        self.rows.clear();
    }

    /// Number of tiles per kernel.
    pub fn counts(&self) -> [usize; 2 * WIDTHS] {
        std::array::from_fn(|kernel| self.items[kernel].len())
    }

    /// All tiles with their log2 widths, in list order.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &TileItem)> {
        let kernels = self.items.iter().enumerate();
        kernels.flat_map(|(kernel, tiles)| tiles.iter().map(move |tile| (kernel % WIDTHS, tile)))
    }

    /// Sorts `items` of `list` (ascending by instance, then block) by block, for [`fill`](Self::fill).
    pub fn sort(&mut self, index: &BlockIndex, list: &WorkList, items: Range<usize>) {
        let half = |item: &Item| 2 * item.block as usize + usize::from(item.source.is_none());
        // Counting sort by block and half: `ends` holds sizes, then starts, finally ends.
        self.ends.clear();
        self.ends.resize(2 * index.count() + 1, 0);
        list.items[items.clone()].iter().for_each(|item| self.ends[half(item) + 1] += 1);
        for i in 1..self.ends.len() {
            self.ends[i] += self.ends[i - 1];
        }
        self.sorted.clear();
        self.sorted.resize(items.len(), 0);
        for i in items {
            let end = &mut self.ends[half(&list.items[i])];
            self.sorted[*end as usize] = i as u32;
            *end += 1;
        }
    }

    /// Appends tiles for the sorted items.
    pub fn fill(&mut self, index: &BlockIndex, list: &WorkList) {
        let mut first = 0;
        for half in 0..2 * index.count() {
            let end = self.ends[half] as usize;
            while first < end {
                let width = (end - first).min(self.device.widest_tile as usize).ilog2() as usize;
                let instances = 1 << width;
                self.push(index, list, half, first..first + instances, width);
                first += instances;
            }
        }
    }

    /// Pads the tiles added since the counts were `before` with empty ones to full workgroups of `items`.
    pub fn fill_workgroups(&mut self, before: [usize; KERNELS], items: usize) {
        for (tiles, before) in self.items.iter_mut().zip(before) {
            tiles.resize(before + (tiles.len() - before).next_multiple_of(items), TileItem::default());
        }
    }

    /// Appends the items `sorted` of one half of a block as one tile or, if cheaper, as two.
    fn push(&mut self, index: &BlockIndex, list: &WorkList, half: usize, sorted: Range<usize>, width: usize) {
        let members = &self.sorted[sorted.clone()];
        let block = half / 2;
        let entries = index.entries(block);
        let mut tile = TileItem { block: block as u32, first: self.rows.len() as u32, ..TileItem::default() };
        if let [only] = members {
            // Its elements already form rows.
            let elements = list.elements_of(&list.items[*only as usize]);
            self.rows.extend_from_slice(bytemuck::cast_slice(elements));
            tile.count = elements.len() as u32;
        } else {
            self.table.clear();
            self.table.resize(entries.len(), ([0; TILE], 0));
            for (member, &i) in members.iter().enumerate() {
                for element in list.elements_of(&list.items[i as usize]) {
                    let (row, needed) = &mut self.table[element.entry as usize - entries.start];
                    (row[member], *needed) = (element.coefficient, *needed | 1 << member);
                }
            }
            let narrow = members.len() / 2;
            let first = (1 << narrow) - 1;
            let rows = |these: u32| self.table.iter().filter(|(_, needed)| needed & these != 0).count();
            let [all, one, other] = [u32::MAX, first, !first].map(rows);
            let load = self.device.load_cost as usize;
            if (one + other) * (load + narrow) < all * (load + 2 * narrow) {
                let middle = sorted.start + narrow;
                self.push(index, list, half, sorted.start..middle, width - 1);
                self.push(index, list, half, middle..sorted.end, width - 1);
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
        if tile.count == 0 {
            // A block that no target touches: any existing entry.
            let end = self.rows.len() + row_words(width);
            self.rows.push(entries.start.min(index.entry_count().saturating_sub(1)) as u32);
            self.rows.resize(end, 0);
            tile.count = 1;
        }
        self.rows.resize(self.rows.len().next_multiple_of(ALIGN), 0);
        for (member, &i) in members.iter().enumerate() {
            tile.items[member] = i;
            tile.rebuilt |= u32::from(list.items[i as usize].source.is_none()) << member;
        }
        self.items[half % 2 * WIDTHS + width].push(tile);
    }

    /// Bytes that kernels load and store for these tiles, and the same without lists.
    pub fn bytes(&self, index: &BlockIndex, pose: PoseFormat) -> [u64; 2] {
        let (mut moved, mut floor) = (0, 0);
        for (width, tile) in self.iter().filter(|(_, tile)| tile.count > 0) {
            let instances = 1u64 << width;
            let stride = row_words(width);
            let size = index.size() as u64;
            // Source poses: each instance's own, or the base pose, which the instances share.
            let sources = match tile.rebuilt {
                0 => instances * pose.stride() as u64,
                _ => pose.base_stride() as u64,
            };
            let rows = &self.rows[tile.first as usize..][..tile.count as usize * stride];
            // A mesh without entries has rows that name none.
            let costs = rows.chunks_exact(stride).filter_map(|row| index.costs.get(row[0] as usize));
            let deltas: u64 = costs.map(|cost| u64::from(cost.bytes)).sum();
            let least = deltas + size * (sources + instances * pose.stride() as u64);
            floor += least;
            moved += least + 4 * (4 + instances + rows.len() as u64);
        }
        [moved, floor]
    }
}
