//! Draws that read poses: those of a crowd, and those of the path `cpu`, uploaded from main memory.

use super::Headless;
use super::submit::Readback;
use super::wait::full_barrier;
use crate::abi::modules::{CONSUME, CONSUME_POSITION};
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::pipelines::Objects;
use crate::gpu::statistics::MemoryKind;
use deltamorph::ash::vk;
use deltamorph::{DeltaFormat, Error, PackedLayout, PoseFormat, Result};
use std::iter::repeat_n;
use std::sync::Arc;
use std::time::Instant;

/// The draws of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Draws {
    /// Draws of each instance in a pass.
    pub copies: u32,
    /// Passes. The last one reads whole vertices, those before it positions alone, as passes for depth and shadows do.
    pub passes: u32,
}

impl Draws {
    /// Whether there are any.
    pub fn any(self) -> bool {
        self.copies > 0 && self.passes > 0
    }

    /// For each pass, whether it reads positions alone.
    pub(super) fn passes(self) -> impl Iterator<Item = bool> {
        (1..=self.passes).map(move |pass| pass < self.passes)
    }
}

/// Draws that read poses as vertex attributes and discard every primitive, to measure the cost of reading them.
pub struct PoseDraw {
    /// Pipelines: one that reads whole vertices, one that reads positions.
    objects: Objects,
}

impl PoseDraw {
    /// Makes draws for poses of a format.
    pub fn new(device: &Arc<Device>, pose: PoseFormat) -> Result<Self> {
        let mut objects = Objects::none(device);
        objects.add_layout(&[CONSUME.row], 0)?;
        objects.add_empty_render_pass()?;
        let (bindings, attributes) = pose.vertex_input();
        for (kernel, attributes) in [(&CONSUME, &attributes[..]), (&CONSUME_POSITION, &attributes[..1])] {
            // It reads no deltas, so the module is the same for all delta formats.
            let module = kernel.module(DeltaFormat::Float32.row(), pose.row(), 0)?;
            objects.add_discarding_vertex(module, &bindings, attributes)?;
        }
        Ok(Self { objects })
    }

    /// Draws `vertices` vertices, or their `positions` alone, of each pose, given by its buffer and offset. `cmd` is
    /// recording outside a render pass, and the poses are ready for vertex-attribute reads.
    pub fn record(
        &self,
        cmd: vk::CommandBuffer,
        poses: impl Iterator<Item = (vk::Buffer, u64)>,
        vertices: u32,
        positions: bool,
    ) {
        let device = &self.objects.device.raw;
        // SAFETY: `cmd` is recording (see above); pipeline and render pass are ours; each pose has `vertices`.
        unsafe {
            self.objects.begin_render_pass(cmd);
            device.cmd_bind_pipeline(
                cmd,
                vk::PipelineBindPoint::GRAPHICS,
                self.objects.pipelines[usize::from(positions)],
            );
            for (buffer, offset) in poses {
                device.cmd_bind_vertex_buffers(cmd, 0, &[buffer], &[offset]);
                device.cmd_draw(cmd, vertices, 1, 0, 0);
            }
            device.cmd_end_render_pass(cmd);
        }
    }
}

/// Uploads poses of a [`CpuCrowd`](deltamorph::CpuCrowd) to a device-local vertex buffer, through staging memory.
pub struct PoseUpload<'a> {
    headless: &'a Headless,
    staging: Buffer,
    poses: Buffer,
    draw: PoseDraw,
    pose_bytes: u64,
    vertices: u32,
    instances: u32,
}

