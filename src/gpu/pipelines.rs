//! Pipelines and the objects they are made from, each destroyed with its owner. Crowds share equal pipelines.

use super::caps::CAPTURE_STRIDE;
use super::descriptors::{BufferRange, Sets, descriptor_type};
use super::device::Device;
use crate::abi::kernels::{Binding, KernelRow, Stage};
use crate::abi::modules::Module;
use crate::error::{Error, Result};
use crate::pack::PoseFormat;
use ash::vk::{self, Handle};
use std::any::Any;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Objects of one update path; destroyed together. Dropped only when the device no longer uses them.
pub struct Objects {
    /// The device of the objects.
    pub device: Arc<Device>,
    bindings: Vec<Binding>,
    /// The kernel, or the first of several.
    kernel: &'static str,
    set_layout: vk::DescriptorSetLayout,
    /// Of all pipelines.
    pub layout: vk::PipelineLayout,
    /// The render pass of vertex passes and draws.
    pub render_pass: vk::RenderPass,
    /// The framebuffer of the empty render pass.
    pub framebuffer: vk::Framebuffer,
    /// In the order in which they were added.
    pub pipelines: Vec<vk::Pipeline>,
}

impl Objects {
    /// Starts with no objects; they are added one by one, and an error on the way drops those that were made.
    pub fn none(device: &Arc<Device>) -> Self {
        Self {
            device: device.clone(),
            bindings: vec![],
            kernel: "",
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            render_pass: vk::RenderPass::null(),
            framebuffer: vk::Framebuffer::null(),
            pipelines: vec![],
        }
    }

