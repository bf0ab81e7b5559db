//! Second step of the vertex order, for a format whose entries take as many bits as their deltas differ: vertices that
//! targets move alike share a block.
//!
//! Two blocks at a time, alike in the mean, are divided anew into vertices that move alike, as long as entries get
//! smaller by it. The first step ([`order`](super::order)) says which blocks there are to begin with.

use super::POSE_FLOATS;
use crate::simd::widest;

/// A delta in steps; the last two are 0, so that a row fills a vector.
pub(super) type Row = [i32; 8];

/// A target that moves a vertex, and the delta.
pub(super) type Move = (usize, Row);

/// Most blocks that each block is tried with, of so many around it in either direction; fewer where a pass would try
/// more than these pairs, which takes about two seconds.
const NEAR: usize = 8;
const AROUND: usize = 512;
const PAIRS: usize = 1 << 14;
/// Most passes over all blocks; one that saves less than this part of the bits is the last.
const PASSES: usize = 8;
const WORTH: usize = 200;
/// How often the vertices of two blocks are divided, each time along the direction between the last halves.
const TURNS: usize = 4;
/// Bits that an entry counts beside its own, for what follows from it in planning and in poses.
const ENTRY_BITS: usize = 32;

/// What tells vertices apart: square roots of their numbers, summed up with signs, each in one of so many places.
const PLACES: usize = 128;
type Sketch = [f32; PLACES];

#[inline(always)]
fn sketch(moves: &[Move]) -> Sketch {
    let mut out = [0.0; PLACES];
    for (target, delta) in moves {
        for (c, number) in delta[..POSE_FLOATS].iter().enumerate() {
            let hash = ((target * POSE_FLOATS + c) as u32 + 1).wrapping_mul(0x9e37_79b1);
            let hash = (hash ^ hash >> 15).wrapping_mul(0x85eb_ca6b);
            // The root: differences between small numbers cost as many bits as those between large ones.
            let root = (number.unsigned_abs() as f32).sqrt();
            let negative = (*number < 0) != (hash >> 8 & 1 != 0);
            out[hash as usize >> 25] += if negative { -root } else { root };
        }
    }
    out
}

// Loops that count, here and below: what iterators call is not always inlined, and then not compiled for AVX2.
#[inline(always)]
fn add(sum: &mut Sketch, of: &Sketch, factor: f32) {
    for i in 0..PLACES {
        sum[i] += factor * of[i];
    }
}

/// In eight sums, which make a vector.
#[inline(always)]
fn dot(a: impl Fn(usize) -> f32, b: impl Fn(usize) -> f32) -> f32 {
    let mut sums = [0.0f32; 8];
    for from in 0..PLACES / 8 {
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum += a(8 * from + i) * b(8 * from + i);
        }
    }
    sums.iter().sum()
}

/// Bits of blocks: those of each entry, of its number of vertices, and the least and largest numbers.
struct Cost<'a, F> {
    moves: &'a [Vec<Move>],
    bits: F,
    /// By target, empty between two blocks.
    ranges: Vec<(usize, Row, Row)>,
    /// The targets that move the block.
    touched: Vec<usize>,
}

const EMPTY: (usize, Row, Row) = (0, [i32::MAX; 8], [i32::MIN; 8]);

impl<F: Fn(usize, &[i32], &[i32]) -> usize> Cost<'_, F> {
    #[inline(always)]
    fn of(&mut self, block: &[u32]) -> usize {
        for vertex in block {
            for (target, delta) in &self.moves[*vertex as usize] {
                // Copies, which nothing else can alias: the loops become vectors.
                let (count, mut low, mut high) = self.ranges[*target];
                for c in 0..low.len() {
                    low[c] = low[c].min(delta[c]);
                }
                for c in 0..high.len() {
                    high[c] = high[c].max(delta[c]);
                }
                if count == 0 {
                    self.touched.push(*target);
                }
                self.ranges[*target] = (count + 1, low, high);
            }
        }
        let mut sum = 0;
        for target in self.touched.drain(..) {
            let (count, low, high) = std::mem::replace(&mut self.ranges[target], EMPTY);
            sum += (self.bits)(count, &low[..POSE_FLOATS], &high[..POSE_FLOATS]) + ENTRY_BITS;
        }
        sum
    }
}

/// Rearranges `order` (packed → user), so that entries take fewer bits; vertices that nothing moves stay behind all
/// others. `bits` returns those of an entry, of its number of vertices, and the least and largest numbers.
pub(super) fn regroup(
    order: &mut [u32],
    moves: &[Vec<Move>],
    size: usize,
    bits: impl Fn(usize, &[i32], &[i32]) -> usize,
) {
    widest!(_simd => regrouped(order, moves, size, &bits));
}

