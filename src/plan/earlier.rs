//! What discarded updates give back.

/// The values that something had before each of the updates that changed it last, as far back as updates may be
/// discarded.
#[derive(Clone, Debug)]
pub struct Earlier<T> {
    /// Updates that may be unfinished at once: older ones have run, and are never discarded.
    most: usize,
    /// Ascending by update.
    values: Vec<(u64, T)>,
}

impl<T: Copy> Earlier<T> {
    /// Of so many updates, one at least.
    pub fn new(most: u32) -> Self {
        Self { most: most.max(1) as usize, values: vec![] }
    }

    /// The update numbered `update` (ascending) changes it from `value`.
    pub fn push(&mut self, update: u64, value: T) {
        if self.values.len() == self.most {
            self.values.remove(0);
        }
        self.values.push((update, value));
    }

    /// The update numbered `first` and all later ones will never run: what there was before those that changed it.
    pub fn discard_from(&mut self, first: u64) -> Option<T> {
        let at = self.values.partition_point(|(update, _)| *update < first);
        let before = self.values.get(at).map(|(_, value)| *value);
        self.values.truncate(at);
        before
    }
}
