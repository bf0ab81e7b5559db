//! Ray tracing of poses: an acceleration structure over vertices that the step `decode` keeps in a buffer of the host.
//! Each update decodes the blocks that changed, refits the structure and traces a picture with ray queries, which is
//! compared with the rasterised one. Run as `cargo run -p deltamorph-render --example rays [FOLDER]`, on a device with
//! VK_KHR_ray_query; pictures go to the folder.

use deltamorph::after::DecodeTarget;
use deltamorph::ash::{self, khr, vk};
use deltamorph::internals::gpu::memory::Buffer;
use deltamorph::internals::gpu::statistics::MemoryKind;
use deltamorph::{Consumers, CrowdDesc, DeltaFormat, PackedMesh, PoseFormat, Tolerance, UpdateDesc};
use deltamorph_head::{HeadDesc, head, head_clip};
use deltamorph_headless::{Headless, HeadlessDesc};
use deltamorph_render::{Camera, Light, Picture, Poses, Scene, Show, Studio, StudioDesc, parts};
use glam::{Mat4, Vec4};
use std::slice::{from_raw_parts, from_ref};
use vk::{
    AccelerationStructureGeometryDataKHR as Data, AccelerationStructureTypeKHR as Level, GeometryTypeKHR as Kind,
};
use vk::{AccessFlags as Access, BufferUsageFlags as Usage, PipelineStageFlags as Stage};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;
/// Bytes of a decoded vertex: position and normal.
const VERTEX: u32 = 24;
/// Pixels differ if a channel differs by more, in units of 1/255: both pictures are rounded.
const TOLERANCE: u8 = 2;

struct Gpu<'a> {
    headless: &'a Headless,
    structures: khr::acceleration_structure::Device,
    addresses: khr::buffer_device_address::Device,
}

impl Gpu<'_> {
    /// Makes a buffer and takes its address. With contents, the host writes them. Any allocator of a host will do.
    fn buffer(&self, bytes: u64, usage: Usage, contents: &[u8]) -> Result<(Buffer, vk::DeviceAddress)> {
        let kind = if contents.is_empty() { MemoryKind::Poses } else { MemoryKind::Staging };
        let usage = usage | Usage::SHADER_DEVICE_ADDRESS;
        let mut buffer = Buffer::new(self.headless.engine().device(), "rays", bytes, usage, kind)?;
        if !contents.is_empty() {
            buffer.mapped()?[..contents.len()].copy_from_slice(contents);
        }
        let info = vk::BufferDeviceAddressInfo::default().buffer(buffer.raw);
        // SAFETY: the buffer has this usage and memory.
        let address = unsafe { self.addresses.get_buffer_device_address(&info) };
        Ok((buffer, address))
    }
}

/// An acceleration structure of one geometry.
struct Structure<'a> {
    gpu: &'a Gpu<'a>,
    raw: vk::AccelerationStructureKHR,
    level: Level,
    geometry: vk::AccelerationStructureGeometryKHR<'a>,
    /// Triangles or instances.
    count: u32,
    scratch: vk::DeviceOrHostAddressKHR,
    buffers: Vec<Buffer>,
}

impl<'a> Structure<'a> {
    fn new(gpu: &'a Gpu<'a>, level: Level, (kind, data): (Kind, Data<'a>), count: u32) -> Result<Self> {
        let geometry = vk::AccelerationStructureGeometryKHR::default().flags(vk::GeometryFlagsKHR::OPAQUE);
        let (geometry, scratch) = (geometry.geometry_type(kind).geometry(data), Default::default());
        let mut this = Self { gpu, raw: Default::default(), level, geometry, count, scratch, buffers: vec![] };
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        let on = vk::AccelerationStructureBuildTypeKHR::DEVICE;
        // SAFETY: the extension is enabled.
        unsafe { gpu.structures.get_acceleration_structure_build_sizes(on, &this.info(), &[count], &mut sizes) };
        let size = sizes.acceleration_structure_size;
        let (storage, _) = gpu.buffer(size, Usage::ACCELERATION_STRUCTURE_STORAGE_KHR, &[])?;
        // No device asks for an alignment above 256.
        let most = sizes.build_scratch_size.max(sizes.update_scratch_size) + 256;
        let (scratch, device_address) = gpu.buffer(most, Usage::STORAGE_BUFFER, &[])?;
        this.scratch = vk::DeviceOrHostAddressKHR { device_address: device_address.next_multiple_of(256) };
        let info = vk::AccelerationStructureCreateInfoKHR::default().buffer(storage.raw).size(size).ty(level);
        // SAFETY: the buffer is large enough, and lives as long as the structure.
        this.raw = unsafe { gpu.structures.create_acceleration_structure(&info, None) }?;
        this.buffers = vec![storage, scratch];
        Ok(this)
    }

    fn info(&self) -> vk::AccelerationStructureBuildGeometryInfoKHR<'_> {
        let info = vk::AccelerationStructureBuildGeometryInfoKHR::default().geometries(from_ref(&self.geometry));
        let info = info.ty(self.level).flags(vk::BuildAccelerationStructureFlagsKHR::ALLOW_UPDATE);
        info.dst_acceleration_structure(self.raw).scratch_data(self.scratch)
    }