#[inline(always)]
fn regrouped(order: &mut [u32], moves: &[Vec<Move>], size: usize, bits: impl Fn(usize, &[i32], &[i32]) -> usize) {
    let targets = moves.iter().flatten().map(|(target, _)| target + 1).max().unwrap_or(0);
    let moved = order.iter().take_while(|vertex| !moves[**vertex as usize].is_empty()).count();
    // A last block that is not full stays as it is.
    let (blocks, _) = order.split_at_mut(moved / size * size);
    let sketches: Vec<Sketch> = moves.iter().map(|moves| sketch(moves)).collect();
    let mut cost = Cost { moves, bits, ranges: vec![EMPTY; targets], touched: vec![] };
    let mut costs = vec![];
    for block in blocks.chunks(size) {
        costs.push(cost.of(block));
    }
    // How often blocks have changed, and with which others each was tried, after how many changes of both.
    let mut changes = vec![0u32; costs.len()];
    let mut tried = vec![vec![]; costs.len()];
    for _ in 0..PASSES {
        let before: usize = costs.iter().sum();
        let sums: Vec<Sketch> = blocks.chunks(size).map(|block| sum(block, &sketches)).collect();
        for one in 0..sums.len() {
            for other in nearest(&sums, one) {
                let [a, b] = [one.min(other), one.max(other)];
                let state = (b, changes[a] + changes[b]);
                if tried[a].contains(&state) {
                    continue;
                }
                tried[a].push(state);
                let pair = [a, b].map(|block| &blocks[block * size..][..size]).concat();
                for direction in [outward(&pair, &sketches), apart(&pair, &sketches)] {
                    let pair = divided(&pair, direction, &sketches);
                    let first = cost.of(&pair[..size]);
                    let second = cost.of(&pair[size..]);
                    if first + second < costs[a] + costs[b] {
                        for (block, half) in [a, b].into_iter().zip(pair.chunks(size)) {
                            blocks[block * size..][..size].copy_from_slice(half);
                            changes[block] += 1;
                        }
                        [costs[a], costs[b]] = [first, second];
                    }
                }
            }
        }
        let after: usize = costs.iter().sum();
        if (before - after) * WORTH < before {
            break;
        }
    }
}

#[inline(always)]
fn sum(vertices: &[u32], sketches: &[Sketch]) -> Sketch {
    let mut sum = [0.0; PLACES];
    vertices.iter().for_each(|vertex| add(&mut sum, &sketches[*vertex as usize], 1.0));
    sum
}

/// The blocks whose sums are nearest to that of block `one`, of those around it in the order.
#[inline(always)]
fn nearest(sums: &[Sketch], one: usize) -> Vec<usize> {
    let around = one.saturating_sub(AROUND)..(one + AROUND).min(sums.len());
    let mut distances = vec![];
    for other in &sums[around.clone()] {
        let difference = |i: usize| other[i] - sums[one][i];
        distances.push(dot(difference, difference));
    }
    distances[one - around.start] = f32::INFINITY;
    let near = (PAIRS / sums.len()).clamp(1, NEAR).min(distances.len() - 1);
    // Not sorted, here and below: that takes 4 kB of the C library for each kind of list.
    let next = |_| {
        let least = (1..distances.len()).fold(0, |at, i| if distances[i] < distances[at] { i } else { at });
        distances[least] = f32::INFINITY;
        around.start + least
    };
    (0..near).map(next).collect()
}

/// The direction from the middle of two blocks to the vertex that is furthest from it.
#[inline(always)]
fn outward(pair: &[u32], sketches: &[Sketch]) -> Sketch {
    let sum = sum(pair, sketches);
    let part = -1.0 / pair.len() as f32;
    let mut furthest = (f32::NEG_INFINITY, sum);
    for vertex in pair {
        let mut direction = sketches[*vertex as usize];
        add(&mut direction, &sum, part);
        let length = dot(|i| direction[i], |i| direction[i]);
        if length >= furthest.0 {
            furthest = (length, direction);
        }
    }
    furthest.1
}

/// The direction from one half to the other.
#[inline(always)]
fn apart(pair: &[u32], sketches: &[Sketch]) -> Sketch {
    let [mut first, second] = [&pair[..pair.len() / 2], &pair[pair.len() / 2..]].map(|half| sum(half, sketches));
    add(&mut first, &second, -1.0);
    first
}

/// Two halves that differ more, beginning with those along `direction`.
#[inline(always)]
fn divided(pair: &[u32], mut direction: Sketch, sketches: &[Sketch]) -> Vec<u32> {
    let mut pair = pair.to_vec();
    for turn in 0..TURNS {
        if turn > 0 {
            direction = apart(&pair, sketches);
        }
        let mut along = vec![];
        for vertex in &pair {
            let sketch = &sketches[*vertex as usize];
            along.push(dot(|i| sketch[i], |i| direction[i]));
        }
        let mut sorted = pair.clone();
        for (i, vertex) in (0u32..).zip(&pair) {
            let own = along[i as usize];
            let before = |(j, other): (u32, &f32)| u32::from((*other > own) | ((*other == own) & (j < i)));
            sorted[(0u32..).zip(&along).map(before).sum::<u32>() as usize] = *vertex;
        }
        // Further turns would change nothing.
        if turn > 0 && sorted == pair {
            break;
        }
        pair = sorted;
    }
    pair
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_that_move_alike_share_blocks_and_the_still_ones_stay() {
        // Target t moves all vertices, those ≡ k modulo 4 by a distance of their own.
        let moves = |v: usize| (0..3).map(|t| (t, [(v % 4 * 100 * (t + 1)) as i32 + (v / 7 % 3) as i32; 8])).collect();
        let all: Vec<Vec<Move>> = (0..300).map(|v| if v < 270 { moves(v) } else { vec![] }).collect();
        let mut order: Vec<u32> = (0..300).collect();
        let bits = |count: usize, low: &[i32], high: &[i32]| {
            let widths = low.iter().zip(high).map(|(low, high)| (high - low + 1).ilog2() as usize);
            count * widths.sum::<usize>()
        };
        regroup(&mut order, &all, 32, bits);
        assert!(order[..256].chunks(32).all(|block| block.iter().all(|v| v % 4 == block[0] % 4)), "{order:?}");
        assert_eq!(order[270..], (270..300).collect::<Vec<u32>>());
        let mut sorted = order;
        sorted.sort_unstable();
        assert_eq!(sorted, (0..300).collect::<Vec<u32>>());
        regroup(&mut [], &[], 32, bits);
        regroup(&mut [0, 1], &[vec![], vec![]], 32, bits);
    }
}
