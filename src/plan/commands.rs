//! Passes and barriers as data: what a back end records, and what the hazard checker reads.

use super::animated::AnimatedCommand;
use super::blocks::Item;
use super::{Plan, Source, UpdatePath};
use std::ops::Range;

/// A pipeline stage, as a bit of [`Scope::stages`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Stage {
    /// Copies.
    Transfer = 1,
    /// Vertex-attribute fetch.
    VertexInput = 2,
    /// Vertex shaders.
    VertexShader = 4,
    /// Transform-feedback writes.
    TransformFeedback = 8,
    /// Compute shaders.
    Compute = 16,
    /// Arguments of indirect dispatches.
    Indirect = 32,
}

/// A kind of memory access, as a bit of [`Scope::accesses`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Access {
    /// A copy writes.
    TransferWrite = 1,
    /// Vertex attributes are fetched.
    AttributeRead = 2,
    /// A shader reads a storage or texel buffer.
    ShaderRead = 4,
    /// A shader writes a storage buffer.
    ShaderWrite = 8,
    /// Transform feedback writes.
    FeedbackWrite = 16,
    /// Arguments of an indirect dispatch are read.
    IndirectRead = 32,
}

impl Access {
    /// Whether it writes.
    pub const fn writes(self) -> bool {
        matches!(self, Self::TransferWrite | Self::ShaderWrite | Self::FeedbackWrite)
    }
}

/// One side of a barrier: sets of stages and accesses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scope {
    /// Bits of [`Stage`].
    pub stages: u8,
    /// Bits of [`Access`].
    pub accesses: u8,
}

impl Scope {
    const fn new(stages: &[Stage], accesses: &[Access]) -> Self {
        let mut scope = Self { stages: 0, accesses: 0 };
        let mut i = 0;
        while i < stages.len() {
            scope.stages |= stages[i] as u8;
            i += 1;
        }
        i = 0;
        while i < accesses.len() {
            scope.accesses |= accesses[i] as u8;
            i += 1;
        }
        scope
    }

    /// Whether `stage` is among the stages.
    pub const fn has_stage(self, stage: Stage) -> bool {
        self.stages & stage as u8 != 0
    }

    /// Whether `access` is among the accesses.
    pub const fn has_access(self, access: Access) -> bool {
        self.accesses & access as u8 != 0
    }
}

/// The barriers we record, each named by the hazard it is there for. All are global memory barriers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Hazard {
    /// Uploads are done: base and deltas may be read by every path.
    TransferWriteToAssetRead,
    /// Draws may still read the slot that compute is about to write; the slot it reads was written by compute.
    PoseReadToComputeUpdate,
    /// One compute pass after another, in place.
    ComputeWriteToComputeUpdate,
    /// The pose is ready for the host's draws.
    ComputeWriteToPoseRead,
    /// As for compute, before the first feedback pass.
    PoseReadToFeedbackUpdate,
    /// A feedback pass reads what the last wrote and writes what the last read.
    FeedbackWriteToFeedbackUpdate,
    /// The pose is ready for the host's draws.
    FeedbackWriteToPoseRead,
    /// Kernels of the last update may still read what a copy is about to write.
    ComputeReadToTransferWrite,
    /// What was copied is there; kernels read and write it.
    TransferWriteToComputeUpdate,
    /// As `PoseReadToComputeUpdate`; the last update's arguments, too, are about to be written anew.
    PoseReadToAnimatedUpdate,
    /// A kernel wrote the arguments of the dispatches that follow, and what they work on.
    ComputeWriteToIndirectUpdate,
    /// As for compute, before the first pass of `vertex-store`.
    PoseReadToVertexStoreUpdate,
    /// A pass of `vertex-store` fetches what the last stored and stores where the last fetched.
    VertexStoreWriteToVertexStoreUpdate,
    /// The pose is ready for the host's draws.
    VertexStoreWriteToPoseRead,
    /// As for compute, before `scatter` clears its sums, which the last update has read, and writes a pose.
    PoseReadToScatterUpdate,
    /// Deltas are added to sums that were cleared.
    ClearToScatter,
}

