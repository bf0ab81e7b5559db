//! How to make a crowd on a device, and where its poses are kept.

use crate::error::{Error, Result};
use crate::gpu::device::Device;
use crate::pack::{PackedLayout, VertexLayout};
use crate::plan::{Consumers, UpdateDesc, UpdatePath};
use crate::setters::setters;
use ash::vk;

/// How to make a crowd.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CrowdDesc {
    /// Instances, each with weights and poses of its own (≥ 1).
    pub instances: u32,
    /// How poses are updated.
    pub update: UpdateDesc,
    /// Updates that may be recorded and not yet finished (≥ 1): how many coefficient or work lists are kept. Updates
    /// that recorded nothing and discarded ones do not count.
    pub frames_in_flight: u32,
    /// Who reads poses between updates: updates wait for these readers, and make new poses visible to them.
    pub consumers: Consumers,
    /// The family of the queue that updates of the crowd run on; `None`: one with graphics and compute. On one without
    /// graphics, barriers name no stage of graphics: [consumers](field@Self::consumers) that have such a stage are on
    /// another queue ([`MorphEngine`](crate::MorphEngine#several-queues)).
    pub queue_family: Option<u32>,
    /// Extra usages of engine-owned pose buffers, in addition to the defaults (vertex, storage and storage texel
    /// buffer, source of copies; on a device with transform feedback, its buffer). Usages of Vulkan 1.0, and
    /// `SHADER_DEVICE_ADDRESS` and `ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR` where
    /// [`DeviceDesc::buffer_device_address`](field@crate::DeviceDesc::buffer_device_address) says so (the latter needs
    /// its extension enabled, too).
    pub pose_usage: vk::BufferUsageFlags,
    /// Vertices of the host's own that poses are written into (path `blocks`); `None`: into pose buffers of ours.
    pub poses: Option<HostPoses>,
}

setters!(CrowdDesc {
    instances: u32,
    update: UpdateDesc,
    frames_in_flight: u32,
    consumers: Consumers,
    queue_family: Option<u32>,
    pose_usage: vk::BufferUsageFlags,
    poses: Option<HostPoses>,
});

impl CrowdDesc {
    /// One instance, two frames in flight, drawn from vertex attributes or by vertex shaders, in pose buffers of ours.
    pub fn new(update: UpdateDesc) -> Self {
        Self {
            instances: 1,
            update,
            frames_in_flight: 2,
            consumers: Consumers::default(),
            queue_family: None,
            pose_usage: vk::BufferUsageFlags::empty(),
            poses: None,
        }
    }

    /// Check the queue that updates run on.
    ///
    /// # Errors
    /// A family that the device does not have, that lacks what the path needs, or that the engine's buffers are not
    /// for.
    pub(crate) fn check_queue(&self, device: &Device) -> Result<()> {
        let Some(family) = self.queue_family else { return Ok(()) };
        device.caps.check_queue_family(self.update.path, family)?;
        if device.families.is_empty() || device.families.contains(&family) {
            return Ok(());
        }
        let text = format!("updates on queue family {family}, of an engine for the families {:?}", device.families);
        Err(Error::invalid(text, "name it in DeviceDesc::queue_families, too"))
    }

    /// Those of the consumers that can be on the queue that updates run on, which was checked.
    pub(crate) fn consumers_on_queue(&self, device: &Device) -> Consumers {
        let flags = self.queue_family.and_then(|family| device.caps.queue_flags(family).ok());
        self.consumers.of_queue(flags.is_none_or(|flags| flags.contains(vk::QueueFlags::GRAPHICS)))
    }

    /// Check where poses are kept, for the groups of a mesh.
    ///
    /// # Errors
    /// Usages that the device was not said to allow; a path that writes no vertices of hosts; a vertex that does not
    /// suit the mesh.
    pub(crate) fn check_poses<'a>(
        &self,
        groups: impl Iterator<Item = &'a PackedLayout> + Clone,
        device: &Device,
    ) -> Result<()> {
        use vk::BufferUsageFlags as U;
        let addressed = U::SHADER_DEVICE_ADDRESS | U::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;
        let usage = self.pose_usage;
        if usage.intersects(addressed) && !device.device_address {
            let text = format!("pose buffers for {usage:?}, on a device or allocator without buffer device addresses");
            let remedy = "enable bufferDeviceAddress, have the allocator made for it where you hand one in, and set \
                          DeviceDesc::buffer_device_address";
            return Err(Error::invalid(text, remedy));
        }
        let core = U::from_raw((U::INDIRECT_BUFFER.as_raw() << 1) - 1);
        let unknown = usage & !(core | addressed);
        if !unknown.is_empty() {
            let text = format!("pose buffers for {unknown:?}");
            return Err(Error::invalid(text, "have poses written into a buffer of your own (CrowdDesc::poses)"));
        }
        let Some(HostPoses { vertex, .. }) = &self.poses else { return Ok(()) };
        if !usage.is_empty() {
            let text = format!("pose buffers of ours for {usage:?}, and poses in vertices of the host's");
            return Err(Error::invalid(text, "make your buffer for that, and leave CrowdDesc::pose_usage empty"));
        }
        if self.update.path != UpdatePath::Blocks {
            let text = format!("poses in vertices of the host's with the path '{}'", self.update.path.name());
            return Err(Error::invalid(text, "use the path 'blocks', or leave CrowdDesc::poses out"));
        }
        vertex.check(groups, self.update.pose)
    }
}

