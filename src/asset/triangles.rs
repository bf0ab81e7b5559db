//! Polygons as triangles.

use super::{Corner, Faces};
use crate::asset::normals::area_vector;
use earcut::Earcut;
use glam::{DVec2, Vec3};
use std::collections::BTreeSet;

/// Part of a polygon's area that a triangle of its fan may be turned over by: rounding of corners on one line.
const ROUNDING: f64 = 1e-6;

/// Most corners of a polygon that is cut in its plane. The time grows with their square where they repeat or cross: a
/// file of 100 kB could take minutes.
pub(crate) const CUT_MOST: usize = 512;

/// Cubes of corners of the polygons that are cut in a mesh altogether: four that take long.
pub(crate) const CUT_ALL: usize = 1 << 29;

impl Faces {
    /// Returns the position indices of the faces, cut into triangles: a polygon of n corners is n − 2 of them. It is a
    /// fan from its first corner where that covers it, as it does any convex polygon, and where it has more than 512
    /// corners, or follows many large ones; otherwise it is cut in its own plane, as it stands in the base pose
    /// `positions`.
    ///
    /// # Panics
    /// A face of four corners or more names a position that there is not.
    pub fn triangles(&self, positions: &[Vec3]) -> Vec<[u32; 3]> {
        let mut earcut = Earcut::new();
        let mut left = CUT_ALL;
        let mut triangles = Vec::with_capacity(self.corners.len());
        for face in self.iter() {
            let is_cut = (4..=CUT_MOST).contains(&face.len());
            let cut = if is_cut { cut(face, positions, &mut earcut, &mut left) } else { None };
            let cut = cut.unwrap_or_else(|| (2..face.len() as u32).map(|i| [0, i - 1, i]).collect());
            triangles.extend(cut.into_iter().map(|triangle| triangle.map(|i| face[i as usize].position)));
        }
        triangles
    }
}

/// Cuts a polygon whose fan does not cover it; returns indices of corners.
fn cut(face: &[Corner], positions: &[Vec3], earcut: &mut Earcut<f64>, left: &mut usize) -> Option<Vec<[u32; 3]>> {
    let place = |corner: &Corner| positions[corner.position as usize].as_dvec3();
    let (x, y) = area_vector(face, positions).try_normalize()?.any_orthonormal_pair();
    let flat = face.iter().map(|corner| place(corner) - place(&face[0]));
    let flat: Vec<[f64; 2]> = flat.map(|corner| [corner.dot(x), corner.dot(y)]).collect();
    let area = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a, b, c].map(|i| DVec2::from_array(flat[i as usize]));
        (b - a).perp_dot(c - a)
    };
    let fan: Vec<f64> = (2..face.len() as u32).map(|i| area([0, i - 1, i])).collect();
    let least = -ROUNDING * fan.iter().sum::<f64>();
    if fan.iter().all(|area| *area >= least) {
        return None;
    }
    *left = left.checked_sub(face.len().pow(3))?;
    let mut indices = vec![];
    earcut.earcut_slice(&flat, &[], &mut indices);
    let mut triangles = indices.as_chunks::<3>().0.to_vec();
    // All turn the same way; the area of one that lies on a line may have either sign.
    if triangles.iter().map(|triangle| area(*triangle)).sum::<f64>() < 0.0 {
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    close(face.len() as u32, &mut triangles);
    // A polygon that crosses itself may come out with more or fewer.
    (triangles.len() == fan.len()).then_some(triangles)
}

