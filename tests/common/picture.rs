//! What a host has to draw poses: a pipeline with positions, normals and texture coordinates as vertex attributes, an
//! offscreen image, and buffers that host and device share.

use deltamorph::ash::{self, vk};
use deltamorph::headless::Headless;
use deltamorph::{PoseFormat, PoseView};
use glam::Mat4;
use glslang::{
    Compiler, CompilerOptions, ShaderInput, ShaderSource, ShaderStage, SourceLanguage, SpirvVersion, Target,
};
use std::cell::RefCell;

/// Pixels of an edge of the picture.
pub const EDGE: u32 = 256;
/// A pixel: u, v, light, and 1 where anything is drawn; the bits of float32.
pub type Pixel = [u32; 4];

/// Behind what declares the attributes of a pose format.
const VERTEX: &str = "
    POSE_ATTRIBUTES(posed, turned)
    layout(location = 2) in vec2 texcoord;
    layout(location = 3) in vec3 base_position;
    layout(location = 4) in vec3 base_normal;
    layout(location = 0) out vec3 shown;
    layout(push_constant) uniform View { mat4 view; vec2 units; };
    void main() {
    #ifdef INTEGER_POSES
        vec3 position = base_position + units.x * vec3(posed), normal = base_normal + units.y * vec3(turned);
    #else
        vec3 position = posed, normal = turned;
    #endif
        gl_Position = view * vec4(position, 1);
        shown = vec3(texcoord, dot(normalize(normal), vec3(0.36, 0.48, 0.8)));
    }";
const FRAGMENT: &str = "#version 450
    layout(location = 0) in vec3 shown;
    layout(location = 0) out vec4 pixel;
    void main() { pixel = vec4(shown, 1); }";
const FORMATS: [vk::Format; 2] = [vk::Format::R32G32B32A32_SFLOAT, vk::Format::D16_UNORM];

/// What is drawn: triangles, of an index buffer or one vertex after the other.
pub struct Triangles {
    /// Positions and normals, as poses of this format have them.
    pub pose: (vk::Buffer, u64, PoseFormat),
    /// Positions and normals of the base pose, and the units of integers; float32 poses need neither.
    pub base: Option<(vk::Buffer, [f32; 2])>,
    /// Texture coordinates of the vertices.
    pub texcoords: vk::Buffer,
    pub indices: Option<vk::Buffer>,
    /// Corners of all triangles.
    pub count: u32,
}

/// The push constants of [`VERTEX`].
const VIEW_BYTES: usize = size_of::<Mat4>() + size_of::<[f32; 2]>();

type Scope = (vk::PipelineStageFlags, vk::AccessFlags);

/// A buffer in memory that host and device share.
#[derive(Clone, Copy)]
pub struct Shared {
    pub buffer: vk::Buffer,
    bytes: usize,
    mapped: *mut u8,
}

pub struct Picture<'a> {
    headless: &'a Headless,
    device: &'a ash::Device,
    pass: vk::RenderPass,
    layout: vk::PipelineLayout,
    /// One for each pose format.
    pipelines: [vk::Pipeline; 3],
    framebuffer: vk::Framebuffer,
    images: Vec<(vk::Image, vk::ImageView)>,
    pixels: Option<Shared>,
    buffers: RefCell<Vec<vk::Buffer>>,
    memory: RefCell<Vec<vk::DeviceMemory>>,
}

