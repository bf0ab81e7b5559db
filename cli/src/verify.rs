//! Bounds on errors of an update path, and checks of poses against them: common to `apply`, `bench`, `play` and `soak`.

use crate::output::{Failure, Output, Result, With};
use crate::runner::{Frame, Runner, Stage};
use crate::table::{sig3, thousands};
use deltamorph::packed::PoseGrid;
use deltamorph::reference::{SHORTEST_NORMAL, angle_degrees, compare, evaluate, evaluate_group, evaluate_unpacked};
use deltamorph::{
    CpuCrowd, CrowdDesc, KeptMesh, POSE_FLOATS, PackedLayout, PackedMesh, PoseError, PoseFormat, UpdateDesc,
    UpdateStats,
};
use deltamorph_headless::Draws;
use glam::DVec3;
use serde::Serialize;
use serde_json::json;
use std::sync::Arc;

/// Remedy for a wrong pose.
pub const REMEDY: &str = "try another --path, and report this with the output of `deltamorph devices`";

/// Largest position error of a right result, as a fraction of the diagonal; [`Promise::beyond`] adds to it for larger
/// coordinates.
const POSITION_BOUND: f64 = 3e-6;
/// Largest angle between its normals and the float64 reference on the kept deltas, in degrees.
const NORMAL_BOUND_DEGREES: f64 = 0.01;

/// Five standard deviations of what adding a term rounds, in units of ε times the number: [`Promise::beyond`].
const ROUNDED_TERMS: f64 = 2.5;
/// Errors of fixed-point poses, as a fraction of the diagonal, from which on another pose format is advised: 2 mm on a
/// body of 2 m.
pub const FAR_OFF: f64 = 1e-3;

/// Results of a verification.
#[derive(Clone, Copy, Default)]
pub struct Found {
    /// Against the reference on the packed deltas.
    pub error: PoseError,
    /// Largest angle between normals, minus the one that rounding to the unit of poses may cause, in degrees.
    pub turned: f64,
    /// The path's stated bound on position errors, in input units: from drift, or from rounding to the unit of poses.
    pub bound: f64,
    /// The largest absolute coordinate of the reference, and what weights above 1 may add on the way to it.
    pub reach: f64,
    /// Counted by [`Promise::additions`].
    pub additions: usize,
    /// The largest difference of any component of further streams.
    pub streams: f64,
}

impl Found {
    pub fn max(self, other: Self) -> Self {
        Self {
            error: self.error.max(other.error),
            turned: worse(self.turned, other.turned),
            bound: self.bound.max(other.bound),
            reach: self.reach.max(other.reach),
            additions: self.additions.max(other.additions),
            streams: worse(self.streams, other.streams),
        }
    }
}

/// The larger one; NaN if either is NaN.
fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// How far vertices are from where the source has them at the requested weights, and what leads there step by step: the
/// parts add up to the whole or more, and are NaN (in JSON null) where they are not measured. In JSON; fields may be
/// added, never renamed.
#[derive(Clone, Copy, Serialize)]
pub struct Errors {
    /// The largest distance, in input units, and as a fraction of the diagonal.
    pub max_error: f64,
    pub max_error_rel: f64,
    /// Of packed deltas.
    pub packing_error_rel: f64,
    /// Of weights, which are rounded to their grid, or sampled by the device.
    pub weights_error_rel: f64,
    /// Of sums and poses; of changes that are deferred, too.
    pub rounding_error_rel: f64,
}

impl Errors {
    /// The whole and its parts in input units, on a mesh of this [`scale`].
    pub fn new([whole, packing, weights, rounding]: [f64; 4], scale: f64) -> Self {
        Self {
            max_error: whole,
            max_error_rel: whole / scale,
            packing_error_rel: packing / scale,
            weights_error_rel: weights / scale,
            rounding_error_rel: rounding / scale,
        }
    }
}

/// The whole and its parts of a pose, in input units; `reference` is the pose of the applied weights on the packed
/// deltas.
fn errors(pose: &[f32], reference: &[f64], mesh: &PackedMesh, source: &KeptMesh, weights: &[f32]) -> [f64; 4] {
    let requested = evaluate(mesh, weights);
    let truth = evaluate_unpacked(source, weights);
    let [whole, rounding] = [&truth, reference].map(|from| compare(pose, from).position);
    [whole, farthest(&requested, &truth), farthest(reference, &requested), rounding]
}

