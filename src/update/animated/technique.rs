//! A crowd that is animated on the GPU: clips, what each instance plays, and the lists that the GPU writes. The CPU
//! records the same commands every time.

use super::budget::Budget;
use super::clips::Clips;
use super::gpu::AnimationKernel;
use super::layout::{GroupLayout, Groups, Layout};
use super::playback::Playbacks;
use super::sample::HeadRecord;
use super::steps::{AnimatedKernel, AnimatedUpdate, UPLOADED};
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::{AnimationPush, BlocksPush};
use crate::error::Result;
use crate::gpu::barriers;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::memory::{Buffer, BufferDesc, STAGING};
use crate::plan::UpdateStats;
use crate::plan::instances::Instances;
use crate::plan::schedule::Barrier;
use crate::plan::steps::{Steps, Work};
use crate::update::blocks::gpu::{BlocksKernel, BlocksKey, GroupBuffers, Workgroups};
use crate::update::blocks::shared::{LIST_USAGE, asset_range, blocks_push, sums_buffer};
use crate::update::blocks::{TILE_WORDS, WIDTHS};
use crate::update::technique::{Context, Technique, UpdateId};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Records that one command writes: 65,536 bytes.
const RECORDS_MAX: usize = 2048;

/// What an animated crowd keeps.
pub(crate) struct Animated {
    device: Arc<Device>,
    kernel: Arc<AnimationKernel>,
    pub(crate) clips: Clips,
    pub(crate) playbacks: Playbacks,
    layout: Layout,
    budget: bool,
    pub(super) state: Buffer,
    tables: Buffer,
    staging: Option<Buffer>,
    /// Of the mesh; the first one's sets serve what all have in common.
    pub(super) groups: Vec<Group>,
}

/// What a group of the mesh takes.
pub(super) struct Group {
    blocks: Arc<BlocksKernel>,
    #[cfg_attr(not(feature = "headless"), allow(dead_code, reason = "read back by headless alone"))]
    pub(super) work: Buffer,
    pub(super) control: Buffer,
    #[cfg_attr(not(feature = "headless"), allow(dead_code, reason = "read back by headless alone"))]
    sums: Buffer,
    sets: Sets,
    block_sets: Sets,
    /// Of the last update.
    push: AnimationPush,
    block_push: BlocksPush,
    /// Widths of tiles, and whether each dispatch is a step of its own.
    widths: u32,
    texels: bool,
    /// Bytes of an instance's sums.
    #[cfg_attr(not(feature = "headless"), allow(dead_code, reason = "read back by headless alone"))]
    pose_bytes: u64,
}

fn on_device(device: &Arc<Device>, name: &'static str, bytes: u64, usage: vk::BufferUsageFlags) -> Result<Buffer> {
    use vk::BufferUsageFlags as U;
    let usage = usage | U::STORAGE_BUFFER | U::TRANSFER_SRC | U::TRANSFER_DST;
    Buffer::new(device, &BufferDesc { name, bytes, usage, location: MemoryLocation::GpuOnly })
}

impl Group {
    /// Buffers and sets of a group; `common` are tables and state.
    fn new(
        context: Context<'_>,
        kernel: &AnimationKernel,
        (layout, group): (&Layout, &GroupLayout),
        common: [BufferRange; 2],
    ) -> Result<Self> {
        let (device, desc, poses, index) = (context.device, context.desc, context.poses, context.layout().index()?);
        // Tiles are filled up to the next width, so that there has to be one.
        let instances = desc.instances.max(2).next_power_of_two();
        let blocks = context.kernels.get::<BlocksKernel>(BlocksKey::new(&context, index, true, instances)?)?;
        let (how, groups) = (blocks.dispatching(0), &group.groups);
        let list_bytes = groups.stride * u64::from(groups.count());
        let work = on_device(device, "deltamorph planned work", list_bytes, LIST_USAGE)?;
        let arguments = vk::BufferUsageFlags::INDIRECT_BUFFER;
        let control = on_device(device, "deltamorph dispatches", group.control_bytes(), arguments)?;
        let sums = sums_buffer(device, poses.bytes * u64::from(desc.instances))?;
        let range = |buffer: &Buffer, offset, size| BufferRange { buffer: buffer.raw, offset, size };
        let (mut plan, mut of_blocks) = (vec![], vec![]);
        for set in 0..groups.count() {
            let (first, count) = groups.get(set);
            let list = range(&work, u64::from(set) * groups.stride, groups.stride);
            plan.push([common[0], common[1], list, range(&control, 0, group.control_bytes())]);
            of_blocks.push(GroupBuffers {
                asset: asset_range(&context),
                list,
                poses: poses.range(first, count),
                sums: Some(range(&sums, u64::from(first) * poses.bytes, u64::from(count) * poses.bytes)),
            });
        }
        Ok(Self {
            sets: kernel.sets(&plan)?,
            block_sets: blocks.sets(&of_blocks)?,
            push: layout.push(group),
            block_push: blocks_push(context.layout(), index, poses.slots, Some(index.exact()?)),
            widths: how.widths,
            texels: how.texels,
            pose_bytes: poses.bytes,
            blocks,
            work,
            control,
            sums,
        })
    }

