//! Phase 2 of an update: decides which blocks are written, from which source, and with which entries.
//!
//! A block is written if a changed target touches it, or if it is stale in the next slot; a stale block is copied and
//! updated at once. Only components that changed are loaded and stored. Each block of each instance starts from the
//! current pose, the base pose or the pose of the instance's base, whichever moves fewest bytes (the base pose if
//! equal), or from the base pose if the bound on accumulated [`rounding`] would exceed the tolerance.

use super::group::{GroupPlan, Item, PoseSlot, rounding};
use super::plan::BlockState;
use crate::abi::worklist::{ELEMENT_BYTES, ITEM_WORDS};

impl BlockState {
    /// Lists the blocks that bring the second slot to the committed weights. The first slot is current, and matches
    /// this state if `known`. `base`: pose and state of the instance's base.
    pub(crate) fn emit(
        &mut self,
        group: &mut GroupPlan,
        instance: usize,
        slots: [u32; 2],
        known: bool,
        base: Option<(PoseSlot, &Self)>,
    ) {
        if !known {
            self.forget_slots();
        }
        let (first_item, first_mask) = (group.list.items.len(), group.list.masks.len());
        match group.index.mask_words() {
            1 => self.emit_blocks::<6>(group, instance, slots, known, base),
            2 => self.emit_blocks::<12>(group, instance, slots, known, base),
            _ => self.emit_blocks::<24>(group, instance, slots, known, base),
        }
        let (items, masks) = (&group.list.items[first_item..], &group.list.masks[first_mask..]);
        let poses = match group.grid() {
            // The pose in and out.
            None => masks.iter().map(|mask| u64::from(mask.count_ones())).sum::<u64>() * 8,
            // Fixed-point poses: whole blocks are written; nothing is read when rebuilding from the base pose.
            Some(_) => {
                let times: u64 = items.iter().map(|item| 1 + u64::from(item.source.is_some())).sum();
                times * (group.index.size() * group.pose().stride()) as u64
            }
        };
        group.stats.bytes_moved += poses;
        group.stats.bytes_floor += poses;
        self.count(group);
    }

    fn emit_blocks<const N: usize>(
        &mut self,
        group: &mut GroupPlan,
        instance: usize,
        [current, destination]: [u32; 2],
        known: bool,
        base: Option<(PoseSlot, &Self)>,
    ) {
        let GroupPlan { index, list, stats, whole_blocks, source_bytes, desc, unit, tolerance, scratch, .. } = group;
        let (count, costs) = (index.count(), &index.costs);
        let (entry_masks, _) = index.masks.as_chunks::<N>();
        let (block_masks, _) = index.block_masks.as_chunks::<N>();
        for (block, all) in block_masks.iter().enumerate() {
            let entries = index.entries(block);
            let first = instance * index.entry_count() + entries.start;
            let mut listed = scratch.ends[block] - entries.start as u32;
            let (touched, at) = (listed > 0, destination as usize * count + block);
            let is_stale = std::mem::replace(&mut self.is_stale[at], false);
            if !touched && !is_stale {
                continue;
            }
            // Loads, motion and components of the listed entries.
            let (mut deltas, mut sum, mut changed) = (0, 0.0, [0; N]);
            for element in &list.elements[first..first + listed as usize] {
                let entry = element.entry as usize;
                deltas += costs[entry].bytes;
                sum += unit.size(element.coefficient) * costs[entry].reach;
                changed = std::array::from_fn(|i| changed[i] | entry_masks[entry][i]);
            }
            let (magnitude, active) =
                (index.block_base[block] + self.largest_weight * index.block_reach[block], self.blocks[block]);
            let bound = active.bound + rounding(magnitude, listed, sum);
            let exceeded = touched && bound > active.limit;
            // The instance's base, with the deltas that it differs by, if the block then loads less than from the base
            // pose, which fixed-point poses do not load.
            let nearer = base.filter(|(_, base)| (touched || !known) && !exceeded && base.blocks[block].active > 0);
            let nearer = nearer.map(|(source, base)| {
                let mut bytes = 0;
                self.apart(index, block, Some(base), |entry, _, _| bytes += costs[entry].bytes);
                (bytes, source, base)
            });
            let nearer = nearer.filter(|(bytes, ..)| bytes + *source_bytes < active.active_bytes);
            let anew = nearer.map_or(active.active_bytes, |(bytes, ..)| bytes + *source_bytes);
            let rebuilt = !known
                || touched
                    && (exceeded
                        || desc.rebuilds()
                        || match *whole_blocks {
                            // All components either way.
                            true => anew <= deltas + *source_bytes,
                            false => no_more_bytes_from_base(anew, deltas, all, &changed),
                        });
            if rebuilt {
                let from = nearer.map(|(.., base)| base);
                let (entries, sum) = self.list_apart(index, *unit, block, from, &mut list.elements[first..]);
                deltas = nearer.map_or(active.active_bytes, |(bytes, ..)| bytes);
                (listed, changed) = (entries, *all);
                let before = from.map_or(0.0, |base| base.blocks[block].bound);
                self.blocks[block].bound = before + rounding(magnitude, listed, sum);
                if exceeded {
                    self.blocks[block].limit = *tolerance;
                }
            } else if touched {
                self.blocks[block].bound = bound;
            }
            if !known || *whole_blocks && touched {
                changed = [u32::MAX; N];
            }
            let (stale, _) = self.stale.as_chunks_mut::<N>();
            let mut written = changed;
            if is_stale && desc.slots > 1 {
                written.iter_mut().zip(&stale[at]).for_each(|(w, s)| *w |= s);
            }
            if touched || rebuilt {
                for slot in 0..desc.slots as usize {
                    let at = slot * count + block;
                    self.is_stale[at] = true;
                    stale[at].iter_mut().zip(&changed).for_each(|(s, c)| *s |= c);
                }
            }
            self.is_stale[at] = false;
            stale[at] = [0; N];
            list.items.push(Item {
                instance: instance as u32,
                block: block as u32,
                source: match rebuilt {
                    true => nearer.map(|(_, source, _)| source),
                    false => Some(PoseSlot { instance: instance as u32, slot: current }),
                },
                destination,
                first: first as u32,
                count: listed,
            });
            list.masks.extend_from_slice(&written);
            stats.dirty_blocks += 1;
            stats.rebuilt_blocks += usize::from(rebuilt);
            stats.bytes_moved += u64::from(deltas) + (listed as usize * ELEMENT_BYTES + (ITEM_WORDS + N) * 4) as u64;
            stats.bytes_floor += u64::from(deltas);
        }
    }
}

/// Cost model: active entries and all components of any target, against changed entries and their components.
fn no_more_bytes_from_base<const N: usize>(active: u32, changed: u32, all: &[u32; N], some: &[u32; N]) -> bool {
    // A rebuild never moves fewer components; counting is needed only if it moves no more deltas.
    let components = |mask: &[u32; N]| 8 * mask.iter().map(|m| m.count_ones()).sum::<u32>();
    active <= changed && active + components(all) <= changed + components(some)
}