impl<'a> Picture<'a> {
    pub fn new(headless: &'a Headless) -> Self {
        let (_, _, device) = headless.handles();
        let attachment = |format: vk::Format, store, layout| {
            let clear = vk::AttachmentDescription::default().format(format).load_op(vk::AttachmentLoadOp::CLEAR);
            clear.samples(vk::SampleCountFlags::TYPE_1).store_op(store).final_layout(layout)
        };
        use vk::{
            AccessFlags as Access, AttachmentStoreOp as Store, ImageLayout as Layout, PipelineStageFlags as Stage,
        };
        let attachments = [
            attachment(FORMATS[0], Store::STORE, Layout::TRANSFER_SRC_OPTIMAL),
            attachment(FORMATS[1], Store::DONT_CARE, Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL),
        ];
        let of = |attachment, layout| vk::AttachmentReference { attachment, layout };
        let colours = [of(0, Layout::COLOR_ATTACHMENT_OPTIMAL)];
        let depth = of(1, Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
        let subpass = [vk::SubpassDescription::default().color_attachments(&colours).depth_stencil_attachment(&depth)];
        let drawing = Stage::COLOR_ATTACHMENT_OUTPUT | Stage::EARLY_FRAGMENT_TESTS | Stage::LATE_FRAGMENT_TESTS;
        let written = Access::COLOR_ATTACHMENT_WRITE | Access::DEPTH_STENCIL_ATTACHMENT_WRITE;
        let read = Access::COLOR_ATTACHMENT_READ | Access::DEPTH_STENCIL_ATTACHMENT_READ;
        let dependency = |from, to, before, after| {
            let stages = vk::SubpassDependency::default().src_stage_mask(before).dst_stage_mask(after);
            stages.src_subpass(from).dst_subpass(to)
        };
        let (outside, inside) = (vk::SUBPASS_EXTERNAL, 0);
        let dependencies = [
            dependency(outside, inside, drawing | Stage::TRANSFER, drawing)
                .src_access_mask(written)
                .dst_access_mask(written | read),
            dependency(inside, outside, drawing, Stage::TRANSFER)
                .src_access_mask(written)
                .dst_access_mask(Access::TRANSFER_READ),
        ];
        let pass = vk::RenderPassCreateInfo::default()
            .attachments(&attachments)
            .subpasses(&subpass)
            .dependencies(&dependencies);
        let range =
            [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::VERTEX).size(VIEW_BYTES as u32)];
        let layout = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&range);
        // SAFETY: the device is alive, and all that is created on it here is destroyed in `drop`.
        let (pass, layout) = unsafe {
            (device.create_render_pass(&pass, None).unwrap(), device.create_pipeline_layout(&layout, None).unwrap())
        };
        let mut this = Self {
            pipelines: PoseFormat::ALL.map(|format| pipeline(device, pass, layout, format)),
            framebuffer: vk::Framebuffer::null(),
            images: vec![],
            pixels: None,
            buffers: RefCell::default(),
            memory: RefCell::default(),
            headless,
            device,
            pass,
            layout,
        };
        use vk::ImageUsageFlags as Usage;
        this.add_image(FORMATS[0], Usage::COLOR_ATTACHMENT | Usage::TRANSFER_SRC, vk::ImageAspectFlags::COLOR);
        this.add_image(FORMATS[1], Usage::DEPTH_STENCIL_ATTACHMENT, vk::ImageAspectFlags::DEPTH);
        let views: Vec<vk::ImageView> = this.images.iter().map(|(_, view)| *view).collect();
        let framebuffer = vk::FramebufferCreateInfo::default().render_pass(pass).attachments(&views);
        let framebuffer = framebuffer.width(EDGE).height(EDGE).layers(1);
        // SAFETY: as above.
        this.framebuffer = unsafe { device.create_framebuffer(&framebuffer, None) }.unwrap();
        this.pixels =
            Some(this.shared((EDGE * EDGE) as usize * size_of::<Pixel>(), vk::BufferUsageFlags::TRANSFER_DST));
        this
    }

    fn add_image(&mut self, format: vk::Format, usage: vk::ImageUsageFlags, aspect: vk::ImageAspectFlags) {
        let extent = vk::Extent3D { width: EDGE, height: EDGE, depth: 1 };
        let info = vk::ImageCreateInfo::default().image_type(vk::ImageType::TYPE_2D).format(format).extent(extent);
        let info = info.mip_levels(1).array_layers(1).samples(vk::SampleCountFlags::TYPE_1).usage(usage);
        let range = vk::ImageSubresourceRange::default().aspect_mask(aspect).level_count(1).layer_count(1);
        let view = vk::ImageViewCreateInfo::default().view_type(vk::ImageViewType::TYPE_2D).format(format);
        // SAFETY: as in `new`; the memory is of a type and size that the image asks for.
        unsafe {
            let image = self.device.create_image(&info, None).unwrap();
            let memory = self.allocate(self.device.get_image_memory_requirements(image), Default::default());
            self.device.bind_image_memory(image, memory, 0).unwrap();
            let view = self.device.create_image_view(&view.image(image).subresource_range(range), None).unwrap();
            self.images.push((image, view));
        }
    }

    fn allocate(&self, needs: vk::MemoryRequirements, flags: vk::MemoryPropertyFlags) -> vk::DeviceMemory {
        let (instance, physical, device) = self.headless.handles();
        // SAFETY: as in `new`.
        let types = unsafe { instance.get_physical_device_memory_properties(physical) }.memory_types;
        let fits = |i: &u32| needs.memory_type_bits >> i & 1 == 1 && types[*i as usize].property_flags.contains(flags);
        let index = (0..32).find(fits).expect("a type of memory");
        let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
        // SAFETY: as in `new`.
        let memory = unsafe { device.allocate_memory(&info, None) }.unwrap();
        self.memory.borrow_mut().push(memory);
        memory
    }

    /// A buffer for whatever copies write.
    pub fn shared(&self, bytes: usize, usage: vk::BufferUsageFlags) -> Shared {
        let info = vk::BufferCreateInfo::default().size(bytes as u64).usage(usage);
        let flags = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        // SAFETY: as in `new`; the memory is of a type and size that the buffer asks for.
        unsafe {
            let buffer = self.device.create_buffer(&info, None).unwrap();
            self.buffers.borrow_mut().push(buffer);
            let memory = self.allocate(self.device.get_buffer_memory_requirements(buffer), flags);
            self.device.bind_buffer_memory(buffer, memory, 0).unwrap();
            let mapped = self.device.map_memory(memory, 0, vk::WHOLE_SIZE, Default::default()).unwrap().cast();
            Shared { buffer, bytes, mapped }
        }
    }

    /// A buffer for vertex attributes or indices, with these contents.
    pub fn filled<T: bytemuck::NoUninit>(&self, contents: &[T]) -> vk::Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        let usage = vk::BufferUsageFlags::VERTEX_BUFFER | vk::BufferUsageFlags::INDEX_BUFFER;
        let shared = self.shared(bytes.len(), usage);
        // SAFETY: as many bytes are mapped, and nobody else knows of them yet.
        unsafe { shared.mapped.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) };
        shared.buffer
    }

    /// What copies have written into `shared`; they have finished.
    pub fn contents<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(&self, shared: &Shared) -> Vec<T> {
        let mut out = vec![T::zeroed(); shared.bytes / size_of::<T>()];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut out);
        // SAFETY: as many bytes are mapped; the device is done with them, since `Headless::run` waits.
        unsafe { shared.mapped.copy_to_nonoverlapping(bytes.as_mut_ptr(), bytes.len()) };
        out
    }

    /// A pose that [`record_pose_copy`](Self::record_pose_copy) has copied, decoded.
    pub fn pose(&self, shared: &Shared, view: &PoseView, base: &[f32]) -> Vec<f32> {
        view.format.decode(&self.contents(shared)[..view.size as usize], base, view.units)
    }

    /// Draw with nothing behind. `cmd` is recording outside a render pass, and the pose is ready for vertex attributes.
    pub fn record(&self, cmd: vk::CommandBuffer, triangles: &Triangles, view: &Mat4) {
        let clear = [
            vk::ClearValue { color: vk::ClearColorValue { float32: [0.0; 4] } },
            vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 1.0, stencil: 0 } },
        ];
        let area = vk::Rect2D { extent: vk::Extent2D { width: EDGE, height: EDGE }, ..Default::default() };
        let begin = vk::RenderPassBeginInfo::default().render_pass(self.pass).framebuffer(self.framebuffer);
        let begin = begin.render_area(area).clear_values(&clear);
        let Triangles { pose: (pose, offset, format), base, texcoords, indices, count } = *triangles;
        // What is not read is bound all the same.
        let (base, units) = base.unwrap_or((pose, [1.0; 2]));
        assert_eq!(base != pose, format.has_integers());
        let layer = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let extent = vk::Extent3D { width: EDGE, height: EDGE, depth: 1 };
        let region = [vk::BufferImageCopy::default().image_subresource(layer).image_extent(extent)];
        let pixels = self.pixels.expect("made in `new`").buffer;
        let device = self.device;
        // SAFETY: `cmd` is recording (see above), and all else is ours or the caller's, alive, and large enough.
        unsafe {
            device.cmd_begin_render_pass(cmd, &begin, vk::SubpassContents::INLINE);
            device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.pipelines[format as usize]);
            let view = [&view.to_cols_array()[..], &units].concat();
            device.cmd_push_constants(cmd, self.layout, vk::ShaderStageFlags::VERTEX, 0, bytemuck::cast_slice(&view));
            device.cmd_bind_vertex_buffers(cmd, 0, &[pose, texcoords, base], &[offset, 0, 0]);
            match indices {
                Some(indices) => {
                    device.cmd_bind_index_buffer(cmd, indices, 0, vk::IndexType::UINT32);
                    device.cmd_draw_indexed(cmd, count, 1, 0, 0, 0);
                }
                None => device.cmd_draw(cmd, count, 1, 0, 0),
            }
            device.cmd_end_render_pass(cmd);
            device.cmd_copy_image_to_buffer(
                cmd,
                self.images[0].0,
                vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
                pixels,
                &region,
            );
        }
        let after = (vk::PipelineStageFlags::HOST, vk::AccessFlags::HOST_READ);
        self.barrier(cmd, (vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_WRITE), after);
    }

    /// Copy a pose that compute passes or transform feedback have written. `cmd` is recording outside a render pass.
    pub fn record_pose_copy(&self, cmd: vk::CommandBuffer, pose: &PoseView, to: &Shared) {
        use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
        let copies = Stage::TRANSFER;
        self.barrier(cmd, (Stage::ALL_COMMANDS, Access::MEMORY_WRITE), (copies, Access::TRANSFER_READ));
        let region = [vk::BufferCopy { src_offset: pose.offset, dst_offset: 0, size: pose.size }];
        // SAFETY: as in `record`; both have `pose.size` bytes.
        unsafe { self.device.cmd_copy_buffer(cmd, pose.buffer, to.buffer, &region) };
        // The next update, which may write this pose, waits as well.
        let after = (Stage::HOST | Stage::ALL_COMMANDS, Access::HOST_READ | Access::MEMORY_WRITE);
        self.barrier(cmd, (copies, Access::TRANSFER_WRITE), after);
    }

    fn barrier(&self, cmd: vk::CommandBuffer, from: Scope, to: Scope) {
        let memory = [vk::MemoryBarrier::default().src_access_mask(from.1).dst_access_mask(to.1)];
        // SAFETY: as in `record`.
        unsafe { self.device.cmd_pipeline_barrier(cmd, from.0, to.0, Default::default(), &memory, &[], &[]) };
    }

    /// What was drawn last, row by row.
    pub fn pixels(&self) -> Vec<Pixel> {
        self.contents(&self.pixels.expect("made in `new`"))
    }
}