    fn address(&self) -> vk::DeviceAddress {
        let info = vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(self.raw);
        // SAFETY: the structure is alive.
        unsafe { self.gpu.structures.get_acceleration_structure_device_address(&info) }
    }

    /// Records a build; or a refit of what was built, whose triangles have moved.
    ///
    /// # Safety
    /// `cmd` is recording, and what the structure is built from is ready for builds.
    unsafe fn build(&self, cmd: vk::CommandBuffer, is_refit: bool) {
        let (info, refit) = (self.info(), vk::BuildAccelerationStructureModeKHR::UPDATE);
        let info = if is_refit { info.mode(refit).src_acceleration_structure(self.raw) } else { info };
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(self.count);
        // SAFETY: the caller's obligations; the structure was made for this geometry.
        unsafe { self.gpu.structures.cmd_build_acceleration_structures(cmd, &[info], &[&[range]]) };
    }
}

impl Drop for Structure<'_> {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, and not in use: `Headless::run` waits.
        unsafe { self.gpu.structures.destroy_acceleration_structure(self.raw, None) };
    }
}

/// The block `Push` of glsl/rays.comp.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Push {
    from_clip: Mat4,
    eye: Vec4,
    /// Addresses of the structure, vertices, corners of triangles, and pixels.
    addresses: [u64; 4],
}

struct Tracer<'a> {
    device: &'a ash::Device,
    layout: vk::PipelineLayout,
    pipeline: vk::Pipeline,
}

impl<'a> Tracer<'a> {
    fn new(device: &'a ash::Device) -> Result<Self> {
        let mut this = Self { device, layout: Default::default(), pipeline: Default::default() };
        let stage = vk::ShaderStageFlags::COMPUTE;
        let constants = [vk::PushConstantRange::default().stage_flags(stage).size(size_of::<Push>() as u32)];
        let layout = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&constants);
        let shader = include_bytes!("../spirv/rays.comp.spv");
        let words: Vec<u32> = shader.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
        let module = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: everything is made on one device; the layout is the module's.
        unsafe {
            this.layout = device.create_pipeline_layout(&layout, None)?;
            let module = device.create_shader_module(&module, None)?;
            let stage = vk::PipelineShaderStageCreateInfo::default().stage(stage).module(module).name(c"main");
            let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(this.layout);
            let made = device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
            device.destroy_shader_module(module, None);
            this.pipeline = made.map_err(|(_, error)| error)?[0];
        }
        Ok(this)
    }
}

impl Drop for Tracer<'_> {
    fn drop(&mut self) {
        // SAFETY: as above; what was not made is null.
        unsafe {
            self.device.destroy_pipeline(self.pipeline, None);
            self.device.destroy_pipeline_layout(self.layout, None);
        }
    }
}

/// A traced picture, and how it differs from the rasterised one.
#[derive(Debug)]
pub struct Traced {
    /// The picture.
    pub picture: Picture,
    /// Blocks that the update decoded.
    pub blocks: usize,
    /// Pixels of the head: all, and those where no triangles meet.
    pub seen: [usize; 2],
    /// Pixels that differ: all, and those where no triangles meet.
    pub different: [usize; 2],
}

