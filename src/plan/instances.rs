//! The instances of a crowd: which there are, which are shown, and the weights requested of them.

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

/// Places for instances, each with weights.
#[derive(Clone, Debug)]
pub(crate) struct Instances {
    presence: Vec<Presence>,
    weights: Vec<Vec<f32>>,
}

impl Instances {
    /// `places` instances, all shown, all weights 0.
    pub fn new(places: usize, targets: usize) -> Self {
        Self { presence: vec![Presence::Shown; places], weights: vec![vec![0.0; targets]; places] }
    }

    /// The place of `instance`.
    ///
    /// # Errors
    /// An instance out of range, or one that was removed.
    pub fn check(&self, instance: u32) -> Result<usize> {
        let i = instance as usize;
        match self.presence.get(i) {
            Some(Presence::Shown | Presence::Hidden) => Ok(i),
            Some(Presence::Free) => {
                Err(Error::invalid(format!("instance {instance} was removed"), "use the number that `add` returns"))
            }
            None => Err(Error::invalid(
                format!("instance {instance} of a crowd of {}", self.presence.len()),
                "count instances from 0",
            )),
        }
    }

    /// Request `weights` of `instance`, which were checked.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        let i = self.check(instance)?;
        self.weights[i].copy_from_slice(weights);
        Ok(())
    }

    /// Show or hide; tells whether that changed.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<bool> {
        let i = self.check(instance)?;
        let new = if hidden { Presence::Hidden } else { Presence::Shown };
        Ok(std::mem::replace(&mut self.presence[i], new) != new)
    }

    /// Take the first free place: shown, all weights 0.
    ///
    /// # Errors
    /// No free place.
    pub fn add(&mut self) -> Result<u32> {
        let Some(i) = self.presence.iter().position(|p| *p == Presence::Free) else {
            let text = format!("the crowd has places for {} heads, all taken", self.presence.len());
            return Err(Error::invalid(text, "remove one, or make another crowd of the same mesh"));
        };
        self.presence[i] = Presence::Shown;
        self.weights[i].fill(0.0);
        Ok(i as u32)
    }

    /// Free the place of `instance`.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        let i = self.check(instance)?;
        self.presence[i] = Presence::Free;
        Ok(())
    }

    /// For each place, the weights requested; `None` where nothing is to be updated.
    pub fn requested(&self) -> impl Iterator<Item = Option<&[f32]>> {
        self.presence.iter().zip(&self.weights).map(|(p, w)| (*p == Presence::Shown).then_some(&w[..]))
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