impl Drop for Picture<'_> {
    fn drop(&mut self) {
        // SAFETY: each is ours, destroyed once, and not in use: `Headless::run` waits.
        unsafe {
            self.device.destroy_framebuffer(self.framebuffer, None);
            for (image, view) in self.images.drain(..) {
                self.device.destroy_image_view(view, None);
                self.device.destroy_image(image, None);
            }
            self.buffers.take().into_iter().for_each(|buffer| self.device.destroy_buffer(buffer, None));
            self.memory.take().into_iter().for_each(|memory| self.device.free_memory(memory, None));
            self.pipelines.iter().for_each(|pipeline| self.device.destroy_pipeline(*pipeline, None));
            self.device.destroy_pipeline_layout(self.layout, None);
            self.device.destroy_render_pass(self.pass, None);
        }
    }
}

fn spirv(stage: ShaderStage, text: &str) -> Vec<u32> {
    let options = CompilerOptions {
        source_language: SourceLanguage::GLSL,
        target: Target::Vulkan { version: glslang::VulkanVersion::Vulkan1_1, spirv_version: SpirvVersion::SPIRV1_3 },
        ..CompilerOptions::default()
    };
    let source = ShaderSource::from(text);
    let input = ShaderInput::new(&source, stage, &options, None, None).unwrap();
    Compiler::acquire().expect("a compiler").create_shader(input).unwrap().compile().unwrap()
}

