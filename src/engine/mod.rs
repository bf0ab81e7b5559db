//! Upload a mesh, make a crowd, record updates into the host's command buffer. Knows no technique and no format.

mod after;
mod base;
mod crowd;
#[cfg(feature = "internals")]
mod internals;
mod poses;
mod readback;
mod record;
mod set;
mod upload;
mod views;

pub use base::{AnyCrowd, DeviceCrowd, Ticket, Update};
pub use crowd::{AnimatedCrowd, Crowd};
pub use readback::{PoseReadback, ReadPose};
pub use set::CrowdSet;
pub use upload::GpuMesh;
pub use views::{PoseBuffer, PoseView, StreamView};

use crate::abi::numbers::WORKGROUP;
use crate::error::{Error, Result};
use crate::gpu::caps::{CAPTURE_STRIDE, DeviceCaps};
use crate::gpu::device::{Device, DeviceDesc};
use crate::gpu::pipelines::Kernels;
use crate::pack::blocks::BlockDesc;
use crate::pack::{DeltaFormat, PackDesc};
use crate::update::Runner;
use crate::update::animated::{Animated, AnimationDesc, Clips};
use crate::update::crowd::CrowdDesc;
use crate::update::technique;
use crate::update::technique::{Context, Technique, Techniques};
use ash::vk;
use crowd::{Playing, Weighted};
use std::sync::{Arc, OnceLock};

/// The engine: the host's device and the pipelines made so far.
///
/// The engine borrows the host's device and records; it never submits, waits, or creates a queue, thread or
/// window. In frame order:
///
/// 1. [`MorphEngine::new`] with the host's device, once; [`MorphEngine::upload`] records the copies of a
///    [`PackedMesh`](crate::PackedMesh); [`MorphEngine::create_crowd`] makes pose buffers and pipelines.
/// 2. Each frame: [`Crowd::set_weights`], then [`MorphEngine::record_update`] before the draws, then draw from
///    [`Crowd::pose`].
///
/// Or the GPU does it all: [`MorphEngine::create_animated_crowd`] uploads clips, [`AnimatedCrowd::play`] says who plays
/// which, and each frame takes [`AnimatedCrowd::set_time`] in place of weights.
///
/// # What the caller is responsible for
/// - Uploads, updates and draws run on one queue with graphics and compute, since barriers name the stages of both, or
///   as [several queues](#several-queues) may. Recorded updates run exactly once each, in the order recorded. An update
///   that will never run is handed to [`Crowd::discard`], and only such a one, before anything newer of the crowd is
///   submitted.
/// - At most [`CrowdDesc::frames_in_flight`] updates of a crowd are recorded and not yet finished. Updates that
///   recorded nothing and discarded ones do not count.
/// - Engine, meshes and crowds are dropped only when the device has finished with them, in any order, and before the
///   device is destroyed: an [`owner`](field@DeviceDesc::owner) that they keep alive sees to that. An allocator that
///   the host shares is not locked by the host meanwhile.
///
/// # Several queues
/// Updates can run on a queue of their own, such as one with compute alone, beside the draws of the frame before:
/// [`DeviceDesc::queue_families`](field@DeviceDesc::queue_families) names the families of all queues, so that buffers
/// are shared by them, and [`CrowdDesc::queue_family`] the one that updates of a crowd run on. Then semaphores, binary
/// ones or timelines, order what barriers order on one queue:
///
/// - From upload to update, and where draws read the base pose (poses of integers), from upload to draw. Uploads may
///   run on any queue.
/// - From update to draw: the draws' queue waits at the stages that read poses (such as VERTEX_INPUT or VERTEX_SHADER).
///   The update signals after its last command.
/// - From draw to a later update: the updates' queue waits at COMPUTE_SHADER (of `feedback` and `vertex-store` at
///   ALL_COMMANDS), before an update that writes a slot, for the last draw that read it. An update writes the slot that
///   is `slots - 1` updates older than the current one. With one update and one draw a frame, that of frame n waits for
///   the draw of frame n - slots, or of n - slots + 1 where draws read the [previous pose](Crowd::previous_pose), too:
///   two slots, or three, let an update run beside the draw of the frame before it. A [discarded](Crowd::discard)
///   update gives its slot back: the next writes the one that it would have written. `feedback` and `vertex-store`
///   write two slots in turn where an update takes several passes: that of frame n waits for the draw of frame n -
///   (slots + 1) / 2 (rounded down), or of n - (slots - 1) / 2 and at least of n - 1 where draws read the previous
///   pose.
/// - What [follows the pose](crate::after) is written into the host's buffers, which the host shares among the families
///   as it does others. A target has one place, which the draw of the frame before reads; a skinned one may have two.
///
/// Updates of one crowd run on one queue, or on several that semaphores order. Those that one
/// [`record_updates`](Self::record_updates) records are of one family, or refused.
pub struct MorphEngine {
    pub(crate) device: Arc<Device>,
    kernels: Kernels,
    /// Techniques that are made outside the library.
    others: OnceLock<&'static Techniques>,
}

