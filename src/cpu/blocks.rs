//! The CPU twin of `glsl/blocks.comp`: one block at a time, the same loads and stores.
//!
//! Which loads and stores those are is counted by a [`Meter`]; a test holds the planner's count against it.

use super::workers::Workers;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::pack::entry::{BitReader, fast_decode, unpack_widths};
use crate::pack::{DeltaFormat, POSE_FLOATS, PackedMesh};
use crate::plan::blocks::{ELEMENT_BYTES, Element, ITEM_WORDS, Item, WorkList};

/// Sees every load and store of the kernel.
pub(crate) trait Meter {
    /// This many bytes are loaded or stored.
    fn moved(&mut self, bytes: usize);
}

/// Counts nothing, at no cost.
impl Meter for () {
    #[inline(always)]
    fn moved(&mut self, _: usize) {}
}

#[cfg(test)]
impl Meter for u64 {
    fn moved(&mut self, bytes: usize) {
        *self += bytes as u64;
    }
}

/// Fewer blocks than this are not worth waking another thread for.
const PIECE_BLOCKS: usize = 12;

/// The pose buffers that an update of one instance touches, and its integer sums where there are any.
pub(super) struct Buffers<'a> {
    /// The slot that is read; `None`: the one that is written.
    pub source: Option<&'a [f32]>,
    pub destination: &'a mut [f32],
    pub sums: Option<(&'a mut [i32], ExactGrid)>,
}

/// Carry out the items of one instance.
pub(super) fn run(
    workers: &Workers,
    mesh: &PackedMesh,
    index: &BlockIndex,
    list: &WorkList,
    items: std::ops::Range<usize>,
    buffers: Buffers<'_>,
) {
    let floats = index.size() * POSE_FLOATS;
    let Buffers { source, destination, sums } = buffers;
    let (mut sums, grid) = sums.map_or((&mut [][..], None), |(sums, grid)| (sums, Some(grid)));
    let (mut destination, mut at) = (destination, 0);
    let piece = items.len().div_ceil(workers.threads() * 4).max(PIECE_BLOCKS);
    let mut rest = items;
    // Pieces of the list, each with the part of the buffers that it writes.
    let pieces = std::iter::from_fn(|| {
        let taken = rest.start..rest.end.min(rest.start + piece);
        rest.start = taken.end;
        let last = list.items[taken.clone()].last()?;
        let end = (last.block as usize + 1) * floats;
        let (mine, tail) = std::mem::take(&mut destination).split_at_mut(end - at);
        destination = tail;
        let my_sums = match grid {
            Some(_) => {
                let (mine, tail) = std::mem::take(&mut sums).split_at_mut(end - at);
                sums = tail;
                mine
            }
            None => &mut [][..],
        };
        let start = at;
        at = end;
        Some((taken, start, mine, my_sums))
    });
    workers.for_each(pieces, |(items, start, destination, sums)| {
        for i in items {
            let item = &list.items[i];
            let from = item.block as usize * floats;
            let block = Block::new(mesh, index, list, i, source.map(|s| &s[from..from + floats]));
            let destination = &mut destination[from - start..][..floats];
            let sums = grid.map(|grid| (&mut sums[from - start..][..floats], grid));
            block.run(destination, sums, &mut ());
        }
    });
}

/// One workgroup's work.
pub(crate) struct Block<'a> {
    mesh: &'a PackedMesh,
    index: &'a BlockIndex,
    item: &'a Item,
    elements: &'a [Element],
    masks: &'a [u32],
    /// The block in the slot that is read; `None`: in the one that is written.
    source: Option<&'a [f32]>,
    base: &'a [f32],
}

/// What a kernel adds up in: float32, or integers that wrap.
trait Sum: Copy + Default {
    /// A coefficient as the work list has it, times the unit of an entry: its step, or 2^shift.
    fn coefficient(bits: u32, step: f32, shift: u32) -> Self;
    fn add(self, coefficient: Self, delta: i32) -> Self;
    /// As [`add`](Self::add), for float32 deltas.
    fn add_float(self, coefficient: f32, delta: f32) -> Self;
}

impl Sum for f32 {
    #[inline(always)]
    fn coefficient(bits: u32, step: f32, shift: u32) -> Self {
        // Both factors are powers of two.
        f32::from_bits(bits) * (step * (1u32 << shift) as f32)
    }
    #[inline(always)]
    fn add(self, coefficient: Self, delta: i32) -> Self {
        self + coefficient * delta as f32
    }
    #[inline(always)]
    fn add_float(self, coefficient: f32, delta: f32) -> Self {
        self + coefficient * delta
    }
}

impl Sum for i32 {
    #[inline(always)]
    fn coefficient(bits: u32, _: f32, shift: u32) -> Self {
        (bits as i32).wrapping_shl(shift)
    }
    #[inline(always)]
    fn add(self, coefficient: Self, delta: i32) -> Self {
        self.wrapping_add(coefficient.wrapping_mul(delta))
    }
    #[inline(always)]
    fn add_float(self, _: f32, _: f32) -> Self {
        self // never called: float32 deltas have no exact grid
    }
}

/// What is added to a block, component after component: the loops over vertices become SIMD.
type Added<T, const S: usize> = [[T; S]; POSE_FLOATS];

impl<'a> Block<'a> {
    /// Item `i` of `list`; `source` is its block in the slot that is read, `None`: in the one that is written.
    pub fn new(
        mesh: &'a PackedMesh,
        index: &'a BlockIndex,
        list: &'a WorkList,
        i: usize,
        source: Option<&'a [f32]>,
    ) -> Self {
        let (floats, words) = (index.size() * POSE_FLOATS, POSE_FLOATS * index.mask_words());
        let item = &list.items[i];
        Self {
            mesh,
            index,
            item,
            elements: list.elements_of(item),
            masks: &list.masks[i * words..][..words],
            source,
            base: &mesh.base()[item.block as usize * floats..][..floats],
        }
    }

