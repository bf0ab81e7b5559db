//! What an update path promises, and whether a pose keeps it: one rule for `bench`, `play` and `soak`.

use crate::output::Failure;
use crate::runner::{Frame, Runner, Setup, Stage};
use crate::table::{sig3, thousands};
use deltamorph::reference::{compare, evaluate, evaluate_unpacked};
use deltamorph::{Accumulate, ExactGrid, MorphMesh, PackedLayout, PoseError, UpdateDesc};
use serde::Serialize;
use std::sync::Arc;

/// What to do about a wrong pose.
pub const REMEDY: &str = "try another --path, and report this with what `deltamorph devices` prints";

/// A result is right when positions are within this fraction of the diagonal …
const POSITION_BOUND: f64 = 3e-6;
/// … and normals within this many degrees of the float64 reference on the deltas kept.
const NORMAL_BOUND_DEGREES: f64 = 0.01;

/// What verification found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Found {
    /// Against the reference on the packed deltas.
    pub error: PoseError,
    /// Against the raw files.
    pub raw: PoseError,
    /// The path's own bound on positions, in input units.
    pub bound: f64,
}

impl Found {
    pub fn max(self, other: Self) -> Self {
        Self { error: self.error.max(other.error), raw: self.raw.max(other.raw), bound: self.bound.max(other.bound) }
    }
}

/// What errors are stated relative to: the diagonal. A single point has none; its errors stay absolute.
pub fn scale(diagonal: f32) -> f64 {
    if diagonal > 0.0 { f64::from(diagonal) } else { 1.0 }
}

/// What a path promises on a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Promise {
    /// Poses carry a bound on what accumulation may have done.
    tracked: bool,
    grid: Option<ExactGrid>,
    budget: f64,
    /// The length that errors are stated relative to.
    pub scale: f64,
}

impl Promise {
    pub fn new(desc: &UpdateDesc, layout: &PackedLayout) -> Self {
        let exact = desc.accumulate == Accumulate::Exact;
        Self {
            tracked: layout.blocks.is_some() && !exact,
            grid: layout.blocks.as_ref().filter(|_| exact).and_then(|blocks| blocks.exact().ok()),
            budget: f64::from(desc.error_budget),
            scale: scale(layout.diagonal),
        }
    }

    /// The weights that the result is compared with: exact sums take those of their grid.
    pub fn applied(&self, weights: &[f32]) -> Vec<f32> {
        weights.iter().map(|&w| self.grid.map_or(w, |grid| grid.round(w))).collect()
    }

    /// The position error allowed. A tracked bound comes off the budget before a change may wait; elsewhere the budget
    /// comes on top.
    pub fn allowed(&self, found: &Found) -> f64 {
        if self.tracked { found.bound.max(self.budget) } else { POSITION_BOUND * self.scale + self.budget }
    }

    /// Whether the promise is kept.
    pub fn kept(&self, found: &Found) -> bool {
        // A budget bounds positions; what waits turns normals as well.
        let normals = if self.budget > 0.0 { 180.0 } else { NORMAL_BOUND_DEGREES };
        found.error.within(self.allowed(found), normals)
    }

    /// What is wrong, where the promise is not kept.
    pub fn complaint(&self, found: &Found) -> String {
        format!(
            "positions are off by {:.3e} of the diagonal ({:.1e} allowed), normals by {:.4}° \
             ({NORMAL_BOUND_DEGREES}° allowed)",
            found.error.position / self.scale,
            self.allowed(found) / self.scale,
            found.error.normal_degrees
        )
    }
}

/// Poses of one head, each compared with the float64 reference.
pub struct Checks<'a> {
    pub stage: &'a Stage,
    pub promise: Promise,
    /// Compare with these deltas, too.
    pub raw: Option<Arc<MorphMesh>>,
    /// Compare normals, and also with the requested weights.
    full: bool,
    count: usize,
    pub found: Found,
    /// Largest position error against the requested weights.
    pub request: f64,
    /// The first frame that breaks the promise, and how.
    wrong: Option<(usize, String)>,
}

/// How poses were updated, and what comparisons found, in the JSON of `play` and `soak`.
#[derive(Debug, Serialize)]
pub struct Checked {
    #[serde(flatten)]
    setup: Setup,
    /// Frames that were compared with the reference.
    checks: usize,
    /// Largest position error against the float64 reference, in input units, and as a fraction of the diagonal. Exact
    /// sums are held to the weights as their grid rounds them.
    max_error: f64,
    max_error_rel: f64,
    /// The largest bound that the path kept, in input units; 0 where it keeps none.
    bound: f64,
}

