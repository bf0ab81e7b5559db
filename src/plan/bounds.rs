//! Bounds that no pose of some weights exceeds, from the weights alone.

use super::UpdateDesc;
use crate::error::Result;
use crate::pack::blocks::PoseGrid;
use crate::pack::{POSE_FLOATS, PackedMesh};

/// Vertices that have bounds of their own, one after the other in the order of poses.
const GROUP: usize = 256;

/// A box along the axes, in input units.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Bounds {
    /// Least coordinates.
    pub min: [f32; 3],
    /// Greatest coordinates.
    pub max: [f32; 3],
}

/// What a target adds at most to the vertices of a group, at weight 1.
#[derive(Clone, Copy, Debug)]
struct Reach {
    target: u32,
    low: [f32; 3],
    high: [f32; 3],
}

/// Bounds of the poses of a mesh, for culling and shadows before the GPU has updated them.
///
/// The vertices are taken in groups of 256 neighbours. Of each group the bounds of the base pose are known, and the
/// least and greatest delta of each target that moves it, along each axis; with weights they add up as intervals do.
/// All is exact in double precision, but for sums, whose rounding is added; bounds are rounded outward to float32. So
/// no pose exceeds them, and they are somewhat too large where the vertices of a group move apart.
///
/// It takes 28 bytes for each group and target that moves it, and as many steps.
#[derive(Clone, Debug)]
pub struct WeightBounds {
    /// Bounds of the base pose, and where the group ends in `reaches`.
    groups: Vec<([f32; 3], [f32; 3], usize)>,
    reaches: Vec<Reach>,
    targets: usize,
    /// What weights are rounded to.
    grid: Option<PoseGrid>,
    /// How far committed weights may leave a vertex from where those requested would put it.
    budget: f32,
}

impl WeightBounds {
    /// For crowds of `mesh` that are updated like this.
    ///
    /// # Errors
    /// Poses of integers that the mesh has no grid for.
    pub fn new(mesh: &PackedMesh, update: &UpdateDesc) -> Result<Self> {
        let (layout, base) = (mesh.layout(), mesh.base());
        let count = layout.padded_vertices().div_ceil(GROUP);
        let mut places = vec![0; layout.vertex_count];
        let mut sizes = vec![0u32; count];
        let empty = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let mut bases = vec![empty; count];
        for (packed, vertex) in base.as_chunks::<POSE_FLOATS>().0.iter().enumerate() {
            let Some(user) = layout.user_vertex(packed) else { continue };
            let group = packed / GROUP;
            (places[user], sizes[group]) = (group, sizes[group] + 1);
            extend(&mut bases[group], [vertex[0], vertex[1], vertex[2]], |x| (x, x));
        }
        let mut by_group: Vec<Vec<Reach>> = vec![vec![]; count];
        for target in 0..layout.targets.len() {
            let (mut reach, mut moved) = (vec![empty; count], vec![0u32; count]);
            mesh.for_each_delta(target, |user, [x, y, z, ..]| {
                moved[places[user]] += 1;
                extend(&mut reach[places[user]], [x, y, z], |x| (down(x), up(x)));
            });
            for group in (0..count).filter(|group| moved[*group] > 0) {
                if moved[group] < sizes[group] {
                    // Vertices that it does not move.
                    extend(&mut reach[group], [0.0f32; 3], |x| (x, x));
                }
                let (low, high) = reach[group];
                by_group[group].push(Reach { target: target as u32, low, high });
            }
        }
        let mut reaches = vec![];
        let groups = bases.into_iter().zip(by_group).filter(|((low, _), _)| low[0].is_finite());
        let groups = groups.map(|((low, high), of_group)| {
            reaches.extend(of_group);
            (low, high, reaches.len())
        });
        let groups = groups.collect();
        let grid = update.grid(layout)?;
        Ok(Self { groups, reaches, targets: layout.targets.len(), grid, budget: update.error_budget })
    }

