//! What follows the pose, written into buffers of the host's: decoded positions, bounds, normals of the morphed surface.
//! Skinning is in [`skin`](crate::skin).

use crate::arguments::{check_command_buffer, check_reserved, or};
use crate::crowd::either;
use crate::engine::Engine;
use crate::handles::{DmCrowd, DmEngine, DmMesh, DmSurface, Handle, handle};
use crate::memory::{Versioned, check_place, read};
use crate::result::{DM_ERROR_UNSUPPORTED, DmResult, Failure, Result, enter, lock};
use crate::structs::{DmBoundsTarget, DmDecodeTarget, DmNormalsTarget};
use deltamorph::DecodeTarget;
use deltamorph::after::{BoundsTarget, GpuNormals, NormalsDesc, NormalsTarget};
use deltamorph::ash::vk::{self, Handle as _};
use std::sync::{Arc, Mutex};

/// What a `DmSurface` names.
pub struct Surface {
    normals: Mutex<GpuNormals>,
    _engine: Arc<Engine>,
}

handle!(DmSurface, 11, Surface);

/// The steps but decoding are a feature, of 52 kB: without it their entries end at this constant, and the compiler leaves
/// out kernels and code.
pub(crate) const BUILT: bool = cfg!(feature = "after");

pub(crate) fn not_built() -> Failure {
    let message = "the library was built without steps after the pose; build it with the feature 'after'".into();
    Failure { code: DM_ERROR_UNSUPPORTED, message }
}

pub(crate) fn check_buffer(buffer: vk::Buffer, what: &str) -> Result<()> {
    match buffer.is_null() {
        true => Err(Failure::invalid(format!("'{what}' is null; hand in a buffer, or a null pointer for no target"))),
        false => Ok(()),
    }
}

/// A target of a step, or none.
///
/// # Safety
/// As [`read`].
pub(crate) unsafe fn target<T: Versioned, R>(
    target: *const T,
    make: impl FnOnce(&T) -> Result<R>,
) -> Result<Option<R>> {
    // SAFETY: the caller's obligation.
    if target.is_null() { Ok(None) } else { make(&unsafe { read(target) }?).map(Some) }
}

/// Have positions of an instance written as float32 into a buffer of the host's, from the next recorded update on;
/// null: no longer. What is written is ready for the crowd's consumers.
///
/// Errors: DM_ERROR_INVALID for an instance out of range or removed, an offset or stride that does not fit. Nothing
/// changes then.
///
/// # Safety
/// - `target` is null or a structure. Its buffer is one of the engine's device, made for use as storage buffer; it is
///   large enough for all that is written, and lives until the instance has another target, or none, and the updates
///   recorded before have finished.
/// - No update of the crowd that was recorded with an earlier target of the instance is unfinished.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_decode_target(
    crowd: DmCrowd,
    instance: u32,
    target: *const DmDecodeTarget,
) -> DmResult {
    enter("dm_crowd_set_decode_target", || {
        // SAFETY: the caller's obligation.
        let target = unsafe { self::target(target, decode_target) }?;
        let crowd = crowd.get()?;
        let (mut state, engine) = (lock(&crowd.state)?, &crowd.engine.morph);
        // SAFETY: the caller's obligations.
        Ok(either!(state, crowd => unsafe { engine.set_decode_target(crowd, instance, target.as_ref()) })?)
    })
}

fn decode_target(asked: &DmDecodeTarget) -> Result<DecodeTarget> {
    check_reserved("DmDecodeTarget", asked.reserved)?;
    check_buffer(asked.buffer, "buffer")?;
    let target = DecodeTarget::new(asked.buffer).offset(asked.offset);
    let normals = (asked.normals != 0).then_some(asked.normals);
    Ok(target.stride(or(asked.stride, target.stride)).normals(normals))
}

/// Have the bounds of an instance's pose written into a buffer of the host's, from the next recorded update on; null:
/// no longer. They are exactly those of the pose as it is decoded, and ready for the crowd's consumers. A skinned pose
/// has others.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `after`; DM_ERROR_INVALID for an
/// instance out of range or removed, an offset that is no multiple of 4. Nothing changes then.
///
/// # Safety
/// As `dm_crowd_set_decode_target`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_bounds_target(
    crowd: DmCrowd,
    instance: u32,
    target: *const DmBoundsTarget,
) -> DmResult {
    enter("dm_crowd_set_bounds_target", || {
        if !BUILT {
            return Err(not_built());
        }
        let make = |asked: &DmBoundsTarget| {
            check_reserved("DmBoundsTarget", asked.reserved)?;
            check_buffer(asked.buffer, "buffer")?;
            Ok(BoundsTarget::new(asked.buffer).offset(asked.offset))
        };
        // SAFETY: the caller's obligation.
        let target = unsafe { self::target(target, make) }?;
        let crowd = crowd.get()?;
        let (mut state, engine) = (lock(&crowd.state)?, &crowd.engine.morph);
        // SAFETY: the caller's obligations.
        Ok(either!(state, crowd => unsafe { engine.set_bounds_target(crowd, instance, target.as_ref()) })?)
    })
}