/// The largest distance between vertices of two poses.
pub fn farthest(a: &[f64], b: &[f64]) -> f64 {
    let vertices = a.chunks_exact(POSE_FLOATS).zip(b.chunks_exact(POSE_FLOATS));
    vertices.map(|(a, b)| DVec3::from_slice(a).distance(DVec3::from_slice(b))).fold(0.0, worse)
}

/// The length that errors are relative to: the diagonal. A single point has none; its errors are absolute.
pub fn scale(diagonal: f32) -> f64 {
    if diagonal > 0.0 { f64::from(diagonal) } else { 1.0 }
}

/// Bound on the position error of float32 poses at weights up to 1, in input units.
pub fn float_rounding(desc: &UpdateDesc, mesh: &Arc<PackedMesh>) -> deltamorph::Result<f64> {
    let layout = mesh.layout();
    let scale = scale(layout.diagonal);
    if layout.blocks.is_none() {
        return Ok(POSITION_BOUND * scale);
    }
    let mut crowd = CpuCrowd::new(mesh.clone(), &CrowdDesc::new(*desc), 1)?;
    crowd.set_weights(0, &vec![1.0; layout.targets.len()])?;
    // Updates take blocks to the tolerance, or to twice the bound of their evaluation in full.
    Ok((f64::from(desc.tolerance) * scale).max(2.0 * f64::from(crowd.update().bound)))
}

/// The error bounds of a path on a mesh.
#[derive(Clone, Copy)]
pub struct Promise {
    /// Poses carry a bound on accumulated errors.
    tracked: bool,
    /// A float32 pose is the base pose plus one sum: of integers, or evaluated in a draw.
    once: bool,
    pub grid: Option<PoseGrid>,
    budget: f64,
    /// The length that errors are relative to.
    pub scale: f64,
}

impl Promise {
    pub fn new(desc: &UpdateDesc, layout: &PackedLayout) -> Self {
        // A mesh without a grid fails when the runner is created.
        let grid = desc.grid(layout).ok().flatten();
        Self {
            tracked: layout.blocks.is_some() && grid.is_none(),
            once: grid.is_some() || desc.path.evaluates_in_draws(),
            grid,
            budget: f64::from(desc.error_budget),
            scale: scale(layout.diagonal),
        }
    }

    /// The weights to compare the result with: for sums of integers, rounded to their grid.
    pub fn applied(&self, weights: &[f32]) -> Vec<f32> {
        weights.iter().map(|&w| self.grid.map_or(w, |grid| grid.round(w))).collect()
    }

    /// Bounds on errors of positions and normals from rounding to the unit of poses in a pose of `weights`, both as
    /// lengths.
    pub fn rounding(&self, weights: &[f32]) -> [f64; 2] {
        // A deferred change may be of a weight that is requested to be 0.
        let active = weights.iter().filter(|w| **w != 0.0 || self.budget > 0.0).count();
        self.grid.map_or([0.0; 2], |grid| [grid.position_error(active), grid.normal_error(active)].map(f64::from))
    }

    /// Errors of `pose` against `reference`, the pose of `weights` on the packed deltas.
    pub fn find(&self, pose: &[f32], reference: &[f64], weights: &[f32]) -> Found {
        let error = compare(pose, reference);
        let sizes = || weights.iter().map(|weight| f64::from(weight.abs()));
        // Deltas of normals are about as long as normals, and may cancel out.
        let length = self.rounding(weights)[1] + ROUNDED_TERMS * f64::from(f32::EPSILON) * sizes().sum::<f64>();
        let turned = turned(pose, reference, length);
        // So may positions, of weights that exaggerate.
        let above: f64 = sizes().map(|size| (size - 1.0).max(0.0)).sum();
        let positions = reference.as_chunks::<POSE_FLOATS>().0.iter().flat_map(|vertex| &vertex[..3]);
        let reach = positions.fold(0.0, |most: f64, coordinate| most.max(coordinate.abs())) + above * self.scale;
        Found { error, turned, reach, ..Found::default() }
    }

    /// Number of additions to float32 poses since they were the base pose, including this update of `heads` instances;
    /// `before`: before it. An upper bound for several instances, since it counts the passes of all.
    pub fn additions(&self, before: usize, stats: &UpdateStats, heads: u32) -> usize {
        match self.once {
            true => 1,
            false if stats.rebuilt == heads as usize => stats.passes,
            false => before + stats.passes,
        }
    }

