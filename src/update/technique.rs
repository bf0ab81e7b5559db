//! What a crowd needs of a way to update its poses.

use crate::asset::streams::TRIPLES;
use crate::error::{Error, Result};
use crate::gpu::caps::DeviceCaps;
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::mesh::{MeshBuffers, Upload};
use crate::gpu::pipelines::Kernels;
use crate::pack::blocks::PoseGrid;
use crate::pack::vertex::{PlaceConstants, Places};
use crate::pack::{PackedLayout, PackedMesh, PoseFormat};
use crate::plan::hazards::Accesses;
use crate::plan::instances::Instances;
use crate::plan::steps::{Steps, Work};
use crate::plan::{UpdatePath, UpdateStats};
use crate::update::crowd::CrowdDesc;
use ash::vk;
use std::any::Any;
use std::ops::Range;
use std::sync::Arc;

/// A way to update the poses of a crowd, with what it keeps for that. Which slots hold poses is in [`Instances`], with
/// what was discarded: a technique is told what happens to instances only for state of its own.
pub trait Technique: Any + Send + Sync {
    /// Plan an update to what is requested into `steps`, which are empty, write its lists, and take it as done: advance
    /// the history of what it writes. Steps without works are for updates that write lists only.
    ///
    /// # Errors
    /// Lists that are not mapped.
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats>;

    /// Record a work of the steps that were planned last.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on the technique's device, outside a render pass, on a queue with compute, and
    ///   with graphics where it draws.
    /// - It is submitted once, after all earlier updates of the crowd; the technique and the mesh live until it has
    ///   run.
    /// - Barriers between steps are recorded as their uses ask for.
    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work);

    /// Slots of the pose and of the previous pose of an instance; `None` while it has none.
    fn slots_of(&self, instances: &Instances, instance: usize) -> Option<(u32, Option<u32>)> {
        instances.slots_of(instance)
    }

    /// Vertices of the first group that the update planned last changed in the pose of an instance that is shown:
    /// ascending ranges, which may go on behind the last vertex.
    fn changed(&self, instances: &Instances, id: UpdateId, instance: u32, out: &mut Vec<Range<u32>>) {
        if instances.written_by(instance as usize) == id.update {
            out.push(0..u32::MAX);
        }
    }

    /// The next pose of an instance has no predecessor.
    fn cut(&mut self, _instance: u32) {}

    /// An instance is hidden from now on, or removed; or it is shown again.
    fn set_hidden(&mut self, _instance: u32, _hidden: bool) {}

    /// A new instance takes a free place.
    fn add(&mut self, _instance: u32) {}

    /// This update and all later ones will never run.
    fn discard_from(&mut self, _id: UpdateId) {}

    /// So many updates are taken for recorded before the first.
    fn begin_at(&mut self, _updates: u64) {}

    /// The error budget of an instance that there is, from the next update on.
    ///
    /// # Errors
    /// No budget: the technique has none, or it is not from 0 to that of the crowd.
    fn set_error_budget(&mut self, _instance: u32, budget: f32) -> Result<()> {
        let what = format!("an error budget of {budget} for an instance of a crowd whose path has none");
        Err(Error::invalid(what, "use the path blocks or cpu, with a mesh in a block format"))
    }

    /// Refuse weights that it cannot apply.
    ///
    /// # Errors
    /// As the technique says.
    fn check_weights(&self, _weights: &[f32]) -> Result<()> {
        Ok(())
    }

    /// What draws poses of a group, where there are no pose buffers: draws evaluate them.
    fn draws(&self, _group: usize) -> Option<&dyn PoseDraws> {
        None
    }

    /// Sums of integers beside the poses of an instance: buffer and offset.
    fn sums(&self, _instance: u32) -> Option<(vk::Buffer, u64)> {
        None
    }

    /// What the works of a step read and write, for the hazard checker; see [`trace`](crate::plan::hazards::trace).
    fn accesses(&self, works: &[Work]) -> Vec<Accesses>;
}

/// Draws that evaluate poses.
pub trait PoseDraws {
    /// Record a draw of each of these instances, in a render pass without attachments, with every primitive discarded.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on the technique's device, outside a render pass, on a queue with graphics.
    /// - An update has written what the draws read, and they run as that update's do.
    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>);

    /// Record the draw of an instance, and capture the pose that it evaluates in the first pose of the crowd's buffer,
    /// with the barriers around it.
    ///
    /// # Errors
    /// A device that cannot capture.
    ///
    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn capture(&self, cmd: vk::CommandBuffer, instance: u32) -> Result<()>;
}

/// Makes the buffers of a mesh for a path that has an upload of its own, and what fills them. The mesh was checked for
/// the path. What buffers are filled by is recorded afterwards; all else is recorded here, unless there is an error.
///
/// To be called with the command buffer in the recording state on the device, outside a render pass; what is returned
/// is kept until the device no longer uses it.
pub type UploadFor =
    unsafe fn(&Arc<Device>, vk::CommandBuffer, &PackedMesh, UpdatePath) -> Result<(Vec<MeshBuffers>, Vec<Upload>)>;

