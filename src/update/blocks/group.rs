//! What the instances of a crowd have in common in a group of the mesh, and what one update lists of all of them: which
//! blocks it writes, with which entries, and which components of them.

use crate::abi::worklist::Element;
use crate::error::{Error, Result};
use crate::pack::blocks::{BlockIndex, PoseGrid};
use crate::pack::{POSE_FLOATS, PackedLayout, PoseFormat};
use crate::plan::{UpdateDesc, UpdateStats};
use std::ops::Range;
use std::sync::Arc;

/// A block of an instance that is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Item {
    /// The instance.
    pub instance: u32,
    /// The block.
    pub block: u32,
    /// The slot that is read; `None`: the base pose.
    pub source: Option<u32>,
    /// The slot that is written.
    pub destination: u32,
    /// Its elements: the first in [`WorkList::elements`], and how many.
    pub first: u32,
    /// Number of elements.
    pub count: u32,
}

/// What one update does: carried out by the GPU or the CPU as it is.
#[derive(Clone, Debug, Default)]
pub struct WorkList {
    /// Blocks to write, ascending by instance, then block.
    pub items: Vec<Item>,
    /// `[item][component][word]`: which vertices' components are loaded and stored.
    pub masks: Vec<u32>,
    /// `[instance][entry]`: the elements of a block lie where its entries do, the first ones being in use.
    pub elements: Vec<Element>,
}

impl WorkList {
    /// Empty, with room for every block of `instances`: filling it never allocates.
    pub fn new(index: &BlockIndex, instances: usize) -> Self {
        let blocks = index.count() * instances;
        Self {
            items: Vec::with_capacity(blocks),
            masks: Vec::with_capacity(blocks * POSE_FLOATS * index.mask_words()),
            elements: vec![Element::default(); index.entry_count() * instances],
        }
    }

    /// The elements of an item.
    pub fn elements_of(&self, item: &Item) -> &[Element] {
        &self.elements[item.first as usize..][..item.count as usize]
    }
}

/// The plan of a group.
#[derive(Clone, Debug)]
pub struct GroupPlan {
    /// What the group was packed into.
    pub index: Arc<BlockIndex>,
    /// What the last update writes.
    pub list: WorkList,
    /// Of the last update.
    pub stats: UpdateStats,
    /// Load and store all of a block that is written, not only the components that change: for kernels that cannot do
    /// less, and poses of integers.
    pub whole_blocks: bool,
    /// Bytes that a whole block saves to load where it starts from the base pose.
    pub source_bytes: u32,
    pub(super) desc: UpdateDesc,
    pub(super) targets: usize,
    pub(super) unit: Unit,
    /// Some stream is measured as a length.
    pub(super) has_lengths: bool,
    /// The largest bound on drift that a block may have, as a length; infinite for poses of integers.
    pub(super) tolerance: f32,
    pub(super) scratch: Scratch,
}

impl GroupPlan {
    /// The plan of so many instances.
    ///
    /// # Errors
    /// As [`UpdateDesc::check_for`]; no blocks.
    pub fn new(desc: UpdateDesc, layout: &PackedLayout, instances: usize) -> Result<Self> {
        desc.check_for(layout)?;
        let index = layout.index()?;
        let grid = desc.grid(layout)?;
        let tolerance = if grid.is_some() { f32::INFINITY } else { desc.tolerance * length_unit(layout) };
        // Without lengths there is nothing to measure a budget against: all is committed at once.
        let has_lengths = layout.has_lengths();
        let error_budget = if has_lengths { desc.error_budget } else { 0.0 };
        Ok(Self {
            index: index.clone(),
            list: WorkList::new(index, instances),
            stats: UpdateStats::default(),
            whole_blocks: grid.is_some(),
            source_bytes: if grid.is_some() { (index.size() * desc.pose.stride()) as u32 } else { 0 },
            desc: UpdateDesc { error_budget, ..desc },
            targets: layout.targets.len(),
            unit: Unit::new(grid, desc.pose),
            has_lengths,
            tolerance,
            scratch: Scratch::default(),
        })
    }

    /// The grid of poses of integers.
    pub fn grid(&self) -> Option<PoseGrid> {
        self.unit.grid
    }

    /// How poses are stored.
    pub fn pose(&self) -> PoseFormat {
        self.desc.pose
    }

    /// Forget the last update.
    pub fn clear(&mut self) {
        self.list.items.clear();
        self.list.masks.clear();
        self.stats = UpdateStats::default();
    }

