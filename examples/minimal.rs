//! A minimal host engine that morphs a head and draws it: start here to link deltamorph.
//!
//!     cargo run --example minimal [PART OF A DEVICE'S NAME]
//!
//! Instance, device, queue, command buffers, fences, pipeline and picture belong to the host, as in any engine;
//! deltamorph records into the host's command buffers. The example plays two seconds of a clip with two frames in
//! flight, draws every pose, and writes the picture after each half second to `head.ppm`, one below the other.

use deltamorph::ash::prelude::VkResult;
use deltamorph::ash::{self, Device, vk};
use deltamorph::{CrowdDesc, DeltaFormat, DeviceDesc, Error, MorphEngine, PoseFormat, PoseView, UpdateDesc};
use deltamorph_head as head;
use glam::{Mat4, Vec3};
use std::io::Cursor;
use vk::{AccessFlags as Access, ImageLayout as Layout, ImageUsageFlags as Usage, PipelineStageFlags as Stage};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const FRAMES_IN_FLIGHT: usize = 2;
const FRAMES: usize = 60;
const PICTURES: usize = 4;
const EXTENT: vk::Extent2D = vk::Extent2D { width: 256, height: 256 };
const COLOUR: vk::Format = vk::Format::R8G8B8A8_UNORM;
const DEPTH: vk::Format = vk::Format::D16_UNORM;
const BACKGROUND: [f32; 4] = [0.2, 0.3, 0.4, 1.0];

/// SPIR-V of the files `head.vert` and `head.frag` beside it: `pose.glsl` is all that they need of deltamorph.
const VERTEX: &[u8] = include_bytes!("shaders/head.vert.spv");
const FRAGMENT: &[u8] = include_bytes!("shaders/head.frag.spv");

type Destroy = Box<dyn FnOnce(&Device)>;

/// The objects of any Vulkan program.
struct Host {
    made: Vec<Destroy>, // what was made on the device; the last is destroyed first
    queue: vk::Queue,
    pool: vk::CommandPool,
    device: Device,
    physical: vk::PhysicalDevice,
    instance: Instance, // goes after the device
}

struct Instance {
    raw: ash::Instance,
    _entry: ash::Entry, // keeps the Vulkan library loaded
}

/// A frame in flight.
struct Frame {
    cmd: vk::CommandBuffer,
    fence: vk::Fence,
}

impl Host {
    fn new(wanted: &str) -> Result<Self> {
        let app = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
        // SAFETY: the system's loader is meant to be loaded, and queries are about the instance's own devices; the
        // device was created with the queue.
        unsafe {
            let entry = ash::Entry::load()?;
            let raw = entry.create_instance(&vk::InstanceCreateInfo::default().application_info(&app), None);
            let instance = Instance { raw: raw.map_err(Error::vulkan("vkCreateInstance"))?, _entry: entry };
            let devices = instance.raw.enumerate_physical_devices();
            let devices = devices.map_err(Error::vulkan("vkEnumeratePhysicalDevices"))?;
            let properties = |device: &_| instance.raw.get_physical_device_properties(*device);
            let is_wanted = |device: &_| {
                let found = properties(device);
                let name = found.device_name_as_c_str().unwrap_or_default().to_string_lossy();
                found.api_version >= vk::API_VERSION_1_1 && name.contains(wanted)
            };
            let is_software = |device: &_| properties(device).device_type == vk::PhysicalDeviceType::CPU;
            let usable = devices.into_iter().filter(is_wanted).min_by_key(is_software);
            let physical = usable.ok_or("no such Vulkan 1.1 device")?;
            let families = instance.raw.get_physical_device_queue_family_properties(physical);
            let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
            let family = families.iter().position(|f| f.queue_flags.contains(wanted)).ok_or("no queue")? as u32;
            let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
            // No extensions or features: `deltamorph::requirements` lists none for UpdatePath::Blocks.
            let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
            let device = instance.raw.create_device(physical, &info, None).map_err(Error::vulkan("vkCreateDevice"))?;
            let (queue, pool) = (device.get_device_queue(family, 0), vk::CommandPool::null());
            let mut host = Self { made: vec![], queue, pool, device, physical, instance };
            let pool = vk::CommandPoolCreateInfo::default().queue_family_index(family);
            let pool = pool.flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            let pool = host.device.create_command_pool(&pool, None);
            host.pool = host.keep("vkCreateCommandPool", pool, Device::destroy_command_pool)?;
            Ok(host)
        }
    }

