//! Weights of crowds.

use crate::crowd::with;
use crate::handles::DmCrowd;
use crate::memory::slice;
use crate::result::{DmResult, enter};

/// Request these weights for an instance, one per target in the mesh's order, from the next recorded update on.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, a wrong number of weights, one that is not finite
/// or out of range, a crowd that plays clips. Nothing changes then.
///
/// # Safety
/// There are `count` weights.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_weights(
    crowd: DmCrowd,
    instance: u32,
    weights: *const f32,
    count: u32,
) -> DmResult {
    enter("dm_crowd_set_weights", || {
        // SAFETY: the caller's obligation.
        let weights = unsafe { slice(weights, count as usize, "weights") }?;
        with(crowd, |state| Ok(state.weighted()?.set_weights(instance, weights)?))
    })
}

/// Request the weight of one target, by its number (`dm_mesh_find_target`), from the next recorded update on; the
/// others keep the requested weights.
///
/// Errors: DM_ERROR_INVALID for a target out of range; those of `dm_crowd_set_weights`. Nothing changes then.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_weight(crowd: DmCrowd, instance: u32, target: u32, weight: f32) -> DmResult {
    let set = || with(crowd, |state| Ok(state.weighted()?.set_weight(instance, target as usize, weight)?));
    enter("dm_crowd_set_weight", set)
}
