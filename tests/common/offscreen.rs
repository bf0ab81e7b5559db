//! The parts that any host with draws has: an image to draw into, pipelines, and buffers shared with the device.

use deltamorph::ash::{self, vk};
use deltamorph_headless::Headless;
use glslang::{Compiler, CompilerOptions, ShaderInput, ShaderSource, ShaderStage};
use std::cell::RefCell;

pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;
/// Bindings and attributes.
pub type VertexInput = (Vec<vk::VertexInputBindingDescription>, Vec<vk::VertexInputAttributeDescription>);

const DEPTH: vk::Format = vk::Format::D16_UNORM;

/// A buffer in memory that host and device share.
#[derive(Clone, Copy)]
pub struct Shared {
    pub buffer: vk::Buffer,
    bytes: usize,
    mapped: *mut u8,
}

/// An image with depth, and the objects to draw into it, destroyed together.
pub struct Offscreen<'a> {
    headless: &'a Headless,
    pub device: &'a ash::Device,
    extent: vk::Extent2D,
    pass: vk::RenderPass,
    framebuffer: vk::Framebuffer,
    images: RefCell<Vec<(vk::Image, vk::ImageView)>>,
    buffers: RefCell<Vec<vk::Buffer>>,
    memory: RefCell<Vec<vk::DeviceMemory>>,
    pipelines: RefCell<Vec<(vk::Pipeline, vk::PipelineLayout)>>,
}

impl<'a> Offscreen<'a> {
    /// Makes an image of `edge` × `edge` pixels in a colour format.
    pub fn new(headless: &'a Headless, edge: u32, format: vk::Format) -> Result<Self> {
        use vk::{AccessFlags as Access, ImageLayout as Layout, ImageUsageFlags as Usage, PipelineStageFlags as Stage};
        let device = headless.handles().2;
        let mut this = Self {
            extent: vk::Extent2D { width: edge, height: edge },
            pass: vk::RenderPass::null(),
            framebuffer: vk::Framebuffer::null(),
            images: RefCell::default(),
            buffers: RefCell::default(),
            memory: RefCell::default(),
            pipelines: RefCell::default(),
            headless,
            device,
        };
        let attachment = |format, layout| {
            let clear = vk::AttachmentDescription::default().format(format).load_op(vk::AttachmentLoadOp::CLEAR);
            clear.samples(vk::SampleCountFlags::TYPE_1).final_layout(layout)
        };
        let attachments = [
            attachment(format, Layout::TRANSFER_SRC_OPTIMAL),
            attachment(DEPTH, Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL),
        ];
        let reference = |attachment, layout| vk::AttachmentReference { attachment, layout };
        let colours = [reference(0, Layout::COLOR_ATTACHMENT_OPTIMAL)];
        let depth = reference(1, Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
        let subpass = [vk::SubpassDescription::default().color_attachments(&colours).depth_stencil_attachment(&depth)];
        let drawing = Stage::COLOR_ATTACHMENT_OUTPUT | Stage::EARLY_FRAGMENT_TESTS | Stage::LATE_FRAGMENT_TESTS;
        let written = Access::COLOR_ATTACHMENT_WRITE | Access::DEPTH_STENCIL_ATTACHMENT_WRITE;
        let read = Access::COLOR_ATTACHMENT_READ | Access::DEPTH_STENCIL_ATTACHMENT_READ;
        let dependency = |before, after| {
            vk::SubpassDependency::default().src_stage_mask(before).dst_stage_mask(after).src_access_mask(written)
        };
        // After earlier draws and copies; and before the copy.
        let (outside, copy) = (vk::SUBPASS_EXTERNAL, Stage::TRANSFER);
        let dependencies = [
            dependency(drawing | copy, drawing).src_subpass(outside).dst_access_mask(written | read),
            dependency(drawing, copy).dst_subpass(outside).dst_access_mask(Access::TRANSFER_READ),
        ];
        let pass = vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpass);
        // SAFETY: all objects are made on one device, which is alive, and are destroyed by `drop`.
        this.pass = unsafe { device.create_render_pass(&pass.dependencies(&dependencies), None) }?;
        let views = [
            this.image(format, Usage::COLOR_ATTACHMENT | Usage::TRANSFER_SRC, vk::ImageAspectFlags::COLOR)?,
            this.image(DEPTH, Usage::DEPTH_STENCIL_ATTACHMENT, vk::ImageAspectFlags::DEPTH)?,
        ];
        let framebuffer = vk::FramebufferCreateInfo::default().render_pass(this.pass).attachments(&views);
        // SAFETY: as above.
        this.framebuffer = unsafe { device.create_framebuffer(&framebuffer.width(edge).height(edge).layers(1), None) }?;
        Ok(this)
    }

