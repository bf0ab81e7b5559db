//! Weights of crowds: set, and read back.

use crate::crowd::with;
use crate::handles::DmCrowd;
use crate::memory::{fill, slice, text};
use crate::result::{DmResult, enter};
use std::ffi::c_char;

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

/// Request the weight of one target, counted from 0 in the mesh's order, from the next recorded update on; the others
/// keep the requested weights.
///
/// Errors: DM_ERROR_INVALID for a target out of range; those of `dm_crowd_set_weights`. Nothing changes then.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_weight(crowd: DmCrowd, instance: u32, target: u32, weight: f32) -> DmResult {
    let set = || with(crowd, |state| Ok(state.weighted()?.set_weight(instance, target as usize, weight)?));
    enter("dm_crowd_set_weight", set)
}

/// Request the weight of the target called `name`, as `dm_crowd_set_weight` does. The names are searched; of several
/// equal ones the first is used.
///
/// Errors: DM_ERROR_INVALID for a name that the mesh does not have, with the most similar name; those of
/// `dm_crowd_set_weights`. Nothing changes then.
///
/// # Safety
/// `name` is a UTF-8 string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_weight_by_name(
    crowd: DmCrowd,
    instance: u32,
    name: *const c_char,
    weight: f32,
) -> DmResult {
    enter("dm_crowd_set_weight_by_name", || {
        // SAFETY: the caller's obligation.
        let name = unsafe { text(name, "name") }?;
        with(crowd, |state| Ok(state.weighted()?.set_weight_by_name(instance, name, weight)?))
    })
}

/// Get the weights requested of an instance, one per target in the mesh's order.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, too little room, a crowd that plays clips.
///
/// # Safety
/// There is room for `count` weights.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_weights(crowd: DmCrowd, instance: u32, weights: *mut f32, count: u32) -> DmResult {
    enter("dm_crowd_weights", || {
        with(crowd, |state| {
            // SAFETY: the caller's obligation.
            unsafe { fill(weights, count as usize, state.weighted()?.weights(instance)?, "weights") }
        })
    })
}
