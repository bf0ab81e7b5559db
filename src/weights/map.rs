//! One weight vector for several meshes.

use super::names::unknown;
use crate::error::{Error, Result};
use std::collections::{HashMap, HashSet};

/// One weight vector for several meshes of a character (face, teeth, lashes, tongue): a weight applies to the targets of
/// its name in every mesh.
///
/// ```
/// let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
/// let map = deltamorph::WeightMap::new(vec![names(&["jaw", "brow"]), names(&["tongue", "jaw"])]);
/// assert_eq!(map.names(), ["jaw", "brow", "tongue"]);
/// let mut teeth = [0.0; 2];
/// map.apply(1, &[0.5, 0.0, 0.25], &mut teeth)?; // then `Crowd::set_weights` of the crowd of that mesh
/// assert_eq!(teeth, [0.25, 0.5]);
/// # Ok::<(), deltamorph::Error>(())
/// ```
///
/// One call of [`record_updates`](crate::MorphEngine::record_updates) records the updates of all crowds, with common
/// barriers.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightMap {
    /// Names of the targets of each mesh.
    meshes: Vec<Vec<String>>,
    names: Vec<String>,
    /// By mesh: pairs of weight and target.
    driven: Vec<Vec<(usize, usize)>>,
}

impl WeightMap {
    /// A map for meshes with targets of these names ([`PackedLayout::targets`](crate::PackedLayout::targets)). Its
    /// weights are initially those of all targets: each name once, in the order of meshes and their targets.
    pub fn new(meshes: Vec<Vec<String>>) -> Self {
        let mut seen = HashMap::new();
        let mut names = vec![];
        for name in meshes.iter().flatten() {
            seen.entry(name.as_str()).or_insert_with(|| {
                names.push(name.clone());
                names.len() - 1
            });
        }
        let driven = driven(&meshes, &seen);
        Self { meshes, names, driven }
    }

    /// Sets the names of the weights, in order, such as those of a clip or a tracker.
    ///
    /// # Errors
    /// A name that no mesh has (the message suggests the closest one); a duplicate name. Nothing changes then.
    pub fn bind(&mut self, names: Vec<String>) -> Result<()> {
        let targets: HashSet<&str> = self.meshes.iter().flatten().map(String::as_str).collect();
        let mut seen = HashMap::new();
        for (i, name) in names.iter().enumerate() {
            if seen.insert(name.as_str(), i).is_some() {
                return Err(Error::invalid(format!("two weights are called '{name}'"), "name each once"));
            }
            if !targets.contains(name.as_str()) {
                let targets: Vec<&str> = targets.into_iter().collect();
                return Err(unknown(format!("no mesh has a target '{name}'"), name, "target of the meshes", &targets));
            }
        }
        self.driven = driven(&self.meshes, &seen);
        self.names = names;
        Ok(())
    }

    /// The names of the weights, in order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Applies the weights, one per name of [`names`](Self::names), to the weights of the targets of the mesh at index
    /// `mesh`. Targets that no name drives keep theirs.
    ///
    /// # Errors
    /// A wrong number of weights or targets; no such mesh. Nothing changes then.
    pub fn apply(&self, mesh: usize, weights: &[f32], targets: &mut [f32]) -> Result<()> {
        let count = |text: String, remedy: &str| Err(Error::invalid(text, remedy));
        if weights.len() != self.names.len() {
            let text = format!("{} weights for {} names", weights.len(), self.names.len());
            return count(text, "pass one weight for each name, in their order");
        }
        let Some(driven) = self.driven.get(mesh) else {
            return count(format!("mesh {mesh} of {}", self.driven.len()), "count meshes from 0, as they were passed");
        };
        if targets.len() != self.meshes[mesh].len() {
            let text = format!("room for {} weights of mesh {mesh}", targets.len());
            return count(text, "pass the weights of all its targets");
        }
        driven.iter().for_each(|&(weight, target)| targets[target] = weights[weight]);
        Ok(())
    }
}

/// Pairs of weight and target of each mesh, by the index of each weight's name.
fn driven(meshes: &[Vec<String>], weights: &HashMap<&str, usize>) -> Vec<Vec<(usize, usize)>> {
    let of_mesh = |targets: &Vec<String>| {
        targets.iter().enumerate().filter_map(|(i, name)| Some((*weights.get(name.as_str())?, i))).collect()
    };
    meshes.iter().map(of_mesh).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strings(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    fn applied(map: &WeightMap, weights: &[f32]) -> [[f32; 3]; 2] {
        let mut targets = [[9.0; 3]; 2];
        targets.iter_mut().enumerate().for_each(|(mesh, of_mesh)| map.apply(mesh, weights, of_mesh).unwrap());
        targets
    }

    /// Two meshes that share two names; each has one of its own.
    #[test]
    fn each_weight_applies_to_the_targets_of_its_name() {
        let mut map = WeightMap::new(vec![strings(&["jaw", "brow", "smile"]), strings(&["smile", "tongue", "jaw"])]);
        assert_eq!(map.names(), ["jaw", "brow", "smile", "tongue"]);
        assert_eq!(applied(&map, &[0.1, 0.2, 0.3, 0.4]), [[0.1, 0.2, 0.3], [0.3, 0.4, 0.1]]);
        map.bind(strings(&["smile", "jaw"])).unwrap();
        assert_eq!(applied(&map, &[0.7, 0.6]), [[0.6, 9.0, 0.7], [0.7, 9.0, 0.6]], "others keep theirs");
        let refused = |result: Result<()>, words: &[&str]| {
            let text = result.unwrap_err().to_string();
            assert!(words.iter().all(|word| text.contains(word)), "{text}");
        };
        refused(map.bind(strings(&["Smile"])), &["no mesh has a target 'Smile'", "use 'smile'"]);
        refused(map.bind(strings(&["jaw", "jaw"])), &["two weights are called 'jaw'"]);
        assert_eq!(map.names(), ["smile", "jaw"], "nothing changes");
        refused(map.apply(0, &[0.0], &mut [0.0; 3]), &["1 weights for 2 names"]);
        refused(map.apply(2, &[0.0; 2], &mut [0.0; 3]), &["mesh 2 of 2", "count meshes from 0"]);
        refused(map.apply(0, &[0.0; 2], &mut [0.0; 2]), &["room for 2 weights"]);
    }

    #[test]
    fn targets_of_one_name_in_a_mesh_all_move() {
        let map = WeightMap::new(vec![strings(&["a", "b", "a"])]);
        let mut targets = [0.0; 3];
        map.apply(0, &[0.5, 0.25], &mut targets).unwrap();
        assert_eq!(targets, [0.5, 0.25, 0.5]);
        assert_eq!(WeightMap::new(vec![]).names().len(), 0);
    }
}
