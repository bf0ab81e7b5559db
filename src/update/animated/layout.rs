//! Where everything is in the buffers of an animated crowd: groups of instances, their work lists, tables, state.

use super::budget::Budget;
use super::clips::Clips;
use crate::abi::numbers::{BIT_KINDS, BIT_KINDS_BUDGET, RECORD_WORDS, WORKGROUP};
use crate::abi::push::AnimationPush;
use crate::error::Result;
use crate::pack::blocks::BlockIndex;
use crate::plan::UpdateMode;
use crate::update::blocks::shared::group_size;
use crate::update::blocks::{ROWS, TILE_WORDS, WIDTHS, row_words};
use crate::update::technique::Context;

/// Instances that one descriptor set reaches, and their work list.
#[derive(Clone, Copy, Debug)]
pub(super) struct Groups {
    pub(super) instances: u32,
    /// Of a group; the last may have fewer.
    pub(super) size: u32,
    /// Items of a width, at most: one for each block and tile.
    pub(super) capacity: u64,
    /// Bytes of a group's work list.
    pub(super) stride: u64,
    /// Dispatches of a width.
    pub(super) chunks: u32,
}

impl Groups {
    pub(super) fn new(context: &Context<'_>, index: &BlockIndex) -> Result<Self> {
        let (caps, instances) = (context.caps(), context.desc.instances);
        // Of a tile: an item of each width for each block, a row for each entry, and what fills rows up.
        let items = WIDTHS * TILE_WORDS * index.count();
        let rows = row_words(WIDTHS - 1) * (index.entry_count() + ROWS as usize * index.count());
        let list = 4 * (items + rows) as u64;
        // The list of a group is rounded up to whole 256 bytes, and still has to be within reach.
        let tiles = (caps.max_storage_range / 256 * 256 / list).min(caps.max_workgroups.into());
        let widest = u64::from(caps.tuning.widest_tile);
        let size = group_size(context, tiles.max(1) * widest)?;
        context.check_range("the work lists of eight instances", list.next_multiple_of(256), "split the mesh")?;
        let planning = (index.count() as u64).div_ceil(WORKGROUP.into());
        let what = format!("planning mesh '{}' takes", context.layout().name);
        caps.check_limit(&what, (planning, "workgroups", caps.max_workgroups.into()), "split the mesh")?;
        let tiles = u64::from(size).div_ceil(widest);
        let capacity = tiles * index.count() as u64;
        Ok(Self {
            instances,
            size,
            capacity,
            stride: (tiles * list).max(16).next_multiple_of(256),
            chunks: capacity.div_ceil(caps.max_workgroups.into()).max(1) as u32,
        })
    }

    pub(super) fn count(&self) -> u32 {
        self.instances.div_ceil(self.size)
    }

    /// First instance of a group, and how many it has.
    pub(super) fn get(&self, group: u32) -> (u32, u32) {
        let first = group * self.size;
        (first, self.size.min(self.instances - first))
    }

    fn counters(&self) -> u32 {
        self.count() * WIDTHS as u32
    }

    /// Where the arguments of a dispatch are in the control buffer, in bytes.
    pub(super) fn arguments(&self, group: u32, width: usize, chunk: u32) -> u64 {
        let dispatch = u64::from(group * WIDTHS as u32 + width as u32) * u64::from(self.chunks) + u64::from(chunk);
        4 * (u64::from(self.counters()) + 3 * dispatch)
    }
}

/// Where everything is in the buffers of a crowd.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) groups: Groups,
    tables: Tables,
    state: State,
    targets: u32,
    blocks: u32,
    entries: u32,
    slots: u32,
    always_rebuild: bool,
    chunk_items: u32,
}

/// Words of the tables before each part: clips; with an error budget, budget and reaches; which targets touch which
/// blocks; the first entry of each block; target and bytes of each entry.
#[derive(Clone, Copy, Debug, Default)]
struct Tables {
    budget: Option<u64>,
    block_targets: u64,
    first_entry: u64,
    entries: u64,
    end: u64,
}

/// Words of the state before each part, behind the records of all instances.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    phases: u64,
    weights: u64,
    deltas: u64,
    bits: u64,
    /// With an error budget.
    requested: u64,
    history: u64,
    end: u64,
}

