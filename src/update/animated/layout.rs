//! Where everything is in the buffers of an animated crowd: groups of instances, their work lists, tables, state.

use super::clips::{Budget, Clips};
use crate::abi::numbers::{BIT_KINDS, BIT_KINDS_BUDGET, RECORD_WORDS, WORKGROUP};
use crate::abi::push::AnimationPush;
use crate::abi::worklist::{TILE_WORDS, WIDTHS, row_words};
use crate::error::Result;
use crate::pack::blocks::BlockIndex;
use crate::plan::UpdateMode;
use crate::update::blocks::gpu::set_size;
use crate::update::technique::Context;

/// A group of the mesh: its instances are split into groups that one descriptor set reaches, each with a work list.
pub(super) struct GroupLayout {
    instances: u32,
    /// Instances of a group; the last may have fewer.
    size: u32,
    /// Bytes of a group's work list.
    pub(super) stride: u64,
    /// Push constants, but for the group of instances; clock and slots are those of the last update.
    pub(super) push: AnimationPush,
}

impl GroupLayout {
    /// Of the mesh and crowd of `context`. `push` is the same for all groups of the mesh; tables and history of this one
    /// are appended to `tables` and `state`.
    fn new(context: &Context<'_>, push: AnimationPush, tables: &mut Words, state: &mut Words) -> Result<Self> {
        let (caps, instances, index) = (context.caps(), context.desc.instances, context.layout().index()?);
        let (blocks, entries) = (index.count() as u64, index.entry_count() as u64);
        // Of a tile: an item of each width for each block, a row for each entry, and one for a block without any.
        let items = (WIDTHS * TILE_WORDS) as u64 * blocks;
        let rows = row_words(WIDTHS - 1) as u64 * (entries + blocks);
        let list = 4 * (items + rows);
        // The list of a group is rounded up to whole 256 bytes, and still has to be within reach.
        let tiles = (caps.max_storage_range / 256 * 256 / list).min(caps.max_workgroups.into());
        let widest = u64::from(caps.tuning.widest_tile);
        let size = set_size(context, tiles.max(1) * widest)?;
        context.check_range("the work lists of eight instances", list.next_multiple_of(256), "split the mesh")?;
        let planning = blocks.div_ceil(WORKGROUP.into());
        let what = format!("planning mesh '{}' takes", context.layout().name);
        caps.check_limit(&what, (planning, "workgroups", caps.max_workgroups.into()), "split the mesh")?;
        let tiles = u64::from(size).div_ceil(widest);
        let capacity = tiles * blocks;
        // `Layout::new` refuses offsets beyond 32 bits.
        let push = AnimationPush {
            blocks: blocks as u32,
            entries: entries as u32,
            block_targets_at: tables.add(blocks * u64::from(push.words)),
            first_entry_at: tables.add(index.parts.first_entry.len() as u64),
            entries_at: tables.add(2 * entries),
            history_at: state.add(blocks * u64::from(instances)),
            capacity: capacity as u32,
            rows_at: ((WIDTHS * TILE_WORDS) as u64 * capacity) as u32,
            counters: instances.div_ceil(size) * WIDTHS as u32,
            chunks: capacity.div_ceil(caps.max_workgroups.into()).max(1) as u32,
            ..push
        };
        Ok(Self { instances, size, stride: (tiles * list).max(16).next_multiple_of(256), push })
    }

    /// Groups of instances.
    pub(super) fn count(&self) -> u32 {
        self.instances.div_ceil(self.size)
    }

    /// First instance of a group, and how many it has.
    pub(super) fn get(&self, group: u32) -> (u32, u32) {
        let first = group * self.size;
        (first, self.size.min(self.instances - first))
    }

    /// Where the arguments of a dispatch are in the control buffer, in bytes.
    pub(super) fn arguments(&self, group: u32, width: usize, chunk: u32) -> u64 {
        let AnimationPush { counters, chunks, .. } = self.push;
        let dispatch = u64::from(group * WIDTHS as u32 + width as u32) * u64::from(chunks) + u64::from(chunk);
        4 * (u64::from(counters) + 3 * dispatch)
    }

    /// Bytes of counters and arguments.
    pub(super) fn control_bytes(&self) -> u64 {
        self.arguments(self.count(), 0, 0)
    }
}

/// Words of a buffer that are in use.
struct Words(u64);

impl Words {
    /// Room for `count` more; where it begins.
    fn add(&mut self, count: u64) -> u32 {
        let at = self.0;
        self.0 += count;
        at as u32
    }
}

/// Where everything is in the buffers of a crowd.
pub(super) struct Layout {
    /// Of each group of the mesh; the first one's tables are those of the error budget as well.
    pub(super) groups: Vec<GroupLayout>,
    /// Bytes of clips and tables; never 0.
    pub(super) table_bytes: u64,
    pub(super) state_bytes: u64,
}

impl Layout {
    /// # Errors
    /// More than the device's storage range holds, with the numbers.
    pub(super) fn new(context: &Context<'_>, clips: &Clips, budget: Option<&Budget>) -> Result<Self> {
        let (targets, instances) = (context.layout().targets.len() as u64, u64::from(context.desc.instances));
        let words = targets.div_ceil(32).max(1);
        // A budget is not at 0, which tells kernels that there is none.
        let (mut tables, mut state) = (Words(clips.words().len().max(1) as u64), Words(0));
        let bit_kinds = if budget.is_some() { BIT_KINDS_BUDGET } else { BIT_KINDS };
        state.add(u64::from(RECORD_WORDS) * instances);
        let common = AnimationPush {
            heads: context.desc.instances,
            targets: targets as u32,
            words: words as u32,
            budget_at: budget.map_or(0, |budget| tables.add(2 + budget.reaches.len() as u64)),
            phases_at: state.add(words * instances),
            weights_at: state.add(targets * instances),
            deltas_at: state.add(targets * instances),
            bits_at: state.add(u64::from(bit_kinds) * words * instances),
            requested_at: state.add(budget.map_or(0, |_| targets * instances)),
            history_mask: ((1u64 << (context.poses.slots - 1)) - 1) as u32,
            slots: context.poses.slots,
            pairs: context.poses.format.rounds_products().into(),
            always_rebuild: (context.desc.update.mode == UpdateMode::Rebuild).into(),
            chunk_items: context.caps().max_workgroups,
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

    /// The tables, of groups with these blocks.
    pub(super) fn tables<'a>(
        &self,
        indices: impl Iterator<Item = &'a BlockIndex>,
        clips: &Clips,
        budget: Option<&Budget>,
    ) -> Vec<u32> {
        let mut words = Vec::with_capacity(self.table_bytes as usize / 4);
        words.extend_from_slice(clips.words());
        words.resize(words.len().max(1), 0);
        if let Some(budget) = budget {
            words.extend([budget.most as u32, (budget.most >> 32) as u32]);
            words.extend_from_slice(&budget.reaches);
        }
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
