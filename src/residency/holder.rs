//! What a crowd needs of the targets of its mesh: those that its poses hold, and those that weights are requested of.

use super::{Names, Presence, Residents, State};
use crate::error::{Error, Result};
use crate::plan::instances::Instances;
use std::sync::{Arc, MutexGuard};

/// The part of a crowd.
pub(crate) struct Holder {
    residents: Arc<Residents>,
    /// By target: whether poses hold it.
    held: Vec<bool>,
    /// Scratch space: the same after an update.
    applied: Vec<bool>,
}

impl Holder {
    /// Nothing is held.
    pub fn new(residents: &Arc<Residents>) -> Self {
        let none = vec![false; residents.targets.len()];
        Self { residents: residents.clone(), held: none.clone(), applied: none }
    }

    /// Refuse a weight of a target that is not there.
    ///
    /// # Errors
    /// As it says.
    pub fn check_weights(&self, weights: &[f32]) -> Result<()> {
        self.check(&self.residents.state(), weights.iter().map(|weight| *weight != 0.0))
    }

    /// Refuse an update to what is requested where some of its targets, or of those that poses hold, are not there.
    ///
    /// # Errors
    /// As it says.
    pub fn check_update(&self, instances: &Instances) -> Result<()> {
        let state = self.residents.state();
        self.check(&state, self.held.iter().copied())?;
        let mut requested = instances.requested().flatten();
        requested.try_for_each(|weights| self.check(&state, weights.iter().map(|weight| *weight != 0.0)))
    }

    fn check(&self, state: &State, needed: impl Iterator<Item = bool>) -> Result<()> {
        let missing = |(target, needed): &(usize, bool)| *needed && state.presence[*target] != Presence::Resident;
        let Some((target, _)) = needed.enumerate().find(missing) else { return Ok(()) };
        let (why, remedy) = match state.presence[target] {
            Presence::Lost => ("whose copies never ran", "record a swap, be it of nothing: it copies them again"),
            Presence::Away | Presence::Resident => {
                ("which is not on the device", "load it with MorphEngine::record_swap first, or request 0")
            }
        };
        Err(Error::invalid(format!("a weight of {}, {why}", self.residents.name(target)), remedy))
    }

    /// From now on poses hold the targets that `mark` marks.
    pub fn hold(&mut self, mark: impl FnOnce(&mut [bool])) {
        let Self { residents, held, applied } = self;
        applied.fill(false);
        mark(applied);
        let mut state = residents.state();
        for ((holders, held), applied) in state.holders.iter_mut().zip(held).zip(applied) {
            *holders = *holders + u32::from(*applied) - u32::from(*held);
            *held = *applied;
        }
    }

    /// What lists call entries, while this is kept.
    pub fn names(&self) -> EntryNames<'_> {
        EntryNames { residents: &self.residents, state: self.residents.state() }
    }
}

impl Drop for Holder {
    fn drop(&mut self) {
        let mut state = self.residents.state();
        state.holders.iter_mut().zip(&self.held).for_each(|(holders, held)| *holders -= u32::from(*held));
    }
}

/// What lists call entries; no target comes or goes meanwhile.
pub(crate) struct EntryNames<'a> {
    residents: &'a Residents,
    state: MutexGuard<'a, State>,
}

impl EntryNames<'_> {
    /// Those of a group.
    pub fn of(&self, group: usize) -> Names<'_> {
        self.residents.names(&self.state, group)
    }
}
