//! Description of a crowd on a device, and of host-owned pose buffers.

use crate::error::{Result, ensure};
use crate::gpu::device::Device;
use crate::pack::{PackedLayout, VertexLayout};
use crate::plan::{Consumers, UpdateDesc, UpdatePath};
use ash::vk;

/// Describes a crowd on a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrowdDesc {
    /// Number of instances (≥ 1), each with its own weights and poses. It is fixed: make the most that will be needed,
    /// and [remove](crate::Crowd::remove) or [hide](crate::Crowd::set_hidden) the rest, which updates leave out; or
    /// make a second crowd of the same mesh later.
    pub instances: u32,
    /// How poses are updated.
    pub update: UpdateDesc,
    /// Updates that may be recorded but unfinished (≥ 1): the number of coefficient or work lists in the ring. Updates
    /// that recorded nothing and discarded ones do not count.
    pub frames_in_flight: u32,
    /// Readers of poses between updates: updates wait for them, and make new poses visible to them.
    pub consumers: Consumers,
    /// Queue family of the crowd's updates; `None`: one with graphics and compute. Without graphics, barriers contain
    /// no graphics stages; [consumers](Self::consumers) in such stages are on another queue
    /// ([`MorphEngine`](crate::MorphEngine#several-queues)).
    pub queue_family: Option<u32>,
    /// Extra usages of engine-owned pose buffers, in addition to the defaults (vertex, storage and storage texel
    /// buffer, transfer source; transform feedback buffer if the device supports it). Usages of Vulkan 1.0; also
    /// `SHADER_DEVICE_ADDRESS` and `ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR` if
    /// [`DeviceDesc::buffer_device_address`](crate::DeviceDesc::buffer_device_address) is set (the latter also
    /// needs its extension).
    pub pose_usage: vk::BufferUsageFlags,
    /// Host vertices to write poses into (path `blocks`); `None`: engine-owned pose buffers.
    pub poses: Option<HostPoses>,
}

impl CrowdDesc {
    /// One instance, two frames in flight, the default consumers, engine-owned pose buffers.
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

    /// Checks the queue family of updates.
    ///
    /// # Errors
    /// A family that the device does not have, that lacks what the path needs, or that the engine's buffers are not
    /// shared with.
    pub(crate) fn check_queue(&self, device: &Device) -> Result<()> {
        let Some(family) = self.queue_family else { return Ok(()) };
        device.caps.check_queue_family(self.update.path, family)?;
        let families = &device.families;
        let text = format!("updates on queue family {family}, of an engine for the families {families:?}");
        let is_named = families.is_empty() || families.contains(&family);
        ensure!(is_named, text, "add it to DeviceDesc::queue_families");
        Ok(())
    }

    /// The consumers that can be on the queue of updates, which was checked.
    pub(crate) fn consumers_on_queue(&self, device: &Device) -> Consumers {
        let flags = self.queue_family.and_then(|family| device.caps.queue_flags(family).ok());
        self.consumers.of_queue(flags.is_none_or(|flags| flags.contains(vk::QueueFlags::GRAPHICS)))
    }

    /// Checks pose buffers, for the groups of a mesh.
    ///
    /// # Errors
    /// Usages that the device does not allow; host vertices on a path without support; a vertex layout that does not
    /// match the mesh.
    pub(crate) fn check_poses<'a>(
        &self,
        groups: impl Iterator<Item = &'a PackedLayout> + Clone,
        device: &Device,
    ) -> Result<()> {
        use vk::BufferUsageFlags as U;
        let addressed = U::SHADER_DEVICE_ADDRESS | U::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;
        let usage = self.pose_usage;
        let text = format!("pose buffers for {usage:?}, on a device or allocator without buffer device addresses");
        let remedy = "enable bufferDeviceAddress, have the allocator made for it where you hand one in, and set \
                      DeviceDesc::buffer_device_address";
        ensure!(device.device_address || !usage.intersects(addressed), text, remedy);
        let core = U::from_raw((U::INDIRECT_BUFFER.as_raw() << 1) - 1);
        let unknown = usage & !(core | addressed);
        let remedy = "have poses written into a buffer of your own (CrowdDesc::poses)";
        ensure!(unknown.is_empty(), format!("pose buffers for {unknown:?}"), remedy);
        let Some(HostPoses { vertex, .. }) = &self.poses else { return Ok(()) };
        let text = format!("usage {usage:?} for engine-owned pose buffers, but poses are in the host's vertices");
        let remedy = "create the host's buffer with this usage, and leave CrowdDesc::pose_usage empty";
        ensure!(usage.is_empty(), text, remedy);
        let path = self.update.path;
        let text = format!("poses in the host's vertices with the path '{}'", path.name());
        ensure!(path == UpdatePath::Blocks, text, "use the path 'blocks', or leave CrowdDesc::poses out");
        vertex.check(groups, self.update.pose)
    }
}

