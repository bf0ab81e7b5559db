//! The CPU twin of `glsl/blocks.comp` and, for fixed-point poses, of `glsl/crowd.comp`: block after block, with the
//! loads and stores of a workgroup for each instance that writes the block. Instances share decoded deltas.
//!
//! `meter` receives the bytes of each load and store of a workgroup with a single instance; a test compares the
//! planner's count with their sum.

use super::simd::widest;
use super::sums::{self, Added, BATCH, Planes};
use super::workers::Workers;
use crate::abi::worklist::{ELEMENT_BYTES, Element, ITEM_WORDS};
use crate::asset::streams::TRIPLES;
use crate::pack::formats::{BlockFormat, with_format};
use crate::pack::poses::sums::Sum;
use crate::pack::poses::{PoseStorage, with_pose};
use crate::pack::{POSE_FLOATS, PackedGroup};
use crate::update::blocks::{GroupPlan, Item};
use bytemuck::{AnyBitPattern, NoUninit, Zeroable, cast_slice, cast_slice_mut};
use std::ops::Range;

/// Work pieces per thread.
const PIECES: usize = 4;
/// Fewer items than this are not worth waking another thread for.
const PIECE_ITEMS: usize = 12;
/// Most instances that share decoded deltas: in blocks of 64 their sums take 48 KiB and stay in the second-level cache.
const TILE: usize = 32;

/// The items of one instance, and its pose.
pub(crate) struct Run<'a> {
    /// Range in the work list.
    pub items: Range<usize>,
    /// The source slot; `None`: in place.
    pub source: Option<&'a [u32]>,
    /// The destination slot, from the first block to be processed on.
    pub destination: &'a mut [u32],
}

impl<'a> Run<'a> {
    /// Splits off the items of blocks before `block`, and `words` words of the destination.
    fn split_off(&mut self, items: &[Item], block: usize, words: usize) -> Self {
        let start = self.items.start;
        self.items.start += items[self.items.clone()].partition_point(|item| (item.block as usize) < block);
        let destination = self.destination.split_off_mut(..words).unwrap_or_default();
        Self { items: start..self.items.start, source: self.source, destination }
    }
}

/// Executes the work list; `runs` has the items of each instance.
pub(super) fn run(workers: &Workers, packed: &PackedGroup, plan: &GroupPlan, mut runs: Vec<Run<'_>>) {
    let (items, words) = (&plan.list.items, block_words(plan));
    let mut counts = vec![0; plan.index.count()];
    items.iter().for_each(|item| counts[item.block as usize] += 1);
    let piece = items.len().div_ceil(workers.threads() * PIECES).max(PIECE_ITEMS);
    let mut end = 0;
    // Pieces of the mesh, each with its items and the parts of the poses that they write.
    let pieces = std::iter::from_fn(|| {
        let (start, mut count) = (end, 0);
        while count < piece && end < counts.len() {
            count += counts[end];
            end += 1;
        }
        let mut part = || runs.iter_mut().map(|run| run.split_off(items, end, (end - start) * words)).collect();
        (count > 0).then(|| (start..end, part()))
    });
    workers.for_each(pieces, |(blocks, runs)| run_piece(packed, plan, blocks, runs, &mut |_| {}));
}

fn block_words(plan: &GroupPlan) -> usize {
    plan.index.size() * plan.pose().stride() / size_of::<u32>()
}

/// Executes the items of `blocks`; `runs` begin with the first block.
pub(crate) fn run_piece(
    packed: &PackedGroup,
    plan: &GroupPlan,
    blocks: Range<usize>,
    runs: Vec<Run<'_>>,
    meter: &mut impl FnMut(usize),
) {
    with_pose!(plan.pose(), P => run_sums::<P>(packed, plan, blocks, runs, meter));
}

fn run_sums<P: PoseStorage>(
    packed: &PackedGroup,
    plan: &GroupPlan,
    blocks: Range<usize>,
    runs: Vec<Run<'_>>,
    meter: &mut impl FnMut(usize),
) {
    match plan.index.size() {
        32 => run_blocks::<P, 32>(packed, plan, blocks, runs, meter),
        64 => run_blocks::<P, 64>(packed, plan, blocks, runs, meter),
        _ => run_blocks::<P, 128>(packed, plan, blocks, runs, meter),
    }
}

