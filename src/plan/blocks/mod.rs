//! The plan of the block formats: which blocks an update writes, from what, and with which entries.
//!
//! An update reads the current slot and writes the next. A block is written when a changed target touches it, or when
//! the next slot missed an earlier change of it (it is copied then, together with what changes now: each change is
//! computed once, however many slots there are). Within a block only the components that changed are loaded and
//! stored: the work list names them, a bit per vertex and component.
//!
//! Each block of each head makes its own choice: apply the changed targets to the pose there is, or rebuild from the
//! base pose with the active ones, whichever moves fewer bytes of deltas and poses ([`UpdateMode::Incremental`]), and
//! from the base pose where it is the same: rounding ends there, and heads have that pose in common. A block whose bound
//! on accumulated rounding would exceed the tolerance is rebuilt in any case. The first time the blocks' limits are
//! spread out, so that they do not all come due in one frame.
//!
//! # The bound
//! Of a block's positions, as a length. With M the largest coordinate that the block can reach, S = Σ|coefficient| ·
//! longest delta over the n entries of an update, and ε = 2⁻²³ (a whole unit in the last place, since Vulkan fixes no
//! rounding mode), an update adds √3 · (M·ε + (n + 4)·S·ε): one rounding at pose magnitude, one for each coefficient,
//! product, partial sum and scale. A rebuild sets the bound to that of its own entries.

mod commit;
mod list;
mod tiles;

pub use list::{ELEMENT_BYTES, Element, ITEM_WORDS, Item, WorkList, component_bytes};
pub use tiles::{ALIGN, ROWS, TILE, TILE_WORDS, TileBytes, TileItem, Tiles, WIDTHS, row_words};

use commit::{Committed, Frame, list_active};

use super::heads::Heads;
use super::{Accumulate, UpdateDesc, UpdateMode, UpdateStats};
use crate::error::{Error, Result};
use crate::pack::PackedLayout;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::weights::delta::{WEIGHT_MAX, check_weights};
use std::sync::Arc;

/// Scratch space of [`BlockState::plan`], shared by the instances of a crowd.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// Per block: the place in the list behind its last element, counted from the instance's first.
    ends: Vec<u32>,
    /// With an error budget: blocks that a change reaches.
    reached: Vec<bool>,
    /// With an error budget: how far each entry of a block is from what was asked for, as a length; [`GOES`] once it
    /// is committed.
    amounts: Vec<f32>,
    /// The entries of a block, those with the largest amounts first.
    largest: Vec<u32>,
}

/// The instances of a crowd, planned together: what both back ends carry out.
pub(crate) struct Planner {
    pub index: Arc<BlockIndex>,
    pub states: Vec<BlockState>,
    pub plans: Vec<BlockPlan>,
    pub list: WorkList,
    scratch: Scratch,
}

impl Planner {
    /// `instances` that are in `state`.
    pub fn new(index: &Arc<BlockIndex>, state: BlockState, instances: usize) -> Self {
        Self {
            index: index.clone(),
            states: vec![state; instances],
            plans: vec![BlockPlan::default(); instances],
            list: WorkList::new(index, instances),
            scratch: Scratch::default(),
        }
    }

    /// The grid of exact sums; the same for all instances.
    pub fn exact(&self) -> Option<ExactGrid> {
        self.states.first().and_then(BlockState::exact)
    }

    /// Plan the update numbered `update` of every head that is shown.
    pub fn plan(&mut self, heads: &Heads, update: u64) -> UpdateStats {
        let mut stats = UpdateStats::default();
        self.list.clear();
        for (i, ((state, asked), plan)) in self.states.iter_mut().zip(heads.asked()).zip(&mut self.plans).enumerate() {
            let Some(weights) = asked else { continue };
            *plan = state.plan(&self.index, i, weights, update, &mut self.scratch, &mut self.list, &mut stats);
        }
        stats.passes = usize::from(!self.list.items.is_empty());
        stats
    }
}

/// What the pose buffers of one instance hold, block by block.
#[derive(Clone, Debug)]
pub struct BlockState {
    desc: UpdateDesc,
    weights: Weights,
    blocks: Blocks,
    slots: Slots,
    /// Every component of a block that is written, not only those that change.
    whole: bool,
    /// Every update moves on to the next slot.
    rotates: bool,
    /// Targets asked for that differ from the update before.
    changed: usize,
    largest_weight: f32,
}

