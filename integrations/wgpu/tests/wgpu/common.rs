//! Adapters under the validation layers, random weights, and readers of all kinds.

use crate::layers::listen;
pub use crate::layers::messages;
use crate::testing;
use deltamorph::ash::{self, vk};
use deltamorph::reference::{compare, evaluate};
use deltamorph::{DeltaFormat, PackedMesh, PoseFormat, PoseView};
use deltamorph_head::Rng;
use deltamorph_wgpu::{Crowd, Mesh, Morph, POSE_WGSL, Pose, VertexInput};
use std::sync::{Mutex, Once, PoisonError};
use wgpu::util::DeviceExt as _;

/// A device and its queue.
pub struct Host {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
}

impl Host {
    pub fn new(adapter: &wgpu::Adapter) -> Self {
        // `DrawReader` writes from vertex shaders.
        let optional = wgpu::Features::SHADER_INT64 | wgpu::Features::VERTEX_WRITABLE_STORAGE;
        let required_features = adapter.features() & optional;
        let desc = wgpu::DeviceDescriptor { required_features, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&desc)).expect("a device");
        Self { device, queue }
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
    pub fn read(&self, buffer: &wgpu::Buffer) -> Vec<u8> {
        buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.expect("mapped"));
        wait(self);
        let bytes = buffer.get_mapped_range(..).expect("mapped").to_vec();
        buffer.unmap();
        bytes
    }
}

/// Returns whether the validation layers have version 1.4 or later. Tests of planted faults show that they are active.
fn layers_are_new() -> bool {
    // SAFETY: the loader is the one that wgpu loads.
    let layers = unsafe { ash::Entry::load() }.map(|entry| {
        // SAFETY: as above.
        unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default()
    });
    let is_new = |layer: &vk::LayerProperties| {
        layer.layer_name_as_c_str() == Ok(c"VK_LAYER_KHRONOS_validation")
            && layer.spec_version >= vk::make_api_version(0, 1, 4, 0)
    };
    layers.is_ok_and(|layers| layers.iter().any(is_new))
}

/// Runs `test` on each driver, one test at a time. A missing driver fails, and so does every message of the layers.
pub fn on_every_adapter(test: impl Fn(Host)) {
    static TURN: Mutex<()> = Mutex::new(());
    static LISTEN: Once = Once::new();
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    LISTEN.call_once(|| {
        // Updates and draws are in separate command buffers. Newer layers compare these at a submit by default.
        if !layers_are_new() {
            let enable = "VALIDATION_CHECK_ENABLE_SYNCHRONIZATION_VALIDATION_QUEUE_SUBMIT";
            // SAFETY: no other thread reads the environment: other tests wait for their turn.
            unsafe { std::env::set_var("VK_LAYER_ENABLES", enable) };
        }
    });
    listen();
    drop(messages());
    let drivers = std::env::var("DELTAMORPH_TEST_DRIVERS").unwrap_or_else(|_| "llvmpipe".into());
    for driver in drivers.split(',') {
        let desc = wgpu::InstanceDescriptor::new_without_display_handle();
        let flags = wgpu::InstanceFlags::VALIDATION | wgpu::InstanceFlags::DEBUG;
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor { flags, ..desc });
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
        let mut adapters = adapters.into_iter().filter(|adapter| adapter.get_info().name.contains(driver));
        let adapter = adapters.next().unwrap_or_else(|| panic!("{driver} is missing: use ./with-vulkan cargo test"));
        test(Host::new(&adapter));
        drop((adapter, adapters, instance));
        let messages = messages();
        assert!(messages.is_empty(), "{driver}: the layers say:\n{}", messages.join("\n"));
    }
}

/// Changes one weight in three.
pub fn change(rng: &mut Rng, weights: &mut [f32]) {
    for weight in weights {
        if rng.below(3) == 0 {
            *weight = rng.below(65) as f32 / 64.0;
        }
    }
}

/// Makes a small mesh, and weights for it, all 0.
pub fn packed(morph: &Morph, format: DeltaFormat) -> (PackedMesh, Vec<f32>) {
    let mesh = PackedMesh::pack(&testing::mesh(300, 23), &morph.pack_desc(format)).expect("a mesh that fits");
    let weights = vec![0.0; mesh.layout().targets.len()];
    (mesh, weights)
}

