//! A crowd's plan for one group of the mesh: state shared by its instances, and the blocks and entries that one
//! update writes.

use crate::abi::worklist::Element;
use crate::error::Result;
use crate::pack::blocks::{BlockIndex, PoseGrid};
use crate::pack::{PackedLayout, PoseFormat};
use crate::plan::{UpdateDesc, UpdateStats};
use std::ops::Range;
use std::sync::Arc;

/// A block of an instance to write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Item {
    /// The instance.
    pub instance: u32,
    /// The block.
    pub block: u32,
    /// The slot of the pose that it starts from; `None`: the base pose.
    pub source: Option<u32>,
    /// The destination slot.
    pub destination: u32,
    /// Its first element in [`WorkList::elements`].
    pub first: u32,
    /// Number of elements.
    pub count: u32,
}

/// The work of one update, for GPU or CPU.
#[derive(Clone, Debug, Default)]
pub struct WorkList {
    /// Blocks to write, ascending by instance, then block.
    pub items: Vec<Item>,
    /// `[instance][entry]`: the elements of a block occupy the first places of its entries.
    pub elements: Vec<Element>,
}

impl WorkList {
    /// Empty, with room for every block of `instances`: filling it never allocates.
    pub fn new(index: &BlockIndex, instances: usize) -> Self {
        Self {
            items: Vec::with_capacity(index.count().saturating_mul(instances)),
            elements: vec![Element::default(); index.entry_count().saturating_mul(instances)],
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
    /// The group's blocks.
    pub index: Arc<BlockIndex>,
    /// The last update.
    pub list: WorkList,
    /// Statistics of the last update.
    pub stats: UpdateStats,
    pub(super) desc: UpdateDesc,
    pub(super) targets: usize,
    pub(super) unit: Unit,
    /// Whether a stream is measured as a length.
    pub(super) has_lengths: bool,
    /// Drift bound above which a block is rebuilt, as a length; infinite for fixed-point poses.
    pub(super) tolerance: f32,
    pub(super) scratch: Scratch,
}

impl GroupPlan {
    /// The plan of `instances` instances.
    ///
    /// # Errors
    /// Errors of [`UpdateDesc::check_for`]; a dense format.
    pub fn new(desc: UpdateDesc, layout: &PackedLayout, instances: usize) -> Result<Self> {
        desc.check_for(layout)?;
        let index = layout.index()?;
        let grid = desc.grid(layout)?;
        let unit = if layout.diagonal > 0.0 { layout.diagonal } else { 1.0 };
        let tolerance = if grid.is_some() { f32::INFINITY } else { desc.tolerance * unit };
        // A budget needs lengths: without them, everything is committed at once.
        let has_lengths = layout.has_lengths();
        let error_budget = if has_lengths { desc.error_budget } else { 0.0 };
        Ok(Self {
            index: index.clone(),
            list: WorkList::new(index, instances),
            stats: UpdateStats::default(),
            desc: UpdateDesc { error_budget, ..desc },
            targets: layout.targets.len(),
            unit: Unit::new(grid, desc.pose),
            has_lengths,
            tolerance,
            scratch: Scratch::default(),
        })
    }

    /// The grid of fixed-point poses.
    pub fn grid(&self) -> Option<PoseGrid> {
        self.unit.grid
    }

    /// The pose format.
    pub fn pose(&self) -> PoseFormat {
        self.desc.pose
    }

    /// Removes the last update.
    pub fn clear(&mut self) {
        self.list.items.clear();
        self.stats = UpdateStats::default();
    }

    /// Vertices that the last update changes in the pose of an instance, as ascending ranges of whole blocks.
    pub fn changed(&self, instance: u32, out: &mut Vec<Range<u32>>) {
        let first = self.list.items.partition_point(|item| item.instance < instance);
        let items = self.list.items[first..].iter().take_while(|item| item.instance == instance);
        // An item that starts from the instance's pose, without elements, is an unchanged copy.
        let changed = items.filter(|item| item.count > 0 || item.source.is_none());
        let size = self.index.size() as u32;
        out.extend(changed.map(|item| item.block * size..(item.block + 1) * size));
    }
}

/// Encoding of weights in lists: float32, or integers in steps of a grid. 32 bits; 0 is weight 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unit {
    grid: Option<PoseGrid>,
    step: f32,
    /// Rounded terms: a coefficient is the new weight (low 16 bits) and the applied weight (high). Otherwise it is
    /// their difference.
    pairs: bool,
}

impl Unit {
    fn new(grid: Option<PoseGrid>, pose: PoseFormat) -> Self {
        Self { grid, step: grid.map_or(1.0, |grid| grid.weight_step()), pairs: pose.rounds_products() }
    }

    pub fn bits(self, weight: f32) -> u32 {
        match self.grid {
            // Adding 0 turns -0 into 0.
            None => (weight + 0.0).to_bits(),
            Some(grid) => grid.steps(weight) as u32,
        }
    }

    /// The coefficient that changes a weight from `old` to `new`.
    pub fn coefficient(self, new: u32, old: u32) -> u32 {
        match self.grid {
            None => (f32::from_bits(new) - f32::from_bits(old)).to_bits(),
            Some(_) if self.pairs => new & 0xffff | old << 16,
            Some(_) => new.wrapping_sub(old),
        }
    }

    /// The absolute change of weight that a coefficient encodes.
    pub fn size(self, coefficient: u32) -> f32 {
        let steps = |change: i32| change.unsigned_abs() as f32 * self.step;
        match self.grid {
            None => f32::from_bits(coefficient).abs(),
            Some(_) if self.pairs => steps(i32::from(coefficient as i16) - (coefficient as i32 >> 16)),
            Some(_) => steps(coefficient as i32),
        }
    }
}

/// Scratch memory shared by the instances.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    /// Requested weights of an instance.
    pub next: Vec<u32>,
    /// By block: end of its elements in the list, relative to the instance's first.
    pub ends: Vec<u32>,
    /// With an error budget: blocks with changed targets.
    pub reached: Vec<bool>,
    /// Entries of a block, by descending amount.
    pub largest: Vec<u32>,
    /// With an error budget, by entry of a block: distance from the requested pose, as a length; negative if it is to
    /// be committed.
    pub amounts: Vec<f32>,
}

const ULP: f32 = f32::EPSILON;
const SQRT_3: f32 = 1.732_050_8;

/// Increment of the drift bound: what one update may add to the position error of a block's float32 sums, as a length:
/// √3 · (M·ε + (n + 4)·S·ε). M is the largest coordinate that the block can reach, S = Σ|coefficient| · longest delta
/// over the n entries of the update, and ε = 2⁻²³ (one ulp, since Vulkan fixes no rounding mode): one rounding at pose
/// magnitude, and one for each coefficient, product, partial sum and scale. A rebuild sets the bound to the increment
/// of its own entries.
pub(super) fn rounding(magnitude: f32, entries: u32, sum: f32) -> f32 {
    SQRT_3 * ULP * (magnitude + (entries + 4) as f32 * sum)
}
