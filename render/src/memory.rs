//! Buffers and images, each with dedicated memory: there are about a dozen, which live as long as their renderer
//! objects.

use deltamorph::ash::{self, vk};
use deltamorph::{Error, ErrorKind, Result};
use std::sync::Arc;

/// Returns a function for `map_err` that names the Vulkan call in the error.
pub(crate) fn failed(call: &'static str) -> impl Fn(vk::Result) -> Error {
    move |result| match Error::vulkan(call)(result) {
        error if error.kind() == ErrorKind::OutOfMemory => {
            Error::Vulkan { call, result, remedy: "free memory, or draw fewer heads or smaller pictures" }
        }
        error => error,
    }
}

/// The device, shared by all objects.
pub(crate) struct Gpu {
    pub(crate) device: ash::Device,
    memory: vk::PhysicalDeviceMemoryProperties,
    pub(crate) limits: vk::PhysicalDeviceLimits,
}

impl Gpu {
    /// # Safety
    /// The handles belong together, and outlive the value and everything made with it.
    pub(crate) unsafe fn new(
        instance: &ash::Instance,
        physical: vk::PhysicalDevice,
        device: &ash::Device,
    ) -> Arc<Self> {
        // SAFETY: the caller guarantees that the handles belong together.
        let memory = unsafe { instance.get_physical_device_memory_properties(physical) };
        // SAFETY: as above.
        let limits = unsafe { instance.get_physical_device_properties(physical) }.limits;
        Arc::new(Self { device: device.clone(), memory, limits })
    }

    /// Allocates memory of the first type that fits, with the properties `wished` if possible.
    fn allocate(
        &self,
        needs: vk::MemoryRequirements,
        required: vk::MemoryPropertyFlags,
        wished: vk::MemoryPropertyFlags,
    ) -> Result<vk::DeviceMemory> {
        let types = &self.memory.memory_types[..self.memory.memory_type_count as usize];
        let find = |flags| {
            let fits = |(i, kind): &(usize, &vk::MemoryType)| {
                needs.memory_type_bits >> i & 1 == 1 && kind.property_flags.contains(flags)
            };
            types.iter().enumerate().find(fits).map(|(i, _)| i as u32)
        };
        let index = find(required | wished).or_else(|| find(required)).ok_or_else(|| Error::Invalid {
            what: format!("no type of memory has {required:?}"),
            remedy: "look at the driver: Vulkan promises one".into(),
        })?;
        let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
        // SAFETY: the device is alive, and has this type of memory.
        unsafe { self.device.allocate_memory(&info, None) }.map_err(failed("vkAllocateMemory"))
    }
}

/// A buffer in memory that host and device share.
pub(crate) struct Buffer {
    gpu: Arc<Gpu>,
    pub(crate) raw: vk::Buffer,
    memory: vk::DeviceMemory,
    bytes: usize,
    mapped: *mut u8,
}

impl Buffer {
    /// Makes a buffer of `bytes` (≥ 1), all 0.
    pub(crate) fn new(gpu: &Arc<Gpu>, bytes: usize, usage: vk::BufferUsageFlags, cached: bool) -> Result<Self> {
        let info = vk::BufferCreateInfo::default().size(bytes as u64).usage(usage);
        // SAFETY: the device is alive as long as `gpu`; what is made is destroyed by `drop`.
        let raw = unsafe { gpu.device.create_buffer(&info, None) }.map_err(failed("vkCreateBuffer"))?;
        let memory = vk::DeviceMemory::null();
        let mapped = std::ptr::null_mut();
        let mut this = Self { gpu: gpu.clone(), raw, memory, bytes, mapped };
        let shared = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let wished = if cached { vk::MemoryPropertyFlags::HOST_CACHED } else { vk::MemoryPropertyFlags::empty() };
        // SAFETY: as above; the memory has a type and size that fit the buffer, and `bytes` bytes are mapped.
        unsafe {
            this.memory = gpu.allocate(gpu.device.get_buffer_memory_requirements(raw), shared, wished)?;
            gpu.device.bind_buffer_memory(raw, this.memory, 0).map_err(failed("vkBindBufferMemory"))?;
            let mapped = gpu.device.map_memory(this.memory, 0, vk::WHOLE_SIZE, Default::default());
            this.mapped = mapped.map_err(failed("vkMapMemory"))?.cast();
            this.mapped.write_bytes(0, bytes);
        }
        Ok(this)
    }