    /// Bound on rounding errors of coordinates larger than the diagonal, in input units.
    ///
    /// An addition rounds a coordinate x by at most half a unit in its last place, ε/2 · |x| with ε = 2⁻²³. If
    /// uniformly distributed, the standard deviation is ε/2 · |x| / √3 in each of three coordinates, ε/2 · |x| for the
    /// vertex, and √n times as much for n additions. Five standard deviations are 2.5 · √n · ε · |x|, more than the
    /// largest error of one addition, √3 · ε/2 · |x|. [`POSITION_BOUND`] covers coordinates up to the diagonal.
    fn beyond(&self, found: &Found) -> f64 {
        let larger = (found.reach - self.scale).max(0.0);
        ROUNDED_TERMS * (found.additions as f64).sqrt() * f64::from(f32::EPSILON) * larger
    }

    /// The position error allowed. A tracked bound is subtracted from the budget before changes are deferred; otherwise
    /// the budget is added.
    pub fn allowed(&self, found: &Found) -> f64 {
        if self.tracked {
            found.bound.max(self.budget)
        } else {
            POSITION_BOUND * self.scale + self.beyond(found) + self.budget + found.bound
        }
    }

    /// Whether the errors are within the bounds.
    pub fn kept(&self, found: &Found) -> bool {
        // A budget bounds positions only; deferred changes rotate normals.
        let normals = if self.budget > 0.0 { 180.0 } else { NORMAL_BOUND_DEGREES };
        found.error.position <= self.allowed(found) && found.turned <= normals
    }

    /// Describes the errors if they exceed the bounds.
    pub fn complaint(&self, found: &Found) -> String {
        format!(
            "positions have an error of {:.3e} of the diagonal ({:.1e} allowed), normals of {:.4}° \
             ({NORMAL_BOUND_DEGREES}° allowed, plus rounding to the unit of poses)",
            found.error.position / self.scale,
            self.allowed(found) / self.scale,
            found.turned
        )
    }
}

/// The largest angle between normals, in degrees, minus the one that a difference of `length` causes.
fn turned(pose: &[f32], reference: &[f64], length: f64) -> f64 {
    let vertices = pose.as_chunks::<POSE_FLOATS>().0.iter().zip(reference.as_chunks::<POSE_FLOATS>().0);
    let angles = vertices.map(|(got, want)| {
        let (got, want) = (DVec3::from_slice(&got.map(f64::from)[3..]), DVec3::from_slice(&want[3..]));
        // For normals without a meaningful direction, `compare` takes lengths instead of angles.
        match want.length() {
            long if long >= SHORTEST_NORMAL && long > length => {
                angle_degrees(got, want) - (length / long).asin().to_degrees()
            }
            _ => got.distance(want) - length,
        }
    });
    angles.fold(0.0, |worst, angle| worse(angle, worst))
}

/// The largest difference between a triple of components in two poses, and the largest number there.
fn differences(pose: &[f32], reference: &[f64], triple: usize) -> [f64; 2] {
    let numbers = |i: &usize| i % POSE_FLOATS / 3 == triple;
    (0..reference.len()).filter(numbers).fold([0.0; 2], |[off, reach], i| {
        let got = pose.get(i).map_or(f64::NAN, |number| f64::from(*number));
        [worse(off, (got - reference[i]).abs()), worse(reach, reference[i].abs())]
    })
}

/// Compares poses of one instance with the float64 reference.
pub struct Checks<'a> {
    pub stage: &'a Stage,
    pub promise: Promise,
    /// Those of the further streams, group after group.
    promises: Vec<Promise>,
    /// Compares normals, too, and positions with these deltas at the requested weights.
    source: Option<Arc<KeptMesh>>,
    count: usize,
    additions: usize,
    pub found: Found,
    /// The largest [`errors`], in input units.
    most: [f64; 4],
    /// The first frame out of bounds, and a description of its errors.
    wrong: Option<(usize, String)>,
}

