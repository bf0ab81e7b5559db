//! Phase 2 of an update: decides which blocks are written, from which source, and with which entries.
//!
//! A block is written if a changed target touches it, or if it is stale in the next slot; a stale block is copied and
//! updated at once. Each block of each instance starts from the current pose or, if that moves no more bytes, from the
//! base pose. It also starts from the base pose if the bound on accumulated [`rounding`] would exceed the tolerance,
//! or, where a rebuild alone exceeds it, twice what the last one left.

use super::group::{GroupPlan, Item, rounding};
use super::plan::BlockState;
use crate::abi::worklist::ELEMENT_BYTES;

impl BlockState {
    /// Lists the blocks that bring the second slot to the committed weights. The first slot is current, and matches
    /// this state if `known`.
    pub fn emit(&mut self, group: &mut GroupPlan, instance: usize, [current, destination]: [u32; 2], known: bool) {
        // The instance has no pose, or was left out of updates.
        if !known {
            self.is_stale.fill(true);
        }
        let GroupPlan { index, list, stats, desc, unit, tolerance, scratch, .. } = &mut *group;
        let pose_bytes = (index.size() * desc.pose.stride()) as u64;
        let base_bytes = (index.size() * desc.pose.base_stride()) as u64;
        for block in 0..index.count() {
            let entries = index.entries(block);
            let first = instance * index.entry_count() + entries.start;
            let mut listed = scratch.ends[block] - entries.start as u32;
            let touched = listed > 0;
            let is_stale = self.is_stale[destination as usize * index.count() + block];
            if !touched && !is_stale {
                continue;
            }
            // Bytes of the listed entries, and how far they move a vertex at most.
            let mut deltas = 0;
            let mut reach = 0.0;
            for element in &list.elements[first..first + listed as usize] {
                let cost = &index.costs[element.entry as usize];
                deltas += cost.bytes;
                reach += unit.size(element.coefficient) * cost.reach;
            }
            let sum = self.blocks[block];
            let magnitude = index.block_base[block] + self.largest_weight * index.block_reach[block];
            let bound = sum.bound + rounding(magnitude, listed, reach);
            let exceeded = touched && bound > sum.limit;
            let is_cheaper = sum.active_bytes <= deltas;
            let rebuilt = !known || touched && (exceeded || desc.rebuilds() || is_cheaper);
            if rebuilt {
                (listed, reach) = self.list_active(index, *unit, block, &mut list.elements[first..]);
                deltas = sum.active_bytes;
                let fresh = rounding(magnitude, listed, reach);
                self.blocks[block].bound = fresh;
                if fresh > *tolerance {
                    // The next rebuild would leave about as much: wait until as much again has come up.
                    self.blocks[block].limit = 2.0 * fresh;
                } else if exceeded || sum.limit > *tolerance {
                    self.blocks[block].limit = *tolerance;
                }
            } else if touched {
                self.blocks[block].bound = bound;
            }
            if touched || rebuilt {
                for slot in 0..desc.slots as usize {
                    self.is_stale[slot * index.count() + block] = true;
                }
            }
            self.is_stale[destination as usize * index.count() + block] = false;
            list.items.push(Item {
                instance: instance as u32,
                block: block as u32,
                source: (!rebuilt).then_some(current),
                destination,
                first: first as u32,
                count: listed,
            });
            let moved = u64::from(deltas) + pose_bytes + if rebuilt { base_bytes } else { pose_bytes };
            stats.dirty_blocks += 1;
            stats.rebuilt_blocks += usize::from(rebuilt);
            stats.bytes_moved += moved + (size_of::<Item>() + listed as usize * ELEMENT_BYTES) as u64;
            stats.bytes_floor += moved;
        }
        self.count(group);
    }
}
