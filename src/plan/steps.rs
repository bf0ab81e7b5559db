//! An update as data: steps and the memory they use.
//!
//! A technique plans an update as [`Steps`]. The works of a step are independent of each other; its [`Use`]s say which
//! memory they read and write, and barriers between steps follow from that ([`Schedule`](super::schedule::Schedule)).
//! Post-morph passes, such as skinning, are further steps of the update.
//!
//! A use names a crowd's memory as a whole (all poses, all sums), so that deriving barriers takes the same time for any
//! number of instances. The hazard checker tracks every instance and slot.

use ash::vk::{AccessFlags as A, PipelineStageFlags as S};
use std::ops::{BitOr, Range};

/// A pipeline stage, as Vulkan's bit of [`Scope::stages`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Stage {
    /// Copies.
    Transfer = S::TRANSFER.as_raw(),
    /// Vertex-attribute fetch.
    VertexInput = S::VERTEX_INPUT.as_raw(),
    /// Vertex shaders.
    VertexShader = S::VERTEX_SHADER.as_raw(),
    /// Transform-feedback writes.
    TransformFeedback = S::TRANSFORM_FEEDBACK_EXT.as_raw(),
    /// Compute shaders.
    Compute = S::COMPUTE_SHADER.as_raw(),
    /// Arguments of indirect dispatches.
    Indirect = S::DRAW_INDIRECT.as_raw(),
    /// Builds of acceleration structures.
    AccelerationStructureBuild = S::ACCELERATION_STRUCTURE_BUILD_KHR.as_raw(),
    /// Task shaders.
    TaskShader = S::TASK_SHADER_EXT.as_raw(),
    /// Mesh shaders.
    MeshShader = S::MESH_SHADER_EXT.as_raw(),
    /// Fragment shaders.
    FragmentShader = S::FRAGMENT_SHADER.as_raw(),
    /// Ray-tracing shaders.
    RayTracingShader = S::RAY_TRACING_SHADER_KHR.as_raw(),
    /// Colour attachment blending and writes.
    ColourOutput = S::COLOR_ATTACHMENT_OUTPUT.as_raw(),
}

impl Stage {
    pub(super) const fn index(self) -> usize {
        (self as u32).trailing_zeros() as usize
    }
}

/// A kind of memory access, as Vulkan's bits of [`Scope::accesses`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Access {
    /// A copy writes.
    TransferWrite = A::TRANSFER_WRITE.as_raw(),
    /// Vertex attributes are fetched.
    AttributeRead = A::VERTEX_ATTRIBUTE_READ.as_raw(),
    /// A shader reads a storage or texel buffer.
    ShaderRead = A::SHADER_READ.as_raw(),
    /// A shader writes a storage buffer.
    ShaderWrite = A::SHADER_WRITE.as_raw(),
    /// Transform feedback writes.
    FeedbackWrite = A::TRANSFORM_FEEDBACK_WRITE_EXT.as_raw(),
    /// Arguments of an indirect dispatch are read.
    IndirectRead = A::INDIRECT_COMMAND_READ.as_raw(),
    /// A copy reads.
    TransferRead = A::TRANSFER_READ.as_raw(),
    /// Blending reads and writes.
    Blend = A::COLOR_ATTACHMENT_READ.as_raw() | A::COLOR_ATTACHMENT_WRITE.as_raw(),
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
    pub stages: u32,
    /// Bits of [`Access`].
    pub accesses: u32,
}

impl Scope {
    /// All stages and accesses.
    pub const ANYTHING: Self = Self { stages: u32::MAX, accesses: u32::MAX };

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

/// Memory of a crowd, by kind, over all instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Resource {
    /// Base pose and deltas of the mesh.
    Asset,
    /// Poses of all instances and slots.
    Poses,
    /// Integer sums of all instances.
    Sums,
    /// Clips, and the table of targets by block.
    Tables,
    /// Clips and times of instances, weights animated on the GPU, and the last update of each block: one buffer, since
    /// synchronization validation tracks whole buffers.
    State,
    /// Work lists written by the GPU.
    WorkList,
    /// Item counts and indirect dispatch arguments: one buffer, for the same reason.
    Control,
    /// What [`PostMorphPass::Output`] writes, of all instances.
    Outputs,
    /// What [`PostMorphPass::Normals`] writes, of all instances.
    Normals,
}

impl Resource {
    pub(super) const COUNT: usize = Self::Normals as usize + 1;
}

/// A use of memory: of a [`Resource`] by a step, or of the hazard checker's memory by a work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Use<M = Resource> {
    /// The memory.
    pub memory: M,
    /// The stage.
    pub stage: Stage,
    /// The access.
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

    pub(crate) const fn scope(&self) -> Scope {
        Scope { stages: self.stage as u32, accesses: self.access as u32 }
    }
}

/// Readers of poses and [outputs](crate::after) between updates, on the queue of the updates. An
/// update's barriers wait for these readers, and make the new poses visible to them. Combined with `|`.
///
/// Leave out readers on another queue: semaphores order them, barriers cannot
/// ([`MorphEngine`](crate::MorphEngine#several-queues)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Consumers(u8);

