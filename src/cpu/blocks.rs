//! The CPU twin of `glsl/crowd.comp`: block after block, for each instance that writes the block. Instances share
//! decoded deltas.
//!
//! `meter` receives the bytes of each load and store of a single instance; a test compares the planner's count with
//! their sum.

use super::records::{self, Row, RowSum};
use super::sums::{self, Added, BATCH, Planes};
use super::workers::Workers;
use crate::abi::worklist::{ELEMENT_BYTES, Element};
use crate::asset::streams::TRIPLES;
use crate::pack::formats::small::Records;
use crate::pack::formats::{BlockFormat, with_format};
use crate::pack::poses::sums::Sum;
use crate::pack::poses::{PoseStorage, with_pose};
use crate::pack::{POSE_FLOATS, PackedGroup};
use crate::simd::widest;
use crate::update::blocks::{GroupPlan, Item};
use bytemuck::{Pod, Zeroable, cast, cast_slice, cast_slice_mut};
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

/// A group, and its base pose: a pose, or `PoseFormat::base_words`.
pub(crate) type Mesh<'a> = (&'a PackedGroup, &'a [u32]);

/// Executes the work list; `runs` has the items of each instance.
pub(super) fn run(workers: &Workers, mesh: Mesh<'_>, plan: &GroupPlan, mut runs: Vec<Run<'_>>) {
    let items = &plan.list.items;
    let words = block_words(plan);
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
    workers.for_each(pieces, |(blocks, runs)| run_piece(mesh, plan, blocks, runs, &mut |_| {}));
}

fn block_words(plan: &GroupPlan) -> usize {
    plan.index.size() * plan.pose().stride() / size_of::<u32>()
}