/// Vertices of a host's own that a crowd keeps its poses in: the buffer, where they begin, and how a vertex is laid
/// out.
///
/// From `offset` on there is a pose for each slot of each instance, `[instance][slot]`, of [`VertexLayout::pose_bytes`]
/// each; vertices are in the order of pose buffers
/// ([`PackedLayout::remap_indices`](crate::PackedLayout::remap_indices)), padded. `instances × slots × pose_bytes`
/// bytes in all. The pose of an instance moves from slot to slot, as in buffers of ours:
/// [`Crowd::pose`](crate::Crowd::pose) says where it is. With one slot it stays in place.
///
/// Updates, passes and barriers are the same as with buffers of ours; only drivers that run on the CPU take longer in
/// the format `fast`, for which they have kernels that know our layout alone. Barriers are global memory barriers: they
/// order what the [consumers](field@CrowdDesc::consumers) read of the buffer, whatever they read. How the buffer is
/// shared is the host's. Where updates and draws run on queues of two families, make it `VK_SHARING_MODE_CONCURRENT`,
/// as the engine's own are ([`MorphEngine`](crate::MorphEngine#several-queues)). With `VK_SHARING_MODE_EXCLUSIVE` the
/// host transfers ownership itself, of all that the crowd takes: released by the draws' queue and acquired by the
/// updates' before each update, and the other way round after it. An incremental update reads the poses that the draws
/// before it read, so that updates and draws then take turns.
///
/// ```no_run
/// # use deltamorph::{ash::vk, CrowdDesc, GpuMesh, HostPoses, MorphEngine, PackedMesh, Semantic, UpdateDesc, VertexLayout};
/// # fn make(engine: &MorphEngine, packed: &PackedMesh, mesh: &GpuMesh, create: impl Fn(u64) -> vk::Buffer)
/// # -> deltamorph::Result<()> {
/// // Position, normal, tangent (left alone), texture coordinates (left alone).
/// let vertex = VertexLayout::new(48).stream(Semantic::Position, 0).stream(Semantic::Normal, 12);
/// let update = UpdateDesc::blocks();
/// let bytes = vertex.pose_bytes(packed.layout()) * u64::from(update.slots);
/// let buffer = create(bytes); // VERTEX_BUFFER | STORAGE_BUFFER
/// // SAFETY: it is large enough, of this device, and outlives the crowd.
/// let poses = unsafe { HostPoses::new(buffer, 0, vertex) };
/// let crowd = engine.create_crowd(mesh, &CrowdDesc::new(update).poses(Some(poses)))?;
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostPoses {
    buffer: vk::Buffer,
    offset: u64,
    vertex: VertexLayout,
}

impl HostPoses {
    /// Poses in `buffer` from byte `offset` on, a multiple of 4 ([`create_crowd`](crate::MorphEngine::create_crowd)
    /// refuses others).
    ///
    /// # Safety
    /// Of every crowd that is made with it, and of its engine's device:
    /// - The buffer belongs to the device, was made for use as storage buffer, and has its memory, as much as the crowd
    ///   takes. It lives until the crowd is dropped.
    /// - What the crowd writes is read and written by nobody else while an update runs, but by the crowd's consumers in
    ///   the order that its barriers make; and by no other crowd.
    #[must_use]
    pub const unsafe fn new(buffer: vk::Buffer, offset: u64, vertex: VertexLayout) -> Self {
        Self { buffer, offset, vertex }
    }

    /// The buffer.
    pub const fn buffer(&self) -> vk::Buffer {
        self.buffer
    }

    /// Bytes from its beginning to the first pose.
    pub const fn offset(&self) -> u64 {
        self.offset
    }

    /// How a vertex is laid out.
    pub const fn vertex(&self) -> &VertexLayout {
        &self.vertex
    }
}
