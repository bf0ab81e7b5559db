//! glTF 2.0: meshes with morph targets, their weight animations, skins and nodes (`*.glb`, `*.gltf`, `*.vrm`).
//!
//! [`read`] returns everything as plain arrays, in the order of the file, for an engine with its own scene.
//! [`import::open`](super::open) makes one mesh of the file, as described at [`Gltf::into_mesh`].
//!
//! - Streams: positions, normals, tangents, texture coordinates and colours; targets may change each of them. Accessors
//!   are dense, sparse or all zero, of any component type (KHR_mesh_quantization), compressed or not
//!   (KHR_meshopt_compression, EXT_meshopt_compression). Buffers are in the file, in data URIs, or in files beside or
//!   below it.
//! - Values keep the file's space and units: texture coordinates begin at the top left. A quantised mesh has integer
//!   positions, which the transform of its node scales or, with a skin, the inverse bind matrices.
//! - Vertices are those of the file. Those at one position are welded ([`MorphSource::weld`]), so computed normals are
//!   smooth across seams (glTF itself specifies flat ones), and no crack opens. If a target moves positions and states
//!   no normals, they are computed from the deformed surface; glTF itself keeps those of the base pose, as does a
//!   target whose [`normals`](crate::mesh::SourceTarget::normals) are `Some(vec![])`.
//! - Tangents are those of the file; none are computed.
//! - Draco, points and lines, and cameras are not read. What is there uncompressed beside Draco is. Of materials, base
//!   colours are, by [`read_materials`], for hosts that draw; textures are not.
//!
//! Files may be hostile: nothing outside their folder is read. Reading a file and making one mesh of it takes at most
//! 960 bytes of memory per byte of the file and of the files that it names, plus 3 MiB. Time is bounded in the same
//! way.

mod accessor;
mod animation;
mod assemble;
mod container;
mod json;
mod material;
mod mesh;
mod meshopt;
mod scene;
mod skeleton;
#[cfg(test)]
mod tests;

pub use animation::{Animation, Channel, Interpolation, Property};
pub use material::{Material, read_materials};
pub use mesh::{Influences, Mesh, Primitive};
use scene::Hierarchy;
pub use scene::{Node, Skin, Transform};
pub use skeleton::Skeleton;

use super::{quoted, shortened, stem};
use crate::asset::MorphSource;
use crate::error::{Error, Result, ensure};
use crate::weights::WeightClip;
use animation::NEAR;
use container::Container;
use glam::DMat4;
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The content of a file, in its order; indices are the file's.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Gltf {
    /// The file's stem.
    pub name: String,
    /// The meshes.
    pub meshes: Vec<Mesh>,
    /// The nodes of all scenes; [`Node::is_shown`] marks those of the scene to draw.
    pub nodes: Vec<Node>,
    /// The skins.
    pub skins: Vec<Skin>,
    /// The animations.
    pub animations: Vec<Animation>,
    /// Remarks for the user; those on a mesh are in its source.
    pub notes: Vec<String>,
    path: PathBuf,
    hierarchy: Hierarchy,
    /// Bytes that may still be allocated for the file.
    budget: u64,
}

/// What a file draws: [`Gltf::into_scene`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Scene {
    /// The mesh that targets move: that of [`Gltf::into_mesh`].
    pub mesh: Drawn,
    /// The meshes that no target moves, as one: it needs no pose and no update. `None` if there are none, or if all
    /// meshes are: they are the mesh then.
    pub still: Option<Drawn>,
}

/// One mesh of several, and what it is drawn with.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Drawn {
    /// The mesh.
    pub source: MorphSource,
    /// The joints that move it, if it is unposed.
    pub skeleton: Option<Skeleton>,
    /// Its faces, in parts of one material each.
    pub parts: Vec<DrawnPart>,
}

/// Faces of a [`Drawn`] mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct DrawnPart {
    /// The name of the mesh that they are of.
    pub name: String,
    /// Their range in the mesh's faces, all of them triangles.
    pub faces: Range<usize>,
    /// Index of the material ([`read_materials`]).
    pub material: Option<usize>,
}

