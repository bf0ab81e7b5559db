//! The parts of any wgpu host, without a window: a device, a pipeline, a picture.

use deltamorph::PoseFormat;
use deltamorph::glam::{Mat4, Vec3};
use deltamorph_wgpu::VertexInput;
use std::task::{Context, Poll, Waker};
use wgpu::util::DeviceExt as _;

pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Width and height of a picture in pixels.
pub const EDGE: u32 = 512;

/// A device and its queue.
pub struct Host {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
}

/// Returns the result of a wgpu future that is ready at once, as all are outside browsers.
pub fn now<F: Future>(future: F) -> F::Output {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(output) => output,
        Poll::Pending => unreachable!("wgpu does it all in the call on native platforms"),
    }
}

impl Host {
    /// Returns the Vulkan adapters whose name contains `wanted`.
    pub fn adapters(wanted: &str, flags: wgpu::InstanceFlags) -> Vec<wgpu::Adapter> {
        let desc = wgpu::InstanceDescriptor::new_without_display_handle();
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor { flags, ..desc });
        let adapters = now(instance.enumerate_adapters(wgpu::Backends::VULKAN));
        adapters.into_iter().filter(|adapter| adapter.get_info().name.contains(wanted)).collect()
    }

    pub fn new(adapter: &wgpu::Adapter) -> Result<Self> {
        // Optional for deltamorph, but faster on software drivers.
        let required_features = adapter.features() & wgpu::Features::SHADER_INT64;
        let desc = wgpu::DeviceDescriptor { required_features, ..Default::default() };
        let (device, queue) = now(adapter.request_device(&desc))?;
        Ok(Self { device, queue })
    }

    /// Makes a buffer with these contents.
    pub fn filled(&self, contents: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    }

    /// Makes a buffer for copies that the host reads.
    pub fn readback(&self, size: u64) -> wgpu::Buffer {
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        self.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    }

    /// Reads such a buffer, after all submitted work has finished.
    pub fn read(&self, buffer: &wgpu::Buffer) -> Result<Vec<u8>> {
        let (sender, receiver) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |mapped| drop(sender.send(mapped)));
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        receiver.recv()??;
        let bytes = buffer.get_mapped_range(..)?.to_vec();
        buffer.unmap();
        Ok(bytes)
    }
}

/// Draws a head from poses of one format.
pub struct Scene<'a> {
    host: &'a Host,
    pipeline: wgpu::RenderPipeline,
    bindings: wgpu::BindGroup,
    pixels: wgpu::Texture,
    depth: wgpu::TextureView,
}

/// Returns a view of all these positions, from the front and a little from above.
pub fn view_of(positions: &[Vec3]) -> Mat4 {
    let (low, high) = positions.iter().fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(*p), high.max(*p)));
    let scale = Mat4::from_scale(Vec3::new(1.8, 1.8, -0.45) / (high - low).max_element());
    let turn = Mat4::from_rotation_x(0.2) * Mat4::from_translation(-(low + high) / 2.0);
    Mat4::from_translation(Vec3::Z * 0.5) * scale * turn
}

const SHADER: &str = "
    @group(0) @binding(0) var<uniform> view: mat4x4f;

    struct Drawn { @builtin(position) clip: vec4f, @location(0) normal: vec3f }

    @vertex fn vertex(in: PoseInput) -> Drawn {
        let pose = pose_input(in);
        return Drawn(view * vec4f(pose.position, 1.0), pose.normal);
    }

    @fragment fn fragment(in: Drawn) -> @location(0) vec4f {
        let light = 0.5 + 0.5 * dot(normalize(in.normal), vec3f(0.36, 0.48, 0.8));
        return vec4f(vec3f(0.9, 0.7, 0.6) * light, 1.0);
    }";

impl<'a> Scene<'a> {
    /// Makes a scene for poses of a format; `view` is of their numbers.
    pub fn new(host: &'a Host, format: PoseFormat, view: Mat4) -> Result<Self> {
        let device = &host.device;
        let input = VertexInput::new(format, 0, false)?;
        let source = wgpu::ShaderSource::Wgsl((input.wgsl() + SHADER).into());
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let target = wgpu::ColorTargetState::from(wgpu::TextureFormat::Rgba8Unorm);
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                buffers: &input.layouts(),
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: wgpu::TextureFormat::Depth32Float,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                targets: &[Some(target)],
            }),
            multiview_mask: None,
            cache: None,
        });
        let view = view.to_cols_array().map(f32::to_ne_bytes).concat();
        let view = host.filled(&view, wgpu::BufferUsages::UNIFORM);
        let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: view.as_entire_binding() }],
        });
        let texture = |format, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d { width: EDGE, height: EDGE, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let drawn = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let pixels = texture(wgpu::TextureFormat::Rgba8Unorm, drawn | wgpu::TextureUsages::COPY_SRC);
        let depth = texture(wgpu::TextureFormat::Depth32Float, drawn).create_view(&Default::default());
        Ok(Self { host, pipeline, bindings, pixels, depth })
    }

    /// Draws indexed triangles from a pose.
    pub fn draw(&self, encoder: &mut wgpu::CommandEncoder, vertices: wgpu::BufferSlice<'_>, indices: &wgpu::Buffer) {
        let background = wgpu::Color { r: 0.5, g: 0.39, b: 0.33, a: 1.0 };
        let view = self.pixels.create_view(&Default::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(background), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bindings, &[]);
        pass.set_vertex_buffer(0, vertices);
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..indices.size() as u32 / 4, 0, 0..1);
    }

    /// Copies the picture into a buffer for [`Host::read`], four bytes per pixel.
    pub fn copy(&self, encoder: &mut wgpu::CommandEncoder) -> wgpu::Buffer {
        let buffer = self.host.readback(u64::from(EDGE * EDGE * 4));
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(EDGE * 4), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(self.pixels.as_image_copy(), to, self.pixels.size());
        buffer
    }
}
