//! Block formats: deltas of the blocks that a target touches, and nothing else.
//!
//! Vertices are reordered (targets cover few blocks then) and cut into blocks of 32, 64 or 128. An *entry* is a target
//! that touches a block, with its deltas there. Positions and normals have one step each for the whole mesh, a power of
//! two, so that integer sums of all entries of a vertex have one unit ([`Accumulate::Exact`](crate::plan::Accumulate)).
//!
//! ```text
//! words   [entry][header words] [entry][delta words]       entries block after block, ascending by target
//! base    [vertex][px py pz nx ny nz]                      in the packed order, padded to whole blocks
//! ```
//!
//! Integers are rounded to nearest, and zero decodes to zero. A delta that is not longer than the error allowed is
//! dropped, for positions and normals apart.

use super::entry::{
    BitReader, BitWriter, FAST_BITS, SMALL_BITS, fast_decode, fast_encode, pack_widths, unpack_widths, width,
};
use super::order::order;
use super::{DeltaFormat, PackDesc, PackError, PackedLayout, PackedMesh, PackedTarget, base_words};
use super::{POSE_FLOATS, VERTEX_PADDING};
use crate::error::{Error, Result};
use crate::mesh::MorphMesh;
use crate::reference::angle_degrees;
use glam::Vec3;
use std::sync::Arc;

/// Sizes that a block may have.
pub const BLOCK_SIZES: [u32; 3] = [32, 64, 128];

/// How to pack into blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockDesc {
    /// Vertices of a block: one of [`BLOCK_SIZES`]; `None` takes what suits the format (32 for `small`, else 64).
    pub size: Option<u32>,
    /// Largest error of a position delta (a length), as a fraction of the bounding-box diagonal, above 0. `fast` may
    /// exceed it where a target moves further than its 15 bits reach; [`BlockIndex::error`] has what was measured.
    pub position_error: f32,
    /// Largest error of a normal at weight 1, in degrees, above 0.
    pub normal_error_degrees: f32,
    /// The largest weight, either sign, that [`Accumulate::Exact`](crate::plan::Accumulate) has to stand.
    pub weight_max: f32,
}

impl Default for BlockDesc {
    /// 1e-5 of the diagonal, 0.5°, weights up to 4.
    fn default() -> Self {
        Self { size: None, position_error: 1e-5, normal_error_degrees: 0.5, weight_max: 4.0 }
    }
}

/// The grid of weights on which integer sums cannot overflow, whatever the weights up to its largest.
///
/// Rounding to it moves a component by at most ½·[`weight_step`](Self::weight_step)·Σ|delta|, on top of what packing lost
/// of the deltas ([`BlockIndex::error`], for each target at weight 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactGrid {
    /// Weights are whole multiples of 2^-bits.
    pub weight_bits: u32,
    /// The largest weight, either sign.
    pub weight_max: f32,
}

impl ExactGrid {
    /// The step of weights.
    pub fn weight_step(&self) -> f32 {
        1.0 / (1u32 << self.weight_bits) as f32
    }

    /// The multiple of the step that is nearest to `weight`: what exact sums take for it.
    pub fn round(&self, weight: f32) -> f32 {
        self.steps(weight) as f32 * self.weight_step()
    }

    /// `weight` in steps. Both factors of the product fit 24 bits, and a power of two changes none: one rounding.
    pub(crate) fn steps(&self, weight: f32) -> i32 {
        (weight * (1u32 << self.weight_bits) as f32).round() as i32
    }
}

/// Most words of a mesh: its bytes have to be counted in 32 bits.
const WORDS_MAX: u64 = u32::MAX as u64 / 4;
/// Fewer bits than this are no grid to animate on.
const WEIGHT_BITS_MIN: u32 = 7;
/// More bits than this nobody can tell apart.
const WEIGHT_BITS_MAX: u32 = 16;

/// An entry as seen from its target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Incidence {
    pub block: u32,
    pub entry: u32,
}

/// What a kernel loads for an entry, and what it may change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EntryCost {
    /// Bytes of its header and deltas.
    pub bytes: u32,
    /// Length of its longest position delta, in input units.
    pub reach: f32,
}

/// The blocks of a mesh: which targets touch them, and where their deltas are.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockIndex {
    format: DeltaFormat,
    size: u32,
    order: Vec<u32>,
    position_step: f32,
    normal_step: f32,
    weight_max: f32,
    error: PackError,
    first_entry: Vec<u32>,
    entry_target: Vec<u32>,
    // Derived from the above and the words.
    deltas_at: usize,
    words: usize,
    exact: Option<ExactGrid>,
    /// The largest Σ|integer| of any vertex component.
    largest_sum: u64,
    costs: Vec<EntryCost>,
    /// `[entry][component][word]`: which vertices' components its deltas change.
    masks: Vec<u32>,
    first_incidence: Vec<u32>,
    incidence: Vec<Incidence>,
    /// `[block][component][word]`: which components some target changes.
    block_masks: Vec<u32>,
    /// Largest base position component of each block, and Σ reach of its entries.
    block_base: Vec<f32>,
    block_reach: Vec<f32>,
}

