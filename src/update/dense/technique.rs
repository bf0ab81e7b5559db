//! A crowd that is updated in dense passes, whoever carries a pass out.

use super::plan::DensePlanner;
use crate::error::Result;
use crate::pack::PackedLayout;
use crate::plan::UpdateStats;
use crate::plan::instances::Instances;
use crate::plan::steps::{Steps, Use, Work};
use crate::update::technique::{Context, Technique, UpdateId};
use crate::weights::delta::Coefficient;
use ash::vk;

/// Who carries the passes of a group out, with what it keeps for a crowd.
pub(crate) trait Passes: Send + Sync + Sized + 'static {
    /// What the passes of a step use.
    const USES: &'static [Use];

    /// What a crowd's passes take.
    fn new(context: Context<'_>) -> Result<Self>;

    /// The group.
    fn layout(&self) -> &PackedLayout;

    /// Write lists for the works of its group.
    fn write_lists<'a>(
        &mut self,
        _planner: &DensePlanner,
        _frame: u64,
        _works: impl Iterator<Item = &'a Work>,
    ) -> Result<()> {
        Ok(())
    }

    /// Record a pass.
    ///
    /// # Safety
    /// As [`Technique::record`].
    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work, coefficients: &[Coefficient]);

    /// As [`Technique::accesses`].
    #[cfg(any(test, feature = "internals"))]
    fn accesses(works: &[Work]) -> Vec<crate::plan::hazards::Accesses>;
}

/// A crowd that is updated by `P`.
pub(crate) struct DenseTechnique<P> {
    planner: DensePlanner,
    /// One for each group.
    passes: Vec<P>,
}

impl<P: Passes> DenseTechnique<P> {
    pub(crate) fn new(context: Context<'_>) -> Result<Self> {
        let planner = DensePlanner::new(context.desc.update, context.desc.instances as usize)?;
        Ok(Self { planner, passes: context.groups().map(P::new).collect::<Result<_>>()? })
    }
}

impl<P: Passes> Technique for DenseTechnique<P> {
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        self.planner.plan(instances, id.update);
        self.planner.fill(self.passes.len(), P::USES, steps);
        for (group, passes) in (0..).zip(&mut self.passes) {
            let works = steps.works().iter().filter(|work| work.group == group);
            passes.write_lists(&self.planner, id.frame, works)?;
        }
        Ok(self.planner.stats(self.passes.iter().map(P::layout)))
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work) {
        // SAFETY: the caller's obligations.
        unsafe { self.passes[work.group as usize].record(cmd, frame, work, self.planner.coefficients(work)) };
    }

    #[cfg(any(test, feature = "internals"))]
    fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        P::accesses(works)
    }
}
