//! The `direct-attributes` path (Gerdelan): the draw itself has the active targets as vertex attributes, next to the base
//! pose, and their weights as push constants. As many targets can be active as the device has attributes for.

use super::no_capture;
use super::vertex_store::{StoreSets, VertexStore};
use crate::abi::modules::DIRECT_ATTRIBUTES;
use crate::abi::push::attribute_push_bytes;
use crate::error::Result;
use crate::gpu::device::Device;
use crate::gpu::feedback::{Feedback, FeedbackPass, push_constants, vertex_buffers, vertex_input};
use crate::gpu::pipelines::Objects;
use crate::pack::{DeltaFormat, PackedLayout};
use crate::plan::{BatchSize, UpdatePath};
use crate::weights::delta::Coefficient;
use ash::vk;
use std::sync::Arc;

/// Pipelines for 0 active targets to the most.
pub(crate) struct Attributes {
    draw: Objects,
    capture: Option<Capture>,
    format: DeltaFormat,
    most: u32,
}

/// How a pose is captured: by a pass from the base pose of a path that evaluates the same (`attributes.glsl`).
enum Capture {
    Feedback(Feedback),
    Store(VertexStore),
}

/// Where it is captured.
pub(crate) struct CaptureTarget {
    poses: vk::Buffer,
    sets: Option<StoreSets>,
}

/// What a draw reads.
pub(crate) struct AttributesDraw<'a> {
    pub(crate) layout: &'a PackedLayout,
    pub(crate) base: vk::Buffer,
    pub(crate) deltas: vk::Buffer,
}

impl Attributes {
    pub(crate) fn new(device: &Arc<Device>, format: DeltaFormat, most: u32) -> Result<Self> {
        let mut draw = Objects::none(device);
        draw.add_layout(&[DIRECT_ATTRIBUTES.row], attribute_push_bytes(format, most))?;
        draw.add_empty_render_pass()?;
        for b in 0..=most {
            let (bindings, attributes) = vertex_input(format, b);
            draw.add_discarding_vertex(DIRECT_ATTRIBUTES.module(format, b)?, &bindings, &attributes)?;
        }
        let capture = if device.caps.check_path(UpdatePath::Feedback).is_ok() {
            Some(Capture::Feedback(Feedback::new(device, format, most)?))
        } else if device.caps.vertex_stores {
            Some(Capture::Store(VertexStore::new(device, format, most)?))
        } else {
            None
        };
        Ok(Self { draw, capture, format, most })
    }

    pub(crate) fn serves(&self, format: DeltaFormat, batch: BatchSize) -> bool {
        (self.format, BatchSize::Targets(self.most)) == (format, batch)
    }

    /// Targets that may be active.
    pub(crate) fn most(&self) -> u32 {
        self.most
    }

    /// Capture into the one pose of `poses`.
    pub(crate) fn capture_target(&self, layout: &PackedLayout, poses: vk::Buffer) -> Result<CaptureTarget> {
        let sets = match &self.capture {
            Some(Capture::Store(store)) => Some(StoreSets::new(store, layout, poses, 1)?),
            _ => None,
        };
        Ok(CaptureTarget { poses, sets })
    }

    /// Whether capturing is done by transform feedback; by vertex stores otherwise.
    ///
    /// # Errors
    /// The device has neither.
    pub(crate) fn captures_by_feedback(&self) -> Result<bool> {
        match &self.capture {
            Some(capture) => Ok(matches!(capture, Capture::Feedback(_))),
            None => Err(no_capture(&self.draw.device, UpdatePath::DirectAttributes)),
        }
    }

    /// Record the draw of each list of active targets.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with graphics.
    /// - The buffers hold what `draw.layout` says, and live until the draw has run; lists have at most
    ///   [`most`](Self::most) entries.
    pub(crate) unsafe fn record_draws<'a>(
        &self,
        cmd: vk::CommandBuffer,
        draw: &AttributesDraw<'_>,
        lists: impl Iterator<Item = &'a [Coefficient]>,
    ) {
        let device = &self.draw.device.raw;
        // SAFETY: the caller's obligations; the render pass is ours.
        unsafe { self.draw.begin_render_pass(cmd) };
        for active in lists {
            let push = push_constants(draw.layout, active);
            // SAFETY: as above; pipeline and layout are ours, and the push constants within the layout's range.
            unsafe {
                device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.draw.pipelines[active.len()]);
                if !push.is_empty() {
                    let bytes = bytemuck::cast_slice(&push);
                    device.cmd_push_constants(cmd, self.draw.layout, vk::ShaderStageFlags::VERTEX, 0, bytes);
                }
            }
            for chunk in draw.layout.chunks() {
                let (buffers, offsets) = vertex_buffers(draw.layout, chunk, (draw.base, 0), draw.deltas, active);
                // SAFETY: as above; each binding reads the chunk's vertices within its buffer.
                unsafe {
                    device.cmd_bind_vertex_buffers(cmd, 0, &buffers, &offsets);
                    device.cmd_draw(cmd, chunk.1 as u32, 1, 0, 0);
                }
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }

    /// Record a draw that captures its pose.
    ///
    /// # Safety
    /// As [`record_draws`](Self::record_draws); `target` was made by this kernel for this mesh.
    pub(crate) unsafe fn record_capture(
        &self,
        cmd: vk::CommandBuffer,
        draw: &AttributesDraw<'_>,
        active: &[Coefficient],
        target: &CaptureTarget,
    ) {
        let pass = FeedbackPass {
            layout: draw.layout,
            deltas: draw.deltas,
            source: (draw.base, 0),
            destination: (target.poses, 0),
            coefficients: active,
        };
        match (&self.capture, &target.sets) {
            // SAFETY: the caller's obligations; the base pose is another buffer than the one written.
            (Some(Capture::Feedback(feedback)), _) => unsafe { feedback.record(cmd, &pass) },
            // SAFETY: as above.
            (Some(Capture::Store(store)), Some(sets)) => unsafe { store.record(cmd, &pass, sets.of(0)) },
            _ => {}
        }
    }
}
