//! The instances of a crowd: which there are, which are shown, the weights requested of them, and where their poses
//! are.

use crate::error::{Error, Result};
use crate::pack::PackedLayout;
use crate::pack::blocks::PoseGrid;
use crate::plan::earlier::Earlier;
use crate::weights::delta;
use crate::weights::names::unknown;

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

/// Places for instances. An instance that is out of range, or that was removed, is refused by whatever takes its
/// number.
#[derive(Clone, Debug)]
pub struct Instances {
    places: Vec<Place>,
}

impl Instances {
    /// `places` instances with so many slots, all shown, all weights 0. So many updates may be unfinished at once, and
    /// be discarded.
    pub fn new(places: usize, targets: usize, slots: u32, unfinished: u32) -> Self {
        let history = History::new(slots, unfinished);
        let place = Place { presence: Presence::Shown, weights: vec![0.0; targets], history };
        Self { places: vec![place; places] }
    }

    /// The same instances without poses, in more places, with so many slots and unfinished updates: the new places are
    /// free.
    pub fn grown(&self, places: usize, slots: u32, unfinished: u32) -> Self {
        let history = History::new(slots, unfinished);
        let before = self.places.iter().map(|place| Place { history: history.clone(), ..place.clone() });
        let targets = self.places.first().map_or(0, |place| place.weights.len());
        let free = Place { presence: Presence::Free, weights: vec![0.0; targets], history: history.clone() };
        Self { places: before.chain(std::iter::repeat(free)).take(places).collect() }
    }

    /// The weights requested of each instance, hidden or not.
    pub fn present(&self) -> impl Iterator<Item = &[f32]> {
        self.places.iter().filter(|place| place.presence != Presence::Free).map(|place| &place.weights[..])
    }

    fn place(&mut self, instance: u32) -> Result<&mut Place> {
        let i = self.check(instance)?;
        Ok(&mut self.places[i])
    }

