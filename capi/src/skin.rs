//! Skins and their joints; where outputs are.

use crate::arguments::or;
use crate::attached::{self, Attached};
use crate::crowd::with;
use crate::handles::{DmCrowd, DmEngine, DmMesh, DmSkin, Handle, handle};
use crate::memory::{Place, Versioned, read, slice};
use crate::result::{DmResult, enter};
use crate::structs::{DmOutputView, DmSkinDesc};
use deltamorph::after::{GpuSkin, SkinDesc};
use deltamorph::ash::vk;

handle!(DmSkin for Attached<GpuSkin>);

/// Make a buffer of the joints and weights of a mesh's vertices, and record its upload: once for each mesh, whatever
/// the number of crowds and instances.
///
/// This records: a copy from staging memory, and a barrier that makes it visible to updates.
///
/// Errors: DM_ERROR_INVALID for a number of influences other than 4 or 8, or of joints outside of 1 to 65,536; a weight
/// that is negative or not a number; weights of a vertex that sum to 0; a joint out of range; DM_ERROR_OUT_OF_MEMORY.
/// Nothing is recorded then.
///
/// # Safety
/// - `cmd` as in `dm_mesh_upload`. It runs exactly once, before any update that uses this skin.
/// - `desc` is a structure whose arrays have the elements that it says, for each vertex of the mesh; `skin` can be
///   written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_skin_upload(
    engine: DmEngine,
    cmd: vk::CommandBuffer,
    mesh: DmMesh,
    desc: *const DmSkinDesc,
    skin: *mut DmSkin,
) -> DmResult {
    enter("dm_skin_upload", || {
        // SAFETY: the caller's obligations.
        let make = |engine: &deltamorph::MorphEngine, mesh: &crate::mesh::Mesh| unsafe {
            let asked = read(desc)?;
            let influences = or(asked.influences, 4);
            let count = mesh.layout().vertex_count.saturating_mul(influences as usize);
            let joints = slice(asked.joints, count, "joints")?;
            let weights = slice(asked.weights, count, "weights")?;
            let desc = SkinDesc { influences, joint_count: asked.joint_count, joints, weights };
            Ok(engine.upload_skin(cmd, &mesh.packed, &desc)?)
        };
        // SAFETY: as above.
        unsafe { attached::upload((engine, cmd, mesh), (skin, "skin"), make) }
    })
}

/// Destroy a skin. Instances that are skinned by it keep the data that they need.
///
/// # Safety
/// The upload has finished, or will never run. Crowds may be using it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_skin_destroy(skin: DmSkin) -> DmResult {
    enter("dm_skin_destroy", || skin.destroy(|_| Ok(())))
}

/// Set the joints of a skinned instance after they moved: from the next recorded update on, those at byte `offset` of
/// their buffer, a multiple of 16. The offset may stay the same if the host's barriers order its writes; with several
/// frames in flight and joints that the host writes, use several offsets in turn.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, or not skinned; joints that reach beyond their
/// buffer. Nothing changes then.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowd_set_joints(crowd: DmCrowd, instance: u32, offset: u64) -> DmResult {
    enter("dm_crowd_set_joints", || with(crowd, |state| Ok(state.crowd.set_joints(instance, offset)?)))
}

/// Get the buffer and offset of the output of an instance, skinned or not, valid once the updates recorded so far have
/// run.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, or without an output target; those of
/// `dm_crowd_pose`.
///
/// # Safety
/// `view` is a structure that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_output(crowd: DmCrowd, instance: u32, view: *mut DmOutputView) -> DmResult {
    enter("dm_crowd_output", || {
        // SAFETY: the caller's obligation.
        let place = unsafe { Place::new(view) }?;
        let found = with(crowd, |state| Ok(state.crowd.output(instance)?))?;
        let (previous_buffer, previous_offset) = found.previous.unwrap_or_default();
        let (buffer, offset) = found.current;
        let none = DmOutputView::zeroed();
        place.write(DmOutputView { buffer, offset, previous_buffer, previous_offset, ..none });
        Ok(())
    })
}