    /// Makes the set layout and pipeline layout that kernels declare; either all of them are compute shaders, or none.
    /// `attribute_push_bytes`: size of the push constants of kernels whose number of coefficients is the batch size.
    pub fn add_layout(&mut self, kernels: &[&KernelRow], attribute_push_bytes: u32) -> Result<()> {
        let stage = kernels.iter().fold(vk::ShaderStageFlags::empty(), |stages, kernel| {
            stages
                | match kernel.stage {
                    Stage::Vertex => vk::ShaderStageFlags::VERTEX,
                    Stage::Fragment => vk::ShaderStageFlags::FRAGMENT,
                    Stage::Compute | Stage::ComputeSized => vk::ShaderStageFlags::COMPUTE,
                }
        });
        self.kernel = kernels.first().map_or("", |kernel| kernel.name);
        self.bindings = kernels.iter().flat_map(|kernel| kernel.bindings).copied().collect();
        self.bindings.sort_unstable_by_key(|(binding, _)| *binding);
        self.bindings.dedup_by_key(|(binding, _)| *binding);
        let binding = |&(binding, buffer): &Binding| {
            let layout = vk::DescriptorSetLayoutBinding::default().binding(binding).descriptor_count(1);
            layout.descriptor_type(descriptor_type(buffer)).stage_flags(stage)
        };
        let declared: Vec<_> = self.bindings.iter().map(binding).collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&declared);
        // SAFETY: the device is alive; the bindings are distinct.
        self.set_layout = unsafe { self.device.raw.create_descriptor_set_layout(&info, None) }
            .map_err(Error::vulkan("vkCreateDescriptorSetLayout"))?;
        let push_bytes = kernels.iter().map(|kernel| kernel.push_bytes).fold(attribute_push_bytes, u32::max);
        let push = [vk::PushConstantRange::default().stage_flags(stage).size(push_bytes)];
        let sets = [self.set_layout];
        let push = &push[..usize::from(push_bytes > 0)];
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(push);
        // SAFETY: the set layout is ours and alive; the push range is within the device's limit (checked by caps).
        self.layout = unsafe { self.device.raw.create_pipeline_layout(&info, None) }
            .map_err(Error::vulkan("vkCreatePipelineLayout"))?;
        Ok(())
    }

    /// Makes a descriptor set for each list of buffers, which are in the order of the kernels' bindings.
    pub fn sets(&self, bound: &[impl AsRef<[BufferRange]>]) -> Result<Sets> {
        Sets::new(&self.device, (self.kernel, &self.bindings, self.set_layout), bound)
    }

    /// Makes a render pass without attachments and its framebuffer, which suffice for rasterizer discard in core Vulkan
    /// 1.0.
    pub fn add_empty_render_pass(&mut self) -> Result<()> {
        let subpasses = [vk::SubpassDescription::default().pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)];
        let info = vk::RenderPassCreateInfo::default().subpasses(&subpasses);
        // SAFETY: the device is alive; one subpass without attachments.
        self.render_pass =
            unsafe { self.device.raw.create_render_pass(&info, None) }.map_err(Error::vulkan("vkCreateRenderPass"))?;
        let info = vk::FramebufferCreateInfo::default().render_pass(self.render_pass).width(1).height(1).layers(1);
        // SAFETY: the render pass was created just now.
        self.framebuffer =
            unsafe { self.device.raw.create_framebuffer(&info, None) }.map_err(Error::vulkan("vkCreateFramebuffer"))?;
        Ok(())
    }

    /// Makes a compute pipeline of a module for each list of specialization constants 0, 1, …
    pub fn add_compute(&mut self, module: &Module, constants: &[&[u32]]) -> Result<()> {
        let most = constants.iter().map(|constants| constants.len()).max().unwrap_or(0) as u32;
        let entries: Vec<_> =
            (0..most).map(|id| vk::SpecializationMapEntry { constant_id: id, offset: 4 * id, size: 4 }).collect();
        let specialize = |constants: &&'_ [u32]| vk::SpecializationInfo {
            data_size: size_of_val(*constants),
            p_data: constants.as_ptr().cast(),
            ..vk::SpecializationInfo::default().map_entries(&entries[..constants.len()])
        };
        let specializations: Vec<_> = constants.iter().map(specialize).collect();
        let device = &self.device;
        let made = with_stage(device, module, vk::ShaderStageFlags::COMPUTE, |stage| {
            let info = |specialization| {
                let stage = stage.specialization_info(specialization);
                vk::ComputePipelineCreateInfo::default().stage(stage).layout(self.layout)
            };
            let infos: Vec<_> = specializations.iter().map(info).collect();
            // SAFETY: module and layout are ours and alive, and so is what `infos` points to; tests reflect the module
            // against the layout.
            unsafe { device.raw.create_compute_pipelines(device.pipeline_cache, &infos, None) }
        })?;
        // If one fails, others may have been made.
        let (made, error) = made.map_or_else(|(made, error)| (made, Some(error)), |made| (made, None));
        for (pipeline, constants) in made.iter().zip(constants).filter(|(pipeline, _)| !pipeline.is_null()) {
            self.device.name(*pipeline, || format!("deltamorph {} {constants:?}", module.name));
        }
        self.pipelines.extend(made);
        error.map_or(Ok(()), |error| Err(Error::vulkan("vkCreateComputePipelines")(error)))
    }

    /// Makes a pipeline of a vertex module with rasterizer discard. It draws lines, since points without gl_PointSize
    /// are not valid, and with it are slow on software devices.
    pub fn add_discarding_vertex(
        &mut self,
        module: &Module,
        bindings: &[vk::VertexInputBindingDescription],
        attributes: &[vk::VertexInputAttributeDescription],
    ) -> Result<()> {
        let input = vk::PipelineVertexInputStateCreateInfo::default()
            .vertex_binding_descriptions(bindings)
            .vertex_attribute_descriptions(attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::LINE_LIST);
        let raster =
            vk::PipelineRasterizationStateCreateInfo::default().rasterizer_discard_enable(true).line_width(1.0);
        let device = &self.device;
        let made = with_stage(device, module, vk::ShaderStageFlags::VERTEX, |stage| {
            let stages = [stage];
            let info = vk::GraphicsPipelineCreateInfo::default()
                .stages(&stages)
                .vertex_input_state(&input)
                .input_assembly_state(&assembly)
                .rasterization_state(&raster)
                .layout(self.layout)
                .render_pass(self.render_pass);
            // SAFETY: module, layout and render pass are ours and alive; with rasterizer discard no further state is
            // read; the attributes are within the device's limits (checked by caps) and match the module (tests).
            unsafe { device.raw.create_graphics_pipelines(device.pipeline_cache, &[info], None) }
        })?;
        self.add_graphics(module, made)
    }

    /// Takes the pipelines that were made of `module`, or returns the error.
    pub fn add_graphics(
        &mut self,
        module: &Module,
        made: std::result::Result<Vec<vk::Pipeline>, (Vec<vk::Pipeline>, vk::Result)>,
    ) -> Result<()> {
        let made = made.map_err(|(_, e)| Error::vulkan("vkCreateGraphicsPipelines")(e))?;
        made.iter().for_each(|pipeline| self.device.name(*pipeline, || format!("deltamorph {}", module.name)));
        self.pipelines.extend(made);
        Ok(())
    }

    /// Begins the empty render pass.
    ///
    /// # Safety
    /// `cmd` is in the recording state on this device, outside a render pass.
    pub unsafe fn begin_render_pass(&self, cmd: vk::CommandBuffer) {
        let info = vk::RenderPassBeginInfo::default()
            .render_pass(self.render_pass)
            .framebuffer(self.framebuffer)
            .render_area(vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width: 1, height: 1 } });
        // SAFETY: the caller's obligation; both objects are ours and alive.
        unsafe { self.device.raw.cmd_begin_render_pass(cmd, &info, vk::SubpassContents::INLINE) };
    }

    /// Draws the bound vertices; with `capture`, transform feedback captures them into the buffer at this offset.
    ///
    /// # Safety
    /// - `cmd` is in the empty render pass, with everything bound that its pipeline reads.
    /// - The captured vertices fit in the buffer; the offset is a multiple of 4.
    pub unsafe fn draw(&self, cmd: vk::CommandBuffer, vertices: usize, capture: Option<(vk::Buffer, u64)>) {
        let device = &self.device.raw;
        let (Some((buffer, offset)), Some(feedback)) = (capture, &self.device.feedback) else {
            // SAFETY: the caller's obligations.
            return unsafe { device.cmd_draw(cmd, vertices as u32, 1, 0, 0) };
        };
        let feedback = feedback.fp();
        let size = (vertices * CAPTURE_STRIDE) as u64;
        // SAFETY: the caller's obligations; transform feedback is enabled since `device.feedback` is there. ash 0.38
        // has no wrappers for these commands.
        unsafe {
            (feedback.cmd_bind_transform_feedback_buffers_ext)(cmd, 0, 1, &buffer, &offset, &size);
            (feedback.cmd_begin_transform_feedback_ext)(cmd, 0, 0, std::ptr::null(), std::ptr::null());
            device.cmd_draw(cmd, vertices as u32, 1, 0, 0);
            (feedback.cmd_end_transform_feedback_ext)(cmd, 0, 0, std::ptr::null(), std::ptr::null());
        }
    }

    /// Dispatches a compute pipeline.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - `set` was made for this layout and lives until the dispatch has run; when it runs, the buffers hold the data
    ///   that `push` describes; there is a dynamic offset for each binding that takes one, and `push` fits the layout's
    ///   range.
    /// - There are no more workgroups than the device allows; indirect arguments lie within their buffer.
    pub unsafe fn dispatch(
        &self,
        cmd: vk::CommandBuffer,
        pipeline: usize,
        (set, dynamic_offsets): (vk::DescriptorSet, &[u32]),
        push: &[u8],
        workgroups: Workgroups,
    ) {
        let device = &self.device.raw;
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: the caller's obligations; pipelines and layout are ours.
        unsafe {
            device.cmd_bind_pipeline(cmd, point, self.pipelines[pipeline]);
            device.cmd_bind_descriptor_sets(cmd, point, self.layout, 0, &[set], dynamic_offsets);
            device.cmd_push_constants(cmd, self.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
            match workgroups {
                Workgroups::Of([x, y]) => device.cmd_dispatch(cmd, x, y, 1),
                Workgroups::At(arguments, offset) => device.cmd_dispatch_indirect(cmd, arguments, offset),
            }
        }
    }
}

