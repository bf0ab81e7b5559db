//! Passes, layouts and pipelines.

use crate::modules;
use crate::passes::{self, SAMPLES};
use crate::scene::PartPush;
use deltamorph::ash::vk;
use deltamorph::internals::gpu::device::Device;
use deltamorph::{Error, PoseFormat, Result};
use deltamorph_headless::Headless;
use std::slice::from_ref;
use std::sync::Arc;

/// First location of pose inputs, after the inputs of glsl/face.vert.
const POSE_LOCATION: u32 = 2;
/// Location of the wrinkle masks, after all others.
const MASK_LOCATION: u32 = 6;
/// The binding of the wrinkle masks.
pub const MASK_BINDING: u32 = 3;

/// The kind of geometry that a pipeline draws.
#[derive(Clone, Copy)]
enum Drawn {
    /// Both sides of faces.
    All,
    /// Faces that are not culled.
    Faces {
        cull: vk::CullModeFlags,
        plain: bool,
    },
    Lines,
}

/// Bindings and attributes.
type Input = (Vec<vk::VertexInputBindingDescription>, Vec<vk::VertexInputAttributeDescription>);

/// Draws poses of one format.
pub struct Renderer {
    pub gpu: Arc<Device>,
    pub limits: vk::PhysicalDeviceLimits,
    /// Format of the poses that are drawn.
    pub pose: PoseFormat,
    /// Whether it draws [`Show::Wrinkles`](crate::Show::Wrinkles), which needs additional pipelines.
    masks: bool,
    pub depth_format: vk::Format,
    pub shadow_pass: vk::RenderPass,
    pub pass: vk::RenderPass,
    pub set_layout: vk::DescriptorSetLayout,
    pub sampler: vk::Sampler,
    pub layout: vk::PipelineLayout,
    pub shadow: vk::Pipeline,
    /// For front faces, and for back faces. Both are visible, since meshes have openings; but most back faces are
    /// hidden, and are not shaded because they are drawn last.
    pub shaded: [vk::Pipeline; 2],
    /// Like `shaded`, for everything but eyeballs, unless drawn in another way.
    pub plain: [vk::Pipeline; 2],
    /// Like `shaded`, with the previous pose.
    pub motion: [vk::Pipeline; 2],
    /// Like `shaded`, with wrinkle masks; null if the renderer was made without them.
    pub wrinkled: [vk::Pipeline; 2],
    /// Like `shaded`, for lines.
    pub lines: vk::Pipeline,
}

impl Renderer {
    /// Makes passes and pipelines.
    ///
    /// # Errors
    /// The device fails or lacks memory.
    ///
    /// # Safety
    /// - The device outlives the renderer and all [models](crate::Model) and [targets](crate::Target) made with it.
    /// - The device has Vulkan 1.1.
    /// - A renderer, model or target is dropped only when no commands recorded with it are still to run.
    pub unsafe fn new(headless: &Headless, pose: PoseFormat, masks: bool) -> Result<Self> {
        let (instance, physical, _) = headless.handles();
        // SAFETY: the physical device is the instance's.
        let limits = unsafe { instance.get_physical_device_properties(physical) }.limits;
        // Vulkan guarantees one of the two; 32 bits are better.
        let usable = |format: &vk::Format| {
            // SAFETY: the physical device is the instance's.
            let properties = unsafe { instance.get_physical_device_format_properties(physical, *format) };
            properties.optimal_tiling_features.contains(vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT)
        };
        let depths = [vk::Format::D32_SFLOAT, vk::Format::X8_D24_UNORM_PACK32];
        let depth_format = depths.into_iter().find(usable).unwrap_or(vk::Format::D16_UNORM);
        let mut this = Self {
            gpu: headless.engine().device().clone(),
            limits,
            pose,
            masks,
            depth_format,
            shadow_pass: vk::RenderPass::null(),
            pass: vk::RenderPass::null(),
            set_layout: vk::DescriptorSetLayout::null(),
            sampler: vk::Sampler::null(),
            layout: vk::PipelineLayout::null(),
            shadow: vk::Pipeline::null(),
            shaded: [vk::Pipeline::null(); 2],
            plain: [vk::Pipeline::null(); 2],
            motion: [vk::Pipeline::null(); 2],
            wrinkled: [vk::Pipeline::null(); 2],
            lines: vk::Pipeline::null(),
        };
        this.shadow_pass = passes::shadow(&this.gpu)?;
        this.pass = passes::picture(&this.gpu, depth_format)?;
        this.make_layouts()?;
        this.make_pipelines()?;
        Ok(this)
    }

