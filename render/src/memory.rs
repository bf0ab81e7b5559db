//! Buffers that host and device share, and images to draw into.

use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph::internals::gpu::device::Device;
pub(crate) use deltamorph::internals::gpu::memory::Buffer;
use deltamorph::internals::gpu::statistics::MemoryKind;
use deltamorph_headless::{Image, ImageDesc};
use std::sync::Arc;

/// Makes a buffer of `bytes`, all 0, that the host writes, or reads after copies to it.
pub fn buffer(gpu: &Arc<Device>, bytes: usize, usage: vk::BufferUsageFlags) -> Result<Buffer> {
    let read = usage.contains(vk::BufferUsageFlags::TRANSFER_DST);
    let kind = if read { MemoryKind::Readback } else { MemoryKind::Lists };
    let mut buffer = Buffer::new(gpu, "deltamorph renderer", bytes as u64, usage, kind)?;
    buffer.mapped()?.fill(0);
    Ok(buffer)
}

/// Makes a buffer with these contents.
pub fn filled(gpu: &Arc<Device>, contents: &[u8], usage: vk::BufferUsageFlags) -> Result<Buffer> {
    let mut buffer = buffer(gpu, contents.len(), usage)?;
    write(&mut buffer, 0, contents)?;
    Ok(buffer)
}

/// Writes `contents` at `offset`. The caller guarantees that the device does not use these bytes now.
///
/// # Panics
/// If the buffer is too small.
pub fn write(buffer: &mut Buffer, offset: usize, contents: &[u8]) -> Result<()> {
    buffer.mapped()?[offset..][..contents.len()].copy_from_slice(contents);
    Ok(())
}

/// Makes an image with a view of it.
pub fn image(
    gpu: &Arc<Device>,
    extent: vk::Extent2D,
    format: vk::Format,
    samples: vk::SampleCountFlags,
    usage: vk::ImageUsageFlags,
) -> Result<Image> {
    let desc = ImageDesc { size: [extent.width, extent.height], layers: 1, format, samples, usage };
    let mut image = Image::new(gpu, "deltamorph picture", &desc)?;
    image.view(0..1, false)?;
    Ok(image)
}
