//! A minimal host engine that morphs a head: start here to link deltamorph.
//!
//!     cargo run --example minimal [PART OF A DEVICE'S NAME]
//!
//! Instance, device, queue, command buffers, fences and the copy at the end belong to the host, as in any engine;
//! deltamorph records into the host's command buffers. The example plays two seconds of a clip with two frames in
//! flight, reads every pose back, and compares it with the float64 reference.

use deltamorph::ash::{self, vk};
use deltamorph::reference::{compare, evaluate};
use deltamorph::{
    Consumers, CrowdDesc, DeltaFormat, DeviceCaps, DeviceDesc, Error, MorphEngine, PackedMesh, PoseError, PoseView,
    Tolerance, UpdateDesc,
};
use deltamorph_head as head;
use std::time::Duration;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;
const FRAMES_IN_FLIGHT: usize = 2;

/// The objects of any Vulkan program. Each is destroyed separately, so that a partly made host cleans up too.
struct Host {
    queue: vk::Queue,
    pool: vk::CommandPool,
    device: ash::Device,
    physical: vk::PhysicalDevice,
    instance: Instance, // goes after the device
}

struct Instance {
    raw: ash::Instance,
    _entry: ash::Entry, // keeps the Vulkan library loaded
}

impl Host {
    fn new(wanted: &str) -> Result<Self> {
        let app = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
        // SAFETY: the system's loader is meant to be loaded, and queries are about the instance's own devices; the
        // device was created with the queue.
        unsafe {
            let entry = ash::Entry::load()?;
            let raw = entry.create_instance(&vk::InstanceCreateInfo::default().application_info(&app), None);
            let instance = Instance { raw: raw.map_err(Error::vulkan("vkCreateInstance"))?, _entry: entry };
            let devices =
                instance.raw.enumerate_physical_devices().map_err(Error::vulkan("vkEnumeratePhysicalDevices"))?;
            // Checked before queries that Vulkan 1.0 does not have.
            let version = |d: &vk::PhysicalDevice| instance.raw.get_physical_device_properties(*d).api_version;
            let devices = devices.into_iter().filter(|d| version(d) >= vk::API_VERSION_1_1);
            let caps = devices.map(|d| Ok((d, DeviceCaps::query(&instance.raw, d)?))).collect::<Result<Vec<_>>>()?;
            let usable = caps.into_iter().filter(|(_, caps)| caps.name.contains(wanted));
            let (physical, _) = usable.min_by_key(|(_, c)| c.is_software()).ok_or("no such Vulkan 1.1 device")?;
            let families = instance.raw.get_physical_device_queue_family_properties(physical);
            let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
            let family = families.iter().position(|f| f.queue_flags.contains(wanted)).ok_or("no queue")? as u32;
            let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
            // No extensions or features: `deltamorph::requirements` lists none for UpdatePath::Blocks.
            let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
            let device = instance.raw.create_device(physical, &info, None).map_err(Error::vulkan("vkCreateDevice"))?;
            let (queue, pool) = (device.get_device_queue(family, 0), vk::CommandPool::null());
            let mut host = Self { queue, pool, device, physical, instance };
            let flags = vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER;
            let pool = vk::CommandPoolCreateInfo::default().queue_family_index(family).flags(flags);
            host.pool = host.device.create_command_pool(&pool, None).map_err(Error::vulkan("vkCreateCommandPool"))?;
            Ok(host)
        }
    }