    /// Dispatches of blocks, `[group of instances][width][chunk]`.
    fn dispatches(&self, groups: &Groups) -> u32 {
        groups.count() * self.widths * groups.chunks
    }
}

impl Animated {
    /// Make buffers and sets; [`upload`](Self::upload) fills them.
    pub(crate) fn new(context: Context<'_>, clips: Clips) -> Result<Self> {
        let (device, desc) = (context.device, context.desc);
        let budget = Budget::new(desc.update.error_budget, context.layout().index()?)?;
        let layout = Layout::new(&context, &clips, budget.as_ref())?;
        let kernel = context.kernels.get::<AnimationKernel>(())?;

        let (table_bytes, none) = (layout.table_bytes(), vk::BufferUsageFlags::empty());
        let tables = on_device(device, "deltamorph clips", table_bytes, none)?;
        let state = on_device(device, "deltamorph animated weights", layout.state_bytes(), none)?;
        let upload = BufferDesc {
            name: "deltamorph clip upload",
            bytes: table_bytes,
            usage: vk::BufferUsageFlags::TRANSFER_SRC,
            location: STAGING,
        };
        let mut staging = Buffer::new(device, &upload)?;
        let indices = context.groups().filter_map(|group| group.layout().blocks.as_deref());
        let words = layout.tables(indices, &clips, budget.as_ref());
        staging.mapped()?[..table_bytes as usize].copy_from_slice(bytemuck::cast_slice(&words));

        let common = [(&tables, table_bytes), (&state, layout.state_bytes())];
        let common = common.map(|(buffer, size)| BufferRange { buffer: buffer.raw, offset: 0, size });
        let groups = context.groups().zip(&layout.of_groups);
        let groups = groups.map(|(context, group)| Group::new(context, &kernel, (&layout, group), common));
        Ok(Self {
            groups: groups.collect::<Result<_>>()?,
            device: device.clone(),
            playbacks: Playbacks::new(desc.instances),
            staging: Some(staging),
            tables,
            kernel,
            clips,
            state,
            budget: budget.is_some(),
            layout,
        })
    }

    /// Record the upload of clips and tables, and fill what kernels keep with zeros.
    ///
    /// # Safety
    /// As [`create_animated_crowd`](crate::engine::MorphEngine::create_animated_crowd).
    pub(crate) unsafe fn upload(&self, cmd: vk::CommandBuffer) {
        let (Some(staging), device) = (&self.staging, &self.device.raw) else { return };
        let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: self.layout.table_bytes() }];
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

    /// Give the staging memory of the clips back.
    pub(crate) fn release_staging(&mut self) {
        self.staging = None;
    }

    /// Where work lists, arguments and weights are.
    #[cfg(feature = "headless")]
    pub(super) fn layout(&self) -> &Layout {
        &self.layout
    }

    /// # Safety
    /// As [`Technique::record`].
    unsafe fn record_records(&self, cmd: vk::CommandBuffer) {
        for run in self.playbacks.changed() {
            let mut at = run.start as usize;
            for records in self.playbacks.records()[at..run.end as usize].chunks(RECORDS_MAX) {
                let (offset, data) = (at * size_of::<HeadRecord>(), bytemuck::cast_slice(records));
                // SAFETY: the caller's obligations; the records lie within the state, and are no more than Vulkan
                // allows.
                unsafe { self.device.raw.cmd_update_buffer(cmd, self.state.raw, offset as u64, data) };
                at += records.len();
            }
        }
    }

    /// Dispatches of the blocks of a group: as many workgroups as the GPU has planned.
    ///
    /// # Safety
    /// As [`Technique::record`].
    unsafe fn record_blocks(&self, cmd: vk::CommandBuffer, work: &Work) {
        let (group, groups) = (&self.groups[work.group as usize], &self.layout.of_groups[work.group as usize].groups);
        // Other groups may have more of them.
        for dispatch in work.items.start..work.items.end.min(group.dispatches(groups)) {
            let (chunk, rest) = (dispatch % groups.chunks, dispatch / groups.chunks);
            let (width, set) = (rest % group.widths, rest / group.widths);
            let first = u64::from(chunk) * u64::from(group.push.chunk_items);
            let item = (u64::from(width) * groups.capacity + first) * TILE_WORDS as u64;
            let push = BlocksPush { first_item: item as u32, ..group.block_push };
            let arguments = Workgroups::At(group.control.raw, groups.arguments(set, width as usize, chunk));
            let set = group.block_sets.get(set as usize);
            // SAFETY: the caller's obligations; the set was written for this mesh and crowd; the arguments lie within
            // the buffer, which is one of arguments.
            unsafe { group.blocks.dispatch(cmd, set, width, &push, arguments) };
        }
    }
}

