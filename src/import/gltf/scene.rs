//! Nodes and skins: the transforms of joints at rest or at a time of an animation, in double precision.

use super::animation::{Animation, Property};
use super::container::Container;
use super::json::At;
use crate::error::{Result, ensure};
use glam::{DMat4, DQuat, DVec3, DVec4, Mat4, Quat, Vec3};

/// A node: its transform relative to its parent, and the mesh that it draws.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Node {
    /// Its name, which may be empty.
    pub name: String,
    /// Index of the parent; `None` for a root.
    pub parent: Option<usize>,
    /// Its transform relative to the parent while no animation changes it.
    pub local: Transform,
    /// Whether it is in the scene to draw: the default scene, or else the first. If the file has no scenes, all nodes
    /// are.
    pub is_shown: bool,
    /// Index of the mesh that it draws.
    pub mesh: Option<usize>,
    /// Index of the skin that deforms the mesh. The node's own transform does not apply then; the joints place the
    /// mesh.
    pub skin: Option<usize>,
    /// Weights that replace those of the mesh; empty if the node states none.
    pub weights: Vec<f32>,
}

/// A transform as a file states it. Only `Parts` can be animated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Transform {
    /// Translation · rotation · scale.
    Parts {
        /// Translation.
        translation: Vec3,
        /// Rotation.
        rotation: Quat,
        /// Scale along its own axes.
        scale: Vec3,
    },
    /// A matrix, column by column.
    Matrix(Mat4),
}

/// The joints that deform a mesh.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Skin {
    /// Its name, which may be empty.
    pub name: String,
    /// The nodes that are its joints; [`Influences::joints`](super::Influences::joints) are indices into them.
    pub joints: Vec<usize>,
    /// For each joint, the matrix from the space of the mesh to that of the joint in the bind pose.
    pub inverse_bind: Vec<Mat4>,
}

/// How transforms of nodes add up.
#[derive(Clone, Debug, Default)]
pub(super) struct Hierarchy {
    /// Nodes, parents before their children.
    pub order: Vec<usize>,
    /// What roots stand in.
    space: DMat4,
}

/// Reads all nodes, in the order of the file, and their hierarchy.
pub fn nodes(file: &Container) -> Result<(Vec<Node>, Hierarchy)> {
    let root = file.root();
    let list = root.items("nodes")?;
    let mut nodes = list.iter().map(|at| node(&root, at)).collect::<Result<Vec<Node>>>()?;
    let mut children = vec![vec![]; nodes.len()];
    for (parent, at) in list.iter().enumerate() {
        for child in at.items("children")? {
            let index = root.index_of("nodes", &child)?;
            if let Some(other) = nodes[index].parent.replace(parent) {
                let what = format!("node {index} is a child of node {other}, too");
                return Err(child.refuse(what, "give each node one parent"));
            }
            children[parent].push(index);
        }
    }
    let mut order: Vec<usize> = (0..nodes.len()).filter(|i| nodes[*i].parent.is_none()).collect();
    let mut done = 0;
    while let Some(&node) = order.get(done) {
        order.extend(&children[node]);
        done += 1;
    }
    if order.len() < nodes.len() {
        // Every node has at most one parent, so a node that no root reaches is in a cycle.
        order.sort_unstable();
        let first = (0..).zip(&order).take_while(|(i, node)| i == *node).count();
        return Err(list[first].refuse("a node below itself", "remove the cycle among the children"));
    }
    let scene = match root.get("scene") {
        Some(index) => Some(root.item("scenes", &index)?),
        None => root.items("scenes")?.into_iter().next(),
    };
    if let Some(scene) = scene {
        nodes.iter_mut().for_each(|node| node.is_shown = false);
        for index in scene.items("nodes")? {
            nodes[root.index_of("nodes", &index)?].is_shown = true;
        }
        for &node in &order {
            nodes[node].is_shown |= nodes[node].parent.is_some_and(|parent| nodes[parent].is_shown);
        }
    }
    // Avatars of VRM 0 look along -z, those of VRM 1 along +z, as glTF has it.
    let diagonal = if root.extension("VRM").is_some() { DVec4::new(-1.0, 1.0, -1.0, 1.0) } else { DVec4::ONE };
    Ok((nodes, Hierarchy { order, space: DMat4::from_diagonal(diagonal) }))
}

