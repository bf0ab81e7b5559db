//! Phase 1 of an update: commits requested weights, all at once or, with an error budget, as far as the budget
//! requires, and lists the entries whose weight changes.

use super::group::{GroupPlan, rounding};
use super::plan::BlockState;
use crate::abi::worklist::Element;

/// Marks the amount of a committed entry.
const COMMITTED: f32 = -1.0;
/// Safety factor on the budget for rounding of amounts.
const SUMMING: f32 = 0.9999;

impl BlockState {
    /// Requests `weights`, and decides which changes to apply now; all of them unless the poses are `known`. Returns
    /// whether [`emit`](Self::emit) has to follow; groups that share slots emit if any of them has to.
    pub fn commit(&mut self, group: &mut GroupPlan, instance: usize, weights: &[f32], known: bool) -> bool {
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

    /// Without a budget: commits every changed target in all its blocks.
    fn commit_targets(&mut self, group: &mut GroupPlan, instance: usize) -> bool {
        let GroupPlan { index, list, scratch, unit, .. } = group;
        let elements = &mut list.elements[instance * index.entry_count()..][..index.entry_count()];
        let ends = &mut scratch.ends[..];
        let mut dirty = false;
        for (target, (&new, committed)) in scratch.next.iter().zip(&mut self.committed).enumerate() {
            if new == *committed {
                continue;
            }
            let old = std::mem::replace(committed, new);
            let incidence = index.incidence(target);
            // A target without entries changes no pose.
            dirty |= !incidence.is_empty();
            let coefficient = unit.coefficient(new, old);
            for i in incidence {
                let end = &mut ends[i.block as usize];
                elements[*end as usize] = Element { entry: i.entry, coefficient };
                *end += 1;
            }
            if (old != 0) != (new != 0) {
                for i in incidence {
                    self.active[i.entry as usize / 64] ^= 1 << (i.entry % 64);
                    self.blocks[i.block as usize].activate(index.costs[i.entry as usize].bytes, old, new);
                }
            }
        }
        dirty
    }

    /// With a budget: defers a block's entries while Σ |pending| · reach stays within it, minus rounding so far and in
    /// this update. A still face settles.
    fn commit_entries(&mut self, group: &mut GroupPlan, instance: usize, known: bool) -> bool {
        let GroupPlan { index, list, scratch, unit, tolerance, .. } = group;
        let still = self.changed == 0;
        // Apply everything deferred.
        let settle = !known || still && self.deferred;
        if still && !settle {
            return false;
        }
        // Blocks with changed targets.
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
            let entries = index.entries(block);
            let amounts = &mut scratch.amounts;
            let next = |entry: usize| scratch.next[index.parts.entry_target[entry] as usize];
            amounts.clear();
            if settle {
                amounts.resize(entries.len(), COMMITTED);
            } else {
                let pending = |entry: usize| unit.size(unit.coefficient(next(entry), self.committed[entry]));
                amounts.extend(entries.clone().map(|entry| pending(entry) * index.costs[entry].reach));
                // float64: subtracting most of a large sum leaves an accurate rest.
                let mut sum: f64 = amounts.iter().copied().map(f64::from).sum();
                let mut rounded = 0.0;
                if tolerance.is_finite() {
                    let reach = self.largest_weight * index.block_reach[block];
                    let added = rounding(index.block_base[block] + reach, entries.len() as u32, reach);
                    rounded = self.blocks[block].bound + added;
                }
                let room = f64::from((self.budget - rounded).max(0.0) * SUMMING);
                if sum <= room {
                    deferred |= sum > 0.0;
                    continue;
                }
                // Commit the largest until the rest is within the budget; small amounts, mostly noise, stay deferred.
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
                let old = self.committed[entry];
                let new = next(entry);
                if *amount != COMMITTED || new == old {
                    continue;
                }
                self.committed[entry] = new;
                let end = &mut scratch.ends[block];
                list.elements[first + *end as usize] =
                    Element { entry: entry as u32, coefficient: unit.coefficient(new, old) };
                *end += 1;
                self.active[entry / 64] ^= u64::from((old != 0) != (new != 0)) << (entry % 64);
                self.blocks[block].activate(index.costs[entry].bytes, old, new);
                dirty = true;
            }
        }
        self.deferred = deferred;
        dirty
    }
}
