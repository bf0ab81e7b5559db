//! The public face: upload a mesh, make a crowd, record updates into the host's command buffer.
//!
//! The engine borrows the host's device and records; it never submits, waits, or creates a queue, thread or
//! window. In frame order:
//!
//! 1. [`MorphEngine::new`] with the host's device, once; [`MorphEngine::upload`] records the copies of a
//!    [`PackedMesh`]; [`MorphEngine::create_crowd`] makes pose buffers and pipelines.
//! 2. Each frame: [`Crowd::set_weights`], then [`MorphEngine::record_update`] before the draws, then draw from
//!    [`Crowd::pose`].
//!
//! Or the GPU does it all: [`MorphEngine::create_animated_crowd`] uploads clips, [`Crowd::play`] says who plays which,
//! and each frame takes [`Crowd::set_time`] in place of weights.
//!
//! # What the caller is responsible for
//! - Uploads, updates and draws run on queues of one family, with graphics and compute: the barriers name the
//!   stages of both. Recorded updates run exactly once each, in the order recorded, on one queue (or ordered by
//!   semaphores). An update that will never run is handed to [`Crowd::discard`].
//! - At most [`CrowdDesc::frames_in_flight`] updates of a crowd are recorded and not yet finished. Updates that
//!   recorded nothing and discarded ones do not count.
//! - Engine, meshes and crowds are dropped only when the device has finished with them, and before the device
//!   is destroyed. An allocator that the host shares is not locked by the host meanwhile.

mod animated;
mod baselines;
mod blocks;
mod crowd;
mod dense;

pub use crate::gpu::caps::{DeviceCaps, DeviceKind, Requirement, TransformFeedbackCaps, requirements};
pub use crate::gpu::device::{DeviceDesc, SharedAllocator};
pub use crowd::{Crowd, CrowdDesc, PoseView, Ticket, Update};

use crate::abi::numbers::WORKGROUP;
use crate::error::{Error, Result};
use crate::gpu::animation::AnimationKernel;
use crate::gpu::barriers;
use crate::gpu::baselines::Baseline;
use crate::gpu::blocks::BlocksKernel;
use crate::gpu::compute::Compute;
use crate::gpu::device::Device;
use crate::gpu::feedback::Feedback;
use crate::gpu::memory::{Buffer, BufferDesc, STAGING};
use crate::pack::blocks::BlockDesc;
use crate::pack::{POSE_STRIDE, PackDesc, PackedLayout, PackedMesh};
use crate::plan::commands::Hazard;
use crate::plan::{Accumulate, BatchSize, UpdatePath};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::any::Any;
use std::sync::{Arc, Mutex, PoisonError};

/// Pipelines of one update path, shared by the crowds that take the same ones.
#[derive(Clone)]
pub(crate) enum Kernel {
    Feedback(Arc<Feedback>),
    Compute(Arc<Compute>),
    Blocks(Arc<BlocksKernel>),
    Baseline(Baseline),
}

/// The engine: the host's device and the pipelines made so far.
pub struct MorphEngine {
    device: Arc<Device>,
    kernels: Mutex<Vec<Kernel>>,
    animation: Mutex<Option<Arc<AnimationKernel>>>,
}

/// A mesh on the device. Crowds keep what they need of it alive.
pub struct GpuMesh {
    pub(crate) shared: Arc<MeshBuffers>,
    staging: Option<Buffer>,
}

/// The device-local part of a mesh.
pub(crate) struct MeshBuffers {
    pub(crate) layout: PackedLayout,
    /// The base pose (dense formats).
    pub(crate) base: Buffer,
    /// Dense formats: the deltas. Block formats: headers, deltas and base pose, the whole asset.
    pub(crate) deltas: Buffer,
    /// Uploaded for `scatter`: the deltas are records instead, and this is the first of each target.
    pub(crate) records: Option<Vec<u32>>,
}

impl GpuMesh {
    /// Give the staging memory back.
    ///
    /// # Safety
    /// The upload that was recorded with this mesh has run, or never will: its copies read the memory.
    pub unsafe fn release_staging(&mut self) {
        self.staging = None;
    }

    /// The same mesh, for `headless`.
    #[cfg(feature = "headless")]
    pub(crate) fn shared(&self) -> Self {
        Self { shared: self.shared.clone(), staging: None }
    }

    /// Names, steps and sizes of what was uploaded.
    pub fn layout(&self) -> &PackedLayout {
        &self.shared.layout
    }
}