/// A block of an instance during the update.
struct InstanceBlock<'a, T: Sum> {
    block: Block<'a>,
    destination: &'a mut [u32],
    /// Elements still to be added.
    elements: &'a [Element],
    /// Elements decoded, to be added.
    batch: [Added<T>; BATCH],
    count: usize,
}

fn run_blocks<P: PoseStorage, const S: usize>(
    packed: &PackedGroup,
    plan: &GroupPlan,
    blocks: Range<usize>,
    mut runs: Vec<Run<'_>>,
    meter: &mut impl FnMut(usize),
) {
    let (items, words) = (&plan.list.items, block_words(plan));
    let mut decoded = [[[<P::Sum as Sum>::Delta::default(); S]; POSE_FLOATS]; BATCH];
    let mut tile: Vec<InstanceBlock<'_, P::Sum>> = Vec::with_capacity(runs.len().min(TILE));
    let zero = [[P::Sum::default(); S]; POSE_FLOATS];
    let mut sums = vec![zero; runs.len().min(TILE)];
    for block in blocks {
        let mut runs = runs.iter_mut();
        loop {
            tile.clear();
            for run in runs.by_ref() {
                let destination = run.destination.split_off_mut(..words).unwrap_or_default();
                let i = run.items.start;
                if !run.items.is_empty() && items[i].block as usize == block {
                    run.items.start += 1;
                    let block = Block::new(packed, plan, i, run.source.map(|source| &source[block * words..][..words]));
                    let elements = plan.list.elements_of(block.item);
                    meter(4 * (ITEM_WORDS + block.masks.len()) + ELEMENT_BYTES * elements.len() + block.moved());
                    let batch = [Added::<P::Sum>::default(); BATCH];
                    tile.push(InstanceBlock { block, destination, elements, batch, count: 0 });
                }
                if tile.len() == TILE {
                    break;
                }
            }
            if tile.is_empty() {
                break;
            }
            sums[..tile.len()].fill(zero);
            // With a single instance, adds while decoding; storing decoded deltas would only cost time.
            match &*tile {
                [instance] => add_alone(packed, plan, instance.elements, &mut sums[0], meter),
                _ => while add_batch(packed, plan, &mut tile, &mut sums, &mut decoded, meter) {},
            }
            for (InstanceBlock { block, destination, .. }, sums) in tile.iter_mut().zip(&sums) {
                write::<P, S>(sums, block, destination);
            }
        }
    }
}

fn add_alone<T: Sum, const S: usize>(
    packed: &PackedGroup,
    plan: &GroupPlan,
    elements: &[Element],
    sums: &mut Planes<T, S>,
    meter: &mut impl FnMut(usize),
) {
    let (index, words, dropped) = (&*plan.index, packed.deltas(), dropped(plan));
    with_format!(index.parts.format, dense _f => {}, blocks format => {
        for element in elements {
            let (header, deltas) = index.locate(format, words, element.entry as usize);
            meter(4 * (header.len() + deltas.len()));
            let factors = factors::<T>(element, index.steps(), format.shifts(header));
            sums::add_decoded(format, header, &words[deltas], factors, dropped, sums);
        }
    });
}

/// Low bits dropped from products, by triple.
fn dropped(plan: &GroupPlan) -> [u32; TRIPLES] {
    plan.grid().map_or([0; TRIPLES], |grid| grid.dropped)
}

fn factors<T: Sum>(element: &Element, steps: [f32; TRIPLES], shifts: [u32; TRIPLES]) -> [T::Factor; TRIPLES] {
    std::array::from_fn(|triple| T::factor(element.coefficient, steps[triple], shifts[triple]))
}

