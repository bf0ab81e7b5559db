//! A dispatch of a post-morph pass, for one instance: its kernel, what it binds, and its push constants.

use super::context::TargetContext;
use super::normals::{GpuNormals, Surface};
use super::output::{OutputTarget, Part};
use super::pieces::Pieces;
use super::skin::{SkinMethod, Skinned};
use crate::abi::modules::{Kernel, NORMALS, OUTPUT, OUTPUT_DUAL, OUTPUT_SKIN};
use crate::abi::numbers::{PIECE, WORKGROUP};
use crate::abi::push::AfterPush;
use crate::asset::streams::Semantic;
use crate::error::{Result, ensure};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Ring;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, Workgroups};
use crate::pack::{DeltaFormat, PoseFormat};
use crate::plan::steps::{Source, Work};
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// What a pass reads beside poses.
#[derive(Clone)]
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
    /// Specialization constants: whether vertices are reordered, streams, influences.
    constants: [u32; 6],
}

impl PipelineKey for Key {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self { kernel, pose, constants } = self;
        objects.add_layout(&[kernel.row], 0)?;
        // Passes read no deltas: the module is the same for every delta format.
        let module = kernel.module(DeltaFormat::Float32.row(), pose.row(), 0)?;
        objects.add_compute(module, &[&constants[..kernel.row.constants as usize]])
    }
}

pub(super) struct Pass {
    kernel: Arc<Pipelines<Key>>,
    /// By list and output buffer.
    sets: Sets,
    pub part: Part,
    pub reads: Reads,
    push: AfterPush,
    /// Numbers per pose, padding included.
    pose_numbers: u32,
}

impl Pass {
    /// A pass that writes `part`, with lists of pieces in `lists`. `order`: the vertices of the mesh in the order of
    /// poses; `None`: outputs have the order of poses. What the pass reads begins at `reads_at`: the index of the first
    /// vector of joints, or of the first word of fans.
    pub fn new(
        context: &TargetContext<'_>,
        part: Part,
        lists: &Ring,
        order: Option<BufferRange>,
        (reads, reads_at): (Reads, u32),
    ) -> Result<Self> {
        let poses = context.groups[part.group].poses;
        let (kernel, influences, ranges) = reads.bound();
        let [a, b, c, d] = part.constants();
        let constants = [order.is_some().into(), a, b, c, d, influences];
        let kernel = context.kernels.get(Key { kernel, pose: poses.format, constants })?;
        let list = |frame| BufferRange { size: 4 * u64::from(context.pieces()), ..lists.range(frame) };
        let set = |frame, output| {
            let list = list(frame);
            let own = [poses.range(context.instance, 1), list, part.range(output), order.unwrap_or(list)];
            own.into_iter().chain(ranges.clone()).collect::<Vec<_>>()
        };
        let frames = 0..u64::from(context.frames);
        let outputs = part.outputs();
        let each = frames.flat_map(|frame| (0..outputs).map(move |output| (frame, output)));
        let bound: Vec<_> = each.map(|(frame, output)| set(frame, output)).collect();
        let [units, offsets] = poses.scale();
        let push = AfterPush {
            units,
            offsets,
            strides: part.strides(),
            vertices: context.layout().vertex_count as u32,
            reads_at,
            // The rest is of each dispatch.
            ..Default::default()
        };
        Ok(Self { sets: kernel.objects.sets(&bound)?, kernel, part, reads, push, pose_numbers: poses.numbers() })
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
            written_at: self.part.first_words(output),
            count,
            listed: is_listed.into(),
            ..self.push
        };
        let workgroups = Workgroups::Of([count.div_ceil(WORKGROUP / PIECE), 1]);
        let set = self.sets.get(frame as usize * self.part.outputs() + output);
        // SAFETY: the caller's obligations; the list was made for this frame, and the set for this layout.
        unsafe { self.kernel.objects.dispatch(cmd, 0, (set, &[]), bytes_of(&push), workgroups) };
    }
}

impl TargetContext<'_> {
    /// Checks poses against the storage range; pieces against the device's texels and workgroups; and the room for
    /// outputs and joints. `what` names the target in errors.
    pub(super) fn check(&self, what: &str, parts: &[Part], reads: &Reads) -> Result<()> {
        let caps = &self.device.caps;
        let name = &self.layout().name;
        let of = format!("{what} for mesh '{name}':");
        for part in parts {
            let limit = (self.groups[part.group].poses.range_bytes(1), "bytes", caps.max_storage_range);
            caps.check_limit(&format!("{of} the slots of one instance take"), limit, "use fewer slots")?;
        }
        let texels = (self.pieces().into(), "texels", caps.max_texels.into());
        caps.check_limit(&format!("{of} its list takes"), texels, "split the mesh")?;
        let workgroups = self.pieces().div_ceil(WORKGROUP / PIECE);
        let limit = (workgroups.into(), "workgroups", caps.max_workgroups.into());
        caps.check_limit(&format!("{of} it takes"), limit, "split the mesh")?;
        for (part, output) in parts.iter().flat_map(|part| (0..part.outputs()).map(move |output| (part, output))) {
            part.range(output).check_room(self.device, &format!("{what} for mesh '{name}'"))?;
        }
        match reads {
            Reads::Skin(skin) => {
                let is_tangent = parts.iter().any(|part| part.has(Semantic::Tangent));
                ensure!(!is_tangent, format!("{of} skinned tangents"), "compute them from normals in the shader");
                skin.joints.check_room(self.device, &format!("{of} the range of joints"))
            }
            Reads::Nothing | Reads::Surface(_) => Ok(()),
        }
    }
}