/// What a [`BlockIndex`] is made from: what a packed file holds of it.
pub(crate) struct Parts {
    pub format: DeltaFormat,
    pub size: u32,
    pub order: Vec<u32>,
    pub position_step: f32,
    pub normal_step: f32,
    pub weight_max: f32,
    pub error: PackError,
    pub first_entry: Vec<u32>,
    pub entry_target: Vec<u32>,
}

impl BlockIndex {
    /// Check `parts` against the words and the base pose, and derive what planning needs.
    pub(crate) fn new(parts: Parts, targets: usize, words: &[u32], base: &[f32]) -> Result<Self, String> {
        let Parts { format, size, order, position_step, normal_step, weight_max, error, first_entry, entry_target } =
            parts;
        let entries = entry_target.len();
        let blocks = first_entry.len().saturating_sub(1);
        let mut index = Self {
            format,
            size,
            order,
            position_step,
            normal_step,
            weight_max,
            error,
            first_entry,
            entry_target,
            deltas_at: 0,
            words: words.len(),
            exact: None,
            largest_sum: 0,
            costs: vec![],
            masks: vec![],
            first_incidence: vec![0; targets + 1],
            incidence: vec![Incidence { block: 0, entry: 0 }; entries],
            block_masks: vec![],
            block_base: vec![0.0; blocks],
            block_reach: vec![0.0; blocks],
        };
        index.deltas_at = entries.saturating_mul(index.header_words());
        index.check(targets, words, base)?;
        index.derive(words, base)?;
        Ok(index)
    }

