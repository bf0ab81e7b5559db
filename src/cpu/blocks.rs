//! The CPU twin of `glsl/blocks.comp`: one block at a time, the same loads and stores.
//!
//! A meter gets the bytes of each load and store; a test holds the planner's count against them.

use super::workers::Workers;
use crate::abi::worklist::{ELEMENT_BYTES, Element, ITEM_WORDS};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::formats::{BlockFormat, with_format};
use crate::pack::{POSE_FLOATS, PackedGroup};
use crate::update::blocks::{GroupPlan, Item};
use std::ops::Range;

/// Fewer blocks than this are not worth waking another thread for.
const PIECE_BLOCKS: usize = 12;

/// The pose buffers that an update of one instance touches.
pub(super) struct Buffers<'a> {
    /// The slot that is read; `None`: the one that is written.
    pub source: Option<&'a [f32]>,
    pub destination: &'a mut [f32],
    /// For exact sums; else empty.
    pub sums: &'a mut [i32],
}

/// Carry out the items of one instance.
pub(super) fn run(
    workers: &Workers,
    packed: &PackedGroup,
    plan: &GroupPlan,
    mut items: Range<usize>,
    Buffers { source, mut destination, mut sums }: Buffers<'_>,
) {
    let (list, floats) = (&plan.list, plan.index.size() * POSE_FLOATS);
    let piece = items.len().div_ceil(workers.threads() * 4).max(PIECE_BLOCKS);
    let mut end = 0;
    // Pieces of the list, each with the part of the buffers that it writes.
    let pieces = std::iter::from_fn(|| {
        let taken = items.start..items.end.min(items.start + piece);
        let (start, last) = (end, list.items[taken.clone()].last()?);
        (items.start, end) = (taken.end, (last.block as usize + 1) * floats);
        let part = ..end - start;
        Some((taken, start, destination.split_off_mut(part)?, sums.split_off_mut(part).unwrap_or_default()))
    });
    workers.for_each(pieces, |(items, start, destination, sums)| {
        for i in items {
            let from = list.items[i].block as usize * floats;
            let block = Block::new(packed, plan, i, source.map(|s| &s[from..from + floats]));
            let place = from - start..from - start + floats;
            let sums = sums.get_mut(place.clone()).unwrap_or_default();
            block.run(&mut destination[place], sums, &mut |_| {});
        }
    });
}

/// One workgroup's work.
pub(crate) struct Block<'a> {
    packed: &'a PackedGroup,
    plan: &'a GroupPlan,
    item: &'a Item,
    elements: &'a [Element],
    masks: &'a [u32],
    /// The block in the slot that is read; `None`: in the one that is written.
    source: Option<&'a [f32]>,
    base: &'a [f32],
}

/// What a kernel adds up in (float32, or integers that wrap) of deltas whose numbers are `C`.
trait Sum<C>: Copy + Default {
    /// A coefficient as the work list has it, times the unit of an entry: its step, or 2^shift.
    fn coefficient(bits: u32, step: f32, shift: u32) -> Self;
    fn add(self, coefficient: Self, delta: C) -> Self;
}

impl Sum<i32> for f32 {
    #[inline(always)]
    fn coefficient(bits: u32, step: f32, shift: u32) -> Self {
        // Both factors are powers of two.
        f32::from_bits(bits) * (step * (1u32 << shift) as f32)
    }
    #[inline(always)]
    fn add(self, coefficient: Self, delta: i32) -> Self {
        self + coefficient * delta as f32
    }
}

impl Sum<f32> for f32 {
    #[inline(always)]
    fn coefficient(bits: u32, _: f32, _: u32) -> Self {
        f32::from_bits(bits)
    }
    #[inline(always)]
    fn add(self, coefficient: Self, delta: f32) -> Self {
        self + coefficient * delta
    }
}

impl Sum<i32> for i32 {
    #[inline(always)]
    fn coefficient(bits: u32, _: f32, shift: u32) -> Self {
        (bits as i32).wrapping_shl(shift)
    }
    #[inline(always)]
    fn add(self, coefficient: Self, delta: i32) -> Self {
        self.wrapping_add(coefficient.wrapping_mul(delta))
    }
}

/// Never called: float32 deltas have no exact grid.
impl Sum<f32> for i32 {
    fn coefficient(_: u32, _: f32, _: u32) -> Self {
        0
    }
    fn add(self, _: Self, _: f32) -> Self {
        self
    }
}

/// What is added to a block, component after component: the loops over vertices become SIMD.
type Added<T, const S: usize> = [[T; S]; POSE_FLOATS];

impl<'a> Block<'a> {
    /// Item `i` of the list; `source` is its block in the slot that is read, `None`: in the one that is written.
    pub fn new(packed: &'a PackedGroup, plan: &'a GroupPlan, i: usize, source: Option<&'a [f32]>) -> Self {
        let GroupPlan { index, list, .. } = plan;
        let (floats, words) = (index.size() * POSE_FLOATS, POSE_FLOATS * index.mask_words());
        let item = &list.items[i];
        Self {
            packed,
            plan,
            item,
            elements: list.elements_of(item),
            masks: &list.masks[i * words..][..words],
            source,
            base: &packed.base()[item.block as usize * floats..][..floats],
        }
    }