impl<'a> Checks<'a> {
    /// Checks positions and further streams of `stage` against the reference; with a `source` also normals, and
    /// positions against it.
    pub fn new(stage: &'a Stage, source: Option<Arc<KeptMesh>>) -> Self {
        let of_layout = |layout: &PackedLayout| Promise::new(&stage.desc, layout);
        let of_group = |layout: &PackedLayout| {
            // No bound on the drift of further streams is kept, and none of their changes is deferred.
            Promise { tracked: false, budget: 0.0, scale: 1.0, ..of_layout(layout) }
        };
        Self {
            stage,
            promise: of_layout(stage.mesh.layout()),
            promises: stage.mesh.groups().iter().skip(1).map(|group| of_group(group.layout())).collect(),
            source,
            count: 0,
            additions: 0,
            found: Found::default(),
            most: [0.0; 4],
            wrong: None,
        }
    }

    /// Updates the instance of `runner`, and if `due` compares its pose. Also returns the position error: against the
    /// source, if there is one.
    pub fn step(
        &mut self,
        frame: usize,
        runner: &mut Runner<'_>,
        weights: &[f32],
        due: bool,
    ) -> Result<(Frame, Option<f64>)> {
        let failed = |e| Failure::Failed(format!("frame {frame}: {}", Failure::from(e)));
        let step = runner.step(&[weights], Draws::default()).map_err(failed)?;
        self.found.bound = self.found.bound.max(step.stats.bound.into());
        self.additions = self.promise.additions(self.additions, &step.stats, 1);
        if !due {
            return Ok((step, None));
        }
        let (pose, mesh) = (&runner.pose(0, 0)?, &self.stage.mesh);
        let step_of_weights = self.promise.grid.map_or(1.0, |grid| grid.weight_step());
        let played = runner.played()?.map(|steps| steps.into_iter().map(|n| n as f32 * step_of_weights).collect());
        // If the device plans, the number of active targets in each block is unknown.
        let bound =
            played.as_ref().map_or(step.stats.bound.into(), |weights: &Vec<f32>| self.promise.rounding(weights)[0]);
        let applied = played.unwrap_or_else(|| self.promise.applied(weights));
        let reference = evaluate(mesh, &applied);
        let found = self.promise.find(pose, &reference, &applied);
        let mut found = Found { bound, additions: self.additions, ..found };
        let errors = if let Some(source) = &self.source {
            errors(pose, &reference, mesh, source, weights)
        } else {
            found.turned = 0.0;
            let error = found.error.position;
            [error, f64::NAN, f64::NAN, error]
        };
        self.most.iter_mut().zip(errors).for_each(|(most, error)| *most = worse(*most, error));
        let mut complaint = (!self.promise.kept(&found)).then(|| self.promise.complaint(&found));
        for (group, packed) in mesh.groups().iter().enumerate().skip(1) {
            let promise = &self.promises[group - 1];
            let (pose, reference) = (runner.pose(0, group)?, evaluate_group(packed, &applied));
            for (triple, bound) in promise.rounding(&applied).into_iter().enumerate() {
                let [off, reach] = differences(&pose, &reference, triple);
                let allowed = promise.allowed(&Found { bound, reach: reach + promise.scale, ..found });
                found.streams = worse(found.streams, off);
                if off.is_nan() || off > allowed {
                    complaint.get_or_insert(format!(
                        "streams of group {group} have an error of {off:.3e} ({allowed:.1e} allowed)"
                    ));
                }
            }
        }
        if let Some(complaint) = complaint {
            self.wrong.get_or_insert((frame, complaint));
        }
        self.count += 1;
        self.found = self.found.max(found);
        Ok((step, Some(errors[0])))
    }

    /// The update options and the comparisons, in the JSON of `play`, `soak` and `apply`. Fields may be added, never
    /// renamed. Without a source, errors are those against the float64 reference: of sums of integers with weights
    /// rounded to their grid. The bound is the largest that the path stated, in input units, from drift or from
    /// rounding to the unit of poses; 0 if neither occurs. `streams_error` is the largest difference of any component
    /// of further streams (tangents, texture coordinates, colours) from the reference; 0 without any.
    pub fn record(&self) -> impl Serialize + use<> {
        let (bound, scale) = (self.found.bound, self.promise.scale);
        let more = json!({
            "checks": self.count, "bound": bound, "bound_rel": bound / scale, "streams_error": self.found.streams,
        });
        With { fields: self.stage.setup(), more: With { fields: Errors::new(self.most, scale), more } }
    }