    fn check(&self, targets: usize, words: &[u32], base: &[f32]) -> Result<(), String> {
        let size = self.size as usize;
        if !BLOCK_SIZES.contains(&self.size) {
            return Err(format!("a block size of {size}"));
        }
        // Powers of two: integers and sums decode without rounding, and a target's step of normals is a shift away.
        let power_of_two = |s: f32| s.is_normal() && s > 0.0 && s.to_bits().trailing_zeros() >= 23;
        if let Some(step) = self.steps().into_iter().find(|s| !power_of_two(*s)) {
            return Err(format!("a step of {step}, which is no power of two"));
        }
        if !(self.weight_max.is_finite() && self.weight_max > 0.0) {
            return Err(format!("weights up to {}", self.weight_max));
        }
        // The kernels count words in 32 bits, and bytes on some devices.
        if words.len() as u64 > WORDS_MAX {
            return Err(format!("{} words; the kernels reach {WORDS_MAX}", words.len()));
        }
        let padded = self.order.len().next_multiple_of(size.max(VERTEX_PADDING));
        if base.len() != padded * POSE_FLOATS || self.first_entry.len() != padded / size + 1 {
            return Err(format!("{} vertices, but {} blocks", self.order.len(), self.first_entry.len() as i64 - 1));
        }
        if let Some(i) = base.iter().position(|b| !b.is_finite()) {
            return Err(format!("the base pose of packed vertex {} is {}", i / POSE_FLOATS, base[i]));
        }
        let mut seen = vec![false; self.order.len()];
        for &v in &self.order {
            match seen.get_mut(v as usize) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(format!("vertex {v} comes twice in the order, or is not there")),
            }
        }
        let ends = (self.first_entry.first(), self.first_entry.last());
        if ends != (Some(&0), Some(&(self.entry_target.len() as u32))) || !self.first_entry.is_sorted() {
            return Err("the entries of blocks overlap or leave gaps".into());
        }
        for block in 0..self.count() {
            let listed = &self.entry_target[self.entries(block)];
            if listed.windows(2).any(|w| w[0] >= w[1]) || listed.iter().any(|&t| t as usize >= targets) {
                return Err(format!("the targets of block {block} are not ascending, or there are fewer"));
            }
        }
        // Before a header is looked at, it has to be there.
        if self.deltas_at > words.len() {
            return Err(format!(
                "{} words, fewer than the headers of {} entries",
                words.len(),
                self.entry_target.len()
            ));
        }
        // Entries lie one after the other: each where the one before ends, the last at the end.
        let mut at = self.deltas_at;
        for entry in 0..self.entry_target.len() {
            self.check_header(words, entry)?;
            if self.first_word(words, entry) != at {
                return Err(format!("the deltas of entry {entry} are not where they belong"));
            }
            at += self.entry_words(words, entry);
        }
        if at != words.len() {
            return Err(format!("{} words where the entries take {at}", words.len()));
        }
        let floats = if self.format == DeltaFormat::BlockFloat32 { words } else { &[] };
        if let Some(i) = floats.iter().position(|w| !f32::from_bits(*w).is_finite()) {
            return Err(format!("word {i} of the deltas is {}", f32::from_bits(floats[i])));
        }
        Ok(())
    }

    /// Whether the integers of an entry fit what decodes them, whatever its deltas are.
    fn check_header(&self, words: &[u32], entry: usize) -> Result<(), String> {
        let largest_normal = match self.format {
            DeltaFormat::Fast => {
                let header = words[entry];
                let shifts = [header & 0xff, header >> 8 & 0xff];
                // Shifted, a component still fits the 32 bits that it is decoded in.
                if header >> 16 != 0 || (0..2).any(|half| FAST_BITS[half] + shifts[half] > 32) {
                    return Err(format!("entry {entry} has shifts of {header:#x}"));
                }
                FAST_BITS[1] + shifts[1]
            }
            DeltaFormat::Small => {
                let word = words[entry * self.header_words() + 1];
                let widths = unpack_widths(word);
                if word >> 30 != 0 || widths.iter().enumerate().any(|(i, w)| *w > SMALL_BITS[i / 3]) {
                    return Err(format!("entry {entry} has components of {widths:?} bits"));
                }
                SMALL_BITS[1]
            }
            _ => return Ok(()),
        };
        let largest_normal = f64::from(self.normal_step) * f64::from(largest_normal).exp2();
        if largest_normal > f64::from(f32::MAX) {
            return Err(format!("the normals of entry {entry} are up to {largest_normal:e} long"));
        }
        Ok(())
    }

    fn derive(&mut self, words: &[u32], base: &[f32]) -> Result<(), String> {
        let (size, w) = (self.size as usize, self.mask_words());
        let entries = self.entry_target.len();
        let mut masks = vec![0u32; entries * POSE_FLOATS * w];
        let mut block_masks = vec![0u32; self.count() * POSE_FLOATS * w];
        let mut costs = Vec::with_capacity(entries);
        let mut sums = vec![[0u64; POSE_FLOATS]; size];
        for block in 0..self.count() {
            sums.fill([0; POSE_FLOATS]);
            for entry in self.entries(block) {
                let mask = &mut masks[entry * POSE_FLOATS * w..][..POSE_FLOATS * w];
                let mut reach = 0.0f64;
                self.for_each_lane(words, entry, |lane, delta, integers| {
                    for (c, (value, integer)) in delta.iter().zip(integers).enumerate() {
                        mask[c * w + lane / 32] |= u32::from(*value != 0.0) << (lane % 32);
                        sums[lane][c] += u64::from(integer.unsigned_abs());
                    }
                    reach = reach.max(delta[..3].iter().map(|d| d * d).sum::<f64>());
                });
                for (all, one) in block_masks[block * POSE_FLOATS * w..].iter_mut().zip(&*mask) {
                    *all |= one;
                }
                // Rounded up: bounds are computed from it.
                let reach = (reach.sqrt() as f32).next_up();
                let bytes = 4 * (self.header_words() + self.entry_words(words, entry)) as u32;
                costs.push(EntryCost { bytes, reach });
                self.block_reach[block] += reach;
            }
            self.largest_sum = sums.iter().flatten().copied().fold(self.largest_sum, u64::max);
            let vertices = &base[block * size * POSE_FLOATS..][..size * POSE_FLOATS];
            let positions = vertices.chunks_exact(POSE_FLOATS).flat_map(|v| &v[..3]);
            self.block_base[block] = positions.fold(0.0, |m: f32, p| m.max(p.abs()));
            if !(self.block_base[block] + self.block_reach[block]).is_finite() {
                return Err(format!("the deltas of block {block} are too large for single precision"));
            }
            // Where the last block has no vertex, nothing may move.
            let live = self.order.len().saturating_sub(block * size).min(size);
            let mask = &block_masks[block * POSE_FLOATS * w..][..POSE_FLOATS * w];
            let moves = |lane: usize| (0..POSE_FLOATS).any(|c| mask[c * w + lane / 32] >> (lane % 32) & 1 != 0);
            if (live..size).any(moves) {
                return Err(format!("block {block} moves vertices that the mesh does not have"));
            }
        }
        (self.masks, self.block_masks, self.costs) = (masks, block_masks, costs);
        // By target: a counting sort, which leaves blocks ascending.
        for &t in &self.entry_target {
            self.first_incidence[t as usize + 1] += 1;
        }
        for t in 1..self.first_incidence.len() {
            self.first_incidence[t] += self.first_incidence[t - 1];
        }
        let mut next = self.first_incidence.clone();
        for block in 0..self.count() {
            for entry in self.entries(block) {
                let at = &mut next[self.entry_target[entry] as usize];
                self.incidence[*at as usize] = Incidence { block: block as u32, entry: entry as u32 };
                *at += 1;
            }
        }
        self.exact = self.exact_grid();
        Ok(())
    }

    /// The finest grid of weights on which Σ|integer| × weight cannot leave 31 bits.
    fn exact_grid(&self) -> Option<ExactGrid> {
        if self.format == DeltaFormat::BlockFloat32 {
            return None;
        }
        let fits = |bits: &u32| {
            let weight = (f64::from(self.weight_max) * f64::from(1u32 << bits)).ceil();
            self.largest_sum as f64 * weight <= f64::from(i32::MAX)
        };
        let weight_bits = (WEIGHT_BITS_MIN..=WEIGHT_BITS_MAX).rev().find(fits)?;
        Some(ExactGrid { weight_bits, weight_max: self.weight_max })
    }

    /// The grid for [`Accumulate::Exact`](crate::plan::Accumulate).
    ///
    /// # Errors
    /// `block-float32` has no integers; deltas so large against their step that sums could overflow: the message
    /// names a position error that would do.
    pub fn exact(&self) -> Result<ExactGrid> {
        if self.format == DeltaFormat::BlockFloat32 {
            return Err(Error::invalid("exact accumulation of float32 deltas", "pack as 'fast' or 'small'"));
        }
        self.exact.ok_or_else(|| {
            let room = f64::from(i32::MAX) / f64::from(self.weight_max) / f64::from(1u32 << WEIGHT_BITS_MIN);
            let factor = (self.largest_sum as f64 / room).log2().ceil().exp2();
            Error::invalid(
                format!(
                    "integer sums of this mesh could overflow: a vertex adds up to {} steps, {room:.0} fit weights up \
                     to {}",
                    self.largest_sum, self.weight_max
                ),
                format!(
                    "pack with errors {factor} times as large (now {:.1e} in length and {:.2}° at most), or with a \
                     smaller largest weight",
                    f64::from(self.position_step) * 0.75f64.sqrt(),
                    (f64::from(self.normal_step) * 0.75f64.sqrt()).to_degrees()
                ),
            )
        })
    }

    /// Vertices of a block.
    pub fn size(&self) -> usize {
        self.size as usize
    }

    /// Number of blocks.
    pub fn count(&self) -> usize {
        self.first_entry.len() - 1
    }

    /// Number of entries: pairs of a block and a target that touches it.
    pub fn entry_count(&self) -> usize {
        self.entry_target.len()
    }

    /// Blocks that some target touches.
    pub fn touched(&self) -> usize {
        (0..self.count()).filter(|&b| !self.entries(b).is_empty()).count()
    }

    /// Packed → user vertex order.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// User → packed vertex order.
    pub fn packed_vertices(&self) -> Vec<u32> {
        let mut packed = vec![0; self.order.len()];
        self.order.iter().enumerate().for_each(|(at, &v)| packed[v as usize] = at as u32);
        packed
    }

    /// What packing lost, measured when the mesh was packed.
    pub fn error(&self) -> PackError {
        self.error
    }

    /// Input units of an integer step of a position delta and of a normal delta.
    pub fn steps(&self) -> [f32; 2] {
        [self.position_step, self.normal_step]
    }

    /// Bytes of the deltas.
    pub fn delta_bytes(&self) -> u64 {
        4 * (self.words - self.deltas_at) as u64
    }

    /// Bytes that say which vertices the deltas belong to and how they are stored.
    pub fn index_bytes(&self) -> u64 {
        4 * self.deltas_at as u64
    }

    /// 32-bit words of a mask of a block's vertices.
    pub(crate) fn mask_words(&self) -> usize {
        self.size as usize / 32
    }

    /// Words of an entry's header.
    pub(crate) fn header_words(&self) -> usize {
        match self.format {
            DeltaFormat::Fast => 1,
            DeltaFormat::Small => 2 + self.mask_words(),
            _ => 0,
        }
    }

    /// Index of the first delta word: the headers end there.
    pub(crate) fn deltas_at(&self) -> usize {
        self.deltas_at
    }

    pub(crate) fn format(&self) -> DeltaFormat {
        self.format
    }

    pub(crate) fn weight_max(&self) -> f32 {
        self.weight_max
    }

    pub(crate) fn first_entries(&self) -> &[u32] {
        &self.first_entry
    }

    pub(crate) fn entry_targets(&self) -> &[u32] {
        &self.entry_target
    }

    pub(crate) fn entries(&self, block: usize) -> std::ops::Range<usize> {
        self.first_entry[block] as usize..self.first_entry[block + 1] as usize
    }

    pub(crate) fn incidence(&self, target: usize) -> &[Incidence] {
        &self.incidence[self.first_incidence[target] as usize..self.first_incidence[target + 1] as usize]
    }

    pub(crate) fn costs(&self) -> &[EntryCost] {
        &self.costs
    }

    pub(crate) fn masks(&self) -> &[u32] {
        &self.masks
    }

    pub(crate) fn block_masks(&self) -> &[u32] {
        &self.block_masks
    }

    /// Largest base position component of each block.
    pub(crate) fn block_base(&self) -> &[f32] {
        &self.block_base
    }

    /// Σ of the longest deltas of each block's entries.
    pub(crate) fn block_reach(&self) -> &[f32] {
        &self.block_reach
    }

    /// Index of an entry's first delta word.
    pub(crate) fn first_word(&self, words: &[u32], entry: usize) -> usize {
        let size = self.size as usize;
        match self.format {
            DeltaFormat::Fast => self.deltas_at + entry * (size * 9 / 4),
            DeltaFormat::Small => self.deltas_at.saturating_add(words[entry * self.header_words()] as usize),
            _ => self.deltas_at + entry * size * POSE_FLOATS,
        }
    }

    /// Delta words of an entry.
    pub(crate) fn entry_words(&self, words: &[u32], entry: usize) -> usize {
        let size = self.size as usize;
        match self.format {
            DeltaFormat::Fast => size * 9 / 4,
            DeltaFormat::Small => {
                let header = &words[entry * self.header_words()..][..self.header_words()];
                let record: u32 = unpack_widths(header[1]).iter().sum();
                let vertices: u32 = header[2..].iter().map(|m| m.count_ones()).sum();
                (record * vertices).div_ceil(32) as usize
            }
            _ => size * POSE_FLOATS,
        }
    }

    /// Call `f` with each vertex of an entry's block that it holds a delta for: its place in the block, the delta in
    /// input units, and in steps (zero for float32).
    pub(crate) fn for_each_lane(
        &self,
        words: &[u32],
        entry: usize,
        mut f: impl FnMut(usize, [f64; POSE_FLOATS], [i32; POSE_FLOATS]),
    ) {
        let size = self.size as usize;
        let steps = [f64::from(self.position_step), f64::from(self.normal_step)];
        let value = |q: [i32; POSE_FLOATS]| std::array::from_fn(|i| f64::from(q[i]) * steps[i / 3]);
        let data = &words[self.first_word(words, entry)..];
        match self.format {
            DeltaFormat::Fast => {
                let shifts = [words[entry] & 0xff, words[entry] >> 8 & 0xff];
                for lane in 0..size {
                    let c = (data[2 * size + lane / 4] >> (8 * (lane % 4))) as i8;
                    let q = fast_decode(data[lane], data[size + lane], c);
                    let q = std::array::from_fn(|i| q[i].wrapping_shl(shifts[i / 3]));
                    f(lane, value(q), q);
                }
            }
            DeltaFormat::Small => {
                let header = &words[entry * self.header_words()..][..self.header_words()];
                let widths = unpack_widths(header[1]);
                let mut bits = BitReader::new(&data[..self.entry_words(words, entry)]);
                for lane in (0..size).filter(|lane| header[2 + lane / 32] >> (lane % 32) & 1 != 0) {
                    let q = widths.map(|w| bits.take(w));
                    f(lane, value(q), q);
                }
            }
            _ => {
                for lane in 0..size {
                    let delta = std::array::from_fn(|c| f64::from(f32::from_bits(data[c * size + lane])));
                    f(lane, delta, [0; POSE_FLOATS]);
                }
            }
        }
    }

    /// As [`PackedMesh::for_each_delta`].
    pub(crate) fn for_each_delta(&self, words: &[u32], target: usize, mut f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        for incidence in self.incidence(target) {
            let first = incidence.block as usize * self.size as usize;
            self.for_each_lane(words, incidence.entry as usize, |lane, delta, _| {
                if let Some(&user) = self.order.get(first + lane) {
                    f(user as usize, delta);
                }
            });
        }
    }
}