    /// Waits until the device is idle or lost. A wait may run out of memory while the device is still working, when its
    /// resources must not be dropped: it is repeated, within limits.
    fn wait_idle(&self) {
        for _ in 0..1000 {
            // SAFETY: waiting is always allowed.
            match unsafe { self.device.device_wait_idle() } {
                Ok(()) | Err(vk::Result::ERROR_DEVICE_LOST) => return,
                Err(_) => std::thread::sleep(Duration::from_millis(10)),
            }
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // SAFETY: destroyed once, after the objects made on the device.
        unsafe {
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: destroyed once, after its device.
        unsafe { self.raw.destroy_instance(None) };
    }
}

/// A frame in flight of the host, with host-visible memory for a copy of its pose.
struct Frame<'a> {
    host: &'a Host,
    cmd: vk::CommandBuffer,
    fence: vk::Fence,
    readback: vk::Buffer,
    memory: vk::DeviceMemory,
    mapped: *const f32,
}

impl<'a> Frame<'a> {
    fn new(host: &'a Host, bytes: u64) -> Result<Self> {
        let Host { instance, physical, device, pool, .. } = host;
        // Null handles may be destroyed, too.
        let (cmd, fence, readback) = (vk::CommandBuffer::null(), vk::Fence::null(), vk::Buffer::null());
        let mut this = Self { host, cmd, fence, readback, memory: vk::DeviceMemory::null(), mapped: std::ptr::null() };
        let buffer = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::TRANSFER_DST);
        // SAFETY: everything is created on one device; the memory has a type and size that fit the buffer.
        unsafe {
            let cmds = vk::CommandBufferAllocateInfo::default().command_pool(*pool).command_buffer_count(1);
            this.cmd = device.allocate_command_buffers(&cmds).map_err(Error::vulkan("vkAllocateCommandBuffers"))?[0];
            let fence = device.create_fence(&vk::FenceCreateInfo::default(), None);
            this.fence = fence.map_err(Error::vulkan("vkCreateFence"))?;
            this.readback = device.create_buffer(&buffer, None).map_err(Error::vulkan("vkCreateBuffer"))?;
            let needs = device.get_buffer_memory_requirements(this.readback);
            let types = instance.raw.get_physical_device_memory_properties(*physical).memory_types;
            let visible = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
            let fits = |i: &u32| types[*i as usize].property_flags.contains(visible);
            let index = (0..32).filter(|i| needs.memory_type_bits >> i & 1 == 1).find(fits).ok_or("no memory")?;
            let memory = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
            this.memory = device.allocate_memory(&memory, None).map_err(Error::vulkan("vkAllocateMemory"))?;
            device.bind_buffer_memory(this.readback, this.memory, 0).map_err(Error::vulkan("vkBindBufferMemory"))?;
            let mapped = device.map_memory(this.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty());
            this.mapped = mapped.map_err(Error::vulkan("vkMapMemory"))?.cast();
            Ok(this)
        }
    }

    /// Records with `f`, and submits. The device has finished with this frame: `wait` comes between two submits.
    fn submit<R>(&self, f: impl FnOnce(vk::CommandBuffer) -> Result<R>) -> Result<R> {
        let (device, cmd) = (&self.host.device, self.cmd);
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: command buffer and fence are this frame's, and not in use (see above).
        unsafe {
            device.begin_command_buffer(cmd, &once).map_err(Error::vulkan("vkBeginCommandBuffer"))?;
            let recorded = f(cmd)?;
            device.end_command_buffer(cmd).map_err(Error::vulkan("vkEndCommandBuffer"))?;
            let submit = vk::SubmitInfo::default().command_buffers(std::slice::from_ref(&cmd));
            let submitted = device.queue_submit(self.host.queue, &[submit], self.fence);
            submitted.map_err(Error::vulkan("vkQueueSubmit"))?;
            Ok(recorded)
        }
    }

    /// Waits for the submission. Even after an error the device no longer uses it: the caller may drop it.
    fn wait(&self) -> Result<()> {
        let device = &self.host.device;
        // SAFETY: the fence was handed to `submit`, and no other thread uses it.
        unsafe {
            let waited = device.wait_for_fences(&[self.fence], true, u64::MAX);
            waited.inspect_err(|_| self.host.wait_idle()).map_err(Error::vulkan("vkWaitForFences"))?;
            Ok(device.reset_fences(&[self.fence]).map_err(Error::vulkan("vkResetFences"))?)
        }
    }

    /// Copies a pose to the readback memory, for which `Consumers::COPIES` has made it ready. A host that draws the
    /// pose does not need this.
    fn record_readback(&self, pose: &PoseView) {
        use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
        let device = &self.host.device;
        let region = [vk::BufferCopy { src_offset: pose.offset, dst_offset: 0, size: pose.size }];
        let read =
            [vk::MemoryBarrier::default().src_access_mask(Access::TRANSFER_WRITE).dst_access_mask(Access::HOST_READ)];
        let none = vk::DependencyFlags::empty();
        // SAFETY: `cmd` is recording, outside a render pass; both buffers have `pose.size` bytes at these offsets.
        unsafe {
            device.cmd_copy_buffer(self.cmd, pose.buffer, self.readback, &region);
            device.cmd_pipeline_barrier(self.cmd, Stage::TRANSFER, Stage::HOST, none, &read, &[], &[]);
        }
    }
}

