//! What fills and binds textures.

use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::statistics::MemoryKind;
use deltamorph::Result;
use deltamorph::ash::vk;
use std::sync::Arc;

/// Records the copy of all texels of a new image from a buffer, with layout changes around it; afterwards shaders can
/// load the image.
///
/// # Safety
/// - `cmd` is in the recording state on the image's device, outside a render pass.
/// - `texels` holds all texels of the image, and both live until the copy has run; the image is not used meanwhile.
pub unsafe fn record_filling(
    device: &Device,
    cmd: vk::CommandBuffer,
    (image, [width, height]): (vk::Image, [u32; 2]),
    texels: vk::Buffer,
) {
    use vk::{AccessFlags as Access, ImageLayout as Layout, PipelineStageFlags as Stage};
    let layers =
        vk::ImageSubresourceLayers { aspect_mask: vk::ImageAspectFlags::COLOR, layer_count: 1, ..Default::default() };
    let extent = vk::Extent3D { width, height, depth: 1 };
    let whole = vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent);
    let range = vk::ImageSubresourceRange {
        aspect_mask: vk::ImageAspectFlags::COLOR,
        level_count: 1,
        layer_count: 1,
        ..Default::default()
    };
    let barrier = vk::ImageMemoryBarrier::default()
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .image(image)
        .subresource_range(range);
    let filling = Layout::TRANSFER_DST_OPTIMAL;
    let before = barrier.dst_access_mask(Access::TRANSFER_WRITE).old_layout(Layout::UNDEFINED).new_layout(filling);
    let after = barrier
        .src_access_mask(Access::TRANSFER_WRITE)
        .dst_access_mask(Access::MEMORY_READ)
        .old_layout(filling)
        .new_layout(Layout::SHADER_READ_ONLY_OPTIMAL);
    let none = vk::DependencyFlags::empty();
    // No shader stage is named, so that every queue accepts the barrier.
    // SAFETY: the caller's obligations.
    unsafe {
        device.raw.cmd_pipeline_barrier(cmd, Stage::TOP_OF_PIPE, Stage::TRANSFER, none, &[], &[], &[before]);
        device.raw.cmd_copy_buffer_to_image(cmd, texels, image, filling, &[whole]);
        device.raw.cmd_pipeline_barrier(cmd, Stage::TRANSFER, Stage::ALL_COMMANDS, none, &[], &[], &[after]);
    }
}

/// Makes staging memory with these bytes.
pub fn staging(device: &Arc<Device>, bytes: &[u8]) -> Result<Buffer> {
    let (size, usage) = (bytes.len() as u64, vk::BufferUsageFlags::TRANSFER_SRC);
    let mut staging = Buffer::new(device, "deltamorph upload", size, usage, MemoryKind::Staging)?;
    staging.mapped()?[..bytes.len()].copy_from_slice(bytes);
    Ok(staging)
}

/// Binds an image that shaders load, in the layout SHADER_READ_ONLY_OPTIMAL, to a set that is not in use yet.
pub fn write_image(device: &Device, set: vk::DescriptorSet, binding: u32, view: vk::ImageView) {
    let layout = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;
    let info = [vk::DescriptorImageInfo::default().image_view(view).image_layout(layout)];
    let write = vk::WriteDescriptorSet::default().dst_set(set).dst_binding(binding);
    let write = write.descriptor_type(vk::DescriptorType::SAMPLED_IMAGE).image_info(&info);
    // SAFETY: the set is not in use yet; its owner keeps the view alive.
    unsafe { device.raw.update_descriptor_sets(&[write], &[]) };
}
