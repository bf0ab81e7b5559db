//! Crowds of several meshes with a common weight vector.

use super::base::{AnyCrowd, Ticket, Update};
use super::crowd::Crowd;
use crate::error::{Error, Result};
use crate::weights::names::unknown;

/// Crowds of several meshes (face, teeth, lashes, tongue) whose instances share one weight vector: a weight applies to
/// the targets of its name in every mesh. Instance i of the set is instance i of each crowd.
///
/// One call records the updates of all, with shared barriers:
/// [`record_updates`](super::MorphEngine::record_updates) of [`crowds_mut`](Self::crowds_mut). Poses are those of the
/// [`crowds`](Self::crowds), of which each may be skinned by itself ([`crowd_mut`](Self::crowd_mut)).
pub struct CrowdSet {
    crowds: Vec<Crowd>,
    names: Vec<String>,
    /// By crowd: pairs of weight and target.
    driven: Vec<Vec<(usize, usize)>>,
    /// Scratch memory: the weights of an instance in each crowd.
    weights: Vec<Vec<f32>>,
}

impl CrowdSet {
    /// A set of these crowds. Its weights are initially those of all targets: each name once, in the order of crowds
    /// and their targets.
    ///
    /// # Errors
    /// No crowd; crowds with different instances.
    pub fn new(crowds: Vec<Crowd>) -> Result<Self> {
        let instances = |crowd: &Crowd| {
            let present = |instance: &u32| crowd.instances.check(*instance).is_ok();
            (crowd.desc().instances, (0..crowd.desc().instances).filter(present).collect::<Vec<_>>())
        };
        let Some(first) = crowds.first().map(instances) else {
            return Err(Error::invalid("a set of no crowd", "pass one or more"));
        };
        if let Some(other) = crowds.iter().map(instances).find(|other| *other != first) {
            let text =
                format!("a set of crowds of {} and {} instances, {:?} and {:?}", first.0, other.0, first.1, other.1);
            return Err(Error::invalid(text, "make all with the same number of instances, and remove none before"));
        }
        let mut names: Vec<String> = vec![];
        for target in crowds.iter().flat_map(|crowd| &crowd.layout().targets) {
            if !names.contains(&target.name) {
                names.push(target.name.clone());
            }
        }
        let weights = vec![vec![]; crowds.len()];
        let mut set = Self { crowds, names: vec![], driven: vec![], weights };
        set.bind(&names)?;
        Ok(set)
    }

    /// Sets the names of the weights, in order, such as those of a clip or a tracker. Other targets keep the weights
    /// requested last.
    ///
    /// # Errors
    /// A name that no mesh has (the message suggests the closest one); a duplicate name. Nothing changes then.
    pub fn bind(&mut self, names: &[impl AsRef<str>]) -> Result<()> {
        let names: Vec<String> = names.iter().map(|name| name.as_ref().to_owned()).collect();
        if let Some(name) = names.iter().enumerate().find_map(|(i, name)| names[..i].contains(name).then_some(name)) {
            return Err(Error::invalid(format!("two weights are called '{name}'"), "name each once"));
        }
        let layouts = || self.crowds.iter().map(Crowd::layout);
        let targets: Vec<&str> = layouts().flat_map(|layout| &layout.targets).map(|target| &*target.name).collect();
        if let Some(name) = names.iter().find(|name| !targets.contains(&name.as_str())) {
            return Err(unknown(
                format!("no mesh of the set has a target '{name}'"),
                name,
                "target of the mesh",
                &targets,
            ));
        }
        let weight_of = |target: &str| names.iter().position(|name| name == target);
        let of_crowd = |layout: &crate::pack::PackedLayout| {
            let targets = layout.targets.iter().enumerate();
            targets.filter_map(|(i, target)| Some((weight_of(&target.name)?, i))).collect()
        };
        self.driven = layouts().map(of_crowd).collect();
        self.names = names;
        Ok(())
    }

    /// The names of the weights, in order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The crowds, in the order of [`new`](Self::new).
    pub fn crowds(&self) -> &[Crowd] {
        &self.crowds
    }

