//! The `feedback` path: vertex passes whose output is captured by transform feedback.
//!
//! James L. Jones, "Efficient Morph Target Animation Using OpenGL ES 3.0", GPU Pro 5: batches of targets bound
//! as vertex attributes, rasterizer discard, ping-pong. One pipeline per batch size; each pass is a draw in a
//! render pass of its own, because a barrier inside a subpass cannot order captures before vertex fetch.

#[cfg(any(test, feature = "internals"))]
use super::plan::PassAccess;
use super::technique::{DensePass, Passes};
use crate::abi::modules::FEEDBACK;
use crate::abi::push::attribute_push_bytes;
use crate::error::Result;
use crate::gpu::caps::CAPTURE_STRIDE;
use crate::gpu::device::Device;
use crate::gpu::kernels::Kernel;
use crate::gpu::pipelines::Objects;
use crate::pack::{DeltaFormat, PackedLayout, PoseFormat};
use crate::plan::BatchSize;
use crate::plan::steps::{Access, Resource, Stage, Use, Work};
use crate::update::technique::Context;
use crate::weights::delta::Coefficient;
use ash::vk;
use std::sync::Arc;

/// Pipelines for batches 0 (a copy) to the batch size.
pub(crate) struct Feedback {
    objects: Objects,
    key: (DeltaFormat, u32),
}

impl Kernel for Feedback {
    type Key = (DeltaFormat, u32);

    fn new(device: &Arc<Device>, key: Self::Key) -> Result<Self> {
        let (format, batch) = key;
        let mut objects = Objects::none(device);
        objects.add_layout(&[FEEDBACK.row], attribute_push_bytes(format, batch))?;
        objects.add_empty_render_pass()?;
        for b in 0..=batch {
            let (bindings, attributes) = vertex_input(format, b);
            objects.add_discarding_vertex(FEEDBACK.module(format, PoseFormat::Float32, b)?, &bindings, &attributes)?;
        }
        Ok(Self { objects, key })
    }

    fn key(&self) -> Self::Key {
        self.key
    }
}

impl Feedback {
    /// Record one pass.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with graphics.
    /// - The buffers of `pass` are alive until it has run, hold what `pass.layout` says, and source and
    ///   destination do not overlap.
    pub(crate) unsafe fn record(&self, cmd: vk::CommandBuffer, pass: &DensePass<'_>) {
        let device = &self.objects.device;
        let Some(feedback) = &device.feedback else { return };
        let feedback = feedback.fp();
        let batch = pass.coefficients.len();
        let push = push_constants(pass.layout, pass.coefficients);
        // SAFETY: the caller's obligations; pipeline, layout and render pass are ours; the push constants are
        // within the layout's range (no more coefficients than the largest batch); offsets are multiples of the 4 bytes
        // of a component.
        unsafe {
            self.objects.begin_render_pass(cmd);
            device.raw.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.objects.pipelines[batch]);
            if !push.is_empty() {
                let bytes = bytemuck::cast_slice(&push);
                device.raw.cmd_push_constants(cmd, self.objects.layout, vk::ShaderStageFlags::VERTEX, 0, bytes);
            }
        }
        for (first, vertices) in pass.layout.chunks() {
            let pose_offset = (first * CAPTURE_STRIDE) as u64;
            let (buffers, offsets) =
                vertex_buffers(pass.layout, (first, vertices), pass.source, pass.deltas, pass.coefficients);
            let (to, size) = (pass.destination.1 + pose_offset, (vertices * CAPTURE_STRIDE) as u64);
            // SAFETY: as above; each binding reads `vertices` elements within its buffer, and as many are
            // captured; transform feedback is enabled since `device.feedback` is there. ash 0.38 has no
            // wrappers for these commands.
            unsafe {
                device.raw.cmd_bind_vertex_buffers(cmd, 0, &buffers, &offsets);
                (feedback.cmd_bind_transform_feedback_buffers_ext)(cmd, 0, 1, &pass.destination.0, &to, &size);
                (feedback.cmd_begin_transform_feedback_ext)(cmd, 0, 0, std::ptr::null(), std::ptr::null());
                device.raw.cmd_draw(cmd, vertices as u32, 1, 0, 0);
                (feedback.cmd_end_transform_feedback_ext)(cmd, 0, 0, std::ptr::null(), std::ptr::null());
            }
        }
        // SAFETY: begun above.
        unsafe { device.raw.cmd_end_render_pass(cmd) };
    }
}

