//! Poses read back to host memory, decoded.

use crate::arguments::check_command_buffer;
use crate::engine::Engine;
use crate::handles::{DmCrowd, DmEngine, DmReadback, Handle, handle};
use crate::memory::{check_place, fill, slice};
use crate::numbers::semantic;
use crate::result::{DmResult, Failure, enter, lock};
use deltamorph::ash::vk;
use deltamorph::{PoseReadback, ReadPose};
use std::sync::{Arc, Mutex};

/// The object of a `DmReadback`.
pub struct Readback {
    state: Mutex<State>,
    pub(crate) engine: Arc<Engine>,
}

handle!(DmReadback for Readback);

struct State {
    readback: PoseReadback,
    /// The poses recorded last, decoded at the first query.
    poses: Option<Vec<ReadPose>>,
}

/// Make an object for reading poses back. Its memory is allocated when copies are recorded, as much as the poses take.
///
/// # Safety
/// `readback` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_readback_create(engine: DmEngine, readback: *mut DmReadback) -> DmResult {
    enter("dm_readback_create", || {
        check_place(readback, "readback")?;
        let engine = engine.get()?;
        let state = Mutex::new(State { readback: engine.morph.readback(), poses: None });
        // SAFETY: the caller's obligation; it was checked.
        unsafe { readback.write(DmReadback::insert(Readback { state, engine })) };
        Ok(())
    })
}

/// Record copies of the poses of `count` instances of a crowd, replacing those recorded before. They come after the
/// update that writes the poses, in the same command buffer or a later one.
///
/// This records: a barrier from the stages that write poses to copies, whatever the consumers of the crowd are; the
/// copies; and a barrier that makes them visible to the host, and that later updates wait for.
///
/// Errors: DM_ERROR_INVALID for a crowd of another engine; those of `dm_crowd_pose`, for each instance;
/// DM_ERROR_OUT_OF_MEMORY. Nothing is recorded then.
///
/// # Safety
/// - `cmd` as in `dm_record_update`, on the queue that updates of the crowd run on. It runs after the updates of the
///   crowd that were recorded so far, and before later ones.
/// - Commands recorded with this read-back before have finished, or never run. It and the crowd live until the device
///   has finished.
/// - There are `count` instances.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_readback_record(
    readback: DmReadback,
    cmd: vk::CommandBuffer,
    crowd: DmCrowd,
    instances: *const u32,
    count: u32,
) -> DmResult {
    enter("dm_readback_record", || {
        let readback = readback.get()?;
        let crowd = crowd.get()?;
        check_command_buffer(cmd)?;
        // SAFETY: the caller's obligation.
        let instances = unsafe { slice(instances, count as usize, "instances") }?;
        let mut locked = lock(&readback.state)?;
        let state = lock(&crowd.state)?;
        locked.poses = None;
        // SAFETY: the caller's obligations.
        Ok(unsafe { locked.readback.record(cmd, &state.crowd, instances) }?)
    })
}

/// Get one of the poses recorded last, decoded: that of the `at`-th instance of the recorded list, in the order of the
/// mesh as it was imported, without padding. `stream` 0: six floats a vertex, the position in input units and the
/// normal, not normalised; another stream of the mesh (`DM_STREAM_…`): its components, vertex after vertex.
///
/// Errors: DM_ERROR_INVALID for `at` out of range, a stream that the mesh does not have, too little room.
///
/// # Safety
/// The command buffer with the copies has finished: the host has waited for its fence. There is room for `count`
/// floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_readback_pose(
    readback: DmReadback,
    at: u32,
    stream: u32,
    values: *mut f32,
    count: usize,
) -> DmResult {
    enter("dm_readback_pose", || {
        let readback = readback.get()?;
        let State { readback, poses } = &mut *lock(&readback.state)?;
        let poses = match poses {
            Some(poses) => poses,
            // SAFETY: the caller's obligation.
            None => poses.insert(unsafe { readback.poses() }?),
        };
        let pose = poses.get(at as usize).ok_or_else(|| {
            Failure::invalid(format!(
                "pose {at} of {} that were read back; dm_readback_record names the instances, counted from 0",
                poses.len()
            ))
        })?;
        let found = match stream {
            0 => &pose.vertices,
            _ => {
                let wanted = semantic(stream)?;
                let found = pose.streams.iter().find(|(semantic, _)| *semantic == wanted);
                let text =
                    "a stream that was not read back; use 0 for positions and normals, or another that the mesh has";
                &found.ok_or_else(|| Failure::invalid(text))?.1
            }
        };
        // SAFETY: the caller's obligation.
        unsafe { fill(values, count, found, "values") }
    })
}

/// Destroy a read-back.
///
/// # Safety
/// Commands recorded with it have finished, or never run.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_readback_destroy(readback: DmReadback) -> DmResult {
    enter("dm_readback_destroy", || readback.destroy(|_| Ok(())))
}
