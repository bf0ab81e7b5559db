//! The parts of a host with its own device: the device, its queue, and an allocator.

use deltamorph::ash::{self, vk};
use deltamorph::gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use deltamorph::gpu_allocator::{AllocationSizes, AllocatorDebugSettings};
use deltamorph::memory::SharedAllocator;
use deltamorph::{GpuMesh, MorphEngine, PackedMesh};
use deltamorph_headless::Headless;
use std::sync::{Arc, Mutex};

/// A device of the host's, and its queue, which one thread at a time may submit to.
pub struct Host {
    pub device: ash::Device,
    queue: Mutex<vk::Queue>,
    /// Buffers have device addresses.
    addresses: bool,
}

impl Host {
    pub fn new(headless: &Headless) -> Arc<Self> {
        Self::with(headless, false)
    }

    /// A device whose buffers may have addresses, if `addresses` says so.
    pub fn with(headless: &Headless, addresses: bool) -> Arc<Self> {
        let (instance, physical, _) = headless.handles();
        let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
        let mut info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
        let mut feature = vk::PhysicalDeviceBufferDeviceAddressFeatures::default().buffer_device_address(true);
        let names = [ash::khr::buffer_device_address::NAME.as_ptr()];
        if addresses {
            info = info.enabled_extension_names(&names).push_next(&mut feature);
        }
        // SAFETY: the physical device is the instance's own; software drivers have one family of queues.
        let device = unsafe { instance.create_device(physical, &info, None) }.expect("a device");
        // SAFETY: as above.
        let queue = Mutex::new(unsafe { device.get_device_queue(0, 0) });
        Arc::new(Self { device, queue, addresses })
    }

    pub fn allocator(self: &Arc<Self>, headless: &Headless) -> SharedAllocator {
        let (instance, physical_device, _) = headless.handles();
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.clone(),
            device: self.device.clone(),
            physical_device,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: self.addresses,
            allocation_sizes: AllocationSizes::new(1 << 20, 1 << 20),
        });
        SharedAllocator::new(Arc::new(Mutex::new(allocator.expect("an allocator"))), Some(self.clone()))
    }

    /// Records a command buffer with `f`, submits it, and waits. Any thread may call it.
    pub fn run<R>(&self, f: impl FnOnce(vk::CommandBuffer) -> R) -> R {
        let device = &self.device;
        // SAFETY: everything but the queue is this call's own, destroyed once, and not in use after the wait.
        unsafe {
            let pool = device.create_command_pool(&vk::CommandPoolCreateInfo::default(), None).expect("a pool");
            let fence = device.create_fence(&vk::FenceCreateInfo::default(), None).expect("a fence");
            let commands = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let cmds = device.allocate_command_buffers(&commands).expect("a command buffer");
            device.begin_command_buffer(cmds[0], &vk::CommandBufferBeginInfo::default()).expect("recording");
            let result = f(cmds[0]);
            device.end_command_buffer(cmds[0]).expect("recorded");
            let submit = vk::SubmitInfo::default().command_buffers(&cmds);
            device.queue_submit(*self.queue.lock().expect("a queue"), &[submit], fence).expect("submitted");
            device.wait_for_fences(&[fence], true, u64::MAX).expect("finished");
            device.destroy_fence(fence, None);
            device.destroy_command_pool(pool, None);
            result
        }
    }

    /// Uploads a mesh, and releases its staging memory.
    pub fn upload(&self, engine: &MorphEngine, mesh: &PackedMesh) -> GpuMesh {
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
        let mut uploaded = self.run(|cmd| unsafe { engine.upload(cmd, mesh) }).expect("an upload");
        uploaded.release_staging();
        uploaded
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // SAFETY: everything made on the device keeps this value alive.
        unsafe { self.device.destroy_device(None) };
    }
}
