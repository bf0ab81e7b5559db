//! Uploads meshes, creates crowds, and records updates into the host's command buffers. Independent of techniques and
//! formats.

mod after;
mod base;
mod crowd;
#[cfg(feature = "internals")]
mod internals;
mod poses;
mod readback;
mod record;
mod upload;
mod views;

pub use base::{Crowd, Ticket, Update};
pub use readback::{PoseReadback, ReadPose};
pub use upload::GpuMesh;
pub use views::{PoseBuffer, PoseView, StreamView};

use crate::abi::numbers::WORKGROUP;
use crate::error::{Result, ensure};
use crate::gpu::caps::{CAPTURE_STRIDE, DeviceCaps};
use crate::gpu::device::{Device, DeviceDesc};
use crate::gpu::pipelines::Kernels;
use crate::gpu::statistics::MemoryStats;
use crate::pack::{DeltaFormat, PackDesc};
use crate::update::Runner;
use crate::update::animated::{Animated, AnimationDesc, Clips};
use crate::update::crowd::CrowdDesc;
use crate::update::technique;
use crate::update::technique::{Context, Techniques};
use ash::vk;
use std::sync::{Arc, OnceLock};

/// The engine: the host's device, and a cache of pipelines.
///
/// The engine borrows the host's device and records; it never submits, waits, or creates a queue, thread or
/// window. In frame order:
///
/// 1. [`MorphEngine::new`] with the host's device, once; [`MorphEngine::upload`] records the copies of a
///    [`PackedMesh`](crate::PackedMesh); [`MorphEngine::create_crowd`] makes pose buffers and pipelines.
/// 2. Each frame: [`Crowd::set_weights`], then [`MorphEngine::record_update`] before the draws, then draw from
///    [`Crowd::pose`].
///
/// Or the GPU animates: [`MorphEngine::create_animated_crowd`] uploads clips, [`Crowd::play`] starts them, and
/// each frame calls [`Crowd::set_time`] instead of setting weights.
///
/// # What the caller is responsible for
/// - Uploads, updates and draws run on one queue with graphics and compute, since barriers name stages of both, or on
///   [several queues](#several-queues). Recorded updates run exactly once each, in the order recorded. An update that
///   will never run is passed to [`Crowd::discard`] before any later update of the crowd is submitted; those recorded
///   after it are discarded with it.
/// - At most [`CrowdDesc::frames_in_flight`] updates of a crowd are recorded but unfinished. Updates that recorded
///   nothing and discarded ones do not count.
/// - Engine, meshes and crowds are dropped, in any order, only when the device no longer uses them, and before the
///   device is destroyed; an [`owner`](DeviceDesc::owner) can keep it alive. The host holds no lock of a shared
///   allocator meanwhile.
///
/// # Several queues
/// Updates can run on a queue of their own, such as one with compute only, concurrently with the draws of the previous
/// frame. [`DeviceDesc::queue_families`](DeviceDesc::queue_families) names the families of all queues, which
/// share the buffers; [`CrowdDesc::queue_family`] names the one of a crowd's updates. Semaphores, binary or timeline,
/// then order what barriers order on one queue:
///
/// - From upload to update. Uploads may run on any queue.
/// - From update to draw: the draws' queue waits at the stages that read poses (such as VERTEX_INPUT or VERTEX_SHADER).
///   The update signals after its last command.
/// - From draw to a later update: the updates' queue waits at COMPUTE_SHADER (`feedback` and `vertex-store`:
///   ALL_COMMANDS), before an update that writes a slot, for the last draw that read it. An update writes the slot that
///   is `slots - 1` updates older than the current one. With one update and one draw per frame, the update of frame n
///   waits for the draw of frame n - slots, or of n - slots + 1 if draws also read the [previous
///   pose](Crowd::previous_pose): with two slots, or three, an update can run concurrently with the draw of the
///   previous frame. A [discarded](Crowd::discard) update returns its slot: the next update writes the same one.
///   `feedback` and `vertex-store` alternate between two slots in an update of several passes: frame n waits for the
///   draw of frame n - (slots + 1) / 2 (rounded down), or of n - (slots - 1) / 2 and at least of n - 1 if draws also
///   read the previous pose.
/// - Outputs of [post-morph passes](crate::after) lie in the host's buffers, which the host shares among the families
///   itself. The update of a target with one output buffer waits for the draw of the previous frame; a
///   [second buffer](crate::after::OutputStream::second) saves that.
///
/// Updates of one crowd run on one queue, or on several that semaphores order. The crowds of one call of
/// [`record_updates`](Self::record_updates) must have the same family.
pub struct MorphEngine {
    pub(crate) device: Arc<Device>,
    kernels: Kernels,
    /// Techniques implemented outside the library.
    others: OnceLock<&'static Techniques>,
}

