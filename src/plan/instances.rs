//! The instances of a crowd: which there are, which are shown, the weights requested of them, and where their poses are.

use super::history::History;
use crate::error::{Error, Result};
use crate::pack::PackedLayout;
use crate::pack::blocks::ExactGrid;
use crate::weights::delta;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Presence {
    Shown,
    Hidden,
    /// Not part of the crowd: its place is free.
    Free,
}

/// A place for an instance.
#[derive(Clone, Debug)]
struct Place {
    presence: Presence,
    weights: Vec<f32>,
    history: History,
}

/// Places for instances.
#[derive(Clone, Debug)]
pub struct Instances {
    places: Vec<Place>,
}

impl Instances {
    /// `places` instances with so many slots, all shown, all weights 0.
    pub fn new(places: usize, targets: usize, slots: u32) -> Self {
        let place = Place { presence: Presence::Shown, weights: vec![0.0; targets], history: History::new(slots) };
        Self { places: vec![place; places] }
    }

    fn place(&mut self, instance: u32) -> Result<&mut Place> {
        let i = self.check(instance)?;
        Ok(&mut self.places[i])
    }

    /// The place of `instance`.
    ///
    /// # Errors
    /// An instance out of range, or one that was removed.
    pub fn check(&self, instance: u32) -> Result<usize> {
        match self.places.get(instance as usize).map(|place| place.presence) {
            Some(Presence::Shown | Presence::Hidden) => Ok(instance as usize),
            Some(Presence::Free) => {
                Err(Error::invalid(format!("instance {instance} was removed"), "use the number that `add` returns"))
            }
            None => Err(Error::invalid(
                format!("instance {instance} of a crowd of {}", self.places.len()),
                "count instances from 0",
            )),
        }
    }

    /// Request `weights` of `instance`, which were checked.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        self.place(instance)?.weights.copy_from_slice(weights);
        Ok(())
    }

    /// The next pose of `instance` has no predecessor.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn cut(&mut self, instance: u32) -> Result<()> {
        self.place(instance)?.history.cut();
        Ok(())
    }

    /// Show or hide: the next pose has no predecessor. Tells whether that changed.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<bool> {
        let place = self.place(instance)?;
        let new = if hidden { Presence::Hidden } else { Presence::Shown };
        let changed = std::mem::replace(&mut place.presence, new) != new;
        if changed {
            place.history.cut();
        }
        Ok(changed)
    }

    /// Take the first free place: shown, all weights 0, without a pose.
    ///
    /// # Errors
    /// No free place.
    pub fn add(&mut self) -> Result<u32> {
        let Some(i) = self.places.iter().position(|place| place.presence == Presence::Free) else {
            let text = format!("the crowd has places for {} heads, all taken", self.places.len());
            return Err(Error::invalid(text, "remove one, or make another crowd of the same mesh"));
        };
        let place = &mut self.places[i];
        place.presence = Presence::Shown;
        place.weights.fill(0.0);
        place.history.discard_from(0);
        Ok(i as u32)
    }

    /// Free the place of `instance`.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.place(instance)?.presence = Presence::Free;
        Ok(())
    }

    /// The update numbered `first` and all later ones will never run.
    pub fn discard_from(&mut self, first: u64) {
        self.places.iter_mut().for_each(|place| place.history.discard_from(first));
    }

    /// Slots of the pose and of the previous pose of a place; `None` while it has no pose.
    pub fn slots_of(&self, place: usize) -> Option<(u32, Option<u32>)> {
        self.places[place].history.slots()
    }

    /// For each place, the weights requested; `None` where nothing is to be updated.
    pub fn requested(&self) -> impl Iterator<Item = Option<&[f32]>> {
        self.places.iter().map(|place| (place.presence == Presence::Shown).then_some(&place.weights[..]))
    }

    /// What is to be updated: each place that is shown, the weights requested, and its slots.
    pub fn shown(&mut self) -> impl Iterator<Item = (usize, &[f32], &mut History)> {
        let shown = self.places.iter_mut().enumerate().filter(|(_, place)| place.presence == Presence::Shown);
        shown.map(|(i, place)| (i, &place.weights[..], &mut place.history))
    }
}

/// Check weights for a mesh: as [`delta::check_weights`], and within the grid of exact sums.
///
/// # Errors
/// A wrong number of weights, or one that is out of range; the message names it.
pub(crate) fn check_weights(weights: &[f32], layout: &PackedLayout, exact: Option<ExactGrid>) -> Result<()> {
    let name = |i: usize| layout.targets.get(i).map(|t| t.name.as_str());
    delta::check_weights(weights, name, layout.targets.len())?;
    let most = exact.map_or(delta::WEIGHT_MAX, |grid| grid.weight_max);
    match weights.iter().position(|w| w.abs() > most) {
        None => Ok(()),
        Some(i) => Err(Error::invalid(
            format!("the weight of target {i} ('{}') is {}", name(i).unwrap_or("?"), weights[i]),
            format!("exact sums of this mesh stand weights from -{most} to {most}: pack with a larger weight_max"),
        )),
    }
}
