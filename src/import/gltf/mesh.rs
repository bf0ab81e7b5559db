//! Meshes: primitives with their streams, targets, joints and weights.

use super::accessor::Accessor;
use super::assemble::{in_file, merge, semantics, size_in};
use super::container::Container;
use super::json::At;
use crate::asset::normals::unit_normals;
use crate::asset::{Corner, Faces, Mesh, MorphTarget, Semantic, StreamData, StreamDeltas};
use crate::error::{Error, Result, ensure};
use crate::import::shortened;
use glam::{DMat4, Vec2, Vec3};
use serde_json::Value;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// A mesh of the file, in its own space; nodes place it.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct GltfMesh {
    /// The vertices of all primitives, one after the other, as in the file: one texture coordinate each, and faces that
    /// name them ([`Faces::triangles`]). Doubled vertices are welded. It has the streams that some target changes.
    /// Without triangles in the file, it has no vertices.
    pub source: Mesh,
    /// A weight for each target, used by nodes that state none.
    pub weights: Vec<f32>,
    /// The vertices and triangles of each primitive.
    #[doc(hidden)]
    pub primitives: Vec<Primitive>,
    /// Streams that no target changes, and that therefore need no pose, except the first texture coordinates, which are
    /// `source.texcoords`. For a primitive that lacks one, tangents are along x, texture coordinates 0, colours white.
    pub constants: Vec<StreamData>,
    /// Joints that each vertex may follow, for linear-blend or dual-quaternion skinning: 4 for each set of joints in
    /// the file; 0 if no vertex follows any.
    pub joints_per_vertex: usize,
    /// `joints_per_vertex` indices into [`Skin::joints`](super::Skin::joints) for each vertex.
    pub joints: Vec<u16>,
    /// `joints_per_vertex` weights for each vertex, 0 or more. Their sum is 1, or 0 for a vertex of a primitive without
    /// any.
    pub joint_weights: Vec<f32>,
}

/// A primitive of a [`GltfMesh`]: the part that is drawn with one material.
#[derive(Clone, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct Primitive {
    /// Its index in the file's mesh. Primitives without triangles are left out.
    pub index: usize,
    /// Its range of vertices.
    pub vertices: Range<usize>,
    /// Its range of faces, all of them triangles.
    pub triangles: Range<usize>,
    /// Index of the file's material.
    pub material: Option<usize>,
}

const AGAIN: &str = "export the file again";

/// Reads a mesh; `name` is for reports. Names of targets that have none begin with `prefix`; those that are made here
/// are none of `stated`. Primitives that cannot be used are left out; `why` gets the first error.
pub fn mesh(
    file: &Container,
    at: &At<'_>,
    (name, prefix): (String, &str),
    stated: &HashSet<&str>,
    why: &mut Option<Error>,
) -> Result<GltfMesh> {
    let primitives = at.items("primitives")?;
    let names = target_names(file, at, prefix, stated)?;
    let joints_per_vertex = primitives.iter().map(|at| 4 * sets_of_joints(at)).max().unwrap_or(0);
    let mut mesh = GltfMesh { joints_per_vertex, ..GltfMesh::default() };
    let mut parts = vec![];
    for (index, primitive) in primitives.iter().enumerate() {
        let read = file.leave_out_or_keep(part(file, primitive, &names), "primitive", why)?;
        let Some(source) = read.flatten() else { continue };
        let first = mesh.joint_weights.len();
        let joints = add_joints(file, primitive, source.positions.len(), &mut mesh);
        if file.leave_out(joints, "skin of this primitive")?.is_none() {
            mesh.joint_weights[first..].fill(0.0);
        }
        let [v, t] = mesh.primitives.last().map_or([0, 0], |last| [last.vertices.end, last.triangles.end]);
        mesh.primitives.push(Primitive {
            index,
            vertices: v..v + source.positions.len(),
            triangles: t..t + source.faces.sizes.len(),
            material: file.leave_out(primitive.index("material"), "material")?.flatten(),
        });
        parts.push(source);
    }
    let all = semantics(parts.iter());
    file.charge(at, parts.iter().map(|part| size_in(part, &all)).sum(), 1)?;
    if mesh.followed().next().is_none() {
        mesh = GltfMesh { joints_per_vertex: 0, joints: vec![], joint_weights: vec![], ..mesh };
    }
    mesh.source = merge(name, parts);
    mesh.source.notes.splice(0..0, file.take_notes());
    let stated = file.leave_out(at.floats_or_none("weights"), "list")?.unwrap_or_default();
    mesh.weights = fitted(file, at, stated, mesh.source.targets.len())?;
    for i in (0..mesh.source.streams.len()).rev() {
        if mesh.source.targets.iter().all(|target| target.streams[i].vertices.is_empty()) {
            mesh.source.targets.iter_mut().for_each(|target| _ = target.streams.remove(i));
            mesh.constants.insert(0, mesh.source.streams.remove(i));
        }
    }
    mesh.constants.retain(|stream| stream.semantic != Semantic::TexCoord(0));
    if !mesh.source.positions.is_empty() {
        mesh.source.weld().map_err(in_file(at.path, &format!(": {}", at.place)))?;
    }
    Ok(mesh)
}

