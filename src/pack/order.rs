//! Vertex order of block formats. A target covers few blocks if vertices moved by the same targets are adjacent.
//!
//! Vertices are split recursively, like a decision tree: by the target whose membership tells most about membership in
//! all other targets. Every second branch is mirrored, so that neighbours in the order differ little.

use crate::simd::widest;
use std::cmp::Reverse;
use std::collections::VecDeque;

/// Largest sample of vertices to choose a split from.
const SAMPLE: usize = 512;
/// Most targets compared for a split: those that divide the sample most evenly. Time is quadratic in it.
const COMPARED: usize = 512;
/// Most sets of welded vertices considered when filling a block.
const AHEAD: usize = 1024;
/// Sets this small are not split.
const LEAF: usize = 4;

/// Packed → user order of `vertices` vertices; `members` lists the vertices that each target moves, ascending. Vertices
/// that no target moves come last.
pub(super) fn order(vertices: usize, members: &[Vec<u32>]) -> Vec<u32> {
    let words = members.len().div_ceil(64);
    let mut sets = vec![0u64; vertices * words];
    for (target, members) in members.iter().enumerate() {
        for &v in members {
            sets[v as usize * words + target / 64] |= 1 << (target % 64);
        }
    }
    let of = |v: u32| &sets[v as usize * words..][..words];
    let (moved, still): (Vec<u32>, Vec<u32>) = (0..vertices as u32).partition(|&v| of(v).iter().any(|word| *word != 0));
    let mut order = Vec::with_capacity(vertices);
    // A stack instead of recursion: the depth may reach the number of targets.
    let mut stack = vec![(moved, false)];
    while let Some((set, mirrored)) = stack.pop() {
        match split(&set, members.len(), of) {
            None => order.extend(set),
            Some(target) => {
                let (first, second): (Vec<u32>, Vec<u32>) =
                    set.into_iter().partition(|&v| has(of(v), target) != mirrored);
                stack.push((second, true));
                stack.push((first, false));
            }
        }
    }
    order.extend(still);
    order
}

/// Rearranges `order` so that no block of `size` vertices ends between welded vertices. `welds` names for each vertex
/// the first one at its position; empty if there are none. Welded vertices with equal base pose and deltas are then
/// decoded and summed alike, and stay bit-equal in every pose. If the next welded set does not fit the rest of a block,
/// a smaller one of the next [`AHEAD`] does, else a subset of these and the block's own that fills it exactly. Failing
/// that (sets of three never fill a block of 32), a set is cut: the order has no gaps.
pub(super) fn keep_welded(order: Vec<u32>, welds: &[u32], size: usize) -> Vec<u32> {
    if welds.is_empty() {
        return order;
    }
    let mut places: Vec<Vec<u32>> = vec![vec![]; welds.len()];
    order.iter().for_each(|&v| places[welds[v as usize] as usize].push(v));
    // Welded sets by first vertex in the order; deferred ones first.
    let mut rest = order.iter().map(|&v| welds[v as usize] as usize);
    let mut waiting: VecDeque<Vec<u32>> = VecDeque::new();
    let mut out = Vec::with_capacity(order.len());
    // The block that is being filled.
    let (mut block, mut room): (Vec<Vec<u32>>, usize) = (vec![], size);
    while out.len() + (size - room) < order.len() {
        let at = waiting.iter().position(|place| place.len() <= room);
        let mut fits = at.and_then(|at| waiting.remove(at));
        while fits.is_none() && waiting.len() < AHEAD {
            let Some(place) = rest.next().map(|place| std::mem::take(&mut places[place])) else { break };
            match place.len() {
                0 => {}
                n if n <= room => fits = Some(place),
                _ => waiting.push_back(place),
            }
        }
        let lengths = || block.iter().chain(&waiting).map(Vec::len).collect::<Vec<_>>();
        if fits.is_none()
            && let Some(chosen) = filling(&lengths(), size)
        {
            let all: Vec<Vec<u32>> = block.drain(..).chain(waiting.drain(..)).collect();
            for (place, chosen) in all.into_iter().zip(chosen) {
                if chosen { block.push(place) } else { waiting.push_back(place) }
            }
            room = 0;
        } else {
            let mut place = fits.or_else(|| waiting.pop_front()).unwrap_or_default();
            let cut = place.split_off(room.min(place.len()));
            room -= place.len();
            block.push(place);
            if !cut.is_empty() {
                waiting.push_front(cut);
            }
        }
        if room == 0 {
            out.extend(block.drain(..).flatten());
            room = size;
        }
    }
    out.extend(block.into_iter().flatten());
    out
}

