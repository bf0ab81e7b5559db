//! Device side of a crowd animated on the GPU. The CPU records the same commands in every update.

use super::clips::Clips;
use super::layout::{GroupLayout, Layout};
use super::playback::Playbacks;
use super::sample::PlaybackRecord;
use super::steps::{AnimatedKernel, AnimatedUpdate, UPLOADED};
use crate::abi::modules;
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::AnimationPush;
use crate::abi::worklist::TILE_WORDS;
use crate::error::Result;
use crate::gpu::barriers;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, Workgroups};
use crate::gpu::statistics::MemoryKind;
use crate::plan::UpdateStats;
use crate::plan::instances::{InstanceState, Instances};
use crate::plan::schedule::Barrier;
use crate::plan::steps::{Steps, Work};
use crate::update::blocks::gpu::{BlocksKernels, Bound, GroupBlocks, LIST_USAGE};
use crate::update::technique::{Context, Technique, UpdateId};
use ash::vk::{self, BufferUsageFlags};
use bytemuck::bytes_of;
use std::sync::Arc;

/// Most records of one update command, which is limited to 65,536 bytes.
const RECORDS_MAX: usize = 65_536 / size_of::<PlaybackRecord>();

/// Pipelines that sample and plan, in the order of [`AnimatedKernel`]; independent of mesh and crowd.
#[derive(Clone, Copy, PartialEq)]
struct Planning;

impl PipelineKey for Planning {
    fn make(self, objects: &mut Objects) -> Result<()> {
        objects.add_layout(&[modules::ANIMATE.kernel], 0)?;
        let tuning = objects.device.caps.tuning;
        let widest = [tuning.widest_tile];
        objects.add_compute(modules::ANIMATE, &[&[tuning.sampling_lanes()]])?;
        objects.add_compute(if tuning.plans_together { modules::PLAN_TOGETHER } else { modules::PLAN }, &[&widest])?;
        objects.add_compute(modules::ARGUMENTS, &[&widest])
    }
}

/// A crowd whose updates the GPU plans.
pub struct Animated {
    device: Arc<Device>,
    planning: Arc<Pipelines<Planning>>,
    pub(crate) clips: Clips,
    pub(crate) playbacks: Playbacks,
    /// Records, weights and histories.
    pub state: Buffer,
    tables: Buffer,
    table_bytes: u64,
    pub(crate) staging: Option<Buffer>,
    /// By group of the mesh. Works shared by all groups use the descriptor sets of the first.
    pub groups: Vec<Group>,
}

/// A group of the mesh.
pub struct Group {
    /// Its sets, runs and work lists.
    pub layout: GroupLayout,
    blocks: GroupBlocks,
    /// Work lists.
    pub work: Buffer,
    /// Item counts and dispatch arguments.
    pub control: Buffer,
    /// Descriptor sets of [`Planning`], by work list.
    sets: Sets,
}

fn on_device(device: &Arc<Device>, name: &'static str, bytes: u64, usage: BufferUsageFlags) -> Result<Buffer> {
    let usage =
        usage | BufferUsageFlags::STORAGE_BUFFER | BufferUsageFlags::TRANSFER_SRC | BufferUsageFlags::TRANSFER_DST;
    Buffer::new(device, name, bytes, usage, MemoryKind::Animation)
}

impl Group {
    /// `common` are tables and state.
    fn new(context: Context<'_>, planning: &Objects, layout: GroupLayout, common: &[BufferRange; 2]) -> Result<Self> {
        let device = context.device;
        // Tiles are padded to the next width, so at least one width must exist.
        let instances = context.desc.instances.max(2).next_power_of_two();
        let kernels = BlocksKernels::new(&context, instances, 0)?;
        let work = on_device(device, "deltamorph planned work", layout.list_bytes(), LIST_USAGE)?;
        let arguments = BufferUsageFlags::INDIRECT_BUFFER;
        let control = on_device(device, "deltamorph dispatches", layout.control_bytes(), arguments)?;
        let (mut planned, mut bound) = (vec![], vec![]);
        for list in 0..layout.lists() {
            let (set, _) = layout.get(list);
            let (offset, size) = layout.place(list);
            let list = BufferRange::new(work.raw, offset, size);
            planned.push([common[0], common[1], list, BufferRange::new(control.raw, 0, layout.control_bytes())]);
            bound.push(Bound { list, instances: layout.instances(set) });
        }
        Ok(Self {
            sets: planning.sets(&planned)?,
            blocks: GroupBlocks::new(&context, kernels, &bound)?,
            layout,
            work,
            control,
        })
    }