/// Fits the number of weights to that of targets.
pub fn fitted(file: &Container, at: &At<'_>, mut weights: Vec<f32>, targets: usize) -> Result<Vec<f32>> {
    file.charge(at, targets, size_of::<f32>())?;
    weights.resize(targets, 0.0);
    Ok(weights)
}

fn list<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

/// The names that a mesh states for its targets: in its own extras.targetNames, or those of its first primitive that
/// has them (UniVRM).
pub fn stated_names<'a>(at: &At<'a>) -> Vec<Option<&'a str>> {
    let primitives = list(at.value, "primitives");
    let count = primitives.iter().map(|primitive| list(primitive, "targets").len()).max().unwrap_or(0);
    let mut lists = std::iter::once(at.value).chain(primitives).map(|value| list(&value["extras"], "targetNames"));
    let names = lists.find(|names| !names.is_empty()).unwrap_or_default();
    (0..count).map(|i| names.get(i)?.as_str().filter(|name| !name.is_empty())).collect()
}

/// The names of the accessors with the positions of `count` targets (FBX2glTF), if no two are alike.
fn names_of_accessors<'a>(file: &'a Container, at: &At<'a>, count: usize) -> Option<Vec<&'a str>> {
    let accessors = list(file.root().value, "accessors");
    let name = |i: usize| {
        let mut targets = list(at.value, "primitives").iter().map(|primitive| &primitive["targets"][i]["POSITION"]);
        let index = usize::try_from(targets.find_map(Value::as_u64)?).ok()?;
        accessors.get(index)?["name"].as_str().filter(|name| !name.is_empty())
    };
    let names: Vec<&str> = (0..count).map(name).collect::<Option<_>>()?;
    (names.iter().collect::<HashSet<_>>().len() == count).then_some(names)
}

/// The names of all targets: those that are not stated get those of accessors or numbers, behind `prefix`. A repeated
/// name gets a number.
fn target_names(file: &Container, at: &At<'_>, prefix: &str, stated: &HashSet<&str>) -> Result<Vec<String>> {
    let names = stated_names(at);
    file.charge(at, names.len(), prefix.len())?;
    let of_accessors = names_of_accessors(file, at, names.len()).filter(|_| names.iter().all(Option::is_none));
    let mut taken = HashMap::new();
    let named = |(i, name): (usize, Option<&str>)| match (name, &of_accessors) {
        (Some(name), _) => name.to_owned(),
        (None, Some(names)) => format!("{prefix}{}", names[i]),
        (None, None) => format!("{prefix}target {i}"),
    };
    let all = names.into_iter().enumerate().map(named);
    Ok(all.map(|name| unique(name, &mut taken, stated)).collect())
}

