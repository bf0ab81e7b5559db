//! Merges several meshes into one, and transforms meshes as nodes place them. Vertices have one texture coordinate or
//! none.

use crate::asset::{Corner, MorphSource, Semantic, SourceTarget, StreamData, StreamDeltas};
use glam::{BVec3, DMat3, DMat4, DVec3, Vec2, Vec3};
use std::collections::{BTreeSet, HashMap, HashSet};

/// The value of a stream for vertices of parts without it.
fn default_of(semantic: Semantic) -> &'static [f32] {
    match semantic {
        Semantic::Position | Semantic::Normal => &[0.0; 3],
        Semantic::Tangent => &[1.0, 0.0, 0.0, 1.0],
        Semantic::TexCoord(_) | Semantic::Mask => &[0.0; 2],
        Semantic::Color(_) => &[1.0; 4],
    }
}

/// Returns the bytes that [`merge`] takes for `parts`: a vertex whose part lacks a stream of another part gets it, and
/// each target has deltas of all streams, if only empty ones.
pub fn merged_size(parts: &[MorphSource]) -> u64 {
    let semantics: BTreeSet<Semantic> = parts.iter().flat_map(|part| &part.streams).map(|s| s.semantic).collect();
    let numbers: usize = semantics.iter().map(|semantic| semantic.components()).sum();
    let names: HashSet<&str> = parts.iter().flat_map(|part| &part.targets).map(|target| target.name.as_str()).collect();
    let vertex = 2 * size_of::<Vec3>() + size_of::<Vec2>() + size_of::<u32>() + numbers * size_of::<f32>();
    let target = size_of::<SourceTarget>() + semantics.len() * size_of::<StreamDeltas>();
    let faces = |part: &MorphSource| size_of_val(&*part.faces.corners) + size_of_val(&*part.faces.sizes);
    let of_parts = parts.iter().map(|part| part.positions.len() as u64 * vertex as u64 + faces(part) as u64);
    of_parts.chain(names.iter().map(|name| (target + 2 * name.len()) as u64)).sum()
}

/// Merges `parts` into one mesh: their vertices one after the other; targets of one name move together. If a part has
/// no normals, those of all parts are computed.
pub fn merge(name: String, parts: Vec<MorphSource>) -> MorphSource {
    let with_normals = parts.iter().all(|part| part.normals.is_some());
    let with_texcoords = parts.iter().any(|part| !part.texcoords.is_empty());
    let semantics: BTreeSet<Semantic> = parts.iter().flat_map(|part| &part.streams).map(|s| s.semantic).collect();
    let mut all = MorphSource { name, normals: with_normals.then(Vec::new), ..MorphSource::default() };
    if !with_normals && parts.iter().any(|part| part.normals.is_some()) {
        all.notes.push("normals are there for some primitives or meshes only: computed for all".to_owned());
    }
    all.streams = semantics.iter().map(|&semantic| StreamData { semantic, values: vec![] }).collect();
    let mut places: HashMap<String, usize> = HashMap::new();
    for part in parts {
        let (first, count) = (all.positions.len() as u32, part.positions.len());
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
        for (place, stream) in all.streams.iter_mut().enumerate() {
            match of_all.iter().position(|at| *at == place) {
                Some(own) => stream.values.extend(&part.streams[own].values),
                None => stream.values.extend(std::iter::repeat_n(default_of(stream.semantic), count).flatten()),
            }
        }
        for target in part.targets {
            let place = *places.entry(target.name.clone()).or_insert(all.targets.len());
            if place == all.targets.len() {
                let streams = vec![StreamDeltas::default(); semantics.len()];
                let normals = with_normals.then(Vec::new);
                all.targets.push(SourceTarget { name: target.name, positions: vec![], normals, streams });
            }
            let one = &mut all.targets[place];
            let moved = |list: Vec<(u32, Vec3)>| list.into_iter().map(move |(v, delta)| (v + first, delta));
            one.positions.extend(moved(target.positions));
            one.normals = one.normals.take().zip(target.normals).map(|(mut normals, more)| {
                normals.extend(moved(more));
                normals
            });
            for (own, StreamDeltas { vertices, deltas }) in target.streams.into_iter().enumerate() {
                let stream = &mut one.streams[of_all[own]];
                stream.vertices.extend(vertices.iter().map(|v| v + first));
                stream.deltas.extend(deltas);
            }
        }
        all.notes.extend(part.notes);
    }
    all
}

