//! Weights of nodes: which targets move together, and clips.
//!
//! In glTF each node that draws a mesh has weights of its own (3.7.4, 3.11). Targets of one name are one target of the
//! mesh that a file becomes, unless nodes have different weights for them.

use super::animation::{Animation, Channel, Interpolation, NEAR};
use super::container::Container;
use super::{Gltf, assemble, mesh};
use crate::error::{Error, Result, ensure};
use crate::import::frame_rate;
use crate::weights::WeightClip;
use std::collections::{HashMap, HashSet};

/// The names of targets that have different weights on nodes.
#[derive(Clone, Debug, Default)]
pub(super) struct OwnNames {
    /// For each node, the one that stands for it: the first of those that draw its mesh with the same weights.
    first: Vec<usize>,
    /// By such a node, and the target's place in its mesh.
    names: HashMap<(usize, usize), String>,
    /// Length of the longest.
    pub longest: usize,
}

impl OwnNames {
    pub fn get(&self, node: usize, target: usize) -> Option<&str> {
        self.names.get(&(*self.first.get(node)?, target)).map(String::as_str)
    }
}

impl Channel {
    /// What tells the weight of one target from others: the only value, or the keys.
    fn key(&self, i: usize) -> Vec<u32> {
        let values: Vec<u32> = self.values.iter().skip(i).step_by(self.width()).map(bits).collect();
        let is_constant = values.iter().all(|value| *value == values[0]);
        if is_constant && self.interpolation != Interpolation::CubicSpline {
            return vec![values[0]];
        }
        let times = self.times.iter().map(bits);
        std::iter::once(self.interpolation as u32).chain(times).chain(values).collect()
    }
}

/// The bits of a number; those of -0 are those of 0.
fn bits(number: &f32) -> u32 {
    (number + 0.0).to_bits()
}

impl Gltf {
    /// The name of a target of a mesh in the mesh that the file becomes, where `node` draws it.
    pub(super) fn target_name(&self, mesh: usize, node: Option<usize>, target: usize) -> &str {
        let own = node.and_then(|node| self.own.get(node, target));
        own.unwrap_or(&self.meshes[mesh].source.targets[target].name)
    }

    /// Iterates over the names of the targets of the mesh that a node draws, as [`clip`](Self::clip) and
    /// [`into_mesh`](Self::into_mesh) call them: those of the mesh or, where nodes in the scene have different weights
    /// for targets of one name, such as `face.smile`, with the name of the node (or of the mesh, if the node has none)
    /// before it.
    #[doc(hidden)]
    pub fn target_names(&self, node: usize) -> impl Iterator<Item = &str> {
        let mesh = self.nodes.get(node).and_then(|stated| stated.mesh);
        let targets = mesh.map_or(0, |mesh| self.meshes[mesh].source.targets.len());
        (0..targets).filter_map(move |target| Some(self.target_name(mesh?, Some(node), target)))
    }

    /// The nodes that draw what [`into_mesh`](Self::into_mesh) takes.
    pub(super) fn drawing(&self) -> impl Iterator<Item = (usize, usize)> {
        let draws = |shown: bool| {
            let nodes = self.nodes.iter().enumerate().filter(move |(_, node)| node.is_shown || !shown);
            let meshes = nodes.filter_map(|(i, node)| Some((i, node.mesh?)));
            meshes.filter(|(_, mesh)| !self.meshes[*mesh].source.targets.is_empty())
        };
        let is_any_shown = draws(true).next().is_some();
        draws(is_any_shown)
    }

    /// The weights of a node at rest.
    fn at_rest(&self, node: usize, mesh: usize) -> &[f32] {
        let own = &self.nodes[node].weights;
        if own.is_empty() { &self.meshes[mesh].weights } else { own }
    }

    /// The targets that a node moves at rest: their names and weights.
    pub(super) fn moved_at_rest(&self, node: usize, mesh: usize) -> impl Iterator<Item = (&str, f32)> {
        let weights = self.at_rest(node, mesh).iter().enumerate().filter(|(_, weight)| **weight != 0.0);
        weights.map(move |(target, weight)| (self.target_name(mesh, Some(node), target), *weight))
    }

    /// The targets that a channel of weights animates: their places in its values, and in the mesh.
    fn targets_of(&self, channel: &Channel) -> impl Iterator<Item = (usize, usize)> + use<> {
        let mesh = self.nodes[channel.node].mesh;
        let count = mesh.map_or(0, |mesh| self.meshes[mesh].source.targets.len());
        let range = channel.target.map_or(0..count, |target| target..count.min(target + 1));
        range.enumerate()
    }

