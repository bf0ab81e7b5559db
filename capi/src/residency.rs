//! Meshes whose targets come to the device and go, under a limit of memory.

use crate::arguments::{built, check_command_buffer, check_reserved};
use crate::handles::{DmEngine, DmGpuMesh, DmMesh, DmSwap, Handle};
use crate::memory::{Place, Versioned, check_place, read, slice};
use crate::result::{DmResult, Failure, enter, lock};
use crate::structs::{DmResidency, DmTargetSwap};
use crate::upload::{GpuMesh, upload};
use deltamorph::ash::vk;
use deltamorph::{SwapCopies, TargetSwap};
use std::sync::{Arc, Mutex};

/// What a `DmSwap` names.
pub struct Swap {
    /// None once it was discarded.
    copies: Mutex<Option<SwapCopies>>,
    pub(crate) mesh: Arc<GpuMesh>,
}

/// Bytes that the deltas of a target take on the device.
///
/// Errors: DM_ERROR_INVALID for a target that there is not.
///
/// # Safety
/// `bytes` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_target_bytes(mesh: DmMesh, target: u32, bytes: *mut u64) -> DmResult {
    enter("dm_mesh_target_bytes", || {
        check_place(bytes, "bytes")?;
        let mesh = mesh.get()?;
        let (targets, found) = (mesh.layout().targets.len(), mesh.asset.mesh.target_bytes(target as usize));
        if target as usize >= targets {
            return Err(Failure::invalid(format!("target {target} of a mesh with {targets}; count targets from 0")));
        }
        // SAFETY: the caller's obligation; it was checked.
        unsafe { bytes.write(found) };
        Ok(())
    })
}

/// Make the buffer of a mesh in blocks whose targets come and go, and record the upload of its base pose: no target is
/// on the device yet, `dm_record_swap` loads them. `resident_bytes` bounds the deltas that are there at a time: at
/// least those of the largest target (`dm_mesh_target_bytes`). The buffer never grows. Crowds of the mesh are made by
/// `dm_crowd_create`; their poses have the same bits as those of a mesh that is there as a whole. A weight other than
/// 0 of a target that is not there is refused.
///
/// This records: a fill, copies, and a barrier that makes them visible to updates and draws.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `residency`; DM_ERROR_INVALID for a
/// dense format, fewer bytes than a target takes, a buffer that exceeds the device's storage range;
/// DM_ERROR_OUT_OF_MEMORY. Nothing is recorded then.
///
/// # Safety
/// As `dm_mesh_upload`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_upload_resident(
    engine: DmEngine,
    cmd: vk::CommandBuffer,
    mesh: DmMesh,
    resident_bytes: u64,
    gpu_mesh: *mut DmGpuMesh,
) -> DmResult {
    enter("dm_mesh_upload_resident", || {
        built!("residency", "meshes whose targets come and go");
        // SAFETY: the caller's obligations.
        unsafe { upload(engine, cmd, mesh, gpu_mesh, |engine, mesh| engine.upload_resident(cmd, mesh, resident_bytes)) }
    })
}

/// Memory of a mesh whose targets come and go, as of the last recorded swap, whether it has run or not.
///
/// # Safety
/// `residency` is a structure that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_gpu_mesh_residency(mesh: DmGpuMesh, residency: *mut DmResidency) -> DmResult {
    enter("dm_gpu_mesh_residency", || {
        // SAFETY: the caller's obligation.
        let place = unsafe { Place::new(residency) }?;
        let mesh = mesh.get()?;
        let found = lock(&mesh.mesh)?.residency();
        let none = DmResidency::zeroed();
        place.write(found.map_or(none, |found| DmResidency {
            limited: 1,
            capacity: found.capacity,
            used: found.used,
            buffer_bytes: found.buffer,
            ..none
        }));
        Ok(())
    })
}

/// Whether weights of a target may be requested: 1, or 0. All targets are there of a mesh that was uploaded as a
/// whole, of others those that were loaded. As of the last recorded swap.
///
/// # Safety
/// `resident` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_gpu_mesh_is_resident(mesh: DmGpuMesh, target: u32, resident: *mut u32) -> DmResult {
    enter("dm_gpu_mesh_is_resident", || {
        check_place(resident, "resident")?;
        let mesh = mesh.get()?;
        let found = lock(&mesh.mesh)?.is_resident(target as usize);
        // SAFETY: the caller's obligation; it was checked.
        unsafe { resident.write(found.into()) };
        Ok(())
    })
}

