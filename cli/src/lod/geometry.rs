//! Movement of vertices by targets: Hausdorff distances, and the error of a clip that drops some targets.

use deltamorph::mesh::KeptTarget;
use deltamorph::{BoundClip, KeptMesh};
use glam::Vec3;
use rstar::RTree;

/// Hausdorff distance between the vertices of the base pose and those of `target` at weight 1, in input units: the
/// largest distance from a vertex of either to the nearest of the other.
pub fn hausdorff(mesh: &KeptMesh, base: &Tree, target: &KeptTarget) -> f64 {
    let mut pose = mesh.positions.clone();
    target.vertices.iter().zip(&target.positions).for_each(|(&v, d)| pose[v as usize] += *d);
    let moved = tree(&pose);
    let nearest = |tree: &Tree, to: Vec3| {
        tree.nearest_neighbor(to.to_array()).map_or(f32::INFINITY, |at| to.distance_squared(Vec3::from(*at)))
    };
    // Unmoved vertices are in both.
    let there = |&v: &u32| nearest(base, pose[v as usize]);
    let back = |&v: &u32| nearest(&moved, mesh.positions[v as usize]);
    let farthest = target.vertices.iter().map(|v| there(v).max(back(v))).fold(0.0, f32::max);
    f64::from(farthest).sqrt()
}

pub type Tree = RTree<[f32; 3]>;

pub fn tree(points: &[Vec3]) -> Tree {
    RTree::bulk_load(points.iter().map(Vec3::to_array).collect())
}

/// The error of a clip for any set D of dropped targets. A frame with weights w has a mean squared error of Σ w_t w_u
/// (d_t · d_u) over t, u in D; for a clip, only the mean of w_t w_u matters.
pub struct Loss {
    targets: usize,
    /// Mean of w_t w_u over the frames.
    weights: Vec<f64>,
    /// Mean of d_t · d_u over the vertices, for pairs that share a frame.
    products: Vec<f64>,
}

impl Loss {
    /// Sums over the frames of `clips` and all vertices; without frames, over each target by itself at weight 1.
    pub fn new(mesh: &KeptMesh, clips: &[BoundClip]) -> Self {
        let targets = mesh.targets.len();
        let mut weights = vec![0.0; targets * targets];
        let mut frames = 0;
        for frame in clips.iter().flat_map(BoundClip::frames) {
            frames += 1;
            let active: Vec<_> = frame.iter().enumerate().filter(|(_, w)| **w != 0.0).collect();
            for (&(t, a), &(u, b)) in active.iter().flat_map(|a| active.iter().map(move |b| (a, b))) {
                weights[t * targets + u] += f64::from(*a) * f64::from(*b);
            }
        }
        if frames == 0 {
            (0..targets).for_each(|t| weights[t * targets + t] = 1.0);
            frames = targets;
        }
        let mut products = vec![0.0; targets * targets];
        let scale = 1.0 / mesh.vertex_count().max(1) as f64;
        let mut dense = vec![Vec3::ZERO; mesh.vertex_count()];
        for (t, target) in mesh.targets.iter().enumerate() {
            target.vertices.iter().zip(&target.positions).for_each(|(&v, d)| dense[v as usize] = *d);
            let row = t * targets..(t + 1) * targets;
            let pairs = weights[row.clone()].iter().zip(&mut products[row]).zip(&mesh.targets);
            for ((_, product), other) in pairs.filter(|((weight, _), _)| **weight != 0.0) {
                let vertices = other.vertices.iter().zip(&other.positions);
                let dots = vertices.map(|(&v, d)| d.as_dvec3().dot(dense[v as usize].as_dvec3()));
                *product = dots.sum::<f64>() * scale;
            }
            target.vertices.iter().for_each(|&v| dense[v as usize] = Vec3::ZERO);
        }
        weights.iter_mut().for_each(|weight| *weight /= frames.max(1) as f64);
        Self { targets, weights, products }
    }

    /// Root mean square error over vertices and frames, in input units, if only `kept` targets are applied.
    pub fn of(&self, kept: &[bool]) -> f64 {
        let dropped: Vec<usize> = (0..self.targets).filter(|t| !kept[*t]).collect();
        let product = |t: usize, u: usize| self.weights[t * self.targets + u] * self.products[t * self.targets + u];
        let row = |t: &usize| dropped.iter().map(|u| product(*t, *u)).sum::<f64>();
        dropped.iter().map(row).sum::<f64>().max(0.0).sqrt()
    }
}
