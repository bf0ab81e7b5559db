//! The one check of a description: what it says by itself, for a mesh, and for who carries it out.

use super::blocks::check_tolerance;
use crate::error::{Error, Result};
use crate::gpu::caps::DeviceCaps;
use crate::pack::{DeltaFormat, PackedLayout};
use crate::plan::{BatchSize, UpdateDesc, UpdateMode, UpdatePath};

/// Most slots of a crowd that is animated on the GPU, which keeps a bit for each update since a slot was written.
const ANIMATED_SLOTS_MAX: u32 = 32;

/// Who is to carry an update out.
#[derive(Clone, Copy)]
pub(crate) enum Runner<'a> {
    /// Not known yet.
    Unknown,
    /// [`CpuCrowd`](crate::cpu::CpuCrowd).
    Cpu,
    /// A device.
    Device(&'a DeviceCaps),
    /// A device that animates as well; `None`: its CPU reference.
    Animated(Option<&'a DeviceCaps>),
}

impl UpdateDesc {
    /// Check the description.
    ///
    /// # Errors
    /// A batch size of 0; no slot, or too few slots for the path; a tolerance or budget that is no length; a pose format
    /// that the path does not take; a budget on a path that has none; incremental updates of a path that only rebuilds.
    pub fn check(&self) -> Result<()> {
        let (path, name) = (self.path, self.path.name());
        let least = if path.works_in_place() { 1 } else { 2 };
        if self.slots < least || self.slots > 64 {
            let remedy = format!("use {least} to 64 slots (2 is ping-pong)");
            return refuse(format!("{} slots for update path '{name}'", self.slots), remedy);
        }
        let tolerance = self.tolerance;
        if !(tolerance > 0.0 && self.error_budget >= 0.0 && self.error_budget.is_finite()) {
            let what = format!("a tolerance of {tolerance} and an error budget of {}", self.error_budget);
            return refuse(what, "use a tolerance above 0 and a budget of 0 or more");
        }
        if !path.poses().contains(&self.pose) {
            let names: Vec<&str> = path.poses().iter().map(|pose| pose.name()).collect();
            let remedy = format!("use {} poses here, or the path 'blocks', 'compute' or 'cpu'", names.join(" or "));
            return refuse(format!("{} poses with '{name}'", self.pose.name()), remedy);
        }
        if path.rebuilds_only() && self.mode == UpdateMode::Incremental {
            let remedy = "use the mode 'rebuild': this technique evaluates every pose from the base pose";
            return refuse(format!("incremental updates through '{name}'"), remedy);
        }
        if path.row().sums_integers && self.error_budget > 0.0 {
            let remedy = "use no budget: it adds integers, each pose afresh";
            return refuse(format!("an error budget with '{name}'"), remedy);
        }
        if !path.formats().iter().any(|format| format.is_blocks()) {
            self.check_dense(name)?;
        }
        match self.batch {
            BatchSize::Targets(0) => refuse("a batch size of 0", "use 1 or more targets per pass"),
            BatchSize::All if !path.takes_all_targets() => refuse(
                format!("batch size 'all' for update path '{name}'"),
                "a vertex pass takes as many targets as the device has vertex attributes for: name a number",
            ),
            BatchSize::Targets(_) | BatchSize::All => Ok(()),
        }
    }

    /// Check the description for a mesh packed like this.
    ///
    /// # Errors
    /// As [`check`](Self::check), and as [`PackedLayout::grid`] where poses are integers; else, in block formats, a
    /// tolerance that rounding exceeds in a pose fresh from base, all weights being 1.
    pub fn check_for(&self, layout: &PackedLayout) -> Result<()> {
        self.check_all(layout, Runner::Unknown)
    }

    /// Check the description for a mesh and for who is to carry it out.
    ///
    /// # Errors
    /// As [`check_for`](Self::check_for); a path that the runner does not have, or that the device cannot run; a batch
    /// size beyond [`DeviceCaps::batch_max`]; a format that the path does not take; blocks larger than a workgroup;
    /// what cannot be animated on the GPU.
    pub(crate) fn check_all(&self, layout: &PackedLayout, runner: Runner<'_>) -> Result<()> {
        // Before what the path takes: of one that is missing that is no matter.
        if let Runner::Device(caps) | Runner::Animated(Some(caps)) = runner {
            caps.check_path(self.path)?;
        }
        self.check()?;
        match runner {
            Runner::Cpu if self.path != UpdatePath::Cpu => {
                let remedy = "use UpdatePath::Cpu here, or MorphEngine for the GPU paths";
                return refuse(format!("update path '{}' for a CpuCrowd", self.path.name()), remedy);
            }
            Runner::Device(caps) | Runner::Animated(Some(caps)) => self.check_on_device(layout, caps)?,
            Runner::Unknown | Runner::Cpu | Runner::Animated(None) => {}
        }
        if layout.blocks.is_none() {
            self.check_dense(layout.format.name())?;
        }
        let has_grid = self.grid(layout)?.is_some();
        if let Some(index) = layout.blocks.as_ref().filter(|_| !has_grid) {
            check_tolerance(self.tolerance, layout, index)?;
        }
        if let Runner::Animated(_) = runner { self.check_animated(layout) } else { Ok(()) }
    }

    /// Refuse what only block formats have; `name` is the path's or the format's.
    fn check_dense(&self, name: &str) -> Result<()> {
        if self.error_budget == 0.0 {
            return Ok(());
        }
        let remedy = "use the path 'blocks', or 'cpu' with a block format ('fast', 'small')";
        refuse(format!("an error budget with '{name}'"), remedy)
    }

    /// Refuse a format that the path does not take, and blocks or a batch that are too large for the device.
    fn check_on_device(&self, layout: &PackedLayout, caps: &DeviceCaps) -> Result<()> {
        let (path, device) = (self.path, &caps.name);
        path.check_format(layout.format)?;
        let what = path.with_deltas(layout.format);
        let (size, most) = (layout.blocks.as_ref().map_or(0, |blocks| blocks.size()), caps.max_workgroup_invocations);
        if path == UpdatePath::Blocks && size > most as usize {
            let remedy = format!("pack with blocks of at most {most} vertices");
            return refuse(format!("blocks of {size} vertices on {device}"), remedy);
        }
        match (self.batch, caps.batch_max(path, layout.format)) {
            (BatchSize::Targets(batch), Some(most)) if batch > most => {
                let all = if path.takes_all_targets() { ", or 'all'" } else { "" };
                refuse(format!("batch size {batch} for {what} on {device}"), format!("use 1 to {most}{all}"))
            }
            (BatchSize::Targets(_) | BatchSize::All, _) => Ok(()),
        }
    }

    /// Refuse what is not animated on the GPU: sums that drift, since nobody there keeps a bound on it.
    fn check_animated(&self, layout: &PackedLayout) -> Result<()> {
        let refuse = |what: String, remedy: &str| refuse(format!("{what} in a crowd animated on the GPU"), remedy);
        let Some(index) = layout.blocks.as_ref().filter(|_| self.path == UpdatePath::Blocks) else {
            let what = format!("update path '{}' and {} deltas", self.path.name(), layout.format.name());
            return refuse(what, "use the path 'blocks', and pack the mesh as 'fast' or 'small'");
        };
        if index.entry_count() == 0 {
            let streams: Vec<String> = layout.streams.iter().map(|stream| stream.semantic.to_string()).collect();
            let what = format!("mesh '{}', whose targets move nothing of {},", layout.name, streams.join(" and "));
            return refuse(what, "draw these streams as they are in the mesh, and leave them out here");
        }
        if !self.pose.has_integers() {
            let what = format!("{} poses", self.pose.name());
            return refuse(what, "use PoseFormat::Fixed16 or Fixed32: sums of integers do not drift");
        }
        if self.slots > ANIMATED_SLOTS_MAX {
            return refuse(format!("{} slots", self.slots), "use at most 32");
        }
        Ok(())
    }
}

fn refuse(what: impl Into<String>, remedy: impl Into<String>) -> Result<()> {
    Err(Error::invalid(what, remedy))
}

impl UpdatePath {
    /// The path with deltas of a format, in messages.
    fn with_deltas(self, format: DeltaFormat) -> String {
        format!("update path '{}' with {} deltas", self.name(), format.name())
    }

    /// Refuse a format that the path does not take.
    pub(crate) fn check_format(self, format: DeltaFormat) -> Result<()> {
        if self.formats().contains(&format) {
            return Ok(());
        }
        let names: Vec<&str> = self.formats().iter().map(|format| format.name()).collect();
        refuse(self.with_deltas(format), format!("pack the mesh as {}", names.join(" or ")))
    }

    /// Check the path for a mesh of so many groups.
    ///
    /// # Errors
    /// Streams that it would leave out.
    pub(crate) fn check_groups(self, groups: usize, layout: &PackedLayout) -> Result<()> {
        if groups == 1 || self.row().takes_groups {
            return Ok(());
        }
        let (path, mesh) = (self.name(), &layout.name);
        refuse(
            format!("update path '{path}' with mesh '{mesh}', which has more than positions and normals"),
            "use the path 'blocks', 'compute', 'feedback' or 'cpu', or leave the other streams out of the mesh",
        )
    }
}
