//! The device side of a post-morph pass of one instance: its kernel, what it binds, and its push constants.

use super::context::TargetContext;
use super::normals::{GpuNormals, Surface};
use super::output::{Output, OutputTarget};
use super::pieces::Pieces;
use super::skin::{SkinMethod, Skinned};
use crate::abi::modules::{Kernel, NORMALS, OUTPUT, OUTPUT_DUAL, OUTPUT_SKIN};
use crate::abi::numbers::{PIECE, WORKGROUP};
use crate::abi::push::AfterPush;
use crate::asset::streams::TRIPLE;
use crate::error::{Result, ensure};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Ring;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, Workgroups};
use crate::pack::vertex::OffsetConstants;
use crate::pack::{DeltaFormat, PoseFormat};
use crate::plan::steps::{Source, Work};
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// What a pass reads beside poses.
pub(super) enum Reads {
    Nothing,
    Skin(Skinned),
    Surface(Arc<Surface>),
}

impl Reads {
    /// What the pass of an output target reads, and the index of the first vector of joints.
    ///
    /// # Errors
    /// Those of [`Skinned::new`].
    pub fn of_output(target: &OutputTarget<'_>, context: &TargetContext<'_>) -> Result<(Self, u32)> {
        let Some(joints) = &target.joints else { return Ok((Self::Nothing, 0)) };
        let (skinned, at) = Skinned::new(joints, context)?;
        Ok((Self::Skin(skinned), at))
    }

    /// What the pass of a normals target reads, and the first word of its fans.
    ///
    /// # Errors
    /// A surface of another engine, mesh or packing.
    pub fn of_normals(normals: &GpuNormals, context: &TargetContext<'_>) -> Result<(Self, u32)> {
        let surface = &normals.surface;
        surface.attached.check("a surface", context.device, context.layout())?;
        Ok((Self::Surface(surface.clone()), surface.attached.words_at()))
    }

    /// The kernel, the influences of each vertex, and what is bound beside poses, list and output.
    fn bound(&self) -> (&'static Kernel, u32, Vec<BufferRange>) {
        match self {
            Self::Nothing => (&OUTPUT, 0, vec![]),
            Self::Surface(surface) => (&NORMALS, 0, vec![surface.attached.range()]),
            Self::Skin(Skinned { attached, influences, method, joints, .. }) => {
                let kernel = match method {
                    SkinMethod::Linear => &OUTPUT_SKIN,
                    SkinMethod::DualQuaternion => &OUTPUT_DUAL,
                };
                (kernel, *influences, vec![attached.range(), *joints])
            }
        }
    }

