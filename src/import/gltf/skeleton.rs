//! The joints of the one mesh that a file becomes.

use super::animation::Animation;
use super::mesh::{Influences, Mesh};
use super::scene::{Node, Skin, world_matrices};
use glam::DMat4;
use std::collections::BTreeMap;

/// Joints that move the vertices of the mesh of [`Gltf::into_mesh`](super::Gltf::into_mesh), beside its targets.
/// Vertices of meshes without a skin follow one joint each, the node that draws them.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Skeleton {
    /// For each vertex 8 joints, and weights that sum to 1.
    pub influences: Influences,
    /// The animations of the file.
    pub animations: Vec<Animation>,
    joints: Vec<Joint>,
    nodes: Vec<Node>,
    /// Numbers of the nodes, parents before their children.
    order: Vec<usize>,
}

/// A node, and the matrix from the space of the mesh to its own.
type Joint = (Option<usize>, DMat4);

impl Skeleton {
    /// Memory of 8 joints and weights.
    pub(super) const VERTEX_BYTES: usize = 48;

    /// A skeleton without vertices.
    pub(super) fn new(nodes: Vec<Node>, order: Vec<usize>, animations: Vec<Animation>) -> Self {
        let influences = Influences { per_vertex: 8, ..Influences::default() };
        Self { influences, animations, joints: vec![], nodes, order }
    }

    /// Adds the vertices of a mesh that `node` draws and `place` has put there. Returns how many of them follow more
    /// than 8 joints, of which the 8 with most weight count; `None` if there are too many joints.
    pub(super) fn add(
        &mut self,
        count: usize,
        node: Option<usize>,
        mesh: &Mesh,
        skins: &[Skin],
        place: &DMat4,
    ) -> Option<usize> {
        let skin = node.and_then(|node| self.nodes[node].skin).map(|skin| &skins[skin]);
        let undo = place.inverse();
        let Influences { joints, weights, .. } = &mut self.influences;
        let first = joints.len();
        let all = &mut self.joints;
        joints.resize(first + 8 * count, 0);
        weights.resize(first + 8 * count, 0.0);
        let slots = joints[first..].chunks_exact_mut(8).zip(weights[first..].chunks_exact_mut(8));
        let mut numbers = BTreeMap::new();
        // What a vertex without a joint follows is the node, unless a skin takes its place: then nothing moves it.
        let mut number = |joint: Option<usize>| {
            *numbers.entry(joint).or_insert_with(|| {
                all.push(match (skin, joint) {
                    (Some(skin), Some(i)) => (Some(skin.joints[i]), skin.inverse_bind[i].as_dmat4() * undo),
                    _ => (node.filter(|_| skin.is_none()), undo),
                });
                (all.len() - 1) as u16
            })
        };
        let mut reduced = 0;
        for (v, (joints, weights)) in slots.enumerate() {
            let influences = mesh.influences.iter().filter(|_| skin.is_some());
            let mut of: Vec<(usize, f32)> = influences.flat_map(|influences| influences.of(v)).collect();
            if of.len() > 8 {
                reduced += 1;
                of.sort_by(|a, b| b.1.total_cmp(&a.1));
                of.truncate(8);
                let sum: f32 = of.iter().map(|(_, weight)| weight).sum();
                of.iter_mut().for_each(|(_, weight)| *weight /= sum);
            }
            for (i, (joint, weight)) in of.into_iter().enumerate() {
                (joints[i], weights[i]) = (number(Some(joint)), weight);
            }
            if weights[0] == 0.0 {
                (joints[0], weights[0]) = (number(None), 1.0);
            }
        }
        (all.len() <= 1 << 16).then_some(reduced)
    }

    /// Number of joints.
    pub fn joint_count(&self) -> usize {
        self.joints.len()
    }

    /// Returns the skinning matrix of each joint, from the space of the mesh to the scene's: at rest, or at a time of
    /// an animation, in seconds ([`Animation::frame_times`]).
    #[must_use]
    pub fn joint_matrices(&self, playing: Option<(&Animation, f64)>) -> Vec<DMat4> {
        let worlds = world_matrices(&self.nodes, &self.order, playing);
        self.joints.iter().map(|(node, bind)| node.map_or(*bind, |node| worlds[node] * *bind)).collect()
    }
}