impl MorphEngine {
    /// Creates an engine on the host's device.
    ///
    /// # Errors
    /// Queue families that the device does not have; values of [`DeviceCaps::tuning`](DeviceCaps::tuning) without
    /// kernels.
    ///
    /// # Safety
    /// - The handles of `desc` are valid, belong together (the pipeline cache may be null), are of Vulkan 1.1 or later,
    ///   and outlive the engine and everything it creates, or live as long as the clones of `desc.owner`. An allocator
    ///   that is passed in was created on the same device, with `buffer_device_address` only if the device has that
    ///   feature enabled. `desc.buffer_device_address` is true only if the device has it enabled and the allocator was
    ///   created with it.
    /// - `desc.caps` does not exceed the device's capabilities.
    /// - `desc.transform_feedback_enabled` is true only if extension and feature were enabled on the device;
    ///   `desc.enabled_features` has only features that were; `desc.debug_names` is true only if VK_EXT_debug_utils was
    ///   enabled on the instance.
    pub unsafe fn new(desc: &DeviceDesc<'_>) -> Result<Self> {
        // SAFETY: the caller's obligations are those of `borrow`.
        let device = Arc::new(unsafe { Device::borrow(desc) }?);
        Ok(Self { kernels: Kernels::new(&device), others: OnceLock::new(), device })
    }

    /// Sets the techniques implemented outside the library, for crowds created from now on. Only the first call has an
    /// effect.
    #[doc(hidden)]
    pub fn set_techniques(&self, others: &'static Techniques) {
        self.others.get_or_init(|| others);
    }

    /// Limits and features that the engine uses.
    pub fn caps(&self) -> &DeviceCaps {
        &self.device.caps
    }

    /// The description for packing a mesh for this device.
    pub fn pack_desc(&self, format: DeltaFormat) -> PackDesc {
        let caps = &self.device.caps;
        let dispatch = u64::from(caps.max_workgroups) * u64::from(WORKGROUP);
        let capture = caps.transform_feedback.map_or(u64::MAX, |f| f.max_buffer_bytes / CAPTURE_STRIDE as u64);
        let max_chunk_vertices = dispatch.min(capture);
        PackDesc { max_chunk_bytes: caps.max_storage_range, max_chunk_vertices, ..PackDesc::new(format) }
    }

    /// Memory of the engine's objects, by what it is for. Host buffers are not counted.
    pub fn memory(&self) -> MemoryStats {
        self.device.used()
    }

    /// Creates pose buffers and pipelines for instances of a mesh, all weights 0. The first update writes base poses.
    ///
    /// Pipelines are created here, never while animating; crowds share pipelines of the same kernels.
    ///
    /// # Errors
    /// A mesh of another engine; a path or batch size that the device does not support (the message names an
    /// alternative); usages ([`CrowdDesc::pose_usage`]) that the device does not allow; a [queue
    /// family](CrowdDesc::queue_family) that does not exist, lacks what the path needs, or is not one of the engine's;
    /// no memory.
    pub fn create_crowd(&self, mesh: &GpuMesh, desc: &CrowdDesc) -> Result<Crowd> {
        self.check_crowd(mesh, desc, Runner::Device(&self.device.caps))?;
        let targets = mesh.layout().targets.len();
        let make = |context: Context<'_>| technique(context, self.others.get().copied());
        Crowd::on_device(&self.device, &self.kernels, mesh, desc, targets, make)
    }

