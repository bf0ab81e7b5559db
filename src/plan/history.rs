//! Which slots hold the poses of an instance: the same for all techniques whose updates rotate slots.

/// The slots of an instance. An update reads the current one and writes the next.
#[derive(Clone, Copy, Debug)]
pub struct History {
    slots: u32,
    /// The slot written last, whether its pose is known or not.
    current: u32,
    previous: Option<u32>,
    /// The update that wrote the current slot, counted from 1; 0: its pose is not known.
    written_by: u64,
    cut: bool,
}

impl History {
    /// No slot is written yet.
    pub fn new(slots: u32) -> Self {
        Self { slots, current: slots - 1, previous: None, written_by: 0, cut: false }
    }

    /// The slot of the pose; `None` before the first update, and after one that was discarded.
    pub fn current(&self) -> Option<u32> {
        (self.written_by > 0).then_some(self.current)
    }

    /// The slot so many places after the one that was written last.
    pub fn after(&self, places: u32) -> u32 {
        (self.current + places) % self.slots
    }

    /// Slots of the pose and of the previous pose; `None` while there is no pose. The previous pose is the pose itself
    /// where nothing changed, where it is the first, and after a cut; `None` where the update overwrote it.
    pub fn slots(&self) -> Option<(u32, Option<u32>)> {
        self.current().map(|current| (current, self.previous))
    }

    /// An update changes nothing.
    pub fn stay(&mut self) {
        (self.previous, self.cut) = (Some(self.current), false);
    }

    /// The update numbered `update` (ascending, from 1) writes these slots, the pose into the last of them.
    pub fn advance(&mut self, update: u64, written: impl IntoIterator<Item = u32>) {
        let (known, cut) = (self.current(), std::mem::take(&mut self.cut));
        let mut overwritten = false;
        for slot in written {
            overwritten |= known == Some(slot);
            self.current = slot;
        }
        self.written_by = update;
        self.previous = match known {
            Some(before) if !cut => (!overwritten).then_some(before),
            Some(_) | None => Some(self.current),
        };
    }

    /// The next pose has no predecessor (the instance was hidden, or teleported): its previous pose is itself.
    pub fn cut(&mut self) {
        self.cut = true;
    }

    /// The update numbered `first` and all later ones will never run: what they wrote is not known.
    pub fn discard_from(&mut self, first: u64) {
        if self.written_by >= first {
            self.written_by = 0;
        }
    }
}
