//! Writing a mesh and its targets as GLB.

mod buffer;
mod encode;
#[cfg(test)]
mod tests;

use crate::asset::{MorphMesh, Semantic};
use crate::error::{Error, Result};
use crate::math::{angle_degrees, diagonal};
use crate::pack::{check, vertex_order};
use crate::setters::setters;
use buffer::{Buffer, Component, Elements, Use};
use glam::{DVec3, Vec2, Vec3};
use serde_json::{Map, Value, json};

/// How [`to_glb`] stores a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum GlbEncoding {
    /// 32-bit floats, sparse where that takes less. Every program that reads glTF 2.0 reads it, and nothing is rounded.
    #[default]
    Float,
    /// Integers of 8 and 16 bits, sparse where that takes less; requires KHR_mesh_quantization.
    Quantized,
    /// Quantised and compressed, in an order of vertices and triangles that compresses well; requires
    /// EXT_meshopt_compression, too.
    Meshopt,
}

/// Options of [`to_glb`]. The errors are those that quantisation may make, each at weight 1; floats make none.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct GlbDesc {
    /// How numbers are stored.
    pub encoding: GlbEncoding,
    /// Largest error of a base position and of a position delta (a length), as a fraction of the bounding-box diagonal;
    /// positive.
    pub position_error: f32,
    /// Largest error of a normal or tangent with one target, in degrees; positive. Where a target turns one right
    /// round, as in folds, it may be larger.
    pub normal_error_degrees: f32,
    /// Texture coordinates of the faces begin at the bottom left, as in OBJ files: v becomes 1 − v, since those of glTF
    /// begin at the top left. `false` by default.
    pub flip_texcoords: bool,
}

setters!(GlbDesc { encoding: GlbEncoding, position_error: f32, normal_error_degrees: f32, flip_texcoords: bool });

impl Default for GlbDesc {
    /// Floats; when quantised, 1e-5 of the diagonal and 0.5°, as packing allows by default.
    fn default() -> Self {
        let encoding = GlbEncoding::default();
        Self { encoding, position_error: 1e-5, normal_error_degrees: 0.5, flip_texcoords: false }
    }
}

/// What [`to_glb`] returns.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Glb {
    /// The file.
    pub bytes: Vec<u8>,
    /// The vertex of the mesh that each vertex of the file is: those of the mesh in their order, then those that seams
    /// of texture coordinates double; in another order with [`GlbEncoding::Meshopt`].
    pub vertices: Vec<u32>,
    /// What the file does not hold, for the user.
    pub notes: Vec<String>,
}

