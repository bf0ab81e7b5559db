//! A head drawn by wgpu and morphed by deltamorph, without a window.
//!
//!     cargo run --example head
//!
//! Plays part of a clip and writes the last frame as `head.png`.

use deltamorph::{CrowdDesc, DeltaFormat, PoseFormat, UpdateDesc};
use deltamorph_head::{HeadDesc, head, head_clip};
use deltamorph_wgpu::{Morph, VertexInput};
use std::error::Error;
use wgpu::util::DeviceExt as _;

/// Width and height of the picture in pixels.
const EDGE: u32 = 512;
const COLOR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Follows the declarations of [`VertexInput::wgsl`]. The head is 29 units high.
const SHADER: &str = "
    struct Vertex { @builtin(position) position: vec4f, @location(0) normal: vec3f }

    @vertex fn vertex(in: PoseInput) -> Vertex {
        let pose = pose_input(in);
        return Vertex(vec4f(pose.position * vec3f(0.06, 0.06, -0.04) + vec3f(0.0, 0.14, 0.5), 1.0), pose.normal);
    }

    @fragment fn fragment(in: Vertex) -> @location(0) vec4f {
        let light = 0.5 + 0.5 * dot(normalize(in.normal), vec3f(0.36, 0.48, 0.8));
        return vec4f(vec3f(0.8, 0.45, 0.3) * light, 1.0);
    }";

fn main() -> Result<(), Box<dyn Error>> {
    let mut desc = wgpu::InstanceDescriptor::new_without_display_handle();
    desc.backends = wgpu::Backends::VULKAN;
    let adapter = pollster::block_on(wgpu::Instance::new(desc).request_adapter(&Default::default()))?;
    // Optional for deltamorph, but faster on software drivers.
    let required_features = adapter.features() & wgpu::Features::SHADER_INT64;
    let desc = wgpu::DeviceDescriptor { required_features, ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&desc))?;

    let picture = draw(&device, &queue, 43)?;
    let mut png = png::Encoder::new(std::fs::File::create("head.png")?, EDGE, EDGE);
    png.set_color(png::ColorType::Rgba);
    png.write_header()?.write_image_data(&picture)?;
    Ok(())
}

/// Draws frames of the head's clip; returns the last picture, four bytes per pixel.
pub fn draw(device: &wgpu::Device, queue: &wgpu::Queue, frames: usize) -> Result<Vec<u8>, Box<dyn Error>> {
    // The mesh, packed for the device, and a crowd of one instance.
    let head_desc = HeadDesc { vertices: 10_000, ..Default::default() };
    let morph = Morph::new(device, queue)?;
    let packed = head(&head_desc).pack(&morph.pack_desc(DeltaFormat::Fast))?;
    let mesh = morph.upload(&packed)?;
    let mut crowd = morph.create_crowd(&mesh, &CrowdDesc::new(UpdateDesc::blocks()))?;
    let names: Vec<&str> = packed.layout().targets.iter().map(|target| target.name.as_str()).collect();
    let clip = head_clip(&head_desc, frames, 30.0).bind(&names)?;

    // A pipeline that reads poses as vertices. Packing reorders vertices: the layout has the indices to draw with.
    let input = VertexInput::new(PoseFormat::Float32, 0, false)?;
    let source = wgpu::ShaderSource::Wgsl((input.wgsl() + SHADER).into());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            buffers: &input.layouts(),
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
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
            targets: &[Some(COLOR.into())],
        }),
        multiview_mask: None,
        cache: None,
    });
    let indices = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: None,
        contents: &packed.layout().indices.iter().flat_map(|index| index.to_ne_bytes()).collect::<Vec<_>>(),
        usage: wgpu::BufferUsages::INDEX,
    });
    let texture = |format| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: EDGE, height: EDGE, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    };
    let [color, depth] = [COLOR, DEPTH].map(texture);
    let [color_view, depth_view] = [&color, &depth].map(|texture| texture.create_view(&Default::default()));

    for weights in clip.frames() {
        // Each frame: weights, an update, and draws that read the pose.
        crowd.set_weights(0, &weights)?;
        let update = morph.update([&mut crowd])?;
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &color_view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth_view,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_vertex_buffer(0, crowd.pose(0)?.slice());
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..packed.layout().indices.len() as u32, 0, 0..1);
        drop(pass);
        queue.submit(update.into_iter().chain([encoder.finish()]));
    }

    // The picture is read back.
    let picture = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(4 * EDGE * EDGE),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * EDGE), rows_per_image: None };
    let copy = wgpu::TexelCopyBufferInfo { buffer: &picture, layout };
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(color.as_image_copy(), copy, color.size());
    queue.submit([encoder.finish()]);
    picture.map_async(wgpu::MapMode::Read, .., |mapped| mapped.expect("a buffer for the host to read"));
    device.poll(wgpu::PollType::wait_indefinitely())?;
    Ok(picture.get_mapped_range(..)?.to_vec())
}
