//! Skinned poses.

use crate::arguments::{check_reserved, or};
use crate::attached::{self, Attached, check_buffer};
use crate::crowd::with;
use crate::handles::{DmCrowd, DmEngine, DmMesh, DmSkin, Handle, handle};
use crate::memory::{Place, Versioned, read, slice};
use crate::numbers::skin_method;
use crate::result::{DmResult, Result, enter};
use crate::structs::{DmSkinDesc, DmSkinTarget, DmSkinnedView};
use deltamorph::after::{GpuSkin, SkinDesc, SkinTarget};
use deltamorph::ash::vk::{self, Handle as _};

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
            check_reserved("DmSkinDesc", asked.reserved)?;
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

/// Skin an instance into a buffer of the host's, from the next recorded update on; `target` null: stop; `skin` is
/// ignored then. If joints moved (`dm_crowd_set_joints`), all vertices are written; if only weights changed, the
/// vertices that the update changed. What is written is ready for the crowd's consumers.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, a skin of another engine or mesh, an offset or
/// stride that does not fit, joints that reach beyond their buffer. Nothing changes then.
///
/// # Safety
/// - The conditions of `dm_crowd_set_decode_target`, for all buffers.
/// - Joints are written, and visible to compute shaders, when an update that skins runs. They stay unchanged from the
///   update that they were set for until others are set, and the updates recorded before have finished.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_skin_target(
    crowd: DmCrowd,
    instance: u32,
    skin: DmSkin,
    target: *const DmSkinTarget,
) -> DmResult {
    enter("dm_crowd_set_skin_target", || {
        // SAFETY: the caller's obligations.
        unsafe {
            attached::set_target(crowd, target, skin_target, |state, engine, target| {
                attached::with_target(skin, target, |target| {
                    Ok(engine.set_skin_target(&mut state.crowd, instance, target)?)
                })
            })
        }
    })
}

fn skin_target(asked: &DmSkinTarget) -> Result<SkinTarget> {
    check_buffer(asked.buffer, "buffer")?;
    check_buffer(asked.joints, "joints")?;
    let normals = (asked.normals != 0).then_some(asked.normals);
    let second = (!asked.second_buffer.is_null()).then_some((asked.second_buffer, asked.second_offset));
    Ok(SkinTarget {
        offset: asked.offset,
        stride: or(asked.stride, asked.normals.saturating_add(12)),
        normals,
        second,
        joints_offset: asked.joints_offset,
        method: skin_method(asked.method)?,
        ..SkinTarget::new(asked.buffer, asked.joints, asked.joints_bytes)
    })
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

/// Get the buffer and offset of the skinned pose of an instance, valid once the updates recorded so far have run.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, or not skinned; those of `dm_crowd_pose`.
///
/// # Safety
/// `view` is a structure that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_skinned(crowd: DmCrowd, instance: u32, view: *mut DmSkinnedView) -> DmResult {
    enter("dm_crowd_skinned", || {
        // SAFETY: the caller's obligation.
        let place = unsafe { Place::new(view) }?;
        let found = with(crowd, |state| Ok(state.crowd.skinned(instance)?))?;
        let (previous_buffer, previous_offset) = found.previous.unwrap_or_default();
        let (buffer, offset) = found.current;
        let none = DmSkinnedView::zeroed();
        place.write(DmSkinnedView { buffer, offset, previous_buffer, previous_offset, ..none });
        Ok(())
    })
}
