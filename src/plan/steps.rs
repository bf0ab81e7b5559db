//! An update as data: steps, and the memory that each of them uses.
//!
//! A technique plans an update as [`Steps`]. A step is work between two barriers: its works are independent of each
//! other, and its [`Use`]s say which memory they read and write. Barriers follow from the uses
//! ([`Schedule`](super::schedule::Schedule)). What comes after an update, such as skinning, is further steps of it.
//!
//! Uses speak of a crowd's memory as a whole (all poses, all sums), so that deriving barriers takes the same time
//! whatever the number of instances. The hazard checker follows every instance and slot.

use super::after::Kind;
use crate::abi::steps::after_steps;
use std::ops::{BitOr, Range};

/// A pipeline stage, as a bit of [`Scope::stages`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
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
    /// Builds of acceleration structures.
    AccelerationStructureBuild = 64,
    /// Task shaders.
    TaskShader = 128,
    /// Mesh shaders.
    MeshShader = 256,
    /// Fragment shaders.
    FragmentShader = 512,
    /// Ray-tracing shaders.
    RayTracingShader = 1024,
    /// Blending and writes of colours.
    ColourOutput = 2048,
}

impl Stage {
    /// The number of its bit.
    pub(super) const fn index(self) -> usize {
        (self as u16).trailing_zeros() as usize
    }
}

/// A kind of memory access, as a bit of [`Scope::accesses`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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
    /// A copy reads.
    TransferRead = 64,
    /// Blending reads and writes.
    Blend = 128,
}

impl Access {
    /// Whether it writes.
    pub const fn writes(self) -> bool {
        matches!(self, Self::TransferWrite | Self::ShaderWrite | Self::FeedbackWrite | Self::Blend)
    }
}

/// One side of a barrier: sets of stages and accesses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scope {
    /// Bits of [`Stage`].
    pub stages: u16,
    /// Bits of [`Access`].
    pub accesses: u8,
}

impl Scope {
    /// Whatever the queue does, and any access.
    pub const ANYTHING: Self = Self { stages: u16::MAX, accesses: u8::MAX };

    /// Whether `stage` is among the stages.
    pub const fn has_stage(self, stage: Stage) -> bool {
        self.stages & stage as u16 != 0
    }

    /// Whether `access` is among the accesses.
    pub const fn has_access(self, access: Access) -> bool {
        self.accesses & access as u8 != 0
    }

    pub(super) const fn contains(self, other: Self) -> bool {
        other.stages & !self.stages == 0 && other.accesses & !self.accesses == 0
    }
}

impl BitOr for Scope {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self { stages: self.stages | other.stages, accesses: self.accesses | other.accesses }
    }
}

