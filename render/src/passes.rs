//! The render passes, with their attachments and dependencies.

use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph::internals::gpu::device::Device;
use deltamorph_headless::render_pass;
use vk::{AccessFlags as Access, ImageLayout as Layout, PipelineStageFlags as Stage};

/// Edge of the shadow map, in texels.
pub const SHADOW_EDGE: u32 = 1024;
pub const SHADOW_FORMAT: vk::Format = vk::Format::D16_UNORM;
/// Format of pictures: shaders write linear colours, and images store sRGB.
pub const FORMAT: vk::Format = vk::Format::R8G8B8A8_SRGB;
pub const SAMPLES: vk::SampleCountFlags = vk::SampleCountFlags::TYPE_4;

const OUTSIDE: u32 = vk::SUBPASS_EXTERNAL;
const ONE: vk::SampleCountFlags = vk::SampleCountFlags::TYPE_1;
const KEEP: vk::AttachmentStoreOp = vk::AttachmentStoreOp::STORE;
const DROP: vk::AttachmentStoreOp = vk::AttachmentStoreOp::DONT_CARE;

/// Describes an attachment that is cleared by the pass.
fn attachment(
    format: vk::Format,
    samples: vk::SampleCountFlags,
    store: vk::AttachmentStoreOp,
    layout: Layout,
) -> vk::AttachmentDescription {
    let clear = vk::AttachmentDescription::default().format(format).load_op(vk::AttachmentLoadOp::CLEAR);
    clear.samples(samples).store_op(store).final_layout(layout)
}

fn reference(attachment: u32, layout: Layout) -> vk::AttachmentReference {
    vk::AttachmentReference { attachment, layout }
}

/// Makes the shadow pass: depth as seen from the key light, to be read by fragment shaders.
pub fn shadow(gpu: &Device) -> Result<vk::RenderPass> {
    let attachments = [attachment(SHADOW_FORMAT, ONE, KEEP, Layout::DEPTH_STENCIL_READ_ONLY_OPTIMAL)];
    let depth = reference(0, Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
    let subpass = vk::SubpassDescription::default().depth_stencil_attachment(&depth);
    let dependencies = [
        // Waits for earlier draws that read the map.
        vk::SubpassDependency::default()
            .src_subpass(OUTSIDE)
            .src_stage_mask(Stage::FRAGMENT_SHADER | Stage::LATE_FRAGMENT_TESTS)
            .src_access_mask(Access::DEPTH_STENCIL_ATTACHMENT_WRITE)
            .dst_stage_mask(Stage::EARLY_FRAGMENT_TESTS | Stage::LATE_FRAGMENT_TESTS)
            .dst_access_mask(Access::DEPTH_STENCIL_ATTACHMENT_READ | Access::DEPTH_STENCIL_ATTACHMENT_WRITE),
        vk::SubpassDependency::default()
            .dst_subpass(OUTSIDE)
            .src_stage_mask(Stage::LATE_FRAGMENT_TESTS)
            .src_access_mask(Access::DEPTH_STENCIL_ATTACHMENT_WRITE)
            .dst_stage_mask(Stage::FRAGMENT_SHADER)
            .dst_access_mask(Access::SHADER_READ),
    ];
    render_pass(gpu, &attachments, &subpass, &dependencies)
}

/// Makes the picture pass: multisampled colours and depth, resolved into an image that is left for copies.
pub fn picture(gpu: &Device, depth_format: vk::Format) -> Result<vk::RenderPass> {
    let attachments = [
        attachment(FORMAT, SAMPLES, DROP, Layout::COLOR_ATTACHMENT_OPTIMAL),
        attachment(depth_format, SAMPLES, DROP, Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL),
        attachment(FORMAT, ONE, KEEP, Layout::TRANSFER_SRC_OPTIMAL).load_op(vk::AttachmentLoadOp::DONT_CARE),
    ];
    let colour = [reference(0, Layout::COLOR_ATTACHMENT_OPTIMAL)];
    let resolve = [reference(2, Layout::COLOR_ATTACHMENT_OPTIMAL)];
    let depth = reference(1, Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
    let subpass = vk::SubpassDescription::default().color_attachments(&colour).resolve_attachments(&resolve);
    let subpass = subpass.depth_stencil_attachment(&depth);
    let drawing = Stage::COLOR_ATTACHMENT_OUTPUT | Stage::EARLY_FRAGMENT_TESTS | Stage::LATE_FRAGMENT_TESTS;
    let written = Access::COLOR_ATTACHMENT_WRITE | Access::DEPTH_STENCIL_ATTACHMENT_WRITE;
    let read = Access::COLOR_ATTACHMENT_READ | Access::DEPTH_STENCIL_ATTACHMENT_READ;
    let dependencies = [
        // Waits for earlier draws into the images, and copies from them.
        vk::SubpassDependency::default()
            .src_subpass(OUTSIDE)
            .src_stage_mask(drawing | Stage::TRANSFER)
            .src_access_mask(written)
            .dst_stage_mask(drawing)
            .dst_access_mask(written | read),
        // Later copies of the image, and draws over it, wait for the pass.
        vk::SubpassDependency::default()
            .dst_subpass(OUTSIDE)
            .src_stage_mask(drawing)
            .src_access_mask(written)
            .dst_stage_mask(Stage::TRANSFER | Stage::COLOR_ATTACHMENT_OUTPUT)
            .dst_access_mask(Access::TRANSFER_READ | Access::COLOR_ATTACHMENT_READ | Access::COLOR_ATTACHMENT_WRITE),
    ];
    render_pass(gpu, &attachments, &subpass, &dependencies)
}
