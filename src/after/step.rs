//! Interface of a post-morph pass: its dispatch for one instance.

use super::pieces::Pieces;
use crate::abi::modules::Kernel;
use crate::abi::numbers::{PIECE, WORKGROUP};
use crate::asset::streams::TRIPLE;
use crate::error::{Result, ensure};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::pipelines::{Kernels, Objects, PipelineKey, Pipelines, Workgroups};
use crate::pack::vertex::OffsetConstants;
use crate::pack::{DeltaFormat, PoseFormat};
use crate::update::technique::PoseGroup;
use ash::vk;
use bytemuck::{Pod, bytes_of};
use std::any::Any;
use std::sync::Arc;

/// A dispatch for one instance.
pub(crate) struct Job {
    /// Index in the ring of lists.
    pub(super) frame: u64,
    pub(super) slot: u32,
    /// Index of the output buffer.
    pub(super) output: usize,
    pub(super) count: u32,
    /// They are the list's; otherwise the first ones.
    pub(super) is_listed: bool,
}

/// A post-morph pass, for one instance.
pub(crate) trait AfterStep: Any + Send + Sync {
    /// Adds to `written` the pieces to write when the pieces `changed` of the pose changed.
    fn spread(&self, changed: &Pieces, written: &mut Pieces) {
        written.add_all(changed);
    }

    /// Whether anything but the pose changed since the last call, so that everything is to be written.
    fn take_changed(&mut self) -> bool {
        false
    }

    /// Records a dispatch.
    ///
    /// # Safety
    /// See [`Technique::record`](crate::update::technique::Technique::record); the target's buffers live until it has
    /// finished.
    unsafe fn record(&self, cmd: vk::CommandBuffer, job: &Job);
}

/// The encoding of poses, part of pipeline keys.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Pose {
    pub format: PoseFormat,
    /// Component offsets; `None`: the kernel's defaults.
    offsets: Option<OffsetConstants>,
}

impl Pose {
    /// The last specialization constants.
    pub fn constants(&self) -> &[u32] {
        self.offsets.as_ref().map_or(&[], |offsets| offsets)
    }
}

#[derive(Clone, Copy, PartialEq)]
pub(super) struct PoseKernel(pub(super) &'static Kernel, pub(super) Pose);

impl PipelineKey for PoseKernel {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self(kernel, pose) = self;
        objects.add_layout(&[kernel.row], 0)?;
        // Steps read no deltas: the module is the same for every delta format.
        objects.add_compute(kernel.module(DeltaFormat::Float32.row(), pose.format.row(), 0)?, &[pose.constants()])
    }
}

/// A step's kernel, and what it binds for one instance.
pub(super) struct Bound<K> {
    pub kernel: Arc<Pipelines<K>>,
    /// By list and output buffer.
    sets: Sets,
    /// Numbers per pose, padding included.
    pose_numbers: u32,
}

impl<K: PipelineKey> Bound<K> {
    pub fn new(context: &TargetContext<'_>, key: K, bound: &[impl AsRef<[BufferRange]>]) -> Result<Self> {
        let kernel = context.kernels.get(key)?;
        Ok(Self { sets: kernel.objects.sets(bound)?, kernel, pose_numbers: context.group.poses.numbers() })
    }

    /// The first number of the pose that a job reads.
    pub fn pose_at(&self, job: &Job) -> u32 {
        job.slot * self.pose_numbers
    }

    /// Records the dispatch of a job.
    ///
    /// # Safety
    /// See [`AfterStep::record`]; the set is of the job's list.
    pub unsafe fn dispatch(&self, cmd: vk::CommandBuffer, job: &Job, set: usize, push: &impl Pod) {
        let workgroups = Workgroups::Of([job.count.div_ceil(WORKGROUP / PIECE), 1]);
        let set = (self.sets.get(set), &[][..]);
        // SAFETY: the caller's obligations; the set was made for this layout.
        unsafe { self.kernel.objects.dispatch(cmd, 0, set, bytes_of(push), workgroups) };
    }
}

pub(crate) struct TargetContext<'a> {
    pub device: &'a Arc<Device>,
    pub kernels: &'a Kernels,
    /// The group of positions and normals.
    pub group: &'a PoseGroup,
    pub frames: u32,
    pub instance: u32,
}

impl TargetContext<'_> {
    /// All slots of the instance.
    pub(super) fn poses(&self) -> BufferRange {
        self.group.poses.range(self.instance, 1)
    }

    /// Pose format, and component offsets in host vertices.
    pub(super) fn pose(&self) -> Pose {
        Pose { format: self.group.poses.format, offsets: self.group.poses.offset_constants() }
    }

    /// Checks that host vertices contain normals; `what` needs them.
    pub(super) fn check_normals(&self, what: &str) -> Result<()> {
        let PoseGroup { mesh, poses } = self.group;
        let name = &mesh.layout.name;
        let text = format!("normals of mesh '{name}' in {what}, which the host's vertices do not have");
        let remedy = "add Semantic::Normal to the VertexLayout, or use a target without normals";
        ensure!(poses.offsets.bytes(poses.format)[TRIPLE].is_some(), text, remedy);
        Ok(())
    }

    /// Input units per number of a position, then of a normal; and the position of number 0.
    pub(super) fn scale(&self) -> [[f32; 4]; 2] {
        let [[x, y, z, normal, ..], [a, b, c, ..]] = self.group.poses.scale();
        [[x, y, z, normal], [a, b, c, 0.0]]
    }

    /// Checks poses against the storage range, and pieces against the workgroups of a dispatch.
    pub(super) fn check(&self, what: &str) -> Result<()> {
        let layout = &self.group.mesh.layout;
        let caps = &self.device.caps;
        let what = format!("{what} mesh '{}':", layout.name);
        let poses = self.poses().size;
        let range = caps.max_storage_range;
        caps.check_limit(
            &format!("{what} the slots of one instance take"),
            (poses, "bytes", range),
            "use fewer slots",
        )?;
        let workgroups = (layout.vertex_count as u32).div_ceil(PIECE).div_ceil(WORKGROUP / PIECE);
        let limit = (workgroups.into(), "workgroups", caps.max_workgroups.into());
        caps.check_limit(&format!("{what} it takes"), limit, "split the mesh")
    }
}
