//! Crowds that are updated on the CPU, without Vulkan.

use crate::handles::{DmCpuCrowd, DmMesh, Handle};
use crate::memory::{check_place, fill, read_or_default, slice};
use crate::result::{DmResult, Failure, Result, enter, lock};
use crate::structs::DmCrowdDesc;
use deltamorph::{POSE_FLOATS, PoseFormat, UpdatePath};
#[cfg(not(feature = "cpu"))]
use deltamorph::{PackedLayout, PackedMesh, UpdateDesc};
use std::sync::{Arc, Mutex};

#[cfg(feature = "cpu")]
use deltamorph::CpuCrowd as Inner;

/// CPU crowds would be a sixth of the library: without the feature there are none.
#[cfg(not(feature = "cpu"))]
pub enum Inner {}

#[cfg(not(feature = "cpu"))]
impl Inner {
    fn new(_: Arc<PackedMesh>, _: UpdateDesc, _: u32, _: usize) -> Result<Self> {
        Err(crate::arguments::not_built("cpu", "CPU crowds"))
    }

    fn set_weights(&mut self, _: u32, _: &[f32]) -> deltamorph::Result<()> {
        match *self {}
    }

    fn update(&mut self) {
        match *self {}
    }

    fn layout(&self) -> &PackedLayout {
        match *self {}
    }

    fn pose(&self, _: u32) -> deltamorph::Result<&[f32]> {
        match *self {}
    }
}

/// The object of a `DmCpuCrowd`.
pub struct CpuCrowd {
    crowd: Mutex<Inner>,
}

/// Make instances of a mesh that are updated on the CPU, all weights 0. They keep a copy of the mesh. `threads` 0: one
/// for each core, if the library was built with the feature `threads`.
///
/// Errors: DM_ERROR_UNSUPPORTED if the library was built without the feature `cpu`; DM_ERROR_INVALID for another path
/// than the CPU's, or options that it does not support; DM_ERROR_OUT_OF_MEMORY.
///
/// # Safety
/// `desc` is null (the defaults) or a structure; `crowd` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_cpu_crowd_create(
    mesh: DmMesh,
    desc: *const DmCrowdDesc,
    threads: u32,
    crowd: *mut DmCpuCrowd,
) -> DmResult {
    enter("dm_cpu_crowd_create", || {
        check_place(crowd, "crowd")?;
        // SAFETY: the caller's obligation.
        let desc = unsafe { read_or_default(desc) }?;
        if !desc.poses.is_null() || desc.pose_usage != 0 || !desc.queue_family.is_null() {
            let text = "buffers or a queue of a crowd on the CPU; leave 'poses', 'pose_usage' and 'queue_family' zero";
            return Err(Failure::invalid(text));
        }
        let desc = desc.crowd(UpdatePath::Cpu, PoseFormat::Float32)?;
        let mesh = Arc::new(mesh.get()?.asset.mesh.clone());
        let made = Inner::new(mesh, desc.update, desc.instances, threads as usize)?;
        // SAFETY: the caller's obligation; it was checked.
        unsafe { crowd.write(DmCpuCrowd::insert(CpuCrowd { crowd: Mutex::new(made) })?) };
        Ok(())
    })
}

/// Runs `body` with a crowd that is locked meanwhile.
fn with(crowd: DmCpuCrowd, body: impl FnOnce(&mut Inner) -> Result<()>) -> Result<()> {
    let crowd = crowd.get()?;
    let mut locked = lock(&crowd.crowd)?;
    body(&mut locked)
}

/// Request these weights for an instance, one per target in the mesh's order, from the next update on.
///
/// Errors: DM_ERROR_INVALID for an instance out of range, a wrong number of weights, one that is not finite or out of
/// range.
///
/// # Safety
/// There are `count` weights.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_cpu_crowd_set_weights(
    crowd: DmCpuCrowd,
    instance: u32,
    weights: *const f32,
    count: u32,
) -> DmResult {
    enter("dm_cpu_crowd_set_weights", || {
        // SAFETY: the caller's obligation.
        let weights = unsafe { slice(weights, count as usize, "weights") }?;
        with(crowd, |crowd| Ok(crowd.set_weights(instance, weights)?))
    })
}

/// Update all poses to the requested weights.
#[unsafe(no_mangle)]
pub extern "C" fn dm_cpu_crowd_update(crowd: DmCpuCrowd) -> DmResult {
    let body = |crowd: &mut Inner| {
        crowd.update();
        Ok(())
    };
    enter("dm_cpu_crowd_update", || with(crowd, body))
}

/// Write the pose of an instance after the last update: six floats for each vertex, in the order of pose buffers,
/// without padding. Fixed-point poses are decoded.
///
/// Errors: DM_ERROR_INVALID for an instance out of range, too little room.
///
/// # Safety
/// There is room for `count` numbers at `pose`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_cpu_crowd_pose(crowd: DmCpuCrowd, instance: u32, pose: *mut f32, count: usize) -> DmResult {
    enter("dm_cpu_crowd_pose", || {
        with(crowd, |crowd| {
            let numbers = crowd.layout().vertex_count * POSE_FLOATS;
            let found = crowd.pose(instance)?;
            // SAFETY: the caller's obligation.
            unsafe { fill(pose, count, &found[..numbers], "pose") }
        })
    })
}

/// Destroy a crowd.
#[unsafe(no_mangle)]
pub extern "C" fn dm_cpu_crowd_destroy(crowd: DmCpuCrowd) -> DmResult {
    enter("dm_cpu_crowd_destroy", || crowd.destroy(|_| Ok(())))
}
