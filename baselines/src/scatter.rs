//! The `scatter` path (O3DE Atom, Unity): one thread per delta adds to the sums of its vertex with integer atomics,
//! then a pass makes the pose from the sums.
//!
//! Weights and deltas are integers on the grid of 32-bit fixed-point poses ([`PoseGrid`]): nothing overflows, and the
//! sums equal such poses of `blocks` bit for bit. The error is the same, too: that of packing, and at most ½ · weight
//! step · Σ |delta| for weights that are not on the grid.

use crate::abi::modules::{RESOLVE, SCATTER};
use crate::abi::numbers::WORKGROUP;
use crate::asset::streams::TRIPLE;
use crate::draws::{has_changed, one_pass};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::{MeshBuffers, Upload};
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines};
use crate::gpu::statistics::MemoryKind;
use crate::pack::blocks::{BlockIndex, PoseGrid};
use crate::pack::{DeltaFormat, POSE_FLOATS, PackedGroup, PackedMesh, PoseFormat};
use crate::plan::UpdateStats;
use crate::plan::instances::{InstanceState, Instances};
use crate::plan::steps::{Resource, Steps, Use, Work};
use crate::update::dense::DensePlanner;
use crate::update::technique::{Context, Poses, Technique, UpdateId};
use crate::{check_storage, private};
use bytemuck::bytes_of;
use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph::shader_structure;
use std::ops::Range;
use std::sync::Arc;

shader_structure! {
    /// Push constants of `baselines/scatter.comp`.
    ScatterPush {
        /// First record of the target.
        first: u32,
        count: u32,
        /// The weight, on the grid of 32-bit fixed-point poses.
        weight: i32,
    }
}

shader_structure! {
    /// Push constants of `baselines/resolve.comp`.
    ResolvePush {
        /// Vertex of the first invocation.
        first_vertex: u32,
        /// Input units per integer of a position sum.
        position_unit: f32,
        /// Input units per integer of a normal sum.
        normal_unit: f32,
    }
}

/// Words of a record: the vertex, then three words of a position component (18 bits) and a normal component (14 bits).
const RECORD_WORDS: usize = 4;

/// Makes the deltas in the layout of `scatter.comp`, target after target, and the index of the first record of each
/// target, followed by the number of records. The mesh is packed as `small`, whose components fit a record.
fn records(group: &PackedGroup, index: &BlockIndex) -> (Vec<u32>, Vec<u32>) {
    let (mut words, mut first) = (vec![], vec![0]);
    let (steps, packed) = (index.steps().map(f64::from), index.packed_vertices());
    for target in 0..group.layout().targets.len() {
        group.for_each_delta(target, |vertex, delta| {
            let q: [i32; POSE_FLOATS] = std::array::from_fn(|c| (delta[c] / steps[c / TRIPLE]) as i32);
            if q != [0; POSE_FLOATS] {
                words.push(packed[vertex]);
                words.extend((0..3).map(|c| (q[c] as u32 & 0x3ffff) | (q[c + 3] as u32) << 18));
            }
        });
        first.push((words.len() / RECORD_WORDS) as u32);
    }
    (words, first)
}

/// Creates and fills the buffers of a mesh that was checked for the path: 16-byte records of a vertex and its delta,
/// and no blocks.
///
/// # Errors
/// Sums that could overflow; more records than a descriptor covers; out of memory.
pub fn upload(device: &Arc<Device>, mesh: &PackedMesh) -> Result<(Vec<MeshBuffers>, Vec<Upload>)> {
    let (group, layout) = (&mesh.groups()[0], mesh.layout());
    let Some(index) = &layout.blocks else { unreachable!("the path takes `small`, which is in blocks") };
    let (words, first) = records(group, index);
    check_storage(device, layout, "the records of 'scatter' take", &words)?;
    let (buffers, upload) =
        MeshBuffers::new(device, layout.clone(), group.base(), &words, Some(Box::new(FirstRecords(first))))?;
    Ok((vec![buffers], vec![upload]))
}

/// The index of the first record of each target, followed by the number of records.
struct FirstRecords(Vec<u32>);

