//! Sets of pieces: runs of vertices of a mesh that a step writes together, one bit each.

use std::ops::Range;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Pieces {
    count: u32,
    bits: Vec<u64>,
}

impl Pieces {
    /// The empty set over `count` pieces.
    pub(super) fn none(count: u32) -> Self {
        Self { count, bits: vec![0; count.div_ceil(64) as usize] }
    }

    /// Number of pieces of the mesh.
    pub(super) fn count(&self) -> u32 {
        self.count
    }

    /// Number of pieces in the set.
    pub(super) fn len(&self) -> u32 {
        self.bits.iter().map(|bits| bits.count_ones()).sum()
    }

    pub(super) fn clear(&mut self) {
        self.bits.fill(0);
    }

    /// Adds a range of pieces, clamped to existing ones.
    pub(super) fn add(&mut self, pieces: Range<u32>) {
        (pieces.start..pieces.end.min(self.count))
            .for_each(|piece| self.bits[piece as usize / 64] |= 1 << (piece % 64));
    }

    /// Adds a set over the same mesh.
    pub(super) fn add_all(&mut self, others: &Self) {
        self.bits.iter_mut().zip(&others.bits).for_each(|(bits, others)| *bits |= others);
    }

    /// The pieces in ascending order.
    pub(super) fn iter(&self) -> impl Iterator<Item = u32> {
        (0..).step_by(64).zip(&self.bits).flat_map(|(first, bits)| {
            let rest = std::iter::successors(Some(*bits), |bits| Some(bits & bits.wrapping_sub(1)));
            rest.take_while(|bits| *bits != 0).map(move |bits| first + bits.trailing_zeros())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_those_added_ascending_and_no_others() {
        let mut pieces = Pieces::none(130);
        [5..7, 63..65, 6..6, 128..400].into_iter().for_each(|range| pieces.add(range));
        assert_eq!(pieces.iter().collect::<Vec<_>>(), [5, 6, 63, 64, 128, 129]);
        let mut others = Pieces::none(130);
        others.add(0..6);
        others.add_all(&pieces);
        assert_eq!((others.len(), others.iter().count()), (11, 11));
        others.clear();
        assert_eq!(others, Pieces::none(130));
    }
}
