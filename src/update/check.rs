//! Device requirements of update paths, and the checks of an [`UpdateDesc`]: by itself, for a mesh, and for its runner.

use crate::abi::kernels::batch_max;
use crate::abi::numbers::{DENSE_BATCH_MAX, WORKGROUP};
use crate::abi::push::attribute_push_bytes;
use crate::error::{Error, Result, ensure, refuse};
use crate::gpu::caps::{CAPTURE_STRIDE, DeviceCaps, Requirement};
use crate::pack::{DeltaFormat, PackedLayout};
use crate::plan::paths::{Batch, Needs};
use crate::plan::{BatchSize, UpdateDesc, UpdateMode, UpdatePath};
use ash::vk;

/// Most slots of a crowd animated on the GPU, which keeps one bit per update since a slot was written.
const ANIMATED_SLOTS_MAX: u32 = 32;

/// The executor of updates.
#[derive(Clone, Copy)]
pub(crate) enum Runner<'a> {
    /// Not known yet.
    Unknown,
    /// [`CpuCrowd`](crate::cpu::CpuCrowd).
    Cpu,
    Device(&'a DeviceCaps),
    /// A device, for a crowd animated on the GPU.
    Animated(&'a DeviceCaps),
}

impl UpdateDesc {
    /// Checks the description by itself.
    ///
    /// # Errors
    /// A batch size of 0; too few or too many slots for the path; a tolerance that is not positive; an error budget
    /// that is negative, not finite or unsupported by the path; a pose format that the path does not support;
    /// incremental updates on a path that only rebuilds.
    #[doc(hidden)]
    pub fn check(&self) -> Result<()> {
        let path = self.path;
        let name = self.path.name();
        let least = if path.works_in_place() { 1 } else { 2 };
        let slots = self.slots;
        let remedy = format!("use {least} to 64 slots (2 is ping-pong)");
        ensure!((least..=64).contains(&slots), format!("{slots} slots for update path '{name}'"), remedy);
        let Self { tolerance, error_budget, .. } = *self;
        let what = format!("a tolerance of {tolerance} and an error budget of {error_budget}");
        let fits = tolerance > 0.0 && error_budget >= 0.0 && error_budget.is_finite();
        ensure!(fits, what, "use a tolerance above 0 and a budget of 0 or more");
        if !path.poses().contains(&self.pose) {
            let names: Vec<&str> = path.poses().iter().map(|pose| pose.name()).collect();
            let takes = UpdatePath::ALL.into_iter().filter(|path| path.poses().contains(&self.pose));
            let paths: Vec<String> = takes.map(|path| format!("'{}'", path.name())).collect();
            let remedy = format!("use {} poses here, or the path {}", names.join(" or "), paths.join(" or "));
            return refuse(format!("{} poses with '{name}'", self.pose.name()), remedy);
        }
        let fits = !path.row().rebuilds_only || self.mode != UpdateMode::Incremental;
        let remedy = "use the mode 'rebuild': this technique evaluates every pose from the base pose";
        ensure!(fits, format!("incremental updates through '{name}'"), remedy);
        if path.row().sums_integers || !path.formats().iter().any(|format| format.is_blocks()) {
            self.check_dense(name)?;
        }
        match self.batch {
            BatchSize::Targets(0) => refuse("a batch size of 0", "use 1 or more targets per pass"),
            BatchSize::All if !path.takes_all_targets() => refuse(
                format!("batch size 'all' for update path '{name}'"),
                "the device's vertex attributes limit the targets of a vertex pass: use a number",
            ),
            BatchSize::Targets(_) | BatchSize::All => Ok(()),
        }
    }

    /// Checks the description for a mesh of this `layout`.
    ///
    /// # Errors
    /// Errors of [`check`](Self::check), and of [`PackedLayout::grid`] for fixed-point poses.
    pub fn check_for(&self, layout: &PackedLayout) -> Result<()> {
        self.check_all(layout, Runner::Unknown)
    }

    /// Checks the description for a mesh and a runner.
    ///
    /// # Errors
    /// Errors of [`check_for`](Self::check_for); a path that the runner does not implement, or the device does not
    /// support; a batch size above [`DeviceCaps::batch_max`]; a delta format that the path does not support; blocks
    /// larger than a workgroup; properties that crowds animated on the GPU do not support.
    pub(crate) fn check_all(&self, layout: &PackedLayout, runner: Runner<'_>) -> Result<()> {
        // First, so that a missing path is reported before its details.
        if let Runner::Device(caps) | Runner::Animated(caps) = runner {
            caps.check_path(self.path)?;
        }
        self.check()?;
        match runner {
            Runner::Cpu if self.path != UpdatePath::Cpu => {
                let remedy = "use UpdatePath::Cpu here, or MorphEngine for the GPU paths";
                return refuse(format!("update path '{}' for a CpuCrowd", self.path.name()), remedy);
            }
            Runner::Device(caps) | Runner::Animated(caps) => self.check_on_device(layout, caps)?,
            Runner::Unknown | Runner::Cpu => {}
        }
        if layout.blocks.is_none() {
            self.check_dense(layout.format.name())?;
        }
        self.grid(layout)?;
        if let Runner::Animated(_) = runner { self.check_animated(layout) } else { Ok(()) }
    }

    /// Rejects an error budget, which only sums of deltas in blocks support; `name` is the path or the format.
    fn check_dense(&self, name: &str) -> Result<()> {
        let remedy = "use the path 'blocks', or 'cpu' with a block format ('fast', 'small')";
        ensure!(self.error_budget == 0.0, format!("an error budget with '{name}'"), remedy);
        Ok(())
    }

    /// Checks the delta format, block size and batch size against the path and the device.
    fn check_on_device(&self, layout: &PackedLayout, caps: &DeviceCaps) -> Result<()> {
        let path = self.path;
        let device = &caps.name;
        path.check_format(layout.format)?;
        let what = path.with_deltas(layout.format);
        let size = layout.blocks.as_ref().map_or(0, |blocks| blocks.size());
        let most = caps.max_workgroup_invocations;
        let fits = path != UpdatePath::Blocks || size <= most as usize;
        let remedy = format!("pack with blocks of at most {most} vertices");
        ensure!(fits, format!("blocks of {size} vertices on {device}"), remedy);
        match (self.batch, caps.batch_max(path, layout.format)) {
            (BatchSize::Targets(batch), Some(most)) if batch > most => {
                let all = if path.takes_all_targets() { ", or 'all'" } else { "" };
                refuse(format!("batch size {batch} for {what} on {device}"), format!("use 1 to {most}{all}"))
            }
            (BatchSize::Targets(_) | BatchSize::All, _) => Ok(()),
        }
    }

    /// Checks the requirements of crowds animated on the GPU. Float32 sums drift, and the GPU keeps no bound on it.
    pub(super) fn check_animated(&self, layout: &PackedLayout) -> Result<()> {
        let refuse =
            |what: String, remedy: &str| Error::invalid(format!("{what} in a crowd animated on the GPU"), remedy);
        let Self { path, error_budget, pose, slots, .. } = *self;
        let Some(index) = layout.blocks.as_ref().filter(|_| path == UpdatePath::Blocks) else {
            let what = format!("update path '{}' and {} deltas", path.name(), layout.format.name());
            return Err(refuse(what, "use the path 'blocks', and pack the mesh as 'fast' or 'small'"));
        };
        let streams: Vec<String> = layout.streams.iter().map(|stream| stream.semantic.to_string()).collect();
        let what = format!("mesh '{}', whose targets move nothing of {},", layout.name, streams.join(" and "));
        let remedy = "draw these streams as they are in the mesh, and leave them out here";
        ensure!(index.entry_count() > 0, refuse(what, remedy));
        let what = format!("an error budget of {error_budget}");
        ensure!(error_budget == 0.0, refuse(what, "use 0, or a Crowd, whose weights the host sets"));
        let remedy = "use fixed16 or fixed32 poses: sums of integers do not drift";
        ensure!(pose.has_integers(), refuse(format!("{} poses", pose.name()), remedy));
        ensure!(slots <= ANIMATED_SLOTS_MAX, refuse(format!("{slots} slots"), "use at most 32"));
        Ok(())
    }
}

/// Extensions and features to enable when creating a device for `path`. Otherwise core Vulkan 1.1 suffices, with one
/// queue for graphics and compute, or one with compute for updates and another for draws
/// ([`DeviceDesc::queue_families`](crate::DeviceDesc::queue_families)).
pub fn requirements(path: UpdatePath) -> &'static [Requirement] {
    match path.row().needs {
        Needs::TransformFeedback => &[Requirement {
            extension: Some(ash::ext::transform_feedback::NAME),
            feature: Some("VkPhysicalDeviceTransformFeedbackFeaturesEXT::transformFeedback"),
            reason: "vertex passes capture the pose into a buffer",
        }],
        Needs::VertexStores => &[Requirement {
            extension: None,
            feature: Some("vertexPipelineStoresAndAtomics"),
            reason: "vertex passes store the pose in a storage buffer",
        }],
        Needs::Nothing | Needs::Workgroups | Needs::FloatBlending => &[],
    }
}

