//! Buffer layout of an animated crowd: tables, state and planned work lists.

use super::clips::Clips;
use crate::abi::numbers::{BIT_KINDS, RECORD_WORDS};
use crate::abi::push::AnimationPush;
use crate::abi::worklist::{ITEMS_MAX, TILE_WORDS, WIDTHS, row_words};
use crate::error::Result;
use crate::gpu::tuning::DeviceTuning;
use crate::pack::blocks::BlockIndex;
use crate::update::blocks::gpu::{set_size, workgroup};
use crate::update::technique::Context;
use std::ops::Range;

/// Workgroups that plan a list, before one takes several blocks: twice what an H100 runs at once.
const PLANNING_WORKGROUPS: u32 = 1 << 13;

/// Blocks planned and dispatched together: as many as have a work list that fits a descriptor.
pub struct Run {
    /// The blocks.
    pub blocks: Range<usize>,
    /// Number of their entries.
    entries: usize,
    /// Byte offset of its work list among those of a set.
    offset: u64,
}

impl Run {
    /// Cuts a mesh into runs, for descriptors of at most `most` bytes.
    fn cut(index: &BlockIndex, most: u64) -> Vec<Self> {
        let run = |blocks: Range<usize>| {
            let entries = index.entries(blocks.end - 1).end - index.entries(blocks.start).start;
            Self { blocks, entries, offset: 0 }
        };
        let mut runs: Vec<Self> = vec![];
        for block in 0..index.count() {
            if let Some(last) = runs.last_mut() {
                let longer = run(last.blocks.start..block + 1);
                if longer.list_bytes(1) <= most {
                    *last = longer;
                    continue;
                }
            }
            runs.push(run(block..block + 1));
        }
        runs
    }

    /// Capacity of a work list of `tiles` tiles, in items per width: one per block, padded to full workgroups.
    fn capacity(&self, tiles: u32) -> u32 {
        (tiles * self.blocks.len() as u32).next_multiple_of(ITEMS_MAX)
    }

    /// Bytes of a work list of `tiles` tiles: items of each width, a row per entry, and one per block without entries.
    fn list_bytes(&self, tiles: u32) -> u64 {
        let items = WIDTHS * TILE_WORDS * self.capacity(tiles) as usize;
        let rows = row_words(WIDTHS - 1) * (self.entries + self.blocks.len());
        (4 * (items as u64 + u64::from(tiles) * rows as u64)).next_multiple_of(256)
    }
}

/// A group of the mesh. Its instances are split into sets that fit a descriptor, its blocks into runs. Each run of each
/// set has its own work list and dispatches.
pub struct GroupLayout {
    instances: u32,
    /// Instances per set; the last set may have fewer.
    size: u32,
    tuning: DeviceTuning,
    runs: Vec<Run>,
    stride: u64,
    /// Push constants shared by all dispatches; clock and slots are those of the last update.
    pub push: AnimationPush,
}

impl GroupLayout {
    /// `push` holds values shared by all groups of the mesh; tables and history of this group are added to `tables` and
    /// `state`.
    fn new(context: &Context<'_>, push: AnimationPush, tables: &mut Words, state: &mut Words) -> Result<Self> {
        let caps = context.caps();
        let instances = context.desc.instances;
        let index = context.layout().index()?;
        let blocks = index.count() as u64;
        let entries = index.entry_count() as u64;
        let mut runs = Run::cut(index, caps.max_storage_range);
        let list = runs.iter().map(|run| run.list_bytes(1)).max().unwrap_or(0);
        context.check_range("the work lists of eight instances", list, "split the mesh")?;
        let [_, most] = caps.tuning.planned_blocks();
        let planning = blocks.div_ceil(most.into());
        let what = format!("planning mesh '{}' takes", context.layout().name);
        caps.check_limit(&what, (planning, "workgroups", caps.max_workgroups.into()), "split the mesh")?;
        let tuning = caps.tuning;
        let widest = tuning.widest_tile;
        let tiles = (caps.max_storage_range / list).min(caps.max_workgroups.into());
        let size = set_size(context, tiles * u64::from(widest))?;
        let tiles = size.div_ceil(widest);
        let sets = instances.div_ceil(size);
        let mut stride = 0;
        for run in &mut runs {
            run.offset = stride;
            stride += run.list_bytes(tiles);
        }
        let items = runs.iter().map(|run| run.capacity(tiles)).max().unwrap_or(0);
        let workgroup = workgroup(context)?;
        // `Layout::new` rejects offsets beyond 32 bits.
        let push = AnimationPush {
            blocks: blocks as u32,
            block_targets_at: tables.add(blocks * u64::from(push.words)),
            first_entry_at: tables.add(index.parts.first_entry.len() as u64),
            entries_at: tables.add(2 * entries),
            history_at: state.add(blocks * u64::from(instances)),
            counters: sets * (runs.len() * WIDTHS) as u32,
            workgroup_items: workgroup.items,
            chunks: items.div_ceil(workgroup.items).div_ceil(caps.max_workgroups).max(1),
            ..push
        };
        Ok(Self { instances, size, tuning, runs, stride, push })
    }