/// Makes `name` unique among `taken`, by appending the first number from 2 on that makes it none of `taken` and of
/// `stated`, if necessary. `taken` maps each name to the last number that was tried for it, so that many repetitions of
/// a name need no search from the start.
pub fn unique(name: String, taken: &mut HashMap<String, usize>, stated: &HashSet<&str>) -> String {
    let mut number = taken.get(&name).copied().unwrap_or(1);
    let mut found = name.clone();
    while taken.contains_key(&found) || number > 1 && stated.contains(found.as_str()) {
        number += 1;
        found = format!("{name} {number}");
    }
    taken.insert(name, number);
    taken.entry(found.clone()).or_insert(1);
    found
}

/// Returns the stream of the attribute `key`, if it is one.
fn semantic(key: &str) -> Option<Semantic> {
    // Only one spelling of a number counts; otherwise a primitive could have any number of streams.
    let number = |set: &str| set.parse().ok().filter(|number: &u8| number.to_string() == set);
    Some(match key.split_once('_') {
        None if key == "POSITION" => Semantic::Position,
        None if key == "NORMAL" => Semantic::Normal,
        None if key == "TANGENT" => Semantic::Tangent,
        Some(("TEXCOORD", set)) => Semantic::TexCoord(number(set)?),
        Some(("COLOR", set)) => Semantic::Color(number(set)?),
        _ => return None,
    })
}

/// Returns the streams that an object of attributes names, in their order.
fn streams<'a>(at: &At<'a>) -> Vec<(Semantic, At<'a>)> {
    let keys = at.value.as_object().into_iter().flat_map(|object| object.keys());
    let mut found: Vec<_> = keys.filter_map(|key| Some((semantic(key)?, at.get(key)?))).collect();
    found.sort_by_key(|(semantic, _)| *semantic);
    found
}

/// Reads a primitive as a separate mesh; `None` if it has no triangles.
fn part(file: &Container, at: &At<'_>, names: &[String]) -> Result<Option<Mesh>> {
    let nothing = |what: &str| {
        file.note(at, format!("{what}, left out"));
        Ok(None)
    };
    file.check_extensions(at)?;
    let mode = at.whole_or("mode", 4)?;
    if !(4..=6).contains(&mode) {
        return nothing("points or lines");
    }
    let attributes = at.need("attributes")?;
    let Some(positions) = attributes.get("POSITION") else { return nothing("no vertices (POSITION)") };
    // The same values may be there uncompressed, too.
    if at.extension("KHR_draco_mesh_compression").is_some()
        && file.root().item("accessors", &positions)?.get("bufferView").is_none()
    {
        let remedy = "decompress the file (gltf-transform copy does), or compress it by KHR_meshopt_compression";
        return Err(at.refuse("compressed by Draco, which is not read", remedy));
    }
    let positions = file.accessor(&positions)?.floats::<3>()?;
    let count = positions.len();
    if count == 0 {
        return nothing("no vertices (POSITION)");
    }
    let faces = faces(file, at, mode, count)?;
    if faces.sizes.is_empty() {
        return nothing("no triangles");
    }
    let mut source = Mesh { faces, ..Mesh::default() };
    source.positions = positions.into_iter().map(Vec3::from).collect();
    let mut part = Part { file, source, normal_scales: vec![], tangent_scales: vec![] };
    for (semantic, index) in streams(&attributes) {
        let read = part.add_stream(semantic, &index);
        file.leave_out(read, "attribute")?;
    }
    let targets = at.items("targets")?;
    if targets.len() < names.len() {
        let others = names.len() - targets.len();
        file.note(at, format!("targets of other primitives, which leave this one: {others}"));
    }
    let streams = part.source.streams.len();
    file.charge(at, targets.len(), size_of::<MorphTarget>() + streams * size_of::<StreamDeltas>())?;
    file.charge(at, names.iter().map(String::len).sum(), 1)?;
    for (target, name) in targets.iter().zip(names) {
        let read = part.target(target, name);
        let target = file.leave_out(read, &format!("target '{}'", shortened(name)))?;
        part.source.targets.push(target.unwrap_or_else(|| part.still_target(name)));
    }
    let source = part.source;
    let without = source.targets.iter().filter(|target| source.normals.is_some() && target.normals.is_none()).count();
    if without > 0 {
        file.note(at, format!("targets without normals, computed from the deformed surface: {without}"));
    }
    Ok(Some(source))
}