impl DeviceCaps {
    /// Largest batch of `path` with coefficients in push constants; `None`: no limit. Vertex passes: vertex attributes
    /// − 2 for the pose, at 2 (float32) or 1 (snorm16) per target, limited by vertex bindings and push constants; 0
    /// in formats that the path does not take.
    #[doc(hidden)]
    pub fn batch_max(&self, path: UpdatePath, format: DeltaFormat) -> Option<u32> {
        match path.row().batch {
            Batch::Attributes => {
                // Formats that are no vertex attributes fit none.
                let attributes = self.max_vertex_attributes.saturating_sub(2).checked_div(format.attributes() as u32);
                let bindings = self.max_vertex_bindings.saturating_sub(1);
                let most = attributes.unwrap_or(0).min(bindings).min(batch_max(format.row()));
                let fits = |batch: &u32| attribute_push_bytes(format.row(), *batch) <= self.max_push_constants;
                Some((0..=most).rev().find(fits).unwrap_or(0))
            }
            Batch::PushConstants => Some(DENSE_BATCH_MAX),
            Batch::Any => None,
        }
    }

    /// Checks that the device supports `path`.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the missing extension, feature or limit, and an alternative.
    pub fn check_path(&self, path: UpdatePath) -> Result<()> {
        let most = self.transform_feedback.map(|feedback| feedback.max_stride);
        let workgroup = self.max_workgroup_invocations;
        let (is_there, reason, remedy) = match path.row().needs {
            Needs::Nothing => return Ok(()),
            Needs::VertexStores => {
                let lacks = "needs the feature vertexPipelineStoresAndAtomics, which the device lacks or the host did \
                             not enable";
                (self.vertex_stores, lacks.into(), "use the path 'compute', which needs no feature")
            }
            Needs::TransformFeedback => {
                let reason = match most {
                    None => "the device has no VK_EXT_transform_feedback, or it was not enabled".into(),
                    Some(most) => {
                        format!("captured vertices may be {most} bytes apart at most, a pose needs {CAPTURE_STRIDE}")
                    }
                };
                let fits = most.is_some_and(|most| most >= CAPTURE_STRIDE as u32);
                (fits, reason, "use the path 'compute', which needs no extension")
            }
            Needs::Workgroups => {
                let reason = format!("{workgroup} invocations per workgroup, {WORKGROUP} needed");
                (workgroup >= WORKGROUP, reason, "use the path 'cpu'")
            }
            Needs::FloatBlending => {
                let lacks = "needs blending of R32G32B32A32_SFLOAT (COLOR_ATTACHMENT_BLEND), which the device lacks";
                (self.float_blending, lacks.into(), "use the path 'compute', which needs no format")
            }
        };
        ensure!(is_there, self.unsupported(path, reason, remedy));
        Ok(())
    }