/// Host vertices that a crowd keeps its poses in: buffer, offset and vertex layout.
///
/// The buffer holds one pose per slot of each instance from `offset` on, `[instance][slot]`, of
/// [`VertexLayout::pose_bytes`] each: `instances × slots × pose_bytes` bytes. Vertices are in pose-buffer order
/// ([`PackedLayout::remap_indices`](crate::PackedLayout::remap_indices)), padded. As in engine-owned buffers, the pose
/// of an instance moves from slot to slot ([`Crowd::pose`](crate::Crowd::pose) returns its place); with one slot it
/// stays in place.
///
/// Updates, passes and barriers are the same as with engine-owned buffers; only software drivers are slower, because
/// their own kernels need the engine's layout. Barriers are global memory barriers and order all reads of the buffer by
/// the [consumers](CrowdDesc::consumers). The host decides how the buffer is shared. If updates and draws run on queues
/// of two families, use `VK_SHARING_MODE_CONCURRENT`, like the engine's own buffers
/// ([`MorphEngine`](crate::MorphEngine#several-queues)). With `VK_SHARING_MODE_EXCLUSIVE` the host transfers ownership
/// of the crowd's whole range: from the draws' queue to the updates' before each update, and back after it. Since an
/// incremental update reads poses that earlier draws read, updates and draws then alternate.
///
/// On lavapipe with `shaderInt64` updates of the host's vertices take several times as long as those of engine-owned
/// buffers, which kernels for software drivers write; GPUs run the same kernels for both.
///
/// ```no_run
/// # use deltamorph::{ash::vk, CrowdDesc, GpuMesh, HostPoses, MorphEngine, PackedMesh, Semantic, UpdateDesc};
/// # use deltamorph::VertexLayout;
/// # fn make(engine: &MorphEngine, packed: &PackedMesh, mesh: &GpuMesh, create: impl Fn(u64) -> vk::Buffer)
/// # -> deltamorph::Result<()> {
/// // Position, normal, tangent (left alone), texture coordinates (left alone).
/// let vertex = VertexLayout::new(48).stream(Semantic::Position, 0).stream(Semantic::Normal, 12);
/// let update = UpdateDesc::blocks();
/// let bytes = vertex.pose_bytes(packed.layout()) * u64::from(update.slots);
/// let buffer = create(bytes); // VERTEX_BUFFER | STORAGE_BUFFER
/// // SAFETY: it is large enough, of this device, and outlives the crowd.
/// let poses = unsafe { HostPoses::new(buffer, 0, vertex) };
/// let crowd = engine.create_crowd(mesh, &CrowdDesc { poses: Some(poses), ..CrowdDesc::new(update) })?;
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
    /// Poses in `buffer` from byte `offset` on, a multiple of 4 (checked by
    /// [`create_crowd`](crate::MorphEngine::create_crowd)).
    ///
    /// # Safety
    /// For every crowd created with it, and the device of its engine:
    /// - The buffer belongs to the device, has storage buffer usage and bound memory, is large enough for the crowd,
    ///   and lives until the crowd is dropped.
    /// - While an update runs, nothing else reads or writes what the crowd writes, except the crowd's consumers in the
    ///   order that its barriers establish. No other crowd uses it.
    #[must_use]
    pub const unsafe fn new(buffer: vk::Buffer, offset: u64, vertex: VertexLayout) -> Self {
        Self { buffer, offset, vertex }
    }

    /// The buffer.
    pub(crate) const fn buffer(&self) -> vk::Buffer {
        self.buffer
    }

    /// Byte offset of the first pose.
    #[doc(hidden)]
    pub const fn offset(&self) -> u64 {
        self.offset
    }

    /// The vertex layout.
    #[doc(hidden)]
    pub const fn vertex(&self) -> &VertexLayout {
        &self.vertex
    }
}
