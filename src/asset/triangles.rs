//! Polygons as triangles.

use super::{Corner, Faces};
use crate::asset::normals::area_vector;
use glam::{DVec2, Vec3};

/// Part of a polygon's area that a triangle may be turned over by: rounding of corners on one line.
const ROUNDING: f64 = 1e-6;

/// Most corners of a polygon that is cut in its plane. The time may grow with their cube: a file of 100 kB could take
/// minutes.
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
        let mut left = CUT_ALL;
        let mut triangles = Vec::with_capacity(self.corners.len());
        for face in self.iter() {
            let is_cut = (4..=CUT_MOST).contains(&face.len());
            let cut = if is_cut { cut(face, positions, &mut left) } else { None };
            let cut = cut.unwrap_or_else(|| (2..face.len() as u32).map(|i| [0, i - 1, i]).collect());
            triangles.extend(cut.into_iter().map(|triangle| triangle.map(|i| face[i as usize].position)));
        }
        triangles
    }
}

/// Cuts a polygon whose fan does not cover it; returns indices of corners. `None` where it crosses itself.
fn cut(face: &[Corner], positions: &[Vec3], left: &mut usize) -> Option<Vec<[u32; 3]>> {
    let place = |corner: &Corner| positions[corner.position as usize].as_dvec3();
    let (x, y) = area_vector(face, positions).try_normalize()?.any_orthonormal_pair();
    let flat = face.iter().map(|corner| place(corner) - place(&face[0]));
    let flat: Vec<DVec2> = flat.map(|corner| DVec2::new(corner.dot(x), corner.dot(y))).collect();
    let corners = face.len() as u32;
    let fan = (2..corners).map(|i| area(&flat, [0, i - 1, i]));
    let least = -ROUNDING * fan.clone().sum::<f64>();
    if fan.clone().all(|area| area >= least) {
        return None;
    }
    *left = left.checked_sub(face.len().pow(3))?;
    let mut rest: Vec<u32> = (0..corners).collect();
    let mut triangles = vec![];
    while rest.len() > 3 {
        let count = rest.len();
        let at = |i: usize| [rest[(i + count - 1) % count], rest[i], rest[(i + 1) % count]];
        let is_ear = |i: &usize| area(&flat, at(*i)) > -least && !rest.iter().any(|v| holds(&flat, at(*i), *v));
        // Corners on one line are cut last: their triangles have no area until a target bends that line.
        let is_flat = |i: &usize| area(&flat, at(*i)).abs() <= -least;
        let ear = (0..count).find(is_ear).or_else(|| (0..count).find(is_flat))?;
        triangles.push(at(ear));
        rest.remove(ear);
    }
    triangles.push([rest[0], rest[1], rest[2]]);
    triangles.iter().all(|triangle| area(&flat, *triangle) >= least).then_some(triangles)
}

/// Twice the area of a triangle; negative where it turns to the right.
fn area(flat: &[DVec2], [a, b, c]: [u32; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|i| flat[i as usize]);
    (b - a).perp_dot(c - a)
}

/// Whether a triangle that turns to the left holds a corner at another place than its own.
fn holds(flat: &[DVec2], [a, b, c]: [u32; 3], corner: u32) -> bool {
    let is_other = [a, b, c].iter().all(|own| flat[*own as usize] != flat[corner as usize]);
    is_other && [[a, b, corner], [b, c, corner], [c, a, corner]].iter().all(|side| area(flat, *side) >= 0.0)
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
