//! Steps of an update planned by the GPU; they do not depend on what changes.

use crate::plan::hazards::{Accesses, Memory};
use crate::plan::steps::{Access, Resource as R, Source, Stage, Steps, Use, Work};
use AnimatedKernel as K;
use std::ops::Range;

/// The list of kernels: documentation, name, name of the step, whether one dispatch serves all groups of the mesh, and
/// memory uses.
macro_rules! kernels {
    ($($(#[doc = $doc:literal])* $kernel:ident $name:literal $common:literal $uses:expr;)*) => {
        /// The kernel or command of a work.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(super) enum AnimatedKernel {
            $($(#[doc = $doc])* $kernel,)*
        }

        impl AnimatedKernel {
            /// All kernels, in the order of [`Work::kernel`].
            pub(super) const ALL: [Self; [$(Self::$kernel),*].len()] = [$(Self::$kernel),*];

            /// The name of its step.
            pub(super) const fn name(self) -> &'static str {
                match self {
                    $(Self::$kernel => $name,)*
                }
            }

            const fn uses(self) -> (bool, &'static [Use]) {
                match self {
                    $(Self::$kernel => ($common, const { $uses }),)*
                }
            }
        }
    };
}

kernels! {
    /// Samples the clips that instances play.
    Sample "sample" true SAMPLE;
    /// Writes the work lists.
    Plan "plan" false PLAN;
    /// Turns their lengths into dispatch arguments.
    Arguments "arguments" false &[Use::read(R::Control), Use::write(R::Control), Use::write(R::WorkList)];
    /// Copies changed records to the device.
    Records "records" true &[Use::copy(R::State)];
    /// Updates the blocks of the work lists.
    Blocks "blocks" false BLOCKS;
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
            let (common, uses) = kernel.uses();
            steps.step(uses);
            let (source, destination) = (Source::Slot(self.source), self.destination);
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

/// Reads and writes of the works of a step, for a crowd of `instances`.
pub(crate) fn accesses(works: &[Work], instances: u32) -> Vec<Accesses> {
    use Memory as M;
    let of = |work: &Work| match AnimatedKernel::ALL[work.kernel as usize] {
        K::Records => Accesses { uses: vec![Use::copy(M::Records)], ..Accesses::default() },
        K::Sample => Accesses::compute([M::Clips, M::Records, M::Weights], [M::Weights]),
        // Counters are atomic.
        K::Plan => {
            Accesses::compute([M::Clips, M::Weights, M::History, M::Counters], [M::History, M::WorkList, M::Counters])
        }
        K::Arguments => Accesses::compute([M::Counters], [M::Counters, M::Arguments, M::WorkList]),
        K::Blocks => {
            let pose = |slot| (0..instances).map(move |instance| M::Pose { instance, slot });
            let Source::Slot(source) = work.source else { unreachable!("blocks are read from a slot") };
            let reads = [M::WorkList, M::Deltas].into_iter().chain(pose(source));
            let mut all = Accesses::compute(reads, pose(work.destination));
            all.uses.push(Use::new(M::Arguments, Stage::Indirect, Access::IndirectRead));
            all
        }
    };
    works.iter().map(|work| Accesses { group: work.group, ..of(work) }).collect()
}