    fn make_layouts(&mut self) -> Result<()> {
        let device = &self.gpu.raw;
        let both = vk::ShaderStageFlags::VERTEX | vk::ShaderStageFlags::FRAGMENT;
        let binding = |binding, kind, stages| {
            let one = vk::DescriptorSetLayoutBinding::default().binding(binding).descriptor_count(1);
            one.descriptor_type(kind).stage_flags(stages)
        };
        let bindings = [
            binding(0, vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC, both),
            binding(1, vk::DescriptorType::COMBINED_IMAGE_SAMPLER, vk::ShaderStageFlags::FRAGMENT),
            binding(2, vk::DescriptorType::STORAGE_BUFFER, vk::ShaderStageFlags::VERTEX),
        ];
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // Outside the map there are no shadows.
        let edge = vk::SamplerAddressMode::CLAMP_TO_BORDER;
        let sampler = vk::SamplerCreateInfo::default().address_mode_u(edge).address_mode_v(edge).address_mode_w(edge);
        let sampler = sampler.border_color(vk::BorderColor::FLOAT_OPAQUE_WHITE);
        let sampler = sampler.compare_enable(true).compare_op(vk::CompareOp::LESS_OR_EQUAL);
        // SAFETY: as in `passes`.
        unsafe {
            let set_layout = device.create_descriptor_set_layout(&info, None);
            self.set_layout = set_layout.map_err(Error::vulkan("vkCreateDescriptorSetLayout"))?;
            self.sampler = device.create_sampler(&sampler, None).map_err(Error::vulkan("vkCreateSampler"))?;
            let push = vk::PushConstantRange { stage_flags: both, offset: 0, size: size_of::<PartPush>() as u32 };
            let info = vk::PipelineLayoutCreateInfo::default().set_layouts(from_ref(&self.set_layout));
            let layout = device.create_pipeline_layout(&info.push_constant_ranges(from_ref(&push)), None);
            self.layout = layout.map_err(Error::vulkan("vkCreatePipelineLayout"))?;
        }
        Ok(())
    }

    fn make_pipelines(&mut self) -> Result<()> {
        let modules = modules::of(self.pose)?;
        let (bindings, mut attributes) = self.pose.vertex_input();
        attributes.iter_mut().for_each(|attribute| attribute.location += POSE_LOCATION);
        // The map only needs positions, but the shader declares all inputs of the poses.
        self.shadow = self.pipeline(self.shadow_pass, &[modules.shadow], (bindings, attributes), Drawn::All)?;
        self.lines = self.pictured(modules.face, self.input(false), Drawn::Lines)?;
        for (side, cull) in [vk::CullModeFlags::BACK, vk::CullModeFlags::FRONT].into_iter().enumerate() {
            let faces = Drawn::Faces { cull, plain: false };
            let plain = Drawn::Faces { cull, plain: true };
            self.shaded[side] = self.pictured(modules.face, self.input(false), faces)?;
            self.plain[side] = self.pictured(modules.face, self.input(false), plain)?;
            self.motion[side] = self.pictured(modules.motion, self.input(true), faces)?;
            if self.masks {
                self.wrinkled[side] = self.pictured(modules.masks, self.masked_input(), faces)?;
            }
        }
        Ok(())
    }

    /// Makes a pipeline of the picture pass.
    fn pictured(&self, module: &'static [u8], input: Input, drawn: Drawn) -> Result<vk::Pipeline> {
        self.pipeline(self.pass, &[module, modules::FRAGMENT], input, drawn)
    }

    /// Returns the inputs of face.vert: binding 0 has the pose, 1 the vertices at rest in float32, 2 the previous pose,
    /// if any.
    fn input(&self, previous: bool) -> Input {
        let (mut bindings, mut attributes) =
            if previous { self.pose.vertex_input_with_previous() } else { self.pose.vertex_input() };
        let own = |attribute: &mut vk::VertexInputAttributeDescription| {
            attribute.location += POSE_LOCATION;
            attribute.binding *= 2;
        };
        attributes.iter_mut().for_each(own);
        let per_vertex = |binding, stride| vk::VertexInputBindingDescription::default().binding(binding).stride(stride);
        bindings.truncate(1);
        bindings.push(per_vertex(1, 24));
        bindings.extend(previous.then(|| per_vertex(2, bindings[0].stride)));
        let attribute = |location, binding, format, offset| vk::VertexInputAttributeDescription {
            location,
            binding,
            format,
            offset,
        };
        attributes.extend([
            attribute(0, 1, vk::Format::R32G32B32_SFLOAT, 0),
            attribute(1, 1, vk::Format::R32G32B32_SFLOAT, 12),
        ]);
        (bindings, attributes)
    }