/// A primitive that is being read.
struct Part<'a> {
    file: &'a Container,
    source: Mesh,
    /// Factors that bring normals and tangents to unit length; deltas are multiplied by them, too.
    normal_scales: Vec<f32>,
    tangent_scales: Vec<f32>,
}

impl<'a> Part<'a> {
    /// An attribute that need not be there.
    fn read(&self, index: &At<'_>) -> Result<Accessor<'a>> {
        Ok(self.file.accessor(index)?.of_count(self.source.positions.len(), "vertices (POSITION)")?.or_missing(0.0))
    }

    /// Adds a stream of the base pose; positions are there already.
    fn add_stream(&mut self, semantic: Semantic, index: &At<'_>) -> Result<()> {
        let values = match semantic {
            // glTF has no attribute for masks.
            Semantic::Position | Semantic::Mask => return Ok(()),
            Semantic::Normal => {
                let stated: Vec<Vec3> = self.read(index)?.floats::<3>()?.into_iter().map(Vec3::from).collect();
                let (units, scales, lost) = unit_normals(&stated, &self.source.faces, &self.source.positions);
                if lost > 0 {
                    self.file.note(index, format!("zero normals, computed and constant in all targets: {lost}"));
                }
                self.source.normals = Some(units);
                self.normal_scales = scales;
                return Ok(());
            }
            Semantic::Tangent => {
                let mut tangents = self.read(index)?.floats::<4>()?.into_flattened();
                for tangent in tangents.as_chunks_mut::<4>().0 {
                    let stated = Vec3::from_slice(tangent);
                    let length = stated.as_dvec3().length();
                    let scale = if length < 1e-6 { 0.0 } else { (1.0 / length) as f32 };
                    let unit = if scale == 0.0 { Vec3::X } else { stated * scale };
                    *tangent = unit.extend(1f32.copysign(tangent[3])).to_array();
                    self.tangent_scales.push(scale);
                }
                tangents
            }
            Semantic::TexCoord(set) => {
                let values = self.read(index)?.floats::<2>()?;
                if set == 0 {
                    self.source.texcoords = values.iter().copied().map(Vec2::from).collect();
                    self.source.faces.corners.iter_mut().for_each(|c| c.texcoord = Some(c.position));
                }
                values.into_flattened()
            }
            Semantic::Color(_) => match self.read(index)?.or_missing(1.0) {
                rgb if rgb.components == 3 => rgb.floats::<3>()?.iter().flat_map(|&[r, g, b]| [r, g, b, 1.0]).collect(),
                rgba => rgba.floats::<4>()?.into_flattened(),
            },
        };
        self.source.streams.push(StreamData { semantic, values });
        Ok(())
    }

    /// A target that moves nothing.
    fn still_target(&self, name: &str) -> MorphTarget {
        let normals = self.source.normals.as_ref().map(|_| vec![]);
        let streams = vec![StreamDeltas::default(); self.source.streams.len()];
        MorphTarget { name: name.to_owned(), positions: vec![], normals, streams }
    }

    fn target(&self, target: &At<'_>, name: &str) -> Result<MorphTarget> {
        let mut made = MorphTarget { normals: None, ..self.still_target(name) };
        for (semantic, index) in streams(target) {
            if semantic == Semantic::Position {
                let accessor = self.file.accessor(&index)?;
                if accessor.count == 0 {
                    self.file.note(&accessor.at, "no elements, left out");
                    continue;
                }
                let accessor = accessor.of_count(self.source.positions.len(), "vertices (POSITION)")?;
                made.positions = vectors(accessor.deltas::<3>()?, None);
            } else {
                let read = self.add_deltas(semantic, &index, &mut made);
                self.file.leave_out(read, "attribute")?;
            }
        }
        // Without positions, the normals stay as well; otherwise they are computed.
        if self.source.normals.is_some() && made.normals.is_none() && made.positions.is_empty() {
            made.normals = Some(vec![]);
        }
        Ok(made)
    }

    /// Adds the deltas of a stream, other than positions, to a target.
    fn add_deltas(&self, semantic: Semantic, index: &At<'_>, made: &mut MorphTarget) -> Result<()> {
        let accessor = self.read(index)?;
        if semantic == Semantic::Normal {
            // If base normals are missing, all normals are computed.
            if self.source.normals.is_some() {
                made.normals = Some(vectors(accessor.deltas::<3>()?, Some(&self.normal_scales)));
            }
            return Ok(());
        }
        let Some(own) = self.source.streams.iter().position(|s| s.semantic == semantic) else {
            return Err(index.refuse(format!("the base pose has no {semantic} to add to"), AGAIN));
        };
        made.streams[own] = match (semantic, accessor.components) {
            (Semantic::Tangent, _) => {
                let deltas = vectors(accessor.deltas::<3>()?, Some(&self.tangent_scales));
                stream(deltas.into_iter().map(|(v, d)| (v, d.to_array())))
            }
            (Semantic::TexCoord(_), _) => stream(accessor.deltas::<2>()?),
            (_, 3) => stream(accessor.deltas::<3>()?.into_iter().map(|(v, [r, g, b])| (v, [r, g, b, 0.0]))),
            _ => stream(accessor.deltas::<4>()?),
        };
        Ok(())
    }
}

fn vectors(deltas: Vec<(u32, [f32; 3])>, scales: Option<&[f32]>) -> Vec<(u32, Vec3)> {
    let scaled = |(v, d): (u32, [f32; 3])| (v, Vec3::from(d) * scales.map_or(1.0, |scales| scales[v as usize]));
    deltas.into_iter().map(scaled).collect()
}

fn stream<const N: usize>(deltas: impl IntoIterator<Item = (u32, [f32; N])>) -> StreamDeltas {
    let (vertices, deltas): (_, Vec<[f32; N]>) = deltas.into_iter().unzip();
    StreamDeltas { vertices, deltas: deltas.into_flattened() }
}

/// Returns the triangles of `count` vertices: a list (mode 4), strip (5) or fan (6).
fn faces(file: &Container, at: &At<'_>, mode: usize, count: usize) -> Result<Faces> {
    let indices: Vec<u32> = match at.get("indices") {
        None => {
            let mut indices = file.room(at, count)?;
            indices.extend(0..count as u32);
            indices
        }
        Some(index) => {
            let accessor = file.accessor(&index)?;
            let indices = accessor.indices::<1>()?.into_flattened();
            for (i, v) in indices.iter().enumerate() {
                let what = || format!("index {i} names vertex {v}, but there are {count}");
                ensure!((*v as usize) < count, accessor.at.refuse(what(), AGAIN));
            }
            indices
        }
    };
    let triangles = if mode == 4 { indices.len() / 3 } else { indices.len().saturating_sub(2) };
    if mode == 4 && 3 * triangles < indices.len() {
        file.note(at, format!("the last indices are no triangle, and left out: {} in all", indices.len()));
    }
    let of = |i: usize| match mode {
        4 => [indices[3 * i], indices[3 * i + 1], indices[3 * i + 2]],
        5 => [indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]],
        _ => [indices[i + 1], indices[i + 2], indices[0]],
    };
    // Strips turn back with triangles that have no area.
    let is_part = |[a, b, c]: &[u32; 3]| mode == 4 || a != b && b != c && c != a;
    file.charge(at, triangles, size_of::<u32>())?;
    let mut corners = file.room(at, 3 * triangles)?;
    let vertices = (0..triangles).map(of).filter(is_part).flatten();
    corners.extend(vertices.map(|position| Corner { position, texcoord: None }));
    Ok(Faces { sizes: vec![3; corners.len() / 3], corners })
}