    /// Has an object destroyed with the host, or names the call that did not make it.
    fn keep<T: Copy + 'static>(
        &mut self,
        call: &'static str,
        made: VkResult<T>,
        destroy: unsafe fn(&Device, T, Option<&vk::AllocationCallbacks<'_>>),
    ) -> Result<T> {
        let made = made.map_err(Error::vulkan(call))?;
        // SAFETY: destroyed once, after what was made from it, and not in use: the host has waited.
        self.made.push(Box::new(move |device| unsafe { destroy(device, made, None) }));
        Ok(made)
    }

    fn allocate(&mut self, needs: vk::MemoryRequirements, flags: vk::MemoryPropertyFlags) -> Result<vk::DeviceMemory> {
        // SAFETY: the device is alive; the type of memory is one of those asked for.
        unsafe {
            let types = self.instance.raw.get_physical_device_memory_properties(self.physical).memory_types;
            let mut allowed = (0..32).filter(|i| needs.memory_type_bits >> i & 1 == 1);
            let fits = |i: &u32| types[*i as usize].property_flags.contains(flags);
            let index = allowed.find(fits).ok_or("no such type of memory")?;
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
            self.keep("vkAllocateMemory", self.device.allocate_memory(&info, None), Device::free_memory)
        }
    }

    /// Makes a buffer that host and device share; returns where it is mapped, too.
    fn buffer(&mut self, bytes: usize, usage: vk::BufferUsageFlags) -> Result<(vk::Buffer, *mut u8)> {
        let info = vk::BufferCreateInfo::default().size(bytes as u64).usage(usage);
        let shared = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        // SAFETY: everything is made on one device; the memory is what the buffer needs.
        unsafe {
            let buffer = self.device.create_buffer(&info, None);
            let buffer = self.keep("vkCreateBuffer", buffer, Device::destroy_buffer)?;
            let memory = self.allocate(self.device.get_buffer_memory_requirements(buffer), shared)?;
            self.device.bind_buffer_memory(buffer, memory, 0).map_err(Error::vulkan("vkBindBufferMemory"))?;
            let mapped = self.device.map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty());
            Ok((buffer, mapped.map_err(Error::vulkan("vkMapMemory"))?.cast()))
        }
    }

    fn image(
        &mut self,
        format: vk::Format,
        usage: Usage,
        aspect: vk::ImageAspectFlags,
    ) -> Result<(vk::Image, vk::ImageView)> {
        let info = vk::ImageCreateInfo::default().image_type(vk::ImageType::TYPE_2D).format(format).usage(usage);
        let info = info.extent(EXTENT.into()).mip_levels(1).array_layers(1).samples(vk::SampleCountFlags::TYPE_1);
        let range = vk::ImageSubresourceRange::default().aspect_mask(aspect).level_count(1).layer_count(1);
        let view = vk::ImageViewCreateInfo::default().view_type(vk::ImageViewType::TYPE_2D).format(format);
        // SAFETY: everything is made on one device; the memory is what the image needs.
        unsafe {
            let image = self.device.create_image(&info, None);
            let image = self.keep("vkCreateImage", image, Device::destroy_image)?;
            let memory = self.allocate(self.device.get_image_memory_requirements(image), Default::default())?;
            self.device.bind_image_memory(image, memory, 0).map_err(Error::vulkan("vkBindImageMemory"))?;
            let view = self.device.create_image_view(&view.image(image).subresource_range(range), None);
            Ok((image, self.keep("vkCreateImageView", view, Device::destroy_image_view)?))
        }
    }

    /// Makes what frames draw into, one after the other.
    fn picture(&mut self) -> Result<(vk::Image, vk::RenderPass, vk::Framebuffer)> {
        let usage = Usage::COLOR_ATTACHMENT | Usage::TRANSFER_SRC;
        let (image, colour) = self.image(COLOUR, usage, vk::ImageAspectFlags::COLOR)?;
        let (_, depth) = self.image(DEPTH, Usage::DEPTH_STENCIL_ATTACHMENT, vk::ImageAspectFlags::DEPTH)?;
        let attachment = |format, layout| {
            let cleared = vk::AttachmentDescription::default().format(format).load_op(vk::AttachmentLoadOp::CLEAR);
            cleared.samples(vk::SampleCountFlags::TYPE_1).final_layout(layout)
        };
        let depth_layout = Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
        let attachments = [attachment(COLOUR, Layout::TRANSFER_SRC_OPTIMAL), attachment(DEPTH, depth_layout)];
        let reference = |attachment, layout| vk::AttachmentReference { attachment, layout };
        let (colours, depths) = ([reference(0, Layout::COLOR_ATTACHMENT_OPTIMAL)], reference(1, depth_layout));
        let subpass = vk::SubpassDescription::default().color_attachments(&colours).depth_stencil_attachment(&depths);
        // Draws come after those of the frame before and after its copy, and before the copy of their own.
        let drawing = Stage::COLOR_ATTACHMENT_OUTPUT | Stage::EARLY_FRAGMENT_TESTS | Stage::LATE_FRAGMENT_TESTS;
        let written = Access::COLOR_ATTACHMENT_WRITE | Access::DEPTH_STENCIL_ATTACHMENT_WRITE;
        let read = Access::COLOR_ATTACHMENT_READ | Access::DEPTH_STENCIL_ATTACHMENT_READ;
        let before = vk::SubpassDependency::default().src_subpass(vk::SUBPASS_EXTERNAL).dst_stage_mask(drawing);
        let before = before.src_stage_mask(drawing | Stage::TRANSFER).dst_access_mask(written | read);
        let after = vk::SubpassDependency::default().dst_subpass(vk::SUBPASS_EXTERNAL).src_stage_mask(drawing);
        let after = after.dst_stage_mask(Stage::TRANSFER).dst_access_mask(Access::TRANSFER_READ);
        let (subpasses, order) = ([subpass], [before.src_access_mask(written), after.src_access_mask(written)]);
        let pass = vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpasses);
        // SAFETY: everything is made on one device.
        unsafe {
            let pass = self.device.create_render_pass(&pass.dependencies(&order), None);
            let pass = self.keep("vkCreateRenderPass", pass, Device::destroy_render_pass)?;
            let views = [colour, depth];
            let info = vk::FramebufferCreateInfo::default().render_pass(pass).attachments(&views);
            let info = info.width(EXTENT.width).height(EXTENT.height).layers(1);
            let framebuffer = self.device.create_framebuffer(&info, None);
            let framebuffer = self.keep("vkCreateFramebuffer", framebuffer, Device::destroy_framebuffer)?;
            Ok((image, pass, framebuffer))
        }
    }

    /// Makes a pipeline that draws poses of a format.
    fn pipeline(&mut self, pass: vk::RenderPass, format: PoseFormat) -> Result<(vk::Pipeline, vk::PipelineLayout)> {
        let mut stages = vec![];
        for (flags, module) in [(vk::ShaderStageFlags::VERTEX, VERTEX), (vk::ShaderStageFlags::FRAGMENT, FRAGMENT)] {
            let words = ash::util::read_spv(&mut Cursor::new(module))?;
            let info = vk::ShaderModuleCreateInfo::default().code(&words);
            // SAFETY: the words are a module that glslang has compiled.
            let module = unsafe { self.device.create_shader_module(&info, None) };
            let module = self.keep("vkCreateShaderModule", module, Device::destroy_shader_module)?;
            stages.push(vk::PipelineShaderStageCreateInfo::default().stage(flags).module(module).name(c"main"));
        }
        let push = [vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::VERTEX, offset: 0, size: 64 }];
        let layout = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&push);
        let (bindings, attributes) = format.vertex_input();
        let input = vk::PipelineVertexInputStateCreateInfo::default().vertex_binding_descriptions(&bindings);
        let input = input.vertex_attribute_descriptions(&attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default();
        let assembly = assembly.topology(vk::PrimitiveTopology::TRIANGLE_LIST);
        let (width, height) = (EXTENT.width as f32, EXTENT.height as f32);
        let viewports = [vk::Viewport { width, height, max_depth: 1.0, ..Default::default() }];
        let scissors = [EXTENT.into()];
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewports(&viewports).scissors(&scissors);
        let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
        let samples = vk::PipelineMultisampleStateCreateInfo::default();
        let samples = samples.rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let depth = vk::PipelineDepthStencilStateCreateInfo::default().depth_test_enable(true).depth_write_enable(true);
        let depth = depth.depth_compare_op(vk::CompareOp::LESS);
        let all = [vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA)];
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&all);
        let info = vk::GraphicsPipelineCreateInfo::default().stages(&stages).vertex_input_state(&input);
        let info = info.input_assembly_state(&assembly).viewport_state(&viewport).rasterization_state(&rasterization);
        let info = info.multisample_state(&samples).depth_stencil_state(&depth).color_blend_state(&blend);
        // SAFETY: everything is made on one device, and all that `info` points to is alive.
        unsafe {
            let layout = self.device.create_pipeline_layout(&layout, None);
            let layout = self.keep("vkCreatePipelineLayout", layout, Device::destroy_pipeline_layout)?;
            let info = [info.render_pass(pass).layout(layout)];
            let made = self.device.create_graphics_pipelines(vk::PipelineCache::null(), &info, None);
            let made = made.map(|pipelines| pipelines[0]).map_err(|(_, result)| result);
            Ok((self.keep("vkCreateGraphicsPipelines", made, Device::destroy_pipeline)?, layout))
        }
    }

    fn frame(&mut self) -> Result<Frame> {
        let cmds = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: everything is made on one device; command buffers go with their pool.
        unsafe {
            let cmds = self.device.allocate_command_buffers(&cmds);
            let cmd = cmds.map_err(Error::vulkan("vkAllocateCommandBuffers"))?[0];
            let fence = self.device.create_fence(&vk::FenceCreateInfo::default(), None);
            let fence = self.keep("vkCreateFence", fence, Device::destroy_fence)?;
            Ok(Frame { cmd, fence })
        }
    }

    /// Records with `f`, and submits. The device has finished with this frame: `wait` comes between two submits.
    fn submit<R>(&self, frame: &Frame, f: impl FnOnce(vk::CommandBuffer) -> Result<R>) -> Result<R> {
        let (device, cmd) = (&self.device, frame.cmd);
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: command buffer and fence are the frame's, and not in use (see above).
        unsafe {
            device.begin_command_buffer(cmd, &once).map_err(Error::vulkan("vkBeginCommandBuffer"))?;
            let recorded = f(cmd)?;
            device.end_command_buffer(cmd).map_err(Error::vulkan("vkEndCommandBuffer"))?;
            let submit = vk::SubmitInfo::default().command_buffers(std::slice::from_ref(&cmd));
            let submitted = device.queue_submit(self.queue, &[submit], frame.fence);
            submitted.map_err(Error::vulkan("vkQueueSubmit"))?;
            Ok(recorded)
        }
    }

    /// Waits for the submission. Even after an error the device no longer uses it: the caller may drop it.
    fn wait(&self, frame: &Frame) -> Result<()> {
        // SAFETY: the fence was handed to `submit`, and no other thread uses it.
        unsafe {
            let waited = self.device.wait_for_fences(&[frame.fence], true, u64::MAX);
            waited.inspect_err(|_| self.wait_idle()).map_err(Error::vulkan("vkWaitForFences"))?;
            Ok(self.device.reset_fences(&[frame.fence]).map_err(Error::vulkan("vkResetFences"))?)
        }
    }

    /// Waits until the device is idle or lost. A wait may run out of memory while the device is still working, when its
    /// resources must not be dropped: it is repeated.
    fn wait_idle(&self) {
        // SAFETY: waiting is always allowed.
        while unsafe { self.device.device_wait_idle() }.is_err_and(|error| error != vk::Result::ERROR_DEVICE_LOST) {
            std::thread::yield_now();
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        while let Some(destroy) = self.made.pop() {
            destroy(&self.device);
        }
        // SAFETY: destroyed once, after the objects made on it.
        unsafe { self.device.destroy_device(None) };
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: destroyed once, after its device.
        unsafe { self.raw.destroy_instance(None) };
    }
}