impl FirstRecords {
    fn of(mesh: &MeshBuffers) -> &[u32] {
        &private::<Self>(mesh).0
    }
}

/// The pipelines: scatter, then resolve.
#[derive(Clone, Copy, PartialEq)]
struct Scatter;

impl PipelineKey for Scatter {
    fn make(self, objects: &mut Objects) -> Result<()> {
        objects.add_layout(&[SCATTER.row, RESOLVE.row], 0)?;
        for kernel in [&SCATTER, &RESOLVE] {
            objects.add_compute(kernel.module(DeltaFormat::Small.row(), PoseFormat::Float32.row(), 0)?, &[&[]])?;
        }
        Ok(())
    }
}

/// Binds the pipeline that adds, or the one that resolves; then dispatches each of `runs` (a number of invocations),
/// split by the device's workgroup count. A run makes the push constants of a dispatch from its first invocation and
/// their number.
///
/// # Safety
/// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
/// - `set` was made for buffers that live until the commands have run, and the invocations stay within them.
unsafe fn dispatch<P: bytemuck::Pod>(
    objects: &Objects,
    cmd: vk::CommandBuffer,
    pipeline: usize,
    set: vk::DescriptorSet,
    runs: impl IntoIterator<Item = (u32, impl Fn(u32, u32) -> P)>,
) {
    let (Objects { layout, pipelines, device, .. }, point) = (objects, vk::PipelineBindPoint::COMPUTE);
    // SAFETY: the caller's obligations; pipelines and layout are ours.
    unsafe {
        device.raw.cmd_bind_pipeline(cmd, point, pipelines[pipeline]);
        device.raw.cmd_bind_descriptor_sets(cmd, point, *layout, 0, &[set], &[]);
    }
    let most = device.caps.max_workgroups.min(u32::MAX / WORKGROUP) * WORKGROUP;
    for (count, push) in runs {
        for first in (0..count).step_by(most as usize) {
            let here = most.min(count - first);
            // SAFETY: the caller's obligations; the push constants are within the layout's range.
            unsafe {
                let (stage, push) = (vk::ShaderStageFlags::COMPUTE, push(first, here));
                device.raw.cmd_push_constants(cmd, *layout, stage, 0, bytes_of(&push));
                device.raw.cmd_dispatch(cmd, here.div_ceil(WORKGROUP), 1, 1);
            }
        }
    }
}

/// Kernels of works, by [`Work::kernel`].
#[derive(Clone, Copy, PartialEq)]
enum Part {
    /// Clears the sums.
    Clear,
    /// Adds the deltas of the active targets, by atomics.
    Add,
    /// Writes the pose: base + sums.
    Resolve,
}

const PARTS: [(Part, &[Use]); 3] = [
    (Part::Clear, &[Use::copy(Resource::Sums)]),
    (Part::Add, &[Use::read(Resource::Asset), Use::read(Resource::Sums), Use::write(Resource::Sums)]),
    (Part::Resolve, &[Use::read(Resource::Asset), Use::read(Resource::Sums), Use::write(Resource::Poses)]),
];

/// A crowd with integer sums for each instance, cleared, added to and resolved in each update.
pub struct ScatterTechnique {
    kernel: Arc<Pipelines<Scatter>>,
    mesh: Arc<MeshBuffers>,
    poses: Poses,
    grid: PoseGrid,
    planner: DensePlanner,
    sums: Buffer,
    /// `[instance][slot]`.
    sets: Sets,
}

impl ScatterTechnique {
    pub fn new(context: Context<'_>) -> Result<Self> {
        let (device, desc, mesh, poses) = (context.device, context.desc, context.mesh, context.poses);
        let kernel = context.kernels.get(Scatter)?;
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_DST
            | vk::BufferUsageFlags::TRANSFER_SRC;
        let bytes = poses.bytes.saturating_mul(desc.instances.into());
        let sums = Buffer::new(device, "deltamorph scattered sums", bytes, usage, MemoryKind::Poses)?;
        let records = u64::from(FirstRecords::of(mesh).last().copied().unwrap_or(0)) * (RECORD_WORDS * 4) as u64;
        let all = (0..desc.instances).flat_map(|instance| (0..poses.slots).map(move |slot| (instance, slot)));
        let bound = |(instance, slot): (u32, u32)| {
            [
                BufferRange::new(mesh.deltas.raw, 0, records.max(16)),
                BufferRange::new(sums.raw, u64::from(instance) * poses.bytes, poses.bytes),
                BufferRange::new(mesh.base.raw, 0, poses.bytes),
                BufferRange::new(poses.buffer, poses.offset(instance, slot), poses.bytes),
            ]
        };
        Ok(Self {
            sets: kernel.objects.sets(&all.map(bound).collect::<Vec<_>>())?,
            kernel,
            mesh: mesh.clone(),
            poses,
            grid: context.grid(),
            planner: one_pass(desc)?,
            sums,
        })
    }

