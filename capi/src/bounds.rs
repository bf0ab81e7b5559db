//! Bounds of poses from their weights, without a GPU.

use crate::crowd::crowd_desc;
use crate::handles::{DmMesh, DmWeightBounds, Handle, handle};
use crate::memory::{check_place, fill, slice};
use crate::result::{DmResult, ensure, enter};
use crate::structs::DmCrowdDesc;
use deltamorph::PoseFormat;

/// The object of a `DmWeightBounds`.
pub struct WeightBounds {
    bounds: deltamorph::WeightBounds,
    targets: usize,
}

handle!(DmWeightBounds for WeightBounds);

/// Make an object that computes bounds of poses from their weights, for crowds of a mesh that are made by `desc`: for
/// culling without waiting for a GPU. The bounds hold, but are somewhat larger than the exact ones. The mesh may be
/// destroyed afterwards.
///
/// Errors: DM_ERROR_INVALID for fixed-point poses that the mesh has no grid for; those of `dm_crowd_create` for invalid
/// fields of `desc`.
///
/// # Safety
/// `desc` as in `dm_crowd_create`; `bounds` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_weight_bounds_create(
    mesh: DmMesh,
    desc: *const DmCrowdDesc,
    bounds: *mut DmWeightBounds,
) -> DmResult {
    enter("dm_weight_bounds_create", || {
        check_place(bounds, "bounds")?;
        // SAFETY: the caller's obligation.
        let desc = unsafe { crowd_desc(desc, PoseFormat::Float32) }?;
        let mesh = mesh.get()?;
        let made = deltamorph::WeightBounds::new(&mesh.packed, &desc.update)?;
        let made = WeightBounds { bounds: made, targets: mesh.layout().targets.len() };
        // SAFETY: the caller's obligation; it was checked.
        unsafe { bounds.write(DmWeightBounds::insert(made)) };
        Ok(())
    })
}

/// Write bounds of the pose with these weights, one weight for each target: six numbers, the least x, y and z of any
/// vertex, then the greatest. `bound` is how far updates may have moved vertices beyond the exact pose: DmUpdate::bound
/// of the update that wrote the pose. For a mesh without vertices the least are infinite.
///
/// Errors: DM_ERROR_INVALID for a wrong number of weights, a weight that is not finite.
///
/// # Safety
/// There are `count` weights, and room for six numbers at `least_and_greatest`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_weight_bounds_of(
    bounds: DmWeightBounds,
    weights: *const f32,
    count: u32,
    bound: f32,
    least_and_greatest: *mut f32,
) -> DmResult {
    enter("dm_weight_bounds_of", || {
        // SAFETY: the caller's obligation.
        let weights = unsafe { slice(weights, count as usize, "weights") }?;
        let object = bounds.get()?;
        let targets = object.targets;
        ensure!(weights.len() == targets, "{count} weights for {targets} targets; give one for each");
        let finite = weights.iter().chain([&bound]).all(|weight| weight.is_finite());
        ensure!(finite, "a weight or bound that is not finite; use numbers");
        let found = object.bounds.of(weights, bound);
        // SAFETY: the caller's obligation.
        unsafe { fill(least_and_greatest, 6, &[found.min, found.max].concat(), "least_and_greatest") }
    })
}

/// Destroy an object that computes bounds.
#[unsafe(no_mangle)]
pub extern "C" fn dm_weight_bounds_destroy(bounds: DmWeightBounds) -> DmResult {
    enter("dm_weight_bounds_destroy", || bounds.destroy(|_| Ok(())))
}