    /// Number of dispatches of blocks, `[work list][width][chunk]`.
    fn dispatches(&self) -> u32 {
        self.layout.lists() * self.blocks.how.widths * self.layout.push.chunks
    }
}

impl Animated {
    /// Creates buffers and sets; [`upload`](Self::upload) fills them.
    pub(crate) fn new(context: Context<'_>, clips: Clips) -> Result<Self> {
        let device = context.device;
        let layout = Layout::new(&context, &clips)?;
        let planning = context.kernels.get(Planning)?;

        let table_bytes = layout.table_bytes;
        let none = BufferUsageFlags::empty();
        let tables = on_device(device, "deltamorph clips", table_bytes, none)?;
        let state = on_device(device, "deltamorph animated weights", layout.state_bytes, none)?;
        let mut staging = Buffer::staging(device, "deltamorph clip upload", table_bytes)?;
        let indices = context.groups().filter_map(|group| group.layout().blocks.as_deref());
        let words = layout.tables(indices, &clips);
        staging.mapped()?[..table_bytes as usize].copy_from_slice(bytemuck::cast_slice(&words));

        let common = [BufferRange::new(tables.raw, 0, table_bytes), BufferRange::new(state.raw, 0, layout.state_bytes)];
        let groups = context.groups().zip(layout.groups);
        let groups = groups.map(|(context, layout)| Group::new(context, &planning.objects, layout, &common));
        Ok(Self {
            groups: groups.collect::<Result<_>>()?,
            device: device.clone(),
            playbacks: Playbacks::new(context.desc.instances),
            staging: Some(staging),
            tables,
            table_bytes,
            planning,
            clips,
            state,
        })
    }

    /// Records the upload of clips and tables, and clears state and control buffers.
    ///
    /// # Safety
    /// See [`create_animated_crowd`](crate::engine::MorphEngine::create_animated_crowd).
    pub(crate) unsafe fn upload(&self, cmd: vk::CommandBuffer) {
        let (Some(staging), device) = (&self.staging, &self.device.raw) else { return };
        let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: self.table_bytes }];
        // SAFETY: the caller's obligations; the region lies within both buffers, and fills cover whole buffers.
        unsafe {
            device.cmd_copy_buffer(cmd, staging.raw, self.tables.raw, &region);
            for buffer in self.groups.iter().map(|group| &group.control).chain([&self.state]) {
                device.cmd_fill_buffer(cmd, buffer.raw, 0, vk::WHOLE_SIZE, 0);
            }
            if let Some(barrier) = Barrier::between(UPLOADED[0], UPLOADED[1]) {
                barriers::record(device, cmd, &barrier);
            }
        }
    }

    /// # Safety
    /// See [`Technique::record`].
    unsafe fn record_records(&self, cmd: vk::CommandBuffer) {
        for run in self.playbacks.changed() {
            let mut at = run.start as usize;
            for records in self.playbacks.records()[at..run.end as usize].chunks(RECORDS_MAX) {
                let offset = at * size_of::<PlaybackRecord>();
                let data = bytemuck::cast_slice(records);
                // SAFETY: the caller's obligations; the records lie within the state, and are no more than Vulkan
                // allows.
                unsafe { self.device.raw.cmd_update_buffer(cmd, self.state.raw, offset as u64, data) };
                at += records.len();
            }
        }
    }

    /// Dispatches the blocks of a group, with workgroup counts from the GPU.
    ///
    /// # Safety
    /// See [`Technique::record`].
    unsafe fn record_blocks(&self, cmd: vk::CommandBuffer, work: &Work) {
        let group = &self.groups[work.group as usize];
        let (layout, AnimationPush { chunks, chunk_workgroups, workgroup_items, .. }) =
            (&group.layout, group.layout.push);
        // Another group may have more dispatches.
        for dispatch in work.items.start..work.items.end.min(group.dispatches()) {
            let chunk = dispatch % chunks;
            let rest = dispatch / chunks;
            let width = rest % group.blocks.how.widths;
            let list = rest / group.blocks.how.widths;
            let item = (width * layout.capacity(list) + chunk * chunk_workgroups * workgroup_items) * TILE_WORDS as u32;
            let arguments = Workgroups::At(group.control.raw, layout.arguments(list, width, chunk));
            // SAFETY: the caller's obligations; the arguments lie within the buffer, which is one of arguments.
            unsafe { group.blocks.dispatch(cmd, list as usize, width as usize, item, arguments) };
        }
    }

    /// Workgroups that sample, in two dimensions if one is too small.
    fn sampling(&self, push: &AnimationPush) -> [u32; 2] {
        let words = u64::from(push.instances) * u64::from(push.words);
        let invocations = words * u64::from(self.device.caps.tuning.sampling_lanes());
        let groups = invocations.div_ceil(WORKGROUP.into()).max(1);
        let x = groups.min(self.device.caps.max_workgroups.into());
        [x as u32, groups.div_ceil(x) as u32]
    }

    /// Source and destination slots of update `update`.
    fn slots(&self, update: u64) -> (u32, u32) {
        let slots = u64::from(self.groups[0].layout.push.slots);
        (((update + slots - 1) % slots) as u32, (update % slots) as u32)
    }
}