impl MorphEngine {
    /// An engine on the host's device.
    ///
    /// # Errors
    /// The allocator cannot be made.
    ///
    /// # Safety
    /// - The handles of `desc` are alive, belong together (the pipeline cache may be null), are of Vulkan 1.1 or later,
    ///   and outlive the engine and all it creates. An allocator that is handed in was made on the same device, without
    ///   `buffer_device_address` unless the device has that feature enabled.
    /// - `desc.caps` does not exceed what the device has.
    /// - `desc.transform_feedback_enabled` is true only if extension and feature were enabled on the device, and
    ///   `desc.enabled_features` has no other features than those that were.
    pub unsafe fn new(desc: &DeviceDesc<'_>) -> Result<Self> {
        // SAFETY: the caller's obligations.
        unsafe { Self::on(desc, None) }
    }

    /// An engine that keeps `owner` alive, and so does all that it makes.
    ///
    /// # Safety
    /// As [`new`](Self::new); what lives as long as `owner` lives long enough.
    pub(crate) unsafe fn on(desc: &DeviceDesc<'_>, owner: Option<Arc<dyn Any + Send + Sync>>) -> Result<Self> {
        // SAFETY: the caller's obligations are those of `borrow`.
        let device = unsafe { Device::borrow(desc, owner) }?;
        Ok(Self { device: Arc::new(device), kernels: Mutex::default(), animation: Mutex::default() })
    }

    /// Limits and features that the engine keeps to.
    pub fn caps(&self) -> &DeviceCaps {
        &self.device.caps
    }

    /// The device, for `headless`.
    #[cfg(feature = "headless")]
    pub(crate) fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// How to pack a mesh for this device.
    pub fn pack_desc(&self, format: crate::pack::DeltaFormat) -> PackDesc {
        let caps = &self.device.caps;
        let dispatch = u64::from(caps.max_workgroups) * u64::from(WORKGROUP);
        let capture = caps.transform_feedback.map_or(u64::MAX, |f| f.max_buffer_bytes / POSE_STRIDE as u64);
        let max_chunk_vertices = dispatch.min(capture);
        PackDesc { format, max_chunk_bytes: caps.max_storage_range, max_chunk_vertices, blocks: BlockDesc::default() }
    }

    /// Bytes of memory that the allocator has from the driver, blocks that are not full included: all of the host's,
    /// where it handed one in.
    pub fn allocated_bytes(&self) -> u64 {
        self.device.allocator().capacity()
    }

    /// Bytes of device memory that a mesh takes (as much again in staging memory until
    /// [`GpuMesh::release_staging`]).
    pub fn mesh_bytes(layout: &PackedLayout) -> u64 {
        match layout.format.is_blocks() {
            true => blocks::asset_bytes(layout),
            false => layout.pose_bytes() + delta_buffer_bytes(layout),
        }
    }

    /// Create a mesh's buffers and record their upload.
    ///
    /// This records: two copies from staging memory, and a barrier that makes them visible to every update path
    /// (first stage TRANSFER with TRANSFER_WRITE; last stages VERTEX_INPUT, VERTEX_SHADER, COMPUTE_SHADER).
    ///
    /// The caller is responsible for: submitting `cmd` before any update of the mesh, and calling
    /// [`GpuMesh::release_staging`] once it has run.
    ///
    /// # Errors
    /// A mesh that exceeds the device's limits, with the numbers; no memory.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and without
    ///   active conditional rendering, on a queue with graphics and compute.
    /// - It runs before any update of the mesh, exactly once; where it never does, no crowd of the mesh is updated.
    /// - The value returned is dropped only when the device no longer uses it.
    pub unsafe fn upload(&self, cmd: vk::CommandBuffer, mesh: &PackedMesh) -> Result<GpuMesh> {
        let layout = mesh.layout().clone();
        self.check_mesh(&layout)?;
        let bytes = match layout.format.is_blocks() {
            true => blocks::asset_bytes(&layout),
            false => delta_buffer_bytes(&layout),
        };
        // SAFETY: the caller's obligations.
        unsafe { self.upload_words(cmd, layout, mesh.base(), (mesh.deltas(), bytes), None) }
    }