/// The number of sets of joints of a primitive.
fn sets_of_joints(primitive: &At<'_>) -> usize {
    let attributes = primitive.get("attributes");
    let is_there = |set: &i32| attributes.as_ref().is_some_and(|at| at.get(&format!("JOINTS_{set}")).is_some());
    (0..).take_while(is_there).count()
}

/// Reads all sets of joints and weights of a primitive; without any, weights are 0.
fn add_joints(file: &Container, primitive: &At<'_>, count: usize, mesh: &mut GltfMesh) -> Result<()> {
    let each = mesh.joints_per_vertex;
    let first = mesh.joint_weights.len();
    file.charge(primitive, count, each * (size_of::<u16>() + size_of::<f32>()))?;
    mesh.joints.resize(first + each * count, 0);
    mesh.joint_weights.resize(first + each * count, 0.0);
    let attributes = primitive.need("attributes")?;
    let of = |key: String| file.accessor(&attributes.need(&key)?)?.of_count(count, "vertices (POSITION)");
    let sets = sets_of_joints(primitive);
    let mut below = 0;
    for set in 0..sets {
        let joints = of(format!("JOINTS_{set}"))?.padded().indices::<4>()?;
        let weights = of(format!("WEIGHTS_{set}"))?.padded().floats::<4>()?;
        for (v, (joints, weights)) in joints.into_iter().zip(weights).enumerate() {
            let at = first + each * v + 4 * set;
            // Joints are at most 16-bit numbers, as in glTF's types for them.
            mesh.joints[at..at + 4].copy_from_slice(&joints.map(|joint| joint.min(u16::MAX.into()) as u16));
            mesh.joint_weights[at..at + 4].copy_from_slice(&weights.map(|weight| weight.max(0.0)));
            below += weights.iter().filter(|weight| **weight < 0.0).count();
        }
    }
    if below > 0 {
        file.note(primitive, format!("weights of joints below 0, taken for 0: {below}"));
    }
    for weights in mesh.joint_weights[first..].chunks_exact_mut(each.max(1)).filter(|_| sets > 0) {
        // The sum of quantised weights is not quite 1; if all weights are 0, the vertex follows its first joint.
        match weights.iter().copied().map(f64::from).sum::<f64>() {
            sum if sum > 0.0 => weights.iter_mut().for_each(|weight| *weight = (f64::from(*weight) / sum) as f32),
            _ => weights[0] = 1.0,
        }
    }
    Ok(())
}

