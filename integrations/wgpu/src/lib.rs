//! Morph targets of [`deltamorph`] in wgpu, on its Vulkan backend: it takes a device, and returns vertex buffers.
//!
//! ```no_run
//! # use deltamorph::{CrowdDesc, PackedMesh, UpdateDesc};
//! # use deltamorph_wgpu::{Morph, Result};
//! # fn draw_a_frame(_: &deltamorph_wgpu::Crowd) -> wgpu::CommandBuffer { todo!() }
//! # fn host(device: wgpu::Device, queue: wgpu::Queue, packed: PackedMesh, weights: Vec<f32>) -> Result<()> {
//! let morph = Morph::new(&device, &queue)?;
//! let mesh = morph.upload(&packed)?;
//! let mut crowd = morph.create_crowd(&mesh, &CrowdDesc::new(UpdateDesc::blocks()))?;
//! // Each frame:
//! crowd.set_weights(0, &weights)?;
//! let update = morph.update([&mut crowd])?; // None if nothing changed
//! let draws = draw_a_frame(&crowd); // pass.set_vertex_buffer(0, crowd.pose(0)?.slice());
//! queue.submit(update.into_iter().chain([draws]));
//! # Ok(()) }
//! ```
//!
//! [`VertexInput`] describes how a pipeline reads poses, with the WGSL for it. `examples/head.rs` is a complete host.
//! No feature or extension of the device is needed; with [`SHADER_INT64`](wgpu::Features::SHADER_INT64), software
//! drivers take half the time.
//!
//! # What the caller does
//! - Submit the command buffer of [`Morph::update`] before the draws that read the new poses, in the same submit or an
//!   earlier one, and submit updates of a crowd in the order they were made. It may be dropped instead: the next update
//!   then rewrites all poses. The next update does so as well if an earlier one was submitted out of order, or in a
//!   submit that failed. That is known only when the GPU has finished the work submitted before it; poses drawn until
//!   then are wrong.
//! - Nothing else. Resources of an update live until the GPU has finished with it, whatever is dropped before. If
//!   [`frames_in_flight`](deltamorph::CrowdDesc::frames_in_flight) updates of a crowd are unfinished, the next one
//!   waits for the oldest; with one more than the number of frames that the surface keeps in flight, there is nothing
//!   to wait for.
//!
//! # Synchronization
//! wgpu does not track the commands of an update, and treats pose buffers as never written. The update has its own
//! barriers, on both sides, for draws (vertex attributes, and storage buffers in vertex and fragment shaders), compute
//! passes and copies. Only updates may write poses: use them for read-only bindings only, though wgpu allows others.

mod crowd;
mod input;
mod submission;

pub use crowd::{Crowd, Pose, Stream};
pub use deltamorph::{self, Error, Result};
pub use input::{POSE_WGSL, VertexInput};

use deltamorph::ash::{self, vk};
use deltamorph::{
    Consumers, CrowdDesc, DeltaFormat, DeviceDesc, MorphEngine, PackDesc, PackedLayout, PackedMesh, Update,
};
use std::any::Any;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use submission::{Flight, Submission};
use wgpu::hal::api::Vulkan;

/// Morphing on a wgpu device.
pub struct Morph {
    engine: MorphEngine,
    queue: wgpu::Queue,
    // Declared last, as in all types here, so that it is dropped last: the other fields are destroyed on it.
    device: wgpu::Device,
}

/// A mesh on the device. Crowds keep the data that they need alive.
pub struct Mesh {
    gpu: Arc<Mutex<deltamorph::GpuMesh>>,
    layout: PackedLayout,
    _device: wgpu::Device,
}

