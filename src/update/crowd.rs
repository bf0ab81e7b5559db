//! Description of a crowd on a device.

use crate::error::{Result, ensure};
use crate::gpu::device::Device;
use crate::plan::{Consumers, UpdateDesc};
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
}

impl CrowdDesc {
    /// One instance, two frames in flight, the default consumers.
    pub fn new(update: UpdateDesc) -> Self {
        Self {
            instances: 1,
            update,
            frames_in_flight: 2,
            consumers: Consumers::default(),
            queue_family: None,
            pose_usage: vk::BufferUsageFlags::empty(),
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

    /// Checks the usages of pose buffers.
    ///
    /// # Errors
    /// Usages that the device does not allow.
    pub(crate) fn check_pose_usage(&self, device: &Device) -> Result<()> {
        use vk::BufferUsageFlags as U;
        let addressed = U::SHADER_DEVICE_ADDRESS | U::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;
        let usage = self.pose_usage;
        let text = format!("pose buffers for {usage:?}, on a device or allocator without buffer device addresses");
        let remedy = "enable bufferDeviceAddress, have the allocator made for it where you hand one in, and set \
                      DeviceDesc::buffer_device_address";
        ensure!(device.device_address || !usage.intersects(addressed), text, remedy);
        let core = U::from_raw((U::INDIRECT_BUFFER.as_raw() << 1) - 1);
        let unknown = usage & !(core | addressed);
        let remedy = "have poses written into a buffer of your own (MorphEngine::set_output_target)";
        ensure!(unknown.is_empty(), format!("pose buffers for {unknown:?}"), remedy);
        Ok(())
    }
}