    /// Returns the inputs with the wrinkle masks added: two numbers in the format of poses, with the stride of pose
    /// vertices.
    fn masked_input(&self) -> Input {
        let (mut bindings, mut attributes) = self.input(false);
        let format = match self.pose.stride() {
            _ if !self.pose.has_integers() => vk::Format::R32G32_SFLOAT,
            12 => vk::Format::R16G16_SINT,
            _ => vk::Format::R32G32_SINT,
        };
        let binding = MASK_BINDING;
        let location = MASK_LOCATION;
        let stride = bindings[0].stride;
        bindings.push(vk::VertexInputBindingDescription::default().binding(binding).stride(stride));
        attributes.push(vk::VertexInputAttributeDescription { location, binding, format, offset: 0 });
        (bindings, attributes)
    }

    /// Makes a pipeline of a vertex module and, if colours are drawn, a fragment module.
    fn pipeline(
        &self,
        pass: vk::RenderPass,
        code: &[&[u8]],
        (bindings, attributes): Input,
        drawn: Drawn,
    ) -> Result<vk::Pipeline> {
        let device = &self.gpu.raw;
        let colours = code.len() > 1;
        let mut made = vec![];
        for bytes in code {
            let words: Vec<u32> = bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
            // SAFETY: the words are a module that glslang made; destroyed below.
            let module =
                unsafe { device.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(&words), None) };
            match module {
                Ok(module) => made.push(module),
                Err(error) => {
                    self.destroy_modules(made);
                    return Err(Error::vulkan("vkCreateShaderModule")(error));
                }
            }
        }
        let (topology, cull, plain) = match drawn {
            Drawn::All => (vk::PrimitiveTopology::TRIANGLE_LIST, vk::CullModeFlags::NONE, false),
            Drawn::Faces { cull, plain } => (vk::PrimitiveTopology::TRIANGLE_LIST, cull, plain),
            Drawn::Lines => (vk::PrimitiveTopology::LINE_LIST, vk::CullModeFlags::NONE, false),
        };
        let constant = [vk::SpecializationMapEntry { constant_id: 0, offset: 0, size: 4 }];
        let value = u32::from(!plain).to_ne_bytes();
        let special = vk::SpecializationInfo::default().map_entries(&constant).data(&value);
        let kinds = [vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT];
        let stage = |(module, kind)| {
            let stage = vk::PipelineShaderStageCreateInfo::default().module(module).stage(kind).name(c"main");
            if kind == vk::ShaderStageFlags::FRAGMENT { stage.specialization_info(&special) } else { stage }
        };
        let stages: Vec<_> = made.iter().copied().zip(kinds).map(stage).collect();
        let input = vk::PipelineVertexInputStateCreateInfo::default().vertex_binding_descriptions(&bindings);
        let input = input.vertex_attribute_descriptions(&attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(topology);
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
        let raster = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0).cull_mode(cull);
        let samples = if colours { SAMPLES } else { vk::SampleCountFlags::TYPE_1 };
        let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(samples);
        let depth = vk::PipelineDepthStencilStateCreateInfo::default().depth_test_enable(true);
        let depth = depth.depth_write_enable(true).depth_compare_op(vk::CompareOp::LESS_OR_EQUAL);
        let written =
            [vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA)];
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&written);
        let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
        let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&raster)
            .multisample_state(&samples)
            .depth_stencil_state(&depth)
            .dynamic_state(&dynamic)
            .layout(self.layout)
            .render_pass(pass);
        let info = if colours { info.color_blend_state(&blend) } else { info };
        // SAFETY: everything that `info` points to is alive, and made for this device.
        let pipelines = unsafe { device.create_graphics_pipelines(vk::PipelineCache::null(), from_ref(&info), None) };
        self.destroy_modules(made);
        pipelines.map(|made| made[0]).map_err(|(_, error)| Error::vulkan("vkCreateGraphicsPipelines")(error))
    }

    fn destroy_modules(&self, modules: Vec<vk::ShaderModule>) {
        // SAFETY: made by `pipeline`, each destroyed once; pipelines do not need their modules once they are made.
        modules.into_iter().for_each(|module| unsafe { self.gpu.raw.destroy_shader_module(module, None) });
    }
}

impl Drop for Renderer {
    fn drop(&mut self) {
        let device = &self.gpu.raw;
        // SAFETY: ours, destroyed once, and not in use, as the caller of `new` guarantees.
        unsafe {
            let faces = [self.shaded, self.plain, self.motion, self.wrinkled].into_iter().flatten();
            let pipelines = [self.shadow, self.lines].into_iter().chain(faces);
            pipelines.for_each(|pipeline| device.destroy_pipeline(pipeline, None));
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_sampler(self.sampler, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
            device.destroy_render_pass(self.shadow_pass, None);
            device.destroy_render_pass(self.pass, None);
        }
    }
}
