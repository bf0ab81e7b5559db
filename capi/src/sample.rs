//! The built-in head and its clip, which examples take.

use crate::arguments::or;
use crate::clip::Clip;
use crate::handles::{DmClip, DmMesh, Handle};
use crate::memory::{check_place, read_or_default};
use crate::mesh::{Mesh, create};
use crate::result::{DmResult, Result, ensure, enter};
use crate::structs::{DmMeshDesc, DmSampleDesc};
use deltamorph_head::{HeadDesc, head, head_clip};

/// Limits on the vertices of the built-in head, and on vertices times targets: some gigabytes.
const HEAD_VERTICES: usize = 10_000_000;
const HEAD_DELTAS: u64 = 1 << 28;

/// The description of the built-in head.
fn head_desc(sample: &DmSampleDesc) -> Result<HeadDesc> {
    let default = HeadDesc::default();
    let vertices = or(sample.vertices as usize, default.vertices);
    let targets = or(sample.targets as usize, default.targets);
    let sparsity = or(sample.sparsity, default.sparsity);
    let seed = or(sample.seed, default.seed);
    ensure!(
        vertices <= HEAD_VERTICES && vertices as u64 * targets as u64 <= HEAD_DELTAS,
        "a head of {vertices} vertices and {targets} targets; use 10,000,000 vertices at most, and 2^28 for vertices \
         times targets"
    );
    let fits = sparsity > 0.0 && sparsity <= 1.0;
    ensure!(fits, "a sparsity of {sparsity}; use a number above 0 and at most 1");
    Ok(HeadDesc { vertices, targets, sparsity, seed })
}

/// The most weights of a clip of the built-in head.
const CLIP_WEIGHTS: u64 = 1 << 24;

/// Make the built-in head that `sample` describes (null: the defaults).
///
/// Errors: DM_ERROR_INVALID for invalid fields of `sample` or `desc`: more than 10,000,000 vertices, or 2^28 for
/// vertices times targets.
///
/// # Safety
/// `sample` and `desc` are null (the defaults) or structures; `mesh` can be written.
#[cfg(feature = "sample")]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_sample_head(
    sample: *const DmSampleDesc,
    desc: *const DmMeshDesc,
    mesh: *mut DmMesh,
) -> DmResult {
    let make = |desc: &DmMeshDesc| {
        // SAFETY: the caller's obligation.
        let sample = unsafe { read_or_default(sample) }?;
        Mesh::of_source(head(&head_desc(&sample)?), desc)
    };
    // SAFETY: the caller's obligations.
    unsafe { create("dm_mesh_sample_head", desc, mesh, make) }
}

/// Make the clip of the built-in head that `sample` describes (null: the defaults). `fps` is its frame rate, from 0.1
/// to 1000; 0: 30.
///
/// Errors: DM_ERROR_INVALID for another frame rate, more than 2^24 weights (frames times targets), or values of
/// `sample` that `dm_mesh_sample_head` refuses.
///
/// # Safety
/// `sample` is null (the defaults) or a structure; `clip` can be written.
#[cfg(feature = "sample")]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_clip_sample_head(
    sample: *const DmSampleDesc,
    frame_count: u32,
    fps: f32,
    clip: *mut DmClip,
) -> DmResult {
    enter("dm_clip_sample_head", || {
        check_place(clip, "clip")?;
        // SAFETY: the caller's obligations; `clip` was checked.
        unsafe {
            let desc = head_desc(&read_or_default(sample)?)?;
            let fits = fps == 0.0 || (0.1..=1000.0).contains(&fps);
            ensure!(fits, "{fps} frames per second; use a number from 0.1 to 1000");
            let targets = desc.targets;
            ensure!(
                u64::from(frame_count) * targets as u64 <= CLIP_WEIGHTS,
                "{frame_count} frames of {targets} targets, more than 2^24 weights; use fewer frames"
            );
            clip.write(DmClip::insert(Clip { clip: head_clip(&desc, frame_count as usize, fps) }));
        }
        Ok(())
    })
}
