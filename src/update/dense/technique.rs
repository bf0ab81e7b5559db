//! A crowd that is updated in dense passes, whoever carries a pass out.

use super::plan::DensePlanner;
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::pipelines::Objects;
use crate::pack::PackedLayout;
use crate::plan::UpdateStats;
use crate::plan::instances::Instances;
use crate::plan::steps::{Source, Steps, Use, Work};
use crate::update::technique::{Context, PoseGroup, Technique, UpdateId};
use crate::weights::delta::Coefficient;
use ash::vk;

/// A pass, with the buffers that it takes.
#[derive(Clone, Copy)]
pub struct DensePass<'a> {
    /// Where everything is in the mesh.
    pub layout: &'a PackedLayout,
    /// The deltas.
    pub deltas: vk::Buffer,
    /// Buffer and offset of the source pose.
    pub source: (vk::Buffer, u64),
    /// Buffer and offset of the destination pose.
    pub destination: (vk::Buffer, u64),
    /// What is applied.
    pub coefficients: &'a [Coefficient],
}

impl<'a> DensePass<'a> {
    /// The pass of a work.
    fn new(PoseGroup { mesh, poses }: &'a PoseGroup, work: &Work, coefficients: &'a [Coefficient]) -> Self {
        let pose = |slot| (poses.buffer, poses.offset(work.instance, slot));
        let source = match work.source {
            Source::Base => (mesh.base.raw, 0),
            Source::Slot(slot) => pose(slot),
        };
        let destination = pose(work.destination);
        Self { layout: &mesh.layout, deltas: mesh.deltas.raw, source, destination, coefficients }
    }
}

/// Descriptor sets of passes, by number, one for each chunk of the mesh. Poses are bound where they are, and not by
/// dynamic offset: synchronization validation does not see dynamic offsets and would take the poses of two instances
/// for one piece of memory.
pub struct ChunkSets {
    sets: Sets,
    chunks: usize,
}

impl ChunkSets {
    /// `bound`: for each number, what is bound of a chunk, from its first vertex and its vertices.
    pub fn new<F: Fn(usize, usize) -> Vec<BufferRange>>(
        objects: &Objects,
        layout: &PackedLayout,
        bound: impl Iterator<Item = F>,
    ) -> Result<Self> {
        let chunks: Vec<_> = layout.chunks().collect();
        let bound =
            bound.flat_map(|bound| chunks.iter().map(|&(first, vertices)| bound(first, vertices)).collect::<Vec<_>>());
        let sets = objects.sets(&bound.collect::<Vec<_>>())?;
        Ok(Self { sets, chunks: chunks.len() })
    }

    /// The sets of a number, chunk by chunk.
    pub fn get(&self, number: u32) -> &[vk::DescriptorSet] {
        let first = number as usize * self.chunks;
        self.sets.range(first..first + self.chunks)
    }
}

/// Who carries the passes of a group out, with what it keeps for a crowd.
pub trait Passes: Send + Sync + Sized + 'static {
    /// What the passes of a step use.
    const USES: &'static [Use];

    /// What a crowd's passes take.
    fn new(context: Context<'_>) -> Result<Self>;

    /// Write the list of a work of this group, where it has one.
    fn write_list(&mut self, _frame: u64, _work: &Work, _pass: &DensePass<'_>) -> Result<()> {
        Ok(())
    }

    /// Record the pass of a work.
    ///
    /// # Safety
    /// As [`Technique::record`].
    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work, pass: &DensePass<'_>);
}

/// A crowd that is updated by `P`.
pub struct DenseTechnique<P> {
    planner: DensePlanner,
    groups: Vec<(PoseGroup, P)>,
}

impl<P: Passes> DenseTechnique<P> {
    /// For a crowd whose description was checked.
    ///
    /// # Errors
    /// No memory.
    pub fn new(context: Context<'_>) -> Result<Self> {
        let planner = DensePlanner::new(context.desc.update, context.poses.grid, context.desc.instances as usize)?;
        let group = |of: Context<'_>| Ok((PoseGroup { mesh: of.mesh.clone(), poses: of.poses }, P::new(of)?));
        Ok(Self { planner, groups: context.groups().map(group).collect::<Result<_>>()? })
    }
}

impl<P: Passes> Technique for DenseTechnique<P> {
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        let Self { planner, groups } = self;
        planner.plan(instances, id.update);
        planner.fill(groups.len(), P::USES, steps);
        for work in steps.works() {
            let (group, passes) = &mut groups[work.group as usize];
            passes.write_list(id.frame, work, &DensePass::new(group, work, planner.coefficients(work)))?;
        }
        Ok(planner.stats(groups.iter().map(|(group, _)| &group.mesh.layout)))
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work) {
        let (group, passes) = &self.groups[work.group as usize];
        let pass = DensePass::new(group, work, self.planner.coefficients(work));
        // SAFETY: the caller's obligations.
        unsafe { passes.record(cmd, frame, work, &pass) };
    }

    fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        self.planner.accesses(works)
    }
}
