//! The `toy` path: passes of `vertex-store` with a kernel of its own.

use crate::vertex_store::store_sets;
use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph::internals::abi::modules::TOY;
use deltamorph::internals::gpu::pipelines::Pipelines;
use deltamorph::internals::plan::steps::{Access, Resource, Stage, Use, Work};
use deltamorph::internals::update::dense::feedback::VertexPasses;
use deltamorph::internals::update::dense::technique::{ChunkSets, DensePass, Passes};
use deltamorph::internals::update::technique::Context;
use std::sync::Arc;

/// The arguments for a crowd's storing vertex passes.
pub(crate) struct ToyPasses {
    kernel: Arc<Pipelines<VertexPasses>>,
    slots: u32,
    stores: ChunkSets,
}

impl Passes for ToyPasses {
    const USES: &'static [Use] = &[
        Use::new(Resource::Asset, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::VertexInput, Access::AttributeRead),
        Use::new(Resource::Poses, Stage::VertexShader, Access::ShaderWrite),
    ];

    fn new(context: Context<'_>) -> Result<Self> {
        let (layout, poses) = (context.layout(), context.poses);
        let kernel = VertexPasses::of(&context, &TOY)?;
        let stores = store_sets(&kernel.objects, layout, poses.buffer, context.desc.instances * poses.slots)?;
        Ok(Self { kernel, slots: poses.slots, stores })
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, work: &Work, pass: &DensePass<'_>) {
        let sets = self.stores.get(work.instance * self.slots + work.destination);
        // SAFETY: the caller's obligations; source and destination are different slots: the plan alternates; the sets
        // were written for this mesh and crowd.
        unsafe { self.kernel.record(cmd, [*pass], sets) };
    }
}