impl Drop for Frame<'_> {
    fn drop(&mut self) {
        let device = &self.host.device;
        // SAFETY: destroyed once; the owner has waited.
        unsafe {
            device.destroy_buffer(self.readback, None);
            device.free_memory(self.memory, None);
            device.destroy_fence(self.fence, None);
        }
    }
}

fn main() {
    if let Err(error) = run(&std::env::args().nth(1).unwrap_or_default()) {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run(wanted: &str) -> Result<()> {
    // Rust drops the last declared first: crowd, mesh, frames, engine, host.
    let host = Host::new(wanted)?;
    let desc = DeviceDesc::new(&host.instance.raw, host.physical, &host.device);
    // SAFETY: the handles belong together, and are destroyed after the engine and its objects.
    let engine = unsafe { MorphEngine::new(&desc) }?;
    let head_desc = head::HeadDesc::default().vertices(5_000).targets(52);
    let source = head::head(&head_desc);
    let mesh = PackedMesh::pack(&source.to_mesh(Tolerance::default())?, &engine.pack_desc(DeltaFormat::Fast))?;
    let names: Vec<&str> = mesh.layout().targets.iter().map(|t| t.name.as_str()).collect();
    let clip: Vec<Vec<f32>> = head::head_clip(&head_desc, 60, 30.0).bind(&names)?.frames().collect();
    let frame = || Frame::new(&host, mesh.layout().base_bytes());
    let frames: [Frame<'_>; FRAMES_IN_FLIGHT] = [frame()?, frame()?];

    // SAFETY: `submit` hands out a recording buffer; the mesh is dropped after the last wait.
    let mut uploaded = frames[0].submit(|cmd| Ok(unsafe { engine.upload(cmd, &mesh) }?))?;
    frames[0].wait()?;
    // SAFETY: the upload has run.
    unsafe { uploaded.release_staging() };
    let consumers = Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES;
    let crowd_desc =
        CrowdDesc::new(UpdateDesc::blocks()).frames_in_flight(FRAMES_IN_FLIGHT as u32).consumers(consumers);
    let mut crowd = engine.create_crowd(&uploaded, &crowd_desc)?;

    let (mut worst, mut applied, mut blocks) = (PoseError::default(), 0, 0);
    let played = (0..clip.len() + FRAMES_IN_FLIGHT).try_for_each(|now| -> Result<()> {
        let frame = &frames[now % FRAMES_IN_FLIGHT];
        if let Some(shown) = now.checked_sub(FRAMES_IN_FLIGHT) {
            frame.wait()?;
            // SAFETY: coherent memory of as many floats, mapped, and written by a copy that has finished.
            let pose = unsafe { std::slice::from_raw_parts(frame.mapped, mesh.base().len()) };
            let pose = mesh.layout().to_user_order(pose);
            worst = worst.max(compare(&pose, &evaluate(&mesh, &clip[shown])));
        }
        let Some(weights) = clip.get(now) else { return Ok(()) };
        crowd.set_weights(0, weights)?;
        let update = frame.submit(|cmd| {
            // SAFETY: `cmd` is recording on the engine's device, outside a render pass, and is submitted once, in
            // order, after the wait for the frame FRAMES_IN_FLIGHT ago. If dropped: crowd.discard(update.ticket).
            let update = unsafe { engine.record_update(cmd, &mut crowd) }?;
            // Draws go here. For motion vectors: `crowd.previous_pose(0)?`, this pose after `crowd.cut(0)?`.
            frame.record_readback(&crowd.pose(0)?);
            Ok(update)
        })?;
        (applied, blocks) = (applied + update.stats.coefficients, blocks + update.stats.dirty_blocks);
        Ok(())
    });
    // Also after an error, so that nothing dropped below is still in use.
    host.wait_idle();
    played?;
    let (error, angle) = (worst.position / f64::from(mesh.layout().diagonal), worst.normal_degrees);
    println!(
        "{}: {} poses of {} triangles, {applied} weights in {blocks} blocks, within {error:.1e} of the diagonal and {angle:.4}°",
        engine.caps().name,
        clip.len(),
        mesh.layout().indices.len() / 3
    );
    if error <= 1e-5 && angle <= 0.01 { Ok(()) } else { Err("the poses differ from the reference".into()) }
}
