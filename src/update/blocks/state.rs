//! The plan of the block formats: which blocks an update writes, from what, and with which entries.
//!
//! An update reads the current slot and writes the next. A block is written when a changed target touches it, or when
//! the next slot missed an earlier change of it (it is copied then, together with what changes now: each change is
//! computed once, however many slots there are). Within a block only the components that changed are loaded and
//! stored: the work list names them, a bit per vertex and component.
//!
//! Each block of each head makes its own choice: apply the changed targets to the pose there is, or rebuild from the
//! base pose with the active ones, whichever moves fewer bytes of deltas and poses ([`UpdateMode::Incremental`]), and
//! from the base pose where it is the same: rounding ends there, and heads have that pose in common. A block whose
//! bound on accumulated rounding would exceed the tolerance is rebuilt in any case. The first time the blocks' limits
//! are spread out, so that they do not all come due in one frame.
//!
//! # The bound
//! Of a block's positions, as a length. With M the largest coordinate that the block can reach, S = Σ|coefficient| ·
//! longest delta over the n entries of an update, and ε = 2⁻²³ (a whole unit in the last place, since Vulkan fixes no
//! rounding mode), an update adds √3 · (M·ε + (n + 4)·S·ε): one rounding at pose magnitude, one for each coefficient,
//! product, partial sum and scale. A rebuild sets the bound to that of its own entries.

use super::bound::{BlockBounds, rounding};
use super::commit::{Committed, Frame, list_active};
use super::list::{ELEMENT_BYTES, ITEM_WORDS, Item, component_bytes};
use crate::error::{Error, Result};
use crate::pack::PackedLayout;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::plan::{Accumulate, UpdateDesc, UpdateMode, UpdateStats};

/// What the pose buffers of one instance hold, block by block.
#[derive(Clone, Debug)]
pub struct BlockState {
    desc: UpdateDesc,
    weights: Weights,
    blocks: BlockBounds,
    slots: Slots,
    /// Every component of a block that is written, not only those that change.
    whole: bool,
    /// Targets asked for that differ from the update before.
    changed: usize,
    largest_weight: f32,
}

#[derive(Clone, Debug)]
enum Weights {
    Float(Committed<f32>),
    Exact(ExactGrid, Committed<i32>),
}

#[derive(Clone, Debug)]
struct Slots {
    /// `[slot][block]`: whether there is anything in `missed`.
    behind: Vec<bool>,
    /// `[slot][block][component][word]`: what differs from the current pose.
    missed: Vec<u32>,
}

/// What tolerances are fractions of: the diagonal, where there is one.
fn length_unit(layout: &PackedLayout) -> f32 {
    if layout.diagonal > 0.0 { layout.diagonal } else { 1.0 }
}

/// Refuse a tolerance that a pose fresh from base exceeds, all weights being 1.
pub(crate) fn check_tolerance(tolerance: f32, layout: &PackedLayout, index: &BlockIndex) -> Result<()> {
    let fresh = (0..index.count()).map(|b| {
        let reach = index.block_reach()[b];
        rounding(index.block_base()[b] + reach, index.entries(b).len() as u32, reach)
    });
    let least = fresh.fold(0.0, f32::max) / length_unit(layout);
    if least <= tolerance {
        return Ok(());
    }
    Err(Error::invalid(
        format!(
            "a drift of at most {tolerance:.1e} of the diagonal: rounding alone may move a vertex by {least:.1e} when all \
             weights are 1"
        ),
        "allow more drift, or use exact sums (Accumulate::Exact)",
    ))
}

impl BlockState {
    /// Nothing known yet: the first plan writes every block.
    ///
    /// # Errors
    /// As [`UpdateDesc::check_for`].
    pub fn new(desc: UpdateDesc, layout: &PackedLayout, index: &BlockIndex) -> Result<Self> {
        desc.check_for(layout)?;
        // Without lengths there is nothing to measure a budget against: all is committed at once.
        let desc = UpdateDesc { error_budget: if layout.has_lengths() { desc.error_budget } else { 0.0 }, ..desc };
        let (targets, entries, per_entry) = (layout.targets.len(), index.entry_count(), desc.error_budget > 0.0);
        let (weights, tolerance) = match desc.accumulate {
            Accumulate::Exact => {
                (Weights::Exact(index.exact()?, Committed::new(targets, entries, per_entry)), f32::INFINITY)
            }
            Accumulate::Float { tolerance } => {
                (Weights::Float(Committed::new(targets, entries, per_entry)), tolerance * length_unit(layout))
            }
        };
        let (blocks, slots) = (index.count(), desc.slots as usize);
        // The golden ratio spreads any number of blocks evenly.
        let spread = |b: usize| 0.25 + 0.75 * (b as f32 * 0.618_034).fract();
        Ok(Self {
            desc,
            weights,
            blocks: BlockBounds {
                bound: vec![0.0; blocks],
                limit: (0..blocks).map(|b| tolerance * spread(b)).collect(),
                active_bytes: vec![0; blocks],
                tolerance,
            },
            slots: Slots {
                behind: vec![true; slots * blocks],
                missed: vec![u32::MAX; slots * blocks * 6 * index.mask_words()],
            },
            whole: false,
            changed: 0,
            largest_weight: 1.0,
        })
    }