/// Reads a file and the buffers beside it.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read; [`Error::Input`], with the place in the JSON, if it is not valid glTF 2.0,
/// requires an extension that is not supported, or refers to something that it does not have; [`Error::OutOfMemory`].
pub fn read(path: &Path) -> Result<Gltf> {
    gltf(&Container::read(path)?)
}

/// Reads the bytes of the file at `path`.
#[cfg(test)]
fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Gltf> {
    gltf(&Container::from_bytes(path, bytes)?)
}

fn gltf(file: &Container) -> Result<Gltf> {
    let root = file.root();
    let (nodes, hierarchy) = scene::nodes(file)?;
    let skins = root.items("skins")?.iter().map(|at| scene::skin(file, at)).collect::<Result<Vec<Skin>>>()?;
    let notes = file.take_notes();
    let path = file.path.clone();
    let mut gltf = Gltf { name: stem(&path), nodes, hierarchy, skins, notes, path, ..Gltf::default() };
    let listed = root.items("meshes")?;
    let namesakes = namesakes(&gltf.nodes, &gltf.hierarchy.order, listed.len());
    // Targets without names are those of one mesh alone.
    let is_prefixed = listed.iter().filter(|at| mesh::has_unnamed(at)).count() > 1;
    let mut prefixes = HashMap::new();
    // For each mesh, the largest joint that one of its vertices follows.
    let mut largest = vec![];
    for (i, at) in listed.iter().enumerate() {
        let stated = at.text_or_empty("name");
        let found = namesakes[i].filter(|_| stated.is_empty()).map_or(stated, |node| gltf.nodes[node].name.as_str());
        file.charge(at, found.len(), 1)?;
        let name = if found.is_empty() { format!("mesh {i}") } else { found.to_owned() };
        let prefix = if is_prefixed { mesh::unique(name.clone(), &mut prefixes) + " " } else { String::new() };
        let mesh = mesh::mesh(file, at, name, &prefix)?;
        largest.push(mesh.influences.iter().flat_map(Influences::followed).map(|(joint, _)| joint).max());
        gltf.meshes.push(mesh);
    }
    for (i, node) in gltf.nodes.iter_mut().enumerate() {
        let Some(mesh) = node.mesh else { continue };
        if !node.weights.is_empty() {
            let stated = std::mem::take(&mut node.weights);
            node.weights = mesh::fitted(file, &listed[mesh], stated, gltf.meshes[mesh].weights.len())?;
        }
        let Some(skin) = node.skin else { continue };
        let joints = gltf.skins[skin].joints.len();
        if gltf.meshes[mesh].influences.is_none() {
            let name = shortened(&node.name);
            gltf.notes
                .push(format!("node {i} '{name}' has a skin, but its mesh no joints: it stands as the node does"));
            node.skin = None;
        } else if let Some(joint) = largest[mesh].filter(|joint| *joint >= joints) {
            let what = format!("a vertex names joint {joint}, but the skin of node {i} has {joints}");
            return Err(listed[mesh].refuse(what, "export the file again"));
        }
    }
    let targets = |node: &Node| node.mesh.map_or(0, |mesh| gltf.meshes[mesh].source.targets.len());
    let targets: Vec<_> = gltf.nodes.iter().map(targets).collect();
    let mut taking = vec![vec![]; gltf.meshes.len()];
    for (i, node) in gltf.nodes.iter().enumerate().filter(|(_, node)| node.weights.is_empty()) {
        node.mesh.into_iter().for_each(|mesh| taking[mesh].push(i));
    }
    let mut taken = HashMap::new();
    for (i, at) in root.items("animations")?.iter().enumerate() {
        let stated = at.text_or_empty("name");
        let name = if stated.is_empty() { format!("animation {i}") } else { stated.to_owned() };
        let name = mesh::unique(name, &mut taken);
        let mut animation = Animation { name, channels: vec![] };
        let channels = animation::channels(file, at, &targets, &taking);
        animation.channels = file.leave_out(channels, "animation")?.unwrap_or_default();
        gltf.notes.extend(file.take_notes());
        gltf.notes.extend(gltf.overruled(&animation));
        gltf.animations.push(animation);
    }
    gltf.budget = file.budget.get();
    Ok(gltf)
}

