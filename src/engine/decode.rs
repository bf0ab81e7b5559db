//! The decode step: float32 positions of a pose, in a buffer of the host's own, for whoever cannot decode poses: ray
//! tracing, picking, a shader that cannot be changed. It follows the steps of the update, and writes what those changed.

use crate::abi::modules::DECODE;
use crate::abi::numbers::{PIECE, WORKGROUP};
use crate::abi::push::DecodePush;
use crate::asset::streams::TRIPLE;
use crate::error::{Error, Result};
use crate::gpu::caps::DeviceCaps;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::memory::Ring;
use crate::gpu::pipelines::{Kernels, Objects, PipelineKey, Pipelines, Workgroups};
use crate::pack::vertex::PlaceConstants;
use crate::pack::{DeltaFormat, PackedLayout, PoseFormat};
#[cfg(any(test, feature = "internals"))]
use crate::plan::hazards::{Accesses, Memory};
use crate::plan::instances::Instances;
use crate::plan::steps::{Resource, Source, Steps, Use, Work};
use crate::setters::setters;
use crate::update::technique::{PoseGroup, Poses, Technique, UpdateId};
use ash::vk;
use bytemuck::bytes_of;
use std::ops::Range;
use std::sync::Arc;

/// The number of the kernel, which no technique has.
const KERNEL: u32 = u32::MAX;
/// What storage buffers begin at a multiple of, on any device.
const ALIGNMENT: u64 = 256;
const USES: &[Use] = &[Use::read(Resource::Asset), Use::read(Resource::Poses), Use::write(Resource::Decoded)];

/// Where float32 positions of an instance are written: see
/// [`MorphEngine::set_decode_target`](crate::MorphEngine::set_decode_target).
///
/// Vertices are those of poses, in their order, without padding: as many as
/// [`PackedLayout::vertex_count`](crate::PackedLayout::vertex_count).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct DecodeTarget {
    /// The buffer, usable as storage buffer.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex's position, a multiple of 4.
    pub offset: u64,
    /// Bytes from vertex to vertex, a multiple of 4: 12 where nothing else is between positions.
    pub stride: u32,
    /// Bytes from a position to its normal, a multiple of 4 from 12 on; `None`: no normals. They are not normalised.
    pub normals: Option<u32>,
}

setters!(DecodeTarget { offset: u64, stride: u32, normals: Option<u32> });

impl DecodeTarget {
    /// Positions one after the other, from the beginning of the buffer.
    pub fn new(buffer: vk::Buffer) -> Self {
        Self { buffer, offset: 0, stride: 12, normals: None }
    }

    /// What is written of a vertex.
    fn vertex_bytes(&self) -> u32 {
        12 + self.normals.unwrap_or(0)
    }

    /// The bytes that a descriptor covers: all that is written, from a place on where a descriptor may begin.
    fn range(&self, layout: &PackedLayout) -> BufferRange {
        let offset = self.offset - self.offset % ALIGNMENT;
        let last = (layout.vertex_count as u64 - 1) * u64::from(self.stride);
        BufferRange::new(self.buffer, offset, self.offset - offset + last + u64::from(self.vertex_bytes()))
    }

    fn check(&self, layout: &PackedLayout, poses: u64, caps: &DeviceCaps) -> Result<()> {
        let Self { offset, stride, normals, .. } = *self;
        let words = offset.is_multiple_of(4) && stride.is_multiple_of(4) && normals.is_none_or(|at| at % 4 == 0);
        if !words || stride < self.vertex_bytes() || normals.is_some_and(|at| at < 12) {
            let text = format!("a decode target at offset {offset} with stride {stride} and normals at {normals:?}");
            let remedy = "use multiples of 4, and a stride with room for three floats, or six where there are normals";
            return Err(Error::invalid(text, remedy));
        }
        let (what, range) = (format!("decoding mesh '{}':", layout.name), caps.max_storage_range);
        let limit =
            |part: &str, amount: (u64, &str, u64), remedy| caps.check_limit(&format!("{what} {part}"), amount, remedy);
        limit("the target takes", (self.range(layout).size, "bytes", range), "use a smaller stride")?;
        limit("the slots of one instance take", (poses, "bytes", range), "use fewer slots")?;
        let workgroups = pieces(layout).div_ceil(WORKGROUP / PIECE);
        limit("it takes", (workgroups.into(), "workgroups", caps.max_workgroups.into()), "split the mesh")
    }
}

