//! What a step after the pose is: its dispatches, and what it does for one instance.

use super::output::aligned;
use super::pieces::Pieces;
use crate::abi::modules::Kernel;
use crate::abi::numbers::WORKGROUP;
use crate::asset::streams::TRIPLE;
use crate::error::{Error, Result};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::pipelines::{Kernels, Objects, PipelineKey};
use crate::pack::vertex::PlaceConstants;
use crate::pack::{DeltaFormat, PoseFormat};
use crate::update::technique::PoseGroup;
use ash::vk;
use std::any::Any;
use std::sync::Arc;

/// A dispatch for one instance.
pub(crate) struct Job {
    /// Which of the step's.
    pub(super) dispatch: usize,
    /// The part of the ring of lists.
    pub(super) frame: u64,
    /// The slot of the pose.
    pub(super) slot: u32,
    /// Which of the places that are written in turn.
    pub(super) output: usize,
    /// Pieces to write…
    pub(super) count: u32,
    /// … which are those of the list, or the first ones.
    pub(super) is_listed: bool,
}

/// What a step does for one instance.
pub(crate) trait Follower: Any + Send + Sync {
    /// Add the pieces to write where these pieces of the pose changed.
    fn spread(&self, changed: &Pieces, written: &mut Pieces) {
        written.add_all(changed);
    }

    /// Whether something else than the pose changed since it was asked last: all is written then.
    fn take_changed(&mut self) -> bool {
        false
    }

    /// Record a dispatch.
    ///
    /// # Safety
    /// As [`Technique::record`](crate::update::technique::Technique::record); the buffers of the target live until it
    /// has run.
    unsafe fn record(&self, cmd: vk::CommandBuffer, job: &Job);
}

/// How poses are read: what pipelines are made for.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Pose {
    pub(super) format: PoseFormat,
    /// Specialization constants; `None`: their defaults are right.
    places: Option<PlaceConstants>,
}

impl Pose {
    /// The last specialization constants.
    pub(super) fn constants(&self) -> &[u32] {
        self.places.as_ref().map_or(&[], |places| places)
    }
}

/// The pipeline of a step's kernel, for a format of poses.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct PoseKernel(pub(super) &'static Kernel, pub(super) Pose);

impl PipelineKey for PoseKernel {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self(kernel, pose) = self;
        objects.add_layout(&[kernel.row], 0)?;
        // Steps read no deltas: the module is the same for each of their formats.
        objects.add_compute(kernel.module(DeltaFormat::Float32.row(), pose.format.row(), 0)?, &[pose.constants()])
    }
}

/// What a target is made from.
pub(crate) struct Place<'a> {
    pub(crate) device: &'a Arc<Device>,
    pub(crate) kernels: &'a Kernels,
    /// Positions and normals.
    pub(crate) group: &'a PoseGroup,
    pub(crate) frames: u32,
    pub(crate) instance: u32,
}

impl Place<'_> {
    /// All slots of the instance.
    pub(super) fn poses(&self) -> BufferRange {
        self.group.poses.range(self.instance, 1)
    }

    /// Numbers from pose to pose.
    pub(super) fn pose_numbers(&self) -> u32 {
        self.group.poses.numbers()
    }

    /// The format of poses, and where numbers are in vertices of the host's own.
    pub(super) fn pose(&self) -> Pose {
        Pose { format: self.group.poses.format, places: self.group.poses.place_constants() }
    }

    /// Refuse normals of `what`, where poses are in vertices that have none.
    pub(super) fn check_normals(&self, what: &str) -> Result<()> {
        if self.group.poses.places.bytes(self.group.poses.format)[TRIPLE].is_some() {
            return Ok(());
        }
        let name = &self.group.mesh.layout.name;
        let text = format!("normals of mesh '{name}' in {what}, which the host's vertices do not have");
        Err(Error::invalid(text, "name Semantic::Normal in the VertexLayout, or ask for positions alone"))
    }

    /// The base pose, and the word that it begins at.
    pub(super) fn base_pose(&self) -> (BufferRange, u32) {
        let base = self.group.mesh.base_pose();
        let (range, before) = aligned(base.buffer, base.offset, base.size);
        (range, (before / 4) as u32)
    }

    /// Refuse poses that no descriptor covers, and more pieces than a dispatch takes.
    pub(super) fn check(&self, what: &str, piece: u32) -> Result<()> {
        let (layout, caps) = (&self.group.mesh.layout, &self.device.caps);
        let what = format!("{what} mesh '{}':", layout.name);
        let (poses, range) = (self.poses().size, caps.max_storage_range);
        caps.check_limit(
            &format!("{what} the slots of one instance take"),
            (poses, "bytes", range),
            "use fewer slots",
        )?;
        let workgroups = (layout.vertex_count as u32).div_ceil(piece).div_ceil((WORKGROUP / piece).max(1));
        let limit = (workgroups.into(), "workgroups", caps.max_workgroups.into());
        caps.check_limit(&format!("{what} it takes"), limit, "split the mesh")
    }
}