    fn image(
        &self,
        format: vk::Format,
        usage: vk::ImageUsageFlags,
        aspect: vk::ImageAspectFlags,
    ) -> Result<vk::ImageView> {
        let info = vk::ImageCreateInfo::default().image_type(vk::ImageType::TYPE_2D).format(format);
        let info = info.extent(self.extent.into()).mip_levels(1).array_layers(1).usage(usage);
        let info = info.samples(vk::SampleCountFlags::TYPE_1);
        let range = vk::ImageSubresourceRange::default().aspect_mask(aspect).level_count(1).layer_count(1);
        let view = vk::ImageViewCreateInfo::default().view_type(vk::ImageViewType::TYPE_2D).format(format);
        // SAFETY: as in `new`; the memory is of a type and size that the image asks for.
        unsafe {
            let image = self.device.create_image(&info, None)?;
            let memory = self.allocate(self.device.get_image_memory_requirements(image), Default::default())?;
            self.device.bind_image_memory(image, memory, 0)?;
            let view = self.device.create_image_view(&view.image(image).subresource_range(range), None)?;
            self.images.borrow_mut().push((image, view));
            Ok(view)
        }
    }

    fn allocate(&self, needs: vk::MemoryRequirements, flags: vk::MemoryPropertyFlags) -> Result<vk::DeviceMemory> {
        let (instance, physical, device) = self.headless.handles();
        // SAFETY: as in `new`.
        let types = unsafe { instance.get_physical_device_memory_properties(physical) }.memory_types;
        let fits = |i: &u32| needs.memory_type_bits >> i & 1 == 1 && types[*i as usize].property_flags.contains(flags);
        let index = (0..32).find(fits).ok_or("no such type of memory")?;
        let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
        // SAFETY: as in `new`.
        let memory = unsafe { device.allocate_memory(&info, None) }?;
        self.memory.borrow_mut().push(memory);
        Ok(memory)
    }

    /// Makes a buffer of `bytes` bytes.
    pub fn shared(&self, bytes: usize, usage: vk::BufferUsageFlags) -> Result<Shared> {
        let flags = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        // SAFETY: as in `image`.
        unsafe {
            let info = vk::BufferCreateInfo::default().size(bytes as u64).usage(usage);
            let buffer = self.device.create_buffer(&info, None)?;
            self.buffers.borrow_mut().push(buffer);
            let memory = self.allocate(self.device.get_buffer_memory_requirements(buffer), flags)?;
            self.device.bind_buffer_memory(buffer, memory, 0)?;
            let mapped = self.device.map_memory(memory, 0, vk::WHOLE_SIZE, Default::default())?.cast();
            Ok(Shared { buffer, bytes, mapped })
        }
    }