impl GltfMesh {
    /// Iterates over the joints that a vertex follows, and their weights.
    fn joints_of(&self, vertex: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = vertex * self.joints_per_vertex..(vertex + 1) * self.joints_per_vertex;
        let joints = self.joints[range.clone()].iter().zip(&self.joint_weights[range]);
        joints.filter(|(_, weight)| **weight > 0.0).map(|(joint, weight)| (usize::from(*joint), *weight))
    }

    /// Iterates over the joints that vertices follow, and their weights; a joint may come many times.
    pub(super) fn followed(&self) -> impl Iterator<Item = (usize, f32)> {
        (0..self.joint_weights.len() / self.joints_per_vertex.max(1)).flat_map(|vertex| self.joints_of(vertex))
    }

    /// Returns the matrix of a vertex where joints have these; the identity if it follows none.
    pub(super) fn blend(&self, vertex: usize, joints: &[DMat4]) -> DMat4 {
        let mut sum = DMat4::ZERO;
        let mut total = 0.0;
        for (joint, weight) in self.joints_of(vertex).map(|(joint, weight)| (joint, f64::from(weight))) {
            sum += joints[joint] * weight;
            total += weight;
        }
        // Rounded weights do not sum to 1 exactly.
        if total > 0.0 { sum / total } else { DMat4::IDENTITY }
    }
}