/// Executes the items of `blocks`; `runs` begin with the first block.
pub(crate) fn run_piece(
    mesh: Mesh<'_>,
    plan: &GroupPlan,
    blocks: Range<usize>,
    runs: Vec<Run<'_>>,
    meter: &mut impl FnMut(usize),
) {
    with_pose!(plan.pose(), P => match plan.index.size() {
        32 => run_blocks::<P, 32>(mesh, plan, blocks, runs, meter),
        64 => run_blocks::<P, 64>(mesh, plan, blocks, runs, meter),
        _ => run_blocks::<P, 128>(mesh, plan, blocks, runs, meter),
    });
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

fn run_blocks<P: PoseStorage<Sum: RowSum>, const S: usize>(
    (packed, base): Mesh<'_>,
    plan: &GroupPlan,
    blocks: Range<usize>,
    mut runs: Vec<Run<'_>>,
    meter: &mut impl FnMut(usize),
) {
    let items = &plan.list.items;
    let words = block_words(plan);
    let base_words = S * plan.pose().base_stride() / size_of::<u32>();
    let mut decoded = [[[<P::Sum as Sum>::Delta::default(); S]; POSE_FLOATS]; BATCH];
    let mut tile: Vec<InstanceBlock<'_, P::Sum>> = Vec::with_capacity(runs.len().min(TILE));
    let zero = [[P::Sum::default(); S]; POSE_FLOATS];
    let mut sums = vec![zero; runs.len().min(TILE)];
    let mut rows = [Row::<P::Sum>::default(); S];
    let mut turned = Turned { pairs: [[0; S]; POSE_FLOATS / 2], vertices: [[0; POSE_FLOATS / 2]; S] };
    for block in blocks {
        let mut runs = runs.iter_mut();
        loop {
            tile.clear();
            for run in runs.by_ref() {
                let destination = run.destination.split_off_mut(..words).unwrap_or_default();
                let i = run.items.start;
                if !run.items.is_empty() && items[i].block as usize == block {
                    run.items.start += 1;
                    let block = Block {
                        item: &items[i],
                        source: run.source.map(|source| &source[block * words..][..words]),
                        base: &base[block * base_words..][..base_words],
                        plan,
                    };
                    let elements = plan.list.elements_of(block.item);
                    meter(size_of::<Item>() + ELEMENT_BYTES * elements.len() + block.moved());
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
            // With a single instance, adds while decoding; storing decoded deltas would only cost time.
            if let [InstanceBlock { block, destination, elements, .. }] = &mut *tile {
                match add_alone(packed, plan, elements, &mut sums[0], &mut rows, meter) {
                    true => turned.take(&rows),
                    false => turned.turn(&sums[0]),
                }
                write::<P, S>(&mut turned, block, destination);
                continue;
            }
            sums[..tile.len()].fill(zero);
            while add_batch(packed, plan, &mut tile, &mut sums, &mut decoded, meter) {}
            for (InstanceBlock { block, destination, .. }, sums) in tile.iter_mut().zip(&sums) {
                turned.turn(sums);
                write::<P, S>(&mut turned, block, destination);
            }
        }
    }
}

/// Adds the entries of an instance to `rows`, if the format has records, otherwise to `sums`; says whether it has.
fn add_alone<T: RowSum, const S: usize>(
    packed: &PackedGroup,
    plan: &GroupPlan,
    elements: &[Element],
    sums: &mut Planes<T, S>,
    rows: &mut [Row<T>; S],
    meter: &mut impl FnMut(usize),
) -> bool {
    let index = &*plan.index;
    let words = packed.deltas();
    let mut in_rows = false;
    with_format!(index.parts.format, dense _f => {}, blocks format => widest!(simd => {
        let entries = elements.iter().map(|element| {
            let (header, deltas) = index.locate(format, words, element.entry as usize);
            meter(4 * (header.len() + deltas.len()));
            let factors = factors::<T>(plan, element, format.shifts(header));
            (header, &words[deltas.start..], factors, T::is_new(&factors), element)
        });
        in_rows = format.has_records();
        if in_rows {
            rows.fill(Row::default());
            for (header, deltas, factors, new, _) in entries {
                let records = Records::new(S, header, deltas);
                match new {
                    true => records::add::<_, T, true>(simd, &records, factors, rows),
                    false => records::add::<_, T, false>(simd, &records, factors, rows),
                }
            }
        } else {
            *sums = [[T::default(); S]; POSE_FLOATS];
            for (header, deltas, factors, new, element) in entries {
                let lanes = index.costs[element.entry as usize].lanes.map(usize::from);
                let entry = (header, deltas, lanes[0]..lanes[1]);
                match new {
                    true => sums::add_decoded::<T, _, S, true>(format, entry, factors, sums),
                    false => sums::add_decoded::<T, _, S, false>(format, entry, factors, sums),
                }
            }
        }
    }));
    in_rows
}

/// The factors of an entry whose deltas are to be shifted by `shifts`.
fn factors<T: Sum>(plan: &GroupPlan, element: &Element, shifts: [u32; TRIPLES]) -> [T::Factor; TRIPLES] {
    let (steps, raised) = (plan.index.steps(), plan.grid().map_or([0; TRIPLES], |grid| grid.raised));
    [0, 1].map(|triple| T::factor(element.coefficient, steps[triple], shifts[triple] + raised[triple]))
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
    let index = &*plan.index;
    let words = packed.deltas();
    for (place, decoded) in decoded.iter_mut().enumerate() {
        let next = tile.iter().filter_map(|instance| Some(instance.elements.first()?.entry)).min();
        let Some(entry) = next else { break };
        let (bytes, shifts) = with_format!(index.parts.format, dense _f => (0, [0; TRIPLES]), blocks format => {
            let (header, deltas) = index.locate(format, words, entry as usize);
            sums::decode::<T, _, S>(format, header, &words[deltas.start..], decoded);
            (4 * (header.len() + deltas.len()), format.shifts(header))
        });
        for instance in &mut *tile {
            let Some((element, rest)) = instance.elements.split_first().filter(|(next, _)| next.entry == entry) else {
                continue;
            };
            instance.elements = rest;
            instance.batch[instance.count] = (place, factors::<T>(plan, element, shifts));
            instance.count += 1;
            meter(bytes);
        }
    }
    for (instance, sums) in tile.iter_mut().zip(sums) {
        sums::add(sums, &instance.batch[..std::mem::take(&mut instance.count)], decoded);
    }
    tile.iter().any(|instance| !instance.elements.is_empty())
}

/// Numbers of a block on their way from planes to vertices: pairs of components, then vertices of three pairs. The
/// compiler makes vectors of these two steps; six components at once it takes one by one.
struct Turned<const S: usize> {
    pairs: [[u64; S]; POSE_FLOATS / 2],
    vertices: [[u64; POSE_FLOATS / 2]; S],
}

impl<const S: usize> Turned<S> {
    fn turn<T: Pod>(&mut self, planes: &Planes<T, S>) {
        widest!(_simd => {
            for (pairs, [even, odd]) in self.pairs.iter_mut().zip(planes.as_chunks().0) {
                let pairs = &mut cast_slice_mut(pairs)[..S];
                for lane in 0..S {
                    pairs[lane] = [even[lane], odd[lane]];
                }
            }
            for (lane, vertex) in self.vertices.iter_mut().enumerate() {
                *vertex = [self.pairs[0][lane], self.pairs[1][lane], self.pairs[2][lane]];
            }
        });
    }

    fn take<T: Pod>(&mut self, rows: &[Row<T>; S]) {
        for (vertex, row) in self.vertices.iter_mut().zip(rows) {
            let [a, b, c, _] = cast(row.0);
            *vertex = [a, b, c];
        }
    }
}

/// Stores a block: `destination = source + sums`.
fn write<P: PoseStorage, const S: usize>(turned: &mut Turned<S>, block: &Block<'_>, destination: &mut [u32]) {
    let is_rebuilt = block.item.source.is_none();
    widest!(_simd => {
        let sums: &mut [P::Sum] = cast_slice_mut(turned.vertices.as_flattened_mut());
        if is_rebuilt && P::ROUNDS_SUMS {
            sums.iter_mut().zip(block.base).for_each(|(sum, base)| *sum = P::plus_base(*sum, *base));
        }
        sums.iter_mut().for_each(|sum| *sum = P::rounded(*sum));
        let out = cast_slice_mut::<u32, P::Number>(destination).iter_mut().zip(&*sums);
        match block.source {
            _ if is_rebuilt && P::ROUNDS_SUMS => out.for_each(|(out, sum)| *out = P::plus(P::Number::zeroed(), *sum)),
            _ if is_rebuilt => out.zip(cast_slice(block.base)).for_each(|((out, sum), base)| *out = P::plus(*base, *sum)),
            Some(from) => out.zip(cast_slice(from)).for_each(|((out, sum), old)| *out = P::plus(*old, *sum)),
            None => out.for_each(|(out, sum)| *out = P::plus(*out, *sum)),
        }
    });
}

/// A block that an instance writes.
struct Block<'a> {
    item: &'a Item,
    /// The block in the source slot; `None`: in place.
    source: Option<&'a [u32]>,
    base: &'a [u32],
    plan: &'a GroupPlan,
}

impl Block<'_> {
    /// Bytes of poses that are loaded and stored.
    fn moved(&self) -> usize {
        let pose = 4 * block_words(self.plan);
        pose + if self.item.source.is_some() { pose } else { size_of_val(self.base) }
    }
}
