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
//! - Vertices are those of the file. Those at one position are welded ([`Mesh::weld`]), so computed normals are
//!   smooth across seams (glTF itself specifies flat ones), and no crack opens. If a target moves positions and states
//!   no normals, they are computed from the deformed surface; glTF itself keeps those of the base pose, as does a
//!   target whose [`normals`](crate::mesh::MorphTarget::normals) are `Some(vec![])`.
//! - Tangents are those of the file; none are computed.
//! - Draco, points and lines, and cameras are not read. What is there uncompressed beside Draco is. Of materials, base
//!   colours are, for hosts that draw; textures are not.
//! - A part that cannot be used costs no more than itself: a target, a primitive, a mesh, a skin or a node is left out,
//!   with a note that names it.
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
#[cfg(test)]
mod tests;
mod weights;

pub use animation::Animation;
#[doc(hidden)]
pub use animation::{Channel, Interpolation, Property};
#[doc(hidden)]
pub use material::Material;
pub use mesh::GltfMesh;
#[doc(hidden)]
pub use mesh::Primitive;
#[doc(hidden)]
pub use scene::Transform;
pub use scene::{Node, Skin};

use super::{quoted, shortened, stem};
use crate::asset::Mesh;
use crate::error::{Error, Result, ensure};
use container::Container;
use glam::DMat4;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The content of a file, in its order; indices are the file's.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Gltf {
    /// The file's stem.
    pub name: String,
    /// The meshes.
    pub meshes: Vec<GltfMesh>,
    /// The nodes of all scenes; [`Node::is_shown`] marks those of the scene to draw.
    pub nodes: Vec<Node>,
    /// The skins.
    pub skins: Vec<Skin>,
    /// The animations.
    pub animations: Vec<Animation>,
    /// The materials.
    #[doc(hidden)]
    pub materials: Vec<Material>,
    /// Whether it is an avatar of VRM 0, which looks along −z, where glTF looks along +z. Nothing is turned: pictures
    /// of its face are taken from behind.
    pub looks_back: bool,
    /// Remarks for the user; those on a mesh are in its source.
    pub notes: Vec<String>,
    path: PathBuf,
    /// Numbers of the nodes, parents before their children.
    order: Vec<usize>,
    own: weights::OwnNames,
    /// Bytes that may still be allocated for the file.
    budget: u64,
}

/// What a file draws: [`Gltf::into_scene`].
#[derive(Clone, Debug)]
#[doc(hidden)]
pub struct Scene {
    /// The mesh that targets move: that of [`Gltf::into_mesh`].
    pub mesh: Drawn,
    /// The meshes that no target moves, as one: it needs no pose and no update. `None` if there are none, or if all
    /// meshes are: they are the mesh then.
    pub still: Option<Drawn>,
}

/// One mesh of several, and what it is drawn with.
#[derive(Clone, Debug)]
#[doc(hidden)]
pub struct Drawn {
    /// The mesh.
    pub source: Mesh,
    /// Its faces, in parts of one material each.
    pub parts: Vec<DrawnPart>,
}