/// A delta as the kernels will see it.
type Delta = [i32; POSE_FLOATS];

/// The largest power of two that is not above `step`.
fn power_of_two_below(step: f64) -> f32 {
    step.log2().floor().clamp(-100.0, 100.0).exp2() as f32
}

/// The smallest step that lets the largest position (0) or normal (1) component of `mesh` fit its bits in a record.
fn least_step(mesh: &MorphMesh, half: usize) -> f64 {
    let deltas = mesh.targets.iter().flat_map(|t| if half == 0 { &t.positions } else { &t.normals });
    let largest = deltas.map(|d| d.abs().max_element()).fold(0.0, f32::max);
    f64::from(largest) / f64::from((1u32 << (SMALL_BITS[half] - 1)) - 1)
}

/// The steps for the errors allowed: rounding to nearest is off by up to half the diagonal of a cell.
fn steps(mesh: &MorphMesh, desc: &BlockDesc) -> [f32; 2] {
    // A mesh without extent has no diagonal to measure by.
    let scale = match mesh.diagonal {
        d if d > 0.0 => f64::from(d),
        _ => (least_step(mesh, 0) * f64::from(1u32 << SMALL_BITS[0])).max(1e-30),
    };
    let cell = 2.0 / 3f64.sqrt();
    let wanted =
        [cell * f64::from(desc.position_error) * scale, cell * f64::from(desc.normal_error_degrees).to_radians().sin()];
    // Rounding down to a power of two halves a step at most.
    [0, 1].map(|half| power_of_two_below(wanted[half].max(2.0 * least_step(mesh, half))))
}

