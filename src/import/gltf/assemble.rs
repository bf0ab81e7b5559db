//! Merges several meshes into one, and transforms meshes as nodes and joints place them. Vertices have one texture
//! coordinate or none.

use crate::asset::{Corner, Mesh, MorphTarget, Semantic, StreamData, StreamDeltas};
use crate::error::Error;
use glam::{DMat3, DMat4, Vec2, Vec3};
use std::collections::{BTreeSet, HashMap};
use std::path::Path;

/// Says where in a file a value is that the library refuses.
pub fn in_file(path: &Path, place: &str) -> impl Fn(Error) -> Error {
    move |error| {
        let Error::Invalid { what, remedy } = error else { return error };
        Error::input(path, place, what, &remedy)
    }
}

/// The value of a stream for vertices of parts without it.
fn default_of(semantic: Semantic) -> &'static [f32] {
    match semantic {
        Semantic::Position | Semantic::Normal => &[0.0; 3],
        Semantic::Tangent => &[1.0, 0.0, 0.0, 1.0],
        Semantic::TexCoord(_) | Semantic::Mask => &[0.0; 2],
        Semantic::Color(_) => &[1.0; 4],
    }
}

pub fn semantics<'a>(parts: impl Iterator<Item = &'a Mesh>) -> BTreeSet<Semantic> {
    parts.flat_map(|part| &part.streams).map(|stream| stream.semantic).collect()
}

/// Returns the bytes of `part` in a mesh with these streams: each vertex has all of them, and each target lists of
/// their deltas, if only empty ones. Welding takes as much as a vertex without streams.
pub fn size_in(part: &Mesh, semantics: &BTreeSet<Semantic>) -> usize {
    let numbers: usize = semantics.iter().map(|semantic| semantic.components()).sum();
    let vertex = 2 * (2 * size_of::<Vec3>() + size_of::<Vec2>() + size_of::<u32>()) + numbers * size_of::<f32>();
    let of_target = |target: &MorphTarget| {
        let streams: usize = target.streams.iter().map(|s| size_of_val(&*s.vertices) + size_of_val(&*s.deltas)).sum();
        let normals = size_of_val(target.normals.as_deref().unwrap_or_default());
        let lists = size_of::<MorphTarget>() + semantics.len() * size_of::<StreamDeltas>() + 2 * target.name.len();
        lists + size_of_val(&*target.positions) + normals + streams
    };
    let faces = size_of_val(&*part.faces.corners) + size_of_val(&*part.faces.sizes);
    part.positions.len() * vertex + faces + part.targets.iter().map(of_target).sum::<usize>()
}

/// Merges `parts` into one mesh: their vertices one after the other; targets of one name move together. If a part has
/// no normals, those of all parts are computed.
pub fn merge(name: String, parts: Vec<Mesh>) -> Mesh {
    let with_normals = parts.iter().all(|part| part.normals.is_some());
    let with_texcoords = parts.iter().any(|part| !part.texcoords.is_empty());
    let semantics = semantics(parts.iter());
    let mut all = Mesh { name, normals: with_normals.then(Vec::new), ..Mesh::default() };
    if !with_normals && parts.iter().any(|part| part.normals.is_some()) {
        all.notes.push("normals are there for some primitives or meshes only: computed for all".to_owned());
    }
    all.streams = semantics.iter().map(|&semantic| StreamData { semantic, values: vec![] }).collect();
    let mut places: HashMap<String, usize> = HashMap::new();
    for part in parts {
        let first = all.positions.len() as u32;
        let count = part.positions.len();
        let texcoord = |v: u32| with_texcoords.then_some(v);
        all.positions.extend(part.positions);
        if let (Some(all), Some(normals)) = (&mut all.normals, part.normals) {
            all.extend(normals);
        }
        if with_texcoords {
            all.texcoords.extend(part.texcoords);
            all.texcoords.resize(all.positions.len(), Vec2::ZERO);
        }
        let corners = part.faces.corners.iter().map(|c| c.position + first);
        all.faces.corners.extend(corners.map(|position| Corner { position, texcoord: texcoord(position) }));
        all.faces.sizes.extend(part.faces.sizes);
        all.welds.extend(part.welds.iter().map(|v| v + first));
        let of_all: Vec<usize> =
            part.streams.iter().filter_map(|s| semantics.iter().position(|o| *o == s.semantic)).collect();
        for stream in &mut all.streams {
            match part.streams.iter().find(|own| own.semantic == stream.semantic) {
                Some(own) => stream.values.extend(&own.values),
                None => stream.values.extend(std::iter::repeat_n(default_of(stream.semantic), count).flatten()),
            }
        }
        for target in part.targets {
            let place = *places.entry(target.name.clone()).or_insert(all.targets.len());
            if place == all.targets.len() {
                let streams = vec![StreamDeltas::default(); semantics.len()];
                let normals = with_normals.then(Vec::new);
                all.targets.push(MorphTarget { name: target.name, positions: vec![], normals, streams });
            }
            let one = &mut all.targets[place];
            let moved = |list: Vec<(u32, Vec3)>| list.into_iter().map(move |(v, delta)| (v + first, delta));
            one.positions.extend(moved(target.positions));
            one.normals = one.normals.take().zip(target.normals).map(|(mut normals, more)| {
                normals.extend(moved(more));
                normals
            });
            for (place, StreamDeltas { vertices, deltas }) in of_all.iter().zip(target.streams) {
                let stream = &mut one.streams[*place];
                stream.vertices.extend(vertices.iter().map(|v| v + first));
                stream.deltas.extend(deltas);
            }
        }
        all.notes.extend(part.notes);
    }
    all
}