    /// From now on, load and store all of a block that is written: for kernels that cannot do less.
    pub(crate) fn write_whole_blocks(&mut self) {
        self.whole = true;
    }

    /// What the slots hold is not known any longer: the instance was left out of some updates.
    pub(crate) fn forget_slots(&mut self) {
        self.slots.behind.fill(true);
        self.slots.missed.fill(u32::MAX);
    }

    /// The grid of exact sums.
    pub fn exact(&self) -> Option<ExactGrid> {
        match self.weights {
            Weights::Float(_) => None,
            Weights::Exact(grid, _) => Some(grid),
        }
    }

    /// The largest bound of any block, in input units; 0 for exact sums.
    pub fn bound(&self) -> f32 {
        if self.exact().is_some() { 0.0 } else { self.blocks.bound.iter().copied().fold(0.0, f32::max) }
    }

    /// The first phase: take `weights` as requested, and decide what of them is applied now; all of them where it is not
    /// `known` what the poses hold. Tells whether the second has to follow: where several states have a slot in common,
    /// for all of them as soon as one says so.
    pub(crate) fn commit(&mut self, frame: &mut Frame<'_>, weights: &[f32], known: bool) -> bool {
        self.largest_weight = weights.iter().fold(self.largest_weight, |m, w| m.max(w.abs()));
        (frame.budget, frame.largest_weight) = (self.desc.error_budget, self.largest_weight);
        let (unknown, amount) = (!known, amount(self.exact()));
        let (blocks, changed) = (&mut self.blocks, &mut self.changed);
        let dirty = match &mut self.weights {
            Weights::Float(committed) => frame.commit(committed, blocks, weights, |w| w, amount, unknown, changed),
            Weights::Exact(grid, committed) => {
                frame.commit(committed, blocks, weights, |w| grid.steps(w), amount, unknown, changed)
            }
        };
        dirty || unknown
    }

    /// Nothing changed: the pose stays where it is.
    pub(super) fn stay(&mut self, stats: &mut UpdateStats) {
        stats.coefficients += self.changed;
        stats.bound = stats.bound.max(self.bound());
    }

    /// The second phase: append what brings the second of two slots to what was committed; the first is current, and
    /// holds what the state says where it is `known`.
    pub(crate) fn emit(&mut self, frame: &mut Frame<'_>, slots: [u32; 2], known: bool, stats: &mut UpdateStats) {
        if !known {
            self.forget_slots();
        }
        match frame.index.mask_words() {
            1 => self.emit_blocks::<6>(frame, slots, known, stats),
            2 => self.emit_blocks::<12>(frame, slots, known, stats),
            _ => self.emit_blocks::<24>(frame, slots, known, stats),
        }
        self.stay(stats);
    }