fn check(desc: &BlockDesc) -> Result<()> {
    if let Some(size) = desc.size.filter(|s| !BLOCK_SIZES.contains(s)) {
        return Err(Error::invalid(format!("blocks of {size} vertices"), "use 32, 64 or 128"));
    }
    let positive = |v: f32| v.is_finite() && v > 0.0;
    if !positive(desc.position_error) || !positive(desc.normal_error_degrees) || !positive(desc.weight_max) {
        return Err(Error::invalid(
            format!(
                "packing errors of {} of the diagonal and {}°, with weights up to {}",
                desc.position_error, desc.normal_error_degrees, desc.weight_max
            ),
            "use numbers above 0",
        ));
    }
    Ok(())
}

/// Lay out `mesh` in blocks.
pub(super) fn pack(mesh: &MorphMesh, desc: &PackDesc) -> Result<PackedMesh> {
    check(&desc.blocks)?;
    let format = desc.format;
    let default_size = if format == DeltaFormat::Small { 32 } else { 64 };
    let size = desc.blocks.size.unwrap_or(default_size);
    let mut steps = if format == DeltaFormat::BlockFloat32 { [1.0, 1.0] } else { steps(mesh, &desc.blocks) };
    // Two halvings at most.
    let normal_floor = steps[1] / 4.0;
    let mut packed = pack_with(mesh, desc, size, steps)?;
    if format == DeltaFormat::Small {
        // Where a target turns a short normal, the same rounding is a larger angle: finer steps then, as far as the
        // bits of a record go. (The bits of `fast` are given, and mostly all in use.)
        let allowed = f64::from(desc.blocks.normal_error_degrees);
        let finest = least_step(mesh, 1);
        let error = |packed: &PackedMesh| packed.layout.blocks.as_ref().map_or(0.0, |b| b.error.normal_degrees);
        while error(&packed) > allowed && f64::from(steps[1]) / 2.0 >= finest && steps[1] > normal_floor {
            steps[1] /= 2.0;
            packed = pack_with(mesh, desc, size, steps)?;
        }
    }
    Ok(packed)
}

