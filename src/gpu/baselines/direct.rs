//! The `direct` path: the vertex shader of the draw evaluates all active targets in every draw, from deltas in a storage
//! buffer (Costigan et al., Algorithm 1; Bevy, three.js and Filament do it so, with textures in the place of buffers).

use super::no_capture;
use crate::abi::modules::{DIRECT, DIRECT_FEEDBACK, DIRECT_STORE};
use crate::abi::push::DirectPush;
use crate::error::Result;
use crate::gpu::descriptors::{Bound, Sets};
use crate::gpu::device::Device;
use crate::gpu::feedback::vertex_input;
use crate::gpu::pipelines::Objects;
use crate::pack::{DeltaFormat, POSE_STRIDE, PackedLayout};
use crate::plan::UpdatePath;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// How a device captures what a draw evaluates.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Capture {
    Feedback,
    Store,
}

/// The draw's pipeline, then, where the device can, the one that captures.
pub(crate) struct Direct {
    objects: Objects,
    format: DeltaFormat,
    capture: Option<Capture>,
}

/// The buffers of a crowd.
pub(crate) struct DirectBuffers<'a> {
    pub(crate) layout: &'a PackedLayout,
    pub(crate) base: vk::Buffer,
    /// Deltas, and the bytes of a chunk.
    pub(crate) deltas: (vk::Buffer, u64),
    /// Weight lists, and the bytes of one.
    pub(crate) weights: (vk::Buffer, u64),
    /// One pose to capture into.
    pub(crate) pose: vk::Buffer,
}

/// What one head's draw reads.
#[derive(Clone, Copy, Default)]
pub(crate) struct DirectHead {
    /// Dynamic offset of its weights.
    pub(crate) weights: u32,
    /// Its active targets.
    pub(crate) active: u32,
}

impl Direct {
    pub(crate) fn new(device: &Arc<Device>, format: DeltaFormat) -> Result<Self> {
        let capture = if device.caps.check_path(UpdatePath::Feedback).is_ok() {
            Some(Capture::Feedback)
        } else {
            device.caps.vertex_stores.then_some(Capture::Store)
        };
        let mut objects = Objects::none(device);
        let kernels = match capture {
            None => &[&DIRECT][..],
            Some(Capture::Feedback) => &[&DIRECT, &DIRECT_FEEDBACK],
            Some(Capture::Store) => &[&DIRECT, &DIRECT_STORE],
        };
        let rows: Vec<_> = kernels.iter().map(|kernel| kernel.row).collect();
        objects.add_layout(&rows, 0)?;
        objects.add_empty_render_pass()?;
        let (bindings, attributes) = vertex_input(format, 0);
        for kernel in kernels {
            objects.add_discarding_vertex(kernel.module(format, 0)?, &bindings, &attributes)?;
        }
        Ok(Self { objects, format, capture })
    }

    pub(crate) fn serves(&self, format: DeltaFormat) -> bool {
        self.format == format
    }

    /// The descriptor set of a crowd.
    pub(crate) fn sets(&self, buffers: &DirectBuffers<'_>) -> Result<Sets> {
        let mut bound = vec![
            Bound::dynamic(buffers.deltas.0, buffers.deltas.1),
            Bound::dynamic(buffers.weights.0, buffers.weights.1),
        ];
        if self.capture == Some(Capture::Store) {
            bound.push(Bound::new(buffers.pose, 0, buffers.layout.pose_bytes()));
        }
        Sets::new(&self.objects.device, self.objects.set_layout, &[bound])
    }

    /// Whether capturing is done by transform feedback; by vertex stores otherwise.
    ///
    /// # Errors
    /// The device has neither.
    pub(crate) fn captures_by_feedback(&self) -> Result<bool> {
        match self.capture {
            Some(capture) => Ok(capture == Capture::Feedback),
            None => Err(no_capture(&self.objects.device, UpdatePath::Direct)),
        }
    }

    /// Record the draws of `heads`, captured if asked for and the device can.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with graphics.
    /// - `sets` were made for `buffers` by this kernel, and all live until the draws have run; the weight lists of
    ///   `heads` are complete by then.
    pub(crate) unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        buffers: &DirectBuffers<'_>,
        sets: &Sets,
        heads: &[DirectHead],
        captured: bool,
    ) {
        let device = &self.objects.device.raw;
        let (point, layout) = (vk::PipelineBindPoint::GRAPHICS, self.objects.layout);
        let pipeline = usize::from(captured && self.capture.is_some());
        // SAFETY: the caller's obligations; pipeline and render pass are ours.
        unsafe {
            self.objects.begin_render_pass(cmd);
            device.cmd_bind_pipeline(cmd, point, self.objects.pipelines[pipeline]);
        }
        for (head, (first, vertices)) in heads.iter().flat_map(|h| buffers.layout.chunks().map(move |c| (h, c))) {
            let at = (first * POSE_STRIDE) as u64;
            let row = (buffers.layout.row_start(0, first, vertices) * 4) as u32;
            let push = DirectPush {
                chunk_vertices: vertices as u32,
                target_count: buffers.layout.targets.len() as u32,
                active_targets: head.active,
                first_vertex: first as u32,
            };
            // SAFETY: as above; vertices and rows are within their buffers, dynamic offsets are multiples of 64 × 12
            // bytes and of a list's 256; the push constants fill the layout's range.
            unsafe {
                device.cmd_bind_vertex_buffers(cmd, 0, &[buffers.base], &[at]);
                device.cmd_bind_descriptor_sets(cmd, point, layout, 0, &[sets.get(0)], &[row, head.weights]);
                device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, bytes_of(&push));
            }
            let draw = || {
                // SAFETY: as above.
                unsafe { device.cmd_draw(cmd, vertices as u32, 1, 0, 0) };
            };
            match &self.objects.device.feedback {
                Some(feedback) if captured && self.capture == Some(Capture::Feedback) => {
                    let (feedback, size) = (feedback.fp(), (vertices * POSE_STRIDE) as u64);
                    // SAFETY: as above; as much is captured as the pose has room for. ash 0.38 has no wrappers for
                    // these commands.
                    unsafe {
                        (feedback.cmd_bind_transform_feedback_buffers_ext)(cmd, 0, 1, &buffers.pose, &at, &size);
                        (feedback.cmd_begin_transform_feedback_ext)(cmd, 0, 0, std::ptr::null(), std::ptr::null());
                        draw();
                        (feedback.cmd_end_transform_feedback_ext)(cmd, 0, 0, std::ptr::null(), std::ptr::null());
                    }
                }
                _ => draw(),
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }
}