    /// Vertices that the last update changes in the pose of an instance: whole blocks, ascending.
    pub fn changed(&self, instance: u32, out: &mut Vec<Range<u32>>) {
        let first = self.list.items.partition_point(|item| item.instance < instance);
        let items = self.list.items[first..].iter().take_while(|item| item.instance == instance);
        // What has a source and no elements is copied, from the pose there was.
        let changed = items.filter(|item| item.count > 0 || item.source.is_none());
        let size = self.index.size() as u32;
        out.extend(changed.map(|item| item.block * size..(item.block + 1) * size));
    }
}

/// How weights are listed: as float32, or as integers in steps of a grid. Both take 32 bits, and 0 is no weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unit {
    grid: Option<PoseGrid>,
    step: f32,
    /// Coefficients are the weight that poses are to hold, and above it the one that they hold, 16 bits each: what a
    /// target adds is rounded. Otherwise they are the difference.
    pairs: bool,
}

impl Unit {
    fn new(grid: Option<PoseGrid>, pose: PoseFormat) -> Self {
        Self { grid, step: grid.map_or(1.0, |grid| grid.weight_step()), pairs: pose.rounds_products() }
    }

    pub(super) fn bits(self, weight: f32) -> u32 {
        match self.grid {
            // The sum makes 0 of -0.
            None => (weight + 0.0).to_bits(),
            Some(grid) => grid.steps(weight) as u32,
        }
    }

    /// What changes a weight, for the list.
    pub(super) fn coefficient(self, new: u32, old: u32) -> u32 {
        match self.grid {
            None => (f32::from_bits(new) - f32::from_bits(old)).to_bits(),
            Some(_) if self.pairs => new & 0xffff | old << 16,
            Some(_) => new.wrapping_sub(old),
        }
    }

    /// By how much a coefficient changes a weight, either way.
    pub(super) fn size(self, coefficient: u32) -> f32 {
        let steps = |change: i32| change.unsigned_abs() as f32 * self.step;
        match self.grid {
            None => f32::from_bits(coefficient).abs(),
            Some(_) if self.pairs => steps(i32::from(coefficient as i16) - (coefficient as i32 >> 16)),
            Some(_) => steps(coefficient as i32),
        }
    }
}

/// Scratch space that the instances share.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    /// The weights requested of an instance.
    pub(super) next: Vec<u32>,
    /// Per block: the place in the list after its last element, counted from the instance's first.
    pub(super) ends: Vec<u32>,
    /// With an error budget: blocks that a change reaches.
    pub(super) reached: Vec<bool>,
    /// The entries of a block, those with the largest amounts first.
    pub(super) largest: Vec<u32>,
    /// With an error budget: how far each entry of a block is from what was requested, as a length; negative once it is
    /// to be committed.
    pub(super) amounts: Vec<f32>,
}

const ULP: f32 = f32::EPSILON;
const SQRT_3: f32 = 1.732_050_8;

/// What one update may add to the bound on what accumulation in float32 has done to the positions of a block, a length:
/// √3 · (M·ε + (n + 4)·S·ε), with M the largest coordinate that the block can reach, S = Σ|coefficient| · longest delta
/// over the n entries of the update, and ε = 2⁻²³ (a whole unit in the last place, since Vulkan fixes no rounding
/// mode): one rounding at pose magnitude, one for each coefficient, product, partial sum and scale. A rebuild sets the
/// bound to that of its own entries.
pub(super) fn rounding(magnitude: f32, entries: u32, sum: f32) -> f32 {
    SQRT_3 * ULP * (magnitude + (entries + 4) as f32 * sum)
}

/// What tolerances are fractions of: the diagonal, where there is one.
pub(super) fn length_unit(layout: &PackedLayout) -> f32 {
    if layout.diagonal > 0.0 { layout.diagonal } else { 1.0 }
}

/// Refuse a tolerance that a pose fresh from base exceeds, all weights being 1.
pub(crate) fn check_tolerance(tolerance: f32, layout: &PackedLayout, index: &BlockIndex) -> Result<()> {
    let fresh = (0..index.count()).map(|b| {
        let reach = index.block_reach[b];
        rounding(index.block_base[b] + reach, index.entries(b).len() as u32, reach)
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
        "allow more drift, or use poses of integers (PoseFormat::Fixed32)",
    ))
}
