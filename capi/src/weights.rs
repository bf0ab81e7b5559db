//! Weights of crowds.

use crate::arguments::built;
use crate::crowd::with;
use crate::handles::DmCrowd;
use crate::memory::{slice, text};
use crate::result::{DmResult, enter};
use deltamorph::Error;
use std::ffi::c_char;
use std::io::Write;
use std::path::Path;

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

/// Start to log the calls on a crowd that decide its poses: weights, cuts, instances hidden, added and removed, error
/// budgets, updates, discards. `dm_crowd_write_calls` writes them to a file, for a report: `deltamorph replay` makes
/// the same calls on another driver, where fixed-point poses are the same bit for bit. A frame takes some 10 bytes
/// for each weight that changes.
///
/// Errors: DM_ERROR_UNSUPPORTED if the library was built without the feature `calls`; DM_ERROR_INVALID for a crowd that
/// plays clips.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_log_calls(crowd: DmCrowd) -> DmResult {
    enter("dm_crowd_log_calls", || {
        built!("calls", "logs of calls");
        with(crowd, |state| {
            state.weighted()?.log_calls();
            Ok(())
        })
    })
}

/// Append the calls logged since `dm_crowd_log_calls`, or since they were last written, to the file at `path`. Begin
/// with a file that does not exist.
///
/// Errors: DM_ERROR_IO, and the calls are lost then; those of `dm_crowd_log_calls`.
///
/// # Safety
/// `path` is a UTF-8 string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_write_calls(crowd: DmCrowd, path: *const c_char) -> DmResult {
    enter("dm_crowd_write_calls", || {
        built!("calls", "logs of calls");
        // SAFETY: the caller's obligation.
        let path = Path::new(unsafe { text(path, "path") }?);
        let calls = with(crowd, |state| Ok(state.weighted()?.take_calls()))?;
        let file = std::fs::File::options().create(true).append(true).open(path);
        let written = file.and_then(|mut file| file.write_all(calls.as_bytes()));
        Ok(written.map_err(|source| Error::Io { path: path.into(), action: "write", source })?)
    })
}
