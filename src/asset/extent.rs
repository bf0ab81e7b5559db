//! The length that tolerances and errors are fractions of: the size of what moves.
//!
//! The bounding box of a whole mesh says little about it if the mesh has a vertex far off, a floor, or two faces far
//! apart. So the mesh is divided into parts, connected by faces or by vertices at one position. Parts that no target
//! moves do not count. Parts near a larger one belong to it, as eyes and teeth to a face. The length is the diagonal of
//! the box around the smallest such group.

use super::{Faces, MorphTarget};
use crate::math::diagonal;
use glam::Vec3;
use std::collections::{BTreeMap, HashMap};

/// Deltas shorter than this fraction of the longest do not count as motion: files repeat still vertices with noise.
const MOVES: f64 = 1e-4;

/// Groups that a part is compared with; those found later hold only themselves.
const GROUPS_MAX: usize = 256;

/// A box around points.
#[derive(Clone, Copy)]
struct Bounds {
    low: Vec3,
    high: Vec3,
}

impl Bounds {
    fn with(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn diagonal(self) -> f64 {
        f64::from(diagonal(&[self.low, self.high]))
    }

    fn distance(self, other: Self) -> f64 {
        let gap = (self.low - other.high).max(other.low - self.high).max(Vec3::ZERO);
        gap.as_dvec3().length()
    }
}

/// Union of sets of vertices; each set is named by its lowest vertex.
struct Sets(Vec<u32>);

impl Sets {
    fn of(&mut self, mut vertex: u32) -> u32 {
        while self.0[vertex as usize] != vertex {
            let above = self.0[self.0[vertex as usize] as usize];
            self.0[vertex as usize] = above;
            vertex = above;
        }
        vertex
    }

    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [a, b].map(|vertex| self.of(vertex));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// Bounding boxes of the parts that a target moves.
fn moving_parts(positions: &[Vec3], faces: &Faces, targets: &[MorphTarget]) -> Vec<Bounds> {
    let deltas = || targets.iter().flat_map(|target| &target.positions);
    let longest = deltas().map(|(_, delta)| delta.as_dvec3().length()).fold(0.0, f64::max);
    if longest == 0.0 {
        return vec![];
    }
    let mut sets = Sets((0..positions.len() as u32).collect());
    let mut at = HashMap::new();
    for face in faces.iter() {
        for corner in face {
            sets.join(face[0].position, corner.position);
        }
    }
    for (vertex, position) in (0..).zip(positions) {
        // Adding 0 turns -0 into 0.
        let place = (*position + Vec3::ZERO).to_array().map(f32::to_bits);
        let first = *at.entry(place).or_insert(vertex);
        sets.join(first, vertex);
    }
    let mut moves = vec![false; positions.len()];
    for (vertex, delta) in deltas() {
        if delta.as_dvec3().length() > MOVES * longest {
            moves[sets.of(*vertex) as usize] = true;
        }
    }
    let mut parts: BTreeMap<u32, Bounds> = BTreeMap::new();
    for (vertex, position) in (0..).zip(positions) {
        let set = sets.of(vertex);
        if moves[set as usize] {
            let point = Bounds { low: *position, high: *position };
            let bounds = parts.entry(set).or_insert(point);
            *bounds = bounds.with(point);
        }
    }
    parts.into_values().collect()
}

/// The length that sizes of a mesh are fractions of, in input units: that of its smallest group of moving parts, or of
/// its whole bounding box if none moves or none has an extent. 0 if all vertices are at one position.
pub(super) fn extent(positions: &[Vec3], faces: &Faces, targets: &[MorphTarget]) -> f32 {
    let mut parts = moving_parts(positions, faces, targets);
    // Without faces no part has an extent: all that moves is one.
    if faces.corners.is_empty() {
        parts = parts.into_iter().reduce(Bounds::with).into_iter().collect();
    }
    parts.sort_by(|a, b| b.diagonal().total_cmp(&a.diagonal()));
    // The largest part of each group, and the box around all of its parts.
    let mut groups: Vec<(Bounds, Bounds)> = vec![];
    for part in parts.into_iter().filter(|part| part.diagonal() > 0.0) {
        let is_near = |(largest, _): &&mut (Bounds, Bounds)| largest.distance(part) <= largest.diagonal() / 2.0;
        match groups.iter_mut().take(GROUPS_MAX).find(is_near) {
            Some((_, all)) => *all = all.with(part),
            None => groups.push((part, part)),
        }
    }
    let sizes = groups.into_iter().map(|(_, all)| all.diagonal() as f32);
    sizes.min_by(f32::total_cmp).unwrap_or_else(|| diagonal(positions))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::{Corner, Mesh, Tolerance};

    /// Squares of unit side in the plane z = 0 at these corners, each with faces of its own. A target moves the first
    /// vertex of each of those `moved` by 0.01, and another, which is not kept, by 1e-9.
    fn squares(places: &[[f32; 2]], moved: &[usize]) -> Mesh {
        let vertex = |[x, y]: &[f32; 2], [dx, dy]: [f32; 2]| Vec3::new(x + dx, y + dy, 0.0);
        let square = |place: &[f32; 2]| [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|to| vertex(place, to));
        let positions: Vec<Vec3> = places.iter().flat_map(square).collect();
        let corners = (0..positions.len() as u32).map(|position| Corner { position, texcoord: None }).collect();
        let target = |name: &str, length: f32| MorphTarget {
            name: name.into(),
            positions: moved.iter().map(|square| (4 * *square as u32, Vec3::Z * length)).collect(),
            ..MorphTarget::default()
        };
        Mesh {
            name: "squares".into(),
            faces: Faces { sizes: vec![4; places.len()], corners },
            positions,
            targets: vec![target("large", 0.01), target("noise", 1e-9)],
            ..Mesh::default()
        }
    }

    #[test]
    fn sizes_are_fractions_of_what_moves() {
        let side = 2f32.sqrt();
        let row: Vec<[f32; 2]> = (0..50).map(|i| [4.0 * i as f32, 0.0]).collect();
        for (what, source, expected) in [
            ("one", squares(&[[0.0, 0.0]], &[0]), side),
            ("one far off that does not move", squares(&[[0.0, 0.0], [1e4, 0.0]], &[0]), side),
            ("two far apart", squares(&[[0.0, 0.0], [200.0, 0.0]], &[0, 1]), side),
            ("a row", squares(&row, &(0..50).collect::<Vec<_>>()), side),
            ("two side by side", squares(&[[0.0, 0.0], [1.5, 0.0]], &[0, 1]), 7.25f32.sqrt()),
            ("two that share a vertex's position", squares(&[[0.0, 0.0], [1.0, 1.0]], &[0]), 8f32.sqrt()),
            ("none moves", squares(&[[0.0, 0.0], [1.0, 0.0]], &[]), 5f32.sqrt()),
            (
                "no faces",
                Mesh { faces: Faces::default(), ..squares(&[[0.0, 0.0], [2.0, 0.0], [1e4, 0.0]], &[0, 1]) },
                2.0,
            ),
        ] {
            assert_eq!(extent(&source.positions, &source.faces, &source.targets), expected, "{what}");
        }
    }

    #[test]
    fn targets_that_the_tolerance_empties_are_named() {
        let mesh = squares(&[[0.0, 0.0]], &[0]).kept(Tolerance { normal: 1e-3, ..Default::default() }).unwrap();
        let [large, noise] = [0, 1].map(|target: usize| mesh.targets[target].vertices.len());
        assert!(large > 0 && noise == 0 && mesh.notes.len() == 1, "{large}, {noise}, {:?}", mesh.notes);
        assert!(mesh.notes[0].contains("'noise'") && mesh.notes[0].contains("left empty"), "{:?}", mesh.notes);
    }
}
