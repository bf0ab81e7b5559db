//! From the weights asked for to those that poses hold: all at once, or with an error budget when they matter.

use super::bound::{BlockBounds, Scratch, rounding};
use super::list::{Element, WorkList};
use crate::pack::blocks::BlockIndex;

/// Weights as the sums see them: float32, or integers on a grid.
pub(super) trait Unit: Copy + PartialEq + Default {
    fn minus(self, other: Self) -> Self;
    fn bits(self) -> u32;
}

impl Unit for f32 {
    fn minus(self, other: Self) -> Self {
        self - other
    }
    fn bits(self) -> u32 {
        self.to_bits()
    }
}

impl Unit for i32 {
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }
    fn bits(self) -> u32 {
        self as u32
    }
}

/// Marks an entry that is committed.
const GOES: f32 = -1.0;
/// What the rounding of amounts may lose of the budget.
const SUMMING: f32 = 0.9999;

#[derive(Clone, Debug)]
pub(super) struct Committed<T> {
    /// What was asked for, per target.
    requested: Vec<T>,
    /// What the poses hold: per target, or with an error budget per entry.
    committed: Vec<T>,
    per_entry: bool,
    /// Some entry waits.
    waiting: bool,
    next: Vec<T>,
}

impl<T: Unit> Committed<T> {
    pub(super) fn new(targets: usize, entries: usize, per_entry: bool) -> Self {
        Self {
            requested: vec![T::default(); targets],
            committed: vec![T::default(); if per_entry { entries } else { targets }],
            per_entry,
            waiting: false,
            next: vec![T::default(); targets],
        }
    }
}

/// One instance's part of an update.
pub(crate) struct Frame<'a> {
    pub(super) index: &'a BlockIndex,
    pub(super) instance: usize,
    pub(super) scratch: &'a mut Scratch,
    pub(super) list: &'a mut WorkList,
    pub(super) budget: f32,
    pub(super) largest_weight: f32,
}

impl<'a> Frame<'a> {
    /// A phase of the update of an instance; scratch space and list pass from the first to the second.
    pub(crate) fn new(
        index: &'a BlockIndex,
        instance: usize,
        scratch: &'a mut Scratch,
        list: &'a mut WorkList,
    ) -> Self {
        Self { index, instance, scratch, list, budget: 0.0, largest_weight: 1.0 }
    }