    fn sets(&self) -> u32 {
        self.instances.div_ceil(self.size)
    }

    /// Number of work lists, `[set][run]`.
    pub fn lists(&self) -> u32 {
        self.sets() * self.runs.len() as u32
    }

    /// The set and the run of a work list.
    pub fn get(&self, list: u32) -> (u32, &Run) {
        let runs = self.runs.len() as u32;
        (list / runs, &self.runs[(list % runs) as usize])
    }

    /// First instance of a set, and count.
    pub fn instances(&self, set: u32) -> (u32, u32) {
        let first = set * self.size;
        (first, self.size.min(self.instances - first))
    }

    fn tiles(&self, set: u32) -> u32 {
        self.instances(set).1.div_ceil(self.tuning.widest_tile)
    }

    /// Capacity of a work list, in items per width.
    pub fn capacity(&self, list: u32) -> u32 {
        let (set, run) = self.get(list);
        run.capacity(self.tiles(set))
    }

    /// Byte offset and length of a work list.
    pub fn place(&self, list: u32) -> (u64, u64) {
        let (set, run) = self.get(list);
        (u64::from(set) * self.stride + run.offset, run.list_bytes(self.tiles(0)))
    }

    pub(super) fn list_bytes(&self) -> u64 {
        u64::from(self.sets()) * self.stride
    }

    /// Push constants and workgroups of the dispatch that plans a work list.
    pub(super) fn plan(&self, list: u32) -> (AnimationPush, [u32; 2]) {
        let (set, run) = self.get(list);
        let (first_instance, group_instances) = self.instances(set);
        let push = AnimationPush {
            first_instance,
            group_instances,
            first_block: run.blocks.start as u32,
            run_blocks: run.blocks.len() as u32,
            run_entries: run.entries as u32,
            first_counter: list * WIDTHS as u32,
            ..self.push
        };
        let tiles = self.tiles(set);
        // As many blocks a workgroup as leave enough workgroups for all of a device.
        let [least, most] = self.tuning.planned_blocks();
        let each = (push.run_blocks * tiles / PLANNING_WORKGROUPS).clamp(least, most);
        (push, [push.run_blocks.div_ceil(each).min(push.chunk_workgroups), tiles])
    }

    /// Byte offset in the control buffer of the arguments of a dispatch.
    pub fn arguments(&self, list: u32, width: u32, chunk: u32) -> u64 {
        let AnimationPush { counters, chunks, .. } = self.push;
        let dispatch = u64::from(list * WIDTHS as u32 + width) * u64::from(chunks) + u64::from(chunk);
        4 * (u64::from(counters) + 3 * dispatch)
    }

    pub(super) fn control_bytes(&self) -> u64 {
        self.arguments(self.lists(), 0, 0)
    }
}

/// Allocates words of a buffer.
struct Words(u64);

impl Words {
    /// Adds `count` words; returns the first.
    fn add(&mut self, count: u64) -> u32 {
        let at = self.0;
        self.0 += count;
        at as u32
    }
}

