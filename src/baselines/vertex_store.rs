//! The `vertex-store` path: the passes of `feedback`, for devices without transform feedback whose vertex shaders may
//! write storage buffers. Binds targets as vertex attributes, discards all primitives, alternates between slots as
//! `feedback` does: a pass must not store where other vertices are still fetched from.

use crate::abi::modules::{DIRECT_ATTRIBUTES, VERTEX_STORE};
use crate::abi::push::attribute_push_bytes;
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::kernels::Kernel;
use crate::gpu::pipelines::Objects;
use crate::pack::{DeltaFormat, PackedLayout, PoseFormat};
use crate::plan::steps::{Access, Resource, Stage, Use, Work};
#[cfg(any(test, feature = "internals"))]
use crate::update::dense::PassAccess;
use crate::update::dense::feedback::{push_constants, vertex_batch, vertex_buffers, vertex_input};
use crate::update::dense::technique::{DensePass, Passes};
use crate::update::technique::Context;
use ash::vk;
use std::borrow::Borrow;
use std::sync::Arc;

/// Pipelines of a vertex shader that takes targets as attributes, for none (a copy) to the most. It stores the pose, or
/// it only draws.
pub(super) struct VertexKernel<const STORES: bool> {
    objects: Objects,
    key: (DeltaFormat, u32),
}

pub(super) type VertexStore = VertexKernel<true>;

impl<const STORES: bool> Kernel for VertexKernel<STORES> {
    type Key = (DeltaFormat, u32);

    fn new(device: &Arc<Device>, key: Self::Key) -> Result<Self> {
        let ((format, most), kernel) = (key, if STORES { &VERTEX_STORE } else { &DIRECT_ATTRIBUTES });
        let mut objects = Objects::none(device);
        objects.add_layout(&[kernel.row], attribute_push_bytes(format, most))?;
        objects.add_empty_render_pass()?;
        for b in 0..=most {
            let (bindings, attributes) = vertex_input(format, b);
            objects.add_discarding_vertex(kernel.module(format, PoseFormat::Float32, b)?, &bindings, &attributes)?;
        }
        Ok(Self { objects, key })
    }

    fn key(&self) -> Self::Key {
        self.key
    }
}

impl<const STORES: bool> VertexKernel<STORES> {
    /// Record passes in one render pass. Where they store, each comes with the sets of its destination, one for each
    /// chunk.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with graphics.
    /// - The buffers hold what the layout of a pass says at the offsets given, and live until it has run; its source and
    ///   destination are not the same slot, and neither is written by another pass.
    /// - No pass has more coefficients than the kernel was made for.
    pub(super) unsafe fn record<'a, P: Borrow<DensePass<'a>>>(
        &self,
        cmd: vk::CommandBuffer,
        passes: impl Iterator<Item = (P, &'a [vk::DescriptorSet])>,
    ) {
        let device = &self.objects.device.raw;
        let (point, layout) = (vk::PipelineBindPoint::GRAPHICS, self.objects.layout);
        // SAFETY: the caller's obligations; the render pass is ours.
        unsafe { self.objects.begin_render_pass(cmd) };
        for (pass, sets) in passes {
            let pass = pass.borrow();
            let push = push_constants(pass.layout, pass.coefficients);
            // SAFETY: as above; pipeline and layout are ours, and the push constants within the layout's range.
            unsafe {
                device.cmd_bind_pipeline(cmd, point, self.objects.pipelines[pass.coefficients.len()]);
                if !push.is_empty() {
                    let bytes = bytemuck::cast_slice(&push);
                    device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, bytes);
                }
            }
            for (i, chunk) in pass.layout.chunks().enumerate() {
                let (buffers, offsets) =
                    vertex_buffers(pass.layout, chunk, pass.source, pass.deltas, pass.coefficients);
                // SAFETY: as above; each binding reads the chunk's vertices within its buffer, and as many are stored.
                unsafe {
                    device.cmd_bind_vertex_buffers(cmd, 0, &buffers, &offsets);
                    if let Some(set) = sets.get(i) {
                        device.cmd_bind_descriptor_sets(cmd, point, layout, 0, &[*set], &[]);
                    }
                    device.cmd_draw(cmd, chunk.1 as u32, 1, 0, 0);
                }
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }

    /// The most targets of a pass.
    pub(super) fn most(&self) -> u32 {
        self.key.1
    }
}

/// What a crowd's storing vertex passes take.
pub(crate) struct StorePasses {
    kernel: Arc<VertexStore>,
    slots: u32,
    stores: StoreSets,
}

impl Passes for StorePasses {
    const USES: &'static [Use] = &[
        Use::new(Resource::Asset, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::VertexShader, Access::ShaderWrite),
    ];

    #[cfg(any(test, feature = "internals"))]
    const ACCESS: PassAccess = PassAccess {
        reads: (Stage::VertexInput, Access::AttributeRead),
        writes: (Stage::VertexShader, Access::ShaderWrite),
        in_place: false,
    };

    fn new(context: Context<'_>) -> Result<Self> {
        let (layout, poses) = (context.layout(), context.poses);
        let kernel: Arc<VertexStore> = context.kernels.get((layout.format, vertex_batch(&context)))?;
        let stores = StoreSets::new(&kernel, layout, poses.buffer, context.desc.instances * poses.slots)?;
        Ok(Self { kernel, slots: poses.slots, stores })
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, work: &Work, pass: &DensePass<'_>) {
        let sets = self.stores.of(work.instance * self.slots + work.destination);
        // SAFETY: the caller's obligations; source and destination are different slots: the plan alternates; the sets
        // were written for this mesh and crowd.
        unsafe { self.kernel.record(cmd, std::iter::once((pass, sets))) };
    }
}

/// Where passes store: a set for each pose of a buffer and each chunk, not dynamic offsets (see `compute`).
pub(super) struct StoreSets {
    sets: Sets,
    chunks: usize,
}

impl StoreSets {
    /// For `count` poses in `poses`.
    pub(super) fn new(kernel: &VertexStore, layout: &PackedLayout, poses: vk::Buffer, count: u32) -> Result<Self> {
        let bound: Vec<[BufferRange; 1]> = (0..u64::from(count))
            .flat_map(|pose| {
                layout.chunks().map(move |(first, vertices)| {
                    let (format, stride) = (PoseFormat::Float32, PoseFormat::Float32.stride());
                    let offset = pose * layout.pose_bytes(format) + (first * stride) as u64;
                    [BufferRange::new(poses, offset, (vertices * stride) as u64)]
                })
            })
            .collect();
        let sets = kernel.objects.sets(&bound)?;
        Ok(Self { sets, chunks: layout.chunks().count() })
    }

    /// The sets of a pose, one for each chunk.
    pub(super) fn of(&self, pose: u32) -> &[vk::DescriptorSet] {
        let first = pose as usize * self.chunks;
        self.sets.range(first..first + self.chunks)
    }
}