/// Let targets go, and load others. Whatever takes no more than is free in all finds a place. `source` is the mesh
/// that was uploaded, or the same read again from its file: deltas are copied from it, and it may be destroyed between
/// swaps.
///
/// A target cannot go while poses hold it: after the last recorded update of each crowd of the mesh. Record an update
/// with its weight at 0 first; with an error budget a second one.
///
/// This records: a barrier that waits for updates, copies, and a barrier that makes them visible to updates. Nothing
/// where there is nothing to copy.
///
/// Errors: DM_ERROR_UNSUPPORTED where the library was built without the feature `residency`; DM_ERROR_INVALID for a
/// mesh that was uploaded as a whole, another `source`, a target that there is not, or that is to come and to go; one
/// that is to go while poses hold it, by name; more bytes than are free; DM_ERROR_OUT_OF_MEMORY. Nothing is recorded
/// then, and nothing changes.
///
/// # Safety
/// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and without
///   active conditional rendering, on a queue with compute. No other thread uses it meanwhile.
/// - It runs exactly once, after the upload of the mesh and all updates of its crowds and swaps recorded before, and
///   before those recorded later; or it never runs, nor does any update recorded later, and `dm_swap_discard` is
///   called before anything else of the mesh is recorded. No update of a crowd of the mesh is recorded on another
///   thread meanwhile.
/// - `swap` is a structure whose arrays have the elements that it says; `copies` can be written; `copied` is null, or
///   can be written: it becomes the bytes that are copied, of what came and of what had to move for it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_record_swap(
    cmd: vk::CommandBuffer,
    mesh: DmGpuMesh,
    source: DmMesh,
    swap: *const DmTargetSwap,
    copies: *mut DmSwap,
    copied: *mut u64,
) -> DmResult {
    enter("dm_record_swap", || {
        built!("residency", "meshes whose targets come and go");
        check_place(copies, "copies")?;
        let (mesh, source) = (mesh.get()?, source.get()?);
        check_command_buffer(cmd)?;
        // SAFETY: the caller's obligations; `copies` was checked.
        unsafe {
            let asked = read(swap)?;
            check_reserved("DmTargetSwap", asked.reserved)?;
            let targets = |targets: *const u32, count: u32, what: &str| {
                let targets = slice(targets, count as usize, what)?.iter();
                Ok::<Vec<usize>, Failure>(targets.map(|target| *target as usize).collect())
            };
            let load = targets(asked.load, asked.load_count, "load")?;
            let unload = targets(asked.unload, asked.unload_count, "unload")?;
            let swap = TargetSwap::default().load(&load).unload(&unload);
            let (morph, from) = (&mesh.engine.morph, &source.asset.mesh);
            let made = morph.record_swap(cmd, &mut *lock(&mesh.mesh)?, from, &swap)?;
            if !copied.is_null() {
                copied.write_unaligned(made.bytes());
            }
            copies.write(DmSwap::insert(Swap { copies: Mutex::new(Some(made)), mesh })?);
        }
        Ok(())
    })
}

/// A swap will never run, nor will the updates recorded after it, which are discarded, too. What it copied is not
/// there then; the next swap, be it of nothing, copies that again, and until then updates that need it are refused.
/// Targets that it let go are gone. The handle names nothing any longer.
///
/// # Safety
/// Neither the swap nor any later update of the mesh runs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_swap_discard(swap: DmSwap) -> DmResult {
    enter("dm_swap_discard", || {
        built!("residency", "meshes whose targets come and go");
        let object = swap.get()?;
        swap.destroy(|_| Ok(()))?;
        if let Some(copies) = lock(&object.copies)?.take() {
            lock(&object.mesh.mesh)?.discard_swap(copies)?;
        }
        Ok(())
    })
}

/// Give the staging memory of a swap back.
///
/// # Safety
/// It has run.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_swap_destroy(swap: DmSwap) -> DmResult {
    enter("dm_swap_destroy", || swap.destroy(|_| Ok(())))
}
