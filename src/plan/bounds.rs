//! Conservative bounds of poses, computed from weights alone.

use super::UpdateDesc;
use crate::error::{Result, refuse};
use crate::math::{down, up};
use crate::pack::blocks::PoseGrid;
use crate::pack::{POSE_FLOATS, PackedMesh};

/// Vertices per cluster, unless the application names its own: consecutive in pose-buffer order.
const CLUSTER: u32 = 256;

/// An axis-aligned box, in input units.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Bounds {
    /// Least coordinates.
    pub min: [f32; 3],
    /// Greatest coordinates.
    pub max: [f32; 3],
}

impl Bounds {
    const EMPTY: Self = Self { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    fn union(self, other: Self) -> Self {
        Self {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }
}

/// Smallest and largest delta of a target in a cluster of vertices, at weight 1.
#[derive(Clone, Copy, Debug)]
struct Reach {
    target: u32,
    low: [f32; 3],
    high: [f32; 3],
}

/// Conservative bounds of a mesh's poses, for culling and shadows before the GPU has updated them: bounds of the whole
/// mesh, or of clusters of its vertices.
///
/// A cluster has the bounds of its base pose and, for each target that moves it, the smallest and largest delta along
/// each axis; interval arithmetic adds them for given weights. All of it is exact in double precision, except sums,
/// whose rounding is added, and that of fixed-point poses and of decoding them ([`PoseGrid::position_error`]); bounds
/// are rounded outward to float32. No pose exceeds its bounds, which are somewhat too large if the vertices of a
/// cluster move apart.
///
/// Takes 28 bytes and one step of work for each pair of a cluster and a target that moves it.
#[derive(Clone, Debug)]
pub struct WeightBounds {
    /// Bounds of the base pose, and end of the cluster in `reaches`.
    clusters: Vec<([f32; 3], [f32; 3], usize)>,
    reaches: Vec<Reach>,
    targets: usize,
    /// Grid of weights, for fixed-point poses.
    grid: Option<PoseGrid>,
    /// The error budget.
    budget: f32,
}

impl WeightBounds {
    /// For crowds of `mesh` with this description. Clusters are 256 neighbours in pose-buffer order.
    ///
    /// # Errors
    /// Errors of [`UpdateDesc::grid`].
    pub fn new(mesh: &PackedMesh, update: &UpdateDesc) -> Result<Self> {
        let vertices = mesh.layout().vertex_count as u32;
        let cluster = |first: u32| (first..vertices.min(first + CLUSTER)).collect();
        let clusters: Vec<Vec<u32>> = (0..vertices).step_by(CLUSTER as usize).map(cluster).collect();
        Self::with_clusters(mesh, update, &clusters)
    }

    /// Like [`new`](Self::new), with these clusters of vertices in pose-buffer order: what a draw, a meshlet or the
    /// geometry of an acceleration structure indexes. A vertex may be in several of them, or in none.
    ///
    /// # Errors
    /// Errors of [`UpdateDesc::grid`]; a vertex that the mesh does not have.
    pub fn with_clusters(mesh: &PackedMesh, update: &UpdateDesc, clusters: &[impl AsRef<[u32]>]) -> Result<Self> {
        let layout = mesh.layout();
        let base = mesh.base().as_chunks::<POSE_FLOATS>().0;
        let count = clusters.len();
        // By vertex, in the user's order.
        let mut places = vec![vec![]; layout.vertex_count];
        let empty = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let mut bases = vec![empty; count];
        for (number, cluster) in clusters.iter().enumerate() {
            for &vertex in cluster.as_ref() {
                let Some(user) = layout.user_vertex(vertex as usize) else {
                    let text = format!("cluster {number} has vertex {vertex} of {}", layout.vertex_count);
                    return refuse(text, "name vertices as the indices of the packed mesh do");
                };
                places[user].push(number);
                let [x, y, z, ..] = base[vertex as usize];
                extend(&mut bases[number], [x, y, z], |x| (x, x));
            }
        }
        let mut by_cluster: Vec<Vec<Reach>> = vec![vec![]; count];
        for target in 0..layout.targets.len() {
            let (mut reach, mut moved) = (vec![empty; count], vec![0; count]);
            mesh.for_each_delta(target, |user, [x, y, z, ..]| {
                for &number in &places[user] {
                    moved[number] += 1;
                    extend(&mut reach[number], [x, y, z], |x| (down(x), up(x)));
                }
            });
            for number in (0..count).filter(|number| moved[*number] > 0) {
                if moved[number] < clusters[number].as_ref().len() {
                    // Unmoved vertices of the cluster.
                    extend(&mut reach[number], [0.0f32; 3], |x| (x, x));
                }
                let (low, high) = reach[number];
                by_cluster[number].push(Reach { target: target as u32, low, high });
            }
        }
        let mut reaches = vec![];
        let clusters = bases.into_iter().zip(by_cluster).map(|((low, high), of_cluster)| {
            reaches.extend(of_cluster);
            (low, high, reaches.len())
        });
        let clusters = clusters.collect();
        let grid = update.grid(layout)?;
        Ok(Self { clusters, reaches, targets: layout.targets.len(), grid, budget: update.error_budget })
    }

    /// Bounds of the pose of these `weights`, one per target; missing ones are 0. `bound`: the position error from
    /// updates, [`UpdateStats::bound`](crate::UpdateStats::bound) of the update that wrote the pose; it is not tracked
    /// for dense float32 poses, where 1e-5 of the diagonal is ample for a few hundred updates. Deferral by an error
    /// budget and rounding of weights to a grid are always included.
    ///
    /// The bounds of a mesh without vertices are empty: `min` is infinite. Weights that are not finite give invalid
    /// bounds.
    #[must_use]
    pub fn of(&self, weights: &[f32], bound: f32) -> Bounds {
        self.of_clusters(weights, bound).fold(Bounds::EMPTY, Bounds::union)
    }

    /// Like [`of`](Self::of), for each cluster; those of a cluster without vertices are empty.
    pub fn of_clusters(&self, weights: &[f32], bound: f32) -> impl Iterator<Item = Bounds> {
        let weights: Vec<f64> = weights.iter().take(self.targets).map(|w| f64::from(self.rounded(*w))).collect();
        // `bound` may include what rounding fixed-point terms and decoding add, too.
        let active = weights.iter().filter(|weight| **weight != 0.0).count();
        let rounding = self.grid.map_or(0.0, |grid| grid.position_error(active));
        let slack = f64::from(bound.max(rounding)) + f64::from(self.budget);
        let mut first = 0;
        self.clusters.iter().map(move |&(base_low, base_high, end)| {
            let (mut low, mut high) = (base_low.map(f64::from), base_high.map(f64::from));
            // Bound on rounding of the sums: one ulp of the largest for each term.
            let mut largest = low.iter().chain(&high).fold(0.0, |most: f64, x| most.max(x.abs()));
            let mut terms = 2.0;
            for reach in &self.reaches[first..end] {
                let weight = weights.get(reach.target as usize).copied().unwrap_or(0.0);
                if weight == 0.0 {
                    continue;
                }
                let mut most: f64 = 0.0;
                for axis in 0..3 {
                    // Products of two float32 are exact.
                    let a = weight * f64::from(reach.low[axis]);
                    let b = weight * f64::from(reach.high[axis]);
                    low[axis] += a.min(b);
                    high[axis] += a.max(b);
                    most = most.max(a.abs()).max(b.abs());
                }
                (largest, terms) = (largest + most, terms + 1.0);
            }
            first = end;
            if low[0] > high[0] {
                return Bounds::EMPTY;
            }
            let slack = slack + largest * terms * f64::EPSILON;
            Bounds { min: low.map(|x| down(x - slack)), max: high.map(|x| up(x + slack)) }
        })
    }

    fn rounded(&self, weight: f32) -> f32 {
        self.grid.map_or(weight, |grid| grid.round(weight))
    }
}

/// Extends `bounds` to `point`; `both` rounds a coordinate down and up.
fn extend<T: Copy>((low, high): &mut ([f32; 3], [f32; 3]), point: [T; 3], both: impl Fn(T) -> (f32, f32)) {
    for ((low, high), x) in low.iter_mut().zip(high).zip(point) {
        let (below, above) = both(x);
        (*low, *high) = (low.min(below), high.max(above));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::Tolerance;
    use crate::cpu::CpuCrowd;
    use crate::pack::{DeltaFormat, PackDesc, PoseFormat};
    use crate::plan::{BatchSize, UpdatePath};
    use crate::reference::evaluate;
    use crate::testing::head;
    use crate::update::crowd::CrowdDesc;
    use deltamorph_head::{HeadDesc, Rng};
    use std::sync::Arc;

    /// 10^5 random poses of small meshes, with few or all weights active, small and large: none exceeds its bounds, not
    /// by the last bit. Poses of weights rounded to a grid stay within the bounds of the requested weights.
    #[test]
    fn no_pose_exceeds_its_bounds() {
        let mut rng = Rng::new(13, 0);
        let mut looseness: f64 = 0.0;
        let mut tight = 0;
        for head_seed in 0..10 {
            let desc = HeadDesc { vertices: 40 + 30 * head_seed, targets: 6, sparsity: 0.4, seed: head_seed as u64 };
            let mesh = head(&desc).kept(Tolerance::default()).expect("a mesh");
            let formats = [DeltaFormat::Fast, DeltaFormat::Small, DeltaFormat::Float32, DeltaFormat::Snorm16];
            let packed = PackedMesh::pack(&mesh, &PackDesc::new(formats[head_seed % 4])).expect("a mesh that fits");
            let pose = if head_seed % 3 == 0 && packed.layout().format.is_blocks() {
                PoseFormat::Fixed32
            } else {
                PoseFormat::Float32
            };
            let update = UpdateDesc { pose, weight_max: Some(4.0), ..UpdateDesc::blocks() };
            let bounds = WeightBounds::new(&packed, &update).expect("a grid");
            // Of any size, with vertices in common.
            let vertices = packed.layout().vertex_count;
            let clusters: [Vec<u32>; 4] =
                [0, 1, 7, vertices / 2].map(|size| (0..size).map(|_| rng.below(vertices) as u32).collect());
            let of_clusters = WeightBounds::with_clusters(&packed, &update, &clusters).expect("a grid");
            let grid = update.grid(packed.layout()).expect("a grid");
            for _ in 0..10_000 {
                let most = [0.1, 1.0, 4.0][rng.below(3)];
                let mut weight = || if rng.below(3) == 0 { 0.0 } else { rng.range(-most, most) };
                let weights: [f32; 6] = std::array::from_fn(|_| weight());
                let found = bounds.of(&weights, 0.0);
                let held = weights.map(|weight| grid.map_or(weight, |grid| grid.round(weight)));
                let pose = evaluate(&packed, &held);
                let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
                for vertex in pose.as_chunks::<POSE_FLOATS>().0 {
                    for axis in 0..3 {
                        (low[axis], high[axis]) = (low[axis].min(vertex[axis]), high[axis].max(vertex[axis]));
                    }
                }
                let found_of: Vec<Bounds> = of_clusters.of_clusters(&weights, 0.0).collect();
                assert_eq!(found_of[0], Bounds::EMPTY);
                for (Bounds { min, max }, cluster) in found_of.iter().zip(&clusters) {
                    for vertex in cluster {
                        let user = packed.layout().user_vertex(*vertex as usize).expect("a vertex");
                        let place = &pose[user * POSE_FLOATS..];
                        let is_in = |axis| f64::from(min[axis]) <= place[axis] && place[axis] <= f64::from(max[axis]);
                        assert!((0..3).all(is_in), "{weights:?}: vertex {vertex} of {cluster:?}: {min:?}, {max:?}");
                    }
                }
                for axis in 0..3 {
                    let (least, most) = (f64::from(found.min[axis]), f64::from(found.max[axis]));
                    assert!(least <= low[axis] && high[axis] <= most, "{weights:?}: {found:?} of {low:?}, {high:?}");
                    looseness = looseness.max((most - least) / (high[axis] - low[axis]));
                    tight += usize::from(most - least < 1.5 * (high[axis] - low[axis]));
                }
            }
        }
        assert!(tight > 200_000, "{tight} of 300,000 are less than half as large again; at most {looseness} times");
    }

    /// Random poses of small meshes as they are decoded, with few or all weights active, small and large: none exceeds
    /// its bounds, not by the last bit. In half of the meshes a vertex far off takes the offset far from all others.
    #[test]
    fn no_decoded_pose_exceeds_its_bounds() {
        let mut rng = Rng::new(13, 0);
        let mut looseness: f32 = 0.0;
        let mut tight = 0;
        for seed in 0..16 {
            let desc = HeadDesc { vertices: 40 + 30 * seed, targets: 6, sparsity: 0.4, seed: seed as u64 };
            let mut mesh = head(&desc).kept(Tolerance::default()).expect("a mesh");
            mesh.positions[0].x += 200.0 * mesh.diagonal * (seed / 8) as f32;
            let format = DeltaFormat::ALL[seed % 4];
            let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh that fits"));
            // Of any size, with vertices in common.
            let vertices = packed.layout().vertex_count;
            let clusters: [Vec<u32>; 4] =
                [0, 1, 7, vertices / 2].map(|size| (0..size).map(|_| rng.below(vertices) as u32).collect());
            for pose in PoseFormat::ALL.into_iter().filter(|pose| pose.takes(format)) {
                let update =
                    UpdateDesc { pose, weight_max: Some(4.0), ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
                let bounds = WeightBounds::new(&packed, &update).expect("a grid");
                let of_clusters = WeightBounds::with_clusters(&packed, &update, &clusters).expect("a grid");
                let mut crowd = CpuCrowd::new(packed.clone(), &CrowdDesc::new(update), 1).expect("a crowd");
                for _ in 0..300 {
                    let most = [0.1, 1.0, 4.0][rng.below(3)];
                    let mut weight = || if rng.below(3) == 0 { 0.0 } else { rng.range(-most, most) };
                    let weights: [f32; 6] = std::array::from_fn(|_| weight());
                    crowd.set_weights(0, &weights).expect("weights");
                    let bound = crowd.update().bound;
                    let found = bounds.of(&weights, bound);
                    let decoded = packed.layout().to_user_order(&crowd.pose(0).expect("a pose"));
                    for axis in 0..3 {
                        let along = || decoded.iter().copied().skip(axis).step_by(POSE_FLOATS);
                        let (low, high) = (along().reduce(f32::min).unwrap(), along().reduce(f32::max).unwrap());
                        let (least, most) = (found.min[axis], found.max[axis]);
                        assert!(least <= low && high <= most, "{pose:?}, {weights:?}: {found:?} of {low}, {high}");
                        looseness = looseness.max((most - least) / (high - low));
                        tight += usize::from(most - least < 1.5 * (high - low));
                    }
                    let found: Vec<Bounds> = of_clusters.of_clusters(&weights, bound).collect();
                    assert_eq!(found[0], Bounds::EMPTY);
                    for (Bounds { min, max }, cluster) in found.iter().zip(&clusters) {
                        for vertex in cluster {
                            let user = packed.layout().user_vertex(*vertex as usize).expect("a vertex");
                            let place = &decoded[user * POSE_FLOATS..];
                            let is_in = |axis| min[axis] <= place[axis] && place[axis] <= max[axis];
                            assert!((0..3).all(is_in), "{pose:?}: vertex {vertex} of {cluster:?}: {min:?}, {max:?}");
                        }
                    }
                }
            }
        }
        assert!(tight > 18_000, "{tight} of 28,800 are less than half as large again; at most {looseness} times");
    }

    #[test]
    fn what_updates_leave_out_is_part_of_the_bounds() {
        let mesh = head(&HeadDesc { vertices: 100, targets: 3, ..Default::default() })
            .kept(Tolerance::default())
            .expect("a mesh");
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).expect("a mesh that fits");
        let bounds = |budget: f32, bound| {
            let update = UpdateDesc { error_budget: budget, ..UpdateDesc::blocks() };
            WeightBounds::new(&packed, &update).expect("no grid").of(&[0.5; 3], bound)
        };
        let [plain, deferred, drifted] = [bounds(0.0, 0.0), bounds(0.25, 0.0), bounds(0.0, 0.25)];
        assert_eq!(deferred, drifted);
        for axis in 0..3 {
            assert!(deferred.min[axis] <= plain.min[axis] - 0.25 && deferred.max[axis] >= plain.max[axis] + 0.25);
        }
        assert_eq!((down(0.1), up(0.1)), (0.1f32.next_down(), 0.1f32));
        let refused = WeightBounds::with_clusters(&packed, &UpdateDesc::blocks(), &[vec![99], vec![100]]);
        assert!(refused.is_err_and(|error| error.to_string().contains("cluster 1 has vertex 100 of 100")));
    }
}
