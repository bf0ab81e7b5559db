//! A view into the render world, for tests.

use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::prelude::*;
use bevy::render::mesh::allocator::MeshAllocator;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::{Render, RenderApp, RenderSystems};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Observations in the render world.
#[derive(Default)]
pub struct Probed {
    /// The mesh to observe.
    pub mesh: Option<AssetId<Mesh>>,
    /// The number of its `MorphAttributes` elements on the device.
    pub elements: u64,
    /// Its vertices on the device, as packed by Bevy; the number of bytes is that of the vector's old contents.
    pub vertices: Vec<u8>,
    /// Motion vectors of each pixel, for each frame with motion.
    pub motion: Vec<Vec<[f32; 2]>>,
}

/// Observes the render world.
#[derive(Resource, Clone, Default)]
pub struct Probe(Arc<Mutex<Probed>>);

impl Probe {
    pub fn lock(&self) -> MutexGuard<'_, Probed> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn add_to(&self, app: &mut App) {
        let render = app.sub_app_mut(RenderApp);
        render.insert_resource(self.clone()).add_systems(Render, probe.in_set(RenderSystems::Cleanup));
    }
}

fn probe(
    probe: Res<Probe>,
    allocator: Res<MeshAllocator>,
    prepasses: Query<&ViewPrepassTextures>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let mut probed = probe.lock();
    let slice = probed.mesh.and_then(|mesh| allocator.mesh_morph_target_slice(&mesh));
    probed.elements = slice.map_or(0, |slice| slice.range.len() as u64);
    if let Some(slice) = probed.mesh.and_then(|mesh| allocator.mesh_vertex_slice(&mesh)) {
        let bytes = probed.vertices.len() as u64;
        let begin = bytes / slice.range.len().max(1) as u64 * u64::from(slice.range.start);
        probed.vertices = copied(device.wgpu_device(), &queue, slice.buffer, begin, bytes);
    }
    for prepass in &prepasses {
        let Some(view) = prepass.motion_vectors_view() else { continue };
        let motion = read(device.wgpu_device(), &queue, view, prepass.size.width, prepass.size.height);
        if motion.iter().flatten().any(|speed| *speed != 0.0) {
            probed.motion.push(motion);
        }
    }
}

/// Reads the texels of a texture that can be bound, and nothing else.
fn read(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    view: &wgpu::TextureView,
    width: u32,
    height: u32,
) -> Vec<[f32; 2]> {
    let source = "
        @group(0) @binding(0) var motion: texture_2d<f32>;
        @group(0) @binding(1) var<storage, read_write> texels: array<vec2f>;
        @compute @workgroup_size(8, 8)
        fn read(@builtin(global_invocation_id) id: vec3u) {
            let size = textureDimensions(motion);
            if all(id.xy < size) {
                texels[id.y * size.x + id.x] = textureLoad(motion, id.xy, 0).xy;
            }
        }";
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: None,
        compilation_options: Default::default(),
        cache: None,
    });
    let size = u64::from(width * height) * 8;
    let texels = empty(device, size, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let bound = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(view) },
            wgpu::BindGroupEntry { binding: 1, resource: texels.as_entire_binding() },
        ],
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &bound, &[]);
    pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
    drop(pass);
    queue.submit([encoder.finish()]);
    let bytes = copied(device, queue, &texels, 0, size);
    let float = |bytes: &[u8]| f32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    bytes.chunks_exact(8).map(|texel| [float(&texel[..4]), float(&texel[4..])]).collect()
}

fn empty(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

/// Reads a range of a buffer.
fn copied(device: &wgpu::Device, queue: &wgpu::Queue, buffer: &wgpu::Buffer, begin: u64, size: u64) -> Vec<u8> {
    if size == 0 {
        return vec![];
    }
    let copy = empty(device, size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, begin, &copy, 0, size);
    queue.submit([encoder.finish()]);
    copy.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("mapped"));
    device.poll(wgpu::PollType::wait_indefinitely()).expect("the device is alive");
    copy.slice(..).get_mapped_range().expect("mapped").to_vec()
}
