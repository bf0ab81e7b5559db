//! Builds a [`BlockIndex`] from the packer's or a file's data: checks it, and derives the tables of planning.

use super::{BLOCK_SIZES, BlockIndex, EntryCost, Incidence, Parts};
use crate::asset::streams::{Measure, StreamPlace, TRIPLE, TRIPLES};
use crate::error::ensure;
use crate::math::is_power_of_two;
use crate::pack::formats::BlockFormat;
use crate::pack::grid::{Reached, Sums};
use crate::pack::{POSE_FLOATS, VERTEX_PADDING};

/// Most words of a mesh: byte offsets have 32 bits.
pub(super) const WORDS_MAX: u64 = u32::MAX as u64 / 4;

impl BlockIndex {
    /// Checks `parts` against words and base pose, and derives the tables of planning and the bounds on integer sums;
    /// both without what depends on the base pose ([`PackedLayout::take_base`](crate::PackedLayout)).
    pub(crate) fn new(
        parts: Parts,
        targets: usize,
        streams: &[StreamPlace],
        words: &[u32],
        base: &[f32],
    ) -> Result<(Self, Sums), String> {
        let entries = parts.entry_target.len();
        let blocks = parts.first_entry.len().saturating_sub(1);
        let format = parts.format.block_format().ok_or("a dense format")?;
        let headers = entries.saturating_mul(format.header_words());
        let reached = vec![Reached::default(); blocks];
        let mut sums = Sums::new(parts.format, parts.steps, streams, reached, parts.weight_max);
        let lengths = streams.iter().find(|s| s.semantic.measure() == Measure::Length);
        let mut index = Self {
            parts,
            deltas_at: headers.next_multiple_of(4),
            words: words.len(),
            lengths: lengths.map_or(0..0, StreamPlace::components),
            costs: vec![],
            first_incidence: vec![],
            incidence: vec![],
            block_base: vec![0.0; blocks],
            block_reach: vec![0.0; blocks],
        };
        index.check(format, targets, words, base)?;
        index.derive(format, targets, words, &mut sums)?;
        Ok((index, sums))
    }

    /// Updates what depends on the base pose: bounds on drift.
    pub(crate) fn take_base(&mut self, base: &[f32]) {
        let size = self.size();
        for (largest, vertices) in self.block_base.iter_mut().zip(base.chunks_exact(size * POSE_FLOATS)) {
            let positions = vertices.chunks_exact(POSE_FLOATS).flat_map(|v| &v[self.lengths.clone()]);
            *largest = positions.fold(0.0, |m: f32, p| m.max(p.abs()));
        }
    }

    fn check(&self, format: &dyn BlockFormat, targets: usize, words: &[u32], base: &[f32]) -> Result<(), String> {
        let Parts { order, steps, weight_max, first_entry, entry_target, .. } = &self.parts;
        let size = self.size();
        let entries = entry_target.len();
        ensure!(BLOCK_SIZES.contains(&self.parts.size), format!("a block size of {size}"));
        // Powers of two: integers and sums decode exactly, and both steps of a target differ by a shift.
        for step in steps {
            ensure!(is_power_of_two(*step), format!("a step of {step}, which is no power of two"));
        }
        ensure!(weight_max.is_finite() && *weight_max > 0.0, format!("weights up to {weight_max}"));
        // Kernels count words in 32 bits, and on some devices bytes.
        let count = words.len();
        ensure!(count as u64 <= WORDS_MAX, format!("{count} words; the kernels reach {WORDS_MAX}"));
        let padded = order.len().next_multiple_of(size.max(VERTEX_PADDING));
        let fits = base.len() == padded * POSE_FLOATS && first_entry.len() == padded / size + 1;
        ensure!(fits, format!("{} vertices, but {} blocks", order.len(), first_entry.len() as i64 - 1));
        for (i, number) in base.iter().enumerate() {
            let what = || format!("the base pose of packed vertex {} is {number}", i / POSE_FLOATS);
            ensure!(number.is_finite(), what());
        }
        let mut unseen = vec![true; order.len()];
        for &v in order.iter() {
            let is_new = unseen.get_mut(v as usize).is_some_and(std::mem::take);
            ensure!(is_new, format!("vertex {v} comes twice in the order, or is not there"));
        }
        let ends = (first_entry.first(), first_entry.last());
        let covers = ends == (Some(&0), Some(&(entries as u32))) && first_entry.is_sorted();
        ensure!(covers, "the entries of blocks overlap or leave gaps".into());
        for block in 0..self.count() {
            let listed = &entry_target[self.entries(block)];
            let fits = listed.is_sorted_by(|a, b| a < b) && listed.last().is_none_or(|&t| (t as usize) < targets);
            ensure!(fits, format!("the targets of block {block} are not ascending, or out of range"));
        }
        // Headers must exist before they are read.
        ensure!(self.deltas_at <= count, format!("{count} words, fewer than the headers of {entries} entries"));
        // Entries are contiguous, and the last one ends at the end.
        let mut at = self.deltas_at;
        for entry in 0..entries {
            let (header, deltas) = self.locate(format, words, entry);
            // Integers must fit their decoded type whatever the deltas are. Lengths are bounded by their sum over a
            // block.
            let bits = format.check_header(header).map_err(|what| format!("entry {entry} has {what}"))?;
            for triple in (0..TRIPLES).filter(|triple| !self.lengths.contains(&(triple * TRIPLE))) {
                let largest = f64::from(steps[triple]) * f64::from(bits[triple]).exp2();
                let fits = largest <= f64::from(f32::MAX);
                ensure!(fits, format!("entry {entry} has numbers up to {largest:e} in triple {triple}"));
            }
            ensure!(deltas.start == at, format!("the deltas of entry {entry} are not where they belong"));
            at = deltas.end;
        }
        ensure!(at == count, format!("{count} words where the entries take {at}"));
        Ok(())
    }