impl Hazard {
    /// Every barrier.
    pub const ALL: [Self; 16] = [
        Self::TransferWriteToAssetRead,
        Self::PoseReadToComputeUpdate,
        Self::ComputeWriteToComputeUpdate,
        Self::ComputeWriteToPoseRead,
        Self::PoseReadToFeedbackUpdate,
        Self::FeedbackWriteToFeedbackUpdate,
        Self::FeedbackWriteToPoseRead,
        Self::ComputeReadToTransferWrite,
        Self::TransferWriteToComputeUpdate,
        Self::PoseReadToAnimatedUpdate,
        Self::ComputeWriteToIndirectUpdate,
        Self::PoseReadToVertexStoreUpdate,
        Self::VertexStoreWriteToVertexStoreUpdate,
        Self::VertexStoreWriteToPoseRead,
        Self::PoseReadToScatterUpdate,
        Self::ClearToScatter,
    ];

    /// `(before, after)`: what must be finished and made available, and what waits and sees it.
    pub const fn scopes(self) -> (Scope, Scope) {
        use Access as A;
        use Stage as S;
        const DRAWS: Scope = Scope::new(&[S::VertexInput, S::VertexShader], &[A::AttributeRead, A::ShaderRead]);
        const COMPUTE: Scope = Scope::new(&[S::Compute], &[A::ShaderRead, A::ShaderWrite]);
        const FEEDBACK: Scope =
            Scope::new(&[S::VertexInput, S::TransformFeedback], &[A::AttributeRead, A::FeedbackWrite]);
        const STORE: Scope = Scope::new(&[S::VertexInput, S::VertexShader], &[A::AttributeRead, A::ShaderWrite]);
        match self {
            Self::TransferWriteToAssetRead => (
                Scope::new(&[S::Transfer], &[A::TransferWrite]),
                Scope::new(&[S::VertexInput, S::VertexShader, S::Compute], &[A::AttributeRead, A::ShaderRead]),
            ),
            Self::PoseReadToComputeUpdate => {
                (Scope::new(&[S::VertexInput, S::VertexShader, S::Compute], &[A::ShaderWrite]), COMPUTE)
            }
            Self::ComputeWriteToComputeUpdate => (Scope::new(&[S::Compute], &[A::ShaderWrite]), COMPUTE),
            Self::ComputeWriteToPoseRead => (Scope::new(&[S::Compute], &[A::ShaderWrite]), DRAWS),
            Self::PoseReadToFeedbackUpdate => {
                (Scope::new(&[S::VertexInput, S::VertexShader, S::TransformFeedback], &[A::FeedbackWrite]), FEEDBACK)
            }
            Self::FeedbackWriteToFeedbackUpdate => {
                (Scope::new(&[S::VertexInput, S::TransformFeedback], &[A::FeedbackWrite]), FEEDBACK)
            }
            Self::FeedbackWriteToPoseRead => (Scope::new(&[S::TransformFeedback], &[A::FeedbackWrite]), DRAWS),
            Self::ComputeReadToTransferWrite => {
                (Scope::new(&[S::Compute], &[]), Scope::new(&[S::Transfer], &[A::TransferWrite]))
            }
            Self::TransferWriteToComputeUpdate => (Scope::new(&[S::Transfer], &[A::TransferWrite]), COMPUTE),
            Self::PoseReadToAnimatedUpdate => {
                (Scope::new(&[S::VertexInput, S::VertexShader, S::Compute, S::Indirect], &[A::ShaderWrite]), COMPUTE)
            }
            Self::ComputeWriteToIndirectUpdate => (
                Scope::new(&[S::Compute], &[A::ShaderWrite]),
                Scope::new(&[S::Compute, S::Indirect], &[A::ShaderRead, A::ShaderWrite, A::IndirectRead]),
            ),
            // The same stages: what a pass fetches and stores is what a draw may still read.
            Self::PoseReadToVertexStoreUpdate | Self::VertexStoreWriteToVertexStoreUpdate => {
                (Scope::new(&[S::VertexInput, S::VertexShader], &[A::ShaderWrite]), STORE)
            }
            Self::VertexStoreWriteToPoseRead => (Scope::new(&[S::VertexShader], &[A::ShaderWrite]), DRAWS),
            Self::PoseReadToScatterUpdate => (
                Scope::new(&[S::VertexInput, S::VertexShader, S::Compute], &[A::ShaderWrite]),
                Scope::new(&[S::Transfer, S::Compute], &[A::TransferWrite, A::ShaderRead, A::ShaderWrite]),
            ),
            Self::ClearToScatter => (Scope::new(&[S::Transfer], &[A::TransferWrite]), COMPUTE),
        }
    }
}

