//! Twins, targets that mirror each other by name: their symmetry, and their positions in an order.

use super::geometry::tree;
use super::order::Order;
use crate::render::scenery::bounds;
use deltamorph::MorphMesh;
use glam::Vec3;
use serde::Serialize;

/// Positions of twins in an order.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Twins {
    pub pairs: usize,
    /// Pairs with no other target between them.
    pub side_by_side: usize,
    /// The other pairs.
    pub apart: Vec<Apart>,
}

/// A pair that is not side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Apart {
    pub names: [String; 2],
    /// Targets between the two.
    pub between: usize,
    /// The larger score over the smaller one, minus 1: infinite (in JSON null) if the smaller is 0.
    pub scores_differ: f64,
    /// [`asymmetry`] of the two.
    pub deltas_differ: f64,
}

/// Two targets of a mesh, and their deviation from mirror symmetry.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    pub targets: [usize; 2],
    pub asymmetry: f64,
}

/// The x of the face's plane of symmetry: the middle of the base pose.
pub fn middle(mesh: &MorphMesh) -> f32 {
    let (low, high) = bounds(mesh.positions.iter().copied());
    if low.x <= high.x { (low.x + high.x) / 2.0 } else { 0.0 }
}

/// The name of the target on the other side of the face, for names with a side.
fn twin_of(name: &str) -> Option<String> {
    let swap = |from: &str, to: &str| name.ends_with(from).then(|| format!("{}{to}", &name[..name.len() - from.len()]));
    let inside = || name.contains("Left").then(|| name.replacen("Left", "Right", 1));
    swap("Left", "Right")
        .or_else(|| swap("_L", "_R"))
        .or_else(|| swap("_l", "_r"))
        .or_else(|| swap(".L", ".R"))
        .or_else(inside)
}

/// Pairs of `mesh` by name: …Left and …Right, …_L and …_R.
pub fn pairs(mesh: &MorphMesh) -> Vec<Pair> {
    let middle = middle(mesh);
    let named = |(left, target): (usize, &deltamorph::mesh::MorphTarget)| {
        Some([left, mesh.target_index(&twin_of(&target.name)?)?])
    };
    let found: Vec<[usize; 2]> = mesh.targets.iter().enumerate().filter_map(named).collect();
    let mut partner = vec![];
    if !found.is_empty() {
        let tree = tree(&mesh.positions);
        let across = |p: &Vec3| tree.nearest_neighbor([2.0 * middle - p.x, p.y, p.z]).map_or(0, |at| at.data);
        partner = mesh.positions.iter().map(across).collect();
    }
    let pair = |targets| Pair { targets, asymmetry: asymmetry(mesh, targets, &partner) };
    found.into_iter().map(pair).collect()
}

/// Deviation of two targets from mirror symmetry: the root mean square of the difference over that of the deltas; 0 if
/// they mirror each other exactly. `partner` of a vertex: the vertex nearest to its mirror image.
fn asymmetry(mesh: &MorphMesh, [left, right]: [usize; 2], partner: &[u32]) -> f64 {
    let dense = |target: usize| {
        let mut deltas = vec![Vec3::ZERO; mesh.vertex_count()];
        let target = &mesh.targets[target];
        target.vertices.iter().zip(&target.positions).for_each(|(&v, d)| deltas[v as usize] = *d);
        deltas
    };
    let square = |d: Vec3| d.as_dvec3().length_squared();
    let [left, right] = [left, right].map(dense);
    let flipped = |d: Vec3| Vec3::new(-d.x, d.y, d.z);
    let off: f64 = left.iter().zip(partner).map(|(d, &v)| square(flipped(*d) - right[v as usize])).sum();
    let all: f64 = left.iter().chain(&right).map(|d| square(*d)).sum();
    if all > 0.0 { (2.0 * off / all).sqrt() } else { 0.0 }
}

/// Positions of the `pairs` of `mesh` in `order`.
pub fn twins(mesh: &MorphMesh, pairs: &[Pair], order: &Order) -> Twins {
    let place = |name: &str| order.ranking.iter().position(|ranked| ranked.name == name);
    let apart = |pair: &Pair| {
        let names = pair.targets.map(|t| mesh.targets[t].name.clone());
        let (a, b) = (place(&names[0])?, place(&names[1])?);
        let between = a.abs_diff(b) - 1;
        let (most, least) = (order.ranking[a.min(b)].score, order.ranking[a.max(b)].score);
        let scores_differ = most.max(least) / most.min(least) - 1.0;
        (between > 0).then_some(Apart { names, between, scores_differ, deltas_differ: pair.asymmetry })
    };
    let apart: Vec<Apart> = pairs.iter().filter_map(apart).collect();
    Twins { pairs: pairs.len(), side_by_side: pairs.len() - apart.len(), apart }
}

/// The mirror image of `mesh` at the plane x = `middle`. Corners of faces keep their order: drawing has to reverse
/// them.
pub fn mirrored(mesh: &MorphMesh, middle: f32) -> MorphMesh {
    let mut mesh = mesh.clone();
    let turned = |vectors: &mut Vec<Vec3>| vectors.iter_mut().for_each(|v| v.x = -v.x);
    mesh.positions.iter_mut().for_each(|p| p.x = 2.0 * middle - p.x);
    turned(&mut mesh.normals);
    for target in &mut mesh.targets {
        turned(&mut target.positions);
        turned(&mut target.normals);
    }
    mesh
}

/// Rotates each face to begin at the corner nearest to the plane x = `middle`, of several at the lowest and hindmost.
/// The mirror image of a fan of triangles is then the fan of the mirror image.
pub fn align_faces(mesh: &mut MorphMesh, middle: f32) {
    let positions = &mesh.positions;
    let key = |v: u32| {
        let p = positions[v as usize];
        [(p.x - middle).abs(), p.y, p.z]
    };
    let mut rest = &mut mesh.faces.corners[..];
    for &size in &mesh.faces.sizes {
        let (face, others) = rest.split_at_mut(size as usize);
        let lowest = |a: &usize, b: &usize| {
            let [a, b] = [*a, *b].map(|corner| key(face[corner].position));
            a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2]))
        };
        let first = (0..face.len()).min_by(lowest).unwrap_or_default();
        face.rotate_left(first);
        rest = others;
    }
}