/// Makes a morph for the device of a host, and a small mesh for it in its memory, with weights, all 0.
pub fn uploaded(host: &Host, format: DeltaFormat) -> (Morph, PackedMesh, Mesh, Vec<f32>) {
    let morph = Morph::new(&host.device, &host.queue).expect("a device with compute");
    let (mesh, weights) = packed(&morph, format);
    let uploaded = morph.upload(&mesh).expect("an upload");
    (morph, mesh, uploaded, weights)
}

/// Asserts that these float32 numbers are the pose of the weights.
pub fn assert_right(pose: &[f32], mesh: &PackedMesh, weights: &[f32], format: PoseFormat, what: &str) {
    let error = compare(&mesh.layout().to_user_order(pose), &evaluate(mesh, weights));
    let relative = if format.stride() == 12 { 2e-4 } else { 3e-6 };
    let degrees = if format.stride() == 12 { 0.2 } else { 0.01 };
    assert!(error.within(relative * f64::from(mesh.layout().diagonal), degrees), "{what}: {error:?}");
}

/// Copies a pose in `encoder`, for [`Host::read`].
pub fn copy(host: &Host, encoder: &mut wgpu::CommandEncoder, pose: &Pose<'_>) -> wgpu::Buffer {
    let copy = host.readback(pose.view.size);
    encoder.copy_buffer_to_buffer(pose.buffer, pose.view.offset, &copy, 0, pose.view.size);
    copy
}

/// Submits an update, and reads the resulting pose.
pub fn submit_and_read(host: &Host, update: Option<wgpu::CommandBuffer>, crowd: &Crowd) -> Vec<u8> {
    let mut encoder = host.device.create_command_encoder(&Default::default());
    let copy = copy(host, &mut encoder, &crowd.pose(0).expect("a pose"));
    host.queue.submit(update.into_iter().chain([encoder.finish()]));
    host.read(&copy)
}

/// Waits until all submitted work has finished.
pub fn wait(host: &Host) {
    host.device.poll(wgpu::PollType::wait_indefinitely()).expect("a device that is not lost");
}

/// Makes a submit that fails, with `commands` in it.
pub fn submit_in_vain(host: &Host, commands: Option<wgpu::CommandBuffer>) {
    let [from, to] = [0, 1].map(|_| host.filled(&[0; 4], wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST));
    let mut encoder = host.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(&from, 0, &to, 0, 4);
    let spoilt = encoder.finish();
    from.destroy();
    let scope = host.device.push_error_scope(wgpu::ErrorFilter::Validation);
    host.queue.submit(commands.into_iter().chain([spoilt]));
    pollster::block_on(scope.pop()).expect("an error: the buffer was destroyed");
}

/// Decodes the numbers of a pose on the CPU.
pub fn decoded(pose: &[u8], view: &PoseView) -> Vec<f32> {
    if !view.format.has_integers() {
        return view.format.decode(pose, None);
    }
    let numbers = view.format.integers(pose).into_iter().enumerate();
    numbers.map(|(i, number)| view.offsets[i % 6] + number as f32 * view.units[i % 6]).collect()
}

/// What shaders decode: float32 positions and normals, written to a buffer.
struct Decoded {
    vertices: u32,
    matrix: wgpu::Buffer,
    numbers: wgpu::Buffer,
}

impl Decoded {
    const WGSL: &str = "
        @group(0) @binding(0) var<uniform> matrix: mat4x4f;
        @group(0) @binding(1) var<storage, read_write> decoded: array<f32>;

        fn store(i: u32, pose: PoseVertex) {
            let position = matrix * vec4f(pose.position, 1.0);
            for (var k = 0u; k < 3u; k++) {
                decoded[6u * i + k] = position[k];
                decoded[6u * i + 3u + k] = pose.normal[k];
            }
        }";

    /// Makes room for the vertices of `poses` poses.
    fn new(host: &Host, view: &PoseView, poses: u32) -> Self {
        let vertices = (view.size / u64::from(view.stride)) as u32;
        let matrix = view.matrix().to_cols_array().map(f32::to_ne_bytes).concat();
        let numbers = vec![0; (24 * vertices * poses) as usize];
        Self {
            vertices,
            matrix: host.filled(&matrix, wgpu::BufferUsages::UNIFORM),
            numbers: host.filled(&numbers, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC),
        }
    }