#[derive(Clone, Debug)]
enum Weights {
    Float(Committed<f32>),
    Exact(ExactGrid, Committed<i32>),
}

/// Per block.
#[derive(Clone, Debug)]
struct Blocks {
    /// Bound on the position error that accumulation caused.
    bound: Vec<f32>,
    /// The bound at which the block is rebuilt.
    limit: Vec<f32>,
    /// Bytes of the active entries.
    active_bytes: Vec<u32>,
    /// The tolerance as a length; infinite for exact sums.
    tolerance: f32,
}

#[derive(Clone, Debug)]
struct Slots {
    current: Option<u32>,
    /// Whether the current slot holds what the state says.
    known: bool,
    written_by: u64,
    cut: bool,
    /// `[slot][block]`: whether there is anything in `missed`.
    behind: Vec<bool>,
    /// `[slot][block][component][word]`: what differs from the current pose.
    missed: Vec<u32>,
}

/// Where an instance's poses are after an update.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockPlan {
    /// The slot that holds the pose.
    pub result: u32,
    /// The slot that holds the previous pose: `result` where there is none to tell apart; `None` where the update
    /// overwrote it (one slot).
    pub previous: Option<u32>,
}

const ULP: f32 = f32::EPSILON;
const SQRT_3: f32 = 1.732_050_8;

/// What rounding may add to a block's positions in one update.
fn rounding(magnitude: f32, entries: u32, sum: f32) -> f32 {
    SQRT_3 * ULP * (magnitude + (entries + 4) as f32 * sum)
}

/// What tolerances are fractions of: the diagonal, where there is one.
fn length_unit(layout: &PackedLayout) -> f32 {
    if layout.diagonal > 0.0 { layout.diagonal } else { 1.0 }
}

