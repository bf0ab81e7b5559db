//! The commands of an update that the GPU plans: the same ones, whatever changes.

use super::commands::{Access, Command, CommandList, Hazard, Stage};
use super::hazards::{Resource, Use};

/// A step of an update that the GPU plans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnimatedCommand {
    /// Records of heads that play something else are copied.
    Records,
    /// What the heads play is sampled.
    Sample,
    /// With an error budget: which changes go is decided.
    Budget,
    /// They become the weights that poses hold.
    Commit,
    /// The work list is written.
    Plan,
    /// Its length becomes the arguments of dispatches.
    Arguments,
    /// The blocks of the work list are updated.
    Blocks {
        /// Instances of the crowd.
        instances: u32,
        /// The slot that blocks are read from.
        source: u32,
        /// The slot they are written to.
        destination: u32,
    },
}

/// What the commands of an update depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnimatedUpdate {
    /// Some head plays something else.
    pub records: bool,
    /// Small changes wait.
    pub budget: bool,
    /// Instances of the crowd.
    pub instances: u32,
    /// The slot that blocks are read from.
    pub source: u32,
    /// The slot they are written to.
    pub destination: u32,
}

impl CommandList {
    /// Write the list for one update that the GPU plans.
    pub fn fill_animated(&mut self, update: AnimatedUpdate) {
        use AnimatedCommand as A;
        let AnimatedUpdate { records, budget, instances, source, destination } = update;
        let (barrier, step) = (Command::Barrier, Command::Animated);
        self.commands.clear();
        if records {
            self.commands.extend([
                barrier(Hazard::ComputeReadToTransferWrite),
                step(A::Records),
                barrier(Hazard::TransferWriteToComputeUpdate),
            ]);
        }
        self.commands.extend([barrier(Hazard::PoseReadToAnimatedUpdate), step(A::Sample)]);
        if budget {
            let between = barrier(Hazard::ComputeWriteToComputeUpdate);
            self.commands.extend([between.clone(), step(A::Budget), between, step(A::Commit)]);
        }
        self.commands.extend([
            barrier(Hazard::ComputeWriteToComputeUpdate),
            step(A::Plan),
            barrier(Hazard::ComputeWriteToComputeUpdate),
            step(A::Arguments),
            barrier(Hazard::ComputeWriteToIndirectUpdate),
            step(A::Blocks { instances, source, destination }),
            barrier(Hazard::ComputeWriteToPoseRead),
        ]);
    }
}

impl AnimatedCommand {
    /// What it reads, and what it writes. Where it does both, an invocation reads what it writes itself, or nobody else
    /// does (counters are atomic).
    pub(super) fn uses(self) -> (Vec<Use>, Vec<Use>) {
        let shader = |access| move |resource| Use { resource, stage: Stage::Compute, access };
        let uses = |read: &[Resource], written: &[Resource]| {
            let read = read.iter().copied().map(shader(Access::ShaderRead)).collect();
            (read, written.iter().copied().map(shader(Access::ShaderWrite)).collect())
        };
        use Resource as R;
        match self {
            Self::Records => {
                let write = Use { resource: R::Records, stage: Stage::Transfer, access: Access::TransferWrite };
                (vec![], vec![write])
            }
            Self::Sample => uses(&[R::Clips, R::Records, R::Weights], &[R::Weights]),
            Self::Budget | Self::Commit => uses(&[R::Clips, R::Weights], &[R::Weights]),
            Self::Plan => {
                uses(&[R::Clips, R::Weights, R::History, R::Counters], &[R::History, R::WorkList, R::Counters])
            }
            Self::Arguments => uses(&[R::Counters], &[R::Counters, R::Arguments]),
            Self::Blocks { instances, source, destination } => {
                let each = |f: &dyn Fn(u32) -> R| (0..instances).map(f).collect::<Vec<_>>();
                let sums = each(&|instance| R::Sums { instance });
                let sources = each(&|instance| R::Pose { instance, slot: source });
                let destinations = each(&|instance| R::Pose { instance, slot: destination });
                let read = [vec![R::WorkList, R::Deltas, R::Base], sums.clone(), sources].concat();
                let (mut read, written) = uses(&read, &[sums, destinations].concat());
                read.push(Use { resource: R::Arguments, stage: Stage::Indirect, access: Access::IndirectRead });
                (read, written)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::UpdatePath;
    use crate::plan::tests::assert_barriers_needed;

    /// Take any one barrier of a running animation out, and the checker says so.
    #[test]
    fn every_barrier_is_needed() {
        for (slots, records, budget) in [(1, false, false), (2, false, true), (2, true, false), (3, true, true)] {
            let frames: Vec<_> = (0..6u32)
                .map(|frame| {
                    let mut list = CommandList::new(UpdatePath::Blocks);
                    let (source, destination) = ((frame + slots - 1) % slots, frame % slots);
                    list.fill_animated(AnimatedUpdate { records, budget, instances: 1, source, destination });
                    (list, [Some(destination), (slots > 1 && frame > 0).then_some(source)])
                })
                .collect();
            let barriers = 5 + 2 * usize::from(records) + 2 * usize::from(budget);
            assert_barriers_needed(&frames, barriers, &format!("{slots} slots, records {records}, budget {budget}"));
        }
    }
}