/// A subset of `lengths` with sum `size`, early ones preferred; `None` if there is none.
fn filling(lengths: &[usize], size: usize) -> Option<Vec<bool>> {
    // For each sum, the first length that completes it; earlier lengths make up the rest.
    let mut last: Vec<Option<usize>> = vec![None; size + 1];
    for (i, &length) in lengths.iter().enumerate() {
        for sum in (length..=size).rev() {
            if last[sum].is_none() && (sum == length || last[sum - length].is_some()) {
                last[sum] = Some(i);
            }
        }
    }
    let mut chosen = vec![false; lengths.len()];
    let mut sum = size;
    while sum > 0 {
        let i = last[sum]?;
        chosen[i] = true;
        sum -= lengths[i];
    }
    Some(chosen)
}

/// Order for several groups, given the vertices that each group's targets move: the first group's order, then, among
/// vertices that it does not move, the next group's.
pub(super) fn order_groups(vertices: usize, groups: &[Vec<Vec<u32>>]) -> Vec<u32> {
    let Some((first, further)) = groups.split_first() else { return (0..vertices as u32).collect() };
    let mut order = order(vertices, first);
    let mut moved = vec![false; vertices];
    first.iter().flatten().for_each(|&v| moved[v as usize] = true);
    if further.iter().flatten().flatten().any(|&v| !moved[v as usize]) {
        let still = order.split_off(moved.iter().filter(|moved| **moved).count());
        // Renumber the remaining vertices.
        let mut number = vec![u32::MAX; vertices];
        still.iter().enumerate().for_each(|(i, &v)| number[v as usize] = i as u32);
        let left = |target: &Vec<u32>| target.iter().map(|&v| number[v as usize]).filter(|&n| n != u32::MAX).collect();
        let rest: Vec<Vec<Vec<u32>>> = further.iter().map(|group| group.iter().map(left).collect()).collect();
        order.extend(order_groups(still.len(), &rest).into_iter().map(|n| still[n as usize]));
    }
    order
}

/// User → packed order, from packed → user.
pub(super) fn inverse(order: &[u32]) -> Vec<u32> {
    let mut inverse = vec![0; order.len()];
    order.iter().enumerate().for_each(|(at, &v)| inverse[v as usize] = at as u32);
    inverse
}

fn has(set: &[u64], target: usize) -> bool {
    set[target / 64] >> (target % 64) & 1 != 0
}

/// The target to split `set` by; `None` if the same targets move all its vertices. `of` returns the targets of a vertex
/// as a bit set.
fn split<'a>(set: &[u32], targets: usize, of: impl Fn(u32) -> &'a [u64]) -> Option<usize> {
    if set.len() <= LEAF {
        return None;
    }
    let step = set.len().div_ceil(SAMPLE);
    let sample: Vec<&[u64]> = set.iter().step_by(step).map(|&v| of(v)).collect();
    let n = sample.len() as u32;
    let mut counts = vec![0; targets];
    for set in &sample {
        for (i, &word) in set.iter().enumerate() {
            let mut rest = word;
            while rest != 0 {
                counts[i * 64 + rest.trailing_zeros() as usize] += 1;
                rest &= rest - 1;
            }
        }
    }
    // Targets that split the sample, renumbered.
    let mut mixed: Vec<usize> = (0..targets).filter(|&t| (1..n).contains(&counts[t])).collect();
    if mixed.len() > COMPARED {
        mixed.sort_by_key(|&t| Reverse(counts[t].min(n - counts[t])));
        mixed.truncate(COMPARED);
        mixed.sort_unstable();
    }
    if mixed.is_empty() {
        // A uniform sample does not imply a uniform set.
        let first = of(set[0]);
        let odd = set.iter().map(|&v| of(v)).find(|odd| *odd != first)?;
        return (0..targets).find(|&t| has(first, t) != has(odd, t));
    }
    // The vertices of the sample that each of them moves, as a bit set.
    let mut members = vec![[0u64; SAMPLE / 64]; mixed.len()];
    for (i, set) in sample.into_iter().enumerate() {
        for (members, &target) in members.iter_mut().zip(&mixed) {
            members[i / 64] |= u64::from(has(set, target)) << (i % 64);
        }
    }
    let mut best = 0;
    widest!(_simd => best = least_variance(&members, n));
    Some(mixed[best])
}