/// The pipeline for a format of poses, and where numbers are in the host's own vertices.
#[derive(Clone, Copy, PartialEq)]
struct Decode(PoseFormat, Option<PlaceConstants>);

impl PipelineKey for Decode {
    fn make(self, objects: &mut Objects) -> Result<()> {
        objects.add_layout(&[DECODE.row], 0)?;
        // It reads no deltas: the module is the same for each of their formats.
        let places = self.1.as_ref().map_or(&[][..], |places| places);
        objects.add_compute(DECODE.module(DeltaFormat::Float32, self.0, 0)?, &[places])
    }
}

/// Where an instance is decoded to.
struct Target {
    instance: u32,
    /// Pieces that changed.
    lists: Ring,
    /// One for each list.
    sets: Sets,
    push: DecodePush,
    /// Numbers from pose to pose.
    pose_numbers: u32,
    /// What the buffer holds is not known, or not all of it.
    is_stale: bool,
    /// The update that wrote the buffer last.
    written_by: u64,
    /// The instance was removed: nothing is written any longer.
    is_removed: bool,
}

/// The decode steps of a crowd.
pub(super) struct Decoder {
    kernel: Arc<Pipelines<Decode>>,
    targets: Vec<Target>,
    /// Scratch space.
    changed: Vec<Range<u32>>,
}

/// Pieces of a mesh.
fn pieces(layout: &PackedLayout) -> u32 {
    (layout.vertex_count as u32).div_ceil(PIECE)
}

impl Decoder {
    pub(super) fn new(kernels: &Kernels, poses: &Poses) -> Result<Self> {
        let kernel = kernels.get(Decode(poses.format, poses.place_constants()))?;
        Ok(Self { kernel, targets: vec![], changed: vec![] })
    }

    /// Decode an instance of a crowd into `target` from now on.
    ///
    /// # Errors
    /// A target that is refused; no memory. Nothing changes then.
    pub(super) fn set(
        &mut self,
        device: &Arc<Device>,
        group: &PoseGroup,
        frames: u32,
        instance: u32,
        target: &DecodeTarget,
    ) -> Result<()> {
        let (layout, poses) = (&group.mesh.layout, group.poses.range(instance, 1));
        if target.normals.is_some() && group.poses.places.bytes(group.poses.format)[TRIPLE].is_none() {
            let text =
                format!("normals of mesh '{}' in a decode target, which the host's vertices do not have", layout.name);
            return Err(Error::invalid(text, "name Semantic::Normal in the VertexLayout, or decode positions alone"));
        }
        target.check(layout, poses.size, &device.caps)?;
        let list_bytes = Ring::part_bytes(4 * u64::from(pieces(layout)));
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let lists = Ring::new(device, "deltamorph pieces to decode", list_bytes, frames, usage)?;
        let (base, decoded) = (group.mesh.base_pose(), target.range(layout));
        let base_at = base.offset % ALIGNMENT;
        let base = BufferRange::new(base.buffer, base.offset - base_at, base.size + base_at);
        let bound = |frame| [poses, base, lists.range(u64::from(frame)), decoded];
        let sets = self.kernel.objects.sets(&(0..frames).map(bound).collect::<Vec<_>>())?;
        let push = DecodePush {
            pose_at: 0,
            base_at: (base_at / 4) as u32,
            decoded_at: ((target.offset - decoded.offset) / 4) as u32,
            stride: target.stride / 4,
            normal_at: target.normals.unwrap_or(0) / 4,
            vertices: layout.vertex_count as u32,
            count: 0,
            listed: 0,
            units: group.poses.units(),
        };
        let pose_numbers = group.poses.numbers();
        self.unset(instance);
        let (is_stale, written_by, is_removed) = (true, 0, false);
        self.targets.push(Target { instance, lists, sets, push, pose_numbers, is_stale, written_by, is_removed });
        Ok(())
    }

    /// Whether nothing is decoded.
    pub(super) fn is_empty(&self) -> bool {
        self.targets.iter().all(|target| target.is_removed)
    }

    /// An instance is no longer decoded.
    pub(super) fn unset(&mut self, instance: u32) {
        self.targets.retain(|target| target.instance != instance);
    }