/// A pass of one instance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PassCommand {
    /// The instance.
    pub instance: u32,
    /// What it adds to.
    pub source: Source,
    /// The slot it writes.
    pub destination: u32,
    /// Which of [`CommandList::coefficients`](CommandList) it adds.
    pub coefficients: Range<usize>,
}

/// The blocks of one instance, all in one pass.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlocksCommand {
    /// The instance.
    pub instance: u32,
    /// The slot that blocks are read from, if any is.
    pub source: Option<u32>,
    /// The slot they are written to.
    pub destination: u32,
    /// Which items of the work list.
    pub items: Range<usize>,
    /// Whether the base pose is read: by rebuilt blocks, and by exact sums always.
    pub reads_base: bool,
    /// Whether integer sums are read and written.
    pub exact: bool,
}

/// What a [`ScatterCommand`] does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScatterStep {
    /// Set the sums to zero.
    Clear,
    /// Add the deltas of the active targets, by atomics.
    Add,
    /// Write the pose: base + sums.
    Resolve,
}

/// A step of `scatter` for one instance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScatterCommand {
    /// The instance.
    pub instance: u32,
    /// What is done.
    pub step: ScatterStep,
    /// The slot that the pose goes to in the end.
    pub destination: u32,
    /// Which of [`CommandList::coefficients`](CommandList) are added.
    pub coefficients: Range<usize>,
}

/// A command of an update.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// A memory barrier.
    Barrier(Hazard),
    /// A pass over all vertices (dense formats).
    Pass(PassCommand),
    /// A pass over blocks.
    Blocks(BlocksCommand),
    /// A step of an update that the GPU plans.
    Animated(AnimatedCommand),
    /// A step of `scatter`.
    Scatter(ScatterCommand),
}

/// What one `record_update` writes into the host's command buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct CommandList {
    /// Who carries it out.
    pub path: UpdatePath,
    /// In order; empty when nothing changed.
    pub commands: Vec<Command>,
    /// Coefficients of all instances.
    pub coefficients: Vec<crate::weights::delta::Coefficient>,
}

impl CommandList {
    /// An empty list.
    pub fn new(path: UpdatePath) -> Self {
        Self { path, commands: vec![], coefficients: vec![] }
    }

    /// The passes.
    pub fn passes(&self) -> impl Iterator<Item = &PassCommand> {
        self.commands.iter().filter_map(|c| match c {
            Command::Pass(pass) => Some(pass),
            Command::Barrier(_) | Command::Blocks(_) | Command::Scatter(_) | Command::Animated(_) => None,
        })
    }

