//! Where everything is in the buffers of an animated crowd: groups of instances, their work lists, tables, state.

use crate::abi::numbers::{BIT_KINDS, BIT_KINDS_BUDGET, RECORD_WORDS, WORKGROUP};
use crate::abi::push::AnimationPush;
use crate::abi::worklist::POSES_MAX;
use crate::animation::{Budget, Clips};
use crate::engine::blocks::whole_tiles;
use crate::engine::crowd::CrowdDesc;
use crate::error::{Error, Result};
use crate::gpu::device::Device;
use crate::pack::PackedLayout;
use crate::pack::blocks::BlockIndex;
use crate::plan::blocks::{ROWS, TILE_WORDS, WIDTHS, row_words};

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
    pub(super) fn new(device: &Device, layout: &PackedLayout, index: &BlockIndex, desc: &CrowdDesc) -> Result<Self> {
        let (caps, slots) = (&device.caps, u64::from(desc.update.slots));
        let per_instance = layout.pose_bytes() * slots;
        // Of a tile: an item of each width for each block, a row for each entry, and what fills rows up.
        let items = WIDTHS * TILE_WORDS * index.count();
        let rows = row_words(WIDTHS - 1) * (index.entry_count() + ROWS as usize * index.count());
        let list = 4 * (items + rows) as u64;
        let refuse = |what: &str, bytes: u64, remedy: &str| {
            let most = caps.max_storage_range;
            let text = format!("{what} of mesh '{}' take {bytes} bytes, {} allows {most}", layout.name, caps.name);
            Err(Error::invalid(text, remedy))
        };
        let poses = (caps.max_storage_range / per_instance).min(POSES_MAX / slots).min(desc.instances.into());
        if poses == 0 {
            return refuse("the slots of one instance", per_instance, "use fewer slots, or split the mesh");
        }
        // The list of a group is rounded up to whole 256 bytes, and still has to be within reach.
        let tiles = (caps.max_storage_range / 256 * 256 / list).min(caps.max_workgroups.into());
        if tiles == 0 {
            return refuse("the work lists of eight instances", list, "split the mesh");
        }
        let groups = (index.count() as u64).div_ceil(WORKGROUP.into());
        if groups > caps.max_workgroups.into() {
            let text = format!(
                "planning mesh '{}' takes {groups} workgroups, {} allows {}",
                layout.name, caps.name, caps.max_workgroups
            );
            return Err(Error::invalid(text, "split the mesh"));
        }
        let widest = u64::from(caps.tuning.widest_tile);
        let size = whole_tiles(poses.min(tiles * widest), desc.instances);
        let tiles = u64::from(size).div_ceil(widest);
        let capacity = tiles * index.count() as u64;
        Ok(Self {
            instances: desc.instances,
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

    pub(super) fn counters(&self) -> u32 {
        self.count() * WIDTHS as u32
    }

    /// Where the arguments of a dispatch are in the control buffer, in bytes.
    pub(super) fn arguments(&self, group: u32, width: usize, chunk: u32) -> u64 {
        let dispatch = u64::from(group * WIDTHS as u32 + width as u32) * u64::from(self.chunks) + u64::from(chunk);
        4 * (u64::from(self.counters()) + 3 * dispatch)
    }
}

/// Clips, then, with an error budget, budget and reaches; which targets touch which blocks, the first entry of each block, target and bytes of each entry.
pub(super) fn tables(clips: &Clips, budget: Option<&Budget>, index: &BlockIndex, push: &mut AnimationPush) -> Vec<u32> {
    let mut words = clips.words().to_vec();
    if let Some(budget) = budget {
        // Not 0, which says that there is none.
        words.resize(words.len().max(1), 0);
        push.budget_at = words.len() as u32;
        words.extend([budget.most() as u32, (budget.most() >> 32) as u32]);
        words.extend_from_slice(budget.reaches());
    }
    push.block_targets_at = words.len() as u32;
    for block in 0..index.count() {
        let first = words.len();
        words.resize(first + push.words as usize, 0);
        for &target in &index.entry_targets()[index.entries(block)] {
            words[first + target as usize / 32] |= 1 << (target % 32);
        }
    }
    push.first_entry_at = words.len() as u32;
    words.extend_from_slice(index.first_entries());
    push.entries_at = words.len() as u32;
    words.extend(index.entry_targets().iter().zip(index.costs()).flat_map(|(&target, cost)| [target, cost.bytes]));
    words
}

/// Lay the state out; its words.
pub(super) fn state_words(push: &mut AnimationPush) -> u64 {
    let [heads, targets, words, blocks] = [push.heads, push.targets, push.words, push.blocks].map(u64::from);
    let budget = push.budget_at != 0;
    let bit_kinds = u64::from(if budget { BIT_KINDS_BUDGET } else { BIT_KINDS });
    let mut at = u64::from(RECORD_WORDS) * heads;
    for (place, each) in [
        (&mut push.phases_at, words),
        (&mut push.weights_at, targets),
        (&mut push.deltas_at, targets),
        (&mut push.bits_at, bit_kinds * words),
        (&mut push.requested_at, if budget { targets } else { 0 }),
        (&mut push.history_at, blocks),
    ] {
        // More than 32 bits is refused before anything is made.
        *place = at as u32;
        at += each * heads;
    }
    at
}
