//! The `scatter` path (O3DE Atom, Unity): a thread for each delta adds to the sums of its vertex by integer atomics, then
//! a pass makes the pose of the sums.
//!
//! Weights and deltas are integers on the grid of exact sums ([`ExactGrid`](crate::pack::blocks::ExactGrid)):
//! nothing overflows, and the sums are those of `blocks` with exact sums, bit for bit. So is the error: that of packing,
//! and at most ½ · weight step · Σ |delta| for weights that are not on the grid.

use crate::abi::modules::{RESOLVE, SCATTER};
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::{ResolvePush, ScatterPush};
use crate::error::Result;
use crate::gpu::descriptors::{Bound, Sets};
use crate::gpu::device::Device;
use crate::gpu::pipelines::Objects;
use crate::pack::blocks::BlockIndex;
use crate::pack::{DeltaFormat, POSE_FLOATS, PackedMesh};
use ash::vk;
use bytemuck::bytes_of;
use std::ops::Range;
use std::sync::Arc;

/// Words of a record: the vertex, then three words of a position component (18 bits) and a normal component (14 bits).
pub(crate) const RECORD_WORDS: usize = 4;

/// Deltas as `scatter.comp` reads them, target after target.
pub(crate) struct Records {
    pub(crate) words: Vec<u32>,
    /// First record of each target, and the number of all.
    pub(crate) first: Vec<u32>,
}

impl Records {
    /// The deltas of `mesh`, packed as `small`: its components fit the bits of a record.
    pub(crate) fn new(mesh: &PackedMesh, index: &BlockIndex) -> Self {
        let (mut words, mut first) = (vec![], vec![0]);
        for target in 0..mesh.layout().targets.len() {
            for incidence in index.incidence(target) {
                let block = incidence.block * index.size() as u32;
                index.for_each_lane(mesh.deltas(), incidence.entry as usize, |lane, _, q| {
                    if q != [0; POSE_FLOATS] {
                        words.push(block + lane as u32);
                        words.extend((0..3).map(|c| (q[c] as u32 & 0x3ffff) | (q[c + 3] as u32) << 18));
                    }
                });
            }
            first.push((words.len() / RECORD_WORDS) as u32);
        }
        Self { words, first }
    }
}

/// The pipelines: scatter, then resolve.
pub(crate) struct Scatter {
    objects: Objects,
}

/// The buffers of a pose: where its sums and its place are.
pub(crate) struct ScatterBuffers {
    pub(crate) records: (vk::Buffer, u64),
    pub(crate) sums: (vk::Buffer, u64),
    pub(crate) base: vk::Buffer,
    pub(crate) destination: (vk::Buffer, u64),
    /// Bytes of sums, of the base pose, and of the destination.
    pub(crate) pose_bytes: u64,
}

impl Scatter {
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self> {
        let mut objects = Objects::none(device);
        objects.add_layout(&[SCATTER.row, RESOLVE.row], 0)?;
        for kernel in [&SCATTER, &RESOLVE] {
            objects.add_compute(kernel.module(DeltaFormat::Small, 0)?, &[&[]])?;
        }
        Ok(Self { objects })
    }

    /// A set for each pose.
    pub(crate) fn sets(&self, poses: impl Iterator<Item = ScatterBuffers>) -> Result<Sets> {
        let bound: Vec<Vec<Bound>> = poses
            .map(|pose| {
                vec![
                    Bound::new(pose.records.0, 0, pose.records.1),
                    Bound::new(pose.sums.0, pose.sums.1, pose.pose_bytes),
                    Bound::new(pose.base, 0, pose.pose_bytes),
                    Bound::new(pose.destination.0, pose.destination.1, pose.pose_bytes),
                ]
            })
            .collect();
        Sets::new(&self.objects.device, self.objects.set_layout, &bound)
    }

    /// Record the addition of targets: their records, and their weights on the grid.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - `set` was made by [`sets`](Self::sets) of buffers that live until the commands have run, and have the records.
    pub(crate) unsafe fn record_add(
        &self,
        cmd: vk::CommandBuffer,
        set: vk::DescriptorSet,
        targets: impl Iterator<Item = (Range<u32>, i32)>,
    ) {
        // SAFETY: the caller's obligations.
        unsafe { self.bind(cmd, 0, set) };
        for (records, weight) in targets {
            // SAFETY: as above.
            unsafe {
                self.dispatch(cmd, records.len() as u32, |first, count| ScatterPush {
                    first: records.start + first,
                    count,
                    weight,
                });
            }
        }
    }

    /// Record the pose of `vertices`, a multiple of [`WORKGROUP`], from base and sums in these units.
    ///
    /// # Safety
    /// As [`record_add`](Self::record_add).
    pub(crate) unsafe fn record_resolve(
        &self,
        cmd: vk::CommandBuffer,
        set: vk::DescriptorSet,
        vertices: u32,
        [position_unit, normal_unit]: [f32; 2],
    ) {
        // SAFETY: the caller's obligations.
        unsafe {
            self.bind(cmd, 1, set);
            self.dispatch(cmd, vertices, |first_vertex, _| ResolvePush { first_vertex, position_unit, normal_unit });
        }
    }

    /// # Safety
    /// As [`record_add`](Self::record_add).
    unsafe fn bind(&self, cmd: vk::CommandBuffer, pipeline: usize, set: vk::DescriptorSet) {
        let (device, point) = (&self.objects.device.raw, vk::PipelineBindPoint::COMPUTE);
        // SAFETY: the caller's obligations; pipelines and layout are ours.
        unsafe {
            device.cmd_bind_pipeline(cmd, point, self.objects.pipelines[pipeline]);
            device.cmd_bind_descriptor_sets(cmd, point, self.objects.layout, 0, &[set], &[]);
        }
    }

    /// An invocation for each of `count`, in as many dispatches as the device's workgroup count asks for.
    ///
    /// # Safety
    /// As [`record_add`](Self::record_add).
    unsafe fn dispatch<P: bytemuck::Pod>(&self, cmd: vk::CommandBuffer, count: u32, push: impl Fn(u32, u32) -> P) {
        let device = &self.objects.device;
        let most = device.caps.max_workgroups.min(u32::MAX / WORKGROUP) * WORKGROUP;
        for first in (0..count).step_by(most as usize) {
            let here = most.min(count - first);
            let push = push(first, here);
            // SAFETY: the caller's obligations; the push constants are within the layout's range.
            unsafe {
                let stage = vk::ShaderStageFlags::COMPUTE;
                device.raw.cmd_push_constants(cmd, self.objects.layout, stage, 0, bytes_of(&push));
                device.raw.cmd_dispatch(cmd, here.div_ceil(WORKGROUP), 1, 1);
            }
        }
    }
}
