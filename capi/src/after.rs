//! Post-morph passes, which write into vertices of the application: poses, skinned or not, and normals of the morphed
//! surface. Skins are in [`skin`](crate::skin).

use crate::arguments::or;
use crate::attached::{self, Attached, check_buffer};
use crate::crowd::State;
use crate::handles::{DmCrowd, DmEngine, DmMesh, DmSkin, DmSurface, Handle, handle};
use crate::memory::slice;
use crate::numbers::{semantic, skin_method};
use crate::result::{DmResult, Result, ensure, enter};
use crate::structs::{DmOutputStream, DmOutputTarget};
use deltamorph::after::{GpuNormals, Joints, OutputStream, OutputTarget};
use deltamorph::ash::vk::{self, Handle as _};

handle!(DmSurface for Attached<GpuNormals>);

/// Write the pose of an instance into vertices of the application, from the next recorded update on, skinned by `skin`
/// or, if that is the null handle, as it is; `target` null: stop; `skin` is ignored then. If joints moved
/// (`dm_crowd_set_joints`), all vertices are written; if only weights changed, the vertices that the update changed.
/// What is written is ready for the crowd's consumers.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, a stream that the mesh does not have, a format,
/// offset or stride that does not fit, a skin of another engine or mesh, joints without a skin or beyond their buffer.
/// Nothing changes then.
///
/// # Safety
/// - `target` is null or a structure, and its streams can be read. Its buffers belong to the engine's device, are
///   usable as storage buffers, and large enough for all that is read and written. They live until the instance has
///   another target, or none, and the updates recorded before have finished.
/// - No update of the crowd that was recorded with an earlier target of the instance is unfinished.
/// - Joints are written, and visible to compute shaders, when an update that skins runs. They stay unchanged from the
///   update that they were set for until others are set, and the updates recorded before have finished.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_output_target(
    crowd: DmCrowd,
    instance: u32,
    skin: DmSkin,
    target: *const DmOutputTarget,
) -> DmResult {
    enter("dm_crowd_set_output_target", || {
        let is_skinned = skin.bits != 0;
        let make = |asked: &DmOutputTarget| {
            if is_skinned {
                check_buffer(asked.joints, "joints")?;
            } else {
                ensure!(
                    asked.joints.is_null(),
                    "'joints' is set, but 'skin' is the null handle; hand in both or neither"
                );
            }
            // SAFETY: the caller's obligations.
            Ok((*asked, unsafe { streams(asked) }?))
        };
        // SAFETY: the caller's obligations.
        unsafe {
            attached::set_target(crowd, target, make, |State { crowd, .. }, engine, target| {
                let Some((asked, streams)) = target else {
                    return Ok(engine.set_output_target(crowd, instance, None)?);
                };
                let target = OutputTarget { pose_order: asked.pose_order != 0, ..OutputTarget::new(streams) };
                if !is_skinned {
                    return Ok(engine.set_output_target(crowd, instance, Some(&target))?);
                }
                attached::with(skin, |skin| {
                    let mut joints = Joints::new(skin, asked.joints, asked.joints_bytes);
                    (joints.offset, joints.method) = (asked.joints_offset, skin_method(asked.method)?);
                    let target = OutputTarget { joints: Some(joints), ..target };
                    Ok(engine.set_output_target(crowd, instance, Some(&target))?)
                })
            })
        }
    })
}

/// The streams of a target.
///
/// # Safety
/// They can be read.
unsafe fn streams(target: &DmOutputTarget) -> Result<Vec<OutputStream>> {
    // SAFETY: the caller's obligation.
    let streams = unsafe { slice(target.streams, target.stream_count as usize, "streams") }?;
    let stream = |asked: &DmOutputStream| {
        ensure!(asked.reserved == 0, "DmOutputStream: 'reserved' is {}; set it to 0", asked.reserved);
        check_buffer(asked.buffer, "buffer")?;
        let default = OutputStream::new(semantic(asked.stream)?, asked.buffer);
        Ok(OutputStream {
            offset: asked.offset,
            stride: or(asked.stride, default.stride),
            format: vk::Format::from_raw(or(asked.format as i32, default.format.as_raw())),
            second: (!asked.second_buffer.is_null()).then_some((asked.second_buffer, asked.second_offset)),
            ..default
        })
    };
    streams.iter().map(stream).collect()
}

/// Make a buffer of the triangles around each vertex of a mesh, and record its upload: once for each mesh, whatever the
/// number of crowds and instances. Vertices that the mesh joins at seams (`DM_MESH_SPLIT`, `DM_MESH_WELD`) get the same
/// normal.
///
/// This records: a copy from staging memory, and a barrier that makes it visible to updates.
///
/// Errors: DM_ERROR_INVALID for a mesh that exceeds the device's limits; DM_ERROR_OUT_OF_MEMORY. Nothing is recorded
/// then.
///
/// # Safety
/// `cmd` as in `dm_mesh_upload`. It runs exactly once, before any update that computes normals with this surface;
/// `surface` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_surface_upload(
    engine: DmEngine,
    cmd: vk::CommandBuffer,
    mesh: DmMesh,
    surface: *mut DmSurface,
) -> DmResult {
    enter("dm_surface_upload", || {
        let make = |engine: &deltamorph::MorphEngine, mesh: &crate::mesh::Mesh| {
            // SAFETY: the caller's obligations.
            Ok(unsafe { engine.upload_normals(cmd, &mesh.packed) }?)
        };
        // SAFETY: as above.
        unsafe { attached::upload((engine, cmd, mesh), (surface, "surface"), make) }
    })
}

/// Destroy a surface. Instances whose normals it computes keep the data that they need.
///
/// # Safety
/// The upload has finished, or will never run. Crowds may be using it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_surface_destroy(surface: DmSurface) -> DmResult {
    enter("dm_surface_destroy", || surface.destroy(|_| Ok(())))
}

/// Compute the normals of an instance's pose from its morphed surface, into vertices of the application, from the next
/// recorded update on: area-weighted, of unit length, ready for the crowd's consumers. The target has one stream,
/// DM_STREAM_NORMAL, and no joints; null: stop; `surface` is ignored then.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, a surface of another engine or mesh, a target that
/// does not fit. Nothing changes then.
///
/// # Safety
/// The same conditions as for `dm_crowd_set_output_target`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_normals_target(
    crowd: DmCrowd,
    instance: u32,
    surface: DmSurface,
    target: *const DmOutputTarget,
) -> DmResult {
    enter("dm_crowd_set_normals_target", || {
        // SAFETY: the caller's obligations.
        let make = |asked: &DmOutputTarget| Ok((asked.pose_order != 0, unsafe { streams(asked) }?));
        // SAFETY: the caller's obligations.
        unsafe {
            attached::set_target(crowd, target, make, |State { crowd, .. }, engine, target| match target {
                Some((pose_order, streams)) => attached::with(surface, |surface| {
                    let target = OutputTarget { pose_order: *pose_order, ..OutputTarget::new(streams) };
                    Ok(engine.set_normals_target(crowd, instance, Some((surface, &target)))?)
                }),
                None => Ok(engine.set_normals_target(crowd, instance, None)?),
            })
        }
    })
}