fn node(root: &At<'_>, at: &At<'_>) -> Result<Node> {
    let existing = |key, list| at.get(key).map(|index| root.index_of(list, &index)).transpose();
    let local = if at.get("matrix").is_some() {
        Transform::Matrix(Mat4::from_cols_array(&at.numbers("matrix", [0.0; 16])?))
    } else {
        Transform::Parts {
            translation: at.numbers("translation", [0.0; 3])?.into(),
            rotation: Quat::from_array(at.numbers("rotation", [0.0, 0.0, 0.0, 1.0])?),
            scale: at.numbers("scale", [1.0; 3])?.into(),
        }
    };
    let weights = at.get("weights").map_or(Ok(vec![]), |weights| weights.floats())?;
    let mesh = existing("mesh", "meshes")?;
    let skin = existing("skin", "skins")?;
    let name = at.text_or_empty("name").to_owned();
    Ok(Node { name, parent: None, local, is_shown: true, mesh, skin, weights })
}

/// Reads a skin.
pub fn skin(file: &Container, at: &At<'_>) -> Result<Skin> {
    let listed = at.need("joints")?.elements()?;
    let joints: Vec<usize> = listed.iter().map(|at| file.root().index_of("nodes", at)).collect::<Result<_>>()?;
    let mut inverse_bind = vec![Mat4::IDENTITY; joints.len()];
    if let Some(index) = at.get("inverseBindMatrices") {
        let accessor = file.accessor(&index)?;
        let count = accessor.count;
        let what = || format!("{count} matrices for {} joints", joints.len());
        let remedy = "export the file again: a skin has a matrix for each joint";
        ensure!(count == 0 || count >= joints.len(), accessor.at.refuse(what(), remedy));
        if count == 0 {
            file.note(&accessor.at, "no matrices, left out");
        } else {
            inverse_bind = accessor.floats()?.iter().take(joints.len()).map(Mat4::from_cols_array).collect();
        }
    }
    Ok(Skin { name: at.text_or_empty("name").to_owned(), joints, inverse_bind })
}

impl Transform {
    /// Returns the matrix, with animated values replacing its own parts.
    fn matrix(&self, playing: &[(Property, Vec<f64>)]) -> DMat4 {
        let (mut translation, mut rotation, mut scale) = match self {
            Self::Matrix(matrix) => return matrix.as_dmat4(),
            Self::Parts { translation, rotation, scale } => {
                (translation.as_dvec3(), rotation.as_dquat(), scale.as_dvec3())
            }
        };
        for (property, value) in playing {
            match property {
                Property::Translation => translation = DVec3::from_slice(value),
                Property::Rotation => rotation = DQuat::from_slice(value),
                Property::Scale => scale = DVec3::from_slice(value),
                Property::Weights => {}
            }
        }
        let length = rotation.length();
        let rotation = if length > 0.0 && length.is_finite() { rotation / length } else { DQuat::IDENTITY };
        DMat4::from_scale_rotation_translation(scale, rotation, translation)
    }
}

/// Returns the matrix of each node, from its own space to the scene's.
pub fn world_matrices(nodes: &[Node], hierarchy: &Hierarchy, playing: Option<(&Animation, f64)>) -> Vec<DMat4> {
    let mut parts: Vec<Vec<(Property, Vec<f64>)>> = vec![vec![]; nodes.len()];
    if let Some((animation, time)) = playing {
        for channel in &animation.channels {
            parts[channel.node].push((channel.property, channel.sample(time)));
        }
    }
    let mut worlds = vec![DMat4::IDENTITY; nodes.len()];
    for &node in &hierarchy.order {
        let parent = nodes[node].parent.map_or(hierarchy.space, |parent| worlds[parent]);
        worlds[node] = parent * nodes[node].local.matrix(&parts[node]);
    }
    worlds
}
