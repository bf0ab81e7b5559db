//! A draw that reads a pose as vertex attributes and discards every primitive: what reading a pose costs.

use crate::abi::modules::CONSUME;
use crate::error::Result;
use crate::gpu::device::Device;
use crate::gpu::pipelines::Objects;
use crate::pack::{DeltaFormat, PoseFormat};
use ash::vk;
use std::sync::Arc;

pub(super) struct PoseDraw {
    objects: Objects,
}

impl PoseDraw {
    pub(super) fn new(device: &Arc<Device>, pose: PoseFormat) -> Result<Self> {
        let mut objects = Objects::none(device);
        objects.add_layout(&[CONSUME.row], 0)?;
        objects.add_empty_render_pass()?;
        let (binding, attributes) = pose.vertex_input();
        // It reads no deltas: the module is the same for each of their formats.
        let module = CONSUME.module(DeltaFormat::Float32, pose, 0)?;
        objects.add_discarding_vertex(module, &[binding], &attributes)?;
        Ok(Self { objects })
    }

    /// Draw `vertices` of each pose, by its buffer and offset. `cmd` is recording outside a render pass, and the poses
    /// are ready for vertex-attribute reads.
    pub(super) fn record(&self, cmd: vk::CommandBuffer, poses: impl Iterator<Item = (vk::Buffer, u64)>, vertices: u32) {
        let device = &self.objects.device.raw;
        // SAFETY: `cmd` is recording (see above); pipeline and render pass are ours; each pose has `vertices`.
        unsafe {
            self.objects.begin_render_pass(cmd);
            device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.objects.pipelines[0]);
            for (buffer, offset) in poses {
                device.cmd_bind_vertex_buffers(cmd, 0, &[buffer], &[offset]);
                device.cmd_draw(cmd, vertices, 1, 0, 0);
            }
            device.cmd_end_render_pass(cmd);
        }
    }
}