    fn records_of(&self, target: u32) -> Range<u32> {
        let first = FirstRecords::of(&self.mesh);
        first[target as usize]..first[target as usize + 1]
    }

    /// Bytes moved: sums cleared; each record loaded, and its six sums loaded and stored by atomics; sums and base pose
    /// loaded, the pose stored. The floor is records, base pose and pose.
    fn stats(&self) -> UpdateStats {
        let changed = self.planner.plans().iter().filter(|plan| !plan.passes.is_empty());
        let coefficients = changed.clone().flat_map(|plan| &plan.coefficients);
        let records: u64 = coefficients.clone().map(|c| self.records_of(c.target).len() as u64).sum();
        let instances = changed.clone().count();
        let poses = instances as u64 * self.poses.bytes;
        let (record, atomics) = ((RECORD_WORDS * 4) as u64, (POSE_FLOATS * 8) as u64);
        let mut stats = UpdateStats::default();
        stats.coefficients = coefficients.count();
        (stats.passes, stats.rebuilt) = (instances, instances);
        stats.bytes_moved = poses * 4 + records * (record + atomics);
        stats.bytes_floor = poses * 2 + records * record;
        stats
    }
}

impl InstanceState for ScatterTechnique {}

impl Technique for ScatterTechnique {
    fn state(&mut self) -> &mut dyn InstanceState {
        self
    }

    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        self.planner.plan(instances, id.update);
        let parts = if has_changed(&self.planner) { &PARTS[..] } else { &[] };
        for &(part, uses) in parts {
            steps.step(uses);
            for (instance, plan) in (0..).zip(self.planner.plans()) {
                let [pass] = &plan.passes[..] else { continue };
                let items = if part == Part::Add { pass.items.clone() } else { 0..0 };
                steps.push(Work { kernel: part as u32, instance, items, ..pass.clone() });
            }
        }
        Ok(self.stats())
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, work: &Work) {
        let set = self.sets.get((work.instance * self.poses.slots + work.destination) as usize);
        match PARTS[work.kernel as usize].0 {
            Part::Clear => {
                let (at, device) = (u64::from(work.instance) * self.poses.bytes, &self.kernel.objects.device.raw);
                // SAFETY: the caller's obligations; the range is within the sums.
                unsafe { device.cmd_fill_buffer(cmd, self.sums.raw, at, self.poses.bytes, 0) };
            }
            Part::Add => {
                let runs = self.planner.coefficients(work).iter().filter_map(|c| {
                    let (Range { start, end }, weight) = (self.records_of(c.target), self.grid.steps(c.value));
                    let push = move |first, count| ScatterPush { first: start + first, count, weight };
                    (weight != 0).then_some((end - start, push))
                });
                // SAFETY: the caller's obligations; the records are the mesh's.
                unsafe { dispatch(&self.kernel.objects, cmd, 0, set, runs) };
            }
            Part::Resolve => {
                let [position_unit, _, _, normal_unit, ..] = self.grid.units;
                let count = self.mesh.layout.padded_vertices() as u32;
                let push = |first_vertex, _| ResolvePush { first_vertex, position_unit, normal_unit };
                // SAFETY: the caller's obligations; `count` is a multiple of the workgroup size.
                unsafe { dispatch(&self.kernel.objects, cmd, 1, set, [(count, push)]) };
            }
        }
    }

    fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        Some((self.sums.raw, u64::from(instance) * self.poses.bytes))
    }
}