impl Technique for Animated {
    fn plan(&mut self, _instances: &mut Instances, _id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        let update = self.playbacks.update(&self.clips);
        let (source, destination) = self.slots(update);
        for Group { layout: GroupLayout { push, .. }, .. } in &mut self.groups {
            (push.now, push.source, push.destination) = (self.playbacks.now(), source, destination);
        }
        let update = AnimatedUpdate {
            records: !self.playbacks.changed().is_empty(),
            source,
            destination,
            groups: self.groups.len() as u32,
            dispatches: self.groups.iter().map(Group::dispatches).max().unwrap_or(0),
            texels: self.groups.iter().any(|group| group.blocks.how.texels),
        };
        update.fill(steps);
        Ok(UpdateStats { passes: 1, ..UpdateStats::default() })
    }

    fn step_name(&self, work: &Work) -> Option<&'static str> {
        Some(AnimatedKernel::ALL[work.kernel as usize].row().0)
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, work: &Work) {
        let group = &self.groups[work.group as usize];
        let what = AnimatedKernel::ALL[work.kernel as usize];
        let layout = &group.layout;
        let push = &layout.push;
        // Work lists are planned one at a time; other kernels process all of them.
        let listed = matches!(what, AnimatedKernel::Plan | AnimatedKernel::Arguments);
        for list in 0..if listed { layout.lists() } else { 1 } {
            let (push, workgroups) = match what {
                AnimatedKernel::Sample => (*push, self.sampling(push)),
                AnimatedKernel::Plan => layout.plan(list),
                AnimatedKernel::Arguments => (layout.plan(list).0, [1, 1]),
                // SAFETY: the caller's obligations.
                AnimatedKernel::Records => return unsafe { self.record_records(cmd) },
                // SAFETY: the caller's obligations.
                AnimatedKernel::Blocks => return unsafe { self.record_blocks(cmd, work) },
            };
            let set = group.sets.get(list as usize);
            let workgroups = Workgroups::Of(workgroups);
            // SAFETY: the caller's obligations; sets and push constants were made for these buffers, and workgroups
            // are no more than the device allows.
            unsafe { self.planning.objects.dispatch(cmd, what as usize, (set, &[]), bytes_of(&push), workgroups) };
        }
    }

    fn slots_of(&self, _instances: &Instances, instance: usize) -> Option<(u32, Option<u32>)> {
        let (update, has_past) = self.playbacks.written(instance as u32)?;
        let (before, slot) = self.slots(update);
        Some((slot, if !has_past { Some(slot) } else { (before != slot).then_some(before) }))
    }

    fn state(&mut self) -> &mut dyn InstanceState {
        &mut self.playbacks
    }

    /// The GPU has changed nothing: only the host's state is rolled back.
    fn discard_from(&mut self, id: UpdateId) {
        self.playbacks.discard_from(id.recorded);
    }

    fn begin_at(&mut self, updates: u64) {
        self.playbacks.begin_at(updates);
    }
}
