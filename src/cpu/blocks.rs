//! The CPU twin of `glsl/blocks.comp`, and of `glsl/crowd.comp` for a single instance where poses are integers: one block
//! at a time, the same loads and stores.
//!
//! A meter gets the bytes of each load and store; a test holds the planner's count against them.

use super::workers::Workers;
use crate::abi::worklist::{ELEMENT_BYTES, Element, ITEM_WORDS};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::formats::{BlockFormat, with_format};
use crate::pack::{POSE_FLOATS, PackedGroup, PoseFormat};
use crate::update::blocks::{GroupPlan, Item};
use bytemuck::{AnyBitPattern, NoUninit, cast_slice};
use std::ops::Range;

/// Fewer blocks than this are not worth waking another thread for.
const PIECE_BLOCKS: usize = 12;

/// Carry out the items of one instance. `source` is the slot that is read, `None`: the one that is written.
pub(super) fn run(
    workers: &Workers,
    packed: &PackedGroup,
    plan: &GroupPlan,
    mut items: Range<usize>,
    source: Option<&[u32]>,
    mut destination: &mut [u32],
) {
    let (list, words) = (&plan.list, plan.index.size() * plan.pose().stride() / size_of::<u32>());
    let piece = items.len().div_ceil(workers.threads() * 4).max(PIECE_BLOCKS);
    let mut end = 0;
    // Pieces of the list, each with the part of the pose that it writes.
    let pieces = std::iter::from_fn(|| {
        let taken = items.start..items.end.min(items.start + piece);
        let (start, last) = (end, list.items[taken.clone()].last()?);
        (items.start, end) = (taken.end, (last.block as usize + 1) * words);
        Some((taken, start, destination.split_off_mut(..end - start)?))
    });
    workers.for_each(pieces, |(items, start, destination)| {
        for i in items {
            let from = list.items[i].block as usize * words;
            let block = Block::new(packed, plan, i, source.map(|s| &s[from..from + words]));
            block.run(&mut destination[from - start..][..words], &mut |_| {});
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
    source: Option<&'a [u32]>,
    base: &'a [f32],
}

/// What a kernel adds up in (float32, or integers that wrap) of deltas whose numbers are `C`.
trait Sum<C>: Copy + Default {
    /// What an entry is multiplied by.
    type Factor: Copy;

    /// It, from the coefficient as the work list has it. `unit`: the step of the entry's triple, and the bits of products
    /// that are dropped; deltas are to be shifted by `shift`.
    fn factor(bits: u32, unit: (f32, u32), shift: u32) -> Self::Factor;

    fn add(self, factor: Self::Factor, delta: C) -> Self;
}

impl Sum<i32> for f32 {
    type Factor = f32;

    #[inline(always)]
    fn factor(bits: u32, (step, _): (f32, u32), shift: u32) -> f32 {
        // Both factors are powers of two.
        f32::from_bits(bits) * (step * (1u32 << shift) as f32)
    }

    #[inline(always)]
    fn add(self, factor: f32, delta: i32) -> Self {
        self + factor * delta as f32
    }
}

impl Sum<f32> for f32 {
    type Factor = f32;

    #[inline(always)]
    fn factor(bits: u32, _: (f32, u32), _: u32) -> f32 {
        f32::from_bits(bits)
    }

    #[inline(always)]
    fn add(self, factor: f32, delta: f32) -> Self {
        self + factor * delta
    }
}

impl Sum<i32> for i32 {
    type Factor = i32;

    #[inline(always)]
    fn factor(bits: u32, _: (f32, u32), shift: u32) -> i32 {
        (bits as i32).wrapping_shl(shift)
    }

    #[inline(always)]
    fn add(self, factor: i32, delta: i32) -> Self {
        self.wrapping_add(factor.wrapping_mul(delta))
    }
}

/// A sum of products that are rounded, each as a function of a weight.
#[derive(Clone, Copy, Default)]
struct Rounded(i32);

impl Sum<i32> for Rounded {
    /// The new weight, the one that the pose holds, and the bits that are dropped.
    type Factor = (i32, i32, u32);

    #[inline(always)]
    fn factor(bits: u32, (_, dropped): (f32, u32), shift: u32) -> Self::Factor {
        (i32::from(bits as i16) << shift, (bits as i32 >> 16) << shift, dropped)
    }

    #[inline(always)]
    fn add(self, (new, old, dropped): Self::Factor, delta: i32) -> Self {
        let half = 1i32 << dropped >> 1;
        let rounded = |weight: i32| weight.wrapping_mul(delta).wrapping_add(half) >> dropped;
        Self(self.0.wrapping_add(rounded(new)).wrapping_sub(rounded(old)))
    }
}

/// Never called: float32 deltas have no grid.
impl Sum<f32> for i32 {
    type Factor = ();
    fn factor(_: u32, _: (f32, u32), _: u32) {}
    fn add(self, (): (), _: f32) -> Self {
        self
    }
}

/// Never called: float32 deltas have no grid.
impl Sum<f32> for Rounded {
    type Factor = ();
    fn factor(_: u32, _: (f32, u32), _: u32) {}
    fn add(self, (): (), _: f32) -> Self {
        self
    }
}

/// What is added to a block, component after component: the loops over vertices become SIMD.
type Added<T, const S: usize> = [[T; S]; POSE_FLOATS];

impl<'a> Block<'a> {
    /// Item `i` of the list; `source` is its block in the slot that is read, `None`: in the one that is written.
    pub fn new(packed: &'a PackedGroup, plan: &'a GroupPlan, i: usize, source: Option<&'a [u32]>) -> Self {
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

    /// Update the block: `destination` is its part of the slot that is written.
    pub fn run(&self, destination: &mut [u32], meter: &mut impl FnMut(usize)) {
        match self.plan.index.size() {
            32 => self.run_sized::<32>(destination, meter),
            64 => self.run_sized::<64>(destination, meter),
            _ => self.run_sized::<128>(destination, meter),
        }
    }

    fn run_sized<const S: usize>(&self, destination: &mut [u32], meter: &mut impl FnMut(usize)) {
        meter(4 * (ITEM_WORDS + self.masks.len()) + ELEMENT_BYTES * self.elements.len());
        match self.plan.pose() {
            PoseFormat::Float32 => {
                let mut added: Added<f32, S> = [[0.0; S]; POSE_FLOATS];
                self.add_up(&mut added, meter);
                let from = if self.item.source.is_none() { Some(self.base) } else { self.source.map(cast_slice) };
                let destination = bytemuck::cast_slice_mut(destination);
                match from {
                    Some(from) => {
                        self.apply::<S>(destination, meter, |lane, c, _| from[lane * POSE_FLOATS + c] + added[c][lane]);
                    }
                    None => self.apply::<S>(destination, meter, |lane, c, old| old + added[c][lane]),
                }
            }
            PoseFormat::Fixed32 => {
                let mut added: Added<i32, S> = [[0; S]; POSE_FLOATS];
                self.add_up(&mut added, meter);
                self.store(destination, meter, |old: i32, lane, c| old.wrapping_add(added[c][lane]));
            }
            PoseFormat::Fixed16 => {
                let mut added: Added<Rounded, S> = [[Rounded(0); S]; POSE_FLOATS];
                self.add_up(&mut added, meter);
                self.store(destination, meter, |old: i16, lane, c| old.wrapping_add(added[c][lane].0 as i16));
            }
        }
    }

    /// Store all integers of the block: what `value` makes of those of the source, 0 where there is none.
    #[inline(always)]
    fn store<T: AnyBitPattern + NoUninit + Default>(
        &self,
        destination: &mut [u32],
        meter: &mut impl FnMut(usize),
        value: impl Fn(T, usize, usize) -> T,
    ) {
        let bytes = size_of_val(destination);
        let (destination, _) = bytemuck::cast_slice_mut::<u32, T>(destination).as_chunks_mut::<POSE_FLOATS>();
        let vertices = destination.iter_mut().enumerate();
        match (self.item.source, self.source) {
            (None, _) => vertices.for_each(|(lane, v)| *v = std::array::from_fn(|c| value(T::default(), lane, c))),
            (Some(_), None) => vertices.for_each(|(lane, v)| *v = std::array::from_fn(|c| value(v[c], lane, c))),
            (Some(_), Some(source)) => {
                let (source, _) = cast_slice::<u32, T>(source).as_chunks::<POSE_FLOATS>();
                vertices.zip(source).for_each(|((i, v), s)| *v = std::array::from_fn(|c| value(s[c], i, c)));
            }
        }
        meter(bytes * if self.item.source.is_some() { 2 } else { 1 });
    }

    /// Σ coefficient · delta of each component of each vertex.
    fn add_up<T: Sum<i32> + Sum<f32>, const S: usize>(&self, added: &mut Added<T, S>, meter: &mut impl FnMut(usize)) {
        let (index, words) = (&*self.plan.index, self.packed.deltas());
        let dropped = self.plan.grid().map_or([0; TRIPLES], |grid| grid.dropped);
        let units = std::array::from_fn(|triple| (index.steps()[triple], dropped[triple]));
        for element in self.elements {
            with_format!(index.parts.format, dense _f => {}, blocks format => {
                let (header, deltas) = index.locate(format, words, element.entry as usize);
                meter(4 * (header.len() + deltas.len()));
                add_entry(format, element.coefficient, units, header, &words[deltas], added);
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
    units: [(f32, u32); TRIPLES],
    header: &[u32],
    deltas: &[u32],
    added: &mut Added<T, S>,
) {
    let shifts = format.shifts(header);
    let factors: [T::Factor; TRIPLES] = std::array::from_fn(|triple| T::factor(bits, units[triple], shifts[triple]));
    format.decode(S, header, deltas, |lane, c, number| {
        added[c][lane] = added[c][lane].add(factors[c / TRIPLE], number);
    });
}