/// Decodes the next entries once each, and adds them to the instances that need them. Returns whether any remain.
fn add_batch<T: Sum, const S: usize>(
    packed: &PackedGroup,
    plan: &GroupPlan,
    tile: &mut [InstanceBlock<'_, T>],
    sums: &mut [Planes<T, S>],
    decoded: &mut [Planes<T::Delta, S>; BATCH],
    meter: &mut impl FnMut(usize),
) -> bool {
    let (index, words, dropped) = (&*plan.index, packed.deltas(), dropped(plan));
    for (place, decoded) in decoded.iter_mut().enumerate() {
        let next = tile.iter().filter_map(|instance| Some(instance.elements.first()?.entry)).min();
        let Some(entry) = next else { break };
        let (bytes, shifts) = with_format!(index.parts.format, dense _f => (0, [0; TRIPLES]), blocks format => {
            let (header, deltas) = index.locate(format, words, entry as usize);
            sums::decode::<T, _, S>(format, header, &words[deltas.clone()], decoded);
            (4 * (header.len() + deltas.len()), format.shifts(header))
        });
        for instance in &mut *tile {
            let Some((element, rest)) = instance.elements.split_first().filter(|(next, _)| next.entry == entry) else {
                continue;
            };
            instance.elements = rest;
            instance.batch[instance.count] = (place, factors::<T>(element, index.steps(), shifts));
            instance.count += 1;
            meter(bytes);
        }
    }
    for (instance, sums) in tile.iter_mut().zip(sums) {
        sums::add(sums, &instance.batch[..std::mem::take(&mut instance.count)], decoded, dropped);
    }
    tile.iter().any(|instance| !instance.elements.is_empty())
}

fn write<P: PoseStorage, const S: usize>(sums: &Planes<P::Sum, S>, block: &Block<'_>, destination: &mut [u32]) {
    let plus = |old: P::Number, lane: usize, c: usize| P::plus(old, sums[c][lane]);
    if block.plan.pose().has_integers() {
        return match block.item.source {
            Some(_) => store(destination, block.source, plus),
            // The base pose has zero displacement.
            None => store(destination, None, |_, lane, c| plus(P::Number::zeroed(), lane, c)),
        };
    }
    let from = if block.item.source.is_none() { Some(cast_slice(block.base)) } else { block.source };
    if block.masks.iter().all(|mask| *mask == u32::MAX) {
        return store(destination, from, plus);
    }
    let destination = cast_slice_mut(destination);
    match from.map(cast_slice::<u32, P::Number>) {
        Some(from) => block.apply::<_, S>(destination, |lane, c, _| plus(from[lane * POSE_FLOATS + c], lane, c)),
        None => block.apply::<_, S>(destination, |lane, c, old| plus(old, lane, c)),
    }
}

/// Stores all of a block: `value(old, vertex, component)`, where `old` is read from `from`, or else from `destination`.
fn store<T: AnyBitPattern + NoUninit>(
    destination: &mut [u32],
    from: Option<&[u32]>,
    value: impl Fn(T, usize, usize) -> T,
) {
    widest(
        #[inline(always)]
        || {
            let (destination, _) = cast_slice_mut::<u32, T>(destination).as_chunks_mut::<POSE_FLOATS>();
            let vertices = destination.iter_mut().enumerate();
            match from {
                None => vertices.for_each(|(lane, v)| *v = std::array::from_fn(|c| value(v[c], lane, c))),
                Some(from) => {
                    let (from, _) = cast_slice::<u32, T>(from).as_chunks::<POSE_FLOATS>();
                    vertices.zip(from).for_each(|((i, v), s)| *v = std::array::from_fn(|c| value(s[c], i, c)));
                }
            }
        },
    );
}

/// The output of one workgroup.
struct Block<'a> {
    item: &'a Item,
    masks: &'a [u32],
    /// The block in the source slot; `None`: in place.
    source: Option<&'a [u32]>,
    base: &'a [f32],
    plan: &'a GroupPlan,
}

impl<'a> Block<'a> {
    /// Item `i` of the list; `source` is its block in the source slot, `None`: in place.
    fn new(packed: &'a PackedGroup, plan: &'a GroupPlan, i: usize, source: Option<&'a [u32]>) -> Self {
        let (floats, words) = (plan.index.size() * POSE_FLOATS, POSE_FLOATS * plan.index.mask_words());
        let (item, masks) = (&plan.list.items[i], &plan.list.masks[i * words..][..words]);
        Self { item, masks, source, base: &packed.base()[item.block as usize * floats..][..floats], plan }
    }

    /// Bytes of the pose that are loaded and stored.
    fn moved(&self) -> usize {
        match self.plan.pose().has_integers() {
            true => 4 * block_words(self.plan) * if self.item.source.is_some() { 2 } else { 1 },
            false => 8 * self.masks.iter().map(|mask| mask.count_ones() as usize).sum::<usize>(),
        }
    }

    /// Stores `value(lane, component, old)` for every component in the masks.
    #[inline(always)]
    fn apply<T: Copy, const S: usize>(&self, destination: &mut [T], mut value: impl FnMut(usize, usize, T) -> T) {
        let (vertices, words) = (&mut destination.as_chunks_mut::<POSE_FLOATS>().0[..S], S / 32);
        for word in 0..words {
            let masks: [u32; POSE_FLOATS] = std::array::from_fn(|c| self.masks[c * words + word]);
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
