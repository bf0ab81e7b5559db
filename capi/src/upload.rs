//! Meshes on the device.

use crate::arguments::check_command_buffer;
use crate::engine::Engine;
use crate::handles::{DmEngine, DmGpuMesh, DmMesh, Handle, handle};
use crate::memory::check_place;
use crate::result::{DmResult, enter};
use deltamorph::ash::vk;
use std::sync::{Arc, Mutex};

/// The object of a `DmGpuMesh`.
pub struct GpuMesh {
    pub(crate) mesh: Mutex<deltamorph::GpuMesh>,
    pub(crate) engine: Arc<Engine>,
}

handle!(DmGpuMesh for GpuMesh);

/// Make the buffers of a mesh on the device, and record their upload. `mesh` may be destroyed afterwards.
///
/// This records: copies from staging memory, and a barrier that makes them visible to every update path (first stage
/// TRANSFER with TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
///
/// Errors: DM_ERROR_INVALID for a mesh that exceeds the device's limits, with the numbers; DM_ERROR_OUT_OF_MEMORY.
/// Nothing is recorded then.
///
/// # Safety
/// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and without
///   active conditional rendering, on any queue. No other thread uses it meanwhile.
/// - It runs exactly once, before any update of the mesh; if it never runs, no crowd of the mesh is updated.
/// - `gpu_mesh` can be written. The mesh on the device is destroyed only when the device no longer uses it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_upload(
    engine: DmEngine,
    cmd: vk::CommandBuffer,
    mesh: DmMesh,
    gpu_mesh: *mut DmGpuMesh,
) -> DmResult {
    enter("dm_mesh_upload", || {
        check_place(gpu_mesh, "gpu_mesh")?;
        let engine = engine.get()?;
        let mesh = mesh.get()?;
        check_command_buffer(cmd)?;
        // SAFETY: the caller's obligations; `gpu_mesh` was checked.
        unsafe {
            let mesh = Mutex::new(engine.morph.upload(cmd, &mesh.packed)?);
            gpu_mesh.write(DmGpuMesh::insert(GpuMesh { mesh, engine }));
        }
        Ok(())
    })
}

/// Destroy a mesh on the device. Crowds keep the data that they need.
///
/// # Safety
/// The upload has finished, or will never run. Crowds of the mesh may be in use.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_gpu_mesh_destroy(mesh: DmGpuMesh) -> DmResult {
    enter("dm_gpu_mesh_destroy", || mesh.destroy(|_| Ok(())))
}
