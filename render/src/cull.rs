//! Culling of heads that are outside the picture of a pass.

use deltamorph::{Bounds, PackedMesh, Result, UpdateDesc, UpdateStats, WeightBounds};
use glam::{Mat4, Vec3, Vec4};

/// The clip volume of Vulkan lies on the positive side of each plane.
const PLANES: [Vec4; 6] = [
    Vec4::new(1.0, 0.0, 0.0, 1.0),
    Vec4::new(-1.0, 0.0, 0.0, 1.0),
    Vec4::new(0.0, 1.0, 0.0, 1.0),
    Vec4::new(0.0, -1.0, 0.0, 1.0),
    Vec4::new(0.0, 0.0, 1.0, 0.0),
    Vec4::new(0.0, 0.0, -1.0, 1.0),
];
/// Fraction of the clip coordinates by which a corner has to be outside. Allows for rounding, for lines, which are a
/// pixel wide, and for edges, which face.vert draws slightly nearer.
const MARGIN: f32 = 2e-3;

/// Returns whether all of `bounds` is on the outer side of one plane of the clip volume.
pub fn is_outside(clip: &Mat4, bounds: &Bounds) -> bool {
    let low = Vec3::from(bounds.min);
    let high = Vec3::from(bounds.max);
    let corner = |i: u32| Vec3::select(glam::BVec3::new(i & 1 == 0, i & 2 == 0, i & 4 == 0), low, high);
    let corners: [Vec4; 8] = std::array::from_fn(|i| *clip * corner(i as u32).extend(1.0));
    PLANES.iter().any(|plane| corners.iter().all(|p| plane.dot(*p) < -MARGIN * p.abs().element_sum()))
}

/// Bounds of the poses of a crowd from their weights, for [`Head::bounds`](crate::Head::bounds).
pub struct PoseBounds {
    of_weights: WeightBounds,
    /// Upper bound of the distance between an updated pose and the exact pose of its weights.
    drift: f32,
}

impl PoseBounds {
    /// Makes the bounds for crowds of `mesh` with the updates `update`.
    ///
    /// # Errors
    /// Those of [`WeightBounds::new`].
    pub fn new(mesh: &PackedMesh, update: &UpdateDesc) -> Result<Self> {
        // Dense updates do not report their drift.
        Ok(Self { of_weights: WeightBounds::new(mesh, update)?, drift: 1e-5 * mesh.layout().diagonal })
    }

    /// Follows a recorded update.
    pub fn updated(&mut self, stats: &UpdateStats) {
        self.drift = self.drift.max(stats.bound);
    }

    /// Returns the bounds of the pose of an instance with these weights.
    pub fn of(&self, weights: &[f32]) -> Bounds {
        self.of_weights.of(weights, self.drift)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Camera;
    use deltamorph_head::{HeadDesc, Rng, head};

    /// Places a pose and its bounds all over the clip volume and around it: no vertex is inside where the bounds are
    /// outside, and in most places without a vertex the bounds are outside.
    #[test]
    fn what_is_outside_has_no_vertex_inside() {
        let source = head(&HeadDesc { vertices: 300, targets: 8, ..Default::default() });
        let mesh = source.kept(Default::default()).expect("a mesh");
        let packed = PackedMesh::pack(&mesh, &Default::default()).expect("a mesh that packs");
        let bounds = PoseBounds::new(&packed, &UpdateDesc::blocks()).expect("bounds").of(&[]);
        let view = Camera::default().fit(mesh.positions.iter().copied(), 1.5, 0.1);
        let mut rng = Rng::new(7, 0);
        let mut outside = 0;
        let mut empty = 0;
        for _ in 0..3000 {
            let mut random = || Vec3::from([0; 3].map(|_| rng.range(-1.0, 1.0)));
            let axis = random().normalize();
            let turn = random().x * 3.0;
            let place = Mat4::from_translation(random() * 6.0 * view.ball.1) * Mat4::from_axis_angle(axis, turn);
            let clip = view.clip * place;
            let is_inside = |p: &Vec3| {
                let [x, y, z, w] = (clip * p.extend(1.0)).to_array();
                x.abs() <= w && y.abs() <= w && (0.0..=w).contains(&z)
            };
            let culled = is_outside(&clip, &bounds);
            let seen = mesh.positions.iter().any(is_inside);
            assert!(!(culled && seen), "{place}");
            (outside, empty) = (outside + u32::from(culled), empty + u32::from(!seen));
        }
        assert!(outside > 1000 && outside * 10 > empty * 9, "{outside} of {empty}");
    }
}
