//! What an update path promises, and whether a pose keeps it: one rule for `bench`, `play` and `soak`.

use deltamorph::{Accumulate, ExactGrid, PackedLayout, PoseError, UpdateDesc};

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
    /// The larger of both, each.
    pub fn max(self, other: Self) -> Self {
        Self { error: self.error.max(other.error), raw: self.raw.max(other.raw), bound: self.bound.max(other.bound) }
    }
}

/// What a path promises on a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Promise {
    /// Poses carry a bound on what accumulation may have done.
    tracked: bool,
    grid: Option<ExactGrid>,
    budget: f64,
    scale: f64,
}

impl Promise {
    /// What `desc` promises on a mesh packed as `layout`.
    pub fn new(desc: &UpdateDesc, layout: &PackedLayout) -> Self {
        let exact = desc.accumulate == Accumulate::Exact;
        Self {
            tracked: layout.blocks.is_some() && !exact,
            grid: layout.blocks.as_ref().filter(|_| exact).and_then(|blocks| blocks.exact().ok()),
            budget: f64::from(desc.error_budget),
            // A single point has no diagonal; its errors stay absolute.
            scale: if layout.diagonal > 0.0 { f64::from(layout.diagonal) } else { 1.0 },
        }
    }

    /// The length that errors are stated relative to.
    pub fn scale(&self) -> f64 {
        self.scale
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
        let exact = UpdateDesc { accumulate: Accumulate::Exact, ..float };
        let patient = |desc: UpdateDesc| UpdateDesc { error_budget: 0.5, ..desc };
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