    /// Update the block: `destination` is its part of the slot that is written, `sums` of the integers.
    pub fn run(&self, destination: &mut [f32], sums: Option<(&mut [i32], ExactGrid)>, meter: &mut impl Meter) {
        match self.index.size() {
            32 => self.run_sized::<32>(destination, sums, meter),
            64 => self.run_sized::<64>(destination, sums, meter),
            _ => self.run_sized::<128>(destination, sums, meter),
        }
    }

    fn run_sized<const S: usize>(
        &self,
        destination: &mut [f32],
        sums: Option<(&mut [i32], ExactGrid)>,
        meter: &mut impl Meter,
    ) {
        meter.moved(4 * (ITEM_WORDS + self.masks.len()) + ELEMENT_BYTES * self.elements.len());
        let rebuilt = self.item.source.is_none();
        match sums {
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
            Some((sums, grid)) => {
                if let (false, true, Some(source)) = (rebuilt, self.elements.is_empty(), self.source) {
                    // It only catches up.
                    self.apply::<S>(destination, meter, |lane, c, _| source[lane * POSE_FLOATS + c]);
                    return;
                }
                let mut added: Added<i32, S> = [[0; S]; POSE_FLOATS];
                self.add_up(&mut added, meter);
                let units = self.index.steps().map(|step| step * grid.weight_step());
                let before = if rebuilt { 0 } else { -1 };
                self.apply::<S>(destination, meter, |lane, c, _| {
                    let at = lane * POSE_FLOATS + c;
                    let sum = (sums[at] & before).wrapping_add(added[c][lane]);
                    sums[at] = sum;
                    // The product is exact, the unit being a power of two; sums above 24 bits are rounded before.
                    self.base[at] + sum as f32 * units[c / 3]
                });
                let components: u32 = self.masks.iter().map(|m| m.count_ones()).sum();
                meter.moved(components as usize * if rebuilt { 4 } else { 8 });
            }
        }
    }

    /// Σ coefficient · delta of each component of each vertex.
    fn add_up<T: Sum, const S: usize>(&self, added: &mut Added<T, S>, meter: &mut impl Meter) {
        let (index, words) = (self.index, self.mesh.words());
        let [position_step, normal_step] = index.steps();
        for element in self.elements {
            let (entry, bits) = (element.entry as usize, element.coefficient);
            let header = &words[entry * index.header_words()..][..index.header_words()];
            let data = &words[index.first_word(words, entry)..][..index.entry_words(words, entry)];
            meter.moved(4 * (header.len() + data.len()));
            let factors = |shifts: [u32; 2]| {
                [T::coefficient(bits, position_step, shifts[0]), T::coefficient(bits, normal_step, shifts[1])]
            };
            match index.format() {
                DeltaFormat::Fast => add_fast(added, factors([header[0] & 0xff, header[0] >> 8 & 0xff]), data),
                DeltaFormat::Small => add_small(added, factors([0, 0]), header, data),
                _ => add_float32(added, f32::from_bits(bits), data),
            }
        }
    }

    /// Store `value(lane, component, float there)` wherever the masks say so.
    #[inline(always)]
    fn apply<const S: usize>(
        &self,
        destination: &mut [f32],
        meter: &mut impl Meter,
        mut value: impl FnMut(usize, usize, f32) -> f32,
    ) {
        let (vertices, words) = (&mut destination.as_chunks_mut::<POSE_FLOATS>().0[..S], S / 32);
        for word in 0..words {
            let masks: [u32; POSE_FLOATS] = std::array::from_fn(|c| self.masks[c * words + word]);
            meter.moved(8 * masks.iter().map(|m| m.count_ones() as usize).sum::<usize>());
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

fn add_float32<T: Sum, const S: usize>(added: &mut Added<T, S>, coefficient: f32, data: &[u32]) {
    for (sums, row) in added.iter_mut().zip(data.chunks_exact(S)) {
        for (sum, word) in sums.iter_mut().zip(row) {
            *sum = sum.add_float(coefficient, f32::from_bits(*word));
        }
    }
}

fn add_fast<T: Sum, const S: usize>(added: &mut Added<T, S>, [position, normal]: [T; 2], data: &[u32]) {
    let (a, rest) = data.split_at(S);
    let (b, c) = rest.split_at(S);
    let c: &[i8] = bytemuck::cast_slice(c);
    let (a, b, c) = (&a[..S], &b[..S], &c[..S]);
    let [x, y, z, nx, ny, nz] = added;
    for lane in 0..S {
        let d = fast_decode(a[lane], b[lane], c[lane]);
        x[lane] = x[lane].add(position, d[0]);
        y[lane] = y[lane].add(position, d[1]);
        z[lane] = z[lane].add(position, d[2]);
        nx[lane] = nx[lane].add(normal, d[3]);
        ny[lane] = ny[lane].add(normal, d[4]);
        nz[lane] = nz[lane].add(normal, d[5]);
    }
}

fn add_small<T: Sum, const S: usize>(added: &mut Added<T, S>, factors: [T; 2], header: &[u32], data: &[u32]) {
    let widths = unpack_widths(header[1]);
    let mut bits = BitReader::new(data);
    for (word, &mask) in header[2..].iter().enumerate() {
        let mut rest = mask;
        while rest != 0 {
            let lane = 32 * word + rest.trailing_zeros() as usize;
            rest &= rest - 1;
            for (c, (row, width)) in added.iter_mut().zip(widths).enumerate() {
                row[lane] = row[lane].add(factors[c / 3], bits.take(width));
            }
        }
    }
}