/// Techniques that are made outside the library, of paths that it names and does not implement.
pub struct Techniques {
    /// Makes the technique of a description, which was checked.
    pub make: fn(Context<'_>) -> Result<Box<dyn Technique>>,
    /// For paths that have an upload of their own.
    pub upload: UploadFor,
}

impl Techniques {
    /// Those there are, or why `path` cannot be had.
    pub(crate) fn of<'a>(others: Option<&'a Self>, path: UpdatePath, caps: &DeviceCaps) -> Result<&'a Self> {
        others.ok_or_else(|| Error::Unsupported {
            path: path.name(),
            device: caps.name.clone(),
            reason: "this build has no baselines".into(),
            remedy: "use the path 'blocks' or 'compute': techniques of others are in the package deltamorph-baselines"
                .into(),
        })
    }
}

/// The place of an update among those of a crowd.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UpdateId {
    /// Its number, from 1.
    pub update: u64,
    /// Updates that recorded something before it, less discarded ones.
    pub recorded: u64,
    /// Which part of the rings it takes.
    pub frame: u64,
}

/// The poses of a crowd in a group, `[instance][slot]`.
#[derive(Clone, Copy, Debug)]
pub struct Poses {
    /// The buffer that holds them all.
    pub buffer: vk::Buffer,
    /// What it was made for; nothing that we know of, where it is the host's.
    pub usage: vk::BufferUsageFlags,
    /// Where a descriptor of the first pose begins, a multiple of 256.
    pub begin: u64,
    /// Bytes from there to the first vertex; 0 in buffers of ours.
    pub lead: u64,
    /// How numbers are stored.
    pub format: PoseFormat,
    /// Where they are in a vertex.
    pub(crate) places: Places,
    /// Bytes of one.
    pub bytes: u64,
    /// Instances of the crowd.
    pub instances: u32,
    /// Poses of an instance.
    pub slots: u32,
    /// The grid of weights and poses, where sums are of integers.
    pub grid: Option<PoseGrid>,
}

impl Poses {
    /// Input units of integers, by triple.
    pub fn units(&self) -> [f32; TRIPLES] {
        self.grid.filter(|_| self.format.has_integers()).map_or([1.0; TRIPLES], |grid| grid.units)
    }

    /// Where a pose begins: its first vertex.
    pub fn offset(&self, instance: u32, slot: u32) -> u64 {
        let number = u64::from(instance) * u64::from(self.slots) + u64::from(slot);
        self.begin + self.lead + number * self.bytes
    }

    /// Bytes that a descriptor of all poses of `count` instances covers.
    pub(crate) fn range_bytes(&self, count: u32) -> u64 {
        self.lead + u64::from(count) * u64::from(self.slots) * self.bytes
    }

    /// All poses of `count` instances.
    pub(crate) fn range(&self, first: u32, count: u32) -> BufferRange {
        let (offset, size) = (self.offset(first, 0) - self.lead, self.range_bytes(count));
        BufferRange { buffer: self.buffer, offset, size }
    }

    /// Numbers from pose to pose.
    pub(crate) fn numbers(&self) -> u32 {
        (self.bytes / self.format.number_bytes() as u64) as u32
    }

    /// What the places of kernels are specialized with, which count from the beginning of a [`range`](Self::range).
    pub(crate) fn place_constants(&self) -> Option<PlaceConstants> {
        self.places.behind((self.lead / self.format.number_bytes() as u64) as u32).constants()
    }
}

/// A group of a mesh, and the poses of a crowd in it.
pub struct PoseGroup {
    /// The group.
    pub mesh: Arc<MeshBuffers>,
    /// The poses.
    pub poses: Poses,
}

/// What a technique is made from.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// The device.
    pub device: &'a Arc<Device>,
    /// Pipelines made so far.
    pub kernels: &'a Kernels,
    /// A group of the mesh.
    pub mesh: &'a Arc<MeshBuffers>,
    /// The crowd's description, which was checked.
    pub desc: &'a CrowdDesc,
    /// The poses in the group.
    pub poses: Poses,
    /// All groups; `mesh` and `poses` are those of one, which is the first to begin with.
    pub all: &'a [PoseGroup],
}

impl<'a> Context<'a> {
    /// What is made from each group of the mesh.
    pub fn groups(self) -> impl Iterator<Item = Self> {
        self.all.iter().map(move |group| Self { mesh: &group.mesh, poses: group.poses, ..self })
    }

    /// Limits and features of the device.
    pub fn caps(&self) -> &DeviceCaps {
        &self.device.caps
    }

    /// Where everything is in the group.
    pub fn layout(&self) -> &'a PackedLayout {
        &self.mesh.layout
    }

    /// The grid of weights and poses, for techniques that know no other sums than those of integers.
    pub fn grid(&self) -> PoseGrid {
        let Some(grid) = self.poses.grid else { unreachable!("`UpdateDesc::check_all` refuses sums without a grid") };
        grid
    }

    /// Refuse `what`, which takes more bytes than a descriptor covers.
    pub fn check_range(&self, what: &str, bytes: u64, remedy: &str) -> Result<()> {
        let what = format!("{what} of mesh '{}' take", self.layout().name);
        self.caps().check_limit(&what, (bytes, "bytes", self.caps().max_storage_range), remedy)
    }

    /// Refuse lists that offsets of 32 bits do not reach.
    pub fn check_offsets(&self, what: &str, bytes: u64, remedy: &str) -> Result<()> {
        if bytes <= u64::from(u32::MAX) {
            return Ok(());
        }
        Err(Error::invalid(format!("the {what} of {} instances take {bytes} bytes", self.desc.instances), remedy))
    }
}