macro_rules! resources {
    ({ $($(#[doc = $doc:literal])* $resource:ident,)* } $(
        $(#[doc = $step_doc:literal])*
        $kind:ident $module:ident::$step:ident $face:tt $set:tt {
            $($reads:tt => $written:ident, $push:ident $members:tt $rows:tt;)*
        }
    )*) => {
        /// Memory of a crowd, each kind as a whole.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Resource {
            $($(#[doc = $doc])* $resource,)*
            $($(#[doc = concat!("What the step `", stringify!($kind), "` writes, of all instances.")] $written,)*)*
        }

        impl Resource {
            /// How many there are.
            pub(super) const COUNT: usize = [$(Self::$resource,)* $($(Self::$written,)*)*].len();
        }
    };
}

after_steps!(resources {
    /// Base pose and deltas of the mesh.
    Asset,
    /// Poses of all instances and slots.
    Poses,
    /// Integer sums of all instances.
    Sums,
    /// Clips, and which targets touch which blocks.
    Tables,
    /// What instances play, weights that are animated on the GPU, and which updates touched the blocks: one buffer,
    /// which synchronization validation takes as a whole.
    State,
    /// Work lists that the GPU writes.
    WorkList,
    /// How many items they have, and the arguments of the dispatches that carry them out: one buffer as well.
    Control,
});

/// One way in which memory is used: a [`Resource`] by a step, or what the hazard checker knows of it by a work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Use<M = Resource> {
    /// What is accessed.
    pub memory: M,
    /// In which stage.
    pub stage: Stage,
    /// How.
    pub access: Access,
}

impl<M> Use<M> {
    /// A use.
    pub const fn new(memory: M, stage: Stage, access: Access) -> Self {
        Self { memory, stage, access }
    }

    /// A compute shader reads.
    pub const fn read(memory: M) -> Self {
        Self::new(memory, Stage::Compute, Access::ShaderRead)
    }

    /// A compute shader writes.
    pub const fn write(memory: M) -> Self {
        Self::new(memory, Stage::Compute, Access::ShaderWrite)
    }

    /// A copy or fill writes.
    pub const fn copy(memory: M) -> Self {
        Self::new(memory, Stage::Transfer, Access::TransferWrite)
    }

    /// Its side of a barrier.
    pub(crate) const fn scope(&self) -> Scope {
        Scope { stages: self.stage as u16, accesses: self.access as u8 }
    }
}

/// Who reads poses, and what is [decoded](crate::DecodeTarget) of them, between updates, on the queue of the updates:
/// the barriers of an update wait for these readers, and make the new poses visible to them. Combined with `|`.
///
/// Readers on another queue are ordered by semaphores, which no barrier can stand in for
/// ([`MorphEngine`](crate::MorphEngine#several-queues)); leave them out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Consumers(u8);

/// The list of consumers: documentation, name and bit; whether only a queue with graphics has them; where and how they
/// read.
macro_rules! consumers {
    ($($(#[doc = $doc:literal])* $name:ident $bit:literal, graphics: $graphics:literal, $([$stage:ident $access:ident])*;)*) => {
        impl Consumers {
            $($(#[doc = $doc])* pub const $name: Self = Self($bit);)*

            const READS: &[(u8, bool, &[(Stage, Access)])] =
                &[$(($bit, $graphics, &[$((Stage::$stage, Access::$access)),*])),*];
        }
    };
}

consumers! {
    /// Draws that fetch poses as vertex attributes.
    VERTEX_ATTRIBUTES 1, graphics: true, [VertexInput AttributeRead];
    /// Vertex shaders that read poses from storage buffers.
    VERTEX_SHADERS 2, graphics: true, [VertexShader ShaderRead];
    /// Compute shaders, such as those of a skinning pass.
    COMPUTE_SHADERS 4, graphics: false, [Compute ShaderRead];
    /// Copies.
    COPIES 8, graphics: false, [Transfer TransferRead];
    /// Builds of acceleration structures, from poses of float32 or from decoded positions. The device has to have them
    /// enabled (VK_KHR_acceleration_structure).
    ACCELERATION_STRUCTURES 16, graphics: false, [AccelerationStructureBuild ShaderRead];
    /// Task and mesh shaders that read poses from storage buffers. The device has to have both enabled
    /// (VK_EXT_mesh_shader, features `taskShader` and `meshShader`).
    MESH_SHADERS 32, graphics: true, [TaskShader ShaderRead] [MeshShader ShaderRead];
    /// Fragment shaders that read poses from storage buffers, such as those that find a vertex of a triangle by its
    /// number.
    FRAGMENT_SHADERS 64, graphics: true, [FragmentShader ShaderRead];
    /// Shaders of ray-tracing pipelines that read poses from storage buffers, such as those of a hit. The device has to
    /// have these pipelines enabled (VK_KHR_ray_tracing_pipeline). Ray queries read in the stage of the shader that
    /// makes them.
    RAY_TRACING_SHADERS 128, graphics: false, [RayTracingShader ShaderRead];
}

impl Consumers {
    /// Nobody on the queue of the updates.
    pub const NONE: Self = Self(0);

    /// Those whose bits these are; `None`: there is a bit of none.
    pub fn from_bits(bits: u32) -> Option<Self> {
        let known = Self::READS.iter().fold(0, |all, (bit, ..)| all | bit);
        u8::try_from(bits).ok().filter(|bits| bits & !known == 0).map(Self)
    }

    /// Those that a queue with or without graphics can have: the stages of the others are on another queue.
    pub fn of_queue(self, graphics: bool) -> Self {
        let there = Self::READS.iter().filter(|(_, only_graphics, _)| graphics || !only_graphics);
        Self(there.fold(0, |all, (bit, ..)| all | bit) & self.0)
    }

    /// What they do with memory of this kind.
    pub fn uses(self, memory: Resource) -> impl Iterator<Item = Use> {
        let named = Self::READS.iter().filter(move |(bit, ..)| self.0 & bit != 0);
        named.flat_map(|(.., reads)| *reads).map(move |&(stage, access)| Use::new(memory, stage, access))
    }
}

impl BitOr for Consumers {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Default for Consumers {
    /// Vertex attributes and vertex shaders.
    fn default() -> Self {
        Self::VERTEX_ATTRIBUTES | Self::VERTEX_SHADERS
    }
}

/// What a work reads from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Source {
    /// The base pose.
    #[default]
    Base,
    /// The pose in this slot.
    Slot(u32),
}

/// Whose a work is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Owner {
    /// The technique's that planned the update.
    #[default]
    Technique,
    /// A step's after the pose.
    Step(Kind),
}

/// A piece of a step, in the numbers of its owner.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Who records it.
    pub owner: Owner,
    /// Which of the owner's kernels; of a step after the pose, which of its dispatches.
    pub kernel: u32,
    /// The group of the mesh.
    pub group: u32,
    /// The instance, or the group of instances.
    pub instance: u32,
    /// What is read.
    pub source: Source,
    /// The slot that is written.
    pub destination: u32,
    /// Which of the planned items or coefficients.
    pub items: Range<u32>,
}

/// What happens between two barriers.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Step {
    uses: &'static [Use],
    /// Its works end here in [`Steps::works`].
    end: usize,
}

/// The planned steps of one update.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Steps {
    steps: Vec<Step>,
    works: Vec<Work>,
    consumers: Consumers,
    /// What follows the last step.
    after: Vec<Use>,
}

impl Steps {
    /// No steps yet; poses are read by `consumers` when the update is done.
    pub fn new(consumers: Consumers) -> Self {
        Self { steps: vec![], works: vec![], consumers, after: consumers.uses(Resource::Poses).collect() }
    }

    /// What further steps write is read by the same consumers as poses are.
    pub fn read_besides(&mut self, written: impl Iterator<Item = Resource>) {
        self.after.retain(|used| used.memory == Resource::Poses);
        self.after.extend(written.flat_map(|memory| self.consumers.uses(memory)));
    }

    /// What each step uses.
    pub fn uses(&self) -> impl Iterator<Item = &'static [Use]> {
        self.steps.iter().map(|step| step.uses)
    }

    /// Forget the last update.
    pub fn clear(&mut self) {
        self.steps.clear();
        self.works.clear();
    }

    /// Begin a step: the works pushed from now on are independent of each other.
    pub fn step(&mut self, uses: &'static [Use]) {
        self.steps.push(Step { uses, end: self.works.len() });
    }

    /// Append a work to the step begun last.
    pub fn push(&mut self, work: Work) {
        self.works.push(work);
        if let Some(step) = self.steps.last_mut() {
            step.end = self.works.len();
        }
    }

    /// Number of steps.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether there is nothing to record.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// All works in order.
    pub fn works(&self) -> &[Work] {
        &self.works
    }

    pub(super) fn works_of(&self, step: usize) -> &[Work] {
        let first = step.checked_sub(1).map_or(0, |before| self.steps[before].end);
        &self.works[first..self.steps[step].end]
    }

    /// What a round uses: the step of this number; after the `last` step of all, what follows the update.
    pub(super) fn uses_of(&self, step: usize, last: usize) -> &[Use] {
        match self.steps.get(step) {
            Some(step) => step.uses,
            // Nothing was done: nobody has to wait.
            None if step == last && !self.is_empty() => &self.after,
            None => &[],
        }
    }
}