    /// Buffers of a base pose and of `deltas` (words, and bytes of their buffer), and their upload.
    ///
    /// # Safety
    /// As [`upload`](Self::upload).
    unsafe fn upload_words(
        &self,
        cmd: vk::CommandBuffer,
        layout: PackedLayout,
        base: &[f32],
        (deltas, deltas_size): (&[u32], u64),
        records: Option<Vec<u32>>,
    ) -> Result<GpuMesh> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER
            | vk::BufferUsageFlags::VERTEX_BUFFER
            | vk::BufferUsageFlags::TRANSFER_DST;
        let buffer =
            |name, bytes, usage, location| Buffer::new(&self.device, &BufferDesc { name, bytes, usage, location });
        let (base_bytes, delta_bytes) =
            (bytemuck::cast_slice::<f32, u8>(base), bytemuck::cast_slice::<u32, u8>(deltas));
        // In blocks the base pose lies behind the deltas, and no buffer of its own is needed.
        let one_buffer = layout.format.is_blocks() && records.is_none();
        let (base_size, base_at) = if one_buffer { (0, delta_bytes.len()) } else { (layout.pose_bytes(), 0) };
        let base = buffer("deltamorph base pose", base_size, usage, MemoryLocation::GpuOnly)?;
        let deltas = buffer("deltamorph deltas", deltas_size, usage, MemoryLocation::GpuOnly)?;
        let mut staging = buffer(
            "deltamorph upload",
            (base_bytes.len() + delta_bytes.len()) as u64,
            vk::BufferUsageFlags::TRANSFER_SRC,
            STAGING,
        )?;
        let mapped = staging.mapped()?;
        mapped[..base_bytes.len()].copy_from_slice(base_bytes);
        mapped[base_bytes.len()..][..delta_bytes.len()].copy_from_slice(delta_bytes);

