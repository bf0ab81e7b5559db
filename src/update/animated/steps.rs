//! Steps of an update planned by the GPU; they do not depend on what changes.

use crate::plan::steps::{Access, Resource as R, Source, Stage, Steps, Use, Work};
use AnimatedKernel as K;
use std::ops::Range;

/// The kernel or command of a work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnimatedKernel {
    /// Samples the clips that instances play.
    Sample,
    /// Writes the work lists.
    Plan,
    /// Turns their lengths into dispatch arguments.
    Arguments,
    /// Copies changed records to the device.
    Records,
    /// Updates the blocks of the work lists.
    Blocks,
}

impl AnimatedKernel {
    /// All kernels, in the order of [`Work::kernel`].
    pub const ALL: [Self; 5] = [K::Sample, K::Plan, K::Arguments, K::Records, K::Blocks];

    /// The name of its step, whether one dispatch serves all groups of the mesh, and memory uses.
    pub(super) const fn row(self) -> (&'static str, bool, &'static [Use]) {
        match self {
            K::Sample => ("sample", true, SAMPLE),
            K::Plan => ("plan", false, PLAN),
            K::Arguments => ("arguments", false, ARGUMENTS),
            K::Records => ("records", true, RECORDS),
            K::Blocks => ("blocks", false, BLOCKS),
        }
    }
}

const SAMPLE: &[Use] = &[Use::read(R::Tables), Use::read(R::State), Use::write(R::State)];
const PLAN: &[Use] = &[
    Use::read(R::Tables),
    Use::read(R::State),
    Use::write(R::State),
    Use::read(R::Control),
    Use::write(R::Control),
    Use::write(R::WorkList),
];
const ARGUMENTS: &[Use] = &[Use::read(R::Control), Use::write(R::Control), Use::write(R::WorkList)];
const RECORDS: &[Use] = &[Use::copy(R::State)];
const BLOCKS: &[Use] = &[
    Use::read(R::WorkList),
    Use::new(R::Control, Stage::Indirect, Access::IndirectRead),
    Use::read(R::Asset),
    Use::read(R::Poses),
    Use::write(R::Poses),
];

/// Memory written when a crowd is created, and its uses by updates.
pub(crate) const UPLOADED: [&[Use]; 2] = [
    &[Use::copy(R::Tables), Use::copy(R::State), Use::copy(R::Control)],
    &[Use::read(R::Tables), Use::read(R::State), Use::write(R::State), Use::read(R::Control), Use::write(R::Control)],
];

/// Parameters of the steps of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnimatedUpdate {
    /// Some record changed.
    pub records: bool,
    /// The source slot.
    pub source: u32,
    /// The destination slot.
    pub destination: u32,
    /// Number of groups of the mesh.
    pub groups: u32,
    /// Most dispatches of blocks of any group.
    pub dispatches: u32,
    /// Each dispatch of blocks is a step, as in [`Dispatching`](crate::update::blocks).
    pub texels: bool,
}

impl AnimatedUpdate {
    /// Appends its steps.
    pub fn fill(&self, steps: &mut Steps) {
        let Self { records, groups, dispatches, texels, .. } = *self;
        let mut add = |kernel: K, items: Range<u32>| {
            let (_, common, uses) = kernel.row();
            steps.step(uses);
            let source = Source::Slot(self.source);
            let destination = self.destination;
            for group in 0..if common { 1 } else { groups } {
                let items = items.clone();
                steps.push(Work { kernel: kernel as u32, group, source, destination, items, ..Work::default() });
            }
        };
        if records {
            add(K::Records, 0..0);
        }
        for kernel in [K::Sample, K::Plan, K::Arguments] {
            add(kernel, 0..0);
        }
        match texels {
            true => (0..dispatches).for_each(|dispatch| add(K::Blocks, dispatch..dispatch + 1)),
            false => add(K::Blocks, 0..dispatches),
        }
    }
}
