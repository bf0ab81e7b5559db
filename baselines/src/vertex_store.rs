//! The `vertex-store` path: the passes of `feedback`, for devices without transform feedback whose vertex shaders can
//! write storage buffers. Like `feedback` it binds targets as vertex attributes, discards all primitives, and
//! alternates between slots: a pass must not store into a slot whose other vertices are still to be fetched.

use crate::abi::modules::VERTEX_STORE;
use crate::gpu::descriptors::BufferRange;
use crate::gpu::pipelines::{Objects, Pipelines};
use crate::pack::{PackedLayout, PoseFormat};
use crate::plan::steps::{Access, Resource, Stage, Use, Work};
use crate::update::dense::feedback::VertexPasses;
use crate::update::dense::technique::{ChunkSets, DensePass, Passes};
use crate::update::technique::Context;
use deltamorph::Result;
use deltamorph::ash::vk;
use std::sync::Arc;

/// The arguments for a crowd's storing vertex passes.
pub struct StorePasses {
    kernel: Arc<Pipelines<VertexPasses>>,
    slots: u32,
    stores: ChunkSets,
}

impl Passes for StorePasses {
    const USES: &'static [Use] = &[
        Use::new(Resource::Asset, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::VertexShader, Access::ShaderWrite),
    ];

    fn new(context: Context<'_>) -> Result<Self> {
        let (layout, poses) = (context.layout(), context.poses);
        let kernel = VertexPasses::of(&context, &VERTEX_STORE)?;
        let stores = store_sets(&kernel.objects, layout, poses.buffer, context.desc.instances * poses.slots)?;
        Ok(Self { kernel, slots: poses.slots, stores })
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, work: &Work, pass: &DensePass<'_>) {
        let sets = self.stores.get(work.instance * self.slots + work.destination);
        // SAFETY: the caller's obligations; source and destination are different slots, since the plan alternates; the
        // sets were written for this mesh and crowd.
        unsafe { self.kernel.record(cmd, [*pass], sets) };
    }
}

/// Makes descriptor sets for the destinations of passes: the `count` poses in `poses`.
pub fn store_sets(objects: &Objects, layout: &PackedLayout, poses: vk::Buffer, count: u32) -> Result<ChunkSets> {
    let (stride, bytes) = (PoseFormat::Float32.stride(), layout.pose_bytes(PoseFormat::Float32));
    let bound = (0..u64::from(count)).map(|pose| {
        move |first: usize, vertices: usize| {
            let offset = pose * bytes + (first * stride) as u64;
            vec![BufferRange::new(poses, offset, (vertices * stride) as u64)]
        }
    });
    ChunkSets::new(objects, layout, bound)
}