/// Whether there is no way back from `matrix`: it flattens a mesh, or leaves the range of numbers.
pub fn flattens(matrix: &DMat4) -> bool {
    let determinant = DMat3::from_mat4(*matrix).determinant();
    !(determinant != 0.0 && determinant.is_finite() && matrix.is_finite())
}

/// Transforms a mesh of triangles, each vertex by its own matrix: normals by the inverse transpose, brought to unit
/// length again; where a matrix mirrors, triangles are turned. Returns the first vertex whose matrix is flat: a normal
/// across what is left of it stays as it was.
pub fn transform(source: &mut Mesh, matrix: impl Fn(usize) -> DMat4) -> Option<usize> {
    let count = source.positions.len();
    if (0..count).all(|v| matrix(v) == DMat4::IDENTITY) {
        return None;
    }
    let linear = |v: usize| DMat3::from_mat4(matrix(v));
    // The inverse transpose times the size of the determinant, which need not be other than 0.
    let turned = |v: usize| {
        let DMat3 { x_axis: x, y_axis: y, z_axis: z } = linear(v);
        let sign = if linear(v).determinant() < 0.0 { -1.0 } else { 1.0 };
        DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * sign
    };
    // A direction that a matrix moves, at unit length again. The factor is added to the others; 0 if the direction is
    // lost, and stays as it was.
    let turn = |stated: Vec3, matrix: DMat3, scales: &mut Vec<f64>| {
        let moved = matrix * stated.as_dvec3();
        let scale = moved.length().recip();
        let is_kept = scale > 0.0 && scale.is_finite();
        scales.push(if is_kept { scale } else { 0.0 });
        if is_kept { (moved * scale).as_vec3() } else { stated }
    };
    for (v, p) in source.positions.iter_mut().enumerate() {
        *p = matrix(v).transform_point3(p.as_dvec3()).as_vec3();
    }
    let mut scales = vec![];
    for (v, normal) in source.normals.iter_mut().flatten().enumerate() {
        *normal = turn(*normal, turned(v), &mut scales);
    }
    for target in &mut source.targets {
        target.positions.iter_mut().for_each(|(v, d)| *d = (linear(*v as usize) * d.as_dvec3()).as_vec3());
        let normals = target.normals.iter_mut().flatten().map(|(v, d)| (*v as usize, d));
        normals.for_each(|(v, d)| *d = (turned(v) * d.as_dvec3() * scales[v]).as_vec3());
    }
    if let Some(tangents) = source.streams.iter().position(|s| s.semantic == Semantic::Tangent) {
        let mut scales = vec![];
        for (v, tangent) in source.streams[tangents].values.chunks_exact_mut(4).enumerate() {
            let moved = turn(Vec3::from_slice(tangent), linear(v), &mut scales);
            tangent[..3].copy_from_slice(&moved.to_array());
            tangent[3] *= if linear(v).determinant() < 0.0 { -1.0 } else { 1.0 };
        }
        for StreamDeltas { vertices, deltas } in source.targets.iter_mut().filter_map(|t| t.streams.get_mut(tangents)) {
            for (v, delta) in vertices.iter().map(|v| *v as usize).zip(deltas.chunks_exact_mut(3)) {
                let moved = linear(v) * Vec3::from_slice(delta).as_dvec3() * scales[v];
                delta.copy_from_slice(&moved.as_vec3().to_array());
            }
        }
    }
    let mirrored = |corners: &&mut [Corner]| linear(corners[0].position as usize).determinant() < 0.0;
    source.faces.corners.chunks_exact_mut(3).filter(mirrored).for_each(|corners| corners.swap(1, 2));
    (0..count).find(|v| flattens(&matrix(*v)))
}