    fn bind_group(&self, host: &Host, layout: &wgpu::BindGroupLayout, pose: Option<&Pose<'_>>) -> wgpu::BindGroup {
        let own = [self.matrix.as_entire_binding(), self.numbers.as_entire_binding()];
        let resources = own.into_iter().chain(pose.map(Pose::binding));
        let entries = (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource });
        let entries: Vec<_> = entries.collect();
        host.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    /// Copies the numbers, for [`Host::read`].
    fn copy(&self, host: &Host, encoder: &mut wgpu::CommandEncoder) -> wgpu::Buffer {
        let copy = host.readback(self.numbers.size());
        encoder.copy_buffer_to_buffer(&self.numbers, 0, &copy, 0, copy.size());
        copy
    }
}

/// Decodes poses from a storage buffer in a compute shader.
pub struct ComputeReader {
    pipeline: wgpu::ComputePipeline,
    decoded: Decoded,
}

impl ComputeReader {
    pub fn new(host: &Host, view: &PoseView) -> Self {
        let read = match view.format.decoder() {
            "fixed16" => "pose_words_fixed16(three(3u * i))".into(),
            other => format!("pose_words_{other}(three(6u * i), three(6u * i + 3u))"),
        };
        let source = format!(
            "{POSE_WGSL}{}
            @group(0) @binding(2) var<storage, read> words: array<u32>;

            fn three(at: u32) -> vec3u {{
                return vec3u(words[at], words[at + 1u], words[at + 2u]);
            }}

            @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {{
                let i = id.x;
                if 6u * i < arrayLength(&decoded) {{ store(i, {read}); }}
            }}",
            Decoded::WGSL
        );
        let source = wgpu::ShaderSource::Wgsl(source.into());
        let module = host.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let pipeline = host.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline, decoded: Decoded::new(host, view, 1) }
    }

    /// Decodes a pose, for [`Host::read`].
    pub fn record(&self, host: &Host, encoder: &mut wgpu::CommandEncoder, pose: &Pose<'_>) -> wgpu::Buffer {
        let bindings = self.decoded.bind_group(host, &self.pipeline.get_bind_group_layout(0), Some(pose));
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.dispatch_workgroups(self.decoded.vertices.div_ceil(64), 1, 1);
        drop(pass);
        self.decoded.copy(host, encoder)
    }
}

/// Decodes poses from vertex attributes in a vertex shader: with `previous`, also the previous pose.
pub struct DrawReader {
    pipeline: wgpu::RenderPipeline,
    target: wgpu::TextureView,
    decoded: Decoded,
}

impl DrawReader {
    pub fn new(host: &Host, view: &PoseView, previous: bool) -> Self {
        // After attributes of the host's own.
        let input = VertexInput::new(view.format, 3, previous).expect("attributes");
        let decoded = Decoded::new(host, view, 1 + u32::from(previous));
        let second = match previous {
            true => format!("store({}u + i, previous_input(in));", decoded.vertices),
            false => String::new(),
        };
        let source = format!(
            "{}{}
            @vertex fn vertex(in: PoseInput, @builtin(vertex_index) i: u32) -> @builtin(position) vec4f {{
                store(i, pose_input(in));
                {second}
                return vec4f(0.0, 0.0, 0.0, 1.0);
            }}

            @fragment fn fragment() -> @location(0) vec4f {{ return vec4f(1.0); }}",
            input.wgsl(),
            Decoded::WGSL
        );
        let source = wgpu::ShaderSource::Wgsl(source.into());
        let module = host.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let format = wgpu::TextureFormat::Rgba8Unorm;
        let pipeline = host.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                buffers: &input.layouts(),
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let target = host.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: 16, height: 16, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        Self { pipeline, target: target.create_view(&Default::default()), decoded }
    }

    /// Decodes poses, one after the other, for [`Host::read`].
    pub fn record(&self, host: &Host, encoder: &mut wgpu::CommandEncoder, poses: &[Pose<'_>]) -> wgpu::Buffer {
        let bindings = self.decoded.bind_group(host, &self.pipeline.get_bind_group_layout(0), None);
        let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store };
        let (view, depth_slice, resolve_target) = (&self.target, None, None);
        let color = wgpu::RenderPassColorAttachment { view, depth_slice, resolve_target, ops };
        let desc = wgpu::RenderPassDescriptor { color_attachments: &[Some(color)], ..Default::default() };
        let mut pass = encoder.begin_render_pass(&desc);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        (0..).zip(poses).for_each(|(slot, pose)| pass.set_vertex_buffer(slot, pose.slice()));
        pass.draw(0..self.decoded.vertices, 0..1);
        drop(pass);
        self.decoded.copy(host, encoder)
    }
}