impl Morph {
    /// Sets up morphing on `device`; updates are submitted to `queue`, which belongs to the device.
    ///
    /// # Errors
    /// The device has another backend than Vulkan, or less than Vulkan 1.1; its queue lacks graphics or compute; or
    /// [`MorphEngine::new`] fails.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Self> {
        // SAFETY: nothing taken from it is destroyed here; wgpu does that.
        let Some(hal) = (unsafe { device.as_hal::<Vulkan>() }) else {
            return Err(invalid("the device is not on Vulkan", "ask for wgpu::Backends::VULKAN"));
        };
        let (shared, physical) = (hal.shared_instance(), hal.raw_physical_device());
        let instance = shared.raw_instance();
        // SAFETY: the instance is alive, and the physical device belongs to it.
        let (properties, families) = unsafe {
            (
                instance.get_physical_device_properties(physical),
                instance.get_physical_device_queue_family_properties(physical),
            )
        };
        if shared.instance_api_version().min(properties.api_version) < vk::API_VERSION_1_1 {
            return Err(invalid("the device is of Vulkan 1.0", "use one of Vulkan 1.1 or later"));
        }
        let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        if !families.get(hal.queue_family_index() as usize).is_some_and(|family| family.queue_flags.contains(wanted)) {
            return Err(invalid("the queue has no graphics, or no compute", "use a device whose first queue has both"));
        }
        let int64 = vk::Bool32::from(device.features().contains(wgpu::Features::SHADER_INT64));
        let features = vk::PhysicalDeviceFeatures::default().shader_int64(int64 == vk::TRUE);
        let desc = DeviceDesc { enabled_features: features, ..DeviceDesc::new(instance, physical, hal.raw_device()) };
        // SAFETY: the handles are those of one wgpu device; a clone keeps it alive as long as the engine and everything
        // made by it. Only features that are enabled are named.
        let engine = unsafe { MorphEngine::new(&desc) }?;
        Ok(Self { engine, queue: queue.clone(), device: device.clone() })
    }

    /// Returns the packing of meshes for this device.
    pub fn pack_desc(&self, format: DeltaFormat) -> PackDesc {
        self.engine.pack_desc(format)
    }

    /// Uploads a mesh: the copies are submitted to the queue, before anything that is submitted later.
    ///
    /// # Errors
    /// Those of [`MorphEngine::upload`].
    pub fn upload(&self, mesh: &PackedMesh) -> Result<Mesh> {
        let (encoder, cmd) = self.encoder("deltamorph upload")?;
        // SAFETY: the command buffer is recording, and is submitted once, here; the mesh is dropped when it has
        // finished.
        let uploaded = unsafe { self.engine.upload(cmd, mesh) }?;
        let gpu = Arc::new(Mutex::new(uploaded));
        let commands = encoder.finish();
        commands.on_submitted_work_done({
            let (gpu, device) = (gpu.clone(), self.device.clone());
            move || {
                lock(&gpu).release_staging();
                drop((gpu, device));
            }
        });
        self.queue.submit([commands]);
        Ok(Mesh { gpu, layout: mesh.layout().clone(), _device: self.device.clone() })
    }

    /// Makes pose buffers and pipelines for the instances of a mesh, with all weights 0: see
    /// [`MorphEngine::create_crowd`]. Consumers are always draws, compute passes and copies, regardless of the
    /// description.
    ///
    /// # Errors
    /// Those of [`MorphEngine::create_crowd`].
    pub fn create_crowd(&self, mesh: &Mesh, desc: &CrowdDesc) -> Result<Crowd> {
        let made = CrowdDesc {
            consumers: desc.consumers | consumers(),
            pose_usage: desc.pose_usage | vk::BufferUsageFlags::TRANSFER_DST,
            ..*desc
        };
        // Unlocked before anything is submitted: callbacks of finished uploads run then, and lock it.
        let crowd = {
            let gpu = lock(&mesh.gpu);
            Crowd::new(self.engine.create_crowd(&gpu, &made)?, gpu.layouts(), &self.device)?
        };
        self.fill(&crowd)?;
        Ok(crowd)
    }

    /// Fills pose buffers with zeros: wgpu treats imported buffers as initialised, and allows reads of slots that no
    /// update has written yet.
    fn fill(&self, crowd: &Crowd) -> Result<()> {
        let (encoder, cmd) = self.encoder("deltamorph poses")?;
        let barrier = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE);
        let (fill, all) = (vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::ALL_COMMANDS);
        let device = raw_device(&self.device)?;
        // SAFETY: the command buffer is recording on the device, outside a render pass; the buffers were made for this,
        // and are kept until it has run.
        unsafe {
            crowd.raw_buffers().for_each(|buffer| device.cmd_fill_buffer(cmd, buffer, 0, vk::WHOLE_SIZE, 0));
            device.cmd_pipeline_barrier(cmd, fill, all, vk::DependencyFlags::empty(), &[barrier], &[], &[]);
        }
        let commands = encoder.finish();
        let kept = crowd.shared().clone();
        commands.on_submitted_work_done(move || drop(kept));
        self.queue.submit([commands]);
        Ok(())
    }

    /// Records an update of these crowds to the requested weights, with common barriers: pass all crowds of a frame in
    /// one call. Returns `None` if nothing changed; then there is nothing to submit.
    ///
    /// [What the caller does](crate#what-the-caller-does) explains when to submit it. From now on, [`Crowd::pose`]
    /// returns the poses after the update.
    ///
    /// The device is polled, which runs pending callbacks. The call waits if
    /// [`frames_in_flight`](deltamorph::CrowdDesc::frames_in_flight) updates of a crowd are unfinished.
    ///
    /// # Errors
    /// A crowd belongs to another `Morph`; an earlier update was neither submitted nor dropped, which must happen
    /// first; there is no memory.
    pub fn update<'a>(&self, crowds: impl IntoIterator<Item = &'a mut Crowd>) -> Result<Option<wgpu::CommandBuffer>> {
        let record = |cmd, crowds: &mut [&mut deltamorph::Crowd]| {
            // SAFETY: the command buffer is recording, on a queue with graphics and compute, with nothing else in it.
            // If it never runs, or out of order, `Crowd::make_room` discards the update before another is recorded. The
            // `Flight` keeps everything that it uses alive.
            unsafe { self.engine.record_updates(cmd, crowds) }
        };
        // SAFETY: `record` records an update.
        unsafe { self.update_by(crowds, record) }
    }

    /// Like [`update`](Self::update), but lets `tamper` change the recorded schedule, so that tests can inject faults.
    ///
    /// # Errors
    /// Those of [`update`](Self::update).
    ///
    /// # Safety
    /// The caller answers for the effects of `tamper`.
    #[cfg(feature = "internals")]
    #[doc(hidden)]
    pub unsafe fn update_tampered<'a>(
        &self,
        crowds: impl IntoIterator<Item = &'a mut Crowd>,
        tamper: impl FnOnce(&mut Vec<deltamorph::internals::plan::schedule::Entry>),
    ) -> Result<Option<wgpu::CommandBuffer>> {
        let record = |cmd, crowds: &mut [&mut deltamorph::Crowd]| {
            // SAFETY: the caller's obligations.
            unsafe { self.engine.record_tampered(cmd, crowds, tamper) }
        };
        // SAFETY: the caller's obligations.
        unsafe { self.update_by(crowds, record) }
    }

    /// Makes an update that `record` records.
    ///
    /// # Safety
    /// `record` is [`MorphEngine::record_updates`], or a function that records the same obligations.
    unsafe fn update_by<'a>(
        &self,
        crowds: impl IntoIterator<Item = &'a mut Crowd>,
        record: impl FnOnce(vk::CommandBuffer, &mut [&mut deltamorph::Crowd]) -> Result<Vec<Update>>,
    ) -> Result<Option<wgpu::CommandBuffer>> {
        let mut crowds: Vec<&mut Crowd> = crowds.into_iter().collect();
        // Runs the callbacks that report finished work. The result is of no further use.
        let _ = self.device.poll(wgpu::PollType::Poll);
        crowds.iter_mut().try_for_each(|crowd| crowd.make_room())?;
        let (encoder, cmd) = self.encoder("deltamorph update")?;
        let submission = Submission::new(&self.device)?;
        let updates = {
            let shared: Vec<_> = crowds.iter().map(|crowd| crowd.shared().clone()).collect();
            let mut locked: Vec<_> = shared.iter().map(|crowd| lock(crowd)).collect();
            let mut borrowed: Vec<_> = locked.iter_mut().map(|crowd| &mut **crowd).collect();
            record(cmd, &mut borrowed)?
        };
        if updates.iter().all(|update| update.stats.passes == 0) {
            return Ok(None);
        }
        // SAFETY: the command buffer is recording, outside a render pass, and in a flight.
        unsafe { submission.record(cmd) };
        let commands = encoder.finish();
        let flight = Flight::new(&submission, crowds.iter().map(|crowd| crowd.shared().clone()).collect());
        commands.on_submitted_work_done(move || drop(flight));
        for (crowd, update) in crowds.iter_mut().zip(updates) {
            crowd.updated(update.ticket, submission.clone());
        }
        Ok(Some(commands))
    }

    /// Makes a command encoder for our own commands, and returns its command buffer, which is recording.
    fn encoder(&self, label: &str) -> Result<(wgpu::CommandEncoder, vk::CommandBuffer)> {
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) });
        // SAFETY: the command buffer is not ended, and the encoder is only used to finish it once we have recorded.
        let cmd = unsafe { encoder.as_hal_mut::<Vulkan, _, _>(|hal| hal.map(|hal| hal.raw_handle())) };
        let cmd = cmd.ok_or_else(|| invalid("wgpu gave no command buffer", "see whether the device was lost"))?;
        Ok((encoder, cmd))
    }
}