/// Each consumer: documentation, name, bit, whether it needs a graphics queue, and its stages and accesses.
macro_rules! consumers {
    ($(
        $(#[doc = $doc:literal])*
        $name:ident $bit:literal, graphics: $graphics:literal, $([$stage:ident $access:ident])*;
    )*) => {
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
    /// Acceleration structure builds, from float32 poses or decoded positions. Needs VK_KHR_acceleration_structure.
    ACCELERATION_STRUCTURES 16, graphics: false, [AccelerationStructureBuild ShaderRead];
    /// Task and mesh shaders that read poses from storage buffers. Needs VK_EXT_mesh_shader with `taskShader` and
    /// `meshShader`.
    MESH_SHADERS 32, graphics: true, [TaskShader ShaderRead] [MeshShader ShaderRead];
    /// Fragment shaders that read poses from storage buffers, such as to fetch the vertices of a triangle by index.
    FRAGMENT_SHADERS 64, graphics: true, [FragmentShader ShaderRead];
    /// Shaders of ray-tracing pipelines that read poses from storage buffers, such as hit shaders. Needs
    /// VK_KHR_ray_tracing_pipeline. Ray queries count as reads in the stage of the shader that makes them.
    RAY_TRACING_SHADERS 128, graphics: false, [RayTracingShader ShaderRead];
}

impl Consumers {
    /// No readers on the queue of the updates.
    pub const NONE: Self = Self(0);

    /// The consumers of a bit mask; `None` if it has unknown bits. There are eight, so no others are in a byte.
    pub fn from_bits(bits: u32) -> Option<Self> {
        bits.try_into().ok().map(Self)
    }

    /// The consumers that a queue with or without graphics can have.
    pub(crate) fn of_queue(self, graphics: bool) -> Self {
        let there = Self::READS.iter().filter(|(_, only_graphics, _)| graphics || !only_graphics);
        Self(there.fold(0, |all, (bit, ..)| all | bit) & self.0)
    }

    /// Their uses of `memory`.
    pub(crate) fn uses(self, memory: Resource) -> impl Iterator<Item = Use> {
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

/// Post-morph passes, in recording order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PostMorphPass {
    /// Writes the pose, skinned or not.
    Output,
    /// Writes normals of the morphed surface.
    Normals,
}

impl PostMorphPass {
    /// Every pass.
    pub const ALL: [Self; 2] = [Self::Output, Self::Normals];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Output => "output",
            Self::Normals => "normals",
        }
    }

    /// The memory uses of its dispatch.
    pub const fn uses(self) -> &'static [Use] {
        match self {
            Self::Output => const { &Self::in_place(Resource::Outputs) },
            Self::Normals => const { &Self::in_place(Resource::Normals) },
        }
    }

    /// Words that outputs share with components of the application are read and written.
    const fn in_place(output: Resource) -> [Use; 3] {
        [Use::read(Resource::Poses), Use::read(output), Use::write(output)]
    }

    /// The output that the application reads.
    pub const fn output(self) -> Resource {
        match self {
            Self::Output => Resource::Outputs,
            Self::Normals => Resource::Normals,
        }
    }
}

/// The source pose of a work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Source {
    /// The base pose.
    #[default]
    Base,
    /// The pose in this slot.
    Slot(u32),
}

/// The planner of a work, which also records it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Owner {
    /// The crowd's technique.
    #[default]
    Technique,
    /// A post-morph pass.
    Pass(PostMorphPass),
}

/// A dispatch or draw of a step. Its owner defines the numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Planned and recorded by.
    pub owner: Owner,
    /// Index of the technique's kernel; 0 for a post-morph pass.
    pub kernel: u32,
    /// The group of the mesh.
    pub group: u32,
    /// The instance, or the group of instances.
    pub instance: u32,
    /// The source pose.
    pub source: Source,
    /// The destination slot.
    pub destination: u32,
    /// Range of the planned items or coefficients.
    pub items: Range<u32>,
}

/// Works between two barriers.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Step {
    uses: &'static [Use],
    /// End of its works in [`Steps::works`].
    end: usize,
}

/// The planned steps of one update.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Steps {
    steps: Vec<Step>,
    works: Vec<Work>,
    consumers: Consumers,
    /// Uses after the last step.
    after: Vec<Use>,
}

impl Steps {
    /// No steps; `consumers` read the poses after the update.
    pub fn new(consumers: Consumers) -> Self {
        Self { steps: vec![], works: vec![], consumers, after: consumers.uses(Resource::Poses).collect() }
    }

    /// Adds outputs that `consumers` read after the update, beside poses.
    pub fn read_besides(&mut self, written: impl Iterator<Item = Resource>) {
        self.after.retain(|used| used.memory == Resource::Poses);
        self.after.extend(written.flat_map(|memory| self.consumers.uses(memory)));
    }

    /// The uses of each step.
    pub fn uses(&self) -> impl Iterator<Item = &'static [Use]> {
        self.steps.iter().map(|step| step.uses)
    }

    /// Removes all steps and works.
    pub fn clear(&mut self) {
        self.steps.clear();
        self.works.clear();
    }

    /// Begins a step: works pushed from now on are independent of each other.
    pub fn step(&mut self, uses: &'static [Use]) {
        self.steps.push(Step { uses, end: self.works.len() });
    }

    /// Adds a work to the last step.
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

    /// Whether there are no steps.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// All works in order.
    pub fn works(&self) -> &[Work] {
        &self.works
    }

    /// The first work of each step that has any.
    pub fn firsts(&self) -> impl Iterator<Item = &Work> {
        (0..self.len()).filter_map(|step| self.works_of(step).first())
    }

    pub(super) fn works_of(&self, step: usize) -> &[Work] {
        let first = step.checked_sub(1).map_or(0, |before| self.steps[before].end);
        &self.works[first..self.steps[step].end]
    }

    /// Uses of round `step`: those of this step, or of the consumers in round `last`.
    pub(super) fn uses_of(&self, step: usize, last: usize) -> &[Use] {
        match self.steps.get(step) {
            Some(step) => step.uses,
            // An empty update has no consumers to synchronize.
            None if step == last && !self.is_empty() => &self.after,
            None => &[],
        }
    }
}