    fn derive(
        &mut self,
        format: &dyn BlockFormat,
        targets: usize,
        words: &[u32],
        of_mesh: &mut Sums,
    ) -> Result<(), String> {
        let lengths = self.lengths.clone();
        let size = self.size();
        let mut costs = Vec::with_capacity(self.entry_count());
        // Σ|delta|: multiples of a step that fit 53 bits.
        let mut sums = vec![[0.0f64; POSE_FLOATS]; size];
        for block in 0..self.count() {
            sums.fill([0.0; POSE_FLOATS]);
            for entry in self.entries(block) {
                let mut reach = 0.0f64;
                let mut lanes = [u8::MAX, 0];
                let mut moved = [false; TRIPLES];
                self.for_each_lane(words, entry, &mut |lane, delta| {
                    sums[lane].iter_mut().zip(delta).for_each(|(sum, value)| *sum += value.abs());
                    if delta != [0.0; POSE_FLOATS] {
                        let first = lane as u8 & !7;
                        lanes = [lanes[0].min(first), first + 8];
                        delta.iter().enumerate().for_each(|(c, value)| moved[c / TRIPLE] |= *value != 0.0);
                    }
                    reach = reach.max(delta[lengths.clone()].iter().map(|d| d * d).sum::<f64>());
                });
                // Rounded up, since bounds are computed from it.
                let reach = if lengths.is_empty() { 0.0 } else { (reach.sqrt() as f32).next_up() };
                let (header, deltas) = self.locate(format, words, entry);
                // Kernels shift by a number that only sums limit: nothing limits that of zeros.
                let fits = format.shifts(header).into_iter().zip(moved).all(|(shift, moved)| moved || shift == 0);
                ensure!(fits, format!("entry {entry} shifts numbers that are all 0"));
                let bytes = 4 * (header.len() + deltas.len()) as u32;
                costs.push(EntryCost { bytes, reach, lanes });
                self.block_reach[block] += reach;
            }
            for sums in &sums {
                for (c, largest) in of_mesh.reached[block].sums.iter_mut().enumerate() {
                    *largest = largest.max(sums[c] / f64::from(self.parts.steps[c / TRIPLE]));
                }
            }
            let fits = (self.block_base[block] + self.block_reach[block]).is_finite();
            ensure!(fits, format!("the deltas of block {block} are too large for single precision"));
            // Vertices beyond the mesh's last one must not move.
            let live = self.parts.order.len().saturating_sub(block * size).min(size);
            let stay = sums[live..].iter().all(|sums| *sums == [0.0; POSE_FLOATS]);
            ensure!(stay, format!("block {block} moves vertices that the mesh does not have"));
        }
        self.costs = costs;
        // By target; blocks stay ascending, since entries are in block order.
        let target_of = |incidence: &Incidence| self.parts.entry_target[incidence.entry as usize];
        let in_block = |block| self.entries(block).map(move |e| Incidence { block: block as u32, entry: e as u32 });
        let mut incidence: Vec<Incidence> = (0..self.count()).flat_map(in_block).collect();
        incidence.sort_by_key(target_of);
        let first = |target| incidence.partition_point(|one| (target_of(one) as usize) < target) as u32;
        self.first_incidence = (0..=targets).map(first).collect();
        self.incidence = incidence;
        of_mesh.targets = (0..self.count()).map(|block| self.entries(block).len()).max().unwrap_or(0);
        Ok(())
    }
}
