//! Nodes and skins: the transforms of joints at rest or at a time of an animation, in double precision.

use super::animation::{Animation, Property};
use super::container::Container;
use super::json::At;
use crate::error::Result;
use glam::{DMat4, DQuat, DVec3, Mat4, Quat, Vec3};

/// A node: its transform relative to its parent, and the mesh that it draws.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Node {
    /// Its name, which may be empty.
    pub name: String,
    /// Index of the parent; `None` for a root.
    pub parent: Option<usize>,
    /// Its transform relative to the parent while no animation changes it.
    #[doc(hidden)]
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
#[doc(hidden)]
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
    /// The nodes that are its joints; [`GltfMesh::joints`](super::GltfMesh::joints) are indices into them.
    pub joints: Vec<usize>,
    /// For each joint, the matrix from the space of the mesh to that of the joint in the bind pose.
    pub inverse_bind: Vec<Mat4>,
}

/// Reads all nodes, in the order of the file; and their numbers, parents before their children.
pub fn nodes(file: &Container) -> Result<(Vec<Node>, Vec<usize>)> {
    let root = file.root();
    let list = root.items("nodes")?;
    let mut nodes = list.iter().map(|at| node(file, at)).collect::<Result<Vec<Node>>>()?;
    let mut children = vec![vec![]; nodes.len()];
    for (parent, at) in list.iter().enumerate() {
        for child in file.leave_out(at.items("children"), "list")?.unwrap_or_default() {
            let found = root.index_of("nodes", &child).and_then(|index| match nodes[index].parent {
                Some(other) => Err(child.refuse(format!("node {index} is a child of node {other}, too"), "")),
                None => Ok(index),
            });
            let Some(index) = file.leave_out(found, "child")? else { continue };
            nodes[index].parent = Some(parent);
            children[parent].push(index);
        }
    }
    let mut order: Vec<usize> = (0..nodes.len()).filter(|i| nodes[*i].parent.is_none()).collect();
    let mut reached = vec![false; nodes.len()];
    let mut done = 0;
    for next in 0..=nodes.len() {
        while let Some(&node) = order.get(done) {
            reached[node] = true;
            order.extend(children[node].iter().filter(|child| !reached[**child]));
            done += 1;
        }
        // Every node has at most one parent, so one that no root reaches is in a cycle, or below one.
        if next < nodes.len() && !reached[next] {
            file.note(&list[next], "a node below itself; its parent is left out");
            nodes[next].parent = None;
            order.push(next);
        }
    }
    let stated = root.get("scene").map(|index| root.item("scenes", &index)).transpose();
    let scene = file.leave_out(stated, "choice")?.flatten();
    if let Some(scene) = scene.or(root.items("scenes")?.into_iter().next()) {
        nodes.iter_mut().for_each(|node| node.is_shown = false);
        for index in scene.items("nodes")? {
            if let Some(index) = file.leave_out(root.index_of("nodes", &index), "node")? {
                nodes[index].is_shown = true;
            }
        }
        for &node in &order {
            nodes[node].is_shown |= nodes[node].parent.is_some_and(|parent| nodes[parent].is_shown);
        }
    }
    Ok((nodes, order))
}

fn node(file: &Container, at: &At<'_>) -> Result<Node> {
    let root = file.root();
    let existing = |key, list| {
        let stated = at.get(key).map(|index| root.index_of(list, &index)).transpose();
        file.leave_out(stated, key).map(Option::flatten)
    };
    // A node that cannot be placed vanishes with what is below it, as one of scale 0 does.
    let local = file.check_extensions(at).and_then(|()| transform(at));
    let local = file.leave_out(local, "node")?.unwrap_or(Transform::Matrix(Mat4::ZERO));
    let weights = file.leave_out(at.floats_or_none("weights"), "list")?.unwrap_or_default();
    let mesh = existing("mesh", "meshes")?;
    let skin = existing("skin", "skins")?;
    let name = at.text_or_empty("name").to_owned();
    Ok(Node { name, parent: None, local, is_shown: true, mesh, skin, weights })
}

fn transform(at: &At<'_>) -> Result<Transform> {
    if at.get("matrix").is_some() {
        return Ok(Transform::Matrix(Mat4::from_cols_array(&at.numbers("matrix", [0.0; 16])?)));
    }
    Ok(Transform::Parts {
        translation: at.numbers("translation", [0.0; 3])?.into(),
        rotation: Quat::from_array(at.numbers("rotation", [0.0, 0.0, 0.0, 1.0])?),
        scale: at.numbers("scale", [1.0; 3])?.into(),
    })
}

/// Reads a skin.
pub fn skin(file: &Container, at: &At<'_>) -> Result<Skin> {
    let listed = at.need("joints")?.elements()?;
    let joints: Vec<usize> = listed.iter().map(|at| file.root().index_of("nodes", at)).collect::<Result<_>>()?;
    let mut inverse_bind = vec![Mat4::IDENTITY; joints.len()];
    if let Some(index) = at.get("inverseBindMatrices") {
        let accessor = file.accessor(&index)?;
        let count = accessor.count;
        if count < joints.len() {
            file.note(&accessor.at, format!("{count} matrices for {} joints; the others have none", joints.len()));
        }
        for (bind, stated) in inverse_bind.iter_mut().zip(accessor.floats()?) {
            *bind = Mat4::from_cols_array(&stated);
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

/// Returns the matrix of each node, from its own space to the scene's. `order` has parents before their children.
pub fn world_matrices(nodes: &[Node], order: &[usize], playing: Option<(&Animation, f64)>) -> Vec<DMat4> {
    let mut parts: Vec<Vec<(Property, Vec<f64>)>> = vec![vec![]; nodes.len()];
    if let Some((animation, time)) = playing {
        for channel in &animation.channels {
            parts[channel.node].push((channel.property, channel.sample(time)));
        }
    }
    let mut worlds = vec![DMat4::IDENTITY; nodes.len()];
    for &node in order {
        let parent = nodes[node].parent.map_or(DMat4::IDENTITY, |parent| worlds[parent]);
        worlds[node] = parent * nodes[node].local.matrix(&parts[node]);
    }
    worlds
}
