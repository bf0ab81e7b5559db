//! The interface between crowds and update techniques.

use crate::asset::streams::{Semantic, StreamPlace};
use crate::error::{Error, Result, ensure};
use crate::gpu::caps::DeviceCaps;
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::{MeshBuffers, Upload};
use crate::gpu::pipelines::Kernels;
use crate::pack::blocks::PoseGrid;
use crate::pack::{POSE_FLOATS, PackedLayout, PackedMesh, PoseFormat};
use crate::plan::instances::{InstanceState, Instances};
use crate::plan::steps::{Steps, Work};
use crate::plan::{UpdatePath, UpdateStats};
use crate::update::crowd::CrowdDesc;
use ash::vk;
use std::any::Any;
use std::sync::Arc;

/// An update technique, with its state for a crowd. [`Instances`] keeps the slots of poses and restores them on
/// discard; a technique is notified of changes to instances only for its own state.
pub trait Technique: Any + Send + Sync {
    /// Plans an update to the requested weights: appends to `steps` (empty), writes its lists, and advances the history
    /// of the instances that it writes. Steps without works belong to updates that only write lists.
    ///
    /// # Errors
    /// Lists that are not mapped.
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats>;

    /// Records a work of the steps planned last.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on the technique's device, outside a render pass, on a queue with compute, and
    ///   with graphics if the technique draws.
    /// - It is submitted once, after all earlier updates of the crowd; technique and mesh live until it has finished.
    /// - The barriers that the steps' uses need are recorded between them.
    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work);

    /// The name of a work's step, if steps differ.
    fn step_name(&self, _work: &Work) -> Option<&'static str> {
        None
    }

    /// Slots of an instance's pose and previous pose; `None` while it has no pose.
    fn slots_of(&self, instances: &Instances, instance: usize) -> Option<(u32, Option<u32>)> {
        instances.slots_of(instance)
    }

    /// What it keeps of each instance.
    fn state(&mut self) -> &mut dyn InstanceState;

    /// Discards an update and all later ones.
    fn discard_from(&mut self, _id: UpdateId) {}

    /// Starts as if `updates` updates had been recorded.
    fn begin_at(&mut self, _updates: u64) {}

    /// The draws that evaluate poses of a group, if there are no pose buffers.
    fn draws(&self, _group: usize) -> Option<&dyn PoseDraws> {
        None
    }

    /// Integer sums of an instance beside its poses: buffer and offset.
    fn sums(&self, _instance: u32) -> Option<(vk::Buffer, u64)> {
        None
    }
}

/// Draws that evaluate poses.
pub trait PoseDraws {
    /// Records a draw of each instance, in a render pass without attachments, with all primitives discarded.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on the technique's device, outside a render pass, on a queue with graphics.
    /// - An update has written what the draws read; they run under the same conditions.
    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>);

    /// Records the draw of an instance, and captures the pose that it evaluates in the first pose of the crowd's
    /// buffer, with the barriers around it.
    ///
    /// # Errors
    /// The device cannot capture.
    ///
    /// # Safety
    /// See [`record`](Self::record).
    unsafe fn capture(&self, cmd: vk::CommandBuffer, instance: u32) -> Result<()>;
}

/// Creates the buffers of a checked mesh for a path with its own upload. The caller records the returned uploads;
/// everything else is recorded here, unless it fails.
///
/// Call it with the command buffer in the recording state on the device, outside a render pass; keep the result until
/// the device no longer uses it.
pub type UploadFor =
    unsafe fn(&Arc<Device>, vk::CommandBuffer, &PackedMesh, UpdatePath) -> Result<(Vec<MeshBuffers>, Vec<Upload>)>;

/// Techniques implemented outside the library, of the paths [`UpdatePath::Baseline`].
pub struct Techniques {
    /// Creates the technique of a checked description.
    pub make: fn(Context<'_>) -> Result<Box<dyn Technique>>,
    /// For paths with their own upload.
    pub upload: UploadFor,
}

impl Techniques {
    /// The baselines, or the error that they are missing.
    pub(crate) fn of<'a>(others: Option<&'a Self>, path: UpdatePath, caps: &DeviceCaps) -> Result<&'a Self> {
        let remedy = "use the path 'blocks' or 'compute': baselines are in the package deltamorph-baselines";
        others.ok_or_else(|| caps.unsupported(path, "this build has no baselines".into(), remedy))
    }
}

/// Identifies an update of a crowd.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UpdateId {
    /// Its number, from 1.
    pub update: u64,
    /// Number of earlier updates that recorded something and were not discarded.
    pub recorded: u64,
    /// Index in the rings of lists.
    pub frame: u64,
}