/// Refuse a tolerance that a pose fresh from base exceeds, all weights being 1.
pub(super) fn check_tolerance(tolerance: f32, layout: &PackedLayout, index: &BlockIndex) -> Result<()> {
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
            blocks: Blocks {
                bound: vec![0.0; blocks],
                limit: (0..blocks).map(|b| tolerance * spread(b)).collect(),
                active_bytes: vec![0; blocks],
                tolerance,
            },
            slots: Slots {
                current: None,
                known: false,
                written_by: 0,
                cut: false,
                behind: vec![true; slots * blocks],
                missed: vec![u32::MAX; slots * blocks * 6 * index.mask_words()],
            },
            whole: false,
            rotates: false,
            changed: 0,
            largest_weight: 1.0,
        })
    }

    /// From now on, load and store all of a block that is written: for kernels that cannot do less.
    pub(crate) fn write_whole_blocks(&mut self) {
        self.whole = true;
    }

    /// From now on, every update moves on to the next slot, also where nothing changed: for planners that do not know
    /// whether anything did.
    pub(crate) fn rotate_always(&mut self) {
        self.rotates = true;
    }

    /// The next update writes `slot`, and what it holds is not known there: the instance was left out of some updates.
    pub(crate) fn take_up_at(&mut self, slot: u32) {
        self.slots.current = Some((slot + self.desc.slots - 1) % self.desc.slots);
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

    /// Whether the current slot holds a pose: not before the first update, and not after a discarded one.
    pub fn is_known(&self) -> bool {
        self.slots.known
    }

    /// The next pose has no predecessor (the head was hidden or teleported): its previous pose is itself.
    pub fn cut(&mut self) {
        self.slots.cut = true;
    }

    /// The update numbered `first` and all later ones will never run.
    pub fn discard_from(&mut self, first: u64) {
        if self.slots.written_by >= first {
            self.slots.known = false;
        }
    }

    /// No slot is known any longer: the next plan rebuilds.
    pub fn forget(&mut self) {
        self.discard_from(0);
    }

    /// The largest bound of any block, in input units; 0 for exact sums.
    pub fn bound(&self) -> f32 {
        if self.exact().is_some() { 0.0 } else { self.blocks.bound.iter().copied().fold(0.0, f32::max) }
    }

    /// Bytes of main memory that an instance's state takes.
    pub fn state_bytes(&self) -> usize {
        let weights = match &self.weights {
            Weights::Float(w) => w.len(),
            Weights::Exact(_, w) => w.len(),
        };
        4 * (weights + 3 * self.blocks.bound.len() + self.slots.missed.len()) + self.slots.behind.len()
    }

    /// Append what brings the poses of `instance` to `weights` to `list`, and take it as done by the update numbered
    /// `update` (ascending, from 1). Counts in `stats`.
    #[allow(clippy::too_many_arguments)]
    pub fn plan(
        &mut self,
        index: &BlockIndex,
        instance: usize,
        weights: &[f32],
        update: u64,
        scratch: &mut Scratch,
        list: &mut WorkList,
        stats: &mut UpdateStats,
    ) -> BlockPlan {
        scratch.ends.clear();
        scratch.ends.extend_from_slice(&index.first_entries()[..index.count()]);
        self.largest_weight = weights.iter().fold(self.largest_weight, |m, w| m.max(w.abs()));
        let (budget, largest_weight) = (self.desc.error_budget, self.largest_weight);
        let mut frame = Frame { index, instance, scratch, list, budget, largest_weight };
        // Taken at once: a still pose has no predecessor to tell apart either.
        let cut = std::mem::take(&mut self.slots.cut);
        let unknown = !self.slots.known;
        let amount = amount(self.exact());
        let (blocks, changed) = (&mut self.blocks, &mut self.changed);
        let dirty = match &mut self.weights {
            Weights::Float(committed) => frame.commit(committed, blocks, weights, |w| w, amount, unknown, changed),
            Weights::Exact(grid, committed) => {
                frame.commit(committed, blocks, weights, |w| grid.steps(w), amount, unknown, changed)
            }
        };
        stats.coefficients += self.changed;
        if let (Some(current), true, false) = (self.slots.current, self.slots.known, dirty || self.rotates) {
            stats.bound = stats.bound.max(self.bound());
            return BlockPlan { result: current, previous: Some(current) };
        }
        match index.mask_words() {
            1 => self.emit::<6>(&mut frame, stats),
            2 => self.emit::<12>(&mut frame, stats),
            _ => self.emit::<24>(&mut frame, stats),
        }
        stats.bound = stats.bound.max(self.bound());
        self.finish(update, cut)
    }

    /// Which blocks are written, and how.
    fn emit<const N: usize>(&mut self, frame: &mut Frame<'_>, stats: &mut UpdateStats) {
        let Frame { index, instance, scratch, list, .. } = frame;
        let count = index.count();
        let (slots, exact) = (self.desc.slots as usize, self.exact().is_some());
        let amount = amount(self.exact());
        let current = self.slots.current.unwrap_or(self.desc.slots - 1);
        let destination = (current + 1) % self.desc.slots;
        let unknown = !self.slots.known;
        if unknown {
            self.slots.behind.fill(true);
            self.slots.missed.fill(u32::MAX);
        }
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
        self.slots.current = Some(destination);
    }

    fn finish(&mut self, update: u64, cut: bool) -> BlockPlan {
        let result = self.slots.current.unwrap_or(0);
        let slots = self.desc.slots;
        let cut = cut || !self.slots.known;
        self.slots.known = true;
        self.slots.written_by = update;
        let previous = match slots {
            _ if cut => Some(result),
            1 => None,
            _ => Some((result + slots - 1) % slots),
        };
        BlockPlan { result, previous }
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

/// As [`check_weights`], and within the grid of exact sums.
///
/// # Errors
/// A wrong number of weights, or one that is out of range; the message names it.
pub fn check_block_weights(weights: &[f32], layout: &PackedLayout, exact: Option<ExactGrid>) -> Result<()> {
    let name = |i: usize| layout.targets.get(i).map(|t| t.name.as_str());
    check_weights(weights, name, layout.targets.len())?;
    let most = exact.map_or(WEIGHT_MAX, |grid| grid.weight_max);
    match weights.iter().position(|w| w.abs() > most) {
        None => Ok(()),
        Some(i) => Err(Error::invalid(
            format!("the weight of target {i} ('{}') is {}", name(i).unwrap_or("?"), weights[i]),
            format!("exact sums of this mesh stand weights from -{most} to {most}: pack with a larger weight_max"),
        )),
    }
}

#[cfg(test)]
mod tests;