    /// The crowds, to record their updates with one call of [`record_updates`](super::MorphEngine::record_updates),
    /// possibly among others.
    pub fn crowds_mut(&mut self) -> Vec<&mut dyn AnyCrowd> {
        self.crowds.iter_mut().map(|crowd| crowd as &mut dyn AnyCrowd).collect()
    }

    /// A crowd, counted in the order in which they were handed in, to set what follows its poses: skinned
    /// ([`set_skin_target`](super::MorphEngine::set_skin_target)), decoded, with normals of their surface.
    /// `None`: there is no such crowd.
    pub fn crowd_mut(&mut self, index: usize) -> Option<&mut dyn AnyCrowd> {
        // Not as a `Crowd`, which the caller could replace with one of another mesh or other instances.
        self.crowds.get_mut(index).map(|crowd| crowd as &mut dyn AnyCrowd)
    }

    /// Sets the requested weights of an instance in all crowds, one per name of [`names`](Self::names), from the next
    /// recorded updates on.
    ///
    /// # Errors
    /// A wrong number of weights, and the errors of [`Crowd::set_weights`]. Nothing changes then, in any crowd.
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        if weights.len() != self.names.len() {
            let text = format!("{} weights given, but the set has {} names", weights.len(), self.names.len());
            return Err(Error::invalid(text, "pass one weight for each name, in their order"));
        }
        for ((crowd, driven), out) in self.crowds.iter().zip(&self.driven).zip(&mut self.weights) {
            out.clear();
            out.extend_from_slice(crowd.weights(instance)?);
            driven.iter().for_each(|&(weight, target)| out[target] = weights[weight]);
            crowd.check_weights(instance, out)?;
        }
        self.crowds.iter_mut().zip(&self.weights).try_for_each(|(crowd, weights)| crowd.set_weights(instance, weights))
    }

    /// See [`Crowd::cut`].
    ///
    /// # Errors
    /// The same.
    pub fn cut(&mut self, instance: u32) -> Result<()> {
        self.crowds.iter_mut().try_for_each(|crowd| crowd.cut(instance))
    }

    /// Sets new joints of a skinned instance of the crowd at `index`; see [`Crowd::set_joints`].
    ///
    /// # Errors
    /// No such crowd, and the errors of [`Crowd::set_joints`].
    pub fn set_joints(&mut self, index: usize, instance: u32, offset: u64) -> Result<()> {
        let count = self.crowds.len();
        let crowd = self.crowds.get_mut(index).ok_or_else(|| {
            Error::invalid(format!("crowd {index} of a set of {count}"), "count crowds from 0, as they were handed in")
        })?;
        crowd.set_joints(instance, offset)
    }

    /// See [`Crowd::set_hidden`].
    ///
    /// # Errors
    /// The same.
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        self.crowds.iter_mut().try_for_each(|crowd| crowd.set_hidden(instance, hidden))
    }

    /// See [`Crowd::add`].
    ///
    /// # Errors
    /// The same.
    pub fn add(&mut self) -> Result<u32> {
        // All crowds have the same free places.
        self.crowds.iter_mut().map(Crowd::add).try_fold(0, |_, added| added)
    }

    /// See [`Crowd::remove`].
    ///
    /// # Errors
    /// The same.
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.crowds.iter_mut().try_for_each(|crowd| crowd.remove(instance))
    }

    /// Discards `updates`, returned by one call of [`record_updates`](super::MorphEngine::record_updates) for
    /// [`crowds_mut`](Self::crowds_mut) in order, and all later ones; see [`Crowd::discard`].
    ///
    /// # Errors
    /// Updates of other crowds. Nothing is discarded then.
    pub fn discard(&mut self, updates: &[Update]) -> Result<()> {
        let tickets: Vec<Ticket> = updates.iter().map(|update| update.ticket).collect();
        if tickets.len() != self.crowds.len() {
            let text = format!("{} updates of a set of {} crowds", tickets.len(), self.crowds.len());
            return Err(Error::invalid(text, "pass the updates that record_updates returned for the set"));
        }
        let mut of = self.crowds.iter().zip(&tickets);
        of.try_for_each(|(crowd, ticket)| crowd.is_discarded(*ticket).map(drop))?;
        self.crowds.iter_mut().zip(tickets).try_for_each(|(crowd, ticket)| crowd.discard(ticket))
    }
}