impl MorphEngine {
    /// An engine on the host's device.
    ///
    /// # Errors
    /// Queue families that the device does not have; numbers of [`DeviceCaps::tuning`](field@DeviceCaps::tuning) that
    /// there are no kernels for.
    ///
    /// # Safety
    /// - The handles of `desc` are alive, belong together (the pipeline cache may be null), are of Vulkan 1.1 or later,
    ///   and outlive the engine and all it creates, or live as long as the clones of `desc.owner`. An allocator that is
    ///   handed in was made on the same device, without `buffer_device_address` unless the device has that feature
    ///   enabled; `desc.buffer_device_address` is true only if the device has it, and so has that allocator.
    /// - `desc.caps` does not exceed what the device has.
    /// - `desc.transform_feedback_enabled` is true only if extension and feature were enabled on the device, and
    ///   `desc.enabled_features` has no other features than those that were; `desc.debug_names` is true only if
    ///   VK_EXT_debug_utils was enabled on the instance.
    pub unsafe fn new(desc: &DeviceDesc<'_>) -> Result<Self> {
        // SAFETY: the caller's obligations are those of `borrow`.
        let device = Arc::new(unsafe { Device::borrow(desc) }?);
        Ok(Self { kernels: Kernels::new(&device), others: OnceLock::new(), device })
    }

    /// Techniques that are made outside the library, for crowds that are made from now on; once.
    #[doc(hidden)]
    pub fn set_techniques(&self, others: &'static Techniques) {
        self.others.get_or_init(|| others);
    }

    pub(super) fn technique(&self, context: Context<'_>) -> Result<Box<dyn Technique>> {
        technique(context, self.others.get().copied())
    }

    /// Limits and features that the engine keeps to.
    pub fn caps(&self) -> &DeviceCaps {
        &self.device.caps
    }

    /// How to pack a mesh for this device.
    pub fn pack_desc(&self, format: DeltaFormat) -> PackDesc {
        let caps = &self.device.caps;
        let dispatch = u64::from(caps.max_workgroups) * u64::from(WORKGROUP);
        let capture = caps.transform_feedback.map_or(u64::MAX, |f| f.max_buffer_bytes / CAPTURE_STRIDE as u64);
        let max_chunk_vertices = dispatch.min(capture);
        PackDesc { format, max_chunk_bytes: caps.max_storage_range, max_chunk_vertices, blocks: BlockDesc::default() }
    }

    /// Bytes of memory that the allocator has from the driver, blocks that are not full included: all of the host's,
    /// where it handed one in.
    pub fn allocated_bytes(&self) -> u64 {
        self.device.allocator().capacity()
    }

    /// Make pose buffers and pipelines for the instances of a mesh, all weights 0. The first update writes
    /// their base poses.
    ///
    /// Pipelines are made here, not while animating; crowds that take the same kernels share them.
    ///
    /// # Errors
    /// A mesh that another engine uploaded; a path or batch size that the device cannot run, with what to use instead;
    /// vertices of the host's ([`CrowdDesc::poses`]) that do not suit the mesh or the path, or a buffer that is too
    /// small for them, as far as `vkGetBufferMemoryRequirements` tells; usages ([`CrowdDesc::pose_usage`]) that the
    /// device was not said to allow; a [queue family](field@CrowdDesc::queue_family) that there is not, that lacks what
    /// the path needs, or that the engine was not made for; no memory.
    pub fn create_crowd(&self, mesh: &GpuMesh, desc: &CrowdDesc) -> Result<Crowd> {
        self.check_crowd(mesh, desc, Runner::Device(&self.device.caps))?;
        let targets = mesh.layout().targets.len();
        Crowd::on_device(&self.device, &self.kernels, mesh, desc, targets, |context, poses| {
            Ok(Weighted::new(self.technique(context)?, poses))
        })
    }

