//! A blending pipeline for baselines that sum colours.

use crate::abi::modules::Module;
use crate::gpu::pipelines::{Objects, with_stage};
use deltamorph::Result;
use deltamorph::ash::vk;

/// Adds a pipeline that blends the output of a vertex and a fragment module into two colours, in triangle strips
/// without vertex attributes. Viewport and scissor are dynamic. The render pass exists already.
pub fn add_blending(objects: &mut Objects, [vertex, fragment]: [&Module; 2]) -> Result<()> {
    let input = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_STRIP);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let add = vk::PipelineColorBlendAttachmentState::default()
        .blend_enable(true)
        .src_color_blend_factor(vk::BlendFactor::ONE)
        .dst_color_blend_factor(vk::BlendFactor::ONE)
        .src_alpha_blend_factor(vk::BlendFactor::ONE)
        .dst_alpha_blend_factor(vk::BlendFactor::ONE)
        .color_write_mask(vk::ColorComponentFlags::RGBA);
    let attachments = [add; 2];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&attachments);
    let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
    let device = &objects.device;
    let made = with_stage(device, vertex, vk::ShaderStageFlags::VERTEX, |vertex| {
        with_stage(device, fragment, vk::ShaderStageFlags::FRAGMENT, |fragment| {
            let stages = [vertex, fragment];
            let info = vk::GraphicsPipelineCreateInfo::default()
                .stages(&stages)
                .vertex_input_state(&input)
                .input_assembly_state(&assembly)
                .viewport_state(&viewport)
                .rasterization_state(&raster)
                .multisample_state(&samples)
                .color_blend_state(&blend)
                .dynamic_state(&dynamic)
                .layout(objects.layout)
                .render_pass(objects.render_pass);
            // SAFETY: modules, layout and render pass are ours and alive; it has two colours, whose format can be
            // blended (checked by caps); the modules match the layout and each other (tests).
            unsafe { device.raw.create_graphics_pipelines(device.pipeline_cache, &[info], None) }
        })
    })??;
    objects.add_graphics(fragment, made)
}