    /// Finds the targets that need names of their own.
    pub(super) fn own_names(&self, file: &Container) -> Result<OwnNames> {
        let root = file.root();
        let animated: HashSet<usize> =
            self.animations.iter().flat_map(Animation::weight_channels).map(|channel| channel.node).collect();
        let mut first: Vec<usize> = (0..self.nodes.len()).collect();
        let mut plain = HashMap::new();
        for (node, mesh) in self.drawing() {
            if self.nodes[node].weights.is_empty() && !animated.contains(&node) {
                first[node] = *plain.entry(mesh).or_insert(node);
            }
        }
        let drawing: Vec<(usize, usize)> = self.drawing().filter(|(node, _)| first[*node] == *node).collect();
        // How each node moves each target: the weight at rest, and the keys of each animation that has others.
        let mut ways: HashMap<(usize, usize), Vec<u32>> = HashMap::new();
        for &(node, mesh) in &drawing {
            let weights = self.at_rest(node, mesh);
            file.charge(&root, weights.len(), 160)?;
            let at_rest = weights.iter().enumerate().map(|(target, weight)| ((node, target), vec![bits(weight)]));
            ways.extend(at_rest);
        }
        for (i, animation) in self.animations.iter().enumerate() {
            for channel in animation.weight_channels() {
                for (place, target) in self.targets_of(channel) {
                    let Some(way) = ways.get_mut(&(channel.node, target)) else { continue };
                    file.charge(&root, channel.times.len() + channel.values.len() / channel.width() + 4, 8)?;
                    let key = channel.key(place);
                    if key != way[..1] {
                        way.extend([i as u32, key.len() as u32]);
                        way.extend(key);
                    }
                }
            }
        }
        let mut of_names: HashMap<&str, HashMap<&[u32], Option<String>>> = HashMap::new();
        for &(node, mesh) in &drawing {
            for (target, stated) in self.meshes[mesh].source.targets.iter().enumerate() {
                of_names.entry(&stated.name).or_default().insert(&*ways[&(node, target)], None);
            }
        }
        let mut taken = of_names.keys().map(|name| ((*name).to_owned(), 1)).collect();
        let mut labels = HashMap::new();
        let mut names = HashMap::new();
        for &(node, mesh) in &drawing {
            let source = &self.meshes[mesh].source;
            let label = Some(&self.nodes[node].name).filter(|name| !name.is_empty()).unwrap_or(&source.name);
            file.charge(&root, label.len(), 3)?;
            let label = mesh::unique(label.clone(), &mut labels, &HashSet::new());
            for (target, stated) in source.targets.iter().enumerate() {
                let all = of_names.get_mut(&*stated.name).expect("all names are there");
                if all.len() > 1 {
                    file.charge(&root, label.len() + stated.name.len() + 64, 2)?;
                    let own = all.get_mut(&*ways[&(node, target)]).expect("all ways are there");
                    let made = || mesh::unique(format!("{label}.{}", stated.name), &mut taken, &HashSet::new());
                    names.insert((node, target), own.get_or_insert_with(made).clone());
                }
            }
        }
        let longest = names.values().map(String::len).max().unwrap_or(0);
        Ok(OwnNames { first, names, longest })
    }

    /// Iterates over the animations that have weights, for [`clip`](Self::clip).
    pub(crate) fn weight_animations(&self) -> impl Iterator<Item = &Animation> {
        self.animations.iter().filter(|animation| animation.weight_channels().next().is_some())
    }

    /// Samples the weights of an animation from its first to its last key. The clip has a column for each target
    /// ([`target_names`](Self::target_names)) that the animation moves, and one for each that it leaves at a weight
    /// other than 0. Where joints alone move, a note says so; there is one column then, if all weights are 0. `fps` is
    /// the frame rate. `None`: evenly spaced keys, 20 a second or more, become the frames, at their own rate; otherwise
    /// 30.
    ///
    /// # Errors
    /// [`Error::Input`] if the animation has no channels, or the file no targets, or it is too long: more than 2²⁰
    /// frames or 2²⁴ weights, and more than keys; [`Error::Invalid`] if `fps` is not a positive number.
    pub fn clip(&self, animation: &Animation, fps: Option<f32>) -> Result<WeightClip> {
        let place = format!(": animation '{}'", animation.name);
        let refuse = || Error::input(&self.path, place, "no weights of morph targets", "name another animation");
        ensure!(!animation.channels.is_empty(), refuse());
        let still = animation.moves_joints_alone().then(|| "joints alone move: weights stay at rest".to_owned());
        let fps = frame_rate(fps.unwrap_or_else(|| animation.frame_rate()))?;
        let drawing: HashMap<usize, usize> = self.drawing().collect();
        let mut names = vec![];
        let mut seen = HashSet::new();
        let mut columns = vec![];
        for channel in animation.weight_channels() {
            let Some(mesh) = drawing.get(&channel.node) else { continue };
            let new = |(_, target): &(usize, usize)| {
                let name = self.target_name(*mesh, Some(channel.node), *target);
                seen.insert(name).then(|| names.push(name.to_owned())).is_some()
            };
            let own: Vec<usize> = self.targets_of(channel).filter(new).map(|(place, _)| place).collect();
            columns.push((channel, own));
        }
        let mut constant = vec![];
        for (name, weight) in self.drawing().flat_map(|(node, mesh)| self.moved_at_rest(node, mesh)) {
            if seen.insert(name) {
                names.push(name.to_owned());
                constant.push(weight);
            }
        }
        if names.is_empty() {
            let (node, mesh) = self.drawing().next().ok_or_else(refuse)?;
            names.push(self.target_name(mesh, Some(node), 0).to_owned());
            constant.push(0.0);
        }
        let times = animation.frames(fps, names.len()).map_err(assemble::in_file(&self.path, ""))?;
        let mut values = Vec::with_capacity(times.len() * names.len());
        for time in times {
            for (channel, own) in &columns {
                let between = channel.between(channel.near_key(time, NEAR / f64::from(fps)));
                values.extend(own.iter().map(|i| channel.number(*i, between) as f32));
            }
            values.extend(&constant);
        }
        Ok(WeightClip { name: animation.name.clone(), names, fps, values, notes: still.into_iter().collect() })
    }
}
