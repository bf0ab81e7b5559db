//! Buffers and layouts of poses and their streams.

use crate::crowd::with;
use crate::handles::DmCrowd;
use crate::memory::{Place, Versioned};
use crate::numbers::{pose_number, semantic};
use crate::result::{DmResult, enter};
use crate::structs::{DmPoseView, DmStreamView};
use deltamorph::ash::vk;
use deltamorph::{PoseView, StreamView};

/// A pose, and the one before it, if it is there.
fn pose_view(view: &PoseView, previous: Option<&PoseView>) -> DmPoseView {
    DmPoseView {
        stride: view.stride,
        buffer: view.buffer,
        offset: view.offset,
        size: view.size,
        format: pose_number(view.format),
        slot: view.slot,
        units: view.units,
        offsets: view.offsets,
        previous_buffer: previous.map_or(vk::Buffer::null(), |previous| previous.buffer),
        previous_offset: previous.map_or(0, |previous| previous.offset),
        ..DmPoseView::zeroed()
    }
}

pub(crate) fn stream_view(view: &StreamView) -> DmStreamView {
    DmStreamView {
        stride: view.stride,
        buffer: view.buffer,
        offset: view.offset,
        components: view.components,
        format: pose_number(view.format),
        units: view.units,
        offsets: view.offsets,
        slot: view.slot,
        ..DmStreamView::zeroed()
    }
}

/// Get the buffer and layout of an instance's pose, and of the pose before its last update, for motion vectors. They
/// are valid once the updates recorded so far have run.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed; if no update was recorded yet, or the instance's
/// update was discarded.
///
/// # Safety
/// `view` is a structure that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_pose(crowd: DmCrowd, instance: u32, view: *mut DmPoseView) -> DmResult {
    enter("dm_crowd_pose", || {
        // SAFETY: the caller's obligation.
        let place = unsafe { Place::new(view) }?;
        let (found, previous) = with(crowd, |state| {
            let crowd = &state.crowd;
            Ok((crowd.pose(instance)?, crowd.previous_pose(instance)?))
        })?;
        place.write(pose_view(&found, previous.as_ref()));
        Ok(())
    })
}

/// Get the buffer and layout of any stream (`DM_STREAM_…`) of the mesh in an instance's pose.
///
/// Errors: those of `dm_crowd_pose`; DM_ERROR_INVALID for a stream that the mesh does not have.
///
/// # Safety
/// `view` is a structure that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_stream(
    crowd: DmCrowd,
    instance: u32,
    stream: u32,
    view: *mut DmStreamView,
) -> DmResult {
    enter("dm_crowd_stream", || {
        // SAFETY: the caller's obligation.
        let place = unsafe { Place::new(view) }?;
        let stream = semantic(stream)?;
        let found = with(crowd, |state| Ok(state.crowd.stream(instance, stream)?))?;
        place.write(stream_view(&found));
        Ok(())
    })
}
