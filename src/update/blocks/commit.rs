//! The first phase of an update: from the weights requested to those that poses hold, all at once, or with an error
//! budget when they matter. Entries whose weight changes are listed.

use super::group::{GroupPlan, rounding};
use super::plan::BlockState;
use crate::abi::worklist::Element;

/// The amount of an entry that is committed.
const COMMITTED: f32 = -1.0;
/// What the rounding of amounts may lose of the budget.
const SUMMING: f32 = 0.9999;

impl BlockState {
    /// Take `weights` as requested, and decide what of them is applied now; all of them where it is not `known` what
    /// the poses hold. Tells whether [`emit`](Self::emit) has to follow: where several groups have slots in common, for
    /// all of them as soon as one says so.
    pub(crate) fn commit(&mut self, group: &mut GroupPlan, instance: usize, weights: &[f32], known: bool) -> bool {
        self.largest_weight = weights.iter().fold(self.largest_weight, |m, w| m.max(w.abs()));
        let GroupPlan { index, scratch, unit, .. } = &mut *group;
        scratch.ends.clear();
        scratch.ends.extend_from_slice(&index.parts.first_entry[..index.count()]);
        scratch.next.clear();
        scratch.next.extend(weights.iter().map(|&weight| unit.bits(weight)));
        self.changed = scratch.next.iter().zip(&self.requested).filter(|(next, last)| next != last).count();
        let dirty = match self.per_entry {
            true => self.commit_entries(group, instance, known),
            false => self.commit_targets(group, instance),
        };
        self.requested.copy_from_slice(&group.scratch.next);
        dirty || !known
    }

    /// No budget: every changed target is committed, in every block it touches.
    fn commit_targets(&mut self, group: &mut GroupPlan, instance: usize) -> bool {
        let GroupPlan { index, list, scratch, unit, .. } = group;
        let elements = &mut list.elements[instance * index.entry_count()..][..index.entry_count()];
        let ends = &mut scratch.ends[..];
        let mut dirty = false;
        for (target, (&new, committed)) in scratch.next.iter().zip(&mut self.committed).enumerate() {
            if new == *committed {
                continue;
            }
            let (old, incidence) = (std::mem::replace(committed, new), index.incidence(target));
            // A target that moves nothing changes no pose.
            dirty |= !incidence.is_empty();
            let coefficient = unit.coefficient(new, old);
            for i in incidence {
                let end = &mut ends[i.block as usize];
                elements[*end as usize] = Element { entry: i.entry, coefficient };
                *end += 1;
            }
            if (old != 0) != (new != 0) {
                for i in incidence {
                    self.blocks[i.block as usize].activate(index.costs[i.entry as usize].bytes, old, new);
                }
            }
        }
        dirty
    }

    /// With a budget: a block's entries are deferred while Σ |pending| · reach stays within it, less what rounding may
    /// have done and may do in this update; a still face settles.
    fn commit_entries(&mut self, group: &mut GroupPlan, instance: usize, known: bool) -> bool {
        let GroupPlan { index, list, scratch, unit, tolerance, .. } = group;
        let still = self.changed == 0;
        // Nothing may be deferred any longer.
        let settle = !known || still && self.deferred;
        if still && !settle {
            return false;
        }
        // Blocks that a change reaches.
        scratch.reached.clear();
        scratch.reached.resize(index.count(), settle || std::mem::take(&mut self.lowered));
        if !settle {
            for target in (0..self.requested.len()).filter(|&t| scratch.next[t] != self.requested[t]) {
                index.incidence(target).iter().for_each(|i| scratch.reached[i.block as usize] = true);
            }
        }
        let first = instance * index.entry_count();
        let (mut dirty, mut deferred) = (false, self.deferred && !settle);
        for block in (0..index.count()).filter(|&block| scratch.reached[block]) {
            let (entries, amounts) = (index.entries(block), &mut scratch.amounts);
            let next = |entry: usize| scratch.next[index.parts.entry_target[entry] as usize];
            amounts.clear();
            if settle {
                amounts.resize(entries.len(), COMMITTED);
            } else {
                let pending = |entry: usize| unit.size(unit.coefficient(next(entry), self.committed[entry]));
                amounts.extend(entries.clone().map(|entry| pending(entry) * index.costs[entry].reach));
                // In float64: what remains of a large sum, when most of it is taken away, is still right.
                let mut sum: f64 = amounts.iter().copied().map(f64::from).sum();
                let mut rounded = 0.0;
                if tolerance.is_finite() {
                    let reach = self.largest_weight * index.block_reach[block];
                    let added = rounding(index.block_base[block] + reach, entries.len() as u32, reach);
                    rounded = self.blocks[block].bound + added;
                }
                let room = f64::from((self.budget() - rounded).max(0.0) * SUMMING);
                if sum <= room {
                    deferred |= sum > 0.0;
                    continue;
                }
                // The largest are committed until the rest is within the budget; the small ones, noise for the most
                // part, stay deferred.
                let largest = &mut scratch.largest;
                largest.clear();
                largest.extend(0..amounts.len() as u32);
                let of = |i: u32| amounts[i as usize];
                largest.sort_unstable_by(|&a, &b| of(b).total_cmp(&of(a)).then(b.cmp(&a)));
                for &i in &*largest {
                    if sum <= room {
                        break;
                    }
                    sum -= f64::from(amounts[i as usize]);
                    amounts[i as usize] = COMMITTED;
                }
                deferred |= amounts.iter().any(|amount| *amount > 0.0);
            }
            for (entry, amount) in entries.zip(amounts) {
                let (old, new) = (self.committed[entry], next(entry));
                if *amount != COMMITTED || new == old {
                    continue;
                }
                self.committed[entry] = new;
                let end = &mut scratch.ends[block];
                list.elements[first + *end as usize] =
                    Element { entry: entry as u32, coefficient: unit.coefficient(new, old) };
                *end += 1;
                self.blocks[block].activate(index.costs[entry].bytes, old, new);
                dirty = true;
            }
        }
        self.deferred = deferred;
        dirty
    }
}