    /// The result in words.
    pub fn text(&self) -> String {
        let relative = |length: f64| sig3(length / self.promise.scale);
        let bound = match self.found.bound {
            0.0 => String::new(),
            bound if self.promise.tracked => format!("; bound: {}", relative(bound)),
            bound if self.promise.budget > 0.0 => format!("; at most {} of it from rounding poses", relative(bound)),
            bound => format!("; at most {} from rounding poses", relative(bound)),
        };
        let streams = match self.found.streams {
            0.0 => String::new(),
            off => format!("; maximum error of further streams: {}", sig3(off)),
        };
        let [whole, packing, weights, rounding] = self.most.map(relative);
        let (against, parts) = match &self.source {
            None => ("the float64 reference", String::new()),
            Some(_) => {
                (self.stage.source, format!(": packing {packing}, rounded weights {weights}, rounding {rounding}"))
            }
        };
        let (count, length) = (thousands(self.count), sig3(self.most[0]));
        format!(
            "poses compared: {count}; maximum error against {against}: {whole} of the diagonal ({length} in the units of \
             the file){parts}{bound}{streams}"
        )
    }

    /// A failure if any frame was out of bounds; a warning if another pose format would be more accurate.
    pub fn verdict(&self, out: &Output) -> Result<()> {
        let UpdateDesc { pose, error_budget, .. } = self.stage.desc;
        let off = self.most[2].max(self.found.error.position) / self.promise.scale;
        // Deferred changes are counted, too.
        if pose.has_integers() && error_budget == 0.0 && off > FAR_OFF {
            let (name, off) = (pose.name(), sig3(off));
            let finer = if pose == PoseFormat::Fixed16 { "rebuilt16 (of the same size) or fixed32" } else { "float32" };
            out.warn(format_args!("{name} poses have an error of {off} of the diagonal: try --pose {finer}"));
        }
        let path = self.stage.desc.path.name();
        self.wrong.as_ref().map_or(Ok(()), |(frame, complaint)| {
            Err(Failure::Failed(format!("frame {frame} is wrong on the path '{path}': {complaint}; {REMEDY}")))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::mesh::MorphTarget;
    use deltamorph::{BatchSize, DeltaFormat, Mesh, PackDesc, PoseFormat, Tolerance, UpdatePath};
    use glam::Vec3;

    #[test]
    fn every_kind_of_poses_has_its_own_promise() {
        let mesh = crate::info::tests::mesh();
        let layout = |format| PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("packed").layout().clone();
        let blocks = layout(DeltaFormat::Fast);
        let float = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
        let [exact, narrow] = [PoseFormat::Fixed32, PoseFormat::Fixed16].map(|pose| UpdateDesc { pose, ..float });
        let patient = |desc: UpdateDesc| UpdateDesc { error_budget: 0.5, ..desc };
        let found = Found { bound: 0.25, ..Found::default() };
        let allowed = |desc: UpdateDesc, layout: &PackedLayout| Promise::new(&desc, layout).allowed(&found);
        let own = 3e-6 * f64::from(mesh.diagonal);
        assert_eq!((allowed(float, &blocks), allowed(patient(float), &blocks)), (0.25, 0.5));
        // The bound includes rounding to a unit; budgets are added.
        assert_eq!((allowed(narrow, &blocks), allowed(patient(narrow), &blocks)), (own + 0.25, own + 0.5 + 0.25));
        let rounding = |desc: UpdateDesc, weights: &[f32]| Promise::new(&desc, &blocks).rounding(weights);
        let two = rounding(narrow, &[0.5, 1.0]);
        assert_eq!(rounding(patient(narrow), &[0.5, 0.0]), two, "what waits may be a weight");

        let error = |position, normal_degrees| Found {
            error: PoseError { position, normal_degrees, ..PoseError::default() },
            turned: normal_degrees,
            ..found
        };
        let promise = Promise::new(&float, &blocks);
        assert!(promise.kept(&error(0.2, 0.0)) && !promise.kept(&error(0.3, 0.0)) && !promise.kept(&error(0.0, 1.0)));
        assert!(Promise::new(&patient(float), &blocks).kept(&error(0.4, 1.0)));
        assert!(promise.complaint(&error(0.3, 0.0)).contains("allowed"));

        let rounded = Promise::new(&exact, &blocks).applied(&[0.3])[0];
        assert!(rounded != 0.3 && (rounded - 0.3).abs() < 0.01, "{rounded}");
    }

    /// A quad of diagonal 0.42 at `x` along the x axis; its 40 targets move it by up to a tenth of the diagonal.
    fn quad(x: f32) -> KeptMesh {
        let corners = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.3, 0.0], [0.0, 0.3, 0.0]];
        let target = |t: usize| {
            let angle = |v: usize| (7 * t + 3 * v) as f32;
            let delta = |v| (v as u32, 0.04 * Vec3::new(angle(v).sin(), angle(v).cos(), (2.0 * angle(v)).sin()));
            let (name, positions, normals) = (t.to_string(), (0..4).map(delta).collect(), Some(vec![]));
            MorphTarget { name, positions, normals, streams: vec![] }
        };
        let source = Mesh {
            positions: corners.map(|corner| Vec3::from(corner) + Vec3::X * x).to_vec(),
            normals: Some(vec![Vec3::Z; 4]),
            targets: (0..40).map(target).collect(),
            ..Mesh::default()
        };
        source.kept(Tolerance::ZERO).expect("a mesh")
    }

    #[test]
    fn far_from_the_origin_rounding_is_right_and_a_wrong_delta_is_not() {
        let formats = [DeltaFormat::Float32, DeltaFormat::Snorm16, DeltaFormat::Fast];
        let poses = [PoseFormat::Float32, PoseFormat::Fixed32];
        for (x, format, pose) in [0.0, 2.0, 5.0, 50.0]
            .into_iter()
            .flat_map(|x| formats.into_iter().flat_map(move |format| poses.map(|pose| (x, format, pose))))
        {
            let batch = if format.is_blocks() { BatchSize::All } else { BatchSize::Targets(1) };
            let desc = UpdateDesc { pose, tolerance: 1e-3, ..UpdateDesc::new(UpdatePath::Cpu, batch) };
            let mesh = Arc::new(PackedMesh::pack(&quad(x), &PackDesc::new(format)).expect("packed"));
            let Ok(mut crowd) = CpuCrowd::new(mesh.clone(), &CrowdDesc::new(desc), 1) else {
                assert!(!format.is_blocks() && pose == PoseFormat::Fixed32, "{format:?} {pose:?}");
                continue;
            };
            let promise = Promise::new(&desc, mesh.layout());
            let (mut weights, mut additions) = (vec![0.5f32; 40], 0);
            for frame in 0..300 {
                weights[frame * 7 % 40] = 0.1 + frame as f32 / 400.0;
                weights[frame * 11 % 40] = 0.9 - frame as f32 / 400.0;
                crowd.set_weights(0, &weights).expect("weights");
                let stats = crowd.update();
                additions = promise.additions(additions, &stats, 1);
                let pose = mesh.layout().to_user_order(&crowd.pose(0).expect("a pose"));
                let find = |weights: &[f32]| {
                    let applied = promise.applied(weights);
                    let bound = f64::from(stats.bound);
                    let found = promise.find(&pose, &evaluate(&mesh, &applied), &applied);
                    Found { additions, bound, ..found }
                };
                let what = format!("{format:?} {} at {x}, frame {frame}", desc.pose.name());
                let right = find(&weights);
                assert!(promise.kept(&right), "{what}: {}", promise.complaint(&right));
                // A fiftieth of one of the forty targets is 2e-3 of the diagonal.
                let mut wrong = weights.clone();
                wrong[13] += 0.02;
                assert!(!promise.kept(&find(&wrong)), "{what}");
            }
        }
    }

    #[test]
    fn normals_may_turn_as_far_as_their_rounding_reaches() {
        let vertex = |x: f64, z: f64| [0.0, 0.0, 0.0, x, 0.0, z];
        let found = |got: [f64; 6], want: [f64; 6], length| turned(&got.map(|v| v as f32), &want, length);
        // A right angle, and one of 45 degrees; a difference longer than the normal itself allows any angle.
        assert!((found(vertex(1.0, 0.0), vertex(0.0, 1.0), 0.5) - 60.0).abs() < 1e-4);
        assert!(found(vertex(0.5, 0.5), vertex(0.0, 1.0), 0.8) <= 0.0);
        assert!(found(vertex(0.1, 0.0), vertex(0.0, 0.1), 0.2) <= 0.0);
        assert!(found(vertex(0.5, 0.0), vertex(0.0, 0.1), 0.2) > 0.3, "longer than rounding makes it");
        assert!(found(vertex(0.02, 0.0), vertex(0.0, 1e-5), 0.005) > 0.014, "no direction, but a length");
        assert!(found(vertex(f64::NAN, 0.0), vertex(0.0, 1.0), 0.5).is_nan());
    }
}
