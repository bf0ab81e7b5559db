//! Post-morph passes, which write into buffers of the host's: decoded positions, normals of the morphed surface.
//! Skinning is in [`skin`](crate::skin).

use crate::arguments::{check_reserved, or};
use crate::attached::{self, Attached, check_buffer};
use crate::handles::{DmCrowd, DmEngine, DmMesh, DmSurface, Handle, handle};
use crate::result::{DmResult, Result, enter};
use crate::structs::{DmDecodeTarget, DmNormalsTarget};
use deltamorph::after::{DecodeTarget, GpuNormals, NormalsDesc, NormalsTarget};
use deltamorph::ash::vk;

handle!(DmSurface for Attached<GpuNormals>);

/// Write the positions of an instance as float32 into a buffer of the host's, from the next recorded update on;
/// `target` null: stop. What is written is ready for the crowd's consumers.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, an offset or stride that does not fit. Nothing
/// changes then.
///
/// # Safety
/// - `target` is null or a structure. Its buffer belongs to the engine's device, is usable as storage buffer and large
///   enough for all that is written. It lives until the instance has another target, or none, and the updates recorded
///   before have finished.
/// - No update of the crowd that was recorded with an earlier target of the instance is unfinished.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_decode_target(
    crowd: DmCrowd,
    instance: u32,
    target: *const DmDecodeTarget,
) -> DmResult {
    enter("dm_crowd_set_decode_target", || {
        // SAFETY: the caller's obligations.
        unsafe {
            attached::set_target(crowd, target, decode_target, |state, engine, target| {
                Ok(engine.set_decode_target(&mut state.crowd, instance, target)?)
            })
        }
    })
}

fn decode_target(asked: &DmDecodeTarget) -> Result<DecodeTarget> {
    check_reserved("DmDecodeTarget", asked.reserved)?;
    check_buffer(asked.buffer, "buffer")?;
    let target = DecodeTarget { offset: asked.offset, ..DecodeTarget::new(asked.buffer) };
    let normals = (asked.normals != 0).then_some(asked.normals);
    Ok(DecodeTarget { stride: or(asked.stride, target.stride), normals, ..target })
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
            let faces = &mesh.packed.faces;
            let corners: Vec<u32> = faces.corners.iter().map(|corner| corner.position).collect();
            let desc = NormalsDesc { sizes: &faces.sizes, welds: &mesh.packed.welds, ..NormalsDesc::new(&corners) };
            // SAFETY: the caller's obligations.
            Ok(unsafe { engine.upload_normals(cmd, &mesh.packed, &desc) }?)
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

/// Compute the normals of an instance's pose from its morphed surface, into a buffer of the host's, from the next
/// recorded update on: area-weighted, of unit length, ready for the crowd's consumers. `target` null: stop; `surface`
/// is ignored then.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, a surface of another engine or mesh, an offset or
/// stride that does not fit. Nothing changes then.
///
/// # Safety
/// The same conditions as for `dm_crowd_set_decode_target`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_normals_target(
    crowd: DmCrowd,
    instance: u32,
    surface: DmSurface,
    target: *const DmNormalsTarget,
) -> DmResult {
    enter("dm_crowd_set_normals_target", || {
        let make = |asked: &DmNormalsTarget| {
            check_buffer(asked.buffer, "buffer")?;
            Ok(NormalsTarget { offset: asked.offset, stride: or(asked.stride, 12), ..NormalsTarget::new(asked.buffer) })
        };
        // SAFETY: the caller's obligations.
        unsafe {
            attached::set_target(crowd, target, make, |state, engine, target| {
                attached::with_target(surface, target, |target| {
                    Ok(engine.set_normals_target(&mut state.crowd, instance, target)?)
                })
            })
        }
    })
}