fn pipeline(
    device: &ash::Device,
    pass: vk::RenderPass,
    layout: vk::PipelineLayout,
    format: PoseFormat,
) -> vk::Pipeline {
    let attributes = match format {
        PoseFormat::Fixed32 => include_str!("../../glsl/poses/fixed32.glsl"),
        PoseFormat::Fixed16 => include_str!("../../glsl/poses/fixed16.glsl"),
        _ => include_str!("../../glsl/poses/float32.glsl"),
    };
    let vertex = format!("#version 450\n{attributes}{VERTEX}");
    let module = |stage, text| {
        let words = spirv(stage, text);
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the device is alive; the module is destroyed below.
        unsafe { device.create_shader_module(&info, None) }.unwrap()
    };
    let modules = [module(ShaderStage::Vertex, &vertex), module(ShaderStage::Fragment, FRAGMENT)];
    let stage = |stage, module| vk::PipelineShaderStageCreateInfo::default().stage(stage).module(module).name(c"main");
    let stages = [stage(vk::ShaderStageFlags::VERTEX, modules[0]), stage(vk::ShaderStageFlags::FRAGMENT, modules[1])];
    let (pose, mut attributes) = format.vertex_input();
    let binding = |binding, stride| vk::VertexInputBindingDescription::default().binding(binding).stride(stride);
    let bindings = [pose, binding(1, 8), binding(2, 24)];
    attributes.extend([
        vk::VertexInputAttributeDescription { location: 2, binding: 1, format: vk::Format::R32G32_SFLOAT, offset: 0 },
        vk::VertexInputAttributeDescription {
            location: 3,
            binding: 2,
            format: vk::Format::R32G32B32_SFLOAT,
            offset: 0,
        },
        vk::VertexInputAttributeDescription {
            location: 4,
            binding: 2,
            format: vk::Format::R32G32B32_SFLOAT,
            offset: 12,
        },
    ]);
    let input = vk::PipelineVertexInputStateCreateInfo::default()
        .vertex_binding_descriptions(&bindings)
        .vertex_attribute_descriptions(&attributes);
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewports = [vk::Viewport { width: EDGE as f32, height: EDGE as f32, max_depth: 1.0, ..Default::default() }];
    let scissors = [vk::Rect2D { extent: vk::Extent2D { width: EDGE, height: EDGE }, ..Default::default() }];
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewports(&viewports).scissors(&scissors);
    let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
    let multisample =
        vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::LESS);
    let blends = [vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA)];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends);
    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(&stages)
        .vertex_input_state(&input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&rasterization)
        .multisample_state(&multisample)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .render_pass(pass)
        .layout(layout);
    // SAFETY: as above; all that `info` points to is alive.
    unsafe {
        let made = device.create_graphics_pipelines(vk::PipelineCache::null(), &[info], None);
        modules.into_iter().for_each(|module| device.destroy_shader_module(module, None));
        made.expect("a pipeline")[0]
    }
}