/// Faces of a [`Drawn`] mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct DrawnPart {
    /// The name of the mesh that they are of.
    pub name: String,
    /// Their range in the mesh's faces, all of them triangles.
    pub faces: Range<usize>,
    /// Index of the material ([`Gltf::materials`]).
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
    let (nodes, order) = scene::nodes(file)?;
    let mut skins = vec![];
    for at in root.items("skins")? {
        skins.push(file.leave_out(scene::skin(file, &at), "skin")?.unwrap_or_default());
    }
    let materials = root.items("materials")?.iter().map(|at| material::material(file, at)).collect::<Result<_>>()?;
    let path = file.path.clone();
    let looks_back = root.extension("VRM").is_some();
    let mut gltf = Gltf { name: stem(&path), nodes, order, skins, materials, looks_back, path, ..Gltf::default() };
    let listed = root.items("meshes")?;
    let namesakes = namesakes(&gltf.nodes, &gltf.order, listed.len());
    let names: Vec<_> = listed.iter().map(mesh::stated_names).collect();
    // Targets without names are those of one mesh alone.
    let is_prefixed = names.iter().filter(|names| names.contains(&None)).count() > 1;
    let stated: HashSet<&str> = names.iter().flatten().copied().flatten().collect();
    let mut prefixes = HashMap::new();
    // Why meshes cannot be used: those with targets, and others.
    let [mut why, mut why_others] = [None, None];
    // For each mesh, the largest joint that one of its vertices follows.
    let mut largest = vec![];
    for (i, at) in listed.iter().enumerate() {
        let name = at.text_or_empty("name");
        let found = namesakes[i].filter(|_| name.is_empty()).map_or(name, |node| gltf.nodes[node].name.as_str());
        file.charge(at, found.len(), 1)?;
        let name = if found.is_empty() { format!("mesh {i}") } else { found.to_owned() };
        let prefix =
            if is_prefixed { mesh::unique(name.clone(), &mut prefixes, &HashSet::new()) + "." } else { String::new() };
        let why = if names[i].is_empty() { &mut why_others } else { &mut why };
        let read = mesh::mesh(file, at, (name, &prefix), &stated, why);
        let mesh = file.leave_out_or_keep(read, "mesh", why)?.unwrap_or_default();
        largest.push(mesh.followed().map(|(joint, _)| joint).max());
        gltf.meshes.push(mesh);
    }
    // Nothing else can stand for the only mesh with targets, or the only one at all.
    let has_targets = |mesh: &GltfMesh| !mesh.source.targets.is_empty();
    let is_left = |mesh: &GltfMesh| !mesh.source.positions.is_empty();
    let why = why.filter(|_| !gltf.meshes.iter().any(has_targets));
    let why = why.or(why_others.filter(|_| !gltf.meshes.iter().any(is_left)));
    why.map_or(Ok(()), Err)?;
    for (i, node) in gltf.nodes.iter_mut().enumerate() {
        let Some(mesh) = node.mesh else { continue };
        if !node.weights.is_empty() {
            let stated = std::mem::take(&mut node.weights);
            node.weights = mesh::fitted(file, &listed[mesh], stated, gltf.meshes[mesh].weights.len())?;
        }
        let Some(skin) = node.skin else { continue };
        let joints = gltf.skins[skin].joints.len();
        let what = match largest[mesh] {
            None => "its mesh no joints".to_owned(),
            Some(joint) if joint >= joints => format!("a vertex names joint {joint} of {joints}"),
            Some(_) => continue,
        };
        let name = shortened(&node.name);
        gltf.notes.push(format!("node {i} '{name}' has a skin, but {what}: it stands as the node does"));
        node.skin = None;
    }
    gltf.notes.splice(0..0, file.take_notes());
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
        let name = mesh::unique(name, &mut taken, &HashSet::new());
        let mut animation = Animation { name, channels: vec![] };
        let channels = animation::channels(file, at, &targets, &taking);
        animation.channels = file.leave_out(channels, "animation")?.unwrap_or_default();
        gltf.notes.extend(file.take_notes());
        gltf.animations.push(animation);
    }
    gltf.own = gltf.own_names(file)?;
    gltf.notes.extend(file.take_notes());
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
    /// seconds.
    #[must_use]
    pub fn world_matrices(&self, playing: Option<(&Animation, f64)>) -> Vec<DMat4> {
        scene::world_matrices(&self.nodes, &self.order, playing)
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

    /// Makes one mesh of the file. It takes all meshes that have targets and are in the default scene, at rest, at the
    /// transform of each node that draws them. If the file has no targets, it takes all meshes in the scene; if none is
    /// in the scene, all of the file. Targets of one name move together, if all nodes that draw them have the same
    /// weights ([`target_names`](Self::target_names)). The notes state what was left out or merged, and the weights at
    /// rest, which a mesh cannot hold. A node that a scale of 0 flattens is taken for not in the scene.
    ///
    /// A mesh with a skin is posed by its joints at rest: base and targets by the blend of matrices that each vertex
    /// follows.
    ///
    /// # Errors
    /// [`Error::Input`] if no mesh has triangles, joints move a vertex out of the range of single precision, or the
    /// mesh would be larger than a file of this size can hold.
    pub fn into_mesh(self) -> Result<Mesh> {
        Ok(self.scene(false)?.mesh.source)
    }

    /// Makes two meshes of the file: that of [`into_mesh`](Self::into_mesh), and the one of everything else in the
    /// scene, which stands in the same space.
    ///
    /// # Errors
    /// Those of `into_mesh`.
    #[doc(hidden)]
    pub fn into_scene(self) -> Result<Scene> {
        self.scene(true)
    }

    fn scene(mut self, with_still: bool) -> Result<Scene> {
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
        let mut meshes_of: BTreeMap<&str, BTreeSet<usize>> = BTreeMap::new();
        for &mesh in &taken {
            let node = drawn[mesh].first().copied();
            let names = (0..self.meshes[mesh].source.targets.len()).map(|target| self.target_name(mesh, node, target));
            names.for_each(|name| _ = meshes_of.entry(name).or_default().insert(mesh));
        }
        let shared = meshes_of.into_values().filter(|meshes| meshes.len() > 1);
        let shared: Vec<usize> = shared.flatten().collect::<BTreeSet<_>>().into_iter().collect();
        if !shared.is_empty() {
            self.notes.push(format!("merged, targets of one name moved together: {}", named(&shared)));
        }
        let at_rest =
            self.drawing().flat_map(|(node, mesh)| self.moved_at_rest(node, mesh)).collect::<BTreeMap<_, _>>();
        let at_rest: Vec<String> = at_rest.into_iter().map(|(name, weight)| format!("{name} {weight}")).collect();
        if !at_rest.is_empty() {
            self.notes.push(format!("weights at rest, which only clips of the file have: {}", at_rest.join(", ")));
        }
        let remedy = "give a file with a mesh of triangles";
        ensure!(!taken.is_empty(), Error::input(&self.path, "", "no mesh has triangles", remedy));
        let mut mesh = self.assembled(taken, &drawn, &worlds)?;
        let is_all = still.is_empty();
        let still = if is_all { None } else { Some(self.assembled(still, &drawn, &worlds)?) };
        self.notes.append(&mut mesh.source.notes);
        mesh.source.notes = self.notes;
        Ok(Scene { mesh, still })
    }

    /// Makes one mesh of those of `taken`, each as often as `drawn` has it.
    fn assembled(&mut self, taken: Vec<usize>, drawn: &[Vec<usize>], worlds: &[DMat4]) -> Result<Drawn> {
        let joints: Vec<_> = self.skins.iter().map(|skin| self.joint_matrices(skin, worlds)).collect();
        let copies = self.copies(&taken, drawn)?;
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
            let names: Vec<_> = left.targets.iter_mut().map(|target| std::mem::take(&mut target.name)).collect();
            for copy in 0..copies {
                let mut source =
                    if copy + 1 == copies { std::mem::take(&mut left) } else { Mesh { notes: vec![], ..left.clone() } };
                let node = nodes.get(copy).copied();
                for (i, target) in source.targets.iter_mut().enumerate() {
                    let own = node.and_then(|node| self.own.get(node, i));
                    target.name = own.unwrap_or(&names[i]).to_owned();
                }
                let skin = node.and_then(|number| self.nodes[number].skin);
                match skin {
                    None => {
                        let place = node.map_or(DMat4::IDENTITY, |node| worlds[node]);
                        assemble::transform(&mut source, |_| place);
                    }
                    Some(skin) => {
                        let blended = |v: usize| self.meshes[mesh].blend(v, &joints[skin]);
                        if let Some(v) = assemble::transform(&mut source, blended) {
                            source.notes.push(format!("{name}: joints of scale 0 flatten it, as at vertex {v}"));
                        }
                        // Joints may part what was at one place, or bring it there.
                        source.welds.clear();
                        source.weld().map_err(assemble::in_file(&self.path, &format!(": {name}")))?;
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
        Ok(Drawn { source: assemble::merge(self.name.clone(), parts), parts: drawn_parts })
    }

    /// Returns how many times each mesh of `taken` is made part of one mesh: once for each node that draws it, as far
    /// as the file is large enough for so much.
    fn copies(&mut self, taken: &[usize], drawn: &[Vec<usize>]) -> Result<Vec<usize>> {
        let all = assemble::semantics(taken.iter().map(|mesh| &self.meshes[*mesh].source));
        let size = |mesh: &usize| {
            let GltfMesh { source, primitives, .. } = &self.meshes[*mesh];
            // The mesh and each of its parts have its name; targets may be called after nodes.
            let names = (primitives.len() + 1) * (size_of::<Mesh>() + source.name.len());
            let names = names + 2 * self.own.longest * source.targets.len();
            (assemble::size_in(source, &all) + names) as u64
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