impl Mesh {
    /// Returns names, steps and sizes of the uploaded mesh, and its index buffer ([`PackedLayout::indices`]).
    pub fn layout(&self) -> &PackedLayout {
        &self.layout
    }
}

/// Returns all uses that wgpu can make of a pose.
fn consumers() -> Consumers {
    let draws = Consumers::VERTEX_ATTRIBUTES | Consumers::VERTEX_SHADERS | Consumers::FRAGMENT_SHADERS;
    draws | Consumers::COMPUTE_SHADERS | Consumers::COPIES
}

/// Imports one of our buffers into wgpu. `keep` is dropped when wgpu and the GPU have finished with it.
///
/// # Safety
/// The buffer was made on this device, with these usages and at least `size` bytes, more than 0; it lives as long as
/// `keep`. `keep` holds nothing of wgpu's, since it is dropped under wgpu's locks.
unsafe fn import(
    device: &wgpu::Device,
    buffer: vk::Buffer,
    size: u64,
    usage: wgpu::BufferUsages,
    keep: Arc<dyn Any + Send + Sync>,
) -> wgpu::Buffer {
    let desc = wgpu::BufferDescriptor { label: Some("deltamorph"), size, usage, mapped_at_creation: false };
    // SAFETY: the caller's obligations; usages without MAP_READ and MAP_WRITE are never mapped.
    unsafe {
        let hal = wgpu::hal::vulkan::Buffer::from_raw_externally_owned(buffer, Box::new(move || drop(keep)));
        device.create_buffer_from_hal::<Vulkan>(hal, &desc)
    }
}

/// Returns the Vulkan device behind a wgpu device, which the caller must keep alive.
fn raw_device(device: &wgpu::Device) -> Result<ash::Device> {
    // SAFETY: the caller keeps it alive.
    let raw = unsafe { device.as_hal::<Vulkan>() }.map(|hal| hal.raw_device().clone());
    raw.ok_or_else(|| invalid("the device is not on Vulkan", "ask for wgpu::Backends::VULKAN"))
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    // A poisoned lock is still used: an update that panics rolls back its plan.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn invalid(what: impl Into<String>, remedy: impl Into<String>) -> Error {
    Error::Invalid { what: what.into(), remedy: remedy.into() }
}