    /// The place of `instance`.
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
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        self.place(instance)?.weights.copy_from_slice(weights);
        Ok(())
    }

    /// The weights requested of `instance`.
    pub fn weights(&self, instance: u32) -> Result<&[f32]> {
        Ok(&self.places[self.check(instance)?].weights)
    }

    /// Request one weight of `instance`, which was checked, and return the one before.
    pub fn set_weight(&mut self, instance: u32, target: usize, weight: f32) -> Result<f32> {
        Ok(std::mem::replace(&mut self.place(instance)?.weights[target], weight))
    }

    /// The next pose of `instance` has no predecessor.
    pub fn cut(&mut self, instance: u32) -> Result<()> {
        self.place(instance)?.history.cut();
        Ok(())
    }

    /// Show or hide: the next pose has no predecessor. Tells whether that changed.
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<bool> {
        let place = self.place(instance)?;
        let new = if hidden { Presence::Hidden } else { Presence::Shown };
        let changed = std::mem::replace(&mut place.presence, new) != new;
        if changed {
            place.history.cut();
        }
        Ok(changed)
    }

    /// Take the first free place, if there is one: shown, all weights 0, without a pose.
    pub fn add(&mut self) -> Result<u32> {
        let Some(i) = self.places.iter().position(|place| place.presence == Presence::Free) else {
            let text = format!("the crowd has places for {} heads, all taken", self.places.len());
            return Err(Error::invalid(text, "remove one, or make another crowd of the same mesh"));
        };
        let place = &mut self.places[i];
        place.presence = Presence::Shown;
        place.weights.fill(0.0);
        place.history.forget();
        Ok(i as u32)
    }

    /// Free the place of `instance`.
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

    /// Whether what is at a place is shown.
    pub fn is_shown(&self, place: usize) -> bool {
        self.places[place].presence == Presence::Shown
    }

    /// The update that wrote the pose of a place; 0: it has none.
    pub fn written_by(&self, place: usize) -> u64 {
        self.places[place].history.written_by
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

/// Which slots hold the poses of an instance, for all techniques whose updates rotate slots: an update reads the
/// current one and writes the next.
#[derive(Clone, Debug)]
pub struct History {
    slots: u32,
    /// The slot written last by an update that was not discarded, whether its pose is known or not.
    current: u32,
    earlier: Earlier<u32>,
    previous: Option<u32>,
    /// The update that wrote the current slot, counted from 1; 0: its pose is not known.
    written_by: u64,
    cut: bool,
    /// The last update after a cut that changed nothing; 0: there was none.
    stayed_after_cut: u64,
}

impl History {
    /// No slot is written yet. So many updates may be unfinished at once, or discarded.
    pub fn new(slots: u32, unfinished: u32) -> Self {
        let (current, earlier) = (slots - 1, Earlier::new(unfinished));
        Self { slots, current, earlier, previous: None, written_by: 0, cut: false, stayed_after_cut: 0 }
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

    /// The update numbered `update` (ascending, from 1) changes nothing.
    pub fn stay(&mut self, update: u64) {
        if std::mem::take(&mut self.cut) {
            self.stayed_after_cut = update;
        }
        self.previous = Some(self.current);
    }

    /// The update numbered `update` writes these slots, the pose into the last of them.
    pub fn advance(&mut self, update: u64, written: impl IntoIterator<Item = u32>) {
        let (known, cut) = (self.current(), std::mem::take(&mut self.cut));
        self.earlier.push(update, self.current);
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

    /// The pose is not known: the next update writes all of it.
    fn forget(&mut self) {
        self.written_by = 0;
    }

    /// The update numbered `first` and all later ones will never run: what they would have written is not known, the
    /// next update writes the slot that the first of them would have written, and the next pose is the one after a cut
    /// that they came after. (A pose that is not known is no predecessor in any case.)
    pub fn discard_from(&mut self, first: u64) {
        if let Some(before) = self.earlier.discard_from(first) {
            self.current = before;
        }
        if self.written_by >= first {
            self.forget();
        }
        if self.stayed_after_cut >= first {
            (self.cut, self.stayed_after_cut) = (true, 0);
        }
    }
}

/// Check weights for a mesh: as [`delta::check_weights`], and within the grid of poses of integers.
///
/// # Errors
/// A wrong number of weights, or one that is out of range; the message names it.
pub(crate) fn check_weights(weights: &[f32], layout: &PackedLayout, grid: Option<PoseGrid>) -> Result<()> {
    delta::check_weights(weights, |i| name(layout, i), layout.targets.len())?;
    weights.iter().enumerate().try_for_each(|(target, &weight)| check_grid(target, weight, layout, grid))
}

/// Check the weight of a target, as [`check_weights`] does.
///
/// # Errors
/// No such target; a weight that is out of range.
pub(crate) fn check_weight(target: usize, weight: f32, layout: &PackedLayout, grid: Option<PoseGrid>) -> Result<()> {
    if target >= layout.targets.len() {
        let text = format!("target {target} of mesh '{}', which has {}", layout.name, layout.targets.len());
        return Err(Error::invalid(text, "count targets from 0"));
    }
    delta::check_weight(target, weight, |i| name(layout, i))?;
    check_grid(target, weight, layout, grid)
}

/// The target called `name`, of several the first.
///
/// # Errors
/// There is none; the message has the one that was probably meant.
pub(crate) fn target_named(name: &str, layout: &PackedLayout) -> Result<usize> {
    layout.target_index(name).ok_or_else(|| {
        let names: Vec<&str> = layout.targets.iter().map(|target| &*target.name).collect();
        unknown(format!("mesh '{}' has no target '{name}'", layout.name), name, "target of the mesh", &names)
    })
}

fn name(layout: &PackedLayout, target: usize) -> Option<&str> {
    layout.targets.get(target).map(|target| target.name.as_str())
}

fn check_grid(target: usize, weight: f32, layout: &PackedLayout, grid: Option<PoseGrid>) -> Result<()> {
    let most = grid.map_or(delta::WEIGHT_MAX, |grid| grid.weight_max);
    if weight.abs() <= most {
        return Ok(());
    }
    Err(Error::invalid(
        format!("the weight of target {target} ('{}') is {weight}", name(layout, target).unwrap_or("?")),
        format!("poses of integers hold weights from -{most} to {most} here: use a larger weight_max"),
    ))
}
