//! Pipelines and what they are made from, each destroyed with its owner.

use super::device::Device;
use super::failed;
use super::shaders;
use crate::error::Result;
use ash::vk;
use std::sync::Arc;

/// Objects of one update path; destroyed together. Dropped only when the device no longer uses them.
pub(crate) struct Objects {
    pub(crate) device: Arc<Device>,
    pub(crate) set_layout: vk::DescriptorSetLayout,
    pub(crate) layout: vk::PipelineLayout,
    pub(crate) render_pass: vk::RenderPass,
    pub(crate) framebuffer: vk::Framebuffer,
    pub(crate) pipelines: Vec<vk::Pipeline>,
}

impl Objects {
    /// No objects yet: fill in one by one; an error on the way drops what is there.
    pub(crate) fn none(device: &Arc<Device>) -> Self {
        Self {
            device: device.clone(),
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            render_pass: vk::RenderPass::null(),
            framebuffer: vk::Framebuffer::null(),
            pipelines: vec![],
        }
    }

    /// A set layout of buffers of these types, for compute.
    pub(crate) fn add_storage_set_layout(&mut self, types: &[vk::DescriptorType]) -> Result<()> {
        self.add_set_layout(types, vk::ShaderStageFlags::COMPUTE)
    }

    /// A set layout of buffers of these types: storage buffers, or texels.
    pub(crate) fn add_set_layout(&mut self, types: &[vk::DescriptorType], stage: vk::ShaderStageFlags) -> Result<()> {
        let bindings: Vec<_> = types
            .iter()
            .enumerate()
            .map(|(binding, ty)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding as u32)
                    .descriptor_type(*ty)
                    .descriptor_count(1)
                    .stage_flags(stage)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive; the bindings are distinct.
        self.set_layout = unsafe { self.device.raw.create_descriptor_set_layout(&info, None) }
            .map_err(failed("vkCreateDescriptorSetLayout"))?;
        Ok(())
    }

    /// A pipeline layout of the set layout (where there is one) and push constants.
    pub(crate) fn add_layout(&mut self, stage: vk::ShaderStageFlags, push_bytes: u32) -> Result<()> {
        let push = [vk::PushConstantRange::default().stage_flags(stage).size(push_bytes)];
        let sets = [self.set_layout];
        let mut info = vk::PipelineLayoutCreateInfo::default();
        if push_bytes > 0 {
            info = info.push_constant_ranges(&push);
        }
        if self.set_layout != vk::DescriptorSetLayout::null() {
            info = info.set_layouts(&sets);
        }
        // SAFETY: the set layout is ours and alive; the push range is within the device's limit (checked by caps).
        self.layout =
            unsafe { self.device.raw.create_pipeline_layout(&info, None) }.map_err(failed("vkCreatePipelineLayout"))?;
        Ok(())
    }