/// For each of `meshes` meshes, the node to name it after: the first one that draws it, or its nearest ancestor with a
/// name.
fn namesakes(nodes: &[Node], order: &[usize], meshes: usize) -> Vec<Option<usize>> {
    let mut named: Vec<Option<usize>> = vec![None; nodes.len()];
    for &i in order {
        let above = nodes[i].parent.and_then(|parent| named[parent]);
        named[i] = if nodes[i].name.is_empty() { above } else { Some(i) };
    }
    let mut of_meshes = vec![None; meshes];
    // The last first, so that the first node overrides the others.
    for (node, named) in nodes.iter().zip(named).rev() {
        if let Some(mesh) = node.mesh {
            of_meshes[mesh] = named;
        }
    }
    of_meshes
}

impl Gltf {
    /// Returns the matrix of each node, from its own space to the scene's: at rest, or at a time of an animation, in
    /// seconds. An avatar of VRM 0, which looks along −z, is turned by 180° about y, so that it looks along +z.
    #[must_use]
    pub fn world_matrices(&self, playing: Option<(&Animation, f64)>) -> Vec<DMat4> {
        scene::world_matrices(&self.nodes, &self.hierarchy, playing)
    }

    /// Returns the skinning matrices, one for each joint of `skin`: from the bind space of the mesh to the space of the
    /// scene. `worlds` is the result of [`world_matrices`](Self::world_matrices).
    ///
    /// ```
    /// # use deltamorph::import::gltf::Gltf;
    /// /// The first three rows of each, as `SkinMethod::Linear` takes them.
    /// fn joints_for_the_gpu(gltf: &Gltf, seconds: f64) -> Vec<[f32; 12]> {
    ///     let worlds = gltf.world_matrices(gltf.animations.first().map(|animation| (animation, seconds)));
    ///     let rows = |matrix: &deltamorph::glam::DMat4| {
    ///         let matrix = matrix.transpose().as_mat4().to_cols_array();
    ///         std::array::from_fn(|i| matrix[i])
    ///     };
    ///     gltf.joint_matrices(&gltf.skins[0], &worlds).iter().map(rows).collect()
    /// }
    /// ```
    ///
    /// The matrices of a quantised mesh include a scale, since its node's transform does not apply; dual quaternions
    /// cannot represent it.
    ///
    /// # Panics
    /// If `worlds` has fewer matrices than the file has nodes.
    #[must_use]
    pub fn joint_matrices(&self, skin: &Skin, worlds: &[DMat4]) -> Vec<DMat4> {
        skin.joints.iter().zip(&skin.inverse_bind).map(|(&joint, bind)| worlds[joint] * bind.as_dmat4()).collect()
    }

    /// Iterates over the targets that a channel of weights animates: their places in its values, and their names.
    fn targets_of(&self, channel: &Channel) -> impl Iterator<Item = (usize, &str)> {
        let targets = self.nodes[channel.node].mesh.map_or(&[][..], |mesh| &self.meshes[mesh].source.targets);
        let targets = channel.target.map_or(targets, |target| targets.get(target..=target).unwrap_or_default());
        targets.iter().map(|target| target.name.as_str()).enumerate()
    }

    /// Names the first of the weights that [`clip`](Self::clip) leaves out, since an earlier channel has others for a
    /// target of that name.
    fn overruled(&self, animation: &Animation) -> Option<String> {
        let mut first: HashMap<&str, (&Channel, usize)> = HashMap::new();
        let own = |channel| self.targets_of(channel).map(move |(i, name)| (channel, i, name));
        let mut others = animation.weight_channels().flat_map(own).filter(|(channel, i, name)| {
            let (other, j) = *first.entry(name).or_insert((channel, *i));
            !channel.is_as(*i, other, j)
        });
        let (channel, _, target) = others.next()?;
        let count = 1 + others.count();
        let node = channel.node;
        let [animation, name, target] = [&animation.name, &self.nodes[node].name, target].map(shortened);
        let what = format!("first of node {node} '{name}', '{target}', which another node animates, too");
        Some(format!("animation '{animation}': weights left out: {count}, {what}"))
    }