    /// Makes a buffer with these contents: vertices, which shaders may write, or indices.
    pub fn filled<T: bytemuck::NoUninit>(&self, contents: &[T]) -> Result<vk::Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        let usage = vk::BufferUsageFlags::VERTEX_BUFFER | vk::BufferUsageFlags::INDEX_BUFFER;
        let shared = self.shared(bytes.len(), usage | vk::BufferUsageFlags::STORAGE_BUFFER)?;
        // SAFETY: as many bytes are mapped, and nothing else uses them yet.
        unsafe { shared.mapped.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) };
        Ok(shared.buffer)
    }

    /// Returns the contents of `shared`, whose writes have finished.
    pub fn contents<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(&self, shared: &Shared) -> Vec<T> {
        let mut out = vec![T::zeroed(); shared.bytes / size_of::<T>()];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut out);
        // SAFETY: as many bytes are mapped; the device has finished with them, since `Headless::run` waits.
        unsafe { shared.mapped.copy_to_nonoverlapping(bytes.as_mut_ptr(), bytes.len()) };
        out
    }

    /// Makes a pipeline of two shaders, of which the first takes `push` bytes of push constants.
    pub fn pipeline(
        &self,
        shaders: [&str; 2],
        (bindings, attributes): &VertexInput,
        push: usize,
    ) -> Result<(vk::Pipeline, vk::PipelineLayout)> {
        let kinds = [vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT];
        let range = [vk::PushConstantRange { stage_flags: kinds[0], offset: 0, size: push as u32 }];
        let layout = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&range);
        let words = [spirv(ShaderStage::Vertex, shaders[0])?, spirv(ShaderStage::Fragment, shaders[1])?];
        let module = |words: &Vec<u32>| {
            // SAFETY: as in `new`; destroyed below.
            unsafe { self.device.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(words), None) }
        };
        let modules = [module(&words[0])?, module(&words[1])?];
        let stage =
            |i: usize| vk::PipelineShaderStageCreateInfo::default().stage(kinds[i]).module(modules[i]).name(c"main");
        let stages = [stage(0), stage(1)];
        let input = vk::PipelineVertexInputStateCreateInfo::default();
        let input = input.vertex_binding_descriptions(bindings).vertex_attribute_descriptions(attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default();
        let assembly = assembly.topology(vk::PrimitiveTopology::TRIANGLE_LIST);
        let (width, height) = (self.extent.width as f32, self.extent.height as f32);
        let viewports = [vk::Viewport { width, height, max_depth: 1.0, ..Default::default() }];
        let scissors = [vk::Rect2D { extent: self.extent, ..Default::default() }];
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewports(&viewports).scissors(&scissors);
        let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
        let samples = vk::PipelineMultisampleStateCreateInfo::default();
        let samples = samples.rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let depth = vk::PipelineDepthStencilStateCreateInfo::default().depth_test_enable(true).depth_write_enable(true);
        let depth = depth.depth_compare_op(vk::CompareOp::LESS);
        let blends = vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA);
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(std::slice::from_ref(&blends));
        let info = vk::GraphicsPipelineCreateInfo::default().stages(&stages).vertex_input_state(&input);
        let info = info.input_assembly_state(&assembly).viewport_state(&viewport).rasterization_state(&rasterization);
        let info = info.multisample_state(&samples).depth_stencil_state(&depth).color_blend_state(&blend);
        // SAFETY: as in `new`; everything that `info` points to is alive.
        unsafe {
            let layout = self.device.create_pipeline_layout(&layout, None)?;
            let info = [info.render_pass(self.pass).layout(layout)];
            let made = self.device.create_graphics_pipelines(vk::PipelineCache::null(), &info, None);
            modules.into_iter().for_each(|module| self.device.destroy_shader_module(module, None));
            let pipeline = made.map_or_else(|(made, _)| made[0], |made| made[0]);
            self.pipelines.borrow_mut().push((pipeline, layout));
            Ok((pipeline, layout))
        }
    }

    /// Records `draws` in front of a background, and a copy of the image to `pixels`.
    pub fn record(&self, cmd: vk::CommandBuffer, background: [f32; 4], pixels: &Shared, draws: impl FnOnce()) {
        let behind = vk::ClearValue { color: vk::ClearColorValue { float32: background } };
        let far = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 1.0, stencil: 0 } };
        let (clear, area) = ([behind, far], vk::Rect2D { extent: self.extent, ..Default::default() });
        let begin = vk::RenderPassBeginInfo::default().render_pass(self.pass).framebuffer(self.framebuffer);
        let begin = begin.render_area(area).clear_values(&clear);
        let layer = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let region = [vk::BufferImageCopy::default().image_subresource(layer).image_extent(self.extent.into())];
        let (image, layout) = (self.images.borrow()[0].0, vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
        // SAFETY: `cmd` is recording outside a render pass; image and buffer are ours, alive, and of one size.
        unsafe { self.device.cmd_begin_render_pass(cmd, &begin, vk::SubpassContents::INLINE) };
        draws();
        // SAFETY: as above.
        unsafe {
            self.device.cmd_end_render_pass(cmd);
            self.device.cmd_copy_image_to_buffer(cmd, image, layout, pixels.buffer, &region);
        }
        let (copy, written) = (vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_WRITE);
        self.barrier(cmd, (copy, written), (vk::PipelineStageFlags::HOST, vk::AccessFlags::HOST_READ));
    }

    /// Records a memory barrier.
    pub fn barrier(
        &self,
        cmd: vk::CommandBuffer,
        from: (vk::PipelineStageFlags, vk::AccessFlags),
        to: (vk::PipelineStageFlags, vk::AccessFlags),
    ) {
        let memory = [vk::MemoryBarrier::default().src_access_mask(from.1).dst_access_mask(to.1)];
        // SAFETY: `cmd` is recording outside a render pass.
        unsafe { self.device.cmd_pipeline_barrier(cmd, from.0, to.0, Default::default(), &memory, &[], &[]) };
    }
}

impl Drop for Offscreen<'_> {
    fn drop(&mut self) {
        // SAFETY: each is ours, destroyed once, and not in use: `Headless::run` waits.
        unsafe {
            self.device.destroy_framebuffer(self.framebuffer, None);
            for (image, view) in self.images.take() {
                self.device.destroy_image_view(view, None);
                self.device.destroy_image(image, None);
            }
            self.buffers.take().into_iter().for_each(|buffer| self.device.destroy_buffer(buffer, None));
            self.memory.take().into_iter().for_each(|memory| self.device.free_memory(memory, None));
            for (pipeline, layout) in self.pipelines.take() {
                self.device.destroy_pipeline(pipeline, None);
                self.device.destroy_pipeline_layout(layout, None);
            }
            self.device.destroy_render_pass(self.pass, None);
        }
    }
}

fn spirv(stage: ShaderStage, text: &str) -> Result<Vec<u32>> {
    let (text, options) = (ShaderSource::from(text), CompilerOptions::default());
    let compiler = Compiler::acquire().ok_or("one compiler at a time")?;
    Ok(compiler.create_shader(ShaderInput::new(&text, stage, &options, None, None)?)?.compile()?)
}