/// Adds triangles until the edges of a polygon are those of its triangles. What earcut leaves out lies on a line, and
/// has no area until a target bends that line.
fn close(corners: u32, triangles: &mut Vec<[u32; 3]>) {
    if triangles.len() as u32 == corners.saturating_sub(2) {
        return;
    }
    let mut open: BTreeSet<(u32, u32)> = (0..corners).map(|i| (i, (i + 1) % corners)).collect();
    for (from, to) in triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]) {
        if !open.remove(&(from, to)) {
            open.insert((to, from));
        }
    }
    // Loops: each edge that is left is followed by another.
    while let Some((first, mut at)) = open.pop_first() {
        while let Some(&edge) = open.range((at, 0)..=(at, corners)).next() {
            open.remove(&edge);
            if edge.1 == first {
                break;
            }
            triangles.push([first, at, edge.1]);
            at = edge.1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Quat};
    use proptest::prelude::*;

    /// A polygon whose corners are positions in order.
    fn polygon(corners: usize) -> Faces {
        let corners = (0..corners as u32).map(|position| Corner { position, texcoord: None }).collect::<Vec<_>>();
        Faces { sizes: vec![corners.len() as u32], corners }
    }

    /// Twice the areas of triangles, along their normals.
    fn areas(triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<DVec3> {
        let place = |i: u32| positions[i as usize].as_dvec3();
        triangles.iter().map(|&[a, b, c]| (place(b) - place(a)).cross(place(c) - place(a))).collect()
    }

    #[test]
    fn a_quad_is_cut_from_a_corner_that_sees_all() {
        let square = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        assert_eq!(polygon(4).triangles(&square), [[0, 1, 2], [0, 2, 3]]);
        let arrow = [Vec3::new(-1.0, 1.0, 0.0), Vec3::new(0.0, 0.3, 0.0), Vec3::X + Vec3::Y, Vec3::NEG_Y];
        let mut triangles = polygon(4).triangles(&arrow);
        triangles.iter_mut().for_each(|triangle| triangle.sort_unstable());
        triangles.sort_unstable();
        assert_eq!(triangles, [[0, 1, 3], [1, 2, 3]]);
        // Too large to be cut: corners may repeat.
        let many = CUT_MOST + 1;
        let corners: Vec<Vec3> = (0..many).map(|i| Vec3::new((i * 7 % 5) as f32, (i * 3 % 4) as f32, 0.0)).collect();
        let fan = polygon(many).triangles(&corners);
        assert!(fan.len() == many - 2 && fan.iter().all(|triangle| triangle[0] == 0));
        // Nothing to go by: no area, or no plane.
        assert_eq!(polygon(5).triangles(&[Vec3::ONE; 5]), [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    }

    proptest! {
        /// A comb of `teeth`, with further corners on its edges, turned.
        #[test]
        fn any_polygon_is_covered_once_and_keeps_its_edges(
            teeth in prop::collection::vec(0.1f32..3.0, 2..9),
            steps in 1usize..4,
            first in 0usize..9,
            turn in prop::array::uniform3(-3.0f32..3.0),
        ) {
            let mut outline = vec![[0.0, -1.0], [2.0 * teeth.len() as f32, -1.0]];
            for (i, &height) in teeth.iter().enumerate().rev() {
                let x = 2.0 * i as f32;
                outline.extend([[x + 2.0, 0.0], [x + 1.0, 0.0], [x + 1.0, height], [x, height]]);
            }
            let turn = Quat::from_scaled_axis(turn.into());
            let outline: Vec<Vec3> = outline.into_iter().map(|[x, y]| turn * Vec3::new(x, y, 7.0)).collect();
            let corner = |i: usize| {
                let from = outline[i / steps % outline.len()];
                from.lerp(outline[(i / steps + 1) % outline.len()], (i % steps) as f32 / steps as f32)
            };
            let count = outline.len() * steps;
            let corners: Vec<Vec3> = (first..first + count).map(corner).collect();
            let polygon = polygon(count);
            let triangles = polygon.triangles(&corners);
            prop_assert_eq!(triangles.len(), count - 2);
            let normal = area_vector(&polygon.corners, &corners).normalize();
            let parts = areas(&triangles, &corners);
            prop_assert!(parts.iter().all(|part| part.dot(normal) > -1e-4), "{:?}", parts);
            // Wherever corners go, the areas add up to that of the polygon: no edge is left open.
            let bent = |i: usize| Vec3::new((i * i) as f32, (i % 7) as f32, (i % 5) as f32);
            let bent: Vec<Vec3> = (0..count).map(bent).collect();
            for positions in [&corners, &bent] {
                let sum: DVec3 = areas(&triangles, positions).into_iter().sum();
                let whole = area_vector(&polygon.corners, positions);
                prop_assert!((sum - whole).length() < 1e-6 * whole.length(), "{} of {}", sum, whole);
            }
        }
    }
}