impl<'a> Checks<'a> {
    /// Of poses of `stage`; against `raw` as well, where it is given. `full`: also normals, and against the requested
    /// weights.
    pub fn new(stage: &'a Stage, raw: Option<Arc<MorphMesh>>, full: bool) -> Self {
        let promise = Promise::new(&stage.desc, stage.mesh.layout());
        Self { stage, promise, raw, full, count: 0, found: Found::default(), request: 0.0, wrong: None }
    }

    /// Update the head of `runner`, and compare its pose where that is `due`. Returns the position error, too.
    pub fn step(
        &mut self,
        frame: usize,
        runner: &mut Runner<'_>,
        weights: &[f32],
        due: bool,
    ) -> Result<(Frame, Option<f64>), Failure> {
        let failed = |e| Failure::Failed(format!("frame {frame}: {}", Failure::from(e)));
        let step = runner.step(&[weights], 0).map_err(failed)?;
        let bound = step.stats.bound.into();
        self.found.bound = self.found.bound.max(bound);
        if !due {
            return Ok((step, None));
        }
        let (pose, mesh) = (&runner.pose(0)?, &self.stage.mesh);
        let applied = runner.played(mesh)?.unwrap_or_else(|| self.promise.applied(weights));
        let mut error = compare(pose, &evaluate(mesh, &applied));
        let raw = self.raw.as_ref().map(|raw| compare(pose, &evaluate_unpacked(raw, weights))).unwrap_or_default();
        if self.full {
            let request = if applied == weights { error } else { compare(pose, &evaluate(mesh, weights)) };
            self.request = self.request.max(request.position);
        } else {
            error = PoseError { position: error.position, ..PoseError::default() };
        }
        let found = Found { error, raw, bound };
        if !self.promise.kept(&found) && self.wrong.is_none() {
            self.wrong = Some((frame, self.promise.complaint(&found)));
        }
        self.count += 1;
        self.found = self.found.max(found);
        Ok((step, Some(error.position)))
    }

    pub fn record(&self) -> Checked {
        Checked {
            setup: self.stage.setup(),
            checks: self.count,
            max_error: self.found.error.position,
            max_error_rel: self.found.error.position / self.promise.scale,
            bound: self.found.bound,
        }
    }

    /// The same for people.
    pub fn text(&self) -> String {
        let relative = |length: f64| sig3(length / self.promise.scale);
        let bound = match self.found.bound {
            0.0 => String::new(),
            bound => format!(", at most {} by the bound kept", relative(bound)),
        };
        let (count, error) = (thousands(self.count), relative(self.found.error.position));
        format!("largest error in {count} frames, of the diagonal: {error} against the float64 reference{bound}")
    }

    /// A failure where a frame broke the promise.
    pub fn verdict(&self) -> Result<(), Failure> {
        let path = self.stage.desc.path.name();
        self.wrong.as_ref().map_or(Ok(()), |(frame, complaint)| {
            Err(Failure::Failed(format!("frame {frame} is wrong through '{path}': {complaint}; {REMEDY}")))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::{BatchSize, DeltaFormat, PackDesc, PackedMesh, UpdatePath};

    #[test]
    fn every_kind_of_sums_has_its_own_promise() {
        let mesh = crate::info::tests::mesh();
        let layout = |format| PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("packed").layout().clone();
        let (dense, blocks) = (layout(DeltaFormat::Float32), layout(DeltaFormat::Fast));
        let float = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
        let exact = float.accumulate(Accumulate::Exact);
        let patient = |desc: UpdateDesc| desc.error_budget(0.5);
        let found = Found { bound: 0.25, ..Found::default() };
        let allowed = |desc: UpdateDesc, layout: &PackedLayout| Promise::new(&desc, layout).allowed(&found);
        let own = 3e-6 * f64::from(mesh.diagonal);
        assert_eq!(allowed(float, &dense), own);
        assert_eq!((allowed(float, &blocks), allowed(patient(float), &blocks)), (0.25, 0.5));
        assert_eq!((allowed(exact, &blocks), allowed(patient(exact), &blocks)), (own, own + 0.5));

        let error = |position, normal_degrees| Found {
            error: PoseError { position, normal_degrees, ..PoseError::default() },
            ..found
        };
        let promise = Promise::new(&float, &blocks);
        assert!(promise.kept(&error(0.2, 0.0)) && !promise.kept(&error(0.3, 0.0)) && !promise.kept(&error(0.0, 1.0)));
        assert!(Promise::new(&patient(float), &blocks).kept(&error(0.4, 1.0)));
        assert!(promise.complaint(&error(0.3, 0.0)).contains("allowed"));

        assert_eq!(promise.applied(&[0.3]), [0.3]);
        let rounded = Promise::new(&exact, &blocks).applied(&[0.3])[0];
        assert!(rounded != 0.3 && (rounded - 0.3).abs() < 0.01, "{rounded}");
    }
}