    /// Adds to `written` the pieces to write when the pieces `changed` of the pose changed.
    pub fn spread(&self, changed: &Pieces, written: &mut Pieces) {
        match self {
            Self::Surface(surface) => surface.spread.of(changed, written),
            Self::Nothing | Self::Skin(_) => written.add_all(changed),
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
struct Key {
    kernel: &'static Kernel,
    pose: PoseFormat,
    influences: u32,
    /// Component offsets in host vertices; `None`: the kernel's defaults.
    offsets: Option<OffsetConstants>,
}

impl PipelineKey for Key {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self { kernel, pose, influences, offsets } = self;
        objects.add_layout(&[kernel.row], 0)?;
        let own = &[influences][..kernel.row.constants as usize];
        let offsets = offsets.as_ref().map_or(&[][..], |offsets| offsets);
        // Passes read no deltas: the module is the same for every delta format.
        let module = kernel.module(DeltaFormat::Float32.row(), pose.row(), 0)?;
        objects.add_compute(module, &[&[own, offsets].concat()])
    }
}

pub(super) struct Pass {
    kernel: Arc<Pipelines<Key>>,
    /// By list and output buffer.
    sets: Sets,
    pub outputs: Vec<Output>,
    pub reads: Reads,
    push: AfterPush,
    /// Numbers per pose, padding included.
    pose_numbers: u32,
}

impl Pass {
    /// A pass with lists of pieces in `lists`, and one or two output buffers of the same layout. What it reads begins
    /// at `reads_at`: the index of the first vector of joints, or of the first word of fans.
    pub fn new(
        context: &TargetContext<'_>,
        lists: &Ring,
        outputs: Vec<Output>,
        (reads, reads_at): (Reads, u32),
    ) -> Result<Self> {
        let layout = context.layout();
        let poses = context.group.poses;
        let (kernel, influences, ranges) = reads.bound();
        let offsets = poses.offset_constants();
        let kernel = context.kernels.get(Key { kernel, pose: poses.format, influences, offsets })?;
        let list = |frame| BufferRange { size: 4 * u64::from(context.pieces()), ..lists.range(frame) };
        let set = |frame, output: &Output| {
            let own = [context.poses(), list(frame), output.range(layout)];
            own.into_iter().chain(ranges.clone()).collect::<Vec<_>>()
        };
        let frames = 0..u64::from(context.frames);
        let bound: Vec<_> = frames.flat_map(|frame| outputs.iter().map(move |output| set(frame, output))).collect();
        let [[x, y, z, normal, ..], [a, b, c, ..]] = poses.scale();
        let push = AfterPush {
            units: [x, y, z, normal],
            offset: [a, b, c, 0.0],
            stride: outputs[0].stride / 4,
            normal_at: outputs[0].second.unwrap_or(0) / 4,
            vertices: layout.vertex_count as u32,
            reads_at,
            // The rest is of each dispatch.
            ..Default::default()
        };
        Ok(Self { sets: kernel.objects.sets(&bound)?, kernel, outputs, reads, push, pose_numbers: poses.numbers() })
    }

    /// Sets the offset of the joints; `None` if there are none.
    ///
    /// # Errors
    /// An invalid offset.
    pub fn set_joints(&mut self, offset: u64) -> Option<Result<()>> {
        let Reads::Skin(skin) = &self.reads else { return None };
        Some(skin.place(offset).map(|at| self.push.reads_at = at))
    }

    /// Records a dispatch.
    ///
    /// # Safety
    /// See [`Technique::record`](crate::update::technique::Technique::record); the target's buffers live until it has
    /// finished.
    pub unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work, is_listed: bool) {
        let (Source::Slot(slot), output, count) = (work.source, work.destination as usize, work.items.end) else {
            return;
        };
        let push = AfterPush {
            pose_at: slot * self.pose_numbers,
            written_at: self.outputs[output].first_word(),
            count,
            listed: is_listed.into(),
            ..self.push
        };
        let workgroups = Workgroups::Of([count.div_ceil(WORKGROUP / PIECE), 1]);
        let set = self.sets.get(frame as usize * self.outputs.len() + output);
        // SAFETY: the caller's obligations; the list was made for this frame, and the set for this layout.
        unsafe { self.kernel.objects.dispatch(cmd, 0, (set, &[]), bytes_of(&push), workgroups) };
    }
}

impl TargetContext<'_> {
    /// Checks outputs and the room for joints; poses against the storage range; and pieces against the device's texels
    /// and workgroups. `what` names the target in errors.
    pub(super) fn check(&self, what: &str, outputs: &[Output], reads: &Reads) -> Result<()> {
        let caps = &self.device.caps;
        let poses = &self.group.poses;
        let name = &self.layout().name;
        let normals = outputs.iter().any(|output| output.second.is_some());
        let fits = !normals || poses.offsets.bytes(poses.format)[TRIPLE].is_some();
        let text = format!("normals of mesh '{name}' in {what}, which the host's vertices do not have");
        ensure!(fits, text, "add Semantic::Normal to the VertexLayout, or use a target without normals");
        let of = format!("{what} for mesh '{name}':");
        let limit = (self.poses().size, "bytes", caps.max_storage_range);
        caps.check_limit(&format!("{of} the slots of one instance take"), limit, "use fewer slots")?;
        let texels = (self.pieces().into(), "texels", caps.max_texels.into());
        caps.check_limit(&format!("{of} its list takes"), texels, "split the mesh")?;
        let workgroups = self.pieces().div_ceil(WORKGROUP / PIECE);
        let limit = (workgroups.into(), "workgroups", caps.max_workgroups.into());
        caps.check_limit(&format!("{of} it takes"), limit, "split the mesh")?;
        outputs.iter().try_for_each(|output| output.check(what, self.layout(), self.device))?;
        match reads {
            Reads::Skin(skin) => skin.joints.check_room(self.device, &format!("{of} the range of joints")),
            Reads::Nothing | Reads::Surface(_) => Ok(()),
        }
    }
}