/// Lay out `mesh` in blocks of `size` on a grid of these steps.
fn pack_with(mesh: &MorphMesh, desc: &PackDesc, size: u32, steps: [f32; 2]) -> Result<PackedMesh> {
    let format = desc.format;
    let error_degrees = f64::from(desc.blocks.normal_error_degrees);
    let diagonal = f64::from(mesh.diagonal);
    let allowed = [
        f64::from(desc.blocks.position_error) * diagonal,
        f64::from(desc.blocks.normal_error_degrees).to_radians().sin(),
    ];

    // What each target keeps: exact deltas, zeroed where they may be dropped.
    let keep = |v: u32, p: Vec3, n: Vec3| -> Option<[f32; POSE_FLOATS]> {
        let (mut p, mut n) = (p, n);
        if format != DeltaFormat::BlockFloat32 {
            if p.as_dvec3().length() <= allowed[0] {
                p = Vec3::ZERO;
            }
            // As an angle and as a length: normals that files state need not have unit length.
            let (base, delta) = (mesh.normals[v as usize].as_dvec3(), n.as_dvec3());
            if delta.length() <= allowed[1] && angle_degrees(base, base + delta) <= error_degrees {
                n = Vec3::ZERO;
            }
        }
        (p != Vec3::ZERO || n != Vec3::ZERO).then_some([p.x, p.y, p.z, n.x, n.y, n.z])
    };
    type Kept = Vec<(u32, [f32; POSE_FLOATS])>;
    let kept: Vec<Kept> = mesh
        .targets
        .iter()
        .map(|t| {
            let deltas = t.vertices.iter().zip(t.positions.iter().zip(&t.normals));
            deltas.filter_map(|(&v, (&p, &n))| keep(v, p, n).map(|d| (v, d))).collect()
        })
        .collect();
    let members: Vec<Vec<u32>> = kept.iter().map(|t| t.iter().map(|(v, _)| *v).collect()).collect();
    let order = order(mesh.vertex_count(), &members);
    let mut packed = vec![0u32; order.len()];
    order.iter().enumerate().for_each(|(at, &v)| packed[v as usize] = at as u32);
    drop(members);

    let padded = order.len().next_multiple_of((size as usize).max(VERTEX_PADDING));
    // Entries: by block, then target; a cell of the table lists the deltas of one entry.
    let mut by_block: Vec<Vec<(u32, Kept)>> = vec![vec![]; padded / size as usize];
    for (t, deltas) in kept.into_iter().enumerate() {
        let mut deltas: Kept = deltas.into_iter().map(|(v, d)| (packed[v as usize], d)).collect();
        deltas.sort_unstable_by_key(|(at, _)| *at);
        for run in deltas.chunk_by(|a, b| a.0 / size == b.0 / size) {
            let lanes = run.iter().map(|(at, d)| (at % size, *d)).collect();
            by_block[(run[0].0 / size) as usize].push((t as u32, lanes));
        }
    }
    let (mut first_entry, mut entry_target) = (vec![0u32], vec![]);
    let (mut headers, mut deltas) = (vec![], vec![]);
    for block in &by_block {
        for (target, lanes) in block {
            entry_target.push(*target);
            encode(format, size as usize, steps, lanes, &mut headers, &mut deltas);
        }
        first_entry.push(entry_target.len() as u32);
    }
    let words = headers.len() as u64 + deltas.len() as u64;
    if words > WORDS_MAX {
        return Err(Error::invalid(
            format!("mesh '{}': its deltas take {} bytes", mesh.name, words * 4),
            "split the mesh, or use a smaller format",
        ));
    }
    headers.append(&mut deltas);
    let words = headers;
    let base = base_words(mesh, padded, Some(&order));
    let parts = Parts {
        format,
        size,
        order,
        position_step: steps[0],
        normal_step: steps[1],
        weight_max: desc.blocks.weight_max,
        error: PackError::default(),
        first_entry,
        entry_target,
    };
    let targets = mesh.targets.len();
    let mut index = BlockIndex::new(parts, targets, &words, &base).map_err(|what| {
        Error::invalid(format!("mesh '{}' cannot be packed: {what}", mesh.name), "report this with the mesh")
    })?;
    let layout = |index: &BlockIndex| PackedLayout {
        name: mesh.name.clone(),
        format,
        vertex_count: mesh.vertex_count(),
        chunk_vertices: padded,
        diagonal: mesh.diagonal,
        targets: mesh.targets.iter().map(|t| target(&t.name, steps)).collect(),
        blocks: Some(Arc::new(index.clone())),
    };
    let packed = PackedMesh { layout: layout(&index), base, words };
    index.error = packed.measure_error(mesh);
    Ok(PackedMesh { layout: layout(&index), ..packed })
}