    /// Refuse a mesh that was uploaded elsewhere.
    fn check_own(&self, mesh: &GpuMesh) -> Result<()> {
        if mesh.groups[0].base.is_on(&self.device) {
            return Ok(());
        }
        let text = format!("mesh '{}' belongs to another MorphEngine", mesh.layout().name);
        Err(Error::invalid(text, "upload it with the engine that makes the crowd"))
    }

    fn check_crowd(&self, mesh: &GpuMesh, desc: &CrowdDesc, runner: Runner<'_>) -> Result<()> {
        self.check_own(mesh)?;
        mesh.layouts().try_for_each(|layout| desc.update.check_all(layout, runner))?;
        desc.update.path.check_groups(mesh.groups.len(), mesh.layout())?;
        desc.check_poses(mesh.layouts(), &self.device)?;
        desc.check_queue(&self.device)?;
        if mesh.groups[0].private.is_none() == desc.update.path.row().has_own_upload {
            return Err(Error::invalid(
                format!("mesh '{}' for the path '{}'", mesh.layout().name, desc.update.path.name()),
                "upload it for the path: the techniques 'scatter' and 'texture' of others have uploads of their own",
            ));
        }
        Ok(())
    }

    /// Make a crowd whose instances play clips on the GPU, and record the upload of the clips. Each update samples
    /// every instance at the time set, plans, and carries the plan out; the CPU records the same commands whatever
    /// changes.
    ///
    /// Poses are integers: they do not drift, and there is no bound to keep. With an error budget, changes are deferred
    /// target by target ([`error_budget`](field@crate::plan::UpdateDesc::error_budget)). Slots always rotate. Instances
    /// that have played nothing yet show the base pose. What an update wrote only the GPU knows:
    /// [`UpdateStats`](crate::plan::UpdateStats) count a pass, and nothing else. There is no ring of lists either: any
    /// number of updates may be in flight.
    ///
    /// An update that is [discarded](AnimatedCrowd::discard) changed nothing: the poses are those of the update before,
    /// and the next update does what it would have done. Only instances that it added have no pose until then, and such
    /// as came and went several times in the updates discarded.
    ///
    /// This records: a copy and two fills, and a barrier that makes them visible to updates (first stage TRANSFER with
    /// TRANSFER_WRITE; last COMPUTE_SHADER).
    ///
    /// The caller is responsible for: submitting `cmd` before any update of the crowd, and calling
    /// [`AnimatedCrowd::release_staging`] once it has run.
    ///
    /// # Errors
    /// As [`create_crowd`](Self::create_crowd) and [`Clips::new`]; float32 poses, more than 32 slots; more
    /// instances, clips or entries than the device's storage range holds, with the numbers. Nothing is recorded then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering, on a queue with compute.
    /// - It runs before any update of the crowd, exactly once; where it never does, the crowd is not updated.
    /// - The value returned is dropped only when the device no longer uses it.
    pub unsafe fn create_animated_crowd(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &GpuMesh,
        desc: &CrowdDesc,
        animation: &AnimationDesc<'_>,
    ) -> Result<AnimatedCrowd> {
        self.check_crowd(mesh, desc, Runner::Animated(Some(&self.device.caps)))?;
        // Weights are the GPU's: none are set.
        let crowd = AnimatedCrowd::on_device(&self.device, &self.kernels, mesh, desc, 0, |context, poses| {
            let clips = Clips::new(animation, context.layout(), context.grid())?;
            Ok(Playing::new(Animated::new(context, clips)?, poses))
        })?;
        // SAFETY: the caller's obligations.
        unsafe { crowd.animated().upload(cmd) };
        Ok(crowd)
    }
}