    /// Iterates over the animations that have weights, for [`clip`](Self::clip).
    pub(super) fn weight_animations(&self) -> impl Iterator<Item = &Animation> {
        self.animations.iter().filter(|animation| animation.weight_channels().next().is_some())
    }

    /// Samples the weights of an animation from its first to its last key. The clip has a column for each target that
    /// the animation moves; if several meshes have targets of one name, the first animated one counts. `fps` is the
    /// frame rate. `None`: evenly spaced keys, 20 a second or more, become the frames, at their own rate; otherwise 30.
    ///
    /// # Errors
    /// [`Error::Input`] if the animation has no weights, or is too long ([`Animation::frame_times`]);
    /// [`Error::Invalid`] if `fps` is not a positive number.
    pub fn clip(&self, animation: &Animation, fps: Option<f32>) -> Result<WeightClip> {
        let channels: Vec<&Channel> = animation.weight_channels().collect();
        let place = format!(": animation '{}'", animation.name);
        let what = "no weights of morph targets";
        ensure!(!channels.is_empty(), Error::input(&self.path, place, what, "name another animation"));
        let fps = super::frame_rate(fps.unwrap_or_else(|| animation.frame_rate()))?;
        let mut names = vec![];
        let mut columns = vec![];
        let mut seen = HashSet::new();
        for channel in &channels {
            let new = self.targets_of(channel).filter(|(_, name)| seen.insert(*name));
            let (own, called): (Vec<usize>, Vec<&str>) = new.unzip();
            names.extend(called.into_iter().map(str::to_owned));
            columns.push((*channel, own));
        }
        // Columns whose channels are all covered by earlier ones.
        columns.retain(|(_, own)| !own.is_empty());
        let times = animation.frames(fps, names.len()).map_err(assemble::in_file(&self.path, ""))?;
        let mut values = Vec::with_capacity(times.len() * names.len());
        for time in times {
            for (channel, own) in &columns {
                let between = channel.between(channel.near_key(time, NEAR / f64::from(fps)));
                values.extend(own.iter().map(|i| channel.number(*i, between) as f32));
            }
        }
        Ok(WeightClip { name: animation.name.clone(), names, fps, values })
    }

    /// Makes one mesh of the file. It takes all meshes that have targets and are in the default scene, at rest, at the
    /// transform of each node that draws them. If the file has no targets, it takes all meshes in the scene; if none is
    /// in the scene, all of the file. Targets of one name move together. The notes state what was left out or merged,
    /// and the weights at rest, which a mesh cannot hold. A node that a scale of 0 flattens is taken for not in the
    /// scene.
    ///
    /// A mesh with a skin is posed by its joints at rest: base and targets by the blend of matrices that each vertex
    /// follows. Not so if `unposed`: it stands whole then, where the joint is that most of its weight follows, and the
    /// mesh has the joints, which bring it to that pose at rest. It has none where nothing moves but targets: no mesh
    /// has a skin, and no animation moves a node.
    ///
    /// # Errors
    /// [`Error::Input`] if no mesh has triangles, joints move a vertex out of the range of single precision, the mesh
    /// would be larger than a file of this size can hold, or vertices of an unposed mesh follow more than 65,535 joints
    /// in all.
    pub fn into_mesh(self, unposed: bool) -> Result<Drawn> {
        Ok(self.scene(unposed, false)?.mesh)
    }

    /// Makes two meshes of the file: that of [`into_mesh`](Self::into_mesh), and the one of everything else in the
    /// scene, which stands in the same space, and has joints in the same way.
    ///
    /// # Errors
    /// Those of `into_mesh`.
    pub fn into_scene(self, unposed: bool) -> Result<Scene> {
        self.scene(unposed, true)
    }