/// Traces the built-in head at rest and at `moments` of its clip, an update each. The size is a multiple of 8.
pub fn run(headless: &Headless, pose: PoseFormat, size: [u32; 2], moments: usize) -> Result<Vec<Traced>> {
    let desc = HeadDesc::default().vertices(6000);
    let mesh = head(&desc).to_mesh(Tolerance::default())?;
    let packed = PackedMesh::pack(&mesh, &headless.engine().pack_desc(DeltaFormat::Fast))?;
    let (parts, count) = (parts(&mesh, &[""; 0]), packed.layout().vertex_count as u32);
    let mut corners: Vec<u32> = parts.iter().flat_map(|part| part.triangles.iter().flatten().copied()).collect();
    packed.layout().remap_indices(&mut corners)?;
    let camera = Camera { yaw: 25.0, ..Camera::default() };
    let view = camera.fit(mesh.positions.iter().copied(), size[0] as f32 / size[1] as f32, 0.05);
    let scene = Scene { view, light: Light::default(), show: Show::Normals };

    let (instance, _, device) = headless.handles();
    let structures = khr::acceleration_structure::Device::new(instance, device);
    let addresses = khr::buffer_device_address::Device::new(instance, device);
    let gpu = Gpu { headless, structures, addresses };
    let (shader, input) = (Usage::STORAGE_BUFFER, Usage::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR);
    let pixel_bytes = 8 * u64::from(size[0] * size[1]);
    let (pixels, pixels_at) = gpu.buffer(pixel_bytes, shader | Usage::TRANSFER_SRC, &[])?;
    let (vertices, vertices_at) = gpu.buffer(u64::from(VERTEX * count), shader | input, &[])?;
    let bytes: &[u8] = bytemuck::cast_slice(&corners);
    let (_corners, corners_at) = gpu.buffer(bytes.len() as u64, shader | input, bytes)?;
    let at = |device_address| vk::DeviceOrHostAddressConstKHR { device_address };
    let floats =
        vk::AccelerationStructureGeometryTrianglesDataKHR::default().vertex_format(vk::Format::R32G32B32_SFLOAT);
    let vertices_of = floats.vertex_data(at(vertices_at)).vertex_stride(VERTEX.into()).max_vertex(count - 1);
    let triangles = vertices_of.index_type(vk::IndexType::UINT32).index_data(at(corners_at));
    let triangles = (Kind::TRIANGLES, Data { triangles });
    let shape = Structure::new(&gpu, Level::BOTTOM_LEVEL, triangles, corners.len() as u32 / 3)?;
    let instance = vk::AccelerationStructureInstanceKHR {
        transform: vk::TransformMatrixKHR { matrix: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0] },
        instance_custom_index_and_mask: vk::Packed24_8::new(0, 0xff),
        instance_shader_binding_table_record_offset_and_flags: vk::Packed24_8::new(0, 0),
        acceleration_structure_reference: vk::AccelerationStructureReferenceKHR { device_handle: shape.address() },
    };
    // SAFETY: an instance has no padding.
    let bytes = unsafe { from_raw_parts((&raw const instance).cast(), size_of_val(&instance)) };
    let (_instance, instance_at) = gpu.buffer(bytes.len() as u64, input, bytes)?;
    let instances = vk::AccelerationStructureGeometryInstancesDataKHR::default().data(at(instance_at));
    let world = Structure::new(&gpu, Level::TOP_LEVEL, (Kind::INSTANCES, Data { instances }), 1)?;
    let tracer = Tracer::new(device)?;
    let addresses = [world.address(), vertices_at, corners_at, pixels_at];
    let push = Push { from_clip: view.clip.inverse(), eye: view.eye.extend(1.0), addresses };

    let (engine, update) = (headless.engine(), UpdateDesc::blocks().pose(pose));
    // SAFETY: `run` hands out a recording buffer, and waits for it.
    let mut uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &packed) })?;
    // SAFETY: the upload has run.
    unsafe { uploaded.release_staging() };
    // Updates wait for these readers of decoded vertices, and make new ones visible to them.
    let readers = Consumers::ACCELERATION_STRUCTURES | Consumers::COMPUTE_SHADERS;
    let mut crowd = engine.create_crowd(&uploaded, &CrowdDesc::new(update).consumers(readers))?;
    let target = DecodeTarget::new(vertices.raw).stride(VERTEX).normals(Some(12));
    // SAFETY: the buffer is large enough, and outlives the crowd.
    unsafe { engine.set_decode_target(&mut crowd, 0, Some(&target)) }?;
    let studio = StudioDesc { size, heads: 1, in_flight: 1, update, afterglow: 0.0, cull: false };
    let mut studio = Studio::new(headless, &mesh, &packed, &parts, studio)?;

    let (rest, clip, mut all) = (vec![0.0; mesh.targets.len()], head_clip(&desc, moments, 2.0).values, vec![]);
    for weights in std::iter::once(&rest[..]).chain(clip.chunks_exact(rest.len())) {
        crowd.set_weights(0, weights)?;
        let stats = headless.run(|cmd| {
            let (build, trace) = (Stage::ACCELERATION_STRUCTURE_BUILD_KHR, Stage::COMPUTE_SHADER);
            let (write, read) = (Access::ACCELERATION_STRUCTURE_WRITE_KHR, Access::ACCELERATION_STRUCTURE_READ_KHR);
            let wait = |from, to, access| {
                let memory = [vk::MemoryBarrier::default().src_access_mask(write).dst_access_mask(access)];
                // SAFETY: `cmd` is recording on this device, outside a render pass.
                unsafe { device.cmd_pipeline_barrier(cmd, from, to, Default::default(), &memory, &[], &[]) };
            };
            // SAFETY: as above; it runs once, in order; all that it uses is of this device, and lives until the end.
            unsafe {
                let stats = engine.record_update(cmd, &mut crowd)?.stats;
                wait(build | trace, build, write | read); // for the picture before
                shape.build(cmd, !all.is_empty());
                wait(build, build, write | read);
                world.build(cmd, !all.is_empty());
                wait(build, trace, read);
                let (push, stages) = (bytemuck::bytes_of(&push), vk::ShaderStageFlags::COMPUTE);
                device.cmd_push_constants(cmd, tracer.layout, stages, 0, push);
                device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::COMPUTE, tracer.pipeline);
                device.cmd_dispatch(cmd, size[0] / 8, size[1] / 8, 1);
                Ok(stats)
            }
        })?;
        studio.draw(Poses::Weights(&[weights]), &[Mat4::IDENTITY], &scene, [0.0, 0.0, 0.0, 1.0])?;
        let picture = studio.finish()?.pop().ok_or("no picture")?;
        let results = headless.read(&[(pixels.raw, 0, pixel_bytes)])?.concat();
        let mut traced = Traced { picture, blocks: stats.dirty_blocks, seen: [0; 2], different: [0; 2] };
        for (result, pixel) in results.chunks_exact(8).zip(traced.picture.rgba.chunks_exact_mut(4)) {
            let is_different = result[..4].iter().zip(&*pixel).any(|(a, b)| a.abs_diff(*b) > TOLERANCE);
            for (sums, is) in [(&mut traced.seen, result[..3] != [0; 3]), (&mut traced.different, is_different)] {
                *sums = [sums[0] + usize::from(is), sums[1] + usize::from(is && result[4] == 0)];
            }
            pixel.copy_from_slice(&result[..4]);
        }
        all.push(traced);
    }
    Ok(all)
}

fn main() -> Result<()> {
    let folder = std::env::args().nth(1);
    let headless = Headless::new(&HeadlessDesc::default().ray_queries(true)).map_err(|error| error.to_string())?;
    println!("{}\npose     update  blocks  pixels  differ  where no triangles meet", headless.caps().name);
    for pose in [PoseFormat::Fixed16, PoseFormat::Float32] {
        for (i, traced) in run(&headless, pose, [480, 640], 10)?.iter().enumerate() {
            let Traced { picture, blocks, seen: [seen, _], different: [different, within] } = traced;
            let share = 100.0 * *different as f64 / *seen as f64;
            println!("{:8} {i:6} {blocks:7} {seen:7} {share:6.2}%  {within}", pose.name());
            let Some(folder) = &folder else { continue };
            let file = std::fs::File::create(format!("{folder}/rays-{}-{i:02}.png", pose.name()))?;
            let mut encoder = png::Encoder::new(file, picture.size[0], picture.size[1]);
            encoder.set_color(png::ColorType::Rgba);
            encoder.write_header()?.write_image_data(&picture.rgba)?;
        }
    }
    Ok(())
}