impl Technique for Animated {
    fn plan(&mut self, _instances: &mut Instances, _id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        let (update, slots) = (self.playbacks.update(&self.clips), u64::from(self.groups[0].push.slots));
        let (source, destination) = (((update + slots - 1) % slots) as u32, (update % slots) as u32);
        for Group { push, .. } in &mut self.groups {
            (push.now, push.source, push.destination) = (self.playbacks.now(), source, destination);
        }
        let groups = self.groups.iter().zip(&self.layout.of_groups);
        let update = AnimatedUpdate {
            records: !self.playbacks.changed().is_empty(),
            budget: self.budget,
            source,
            destination,
            groups: self.groups.len() as u32,
            dispatches: groups.map(|(group, layout)| group.dispatches(&layout.groups)).max().unwrap_or(0),
            texels: self.groups.iter().any(|group| group.texels),
        };
        update.fill(steps);
        Ok(UpdateStats { passes: 1, ..UpdateStats::default() })
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, work: &Work) {
        let (group, layout) = (&self.groups[work.group as usize], &self.layout.of_groups[work.group as usize]);
        let (kernel, push, caps) = (&self.kernel, &group.push, &self.device.caps);
        let invocations = u64::from(push.heads) * u64::from(self.layout.target_words());
        let (blocks, what) = (layout.blocks.div_ceil(WORKGROUP), AnimatedKernel::ALL[work.kernel as usize]);
        let workgroups = match what {
            AnimatedKernel::Sample | AnimatedKernel::Commit => kernel.groups(invocations),
            AnimatedKernel::Budget => [blocks, push.heads.min(caps.max_workgroups)],
            AnimatedKernel::Arguments => [1, 1],
            // SAFETY: the caller's obligations.
            AnimatedKernel::Records => return unsafe { self.record_records(cmd) },
            // SAFETY: the caller's obligations.
            AnimatedKernel::Blocks => return unsafe { self.record_blocks(cmd, work) },
            AnimatedKernel::Plan => {
                // SAFETY: as below.
                unsafe { kernel.bind(cmd, what) };
                for set in 0..layout.groups.count() {
                    let (first_head, group_heads) = layout.groups.get(set);
                    let first_counter = set * WIDTHS as u32;
                    let push = AnimationPush { first_head, group_heads, first_counter, ..*push };
                    let tiles = group_heads.div_ceil(caps.tuning.widest_tile);
                    // SAFETY: as below.
                    unsafe { kernel.dispatch(cmd, group.sets.get(set as usize), &push, [blocks, tiles]) };
                }
                return;
            }
        };
        // SAFETY: the caller's obligations; sets and push constants were made for these buffers, and workgroups are no
        // more than the device allows.
        unsafe {
            kernel.bind(cmd, what);
            kernel.dispatch(cmd, group.sets.get(0), push, workgroups);
        }
    }

    fn slots_of(&self, _instances: &Instances, instance: usize) -> Option<(u32, Option<u32>)> {
        let (update, has_past) = self.playbacks.written(instance as u32)?;
        let slots = u64::from(self.groups[0].push.slots);
        let slot = (update % slots) as u32;
        let before = ((update + slots - 1) % slots) as u32;
        Some((slot, if !has_past { Some(slot) } else { (slots > 1).then_some(before) }))
    }

    fn cut(&mut self, instance: u32) {
        self.playbacks.cut(instance);
    }

    fn set_hidden(&mut self, instance: u32, hidden: bool) {
        self.playbacks.set_hidden(instance, hidden);
    }

    fn add(&mut self, instance: u32) {
        self.playbacks.add(instance);
    }

    /// What the GPU would have changed is unchanged: the CPU's count of updates turns back, and that is all.
    fn discard_from(&mut self, id: UpdateId) {
        self.playbacks.discard_from(id.recorded);
    }

    fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        let group = &self.groups[0];
        Some((group.sums.raw, u64::from(instance) * group.pose_bytes))
    }

    #[cfg(any(test, feature = "internals"))]
    fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        super::steps::accesses(works, self.groups[0].push.heads)
    }
}