/// A target of a mesh in blocks.
pub(super) fn target(name: &str, steps: [f32; 2]) -> PackedTarget {
    // Both are powers of two.
    let normal_exponent = (steps[1] / steps[0]).log2().clamp(-100.0, 100.0) as i8;
    PackedTarget { name: name.to_owned(), position_step: steps[0], normal_exponent }
}

/// Append one entry.
fn encode(
    format: DeltaFormat,
    size: usize,
    steps: [f32; 2],
    lanes: &[(u32, [f32; POSE_FLOATS])],
    headers: &mut Vec<u32>,
    deltas: &mut Vec<u32>,
) {
    let quantise = |d: &[f32; POSE_FLOATS], shifts: [u32; 2]| -> Delta {
        std::array::from_fn(|i| {
            let step = f64::from(steps[i / 3]) * f64::from(1u32 << shifts[i / 3]);
            (f64::from(d[i]) / step).round() as i32
        })
    };
    match format {
        DeltaFormat::Fast => {
            let fits = |half: usize, shift: u32| {
                let most = (1 << (FAST_BITS[half] - 1)) - 1;
                let mut components = lanes.iter().flat_map(|(_, d)| &d[3 * half..3 * half + 3]);
                let step = f64::from(steps[half]) * f64::from(1u32 << shift);
                components.all(|v| (f64::from(*v) / step).round().abs() <= f64::from(most))
            };
            let shifts = [0, 1].map(|half| (0..31).find(|&s| fits(half, s)).unwrap_or(31));
            headers.push(shifts[0] | shifts[1] << 8);
            let at = deltas.len();
            deltas.resize(at + size * 9 / 4, 0);
            for (lane, delta) in lanes {
                let lane = *lane as usize;
                let (a, b, c) = fast_encode(quantise(delta, shifts));
                deltas[at + lane] = a;
                deltas[at + size + lane] = b;
                deltas[at + 2 * size + lane / 4] |= u32::from(c) << (8 * (lane % 4));
            }
        }
        DeltaFormat::Small => {
            let mut mask = vec![0u32; size / 32];
            let mut widths = [0u32; POSE_FLOATS];
            let mut kept = vec![];
            for (lane, delta) in lanes {
                let q = quantise(delta, [0, 0]);
                if q != [0; POSE_FLOATS] {
                    mask[*lane as usize / 32] |= 1 << (lane % 32);
                    widths = std::array::from_fn(|i| widths[i].max(width(q[i])));
                    kept.push(q);
                }
            }
            headers.extend([deltas.len() as u32, pack_widths(widths)]);
            headers.append(&mut mask);
            let mut bits = BitWriter::default();
            for q in kept {
                q.iter().zip(widths).for_each(|(v, w)| bits.put(*v, w));
            }
            deltas.append(&mut bits.words);
        }
        _ => {
            let at = deltas.len();
            deltas.resize(at + size * POSE_FLOATS, 0);
            for (lane, delta) in lanes {
                for (c, value) in delta.iter().enumerate() {
                    deltas[at + c * size + *lane as usize] = value.to_bits();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    fn packed(format: DeltaFormat, size: u32) -> (MorphMesh, PackedMesh) {
        let mesh = testing::mesh(500, 9);
        let blocks = BlockDesc { size: Some(size), ..BlockDesc::default() };
        let packed = PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(format) }).unwrap();
        (mesh, packed)
    }

    #[test]
    fn deltas_come_back_within_the_error_allowed_in_every_format() {
        for (format, size) in DeltaFormat::BLOCKS.into_iter().flat_map(|f| BLOCK_SIZES.map(|s| (f, s))) {
            let (mesh, packed) = packed(format, size);
            let error = packed.layout().blocks.as_ref().unwrap().error();
            assert_eq!(error, packed.measure_error(&mesh));
            let most = if format == DeltaFormat::BlockFloat32 { 0.0 } else { 1e-5 * f64::from(mesh.diagonal) };
            assert!(error.position <= most && error.normal_degrees <= 0.5, "{format:?} {size}: {error:?}");
            assert!(format == DeltaFormat::BlockFloat32 || error.position > 0.0);
            // Nothing moves that the mesh does not move.
            for (t, target) in mesh.targets.iter().enumerate() {
                packed.for_each_delta(t, |vertex, delta| {
                    assert!(delta == [0.0; 6] || target.vertices.contains(&(vertex as u32)), "{format:?}");
                });
            }
        }
    }

    #[test]
    fn large_deltas_shift_in_fast() {
        let mut mesh = testing::mesh(100, 1);
        mesh.targets[0].positions[0] = Vec3::new(mesh.diagonal, 0.0, 0.0);
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).unwrap();
        let found = packed.measure_error(&mesh).position / f64::from(mesh.diagonal);
        assert!(found > 1e-6 && found < 1e-4, "{found}");
    }

    #[test]
    fn masks_say_what_changes() {
        for (format, size) in DeltaFormat::BLOCKS.into_iter().flat_map(|f| BLOCK_SIZES.map(|s| (f, s))) {
            let (_, packed) = packed(format, size);
            let index = packed.layout().blocks.clone().unwrap();
            let w = index.mask_words();
            for entry in 0..index.entry_count() {
                let mask = &index.masks()[entry * 6 * w..][..6 * w];
                let mut found = vec![0u32; 6 * w];
                index.for_each_lane(packed.words(), entry, |lane, delta, _| {
                    (0..6).for_each(|c| found[c * w + lane / 32] |= u32::from(delta[c] != 0.0) << (lane % 32));
                });
                assert_eq!(mask, found);
                assert!(mask.iter().any(|m| *m != 0) || format != DeltaFormat::BlockFloat32);
            }
            let by_target: usize = (0..9).map(|t| index.incidence(t).len()).sum();
            assert_eq!(by_target, index.entry_count());
        }
    }

    #[test]
    fn an_exact_grid_is_refused_where_sums_could_overflow() {
        let mesh = testing::mesh(100, 3);
        let pack = |position_error| {
            let blocks = BlockDesc { position_error, weight_max: 1e5, ..BlockDesc::default() };
            PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(DeltaFormat::Small) }).unwrap()
        };
        let index = pack(1e-5).layout().blocks.clone().unwrap();
        let text = index.exact().unwrap_err().to_string();
        let factor: f32 = text.split("errors ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!(text.contains("could overflow"), "{text}");
        // The remedy works.
        let grid = pack(1e-5 * factor).layout().blocks.clone().unwrap().exact().unwrap();
        assert!(grid.weight_bits >= WEIGHT_BITS_MIN && grid.weight_max == 1e5);
        let (_, floats) = packed(DeltaFormat::BlockFloat32, 64);
        assert!(floats.layout().blocks.clone().unwrap().exact().is_err());
    }

    #[test]
    fn bad_descriptions_are_refused() {
        let mesh = testing::mesh(10, 1);
        for (blocks, part) in [
            (BlockDesc { size: Some(48), ..BlockDesc::default() }, "48 vertices"),
            (BlockDesc { position_error: 0.0, ..BlockDesc::default() }, "above 0"),
            (BlockDesc { normal_error_degrees: f32::NAN, ..BlockDesc::default() }, "above 0"),
        ] {
            let error = PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(DeltaFormat::Fast) });
            assert!(error.unwrap_err().to_string().contains(part));
        }
    }
}