/// Make a buffer of the triangles around each vertex of a mesh, and record its upload: once for each mesh, whatever the
/// number of crowds and instances. Vertices that the mesh holds together at seams (`DM_MESH_SPLIT`, `DM_MESH_WELD`) get
/// the same normal.
///
/// This records: a copy from staging memory, and a barrier that makes it visible to updates.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `after`; DM_ERROR_INVALID for a mesh
/// that exceeds the device's limits; DM_ERROR_OUT_OF_MEMORY. Nothing is recorded then.
///
/// # Safety
/// `cmd` as in `dm_mesh_upload`. It runs exactly once, before any update that computes normals by the value; `surface`
/// can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_surface_upload(
    engine: DmEngine,
    cmd: vk::CommandBuffer,
    mesh: DmMesh,
    surface: *mut DmSurface,
) -> DmResult {
    enter("dm_surface_upload", || {
        if !BUILT {
            return Err(not_built());
        }
        check_place(surface, "surface")?;
        check_command_buffer(cmd)?;
        let (engine, mesh) = (engine.get()?, mesh.get()?);
        let faces = &mesh.asset.faces;
        let corners: Vec<u32> = faces.corners.iter().map(|corner| corner.position).collect();
        let desc = NormalsDesc::new(&corners).sizes(&faces.sizes).welds(&mesh.asset.welds);
        // SAFETY: the caller's obligations; `surface` was checked.
        unsafe {
            let normals = Mutex::new(engine.morph.upload_normals(cmd, &mesh.asset.mesh, &desc)?);
            surface.write(DmSurface::insert(Surface { normals, _engine: engine })?);
        }
        Ok(())
    })
}

/// Give the staging memory of a surface back.
///
/// # Safety
/// The upload has run, or never will.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_surface_release_staging(surface: DmSurface) -> DmResult {
    enter("dm_surface_release_staging", || {
        let surface = surface.get()?;
        // SAFETY: the caller's obligation.
        unsafe { lock(&surface.normals)?.release_staging() };
        Ok(())
    })
}

/// Destroy a surface. Instances whose normals are computed keep what they need.
///
/// # Safety
/// The device no longer uses it but for its crowds: its upload has run, or never will.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_surface_destroy(surface: DmSurface) -> DmResult {
    enter("dm_surface_destroy", || surface.destroy(|_| Ok(())))
}

/// Have the normals of an instance's pose computed from its morphed surface, into a buffer of the host's, from the next
/// recorded update on: area-weighted, of unit length, ready for the crowd's consumers. `target` null: no longer, and
/// `surface` is not looked at.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `after`; DM_ERROR_INVALID for an
/// instance out of range or removed, a surface of another engine or mesh, an offset or stride that does not fit.
/// Nothing changes then.
///
/// # Safety
/// As `dm_crowd_set_decode_target`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_normals_target(
    crowd: DmCrowd,
    instance: u32,
    surface: DmSurface,
    target: *const DmNormalsTarget,
) -> DmResult {
    enter("dm_crowd_set_normals_target", || {
        if !BUILT {
            return Err(not_built());
        }
        let make = |asked: &DmNormalsTarget| {
            check_buffer(asked.buffer, "buffer")?;
            Ok(NormalsTarget::new(asked.buffer).offset(asked.offset).stride(or(asked.stride, 12)))
        };
        // SAFETY: the caller's obligation.
        let target = unsafe { self::target(target, make) }?;
        let surface = target.map(|_| surface.get()).transpose()?;
        let surface = surface.as_ref().map(|surface| lock(&surface.normals)).transpose()?;
        let crowd = crowd.get()?;
        let (mut state, engine) = (lock(&crowd.state)?, &crowd.engine.morph);
        let target = surface.as_deref().zip(target.as_ref());
        // SAFETY: the caller's obligations.
        Ok(either!(state, crowd => unsafe { engine.set_normals_target(crowd, instance, target) })?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handles::DmSkin;
    use crate::result::{DM_ERROR_HANDLE, dm_last_error};

    #[test]
    fn a_library_without_these_steps_says_so() {
        let (null, no_crowd) = (std::ptr::null(), DmCrowd { bits: 0 });
        // SAFETY: null pointers are allowed, or refused.
        let codes = unsafe {
            [
                dm_crowd_set_bounds_target(no_crowd, 0, null),
                crate::skin::dm_crowd_set_skin_target(no_crowd, 0, DmSkin { bits: 0 }, std::ptr::null()),
                dm_crowd_set_normals_target(no_crowd, 0, DmSurface { bits: 0 }, std::ptr::null()),
                crate::skin::dm_crowd_set_joints(no_crowd, 0, 0),
            ]
        };
        assert_eq!(codes, [if BUILT { DM_ERROR_HANDLE } else { DM_ERROR_UNSUPPORTED }; 4]);
        // SAFETY: a string that is valid until the next failure on this thread.
        let said = unsafe { std::ffi::CStr::from_ptr(dm_last_error()) }.to_str().unwrap();
        assert!(said.contains(if BUILT { "null handle" } else { "build it with the feature 'after'" }), "{said}");
    }
}