/// Workgroups of a dispatch.
#[derive(Clone, Copy)]
pub enum Workgroups {
    /// This number, in two dimensions.
    Of([u32; 2]),
    /// The number in the indirect arguments at this offset when the dispatch runs.
    At(vk::Buffer, u64),
}

impl Drop for Objects {
    fn drop(&mut self) {
        let device = &self.device.raw;
        // SAFETY: all were created on this device, are destroyed once, and are no longer used (see the type);
        // destroying a null handle does nothing.
        unsafe {
            self.pipelines.iter().for_each(|&pipeline| device.destroy_pipeline(pipeline, None));
            device.destroy_framebuffer(self.framebuffer, None);
            device.destroy_render_pass(self.render_pass, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// Bindings and attributes of a vertex shader.
pub type VertexInput = (Vec<vk::VertexInputBindingDescription>, Vec<vk::VertexInputAttributeDescription>);

impl PoseFormat {
    /// Describes how a draw reads a pose as vertex attributes: the inputs that `glsl/host/pose.glsl` declares.
    ///
    /// The pose ([`PoseView`](crate::PoseView)) is binding 0, at locations 0 and 1. Vulkan guarantees these formats for
    /// vertex buffers. A host with its own attributes may renumber binding and locations.
    /// [`PoseView::matrix`](crate::PoseView::matrix) makes positions of what a draw fetches.
    pub fn vertex_input(self) -> VertexInput {
        self.vertex_input_of(0..1)
    }

    /// Like [`vertex_input`](Self::vertex_input), with the previous pose as binding 1, at locations 2 and 3, for motion
    /// vectors.
    pub fn vertex_input_with_previous(self) -> VertexInput {
        self.vertex_input_of(0..2)
    }

    fn vertex_input_of(self, bindings: Range<u32>) -> VertexInput {
        let stride = self.stride() as u32;
        let of = |binding: u32| {
            (2 * binding..).zip(self.row().attributes).map(move |(location, &(format, offset))| {
                let format = vk::Format::from_raw(format as i32);
                vk::VertexInputAttributeDescription { location, binding, format, offset }
            })
        };
        let binding = |binding| vk::VertexInputBindingDescription::default().binding(binding).stride(stride);
        (bindings.clone().map(binding).collect(), bindings.flat_map(of).collect())
    }
}

/// Calls `make` with a stage that runs `module`; the module is destroyed once its pipelines are made.
pub fn with_stage<R>(
    device: &Device,
    module: &Module,
    stage: vk::ShaderStageFlags,
    make: impl FnOnce(vk::PipelineShaderStageCreateInfo<'_>) -> R,
) -> Result<R> {
    let words = module.words();
    let info = vk::ShaderModuleCreateInfo::default().code(&words);
    // SAFETY: the words are SPIR-V made by glslang for Vulkan 1.1.
    let raw = unsafe { device.raw.create_shader_module(&info, None) }.map_err(Error::vulkan("vkCreateShaderModule"))?;
    let made = make(vk::PipelineShaderStageCreateInfo::default().stage(stage).module(raw).name(c"main"));
    // SAFETY: created above; its pipelines are made.
    unsafe { device.raw.destroy_shader_module(raw, None) };
    Ok(made)
}

/// A key of pipelines: what they are made for.
pub trait PipelineKey: Any + Copy + PartialEq + Send + Sync {
    /// Makes the pipelines and the objects that they need.
    fn make(self, objects: &mut Objects) -> Result<()>;
}

/// Pipelines and the objects that they need.
pub struct Pipelines<K> {
    /// The pipelines.
    pub objects: Objects,
    /// The key they were made for.
    pub key: K,
}

/// The pipelines made so far.
pub struct Kernels {
    device: Arc<Device>,
    made: Mutex<Vec<Arc<dyn Any + Send + Sync>>>,
}

impl Kernels {
    /// None yet.
    pub fn new(device: &Arc<Device>) -> Self {
        Self { device: device.clone(), made: Mutex::default() }
    }

    /// Returns the pipelines of `key`: existing ones, or new ones.
    pub fn get<K: PipelineKey>(&self, key: K) -> Result<Arc<Pipelines<K>>> {
        let locked = || self.made.lock().unwrap_or_else(PoisonError::into_inner);
        let find = |made: &[Arc<dyn Any + Send + Sync>]| {
            let mut of_kind = made.iter().filter_map(|pipelines| pipelines.clone().downcast::<Pipelines<K>>().ok());
            of_kind.find(|pipelines| pipelines.key == key)
        };
        let found = find(&locked());
        if let Some(pipelines) = found {
            return Ok(pipelines);
        }
        // Not locked while the driver compiles, so that other threads can make crowds from existing pipelines.
        let mut objects = Objects::none(&self.device);
        key.make(&mut objects)?;
        let pipelines = Arc::new(Pipelines { objects, key });
        let mut made = locked();
        // Another thread may have made them in the meantime.
        Ok(find(&made).unwrap_or_else(|| {
            made.push(pipelines.clone());
            pipelines
        }))
    }
}
