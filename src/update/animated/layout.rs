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
    /// Of each group of the mesh; the first one's tables are those of the error budget as well.
    pub(super) of_groups: Vec<GroupLayout>,
    /// Words of the tables before the budget and the reaches, and in all.
    budget: Option<u64>,
    tables_end: u64,
    state: State,
    targets: u32,
    slots: u32,
    always_rebuild: bool,
    chunk_items: u32,
}

/// What a group of the mesh has of its own.
#[derive(Clone, Debug)]
pub(super) struct GroupLayout {
    /// Groups of instances.
    pub(super) groups: Groups,
    pub(super) blocks: u32,
    entries: u32,
    /// Words of the tables before each part: which targets touch which blocks; the first entry of each block; target
    /// and bytes of each entry.
    block_targets: u64,
    first_entry: u64,
    entries_at: u64,
    /// Words of the state before its history.
    history: u64,
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
    /// Behind it are the histories of all groups of the mesh.
    end: u64,
}

impl Layout {
    /// # Errors
    /// More than the device's storage range holds, with the numbers.
    pub(super) fn new(context: &Context<'_>, clips: &Clips, budget: Option<&Budget>) -> Result<Self> {
        let (targets, instances) = (context.layout().targets.len() as u64, u64::from(context.desc.instances));
        let words = targets.div_ceil(32).max(1);
        let mut tables_end = clips.words().len() as u64;
        let budget_at = budget.map(|budget| {
            // Not 0, which tells kernels that there is none.
            let at = tables_end.max(1);
            tables_end = at + 2 + budget.reaches().len() as u64;
            at
        });
        let bit_kinds = u64::from(if budget.is_some() { BIT_KINDS_BUDGET } else { BIT_KINDS });
        let mut state = State { phases: u64::from(RECORD_WORDS) * instances, ..State::default() };
        state.weights = state.phases + words * instances;
        state.deltas = state.weights + targets * instances;
        state.bits = state.deltas + targets * instances;
        state.requested = state.bits + bit_kinds * words * instances;
        state.end = state.requested + if budget.is_some() { targets * instances } else { 0 };
        let group = |context: Context<'_>| {
            let index = context.layout().index()?;
            let (blocks, entries) = (index.count() as u64, index.entry_count() as u64);
            let (block_targets, history) = (tables_end, state.end);
            let first_entry = block_targets + blocks * words;
            let entries_at = first_entry + index.first_entries().len() as u64;
            (tables_end, state.end) = (entries_at + 2 * entries, history + blocks * instances);
            let (blocks, entries) = (blocks as u32, entries as u32);
            let groups = Groups::new(&context, index)?;
            Ok(GroupLayout { groups, blocks, entries, block_targets, first_entry, entries_at, history })
        };
        let layout = Self {
            of_groups: context.groups().map(group).collect::<Result<_>>()?,
            budget: budget_at,
            tables_end,
            state,
            targets: targets as u32,
            slots: context.poses.slots,
            always_rebuild: context.desc.update.mode == UpdateMode::Rebuild,
            chunk_items: context.caps().max_workgroups,
        };
        let control = layout.of_groups.iter().map(GroupLayout::control_bytes).max().unwrap_or(0);
        for (what, bytes, remedy) in [
            ("clips and tables", layout.table_bytes(), "use 16-bit keys, fewer frames, or several crowds"),
            ("the weights and histories of all instances", layout.state_bytes(), "make several crowds"),
            ("the arguments of all dispatches", control, "make several crowds"),
        ] {
            context.check_range(what, bytes, remedy)?;
        }
        Ok(layout)
    }

    /// Bytes of the tables; never 0, since there is a first entry.
    pub(super) fn table_bytes(&self) -> u64 {
        4 * self.tables_end
    }

    /// Bytes of the state.
    pub(super) fn state_bytes(&self) -> u64 {
        4 * self.state.end
    }

    /// Words of a bit for each target.
    pub(super) fn target_words(&self) -> u32 {
        self.targets.div_ceil(32).max(1)
    }

    /// Where the weights of an instance are in the state: offset and bytes.
    #[cfg(feature = "headless")]
    pub(super) fn weights_of(&self, instance: u32) -> (u64, u64) {
        let targets = u64::from(self.targets);
        (4 * (self.state.weights + u64::from(instance) * targets), 4 * targets)
    }

    /// The tables, of groups with these blocks.
    pub(super) fn tables<'a>(
        &self,
        indices: impl Iterator<Item = &'a BlockIndex>,
        clips: &Clips,
        budget: Option<&Budget>,
    ) -> Vec<u32> {
        let mut words = Vec::with_capacity(self.tables_end as usize);
        words.extend_from_slice(clips.words());
        if let (Some(budget), Some(at)) = (budget, self.budget) {
            words.resize(at as usize, 0);
            words.extend([budget.most() as u32, (budget.most() >> 32) as u32]);
            words.extend_from_slice(budget.reaches());
        }
        for index in indices {
            for block in 0..index.count() {
                let first = words.len();
                words.resize(first + self.target_words() as usize, 0);
                for &target in &index.entry_targets()[index.entries(block)] {
                    words[first + target as usize / 32] |= 1 << (target % 32);
                }
            }
            words.extend_from_slice(index.first_entries());
            let entries = index.entry_targets().iter().zip(index.costs());
            words.extend(entries.flat_map(|(&target, cost)| [target, cost.bytes]));
        }
        words
    }

    /// What kernels have to know of a group of the mesh; clock, slots and group of instances are those of an update.
    /// All fits 32 bits: `new` refuses more.
    pub(super) fn push(&self, group: &GroupLayout) -> AnimationPush {
        let (groups, state) = (&group.groups, &self.state);
        AnimationPush {
            heads: groups.instances,
            targets: self.targets,
            words: self.target_words(),
            blocks: group.blocks,
            entries: group.entries,
            block_targets_at: group.block_targets as u32,
            first_entry_at: group.first_entry as u32,
            entries_at: group.entries_at as u32,
            budget_at: self.budget.unwrap_or(0) as u32,
            phases_at: state.phases as u32,
            weights_at: state.weights as u32,
            deltas_at: state.deltas as u32,
            bits_at: state.bits as u32,
            requested_at: state.requested as u32,
            history_at: group.history as u32,
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

impl GroupLayout {
    /// Bytes of counters and arguments.
    pub(super) fn control_bytes(&self) -> u64 {
        self.groups.arguments(self.groups.count(), 0, 0)
    }
}