impl Passes for Arc<Feedback> {
    const USES: &'static [Use] = &[
        Use::new(Resource::Asset, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::TransformFeedback, Access::FeedbackWrite),
    ];

    #[cfg(any(test, feature = "internals"))]
    const ACCESS: PassAccess = PassAccess {
        reads: (Stage::VertexInput, Access::AttributeRead),
        writes: (Stage::TransformFeedback, Access::FeedbackWrite),
        in_place: false,
    };

    fn new(context: Context<'_>) -> Result<Self> {
        context.kernels.get((context.layout().format, vertex_batch(&context)))
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, _work: &Work, pass: &DensePass<'_>) {
        // SAFETY: the caller's obligations; source and destination are different slots: the plan alternates (tests hold
        // every plan to that).
        unsafe { Feedback::record(self, cmd, pass) };
    }
}

/// Targets of a vertex pass, at most.
pub(crate) fn vertex_batch(context: &Context<'_>) -> u32 {
    match context.desc.update.batch {
        BatchSize::Targets(batch) => batch,
        // Refused by the check of the description.
        BatchSize::All => 0,
    }
}

/// Coefficients, and for snorm16 the exponents of normals, as `attributes.glsl` declares them.
pub(crate) fn push_constants(layout: &PackedLayout, coefficients: &[Coefficient]) -> Vec<u32> {
    let mut words: Vec<u32> =
        coefficients.iter().map(|c| (c.value * layout.targets[c.target as usize].position_step).to_bits()).collect();
    if layout.format == DeltaFormat::Snorm16 {
        words.extend(coefficients.chunks(4).map(|four| {
            let byte = |c: &Coefficient| layout.targets[c.target as usize].normal_exponent as u8;
            four.iter().enumerate().fold(0, |word, (i, c)| word | u32::from(byte(c)) << (8 * i))
        }));
    }
    words
}

/// What a pass or draw binds for `vertices` from `first` on: the pose `source`, then a row of `deltas` for each target.
pub(crate) fn vertex_buffers(
    layout: &PackedLayout,
    (first, vertices): (usize, usize),
    source: (vk::Buffer, u64),
    deltas: vk::Buffer,
    coefficients: &[Coefficient],
) -> (Vec<vk::Buffer>, Vec<u64>) {
    let row = |c: &Coefficient| (deltas, (layout.row_start(c.target as usize, first, vertices) * 4) as u64);
    std::iter::once((source.0, source.1 + (first * CAPTURE_STRIDE) as u64)).chain(coefficients.iter().map(row)).unzip()
}

type VertexInput = (Vec<vk::VertexInputBindingDescription>, Vec<vk::VertexInputAttributeDescription>);

/// Binding 0: the pose. Bindings 1..=batch: a target's deltas, as one attribute or two.
pub(crate) fn vertex_input(format: DeltaFormat, batch: u32) -> VertexInput {
    let binding = |binding, stride| vk::VertexInputBindingDescription::default().binding(binding).stride(stride);
    let attribute =
        |location, binding, format, offset| vk::VertexInputAttributeDescription { location, binding, format, offset };
    let float3 = vk::Format::R32G32B32_SFLOAT;
    let (pose, mut attributes) = PoseFormat::Float32.vertex_input();
    let mut bindings = vec![pose];
    for b in 1..=batch {
        bindings.push(binding(b, format.stride() as u32));
        match format.attributes() {
            1 => attributes.push(attribute(1 + b, b, vk::Format::R32G32B32_UINT, 0)),
            _ => attributes.extend([attribute(2 * b, b, float3, 0), attribute(2 * b + 1, b, float3, 12)]),
        }
    }
    (bindings, attributes)
}