    /// Update the block: `destination` is its part of the slot that is written, `sums` of the integers.
    pub fn run(&self, destination: &mut [f32], sums: &mut [i32], meter: &mut impl FnMut(usize)) {
        match self.plan.index.size() {
            32 => self.run_sized::<32>(destination, sums, meter),
            64 => self.run_sized::<64>(destination, sums, meter),
            _ => self.run_sized::<128>(destination, sums, meter),
        }
    }

    fn run_sized<const S: usize>(&self, destination: &mut [f32], sums: &mut [i32], meter: &mut impl FnMut(usize)) {
        meter(4 * (ITEM_WORDS + self.masks.len()) + ELEMENT_BYTES * self.elements.len());
        let rebuilt = self.item.source.is_none();
        match self.plan.exact() {
            None => {
                let mut added: Added<f32, S> = [[0.0; S]; POSE_FLOATS];
                self.add_up(&mut added, meter);
                match if rebuilt { Some(self.base) } else { self.source } {
                    Some(from) => {
                        self.apply::<S>(destination, meter, |lane, c, _| from[lane * POSE_FLOATS + c] + added[c][lane]);
                    }
                    None => self.apply::<S>(destination, meter, |lane, c, old| old + added[c][lane]),
                }
            }
            Some(grid) => {
                if let (false, true, Some(source)) = (rebuilt, self.elements.is_empty(), self.source) {
                    // It only catches up.
                    self.apply::<S>(destination, meter, |lane, c, _| source[lane * POSE_FLOATS + c]);
                    return;
                }
                let mut added: Added<i32, S> = [[0; S]; POSE_FLOATS];
                self.add_up(&mut added, meter);
                let units = self.plan.index.steps().map(|step| step * grid.weight_step());
                let before = if rebuilt { 0 } else { -1 };
                self.apply::<S>(destination, meter, |lane, c, _| {
                    let at = lane * POSE_FLOATS + c;
                    let sum = (sums[at] & before).wrapping_add(added[c][lane]);
                    sums[at] = sum;
                    // The product is exact, the unit being a power of two; sums above 24 bits are rounded before.
                    self.base[at] + sum as f32 * units[c / TRIPLE]
                });
                let components: u32 = self.masks.iter().map(|m| m.count_ones()).sum();
                meter(components as usize * if rebuilt { 4 } else { 8 });
            }
        }
    }

    /// Σ coefficient · delta of each component of each vertex.
    fn add_up<T: Sum<i32> + Sum<f32>, const S: usize>(&self, added: &mut Added<T, S>, meter: &mut impl FnMut(usize)) {
        let (index, words) = (&*self.plan.index, self.packed.deltas());
        for element in self.elements {
            with_format!(index.parts.format, dense _f => {}, blocks format => {
                let (header, deltas) = index.locate(format, words, element.entry as usize);
                meter(4 * (header.len() + deltas.len()));
                add_entry(format, element.coefficient, index.steps(), header, &words[deltas], added);
            });
        }
    }

    /// Store `value(lane, component, float there)` wherever the masks say so.
    #[inline(always)]
    fn apply<const S: usize>(
        &self,
        destination: &mut [f32],
        meter: &mut impl FnMut(usize),
        mut value: impl FnMut(usize, usize, f32) -> f32,
    ) {
        let (vertices, words) = (&mut destination.as_chunks_mut::<POSE_FLOATS>().0[..S], S / 32);
        for word in 0..words {
            let masks: [u32; POSE_FLOATS] = std::array::from_fn(|c| self.masks[c * words + word]);
            meter(8 * masks.iter().map(|m| m.count_ones() as usize).sum::<usize>());
            let (whole, some) = (masks.iter().fold(u32::MAX, |a, m| a & m), masks.iter().fold(0, |a, m| a | m));
            if some == 0 {
                continue;
            }
            for (bit, vertex) in vertices[32 * word..][..32].iter_mut().enumerate() {
                let lane = 32 * word + bit;
                if whole >> bit & 1 != 0 {
                    *vertex = std::array::from_fn(|c| value(lane, c, vertex[c]));
                } else if some >> bit & 1 != 0 {
                    for c in (0..POSE_FLOATS).filter(|&c| masks[c] >> bit & 1 != 0) {
                        vertex[c] = value(lane, c, vertex[c]);
                    }
                }
            }
        }
    }
}

/// Add an entry times the coefficient of these bits.
#[inline(always)]
fn add_entry<F: BlockFormat, T: Sum<F::Component>, const S: usize>(
    format: &F,
    bits: u32,
    steps: [f32; TRIPLES],
    header: &[u32],
    deltas: &[u32],
    added: &mut Added<T, S>,
) {
    let shifts = format.shifts(header);
    let coefficients: [T; TRIPLES] = std::array::from_fn(|triple| T::coefficient(bits, steps[triple], shifts[triple]));
    format.decode(S, header, deltas, |lane, c, number| {
        added[c][lane] = added[c][lane].add(coefficients[c / TRIPLE], number);
    });
}
