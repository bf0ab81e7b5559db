//! Memory of a fixed size that entries come to and go from. What is free in all is enough: where no hole is large
//! enough, entries move together.

use std::collections::{BTreeMap, BTreeSet};

/// An entry: the group of the mesh, and its number there.
pub(crate) type Key = (u32, u32);

/// Where entries lie, in words. Those of no words have no place.
#[derive(Clone, Debug)]
pub(crate) struct Space {
    /// By first word: words, and whose they are.
    used: BTreeMap<u32, (u32, Key)>,
    /// Words of the holes between, by first word.
    holes: BTreeMap<u32, u32>,
    /// The holes by size: words, first word.
    sizes: BTreeSet<(u32, u32)>,
    free: u32,
}

impl Space {
    /// So many words, all free.
    pub fn new(words: u32) -> Self {
        let mut space = Self { used: BTreeMap::new(), holes: BTreeMap::new(), sizes: BTreeSet::new(), free: words };
        space.add_hole(0, words);
        space
    }

    /// Words that are free.
    pub fn free(&self) -> u32 {
        self.free
    }

    /// Free what begins at a word.
    pub fn remove(&mut self, at: u32) {
        let Some((words, _)) = self.used.remove(&at) else { return };
        self.free += words;
        let (mut first, mut end) = (at, at + words);
        if let Some((&before, &words)) =
            self.holes.range(..at).next_back().filter(|(before, words)| *before + *words == at)
        {
            self.remove_hole(before, words);
            first = before;
        }
        if let Some(&words) = self.holes.get(&end) {
            self.remove_hole(end, words);
            end += words;
        }
        self.add_hole(first, end - first);
    }

    /// Find places for entries of so many words each, which take no more than is free in all: `placed` is told each,
    /// and those of others that move. An entry may be told several times: the last place counts.
    pub fn place(&mut self, mut entries: Vec<(u32, Key)>, mut placed: impl FnMut(Key, u32)) {
        // The largest first: small ones fit what they leave.
        entries.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        debug_assert!(entries.iter().map(|(words, _)| words).sum::<u32>() <= self.free, "callers make sure");
        for (words, key) in entries.into_iter().filter(|(words, _)| *words > 0) {
            if self.smallest_hole(words).is_none() {
                self.compact(words, &mut placed);
            }
            let Some((hole, at)) = self.smallest_hole(words) else { return };
            self.remove_hole(at, hole);
            self.add_hole(at + words, hole - words);
            self.used.insert(at, (words, key));
            self.free -= words;
            placed(key, at);
        }
    }

    /// The smallest hole of at least so many words.
    fn smallest_hole(&self, words: u32) -> Option<(u32, u32)> {
        self.sizes.range((words, 0)..).next().copied()
    }

    /// Make one hole of at least `need` words of neighbouring ones, where that moves the fewest words.
    fn compact(&mut self, need: u32, placed: &mut impl FnMut(Key, u32)) {
        let holes: Vec<(u32, u32)> = self.holes.iter().map(|(at, words)| (*at, *words)).collect();
        let (mut best, mut first, mut sum) = (None, 0, 0);
        for (at, words) in &holes {
            sum += words;
            while sum - holes[first].1 >= need {
                sum -= holes[first].1;
                first += 1;
            }
            let range = holes[first].0..at + words;
            let moved = range.end - range.start - sum;
            if sum >= need && best.as_ref().is_none_or(|(least, _)| moved < *least) {
                best = Some((moved, range));
            }
        }
        let Some((_, range)) = best else { return };
        for (at, words) in holes.into_iter().filter(|(at, _)| range.contains(at)) {
            self.remove_hole(at, words);
        }
        let entries: Vec<(u32, (u32, Key))> = self.used.range(range.clone()).map(|(at, entry)| (*at, *entry)).collect();
        let mut end = range.start;
        for (at, (words, key)) in entries {
            // Ascending, and each moves down: no place is taken that is not free by then.
            self.used.remove(&at);
            self.used.insert(end, (words, key));
            placed(key, end);
            end += words;
        }
        self.add_hole(end, range.end - end);
    }

    fn add_hole(&mut self, at: u32, words: u32) {
        if words > 0 {
            self.holes.insert(at, words);
            self.sizes.insert((words, at));
        }
    }

    fn remove_hole(&mut self, at: u32, words: u32) {
        self.holes.remove(&at);
        self.sizes.remove(&(words, at));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        /// Whatever came and went: what is free in all is enough, nothing overlaps, and every move is told.
        #[test]
        fn what_is_free_in_all_is_enough(
            words in 1u32..400,
            swaps in prop::collection::vec((prop::collection::vec(0u32..60, 0..9), any::<u64>()), 1..60),
        ) {
            let (mut space, mut places) = (Space::new(words), HashMap::<Key, (u32, u32)>::new());
            for (swap, (sizes, pick)) in (0..).zip(swaps) {
                let gone: Vec<Key> =
                    places.keys().copied().filter(|(s, e)| pick.rotate_left(7 * s + 11 * e) & 3 == 0).collect();
                for key in gone {
                    if let Some((at, 1..)) = places.remove(&key) { space.remove(at) }
                }
                let mut rest = space.free();
                let fits = |size: &u32| { let fits = *size <= rest; if fits { rest -= size } fits };
                let fitting: Vec<u32> = sizes.into_iter().filter(fits).collect();
                let entries: Vec<(u32, Key)> = (0..).zip(fitting).map(|(i, size)| (size, (swap, i))).collect();
                places.extend(entries.iter().map(|(size, key)| (*key, (u32::MAX, *size))));
                space.place(entries, |key, at| places.get_mut(&key).unwrap().0 = at);
                let mut sorted: Vec<(u32, u32)> = places.values().copied().filter(|(_, size)| *size > 0).collect();
                sorted.sort_unstable();
                prop_assert!(sorted.windows(2).all(|two| two[0].0 + two[0].1 <= two[1].0));
                prop_assert!(sorted.last().is_none_or(|(at, size)| at.checked_add(*size).unwrap() <= words));
                prop_assert_eq!(space.free(), words - sorted.iter().map(|(_, size)| size).sum::<u32>());
                // Holes are as large as they could be, and all that is free is in them.
                prop_assert_eq!(space.holes.values().sum::<u32>(), space.free());
                prop_assert!(space.holes.iter().all(|(at, words)| !space.holes.contains_key(&(at + words))));
                prop_assert_eq!(space.holes.len(), space.sizes.len());
            }
        }
    }

    #[test]
    fn compaction_moves_as_few_words_as_it_can() {
        let mut space = Space::new(100);
        space.place((0..10).map(|i| (10, (0, i))).collect(), |_, _| {});
        // Holes of 10 with one entry between two of them, and with three between the other two.
        [0, 40, 60].iter().for_each(|at| space.remove(*at));
        let mut told = vec![];
        space.place(vec![(20, (1, 0))], |key, at| told.push((key, at)));
        assert_eq!(told, [((0, 5), 40), ((1, 0), 50)]);
        assert_eq!(space.free(), 10);
    }
}
