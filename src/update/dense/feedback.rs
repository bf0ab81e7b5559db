//! Vertex passes, with targets as vertex attributes. Path `feedback` captures poses by transform feedback.
//!
//! James L. Jones, "Efficient Morph Target Animation Using OpenGL ES 3.0", GPU Pro 5: batches of targets bound
//! as vertex attributes, rasterizer discard, ping-pong. One pipeline per batch size; each pass is a draw in a
//! render pass of its own, because a barrier inside a subpass cannot order captures before vertex fetch.

use super::technique::{DensePass, Passes};
use crate::abi::modules::{FEEDBACK, Kernel};
use crate::abi::push::attribute_push_bytes;
use crate::error::Result;
use crate::gpu::caps::CAPTURE_STRIDE;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, VertexInput};
use crate::pack::{DeltaFormat, PackedLayout, PoseFormat};
use crate::plan::BatchSize;
use crate::plan::steps::{Access, Resource, Stage, Use, Work};
use crate::update::technique::Context;
use crate::weights::delta::Coefficient;
use ash::vk;
use std::sync::Arc;

/// Pipelines of a vertex shader with 0 (a copy) to `most` targets as attributes.
#[derive(Clone, Copy, PartialEq)]
pub struct VertexPasses {
    kernel: &'static Kernel,
    format: DeltaFormat,
    /// Most targets of a pass.
    pub most: u32,
}

impl VertexPasses {
    /// The pipelines of `kernel` for a crowd.
    pub fn of(context: &Context<'_>, kernel: &'static Kernel) -> Result<Arc<Pipelines<Self>>> {
        let most = match context.desc.update.batch {
            BatchSize::Targets(batch) => batch,
            // Rejected by the check of the description.
            BatchSize::All => 0,
        };
        context.kernels.get(Self { kernel, format: context.layout().format, most })
    }
}

impl PipelineKey for VertexPasses {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self { kernel, format, most } = self;
        objects.add_layout(&[kernel.row], attribute_push_bytes(format.row(), most))?;
        objects.add_empty_render_pass()?;
        for batch in 0..=most {
            let (bindings, attributes) = vertex_input(format, batch);
            objects.add_discarding_vertex(
                kernel.module(format.row(), PoseFormat::Float32.row(), batch)?,
                &bindings,
                &attributes,
            )?;
        }
        Ok(())
    }
}

impl Pipelines<VertexPasses> {
    /// Records passes in one render pass. For a shader that stores poses, `stores` are the sets of the destination, one
    /// per chunk.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with graphics.
    /// - The buffers of each pass contain the data that its layout describes at the given offsets, and live until it
    ///   has finished. Source and destination do not overlap, and no other pass writes them.
    /// - No pass has more coefficients than the pipelines support.
    pub unsafe fn record<'a>(
        &self,
        cmd: vk::CommandBuffer,
        passes: impl IntoIterator<Item = DensePass<'a>>,
        stores: &[vk::DescriptorSet],
    ) {
        let objects = &self.objects;
        let device = &self.objects.device.raw;
        let captures = *self.key.kernel == FEEDBACK;
        let point = vk::PipelineBindPoint::GRAPHICS;
        let layout = objects.layout;
        // SAFETY: the caller's obligations; the render pass is ours.
        unsafe { objects.begin_render_pass(cmd) };
        for pass in passes {
            let push = push_constants(pass.layout, pass.coefficients);
            // SAFETY: as above; pipeline and layout are ours, and the push constants within the layout's range.
            unsafe {
                device.cmd_bind_pipeline(cmd, point, objects.pipelines[pass.coefficients.len()]);
                if !push.is_empty() {
                    let bytes = bytemuck::cast_slice(&push);
                    device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, bytes);
                }
            }
            for (i, (first, vertices)) in pass.layout.chunks().enumerate() {
                let (buffers, offsets) = vertex_buffers(&pass, first, vertices);
                let (buffer, offset) = pass.destination;
                let capture = captures.then_some((buffer, offset + (first * CAPTURE_STRIDE) as u64));
                // SAFETY: as above; each binding reads the chunk's vertices within its buffer, and as many are captured
                // or stored; offsets are multiples of the 4 bytes of a component.
                unsafe {
                    device.cmd_bind_vertex_buffers(cmd, 0, &buffers, &offsets);
                    if let Some(set) = stores.get(i) {
                        device.cmd_bind_descriptor_sets(cmd, point, layout, 0, &[*set], &[]);
                    }
                    objects.draw(cmd, vertices, capture);
                }
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }
}

pub(crate) struct FeedbackPasses(Arc<Pipelines<VertexPasses>>);

impl Passes for FeedbackPasses {
    const USES: &'static [Use] = &[
        Use::new(Resource::Asset, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::TransformFeedback, Access::FeedbackWrite),
    ];

    fn new(context: Context<'_>) -> Result<Self> {
        VertexPasses::of(&context, &FEEDBACK).map(Self)
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, _work: &Work, pass: &DensePass<'_>) {
        // SAFETY: the caller's obligations; source and destination are different slots: the plan alternates (tests hold
        // every plan to that).
        unsafe { self.0.record(cmd, [*pass], &[]) };
    }
}

/// Coefficients, and exponents of normals if the format has them, in the layout of `attributes.glsl`.
fn push_constants(layout: &PackedLayout, coefficients: &[Coefficient]) -> Vec<u32> {
    let mut words: Vec<u32> =
        coefficients.iter().map(|c| (c.value * layout.targets[c.target as usize].position_step).to_bits()).collect();
    if layout.format.row().exponents {
        words.extend(coefficients.chunks(4).map(|four| {
            let byte = |c: &Coefficient| layout.targets[c.target as usize].normal_exponent as u8;
            four.iter().enumerate().fold(0, |word, (i, c)| word | u32::from(byte(c)) << (8 * i))
        }));
    }
    words
}

/// Vertex buffers of a pass for `vertices` from `first` on: the source pose, then a row of deltas per target.
fn vertex_buffers(pass: &DensePass<'_>, first: usize, vertices: usize) -> (Vec<vk::Buffer>, Vec<u64>) {
    let (buffer, offset) = pass.source;
    let row = |c: &Coefficient| (pass.deltas, (pass.layout.row_start(c.target as usize, first, vertices) * 4) as u64);
    let source = (buffer, offset + (first * CAPTURE_STRIDE) as u64);
    std::iter::once(source).chain(pass.coefficients.iter().map(row)).unzip()
}

/// Vertex input of a pass. Binding 0: the pose; bindings 1..=batch: the deltas of a target each.
pub fn vertex_input(format: DeltaFormat, batch: u32) -> VertexInput {
    let binding = |binding, stride| vk::VertexInputBindingDescription::default().binding(binding).stride(stride);
    let (mut bindings, mut attributes) = PoseFormat::Float32.vertex_input();
    for b in 1..=batch {
        bindings.push(binding(b, format.stride() as u32));
        for &(format, offset) in format.row().attributes {
            let location = attributes.len() as u32;
            let format = vk::Format::from_raw(format as i32);
            attributes.push(vk::VertexInputAttributeDescription { location, binding: b, format, offset });
        }
    }
    (bindings, attributes)
}