fn main() {
    if let Err(error) = run(&std::env::args().nth(1).unwrap_or_default()) {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run(wanted: &str) -> Result<()> {
    // Rust drops the last declared first: crowd, mesh, engine, host.
    let mut host = Host::new(wanted)?;
    let desc = DeviceDesc::new(&host.instance.raw, host.physical, &host.device);
    // SAFETY: the handles belong together, and are destroyed after the engine and its objects.
    let engine = unsafe { MorphEngine::new(&desc) }?;
    let head_desc = head::HeadDesc { vertices: 5_000, targets: 52, ..Default::default() };
    let mesh = head::head(&head_desc).pack(&engine.pack_desc(DeltaFormat::Fast))?;
    let names: Vec<&str> = mesh.layout().targets.iter().map(|t| t.name.as_str()).collect();
    let clip: Vec<Vec<f32>> = head::head_clip(&head_desc, FRAMES, 30.0).bind(&names)?.frames().collect();

    let (image, pass, framebuffer) = host.picture()?;
    let (pipeline, layout) = host.pipeline(pass, PoseFormat::Float32)?;
    // From the front: the head is 29 units high and 21 deep.
    let view = Mat4::from_translation(Vec3::new(0.0, -0.14, 0.5)) * Mat4::from_scale(Vec3::new(0.06, -0.06, -0.04));
    let triangles = &mesh.layout().indices;
    let (indices, mapped) = host.buffer(size_of_val(&triangles[..]), vk::BufferUsageFlags::INDEX_BUFFER)?;
    // SAFETY: as many indices are mapped, and nothing else uses them yet.
    unsafe { mapped.cast::<u32>().copy_from_nonoverlapping(triangles.as_ptr(), triangles.len()) };
    let bytes = PICTURES * 4 * (EXTENT.width * EXTENT.height) as usize;
    let (pixels, copied) = host.buffer(bytes, vk::BufferUsageFlags::TRANSFER_DST)?;
    let frames: [Frame; FRAMES_IN_FLIGHT] = [host.frame()?, host.frame()?];

    // SAFETY: `submit` hands out a recording buffer; the mesh is dropped after the last wait.
    let mut uploaded = host.submit(&frames[0], |cmd| Ok(unsafe { engine.upload(cmd, &mesh) }?))?;
    host.wait(&frames[0])?;
    uploaded.release_staging();
    let crowd_desc = CrowdDesc { frames_in_flight: FRAMES_IN_FLIGHT as u32, ..CrowdDesc::new(UpdateDesc::blocks()) };
    let mut crowd = engine.create_crowd(&uploaded, &crowd_desc)?;

    // Draws a pose, which its update has made ready for vertex attributes, and copies the picture.
    let record_draw = |cmd: vk::CommandBuffer, pose: &PoseView, number: usize| {
        let behind = vk::ClearValue { color: vk::ClearColorValue { float32: BACKGROUND } };
        let far = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 1.0, stencil: 0 } };
        let clear = [behind, far];
        let begin = vk::RenderPassBeginInfo::default().render_pass(pass).framebuffer(framebuffer);
        let begin = begin.render_area(EXTENT.into()).clear_values(&clear);
        // From the numbers of the pose to the mesh, then to the picture.
        let push = (view * pose.matrix()).to_cols_array().map(f32::to_ne_bytes);
        let layer = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let region = vk::BufferImageCopy::default().image_subresource(layer).image_extent(EXTENT.into());
        let region = [region.buffer_offset((number * bytes / PICTURES) as u64)];
        // Before the next copy, and before the host.
        let copied = vk::MemoryBarrier::default().src_access_mask(Access::TRANSFER_WRITE);
        let copied = [copied.dst_access_mask(Access::TRANSFER_WRITE | Access::HOST_READ)];
        let (device, from, next) = (&host.device, Layout::TRANSFER_SRC_OPTIMAL, Stage::TRANSFER | Stage::HOST);
        // SAFETY: `cmd` is recording outside a render pass; all objects are ours, alive, and fit each other.
        unsafe {
            device.cmd_begin_render_pass(cmd, &begin, vk::SubpassContents::INLINE);
            device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
            device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, push.as_flattened());
            device.cmd_bind_vertex_buffers(cmd, 0, &[pose.buffer], &[pose.offset]);
            device.cmd_bind_index_buffer(cmd, indices, 0, vk::IndexType::UINT32);
            device.cmd_draw_indexed(cmd, triangles.len() as u32, 1, 0, 0, 0);
            device.cmd_end_render_pass(cmd);
            device.cmd_copy_image_to_buffer(cmd, image, from, pixels, &region);
            device.cmd_pipeline_barrier(cmd, Stage::TRANSFER, next, Default::default(), &copied, &[], &[]);
        }
    };

    let (mut applied, mut blocks) = (0, 0);
    let played = (0..FRAMES + FRAMES_IN_FLIGHT).try_for_each(|now| -> Result<()> {
        let frame = &frames[now % FRAMES_IN_FLIGHT];
        if now >= FRAMES_IN_FLIGHT {
            host.wait(frame)?;
        }
        let Some(weights) = clip.get(now) else { return Ok(()) };
        crowd.set_weights(0, weights)?;
        let update = host.submit(frame, |cmd| {
            // SAFETY: `cmd` is recording on the engine's device, outside a render pass, and is submitted once, in
            // order, after the wait for the frame FRAMES_IN_FLIGHT ago. If dropped: crowd.discard(update.ticket).
            let update = unsafe { engine.record_update(cmd, &mut crowd) }?;
            // For motion vectors: `crowd.previous_pose(0)?`, this pose after `crowd.reset_history(0)?`.
            record_draw(cmd, &crowd.pose(0)?, now * PICTURES / FRAMES);
            Ok(update)
        })?;
        (applied, blocks) = (applied + update.stats.coefficients, blocks + update.stats.dirty_blocks);
        Ok(())
    });
    // Also after an error, so that nothing dropped below is still in use.
    host.wait_idle();
    played?;

    let mut file = format!("P6 {} {} 255\n", EXTENT.width, EXTENT.height as usize * PICTURES).into_bytes();
    // SAFETY: as many bytes are mapped, and the copies have finished.
    let pixels = unsafe { std::slice::from_raw_parts(copied, bytes) };
    file.extend(pixels.chunks_exact(4).flat_map(|rgba| &rgba[..3]));
    std::fs::write("head.ppm", file)?;
    let device = &engine.caps().name;
    println!("{device}: {FRAMES} poses, {applied} weights in {blocks} blocks, drawn into head.ppm");
    Ok(())
}
