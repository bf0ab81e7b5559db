//! Earlier values, restored when updates are discarded.

/// A value's history: the value before each of the last updates that changed it, as far back as updates can be
/// discarded.
#[derive(Clone, Debug)]
pub struct Earlier<T> {
    /// Updates that may be in flight. Older ones have finished and cannot be discarded.
    most: usize,
    /// (update, value before it), ascending.
    values: Vec<(u64, T)>,
}

impl<T: Copy> Earlier<T> {
    /// Keeps at least one and at most `most` values.
    pub fn new(most: u32) -> Self {
        Self { most: most.max(1) as usize, values: vec![] }
    }

    /// Records that update `update` (ascending) changes the value from `value`.
    pub fn push(&mut self, update: u64, value: T) {
        if self.values.len() == self.most {
            self.values.remove(0);
        }
        self.values.push((update, value));
    }

    /// Drops update `first` and all later ones; returns the value before them, if one of them changed it.
    pub fn discard_from(&mut self, first: u64) -> Option<T> {
        let at = self.values.partition_point(|(update, _)| *update < first);
        let before = self.values.get(at).map(|(_, value)| *value);
        self.values.truncate(at);
        before
    }
}