    fn scene(mut self, unposed: bool, with_still: bool) -> Result<Scene> {
        let has_skin = self.nodes.iter().any(|node| node.skin.is_some());
        let mut channels = self.animations.iter().flat_map(|animation| &animation.channels);
        let moves = has_skin || channels.any(|channel| channel.property != Property::Weights);
        let worlds = self.world_matrices(None);
        // For each mesh, the nodes in the scene that draw it.
        let mut drawn = vec![vec![]; self.meshes.len()];
        let mut flat = vec![];
        for (i, node) in self.nodes.iter().enumerate().filter(|(_, node)| node.is_shown) {
            match node.mesh {
                Some(_) if node.skin.is_none() && assemble::flattens(&worlds[i]) => flat.push(node.name.as_str()),
                Some(mesh) => drawn[mesh].push(i),
                None => {}
            }
        }
        if !flat.is_empty() {
            self.notes.push(format!("nodes that a scale of 0 flattens are left out: {}", quoted(flat)));
        }
        let mut taken: Vec<usize> = (0..self.meshes.len()).collect();
        taken.retain(|mesh| !self.meshes[*mesh].source.positions.is_empty());
        let mut still = vec![];
        let named = |meshes: &[usize]| quoted(meshes.iter().map(|mesh| self.meshes[*mesh].source.name.as_str()));
        let has_targets = |mesh: &usize| !self.meshes[*mesh].source.targets.is_empty();
        let is_drawn = |mesh: &usize| !drawn[*mesh].is_empty();
        for (why, is_wanted) in [
            ("without targets, and no part of the mesh", &has_targets as &dyn Fn(&usize) -> bool),
            ("not in the scene, and left out", &is_drawn),
        ] {
            if taken.iter().any(is_wanted) {
                let others: Vec<usize> = taken.extract_if(.., |mesh| !is_wanted(mesh)).collect();
                if !others.is_empty() {
                    self.notes.push(format!("{why}: {}", named(&others)));
                }
                still.extend(others.into_iter().filter(|mesh| with_still && is_drawn(mesh)));
            }
        }
        if taken.len() > 1 {
            self.notes.push(format!("merged, targets of one name moved together: {}", named(&taken)));
        }
        let remedy = "give a file with a mesh of triangles";
        ensure!(!taken.is_empty(), Error::input(&self.path, "", "no mesh has triangles", remedy));
        let mut mesh = self.assembled(taken, &drawn, &worlds, unposed && moves)?;
        let is_all = still.is_empty();
        let still = if is_all { None } else { Some(self.assembled(still, &drawn, &worlds, unposed && moves)?) };
        self.notes.append(&mut mesh.source.notes);
        mesh.source.notes = self.notes;
        Ok(Scene { mesh, still })
    }