    /// Commit weights and list the entries whose committed weight changed. Tells whether there are any.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn commit<T: Unit>(
        &mut self,
        weights: &mut Committed<T>,
        blocks: &mut BlockBounds,
        asked: &[f32],
        convert: impl Fn(f32) -> T,
        amount: impl Fn(u32) -> f32,
        unknown: bool,
        changed: &mut usize,
    ) -> bool {
        let ends = &mut self.scratch.ends;
        ends.clear();
        ends.extend_from_slice(&self.index.first_entries()[..self.index.count()]);
        weights.next.iter_mut().zip(asked).for_each(|(n, w)| *n = convert(*w));
        *changed = weights.next.iter().zip(&weights.requested).filter(|(a, b)| a != b).count();
        let dirty = match weights.per_entry {
            true => self.commit_entries(weights, blocks, amount, unknown, *changed == 0),
            false => self.commit_targets(weights, blocks),
        };
        weights.requested.copy_from_slice(&weights.next);
        dirty
    }

    /// No budget: every changed target is committed, in every block it touches.
    fn commit_targets<T: Unit>(&mut self, weights: &mut Committed<T>, blocks: &mut BlockBounds) -> bool {
        let index = self.index;
        let first = self.instance * index.entry_count();
        let elements = &mut self.list.elements[first..first + index.entry_count()];
        let ends = &mut self.scratch.ends[..];
        let mut dirty = false;
        for (target, (&new, old)) in weights.next.iter().zip(&mut weights.committed).enumerate() {
            if new == *old {
                continue;
            }
            let incidence = index.incidence(target);
            // A target that moves nothing changes no pose.
            dirty |= !incidence.is_empty();
            let coefficient = new.minus(*old).bits();
            for i in incidence {
                let end = &mut ends[i.block as usize];
                elements[*end as usize] = Element { entry: i.entry, coefficient };
                *end += 1;
            }
            let (was, is) = (*old != T::default(), new != T::default());
            *old = new;
            if was != is {
                for i in incidence {
                    let (active, bytes) =
                        (&mut blocks.active_bytes[i.block as usize], index.costs()[i.entry as usize].bytes);
                    *active = if is { *active + bytes } else { *active - bytes };
                }
            }
        }
        dirty
    }

    /// With a budget: a block's entries wait while Σ |pending| · reach stays within it, less what rounding may have
    /// done and may do in this update; a still face settles.
    fn commit_entries<T: Unit>(
        &mut self,
        weights: &mut Committed<T>,
        blocks: &mut BlockBounds,
        amount: impl Fn(u32) -> f32,
        unknown: bool,
        still: bool,
    ) -> bool {
        let index = self.index;
        // Blocks that a change reaches; all where nothing may wait any longer.
        let settle = unknown || still && weights.waiting;
        if still && !settle {
            return false;
        }
        let reached = &mut self.scratch.reached;
        reached.clear();
        reached.resize(index.count(), settle);
        if !settle {
            for target in (0..weights.next.len()).filter(|&t| weights.next[t] != weights.requested[t]) {
                index.incidence(target).iter().for_each(|i| reached[i.block as usize] = true);
            }
        }
        let first = self.instance * index.entry_count();
        let (mut dirty, mut waiting) = (unknown, weights.waiting && !settle);
        for block in 0..index.count() {
            if !self.scratch.reached[block] {
                continue;
            }
            let entries = index.entries(block);
            let targets = &index.entry_targets()[entries.clone()];
            let pending =
                |committed: &[T], i: usize, entry: usize| weights.next[targets[i] as usize].minus(committed[entry]);
            let amounts = &mut self.scratch.amounts;
            amounts.clear();
            amounts.extend(
                entries.clone().enumerate().map(|(i, entry)| {
                    amount(pending(&weights.committed, i, entry).bits()) * index.costs()[entry].reach
                }),
            );
            // In float64: what remains of a large sum, when most of it is taken away, is still right.
            let mut sum: f64 = amounts.iter().copied().map(f64::from).sum();
            let rounded = match blocks.tolerance.is_finite() {
                true => {
                    let reach = self.largest_weight * index.block_reach()[block];
                    let next = rounding(index.block_base()[block] + reach, entries.len() as u32, reach);
                    blocks.bound[block] + next
                }
                false => 0.0,
            };
            let room = f64::from((self.budget - rounded).max(0.0) * SUMMING);
            if sum <= room && !settle {
                waiting |= sum > 0.0;
                continue;
            }
            // The largest go until the rest is within the budget; the small ones, noise for the most part, go on
            // waiting.
            if settle {
                amounts.fill(GOES);
            } else {
                let largest = &mut self.scratch.largest;
                largest.clear();
                largest.extend(0..amounts.len() as u32);
                let of = |i: u32| amounts[i as usize];
                largest.sort_unstable_by(|&a, &b| of(b).total_cmp(&of(a)).then(b.cmp(&a)));
                for &i in &*largest {
                    if sum <= room {
                        break;
                    }
                    sum -= f64::from(amounts[i as usize]);
                    amounts[i as usize] = GOES;
                }
            }
            waiting |= !settle && amounts.iter().any(|a| *a > 0.0);
            let mut listed = 0;
            for (i, entry) in entries.clone().enumerate() {
                let delta = pending(&weights.committed, i, entry);
                if self.scratch.amounts[i] != GOES || delta == T::default() {
                    continue;
                }
                let (old, new) = (weights.committed[entry], weights.next[targets[i] as usize]);
                weights.committed[entry] = new;
                let cost = index.costs()[entry];
                self.list.elements[first + entries.start + listed] =
                    Element { entry: entry as u32, coefficient: delta.bits() };
                listed += 1;
                let active = &mut blocks.active_bytes[block];
                *active = match (old != T::default(), new != T::default()) {
                    (false, true) => *active + cost.bytes,
                    (true, false) => *active - cost.bytes,
                    _ => *active,
                };
            }
            self.scratch.ends[block] += listed as u32;
            dirty |= listed > 0;
        }
        weights.waiting = waiting;
        dirty
    }
}

/// List the active entries of a block; how many there are, and Σ |weight| · reach.
pub(super) fn list_active<T: Unit>(
    weights: &Committed<T>,
    index: &BlockIndex,
    block: usize,
    out: &mut [Element],
    amount: impl Fn(u32) -> f32,
) -> (u32, f32) {
    let (mut count, mut sum) = (0, 0.0);
    for entry in index.entries(block) {
        let at = if weights.per_entry { entry } else { index.entry_targets()[entry] as usize };
        let weight = weights.committed[at];
        if weight != T::default() {
            out[count] = Element { entry: entry as u32, coefficient: weight.bits() };
            count += 1;
            sum += amount(weight.bits()) * index.costs()[entry].reach;
        }
    }
    (count as u32, sum)
}