impl<'a> PoseUpload<'a> {
    /// Makes buffers for the poses of `instances` instances of a mesh with this `layout`.
    ///
    /// # Errors
    /// No instances; out of memory.
    pub fn new(headless: &'a Headless, layout: &PackedLayout, instances: u32) -> Result<Self> {
        let (pose_bytes, vertices) = (layout.pose_bytes(PoseFormat::Float32), layout.padded_vertices() as u32);
        let bytes = pose_bytes.saturating_mul(instances.into());
        if instances == 0 || bytes == 0 {
            return Err(Error::invalid(
                "an upload of an empty list of poses",
                "pass at least one, or leave the upload out",
            ));
        }
        let device = headless.engine.device();
        let buffer = |name, usage, kind| Buffer::new(device, name, bytes, usage, kind);
        let mut staging = buffer("poses to upload", vk::BufferUsageFlags::TRANSFER_SRC, MemoryKind::Staging)?;
        staging.mapped()?;
        let usage = vk::BufferUsageFlags::VERTEX_BUFFER
            | vk::BufferUsageFlags::TRANSFER_DST
            | vk::BufferUsageFlags::TRANSFER_SRC;
        let poses = buffer("uploaded poses", usage, MemoryKind::Poses)?;
        let draw = PoseDraw::new(device, PoseFormat::Float32)?;
        Ok(Self { headless, staging, poses, draw, pose_bytes, vertices, instances })
    }

    /// Uploads the pose of each instance, as returned by [`CpuCrowd::pose`](deltamorph::CpuCrowd::pose), makes it ready
    /// for vertex-attribute reads, and waits. Returns milliseconds from poses in main memory to the fence: write to
    /// staging memory, copy, wait.
    ///
    /// # Errors
    /// Too few or too many poses, or one of the wrong size; the device fails.
    pub fn upload(&mut self, poses: &[&[f32]]) -> Result<f64> {
        let (pose_bytes, start) = (self.pose_bytes as usize, Instant::now());
        if poses.len() != self.instances as usize || poses.iter().any(|pose| size_of_val(*pose) != pose_bytes) {
            return Err(Error::invalid(
                format!("{} poses for an upload of {} with {pose_bytes} bytes each", poses.len(), self.instances),
                "hand in the pose of every instance as CpuCrowd::pose returns it, of the same mesh",
            ));
        }
        for (pose, staged) in poses.iter().zip(self.staging.mapped()?.chunks_exact_mut(pose_bytes)) {
            staged.copy_from_slice(bytemuck::cast_slice(pose));
        }
        let size = (pose_bytes * poses.len()) as u64;
        let (submitter, region) = (&self.headless.submitter, [vk::BufferCopy { src_offset: 0, dst_offset: 0, size }]);
        submitter.run(|cmd| {
            // SAFETY: the buffer is recording on this device; the region lies within both buffers, which are alive;
            // nothing is running, since each submission is waited for.
            unsafe { submitter.device.cmd_copy_buffer(cmd, self.staging.raw, self.poses.raw, &region) };
            full_barrier(&submitter.device, cmd, vk::PipelineStageFlags::ALL_COMMANDS);
            Ok(())
        })?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Draws every uploaded pose, discarding all primitives; returns device time in milliseconds.
    ///
    /// # Errors
    /// The device fails.
    pub fn draw(&self, draws: Draws) -> Result<Option<f64>> {
        let pose = |instance: u32| (self.poses.raw, u64::from(instance) * self.pose_bytes);
        let ((), [ms, _]) = self.headless.submitter.run_timed(|cmd, _| {
            for positions in draws.passes() {
                let poses = (0..self.instances).flat_map(|i| repeat_n(pose(i), draws.copies as usize));
                self.draw.record(cmd, poses, self.vertices, positions);
            }
            Ok(())
        })?;
        Ok(ms)
    }

    /// Reads the last upload back: the poses of all instances in order, as they were passed in.
    ///
    /// # Errors
    /// The device fails.
    pub fn read(&mut self) -> Result<Vec<f32>> {
        let (size, Headless { engine, submitter, .. }) = (self.pose_bytes * u64::from(self.instances), self.headless);
        Readback::new(engine.device(), size)?.read(submitter, (self.poses.raw, 0, size))
    }
}