/// Layout of a crowd's buffers.
pub(super) struct Layout {
    /// By group.
    pub groups: Vec<GroupLayout>,
    /// Bytes of clips and tables; never 0.
    pub table_bytes: u64,
    pub state_bytes: u64,
}

impl Layout {
    /// # Errors
    /// Sizes beyond the device's storage range.
    pub fn new(context: &Context<'_>, clips: &Clips) -> Result<Self> {
        let targets = context.layout().targets.len() as u64;
        let instances = u64::from(context.desc.instances);
        let words = targets.div_ceil(32).max(1);
        let mut tables = Words(clips.words().len() as u64);
        let mut state = Words(0);
        state.add(u64::from(RECORD_WORDS) * instances);
        let common = AnimationPush {
            instances: context.desc.instances,
            targets: targets as u32,
            words: words as u32,
            phases_at: state.add(words * instances),
            weights_at: state.add(targets * instances),
            deltas_at: state.add(targets * instances),
            bits_at: state.add(u64::from(BIT_KINDS) * words * instances),
            history_mask: ((1u64 << (context.poses.slots - 1)) - 1) as u32,
            slots: context.poses.slots,
            pairs: context.poses.format.rounds_products().into(),
            always_rebuild: context.desc.update.rebuilds().into(),
            chunk_workgroups: context.caps().max_workgroups,
            ..AnimationPush::default()
        };
        let groups = context.groups().map(|group| GroupLayout::new(&group, common, &mut tables, &mut state));
        let groups = groups.collect::<Result<Vec<_>>>()?;
        let control = groups.iter().map(GroupLayout::control_bytes).max().unwrap_or(0);
        let layout = Self { groups, table_bytes: 4 * tables.0, state_bytes: 4 * state.0 };
        for (what, bytes, remedy) in [
            ("clips and tables", layout.table_bytes, "use 16-bit keys, fewer frames, or several crowds"),
            ("the weights and histories of all instances", layout.state_bytes, "make several crowds"),
            ("the arguments of all dispatches", control, "make several crowds"),
        ] {
            context.check_range(what, bytes, remedy)?;
        }
        Ok(layout)
    }

    /// Contents of the tables; `indices` are the blocks of the groups.
    pub fn tables<'a>(&self, indices: impl Iterator<Item = &'a BlockIndex>, clips: &Clips) -> Vec<u32> {
        let mut words = Vec::with_capacity(self.table_bytes as usize / 4);
        words.extend_from_slice(clips.words());
        for (index, group) in indices.zip(&self.groups) {
            for block in 0..index.count() {
                let first = words.len();
                words.resize(first + group.push.words as usize, 0);
                for &target in &index.parts.entry_target[index.entries(block)] {
                    words[first + target as usize / 32] |= 1 << (target % 32);
                }
            }
            words.extend_from_slice(&index.parts.first_entry);
            let entries = index.parts.entry_target.iter().zip(&index.costs);
            words.extend(entries.flat_map(|(&target, cost)| [target, cost.bytes]));
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::{DeltaFormat, PackDesc, PackedMesh};
    use crate::testing;

    /// Work lists may be larger than the asset if entries are small: runs are cut to fit.
    #[test]
    fn runs_are_cut_where_their_lists_exceed_the_range() {
        let mesh = PackedMesh::pack(&testing::mesh(3000, 20), &PackDesc::new(DeltaFormat::Small)).unwrap();
        let index = mesh.layout().index().unwrap();
        let whole = Run::cut(index, u64::MAX);
        assert_eq!(whole.len(), 1);
        let most = whole[0].list_bytes(1) / 3;
        let runs = Run::cut(index, most);
        assert!(runs.len() > 3);
        let mut next = 0;
        for run in &runs {
            assert_eq!(run.blocks.start, next);
            assert!(run.list_bytes(1) <= most);
            assert_eq!(run.entries, run.blocks.clone().map(|block| index.entries(block).len()).sum::<usize>());
            next = run.blocks.end;
        }
        assert_eq!(next, index.count());
    }
}