/// Writes a mesh as a binary glTF 2.0 file of one node, with the names of the targets in `extras.targetNames`.
///
/// A target that moves nothing has one delta of zero. [`MorphMesh::origin`] becomes the translation of the node; quantised
/// positions are whole multiples of a step, the scale of the node. Wrinkle masks are left out.
///
/// # Errors
/// [`Error::Invalid`] if the mesh has no triangles, or is not as [`MorphSource::to_mesh`](crate::MorphSource::to_mesh)
/// makes it; a number of `desc` is out of range; the file would have more than 4 GiB.
pub fn to_glb(mesh: &MorphMesh, desc: &GlbDesc) -> Result<Glb> {
    let refuse = |what: String| {
        Error::invalid(format!("mesh '{}': {what}", mesh.name), "make the mesh with MorphSource::to_mesh")
    };
    check(mesh).map_err(refuse)?;
    for (error, what) in [(desc.position_error, "position"), (desc.normal_error_degrees, "normal")] {
        if !(error > 0.0 && error.is_finite()) {
            return Err(Error::invalid(format!("a {what} error of {error}"), "give a positive number"));
        }
    }
    let mut render = mesh.faces.render_vertices(mesh.vertex_count(), &mesh.texcoords)?;
    if render.indices.is_empty() {
        return Err(Error::invalid(format!("mesh '{}' has no faces", mesh.name), "glTF draws triangles: give it some"));
    }
    if desc.encoding == GlbEncoding::Meshopt {
        reorder(mesh, &mut render.pose_vertices, &mut render.texcoords, &mut render.indices);
    }
    let mut file = File { mesh, desc, vertices: render.pose_vertices, buffer: Buffer::new(desc.encoding) };
    let mut attributes = Map::new();
    let mut targets = vec![Map::new(); mesh.targets.len()];
    let node = file.positions(&mut attributes, &mut targets);
    file.directions(Semantic::Normal, "NORMAL", &mut attributes, &mut targets);
    file.streams(&render.texcoords, &mut attributes, &mut targets);
    let indices = file.buffer.indices(&render.indices, file.vertices.len());
    let mut primitive = json!({"attributes": attributes, "indices": indices});
    let mut of_mesh = json!({"name": mesh.name});
    if !targets.is_empty() {
        primitive["targets"] = json!(targets);
        let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
        of_mesh["extras"] = json!({"targetNames": names});
    }
    of_mesh["primitives"] = json!([primitive]);
    let has_masks = mesh.streams.iter().any(|stream| stream.semantic == Semantic::Mask);
    let notes = if has_masks { vec!["glTF has no wrinkle masks: left out".to_owned()] } else { vec![] };
    let bytes =
        file.buffer.glb(json!({"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [node], "meshes": [of_mesh]}))?;
    Ok(Glb { bytes, vertices: file.vertices, notes })
}

/// Puts vertices that the same targets move beside each other, and triangles in the order of their vertices.
fn reorder(mesh: &MorphMesh, vertices: &mut [u32], texcoords: &mut [Vec2], indices: &mut [u32]) {
    let mut rank = vec![0; mesh.vertex_count()];
    vertex_order(mesh).into_iter().zip(0u32..).for_each(|(v, at)| rank[v as usize] = at);
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.sort_by_key(|at| rank[vertices[*at as usize] as usize]);
    let (old, old_texcoords) = (vertices.to_vec(), texcoords.to_vec());
    let mut place = vec![0; vertices.len()];
    for (new, &at) in order.iter().enumerate() {
        (vertices[new], texcoords[new]) = (old[at as usize], old_texcoords[at as usize]);
        place[at as usize] = new as u32;
    }
    indices.iter_mut().for_each(|v| *v = place[*v as usize]);
    indices.as_chunks_mut::<3>().0.sort_by_key(|triangle| *triangle.iter().min().unwrap_or(&0));
}

struct File<'a> {
    mesh: &'a MorphMesh,
    desc: &'a GlbDesc,
    /// The vertex of the mesh that each vertex of the file is.
    vertices: Vec<u32>,
    buffer: Buffer,
}

type Attributes = Map<String, Value>;

impl File<'_> {
    fn is_quantized(&self) -> bool {
        self.desc.encoding != GlbEncoding::Float
    }

    /// The values of a stream, of `N` numbers for each vertex of the file.
    fn base<const N: usize>(&self, values: &[f32]) -> Vec<[f32; N]> {
        let all = values.as_chunks::<N>().0;
        self.vertices.iter().map(|&v| all[v as usize]).collect()
    }

    /// The deltas of a stream that are not zero, and the vertices of the file that they move, ascending.
    fn deltas<const N: usize>(&self, target: usize, semantic: Semantic) -> (Vec<u32>, Vec<[f32; N]>) {
        let (moved, deltas) = self.mesh.deltas(&self.mesh.targets[target], semantic);
        let mut of = vec![[0.0; N]; self.mesh.vertex_count()];
        moved.iter().zip(deltas.as_chunks::<N>().0).for_each(|(v, delta)| of[*v as usize] = *delta);
        let all = self.vertices.iter().enumerate().map(|(at, v)| (at as u32, of[*v as usize]));
        all.filter(|(_, delta)| *delta != [0.0; N]).unzip()
    }

    /// Adds positions; returns the node that puts them in place.
    fn positions(&mut self, attributes: &mut Attributes, targets: &mut [Attributes]) -> Value {
        let mesh = self.mesh;
        let mut origin = mesh.origin.as_dvec3();
        let base: Vec<Vec3> = self.base(bytemuck::cast_slice(&mesh.positions)).into_iter().map(Vec3::from).collect();
        // Rounding moves each of three components by half a step at most.
        let step = f64::from(self.desc.position_error) * f64::from(diagonal(&mesh.positions)) * 2.0 / 3f64.sqrt();
        let step = if self.is_quantized() && (step as f32).is_normal() { f64::from(step as f32) } else { 1.0 };
        let low = base.iter().copied().reduce(Vec3::min).unwrap_or_default().as_dvec3();
        let whole: Vec<DVec3> = base.iter().map(|p| ((p.as_dvec3() - low) / step).round()).collect();
        let mut component = Component::F32;
        let mut stored: Vec<Vec3> = base.iter().map(|p| (p.as_dvec3() / step).as_vec3()).collect();
        if self.is_quantized() && whole.iter().all(|p| p.max_element() <= 65535.0) {
            component = Component::U16;
            stored = whole.iter().map(|p| p.as_vec3()).collect();
            origin += low;
        }
        let elements = Elements::of(bytemuck::cast_slice(&stored), 3, component);
        attributes.insert("POSITION".into(), self.buffer.dense(&elements.bounded(), Use::Attribute));
        for (target, attributes) in targets.iter_mut().enumerate() {
            let (mut moved, mut deltas) = self.deltas::<3>(target, Semantic::Position);
            let mut component = Component::F32;
            if self.is_quantized() {
                let whole = deltas.iter().map(|d| d.map(|x| (f64::from(x) / step).round() as f32));
                let kept = moved.iter().copied().zip(whole).filter(|(_, d)| *d != [0.0; 3]);
                let (places, whole): (Vec<u32>, Vec<[f32; 3]>) = kept.unzip();
                let largest = whole.as_flattened().iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
                component = Component::signed(largest);
                if component == Component::F32 {
                    deltas.as_flattened_mut().iter_mut().for_each(|x| *x = (f64::from(*x) / step) as f32);
                } else {
                    (moved, deltas) = (places, whole);
                }
            }
            let elements = Elements::of(deltas.as_flattened(), 3, component).bounded();
            attributes.insert("POSITION".into(), self.buffer.sparse(&elements, &moved, self.vertices.len()));
        }
        let mut node = json!({"name": mesh.name, "mesh": 0});
        if origin != DVec3::ZERO {
            node["translation"] = json!(origin.as_vec3().to_array());
        }
        if step != 1.0 {
            node["scale"] = json!([step, step, step]);
        }
        node
    }

    /// Adds normals or tangents: what targets add in bytes, or 16 bits where bytes would turn them further than is
    /// allowed.
    fn directions(&mut self, semantic: Semantic, name: &str, attributes: &mut Attributes, targets: &mut [Attributes]) {
        let mesh = self.mesh;
        let width = semantic.components();
        let all = mesh.values(semantic);
        let base: Vec<DVec3> = self.vertices.iter().map(|&v| vector(&all[v as usize * width..])).collect();
        // 16 bits for the base: where a target turns it round, little is left of the two to be off.
        let [component, finest] =
            if self.is_quantized() { [Component::Unit8, Component::Unit16] } else { [Component::F32; 2] };
        let stored: Vec<f32> =
            self.vertices.iter().flat_map(|&v| &all[v as usize * width..][..width]).copied().collect();
        attributes.insert(name.into(), self.buffer.dense(&Elements::of(&stored, width, finest), Use::Attribute));
        for (target, attributes) in targets.iter_mut().enumerate() {
            let (moved, mut deltas) = self.deltas::<3>(target, semantic);
            let mut worst = 0.0f64;
            for (v, d) in moved.iter().zip(&mut deltas).filter(|_| component != Component::F32) {
                let before = base[*v as usize];
                let delta = shortened(before, Vec3::from(*d).as_dvec3());
                worst = worst.max(angle_degrees(before + delta, before + delta.map(|x| component.rounded(x))));
                *d = delta.as_vec3().to_array();
            }
            let component = if worst <= f64::from(self.desc.normal_error_degrees) { component } else { finest };
            let kept = moved.into_iter().zip(deltas);
            let kept = kept.filter(|(_, d)| d.iter().any(|x| component.rounded(f64::from(*x)) != 0.0));
            let (moved, deltas): (Vec<u32>, Vec<[f32; 3]>) = kept.unzip();
            let elements = Elements::of(deltas.as_flattened(), 3, component);
            attributes.insert(name.into(), self.buffer.sparse(&elements, &moved, self.vertices.len()));
        }
    }

    /// Adds tangents, texture coordinates and colours. `texcoords` are those of the faces.
    fn streams(&mut self, texcoords: &[Vec2], attributes: &mut Attributes, targets: &mut [Attributes]) {
        let mesh = self.mesh;
        let has_set = mesh.streams.iter().any(|stream| stream.semantic == Semantic::TexCoord(0));
        if !mesh.texcoords.is_empty() && !has_set {
            let placed = |t: &Vec2| if self.desc.flip_texcoords { [t.x, 1.0 - t.y] } else { t.to_array() };
            let texcoords: Vec<[f32; 2]> = texcoords.iter().map(placed).collect();
            self.texcoords("TEXCOORD_0", texcoords.as_flattened(), attributes);
        }
        for stream in &mesh.streams {
            match stream.semantic {
                Semantic::Position | Semantic::Normal | Semantic::Mask => {}
                Semantic::Tangent => self.directions(Semantic::Tangent, "TANGENT", attributes, targets),
                Semantic::TexCoord(set) => {
                    self.stream::<2>(stream.semantic, &format!("TEXCOORD_{set}"), attributes, targets)
                }
                Semantic::Color(set) => self.stream::<4>(stream.semantic, &format!("COLOR_{set}"), attributes, targets),
            }
        }
    }

    /// Texture coordinates that no target changes: quantised where they are from 0 to 1.
    fn texcoords(&mut self, name: &str, values: &[f32], attributes: &mut Attributes) {
        let fits = self.is_quantized() && values.iter().all(|x| (0.0..=1.0).contains(x));
        let component = if fits { Component::UnitU16 } else { Component::F32 };
        attributes.insert(name.into(), self.buffer.dense(&Elements::of(values, 2, component), Use::Attribute));
    }

    fn stream<const N: usize>(
        &mut self,
        semantic: Semantic,
        name: &str,
        attributes: &mut Attributes,
        targets: &mut [Attributes],
    ) {
        let base = self.base::<N>(self.mesh.values(semantic));
        let deltas: Vec<_> = (0..targets.len()).map(|target| self.deltas::<N>(target, semantic)).collect();
        let moves = deltas.iter().any(|(moved, _)| !moved.is_empty());
        if N == 2 && !moves {
            return self.texcoords(name, base.as_flattened(), attributes);
        }
        let elements = Elements::of(base.as_flattened(), N, Component::F32);
        attributes.insert(name.into(), self.buffer.dense(&elements, Use::Attribute));
        for (attributes, (moved, deltas)) in targets.iter_mut().zip(deltas).filter(|_| moves) {
            let elements = Elements::of(deltas.as_flattened(), N, Component::F32);
            attributes.insert(name.into(), self.buffer.sparse(&elements, &moved, self.vertices.len()));
        }
    }
}

fn vector(numbers: &[f32]) -> DVec3 {
    Vec3::from_slice(numbers).as_dvec3()
}

/// What `delta` makes of the direction `base`, in the same direction but not as long, so that no component of the delta
/// is beyond 1: normalised integers end there.
fn shortened(base: DVec3, delta: DVec3) -> DVec3 {
    let sum = base + delta;
    let limit = |c: usize| if delta[c].abs() > 1.0 { (base[c] + delta[c].signum()) / sum[c] } else { 1.0 };
    let scale = (0..3).map(limit).fold(1.0, f64::min);
    if scale < 1.0 { sum * scale - base } else { delta }
}