    /// Bounds of the pose of these weights, one for each target; further targets have the weight 0. `bound`: how far
    /// updates may have taken poses from it, which is [`UpdateStats::bound`](crate::UpdateStats::bound) of the update
    /// that wrote it; of dense float32 poses nothing is known, and 1e-5 of the diagonal is plenty for a few hundred
    /// updates. What an error budget defers, and what a grid rounds of weights, is part of the bounds in any case.
    ///
    /// A mesh without vertices has none: its least coordinates are infinite. Weights that are no numbers give none that
    /// hold.
    #[must_use]
    pub fn of(&self, weights: &[f32], bound: f32) -> Bounds {
        let weights: Vec<f64> = weights.iter().take(self.targets).map(|w| f64::from(self.rounded(*w))).collect();
        // What terms of integers are rounded by is in bounds on updates, too.
        let active = weights.iter().filter(|weight| **weight != 0.0).count();
        let rounding = self.grid.map_or(0.0, |grid| grid.position_error(active));
        let slack = f64::from(bound.max(rounding)) + f64::from(self.budget);
        // Draws decode integers in float32.
        let decoding = if self.grid.is_some() { f64::from(f32::EPSILON) } else { 0.0 };
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let mut first = 0;
        for &(base_low, base_high, end) in &self.groups {
            let (mut low, mut high) = (base_low.map(f64::from), base_high.map(f64::from));
            // What rounding of the sums may come to: a unit in the last place of the largest for each.
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
                    let (a, b) = (weight * f64::from(reach.low[axis]), weight * f64::from(reach.high[axis]));
                    low[axis] += a.min(b);
                    high[axis] += a.max(b);
                    most = most.max(a.abs()).max(b.abs());
                }
                (largest, terms) = (largest + most, terms + 1.0);
            }
            first = end;
            let slack = slack + largest * (terms * f64::EPSILON + decoding);
            for axis in 0..3 {
                min[axis] = min[axis].min(low[axis] - slack);
                max[axis] = max[axis].max(high[axis] + slack);
            }
        }
        Bounds { min: min.map(down), max: max.map(up) }
    }

    fn rounded(&self, weight: f32) -> f32 {
        self.grid.map_or(weight, |grid| grid.round(weight))
    }
}

/// Let `bounds` have room for `point`, each coordinate as float32 from below and from above.
fn extend<T: Copy>((low, high): &mut ([f32; 3], [f32; 3]), point: [T; 3], both: impl Fn(T) -> (f32, f32)) {
    for ((low, high), x) in low.iter_mut().zip(high).zip(point) {
        let (below, above) = both(x);
        (*low, *high) = (low.min(below), high.max(above));
    }
}

/// The largest float32 that is not above.
fn down(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

/// The smallest float32 that is not below.
fn up(x: f64) -> f32 {
    -down(-x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::Tolerance;
    use crate::pack::{DeltaFormat, PackDesc, PoseFormat};
    use crate::reference::evaluate;
    use crate::testing::head;
    use deltamorph_head::{HeadDesc, Rng};

    /// 10^5 random poses of small heads, from a few weights to all, small ones and large ones: none exceeds its bounds,
    /// not by the last bit. Poses of weights that are rounded to a grid keep within those of the weights requested.
    #[test]
    fn no_pose_exceeds_its_bounds() {
        let mut rng = Rng::new(13, 0);
        let mut looseness: f64 = 0.0;
        let mut tight = 0;
        for head_seed in 0..10 {
            let desc =
                HeadDesc::default().vertices(40 + 30 * head_seed).targets(6).sparsity(0.4).seed(head_seed as u64);
            let mesh = head(&desc).to_mesh(Tolerance::default()).expect("a mesh");
            let formats = [DeltaFormat::Fast, DeltaFormat::Small, DeltaFormat::Float32, DeltaFormat::Snorm16];
            let packed = PackedMesh::pack(&mesh, &PackDesc::new(formats[head_seed % 4])).expect("a mesh that fits");
            let pose = if head_seed % 3 == 0 && head_seed % 4 != 2 { PoseFormat::Fixed32 } else { PoseFormat::Float32 };
            let update = UpdateDesc::blocks().pose(pose).weight_max(Some(4.0));
            let bounds = WeightBounds::new(&packed, &update).expect("a grid");
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

    #[test]
    fn what_updates_leave_out_is_part_of_the_bounds() {
        let mesh = head(&HeadDesc::default().vertices(100).targets(3)).to_mesh(Tolerance::default()).expect("a mesh");
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).expect("a mesh that fits");
        let bounds = |budget: f32, bound| {
            let update = UpdateDesc::blocks().error_budget(budget);
            WeightBounds::new(&packed, &update).expect("no grid").of(&[0.5; 3], bound)
        };
        let [plain, deferred, drifted] = [bounds(0.0, 0.0), bounds(0.25, 0.0), bounds(0.0, 0.25)];
        assert_eq!(deferred, drifted);
        for axis in 0..3 {
            assert!(deferred.min[axis] <= plain.min[axis] - 0.25 && deferred.max[axis] >= plain.max[axis] + 0.25);
        }
        assert_eq!((down(0.1), up(0.1)), (0.1f32.next_down(), 0.1f32));
    }
}