    /// Write the list for one update of a crowd: the k-th passes of all instances stand together, since they
    /// do not depend on each other, with one barrier between rounds.
    pub fn fill(&mut self, plans: &[Plan]) {
        self.commands.clear();
        self.coefficients.clear();
        let rounds = plans.iter().map(|p| p.passes.len()).max().unwrap_or(0);
        if rounds == 0 {
            return;
        }
        let (before, between, after) = match self.path {
            UpdatePath::Feedback => (
                Hazard::PoseReadToFeedbackUpdate,
                Hazard::FeedbackWriteToFeedbackUpdate,
                Hazard::FeedbackWriteToPoseRead,
            ),
            UpdatePath::VertexStore => (
                Hazard::PoseReadToVertexStoreUpdate,
                Hazard::VertexStoreWriteToVertexStoreUpdate,
                Hazard::VertexStoreWriteToPoseRead,
            ),
            // The cpu path has no barriers to record, but its list is the same list.
            _ => (Hazard::PoseReadToComputeUpdate, Hazard::ComputeWriteToComputeUpdate, Hazard::ComputeWriteToPoseRead),
        };
        for round in 0..rounds {
            self.commands.push(Command::Barrier(if round == 0 { before } else { between }));
            for (instance, plan) in plans.iter().enumerate() {
                let Some(pass) = plan.passes.get(round) else { continue };
                let start = self.coefficients.len();
                self.coefficients.extend_from_slice(&plan.coefficients[pass.coefficients.clone()]);
                self.commands.push(Command::Pass(PassCommand {
                    instance: instance as u32,
                    source: pass.source,
                    destination: pass.destination,
                    coefficients: start..self.coefficients.len(),
                }));
            }
        }
        self.commands.push(Command::Barrier(after));
    }

    /// Write the list for one update in blocks: one pass for all instances, which do not depend on each other.
    pub fn fill_blocks(&mut self, items: &[Item], exact: bool) {
        self.commands.clear();
        let mut first = 0;
        for run in items.chunk_by(|a, b| a.instance == b.instance) {
            if first == 0 {
                self.commands.push(Command::Barrier(Hazard::PoseReadToComputeUpdate));
            }
            self.commands.push(Command::Blocks(BlocksCommand {
                instance: run[0].instance,
                source: run.iter().find_map(|item| item.source),
                destination: run[0].destination,
                items: first..first + run.len(),
                reads_base: exact || run.iter().any(|item| item.source.is_none()),
                exact,
            }));
            first += run.len();
        }
        if first > 0 {
            self.commands.push(Command::Barrier(Hazard::ComputeWriteToPoseRead));
        }
    }

    /// Write the list for one update through `scatter`: each step of all instances, which do not depend on each other,
    /// then a barrier.
    pub fn fill_scatter(&mut self, plans: &[Plan]) {
        self.commands.clear();
        self.coefficients.clear();
        if plans.iter().all(|plan| plan.passes.is_empty()) {
            return;
        }
        for (step, before) in [
            (ScatterStep::Clear, Hazard::PoseReadToScatterUpdate),
            (ScatterStep::Add, Hazard::ClearToScatter),
            (ScatterStep::Resolve, Hazard::ComputeWriteToComputeUpdate),
        ] {
            self.commands.push(Command::Barrier(before));
            for (instance, plan) in plans.iter().enumerate().filter(|(_, plan)| !plan.passes.is_empty()) {
                let start = self.coefficients.len();
                if step == ScatterStep::Add {
                    self.coefficients.extend_from_slice(&plan.coefficients);
                }
                self.commands.push(Command::Scatter(ScatterCommand {
                    instance: instance as u32,
                    step,
                    destination: plan.result,
                    coefficients: start..self.coefficients.len(),
                }));
            }
        }
        self.commands.push(Command::Barrier(Hazard::ComputeWriteToPoseRead));
    }

    /// Bytes that the passes load and store: each reads its source and its targets' deltas and writes its
    /// destination, for `vertices` vertices (with padding) of `delta_stride` bytes a target.
    pub fn bytes_moved(&self, vertices: usize, pose_stride: usize, delta_stride: usize) -> u64 {
        self.passes().map(|p| (vertices * (2 * pose_stride + p.coefficients.len() * delta_stride)) as u64).sum()
    }

    /// The least that any order of the same dense work could move: each instance's pose read and written once,
    /// each coefficient's deltas read once.
    pub fn bytes_floor(&self, vertices: usize, pose_stride: usize, delta_stride: usize) -> u64 {
        let mut instances: Vec<u32> = self.passes().map(|p| p.instance).collect();
        instances.sort_unstable();
        instances.dedup();
        (vertices * (2 * pose_stride * instances.len() + self.coefficients.len() * delta_stride)) as u64
    }
}