/// The poses of a crowd in a group, `[instance][slot]`.
#[derive(Clone, Copy, Debug)]
pub struct Poses {
    /// The buffer that holds them all.
    pub buffer: vk::Buffer,
    /// Its usage flags.
    pub usage: vk::BufferUsageFlags,
    /// The pose format.
    pub format: PoseFormat,
    /// Bytes per pose.
    pub bytes: u64,
    /// Instances of the crowd.
    pub instances: u32,
    /// Slots per instance.
    pub slots: u32,
    /// The grid of weights and poses, if sums are integers.
    pub grid: Option<PoseGrid>,
}

impl Poses {
    /// Input units per integer, and the value of 0, by component; 1 and 0 for float32.
    pub fn scale(&self) -> [[f32; POSE_FLOATS]; 2] {
        let grid = self.grid.filter(|_| self.format.has_integers());
        grid.map_or([[1.0; POSE_FLOATS], [0.0; POSE_FLOATS]], |grid| [grid.units, grid.offsets])
    }

    /// Byte offset of a pose's first vertex.
    pub fn offset(&self, instance: u32, slot: u32) -> u64 {
        let number = u64::from(instance) * u64::from(self.slots) + u64::from(slot);
        number * self.bytes
    }

    /// Bytes of a descriptor of all poses of `count` instances.
    pub(crate) fn range_bytes(&self, count: u32) -> u64 {
        u64::from(count) * u64::from(self.slots) * self.bytes
    }

    pub(crate) fn range(&self, first: u32, count: u32) -> BufferRange {
        BufferRange::new(self.buffer, self.offset(first, 0), self.range_bytes(count))
    }

    pub(crate) fn numbers(&self) -> u32 {
        (self.bytes / self.format.number_bytes() as u64) as u32
    }
}

/// A group of a mesh, and a crowd's poses in it.
pub struct PoseGroup {
    /// The group.
    pub mesh: Arc<MeshBuffers>,
    /// The poses.
    pub poses: Poses,
}

/// The group that contains a stream, and the stream's place in it.
///
/// # Errors
/// A stream that the mesh does not have.
pub(crate) fn place_of(groups: &[PoseGroup], semantic: Semantic) -> Result<(usize, StreamPlace)> {
    let numbered = groups.iter().enumerate();
    let streams = numbered.flat_map(|(group, of)| of.mesh.layout.streams.iter().map(move |place| (group, *place)));
    streams.clone().find(|(_, place)| place.semantic == semantic).ok_or_else(|| {
        let names: Vec<String> = streams.map(|(_, place)| place.semantic.to_string()).collect();
        let text = format!("stream '{semantic}' of mesh '{}'", groups[0].mesh.layout.name);
        Error::invalid(text, format!("it has {}", names.join(", ")))
    })
}

/// Input for creating a technique.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// The device.
    pub device: &'a Arc<Device>,
    /// Cache of pipelines.
    pub kernels: &'a Kernels,
    /// A group of the mesh.
    pub mesh: &'a Arc<MeshBuffers>,
    /// The crowd's description, which was checked.
    pub desc: &'a CrowdDesc,
    /// The poses of the group.
    pub poses: Poses,
    /// All groups. `mesh` and `poses` are those of one group, initially the first.
    pub all: &'a [PoseGroup],
}

impl<'a> Context<'a> {
    /// A context for each group of the mesh.
    pub fn groups(self) -> impl Iterator<Item = Self> {
        self.all.iter().map(move |group| Self { mesh: &group.mesh, poses: group.poses, ..self })
    }

    /// Limits and features of the device.
    pub fn caps(&self) -> &DeviceCaps {
        &self.device.caps
    }

    /// The layout of the group.
    pub fn layout(&self) -> &'a PackedLayout {
        &self.mesh.layout
    }

    /// The grid of weights and poses, for techniques with integer sums only.
    pub fn grid(&self) -> PoseGrid {
        let Some(grid) = self.poses.grid else { unreachable!("`UpdateDesc::check_all` refuses sums without a grid") };
        grid
    }

    /// The base pose of fixed-point poses on the device.
    pub(crate) fn integer_base(&self) -> Result<Option<Buffer>> {
        let base = |grid| self.mesh.integer_base(self.device, self.poses.format, &grid);
        self.poses.grid.map(base).transpose()
    }

    /// Fails if `bytes` of `what` exceed the device's storage range.
    pub fn check_range(&self, what: &str, bytes: u64, remedy: &str) -> Result<()> {
        let what = format!("{what} of mesh '{}' take", self.layout().name);
        self.caps().check_limit(&what, (bytes, "bytes", self.caps().max_storage_range), remedy)
    }

    /// Fails if 32-bit offsets do not reach `bytes` of `what`.
    pub fn check_offsets(&self, what: &str, bytes: u64, remedy: &str) -> Result<()> {
        let what = format!("the {what} of {} instances take {bytes} bytes", self.desc.instances);
        ensure!(bytes <= u32::MAX.into(), what, remedy);
        Ok(())
    }
}