    /// Makes a buffer with these contents.
    pub(crate) fn filled(gpu: &Arc<Gpu>, contents: &[u8], usage: vk::BufferUsageFlags) -> Result<Self> {
        let mut buffer = Self::new(gpu, contents.len().max(4), usage, false)?;
        buffer.write(0, contents);
        Ok(buffer)
    }

    /// Writes `contents` at `offset`. The caller guarantees that the device does not use these bytes now.
    ///
    /// # Panics
    /// If the buffer is too small.
    pub(crate) fn write(&mut self, offset: usize, contents: &[u8]) {
        assert!(offset + contents.len() <= self.bytes, "{} bytes at {offset} of {}", contents.len(), self.bytes);
        // SAFETY: that many bytes are mapped, as checked above; `&mut` excludes other accesses of the host.
        unsafe { self.mapped.add(offset).copy_from_nonoverlapping(contents.as_ptr(), contents.len()) };
    }

    /// Returns the contents. The caller guarantees that writes by the device have finished.
    pub(crate) fn contents(&self) -> &[u8] {
        // SAFETY: `bytes` bytes are mapped and initialised, and only `&mut` writes them.
        unsafe { std::slice::from_raw_parts(self.mapped, self.bytes) }
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, and not in use: see `Target` and `Model`.
        unsafe {
            self.gpu.device.destroy_buffer(self.raw, None);
            self.gpu.device.free_memory(self.memory, None);
        }
    }
}

/// The properties of an image to make.
pub(crate) struct ImageDesc {
    pub(crate) extent: vk::Extent2D,
    pub(crate) format: vk::Format,
    pub(crate) samples: vk::SampleCountFlags,
    pub(crate) usage: vk::ImageUsageFlags,
    pub(crate) aspect: vk::ImageAspectFlags,
}

/// An image on the device, with a view of the whole image.
pub(crate) struct Image {
    gpu: Arc<Gpu>,
    pub(crate) raw: vk::Image,
    pub(crate) view: vk::ImageView,
    memory: vk::DeviceMemory,
}

impl Image {
    pub(crate) fn new(gpu: &Arc<Gpu>, desc: &ImageDesc) -> Result<Self> {
        let info = vk::ImageCreateInfo::default().image_type(vk::ImageType::TYPE_2D).format(desc.format);
        let info = info.extent(desc.extent.into()).mip_levels(1).array_layers(1).usage(desc.usage);
        let range = vk::ImageSubresourceRange::default().aspect_mask(desc.aspect).level_count(1).layer_count(1);
        // SAFETY: the device is alive as long as `gpu`; what is made is destroyed by `drop`; the memory has a type and
        // size that fit the image.
        unsafe {
            let raw = gpu.device.create_image(&info.samples(desc.samples), None).map_err(failed("vkCreateImage"))?;
            let view = vk::ImageView::null();
            let memory = vk::DeviceMemory::null();
            let mut this = Self { gpu: gpu.clone(), raw, view, memory };
            let needs = gpu.device.get_image_memory_requirements(raw);
            this.memory = gpu.allocate(needs, Default::default(), vk::MemoryPropertyFlags::DEVICE_LOCAL)?;
            gpu.device.bind_image_memory(raw, this.memory, 0).map_err(failed("vkBindImageMemory"))?;
            let view = vk::ImageViewCreateInfo::default().view_type(vk::ImageViewType::TYPE_2D).format(desc.format);
            let view = view.image(raw).subresource_range(range);
            this.view = gpu.device.create_image_view(&view, None).map_err(failed("vkCreateImageView"))?;
            Ok(this)
        }
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, and not in use: see `Target`.
        unsafe {
            self.gpu.device.destroy_image_view(self.view, None);
            self.gpu.device.destroy_image(self.raw, None);
            self.gpu.device.free_memory(self.memory, None);
        }
    }
}