        let region = |src_offset: usize, dst_offset: usize, size: usize| vk::BufferCopy {
            src_offset: src_offset as u64,
            dst_offset: dst_offset as u64,
            size: size as u64,
        };
        let base_buffer = if one_buffer { &deltas } else { &base };
        for (target, region) in [
            (base_buffer, region(0, base_at, base_bytes.len())),
            (&deltas, region(base_bytes.len(), 0, delta_bytes.len())),
        ] {
            if region.size > 0 {
                // SAFETY: the caller's obligations; the region lies within both buffers, and the two do not overlap.
                unsafe { self.device.raw.cmd_copy_buffer(cmd, staging.raw, target.raw, &[region]) };
            }
        }
        // SAFETY: the caller's obligations.
        unsafe { barriers::record(&self.device.raw, cmd, Hazard::TransferWriteToAssetRead) };
        Ok(GpuMesh { shared: Arc::new(MeshBuffers { layout, base, deltas, records }), staging: Some(staging) })
    }

    fn check_not_empty(&self, layout: &PackedLayout) -> Result<()> {
        if layout.vertex_count > 0 {
            return Ok(());
        }
        Err(Error::invalid(format!("mesh '{}' has no vertices", layout.name), "leave it out"))
    }

    /// Refuse a mesh of which there is more than the device allows: `(amount, unit, most)`.
    fn check_limit(
        &self,
        layout: &PackedLayout,
        what: &str,
        (amount, unit, most): (u64, &str, u64),
        remedy: &str,
    ) -> Result<()> {
        if amount <= most {
            return Ok(());
        }
        let device = &self.device.caps.name;
        Err(Error::invalid(
            format!("mesh '{}': {what} {amount} {unit}, but {device} allows {most}", layout.name),
            remedy,
        ))
    }

    fn check_mesh(&self, layout: &PackedLayout) -> Result<()> {
        let caps = &self.device.caps;
        let limit = |what: &str, amount: u64, unit: &str, most: u64, remedy: &str| {
            self.check_limit(layout, what, (amount, unit, most), remedy)
        };
        self.check_not_empty(layout)?;
        let (range, groups) = (caps.max_storage_range, caps.max_workgroups.into());
        let chunk_groups = (layout.chunk_vertices as u64).div_ceil(WORKGROUP.into());
        limit("a pose takes", layout.pose_bytes(), "bytes", range, "split the mesh")?;
        if layout.format.is_blocks() {
            let remedy =
                "use a smaller format, the path 'compute', which cuts its deltas into chunks, or split the mesh";
            return limit("deltas and base pose take", blocks::asset_bytes(layout), "bytes", range, remedy);
        }
        limit("a chunk of deltas takes", chunk_bytes(layout), "bytes", range, "pack with MorphEngine::pack_desc")?;
        limit("a chunk takes", chunk_groups, "workgroups", groups, "pack with MorphEngine::pack_desc")?;
        if let Some(feedback) = caps.transform_feedback {
            let captured = (layout.chunk_vertices * POSE_STRIDE) as u64;
            let most = feedback.max_buffer_bytes;
            limit("a chunk captures", captured, "bytes", most, "pack with MorphEngine::pack_desc")?;
        }
        let deltas = delta_buffer_bytes(layout);
        limit("its deltas take", deltas, "bytes", u32::MAX.into(), "split the mesh or use the snorm16 format")
    }

    /// Make pose buffers and pipelines for the instances of a mesh, all weights 0. The first update writes
    /// their base poses.
    ///
    /// Pipelines are made here, not while animating; crowds that take the same kernels share them.
    ///
    /// # Errors
    /// A mesh that another engine uploaded; a path or batch size that the device cannot run, with what to use
    /// instead; no memory.
    pub fn create_crowd(&self, mesh: &GpuMesh, desc: &CrowdDesc) -> Result<Crowd> {
        self.check_crowd(mesh, desc)?;
        let kernel = self.kernel(desc, mesh)?;
        Crowd::new(&self.device, &mesh.shared, kernel, desc)
    }

    fn check_crowd(&self, mesh: &GpuMesh, desc: &CrowdDesc) -> Result<()> {
        if !mesh.shared.base.is_on(&self.device) {
            return Err(Error::invalid(
                format!("mesh '{}' belongs to another MorphEngine", mesh.layout().name),
                "upload it with the engine that makes the crowd",
            ));
        }
        self.device.caps.check_update(&desc.update, mesh.layout())?;
        if mesh.shared.records.is_some() != (desc.update.path == UpdatePath::Scatter) {
            return Err(Error::invalid(
                format!("mesh '{}' for the path '{}'", mesh.layout().name, desc.update.path.name()),
                "upload it with MorphEngine::upload_scatter for 'scatter', with MorphEngine::upload for other paths",
            ));
        }
        Ok(())
    }

    fn animation_kernel(&self) -> Result<Arc<AnimationKernel>> {
        let mut kernel = self.animation.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kernel) = &*kernel {
            return Ok(kernel.clone());
        }
        let made = Arc::new(AnimationKernel::new(&self.device)?);
        *kernel = Some(made.clone());
        Ok(made)
    }

    fn kernel(&self, desc: &CrowdDesc, mesh: &GpuMesh) -> Result<Kernel> {
        let (format, instances, desc) = (mesh.layout().format, desc.instances, &desc.update);
        let exact = desc.accumulate == Accumulate::Exact;
        let blocks = match &mesh.layout().blocks {
            Some(index) if desc.path == UpdatePath::Blocks => {
                let case = self.device.caps.blocks_case(format, exact, instances, index.entry_count() > 0);
                Some((case.choose()?, index.size() as u32))
            }
            _ => None,
        };
        let locked = || self.kernels.lock().unwrap_or_else(PoisonError::into_inner);
        let serves = |kernel: &&Kernel| match (kernel, desc.path, desc.batch) {
            (Kernel::Feedback(k), UpdatePath::Feedback, BatchSize::Targets(b)) => k.serves(format, b),
            (Kernel::Compute(k), UpdatePath::Compute, batch) => k.serves(format, batch),
            (Kernel::Blocks(k), UpdatePath::Blocks, _) => blocks.is_some_and(|(choice, size)| k.serves(&choice, size)),
            (Kernel::Baseline(k), ..) => k.serves(desc, format),
            _ => false,
        };
        // Not locked while the driver compiles: others may make crowds of kernels that are there.
        let made = locked().clone();
        if let Some(kernel) = made.iter().find(serves) {
            return Ok(kernel.clone());
        }
        let kernel = match (desc.path, desc.batch, blocks) {
            (UpdatePath::Blocks, _, Some((choice, size))) => {
                let others = made.iter().filter_map(|kernel| match kernel {
                    Kernel::Blocks(kernel) => Some(&**kernel),
                    Kernel::Feedback(_) | Kernel::Compute(_) | Kernel::Baseline(_) => None,
                });
                Kernel::Blocks(Arc::new(BlocksKernel::new(&self.device, choice, size, others)?))
            }
            (UpdatePath::Feedback, BatchSize::Targets(b), _) => {
                Kernel::Feedback(Arc::new(Feedback::new(&self.device, format, b)?))
            }
            (UpdatePath::Compute, batch, _) => Kernel::Compute(Arc::new(Compute::new(&self.device, format, batch)?)),
            _ => Kernel::Baseline(Baseline::new(&self.device, desc, format)?),
        };
        let mut kernels = locked();
        // Another thread may have made it meanwhile.
        let found = kernels.iter().find(serves).cloned();
        Ok(found.unwrap_or_else(|| {
            kernels.push(kernel.clone());
            kernel
        }))
    }

    /// Record the update of all instances of `crowd` to the weights asked for.
    ///
    /// This records: nothing when no weight changed; otherwise the passes of the plan with the barriers they
    /// need. First stages: VERTEX_INPUT, VERTEX_SHADER (reads of earlier poses) and the path's own; last:
    /// VERTEX_INPUT with VERTEX_ATTRIBUTE_READ and VERTEX_SHADER with SHADER_READ, so that draws recorded next
    /// may read [`Crowd::pose`] and [`Crowd::previous_pose`] as vertex attributes or storage buffers.
    ///
    /// It binds over: the compute pipeline, its set 0 and push constants (`compute`, `blocks`, `scatter`); the graphics
    /// pipeline, vertex bindings from 0 on, push constants and transform-feedback binding 0 (`feedback`), or set 0
    /// (`vertex-store`).
    ///
    /// The direct paths record nothing: their update is a list of weights for [`record_draws`](Self::record_draws).
    ///
    /// The caller is responsible for: submitting `cmd` exactly once, after all earlier updates of the crowd,
    /// or calling [`Crowd::discard`] with the ticket; having at most [`CrowdDesc::frames_in_flight`] updates
    /// unfinished, this one included; binding its own state anew; barriers of its own where other stages than
    /// those named read or have read poses.
    ///
    /// # Errors
    /// A crowd that another engine made. Nothing is recorded then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and without
    ///   active conditional rendering (the state of the crowd takes the update as done), on a queue with graphics and
    ///   compute.
    /// - It runs exactly once, after the upload of the mesh and all earlier updates of the crowd, and before later ones; or it
    ///   never runs, and [`Crowd::discard`] is called with the ticket before any later update is recorded.
    /// - A ticket is discarded only if neither its update nor any later one of the crowd runs: the next update takes over the
    ///   memory of their lists.
    /// - With this one, at most [`CrowdDesc::frames_in_flight`] updates of the crowd are recorded and not yet finished.
    /// - After an error or a panic nothing of the update counts as done; `cmd` may hold some of its commands after a panic, and
    ///   is not run then.
    /// - Engine, mesh and crowd live until the device has finished.
    pub unsafe fn record_update(&self, cmd: vk::CommandBuffer, crowd: &mut Crowd) -> Result<Update> {
        // SAFETY: the caller's obligations.
        unsafe { self.record_tampered(cmd, crowd, |_| {}) }
    }

    /// As [`record_update`](Self::record_update), with the commands changed by `tamper` before they are
    /// recorded: lets tests plant faults.
    ///
    /// # Errors
    /// As [`record_update`](Self::record_update).
    ///
    /// # Safety
    /// As [`record_update`](Self::record_update); what `tamper` breaks is broken.
    #[doc(hidden)]
    pub unsafe fn record_tampered(
        &self,
        cmd: vk::CommandBuffer,
        crowd: &mut Crowd,
        tamper: impl FnOnce(&mut crate::plan::commands::CommandList),
    ) -> Result<Update> {
        if !crowd.is_on(&self.device) {
            return Err(Error::invalid(
                "the crowd belongs to another MorphEngine",
                "record it with the engine that created it",
            ));
        }
        let mut planned = Planned { ticket: Some(crowd.next_ticket()), crowd };
        let mut update = planned.crowd.plan_update();
        tamper(planned.crowd.commands_mut());
        // SAFETY: the caller's obligations.
        unsafe { planned.crowd.record(cmd, &mut update) }?;
        planned.ticket = None;
        Ok(update)
    }
}

/// An update that is planned and not yet recorded: taken back when recording fails or panics.
struct Planned<'a> {
    crowd: &'a mut Crowd,
    ticket: Option<Ticket>,
}

impl Drop for Planned<'_> {
    fn drop(&mut self) {
        if let Some(ticket) = self.ticket.take() {
            // The ticket is of this crowd: there is no error.
            let _ = self.crowd.discard(ticket);
        }
    }
}

/// Bytes of the largest chunk of deltas.
fn chunk_bytes(layout: &PackedLayout) -> u64 {
    (layout.chunk_vertices * layout.targets.len() * layout.format.stride()) as u64
}

/// Bytes of the buffer of deltas: whole chunks, so that one descriptor range fits at every chunk's offset.
pub(crate) fn delta_buffer_bytes(layout: &PackedLayout) -> u64 {
    (chunk_bytes(layout) * layout.chunks().count() as u64).max(16)
}

/// Bytes that a descriptor of deltas covers.
pub(crate) fn delta_range(layout: &PackedLayout) -> u64 {
    chunk_bytes(layout).max(16)
}