    /// Makes one mesh of those of `taken`, each as often as `drawn` has it.
    fn assembled(
        &mut self,
        taken: Vec<usize>,
        drawn: &[Vec<usize>],
        worlds: &[DMat4],
        with_joints: bool,
    ) -> Result<Drawn> {
        let joints: Vec<_> = self.skins.iter().map(|skin| self.joint_matrices(skin, worlds)).collect();
        let copies = self.copies(&taken, drawn, if with_joints { Skeleton::VERTEX_BYTES } else { 0 })?;
        let skeleton = || Skeleton::new(self.nodes.clone(), self.hierarchy.clone(), self.animations.clone());
        let mut skeleton = with_joints.then(skeleton);
        let mut parts = vec![];
        let mut drawn_parts = vec![];
        let mut faces = 0;
        for (mesh, copies) in taken.into_iter().zip(copies) {
            let mut left = std::mem::take(&mut self.meshes[mesh].source);
            let nodes = &drawn[mesh];
            let name = format!("mesh '{}'", left.name);
            if copies < nodes.len() {
                let why = "since the file is small, copies are fewer";
                left.notes.push(format!("{name} is drawn by {} nodes; {why}: {copies}", nodes.len()));
            }
            let stated = nodes.first().map(|number| &self.nodes[*number].weights).filter(|weights| !weights.is_empty());
            let weights = stated.unwrap_or(&self.meshes[mesh].weights);
            let at_rest = weights.iter().zip(&left.targets).filter(|(weight, _)| **weight != 0.0);
            let at_rest: Vec<String> = at_rest.map(|(weight, target)| format!("{} {weight}", target.name)).collect();
            if !at_rest.is_empty() {
                left.notes.push(format!("{name} has weights at rest, which are left out: {}", at_rest.join(", ")));
            }
            for copy in 0..copies {
                let mut source = match copy + 1 == copies {
                    true => std::mem::take(&mut left),
                    false => MorphSource { notes: vec![], ..left.clone() },
                };
                let node = nodes.get(copy).copied();
                let skin = node.and_then(|number| self.nodes[number].skin);
                let influences = self.meshes[mesh].influences.as_ref().zip(skin.map(|skin| &joints[skin][..]));
                let place = match (node, influences) {
                    (_, Some((influences, joints))) if with_joints => influences.foremost(joints),
                    (Some(number), None) if skin.is_none() => worlds[number],
                    _ => DMat4::IDENTITY,
                };
                match influences.filter(|_| !with_joints) {
                    None => _ = assemble::transform(&mut source, |_| place),
                    Some((influences, joints)) => {
                        if let Some(v) = assemble::transform(&mut source, |v| influences.blend(v, joints)) {
                            source.notes.push(format!("{name}: joints of scale 0 flatten it, as at vertex {v}"));
                        }
                        // Joints may part what was at one place, or bring it there.
                        source.welds.clear();
                        source.weld().map_err(assemble::in_file(&self.path, &format!(": {name}")))?;
                    }
                }
                if let Some(skeleton) = &mut skeleton {
                    let count = source.positions.len();
                    let added = skeleton.add(count, node, &self.meshes[mesh], &self.skins, &place);
                    let reduced = added.ok_or_else(|| {
                        let remedy = "export fewer meshes or joints";
                        Error::input(&self.path, "", "vertices follow more than 65535 joints", remedy)
                    })?;
                    if reduced > 0 {
                        let what = "vertices that follow more than 8 joints, of which 8 move them";
                        source.notes.push(format!("{name}: {what}: {reduced}"));
                    }
                }
                drawn_parts.extend(self.meshes[mesh].primitives.iter().map(|primitive| DrawnPart {
                    name: source.name.clone(),
                    faces: primitive.triangles.start + faces..primitive.triangles.end + faces,
                    material: primitive.material,
                }));
                faces += source.faces.sizes.len();
                parts.push(source);
            }
        }
        Ok(Drawn { source: assemble::merge(self.name.clone(), parts), skeleton, parts: drawn_parts })
    }

    /// Returns how many times each mesh of `taken` is made part of one mesh: once for each node that draws it, as far
    /// as the file is large enough for so much. `more` are the bytes of a vertex besides.
    fn copies(&mut self, taken: &[usize], drawn: &[Vec<usize>], more: usize) -> Result<Vec<usize>> {
        let all = assemble::semantics(taken.iter().map(|mesh| &self.meshes[*mesh].source));
        let size = |mesh: &usize| {
            let Mesh { source, primitives, .. } = &self.meshes[*mesh];
            // The mesh and each of its parts have its name.
            let names = (primitives.len() + 1) * (size_of::<MorphSource>() + source.name.len());
            (assemble::size_in(source, &all) + more * source.positions.len() + names) as u64
        };
        let total = taken.iter().map(size).sum::<u64>();
        let mut left = self.budget.checked_sub(total).ok_or_else(|| {
            let mib = total.div_ceil(1 << 20);
            let what = format!("its meshes as one take {mib} MiB, which is more than a file of this size can hold");
            let remedy = "export fewer of them, or without what only some of them have";
            Error::input(&self.path, "", what, remedy)
        })?;
        let mut copies = vec![];
        for mesh in taken {
            // A copy, and the part of the one mesh that is made of it.
            let each = 2 * size(mesh);
            let others = (drawn[*mesh].len().saturating_sub(1) as u64).min(left / each);
            left -= others * each;
            copies.push(others as usize + 1);
        }
        self.budget = left;
        Ok(copies)
    }
}