/// The target by which to split, so that the remaining variance of membership, summed over targets, is the least.
#[inline(always)]
fn least_variance(members: &[[u64; SAMPLE / 64]], sample: u32) -> usize {
    let words = sample.div_ceil(64) as usize;
    let count = |a: &[u64; SAMPLE / 64], b: &[u64; SAMPLE / 64]| -> f64 {
        let mut count = 0;
        for word in 0..words {
            count += (a[word] & b[word]).count_ones();
        }
        f64::from(count)
    };
    let mut counts = vec![];
    for b in members {
        counts.push(count(b, b));
    }
    let variance = |members: f64, of: f64| if of > 0.0 { members * (of - members) / of } else { 0.0 };
    let mut best = (0, f64::INFINITY);
    for (i, a) in members.iter().enumerate() {
        let outside = f64::from(sample) - counts[i];
        let mut remaining = 0.0;
        for (b, all) in members.iter().zip(&counts) {
            let both = count(a, b);
            remaining += variance(both, counts[i]) + variance(all - both, outside);
        }
        if remaining < best.1 {
            best = (i, remaining);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interleaved_targets_get_blocks_of_their_own_and_the_next_group_orders_the_rest() {
        // Target t moves vertices ≡ t modulo 4: in the user's order every block has all targets.
        let interleaved = |end: u32| -> Vec<Vec<u32>> { (0..4).map(|t| (t..end).step_by(4).collect()).collect() };
        let targets_of = |block: &[u32]| (0..4).filter(|t| block.iter().any(|v| v % 4 == *t)).count();
        let blocks = |order: &[u32]| order.chunks(64).map(targets_of).sum::<usize>();
        assert_eq!(blocks(&order(1024, &interleaved(1024))), 16, "each block has one target");
        let first = interleaved(512);
        let alone = order(1024, &first);
        let both = order_groups(1024, &[first.clone(), interleaved(1024)]);
        assert_eq!((&both[..512], order_groups(1024, std::slice::from_ref(&first))), (&alone[..512], alone.clone()));
        assert_eq!(order_groups(1024, &[first, vec![(0..512).collect()]]), alone);
        assert_eq!(blocks(&both[512..]), 8, "each block has one target");
    }

    /// Number of welded sets that span blocks.
    fn cut(order: &[u32], welds: &[u32], size: usize) -> usize {
        let at = inverse(order);
        let block = |v: u32| at[v as usize] as usize / size;
        let mut places: Vec<u32> = (0..order.len() as u32)
            .filter(|&v| block(v) != block(welds[v as usize]))
            .map(|v| welds[v as usize])
            .collect();
        places.dedup();
        places.len()
    }

    #[test]
    fn welded_vertices_share_a_block() {
        // Every fifth vertex is duplicated at the end of the list, some of them five times.
        let mut welds: Vec<u32> = (0..500).collect();
        welds.extend((0..500).step_by(5));
        welds.extend((0..500).step_by(50).flat_map(|v| [v, v, v]));
        let order: Vec<u32> = (0..welds.len() as u32).rev().collect();
        for size in [32, 64, 128] {
            let kept = keep_welded(order.clone(), &welds, size);
            let mut sorted = kept.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..welds.len() as u32).collect::<Vec<u32>>());
            assert_eq!(cut(&kept, &welds, size), 0, "{size}");
        }
        assert_eq!(keep_welded(order.clone(), &[], 32), order);
        // No set fits the rest of a block, but other sets fill it from the start.
        let sizes = (0..300).map(|place| 5 + place % 3);
        let soup: Vec<u32> =
            sizes.scan(0, |first, n| Some(vec![std::mem::replace(first, *first + n); n as usize])).flatten().collect();
        for size in [32, 64, 128] {
            // The last blocks may stay partial.
            let kept = keep_welded((0..soup.len() as u32).collect(), &soup, size);
            assert!(cut(&kept, &soup, size) <= 1 && inverse(&inverse(&kept)) == kept, "{size}");
        }
        // The limit: sets of three fill no block. Sets at borders are cut (the third is at 96), not lost.
        let threes: Vec<u32> = (0..99).map(|v| v / 3 * 3).collect();
        let kept = keep_welded((0..99).collect(), &threes, 32);
        assert_eq!((cut(&kept, &threes, 32), kept), (2, (0..99).collect::<Vec<u32>>()));
    }

    #[test]
    fn many_targets_take_memory_for_the_most_even_ones() {
        let members: Vec<Vec<u32>> = (0..4000u32)
            .map(|t| (0..500u32).filter(|v| ((v * 7919) ^ (t * 104_729)) % 97 < 30 + t % 9).collect())
            .collect();
        let mut sorted = vec![];
        let used = allocation_counter::measure(|| sorted = order(500, &members));
        sorted.sort_unstable();
        assert_eq!(sorted, (0..500).collect::<Vec<u32>>());
        assert!(used.bytes_max < 4 << 20, "{} bytes", used.bytes_max);
    }
}
