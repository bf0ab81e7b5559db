//! The least bounds of poses, on the device.

use crate::abi::modules::{BOUNDS, BOUNDS_TOTAL};
use crate::abi::numbers::BOUNDS_PART;
use crate::abi::push::{BoundsPush, BoundsTotalPush};
use crate::after::follower::{Follower, Job, Place, PoseKernel};
use crate::after::output::aligned;
use crate::after::steps::After;
use crate::error::{Error, Result};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Buffer;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, Workgroups};
use crate::plan::after::Kind;
use crate::setters::setters;
use ash::vk;
use bytemuck::bytes_of;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Bytes of bounds: six float32.
const BYTES: u64 = 24;

/// Where the bounds of an instance are written: see
/// [`MorphEngine::set_bounds_target`](crate::MorphEngine::set_bounds_target).
///
/// Six float32, 24 bytes: the least x, y and z of any vertex, and the greatest, of the pose as it is decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct BoundsTarget {
    /// The buffer, usable as storage buffer.
    pub buffer: vk::Buffer,
    /// Offset in bytes, a multiple of 4.
    pub offset: u64,
}

setters!(BoundsTarget { offset: u64 });

impl BoundsTarget {
    /// At the beginning of the buffer.
    pub fn new(buffer: vk::Buffer) -> Self {
        Self { buffer, offset: 0 }
    }
}

/// The pipeline for what parts have in common.
#[derive(Clone, Copy, PartialEq)]
struct TotalKey;

impl PipelineKey for TotalKey {
    fn make(self, objects: &mut Objects) -> Result<()> {
        objects.add_layout(&[BOUNDS_TOTAL.kernel], 0)?;
        objects.add_compute(BOUNDS_TOTAL, &[&[]])
    }
}

/// Finds the bounds of an instance: of the parts that changed, and from those of all parts its own.
pub(crate) struct TightBounds {
    parts: (Arc<Pipelines<PoseKernel>>, Sets, BoundsPush),
    total: (Arc<Pipelines<TotalKey>>, Sets, BoundsTotalPush),
    pose_numbers: u32,
    /// Bound by the sets.
    _of_parts: Buffer,
}

impl TightBounds {
    /// Find the bounds of an instance from now on; `None`: no longer.
    ///
    /// # Errors
    /// A target that is refused; no memory. Nothing changes then.
    pub(crate) fn set(after: &mut After, place: &Place<'_>, target: Option<&BoundsTarget>) -> Result<()> {
        let Some(&BoundsTarget { buffer, offset }) = target else {
            after.unset(Kind::Bounds, place.instance);
            return Ok(());
        };
        if !offset.is_multiple_of(4) {
            let text = format!("a bounds target at offset {offset}");
            return Err(Error::invalid(text, "use a multiple of 4"));
        }
        place.check("bounds of", BOUNDS_PART)?;
        let (range, before) = aligned(buffer, offset, BYTES);
        let what = format!("a bounds target for mesh '{}'", place.group.mesh.layout.name);
        range.check_room(place.device, &what)?;
        after.set(place, Kind::Bounds, (BOUNDS_PART, 1), vk::BufferUsageFlags::STORAGE_BUFFER, |lists| {
            let vertices = place.group.mesh.layout.vertex_count as u32;
            let count = vertices.div_ceil(BOUNDS_PART);
            let (bytes, usage) = (BYTES * u64::from(count), vk::BufferUsageFlags::STORAGE_BUFFER);
            let of_parts =
                Buffer::new(place.device, "deltamorph bounds of parts", bytes, usage, MemoryLocation::GpuOnly)?;
            let (base, base_at) = place.base_pose();
            let parts_range = BufferRange::new(of_parts.raw, 0, bytes);
            let kernel = place.kernels.get(PoseKernel(&BOUNDS, place.pose()))?;
            let bound = |frame| [place.poses(), base, lists.range(u64::from(frame)), parts_range];
            let sets = kernel.objects.sets(&(0..place.frames).map(bound).collect::<Vec<_>>())?;
            let units = place.group.poses.units();
            let parts = (kernel, sets, BoundsPush { pose_at: 0, base_at, vertices, listed: 0, units });
            let kernel = place.kernels.get(TotalKey)?;
            let sets = kernel.objects.sets(&[[parts_range, range]])?;
            let total = (kernel, sets, BoundsTotalPush { count, bounds_at: (before / 4) as u32 });
            Ok(Self { parts, total, pose_numbers: place.pose_numbers(), _of_parts: of_parts })
        })
    }
}

impl Follower for TightBounds {
    unsafe fn record(&self, cmd: vk::CommandBuffer, job: &Job) {
        if job.dispatch == 1 {
            let (kernel, sets, push) = &self.total;
            let set = (sets.get(0), &[][..]);
            // SAFETY: the caller's obligations; the set was made for this layout.
            return unsafe { kernel.objects.dispatch(cmd, 0, set, bytes_of(push), Workgroups::Of([1, 1])) };
        }
        let (kernel, sets, push) = &self.parts;
        let push = BoundsPush { pose_at: job.slot * self.pose_numbers, listed: job.is_listed.into(), ..*push };
        let (set, workgroups) = ((sets.get(job.frame as usize), &[][..]), Workgroups::Of([job.count, 1]));
        // SAFETY: as above; the list is this frame's.
        unsafe { kernel.objects.dispatch(cmd, 0, set, bytes_of(&push), workgroups) };
    }
}