impl Layout {
    /// # Errors
    /// More than the device's storage range holds, with the numbers.
    pub(super) fn new(
        context: &Context<'_>,
        index: &BlockIndex,
        clips: &Clips,
        budget: Option<&Budget>,
    ) -> Result<Self> {
        let (targets, instances) = (context.layout().targets.len() as u64, u64::from(context.desc.instances));
        let (words, blocks, entries) = (targets.div_ceil(32).max(1), index.count() as u64, index.entry_count() as u64);
        let clip_words = clips.words().len() as u64;
        let mut tables = Tables { block_targets: clip_words, ..Tables::default() };
        if budget.is_some() {
            // Not 0, which tells kernels that there is none.
            let at = clip_words.max(1);
            (tables.budget, tables.block_targets) = (Some(at), at + 2 + entries);
        }
        tables.first_entry = tables.block_targets + blocks * words;
        tables.entries = tables.first_entry + index.first_entries().len() as u64;
        tables.end = tables.entries + 2 * entries;
        let bit_kinds = u64::from(if budget.is_some() { BIT_KINDS_BUDGET } else { BIT_KINDS });
        let mut state = State { phases: u64::from(RECORD_WORDS) * instances, ..State::default() };
        state.weights = state.phases + words * instances;
        state.deltas = state.weights + targets * instances;
        state.bits = state.deltas + targets * instances;
        state.requested = state.bits + bit_kinds * words * instances;
        state.history = state.requested + if budget.is_some() { targets * instances } else { 0 };
        state.end = state.history + blocks * instances;
        let layout = Self {
            groups: Groups::new(context, index)?,
            tables,
            state,
            targets: targets as u32,
            blocks: blocks as u32,
            entries: entries as u32,
            slots: context.poses.slots,
            always_rebuild: context.desc.update.mode == UpdateMode::Rebuild,
            chunk_items: context.caps().max_workgroups,
        };
        for (what, bytes, remedy) in [
            ("clips and tables", layout.table_bytes(), "use 16-bit keys, fewer frames, or several crowds"),
            ("the weights and histories of all instances", layout.state_bytes(), "make several crowds"),
            ("the arguments of all dispatches", layout.control_bytes(), "make several crowds"),
        ] {
            context.check_range(what, bytes, remedy)?;
        }
        Ok(layout)
    }

    /// Bytes of the tables; never 0, since there is a first entry.
    pub(super) fn table_bytes(&self) -> u64 {
        4 * self.tables.end
    }

    /// Bytes of the state.
    pub(super) fn state_bytes(&self) -> u64 {
        4 * self.state.end
    }

    /// Bytes of counters and arguments.
    pub(super) fn control_bytes(&self) -> u64 {
        self.groups.arguments(self.groups.count(), 0, 0)
    }

    /// Words of a bit for each target.
    pub(super) fn target_words(&self) -> u32 {
        self.targets.div_ceil(32).max(1)
    }

    /// Blocks of the mesh.
    pub(super) fn blocks(&self) -> u32 {
        self.blocks
    }

    /// Where the weights of an instance are in the state: offset and bytes.
    #[cfg(feature = "headless")]
    pub(super) fn weights_of(&self, instance: u32) -> (u64, u64) {
        let targets = u64::from(self.targets);
        (4 * (self.state.weights + u64::from(instance) * targets), 4 * targets)
    }

    /// The tables.
    pub(super) fn tables(&self, index: &BlockIndex, clips: &Clips, budget: Option<&Budget>) -> Vec<u32> {
        let mut words = Vec::with_capacity(self.tables.end as usize);
        words.extend_from_slice(clips.words());
        if let (Some(budget), Some(at)) = (budget, self.tables.budget) {
            words.resize(at as usize, 0);
            words.extend([budget.most() as u32, (budget.most() >> 32) as u32]);
            words.extend_from_slice(budget.reaches());
        }
        for block in 0..index.count() {
            let first = words.len();
            words.resize(first + self.target_words() as usize, 0);
            for &target in &index.entry_targets()[index.entries(block)] {
                words[first + target as usize / 32] |= 1 << (target % 32);
            }
        }
        words.extend_from_slice(index.first_entries());
        words.extend(index.entry_targets().iter().zip(index.costs()).flat_map(|(&target, cost)| [target, cost.bytes]));
        words
    }

    /// What kernels have to know; clock, slots and group are those of an update. All fits 32 bits: `new` refuses more.
    pub(super) fn push(&self) -> AnimationPush {
        let Self { groups, tables, state, .. } = self;
        AnimationPush {
            heads: groups.instances,
            targets: self.targets,
            words: self.target_words(),
            blocks: self.blocks,
            entries: self.entries,
            block_targets_at: tables.block_targets as u32,
            first_entry_at: tables.first_entry as u32,
            entries_at: tables.entries as u32,
            budget_at: tables.budget.unwrap_or(0) as u32,
            phases_at: state.phases as u32,
            weights_at: state.weights as u32,
            deltas_at: state.deltas as u32,
            bits_at: state.bits as u32,
            requested_at: state.requested as u32,
            history_at: state.history as u32,
            history_mask: ((1u64 << (self.slots - 1)) - 1) as u32,
            slots: self.slots,
            always_rebuild: self.always_rebuild.into(),
            capacity: groups.capacity as u32,
            rows_at: ((WIDTHS * TILE_WORDS) as u64 * groups.capacity) as u32,
            counters: groups.counters(),
            chunks: groups.chunks,
            chunk_items: self.chunk_items,
            ..AnimationPush::default()
        }
    }
}
