//! A crowd updated in dense passes, generic over how a pass is executed.

use super::plan::DensePlanner;
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::pipelines::Objects;
use crate::pack::PackedLayout;
use crate::plan::UpdateStats;
use crate::plan::instances::{InstanceState, Instances};
use crate::plan::steps::{Source, Steps, Use, Work};
use crate::update::technique::{Context, PoseGroup, Technique, UpdateId};
use crate::weights::delta::Coefficient;
use ash::vk;

/// A pass with its buffers.
#[derive(Clone, Copy)]
pub struct DensePass<'a> {
    /// Layout of the group.
    pub layout: &'a PackedLayout,
    /// The deltas.
    pub deltas: vk::Buffer,
    /// Buffer and offset of the source pose.
    pub source: (vk::Buffer, u64),
    /// Buffer and offset of the destination pose.
    pub destination: (vk::Buffer, u64),
    /// Coefficients.
    pub coefficients: &'a [Coefficient],
}

impl<'a> DensePass<'a> {
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

/// Descriptor sets by index and chunk of the mesh. Poses are bound at fixed offsets: synchronization validation ignores
/// dynamic offsets, and would confuse the poses of two instances.
pub struct ChunkSets {
    sets: Sets,
    chunks: usize,
}

impl ChunkSets {
    /// `bound`: for each index, a function of first vertex and number of vertices that returns the bindings of a chunk.
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

    /// The sets of an index, one per chunk.
    pub fn get(&self, number: u32) -> &[vk::DescriptorSet] {
        let first = number as usize * self.chunks;
        self.sets.range(first..first + self.chunks)
    }
}

/// Executes the passes of a group, with device state for a crowd.
pub trait Passes: Send + Sync + Sized + 'static {
    /// Memory uses of a step of passes.
    const USES: &'static [Use];

    /// Creates the device state of a crowd.
    fn new(context: Context<'_>) -> Result<Self>;

    /// Writes the coefficient list of a work, if it has one.
    fn write_list(&mut self, _frame: u64, _work: &Work, _pass: &DensePass<'_>) -> Result<()> {
        Ok(())
    }

    /// Records the pass of a work.
    ///
    /// # Safety
    /// See [`Technique::record`].
    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work, pass: &DensePass<'_>);
}

/// A crowd updated by passes `P`.
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
        let planner = DensePlanner::new(context.desc.update, context.desc.instances as usize)?;
        let group = |of: Context<'_>| Ok((PoseGroup { mesh: of.mesh.clone(), poses: of.poses }, P::new(of)?));
        Ok(Self { planner, groups: context.groups().map(group).collect::<Result<_>>()? })
    }
}

impl<P: Passes> Technique for DenseTechnique<P> {
    fn state(&mut self) -> &mut dyn InstanceState {
        &mut self.planner
    }

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
}