    /// The error that the device, or this build, does not support `path`.
    pub(crate) fn unsupported(&self, path: UpdatePath, reason: String, remedy: &str) -> Error {
        Error::Unsupported { path: path.name(), device: self.name.clone(), reason, remedy: remedy.into() }
    }

    /// Checks that a queue family can run updates of `path`: compute, and graphics for vertex passes.
    ///
    /// # Errors
    /// A family out of range, or one that lacks what the path needs; names an alternative.
    pub(crate) fn check_queue_family(&self, path: UpdatePath, family: u32) -> Result<()> {
        let flags = self.queue_flags(family)?;
        let refuse = |lacks: &str, remedy: &str| {
            self.unsupported(path, format!("queue family {family}, named for updates, has no {lacks}"), remedy)
        };
        let computes = flags.contains(vk::QueueFlags::COMPUTE);
        ensure!(computes, refuse("compute", "name a queue family with compute"));
        let fits = !path.draws_updates() || flags.contains(vk::QueueFlags::GRAPHICS);
        let lacks = "graphics, which the passes of this path need";
        ensure!(fits, refuse(lacks, "use the path 'blocks' or 'compute' on it"));
        Ok(())
    }
}

impl UpdatePath {
    /// Path and delta format, for messages.
    fn with_deltas(self, format: DeltaFormat) -> String {
        format!("update path '{}' with {} deltas", self.name(), format.name())
    }

    pub(crate) fn check_format(self, format: DeltaFormat) -> Result<()> {
        let names: Vec<&str> = self.formats().iter().map(|format| format.name()).collect();
        let remedy = format!("pack the mesh as {}", names.join(" or "));
        ensure!(self.formats().contains(&format), self.with_deltas(format), remedy);
        Ok(())
    }

    /// Checks that the path supports a mesh of `groups` groups.
    ///
    /// # Errors
    /// A path that updates only the first group.
    pub(crate) fn check_groups(self, groups: usize, layout: &PackedLayout) -> Result<()> {
        let path = self.name();
        let mesh = &layout.name;
        let what = format!("update path '{path}' with mesh '{mesh}', which has more than positions and normals");
        let remedy =
            "use the path 'blocks', 'compute', 'feedback' or 'cpu', or leave the other streams out of the mesh";
        ensure!(groups == 1 || self.row().takes_groups, what, remedy);
        Ok(())
    }
}