    /// An instance is removed. What earlier updates use of the target stays.
    pub(super) fn remove(&mut self, instance: u32) {
        let of = self.targets.iter_mut().filter(|target| target.instance == instance);
        of.for_each(|target| target.is_removed = true);
    }

    /// An instance is shown again: its buffer may have been used for something else meanwhile.
    pub(super) fn renew(&mut self, instance: u32) {
        let of = self.targets.iter_mut().filter(|target| target.instance == instance);
        of.for_each(|target| target.is_stale = true);
    }

    /// The update numbered `first` and all later ones will never run.
    pub(super) fn discard_from(&mut self, first: u64) {
        self.targets.iter_mut().for_each(|target| target.is_stale |= target.written_by >= first);
    }

    /// Append what brings the targets to the update that `technique` planned: nothing where nothing changed. `wrote`: what
    /// the steps used of the update that wrote poses last, this one or an earlier one.
    ///
    /// # Errors
    /// Lists that are not mapped.
    pub(super) fn plan(
        &mut self,
        technique: &dyn Technique,
        instances: &Instances,
        id: UpdateId,
        wrote: &[&'static [Use]],
        steps: &mut Steps,
    ) -> Result<()> {
        let Self { targets, changed, .. } = self;
        let mut begun = false;
        let is_shown = |target: &&mut Target| instances.is_shown(target.instance as usize);
        for target in targets.iter_mut().filter(|target| !target.is_removed).filter(is_shown) {
            let Some((slot, _)) = technique.slots_of(instances, target.instance as usize) else { continue };
            changed.clear();
            technique.changed(instances, id, target.instance, changed);
            let count = target.list(changed, id.frame)?;
            if count == 0 {
                continue;
            }
            (target.is_stale, target.written_by) = (false, id.update);
            if !begun {
                // Where no pose changes: barriers after what an earlier update wrote.
                let earlier = if steps.is_empty() { wrote } else { &[] };
                earlier.iter().copied().chain([USES]).for_each(|uses| steps.step(uses));
                begun = true;
            }
            let (instance, source) = (target.instance, Source::Slot(slot));
            steps.push(Work { kernel: KERNEL, instance, source, items: 0..count, ..Work::default() });
        }
        Ok(())
    }

    /// Whether a work is of the decode step.
    pub(super) fn is_of(work: &Work) -> bool {
        work.kernel == KERNEL
    }

    /// Record a work.
    ///
    /// # Safety
    /// As [`Technique::record`]; the target's buffer lives until it has run.
    pub(super) unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work) {
        let (Some(target), Source::Slot(slot)) =
            (self.targets.iter().find(|t| t.instance == work.instance), work.source)
        else {
            return;
        };
        let (count, pose_at) = (work.items.end, slot * target.pose_numbers);
        let push = DecodePush { pose_at, count, ..target.push };
        let workgroups = Workgroups::Of([count.div_ceil(WORKGROUP / PIECE), 1]);
        let set = (target.sets.get(frame as usize), &[][..]);
        // SAFETY: the caller's obligations; the set was made for this layout, and the list for this frame.
        unsafe { self.kernel.objects.dispatch(cmd, 0, set, bytes_of(&push), workgroups) };
    }

    /// What works read and write.
    #[cfg(any(test, feature = "internals"))]
    pub(super) fn accesses(works: &[Work]) -> Vec<Accesses> {
        let of = |work: &Work| {
            let (Work { instance, .. }, Source::Slot(slot)) = (work, work.source) else { return Accesses::default() };
            let pose = Memory::Pose { instance: *instance, slot };
            Accesses::compute([Memory::Base, pose], [Memory::Decoded { instance: *instance }])
        };
        works.iter().map(of).collect()
    }
}

impl Target {
    /// List the pieces of these vertices, or all that there are, and tell how many.
    fn list(&mut self, changed: &[Range<u32>], frame: u64) -> Result<u32> {
        let all = self.push.vertices.div_ceil(PIECE);
        let pieces = |range: &Range<u32>| range.start / PIECE..range.end.min(self.push.vertices).div_ceil(PIECE);
        let count: u32 = changed.iter().map(|range| pieces(range).len() as u32).sum();
        let listed = !self.is_stale && count < all;
        self.push.listed = listed.into();
        if !listed {
            return Ok(all);
        }
        let list = self.lists.words(frame)?;
        changed.iter().flat_map(pieces).zip(list).for_each(|(piece, word)| *word = piece);
        Ok(count)
    }
}