    /// A render pass without attachments and its framebuffer: rasterizer discard needs no more, and core
    /// Vulkan 1.0 has it.
    pub(crate) fn add_empty_render_pass(&mut self) -> Result<()> {
        let subpasses = [vk::SubpassDescription::default().pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)];
        let info = vk::RenderPassCreateInfo::default().subpasses(&subpasses);
        // SAFETY: the device is alive; one subpass without attachments.
        self.render_pass =
            unsafe { self.device.raw.create_render_pass(&info, None) }.map_err(failed("vkCreateRenderPass"))?;
        let info = vk::FramebufferCreateInfo::default().render_pass(self.render_pass).width(1).height(1).layers(1);
        // SAFETY: the render pass was created just now.
        self.framebuffer =
            unsafe { self.device.raw.create_framebuffer(&info, None) }.map_err(failed("vkCreateFramebuffer"))?;
        Ok(())
    }

    /// A compute pipeline of module `name`; `constants` are specialization constants 0, 1, …
    pub(crate) fn add_compute(&mut self, name: &str, constants: &[u32]) -> Result<()> {
        let module = Module::new(&self.device, name)?;
        let entries: Vec<_> = (0..constants.len() as u32)
            .map(|id| vk::SpecializationMapEntry { constant_id: id, offset: 4 * id, size: 4 })
            .collect();
        let specialization =
            vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(constants));
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module.raw)
            .name(c"main")
            .specialization_info(&specialization);
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(self.layout);
        // SAFETY: module and layout are ours and alive; tests reflect the module against the layout.
        let made = unsafe { self.device.raw.create_compute_pipelines(vk::PipelineCache::null(), &[info], None) };
        self.pipelines.extend(made.map_err(|(_, e)| failed("vkCreateComputePipelines")(e))?);
        Ok(())
    }

    /// A pipeline of vertex module `name` with rasterizer discard, drawing lines.
    ///
    /// Lines, since points without gl_PointSize are not valid and with it are slow on software devices.
    pub(crate) fn add_discarding_vertex(
        &mut self,
        name: &str,
        bindings: &[vk::VertexInputBindingDescription],
        attributes: &[vk::VertexInputAttributeDescription],
    ) -> Result<()> {
        let module = Module::new(&self.device, name)?;
        let stages = [vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::VERTEX)
            .module(module.raw)
            .name(c"main")];
        let input = vk::PipelineVertexInputStateCreateInfo::default()
            .vertex_binding_descriptions(bindings)
            .vertex_attribute_descriptions(attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::LINE_LIST);
        let raster =
            vk::PipelineRasterizationStateCreateInfo::default().rasterizer_discard_enable(true).line_width(1.0);
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input)
            .input_assembly_state(&assembly)
            .rasterization_state(&raster)
            .layout(self.layout)
            .render_pass(self.render_pass);
        // SAFETY: module, layout and render pass are ours and alive; with rasterizer discard no further state
        // is read; the attributes are within the device's limits (checked by caps) and match the module (tests).
        let made = unsafe { self.device.raw.create_graphics_pipelines(vk::PipelineCache::null(), &[info], None) };
        self.pipelines.extend(made.map_err(|(_, e)| failed("vkCreateGraphicsPipelines")(e))?);
        Ok(())
    }

    /// Begin the empty render pass.
    ///
    /// # Safety
    /// `cmd` is in the recording state on this device, outside a render pass.
    pub(crate) unsafe fn begin_render_pass(&self, cmd: vk::CommandBuffer) {
        let info = vk::RenderPassBeginInfo::default()
            .render_pass(self.render_pass)
            .framebuffer(self.framebuffer)
            .render_area(vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width: 1, height: 1 } });
        // SAFETY: the caller's obligation; both objects are ours and alive.
        unsafe { self.device.raw.cmd_begin_render_pass(cmd, &info, vk::SubpassContents::INLINE) };
    }
}

impl Drop for Objects {
    fn drop(&mut self) {
        let device = &self.device.raw;
        // SAFETY: all were created on this device, are destroyed once, and are no longer used (see the type);
        // destroying a null handle does nothing.
        unsafe {
            self.pipelines.iter().for_each(|&p| device.destroy_pipeline(p, None));
            device.destroy_framebuffer(self.framebuffer, None);
            device.destroy_render_pass(self.render_pass, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// A shader module for the time it takes to make a pipeline of it.
struct Module<'a> {
    device: &'a Device,
    raw: vk::ShaderModule,
}

impl<'a> Module<'a> {
    fn new(device: &'a Device, name: &str) -> Result<Self> {
        let words = shaders::words(name);
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words are SPIR-V made by glslang for Vulkan 1.1.
        let raw = unsafe { device.raw.create_shader_module(&info, None) }.map_err(failed("vkCreateShaderModule"))?;
        Ok(Self { device, raw })
    }
}

impl Drop for Module<'_> {
    fn drop(&mut self) {
        // SAFETY: created in `new`; a module may go once its pipelines are made.
        unsafe { self.device.raw.destroy_shader_module(self.raw, None) };
    }
}