/// Returns the common value of these matrices, if they agree within 1e-4 of the extent of the positions.
pub fn common(matrices: &[DMat4], positions: &[Vec3]) -> Option<DMat4> {
    let low = positions.iter().copied().reduce(Vec3::min)?.as_dvec3();
    let high = positions.iter().copied().reduce(Vec3::max)?.as_dvec3();
    let corner = |i: u32| DVec3::select(BVec3::new(i & 1 == 0, i & 2 == 0, i & 4 == 0), low, high);
    let (first, others) = matrices.split_first()?;
    let extent = first.transform_point3(low).distance(first.transform_point3(high));
    let is_near =
        |matrix: &DMat4, p: DVec3| first.transform_point3(p).distance(matrix.transform_point3(p)) <= 1e-4 * extent;
    others.iter().all(|matrix| (0..8).all(|i| is_near(matrix, corner(i)))).then_some(*first)
}

/// Transforms a mesh of triangles by `matrix`: normals by the inverse transpose, brought to unit length again; if it
/// mirrors the mesh, triangles are turned. Returns `false`, and changes nothing, if `matrix` flattens the mesh.
pub fn transform(source: &mut MorphSource, matrix: &DMat4) -> bool {
    let linear = DMat3::from_mat4(*matrix);
    let determinant = linear.determinant();
    if !(determinant != 0.0 && determinant.is_finite() && matrix.is_finite()) {
        return false;
    }
    let turned = linear.inverse().transpose();
    let apply = |by: &DMat3, v: Vec3| (*by * v.as_dvec3()).as_vec3();
    source.positions.iter_mut().for_each(|p| *p = matrix.transform_point3(p.as_dvec3()).as_vec3());
    let mut scales = vec![];
    for normal in source.normals.iter_mut().flatten() {
        let moved = turned * normal.as_dvec3();
        scales.push(moved.length().recip());
        *normal = (moved * moved.length().recip()).as_vec3();
    }
    for target in &mut source.targets {
        target.positions.iter_mut().for_each(|(_, d)| *d = apply(&linear, *d));
        let normals = target.normals.iter_mut().flatten();
        normals.for_each(|(v, d)| *d = (turned * d.as_dvec3() * scales[*v as usize]).as_vec3());
    }
    if let Some(tangents) = source.streams.iter().position(|s| s.semantic == Semantic::Tangent) {
        let mut scales = vec![];
        for tangent in source.streams[tangents].values.chunks_exact_mut(4) {
            let moved = linear * Vec3::from_slice(tangent).as_dvec3();
            scales.push(moved.length().recip());
            tangent[..3].copy_from_slice(&(moved * moved.length().recip()).as_vec3().to_array());
            tangent[3] *= determinant.signum() as f32;
        }
        for StreamDeltas { vertices, deltas } in source.targets.iter_mut().filter_map(|t| t.streams.get_mut(tangents)) {
            for (v, delta) in vertices.iter().zip(deltas.chunks_exact_mut(3)) {
                let moved = linear * Vec3::from_slice(delta).as_dvec3() * scales[*v as usize];
                delta.copy_from_slice(&moved.as_vec3().to_array());
            }
        }
    }
    if determinant < 0.0 {
        source.faces.corners.chunks_exact_mut(3).for_each(|corners| corners.swap(1, 2));
    }
    true
}