    fn check_crowd(&self, mesh: &GpuMesh, desc: &CrowdDesc, runner: Runner<'_>) -> Result<()> {
        let name = &mesh.layout().name;
        let text = format!("mesh '{name}' belongs to another MorphEngine");
        let is_its_own = mesh.groups[0].base.is_on(&self.device);
        ensure!(is_its_own, text, "upload it with the engine that makes the crowd");
        mesh.layouts().try_for_each(|layout| desc.update.check_all(layout, runner))?;
        desc.update.path.check_groups(mesh.groups.len(), mesh.layout())?;
        desc.check_pose_usage(&self.device)?;
        desc.check_queue(&self.device)?;
        let path = desc.update.path;
        let fits = mesh.groups[0].private.is_some() == path.row().has_own_upload;
        let remedy = "upload it for the path: the baselines 'scatter' and 'texture' have uploads of their own";
        ensure!(fits, format!("mesh '{name}' for the path '{}'", path.name()), remedy);
        Ok(())
    }

    /// Creates a crowd whose instances play clips on the GPU, and records the upload of the clips. Each update samples
    /// every instance at the current time, plans and executes on the GPU; the CPU records the same commands whatever
    /// changes.
    ///
    /// Poses are fixed-point, so they do not drift. There is no
    /// [`error_budget`](crate::plan::UpdateDesc::error_budget). Slots rotate in every update. Instances that have not
    /// played anything show the base pose. [`UpdateStats`](crate::plan::UpdateStats) count one pass and nothing else,
    /// since only the GPU knows the rest. Any number of updates may be in flight, since there is no ring of lists; with
    /// [post-morph passes](crate::after), [`CrowdDesc::frames_in_flight`] at most.
    ///
    /// A [discarded](Crowd::discard) update changed nothing: poses are those of the update before it, and the
    /// next update does its work. Until then, instances added since have no pose, nor do those that were shown and
    /// hidden repeatedly in the discarded updates.
    ///
    /// Records: a copy and two fills, and a barrier that makes them visible to updates (first stage TRANSFER with
    /// TRANSFER_WRITE; last COMPUTE_SHADER).
    ///
    /// The caller is responsible for: submitting `cmd` before any update of the crowd, and calling
    /// [`Crowd::release_staging`] once it has finished.
    ///
    /// # Errors
    /// Errors of [`create_crowd`](Self::create_crowd) and [`Clips::new`]; float32 poses; an error budget; more than 32
    /// slots; instances, clips or entries beyond the device's storage range, with the numbers. Nothing is recorded
    /// then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering, on a queue with compute.
    /// - It runs exactly once, before any update of the crowd; if it never runs, the crowd is not updated.
    /// - [`Crowd::release_staging`] is called only when `cmd` has finished, or if it never runs.
    /// - The returned value is dropped only when the device no longer uses it.
    pub unsafe fn create_animated_crowd(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &GpuMesh,
        desc: &CrowdDesc,
        animation: &AnimationDesc<'_>,
    ) -> Result<Crowd> {
        self.check_crowd(mesh, desc, Runner::Animated(&self.device.caps))?;
        // The GPU has the weights: none are requested by the host.
        let crowd = Crowd::on_device(&self.device, &self.kernels, mesh, desc, 0, |context| {
            // Before they are filled.
            context.check_range(
                "clips",
                Clips::bytes(animation, context.layout()),
                "use fewer frames or 16-bit keys",
            )?;
            let clips = Clips::new(animation, context.layout(), context.grid())?;
            Ok(Box::new(Animated::new(context, clips)?))
        })?;
        if let Some(animated) = crowd.animated() {
            // SAFETY: the caller's obligations.
            unsafe { animated.upload(cmd) };
        }
        Ok(crowd)
    }
}