    /// Which blocks are written, and how.
    fn emit_blocks<const N: usize>(
        &mut self,
        frame: &mut Frame<'_>,
        [current, destination]: [u32; 2],
        known: bool,
        stats: &mut UpdateStats,
    ) {
        let Frame { index, instance, scratch, list, .. } = frame;
        let count = index.count();
        let (slots, exact) = (self.desc.slots as usize, self.exact().is_some());
        let amount = amount(self.exact());
        let unknown = !known;
        let first_element = *instance * index.entry_count();
        let costs = index.costs();
        let (entry_masks, _) = index.masks().as_chunks::<N>();
        let (block_masks, _) = index.block_masks().as_chunks::<N>();
        let (missed, _) = self.slots.missed.as_chunks_mut::<N>();
        let first_mask = list.masks.len();
        for (block, all) in block_masks.iter().enumerate() {
            let entries = index.entries(block);
            let first = first_element + entries.start;
            let mut listed = scratch.ends[block] - entries.start as u32;
            let at = destination as usize * count + block;
            let behind = self.slots.behind[at];
            if listed == 0 && !behind && !unknown {
                continue;
            }
            let touched = listed > 0;
            // What the listed entries take, move and change.
            let (mut deltas, mut sum, mut changed) = (0, 0.0, [0; N]);
            for element in &list.elements[first..first + listed as usize] {
                let entry = element.entry as usize;
                deltas += costs[entry].bytes;
                sum += amount(element.coefficient) * costs[entry].reach;
                changed.iter_mut().zip(&entry_masks[entry]).for_each(|(c, e)| *c |= e);
            }
            let magnitude = index.block_base()[block] + self.largest_weight * index.block_reach()[block];
            let bound = self.blocks.bound[block] + rounding(magnitude, listed, sum);
            let worn = touched && bound > self.blocks.limit[block];
            let rebuilt = unknown
                || touched
                    && (worn
                        || self.desc.mode == UpdateMode::Rebuild
                        || match self.whole {
                            // All components either way.
                            true => self.blocks.active_bytes[block] <= deltas,
                            false => no_more_bytes_from_base(self.blocks.active_bytes[block], deltas, all, &changed),
                        });
            if rebuilt {
                let active;
                (listed, active) = match &self.weights {
                    Weights::Float(w) => list_active(w, index, block, &mut list.elements[first..], amount),
                    Weights::Exact(_, w) => list_active(w, index, block, &mut list.elements[first..], amount),
                };
                deltas = self.blocks.active_bytes[block];
                changed = *all;
                self.blocks.bound[block] = rounding(magnitude, listed, active);
                if worn {
                    self.blocks.limit[block] = self.blocks.tolerance;
                }
            } else if touched {
                self.blocks.bound[block] = bound;
            }
            if unknown || self.whole && touched {
                changed = [u32::MAX; N];
            }
            let mut written = changed;
            if behind && slots > 1 {
                written.iter_mut().zip(&missed[at]).for_each(|(w, m)| *w |= m);
            }
            if touched || rebuilt {
                for slot in (0..slots).filter(|s| *s != destination as usize) {
                    let at = slot * count + block;
                    self.slots.behind[at] = true;
                    missed[at].iter_mut().zip(&changed).for_each(|(m, c)| *m |= c);
                }
            }
            self.slots.behind[at] = false;
            missed[at] = [0; N];
            list.items.push(Item {
                instance: *instance as u32,
                block: block as u32,
                source: (!rebuilt).then_some(current),
                destination,
                first: first as u32,
                count: listed,
            });
            list.masks.extend_from_slice(&written);
            stats.dirty_blocks += 1;
            stats.rebuilt_blocks += usize::from(rebuilt);
            let moved = u64::from(deltas) + (listed as usize * ELEMENT_BYTES + (ITEM_WORDS + N) * 4) as u64;
            stats.bytes_moved += moved;
            stats.bytes_floor += u64::from(deltas);
            if exact {
                let components: u32 = written.iter().map(|m| m.count_ones()).sum();
                let pose = u64::from(components) * component_bytes(true, rebuilt, touched);
                stats.bytes_moved += pose;
                stats.bytes_floor += pose;
            }
        }
        if !exact {
            // In one loop over all items: it becomes SIMD.
            let components: u32 = list.masks[first_mask..].iter().map(|m| m.count_ones()).sum();
            let pose = u64::from(components) * component_bytes(false, false, true);
            stats.bytes_moved += pose;
            stats.bytes_floor += pose;
        }
    }
}

/// The size of a coefficient as elements have it, as a weight.
fn amount(exact: Option<ExactGrid>) -> impl Fn(u32) -> f32 + Copy {
    let weight_step = exact.map(|grid| grid.weight_step());
    move |bits| match weight_step {
        None => f32::from_bits(bits).abs(),
        Some(step) => (bits as i32).unsigned_abs() as f32 * step,
    }
}

/// The cost model: active entries and all components that any target moves, against changed ones and theirs.
fn no_more_bytes_from_base<const N: usize>(active: u32, changed: u32, all: &[u32; N], some: &[u32; N]) -> bool {
    // A rebuild never moves fewer components; counting them is only worth it where it moves no more deltas.
    let components = |mask: &[u32; N]| 8 * mask.iter().map(|m| m.count_ones()).sum::<u32>();
    active <= changed && active + components(all) <= changed + components(some)
}
