//! A crowd that is animated on the GPU: clips, what each instance plays, and the lists that the GPU writes. The CPU
//! records the same commands every time.

use super::budget::Budget;
use super::clips::Clips;
use super::gpu::AnimationKernel;
use super::layout::Layout;
use super::playback::Playbacks;
use super::sample::HeadRecord;
use super::steps::{AnimatedKernel, AnimatedUpdate, UPLOADED};
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::{AnimationPush, BlocksPush};
use crate::error::{Error, Result};
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
use std::ops::Range;
use std::sync::Arc;

/// Records that one command writes: 65,536 bytes.
const RECORDS_MAX: usize = 2048;

/// What an animated crowd keeps.
pub(crate) struct Animated {
    device: Arc<Device>,
    kernel: Arc<AnimationKernel>,
    blocks: Arc<BlocksKernel>,
    pub(crate) clips: Clips,
    pub(crate) playbacks: Playbacks,
    layout: Layout,
    budget: bool,
    pub(super) state: Buffer,
    pub(super) work: Buffer,
    pub(super) control: Buffer,
    sums: Buffer,
    tables: Buffer,
    staging: Option<Buffer>,
    sets: Sets,
    block_sets: Sets,
    /// Of the last update.
    push: AnimationPush,
    block_push: BlocksPush,
    /// Widths of tiles, and whether each dispatch is a step of its own.
    widths: u32,
    texels: bool,
    /// Bytes of an instance's sums.
    pose_bytes: u64,
}

impl Animated {
    /// Make buffers and sets; [`upload`](Self::upload) fills them.
    pub(crate) fn new(context: Context<'_>, clips: Clips) -> Result<Self> {
        let (device, mesh_layout, desc) = (context.device, context.layout(), context.desc);
        let index = mesh_layout.index()?;
        if context.groups().count() > 1 {
            return Err(Error::invalid(
                format!("mesh '{}', which has more than positions and normals, animated on the GPU", mesh_layout.name),
                "make a crowd whose weights are set, or leave the other streams out of the mesh",
            ));
        }
        let (grid, poses) = (index.exact()?, context.poses);
        let budget = Budget::new(desc.update.error_budget, index)?;
        let layout = Layout::new(&context, index, &clips, budget.as_ref())?;
        // Tiles are filled up to the next width, so that there has to be one.
        let instances = desc.instances.max(2).next_power_of_two();
        let blocks = context.kernels.get::<BlocksKernel>(BlocksKey::new(&context, index, true, instances)?)?;
        let how = blocks.dispatching(0);
        let kernel = context.kernels.get::<AnimationKernel>(())?;

        use vk::BufferUsageFlags as U;
        let buffer = |name, bytes, usage, location| Buffer::new(device, &BufferDesc { name, bytes, usage, location });
        let on_device = |name, bytes, usage| {
            let usage = usage | U::STORAGE_BUFFER | U::TRANSFER_SRC | U::TRANSFER_DST;
            buffer(name, bytes, usage, MemoryLocation::GpuOnly)
        };
        let (groups, table_bytes) = (&layout.groups, layout.table_bytes());
        let tables = on_device("deltamorph clips", table_bytes, U::empty())?;
        let state = on_device("deltamorph animated weights", layout.state_bytes(), U::empty())?;
        let work = on_device("deltamorph planned work", groups.stride * u64::from(groups.count()), LIST_USAGE)?;
        let control = on_device("deltamorph dispatches", layout.control_bytes(), U::INDIRECT_BUFFER)?;
        let sums = sums_buffer(device, poses.bytes * u64::from(desc.instances))?;
        let mut staging = buffer("deltamorph clip upload", table_bytes, U::TRANSFER_SRC, STAGING)?;
        let words = layout.tables(index, &clips, budget.as_ref());
        staging.mapped()?[..table_bytes as usize].copy_from_slice(bytemuck::cast_slice(&words));

        let range = |buffer: &Buffer, offset, size| BufferRange { buffer: buffer.raw, offset, size };
        let (mut plan, mut of_blocks) = (vec![], vec![]);
        for group in 0..groups.count() {
            let (first, count) = groups.get(group);
            let list = range(&work, u64::from(group) * groups.stride, groups.stride);
            plan.push([
                range(&tables, 0, table_bytes),
                range(&state, 0, layout.state_bytes()),
                list,
                range(&control, 0, layout.control_bytes()),
            ]);
            of_blocks.push(GroupBuffers {
                asset: asset_range(&context),
                list,
                poses: poses.range(first, count),
                sums: Some(range(&sums, u64::from(first) * poses.bytes, u64::from(count) * poses.bytes)),
            });
        }
        Ok(Self {
            device: device.clone(),
            sets: kernel.sets(&plan)?,
            block_sets: blocks.sets(&of_blocks)?,
            playbacks: Playbacks::new(desc.instances),
            staging: Some(staging),
            tables,
            kernel,
            blocks,
            clips,
            state,
            work,
            control,
            sums,
            budget: budget.is_some(),
            push: layout.push(),
            layout,
            block_push: blocks_push(mesh_layout, index, poses.slots, Some(grid)),
            widths: how.widths,
            texels: how.texels,
            pose_bytes: poses.bytes,
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
            for buffer in [&self.state, &self.control] {
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

    /// The dispatches of blocks, `[group][width][chunk]`: as many workgroups as the GPU has planned.
    ///
    /// # Safety
    /// As [`Technique::record`].
    unsafe fn record_blocks(&self, cmd: vk::CommandBuffer, dispatches: Range<u32>) {
        let groups = &self.layout.groups;
        for dispatch in dispatches {
            let (chunk, rest) = (dispatch % groups.chunks, dispatch / groups.chunks);
            let (width, group) = (rest % self.widths, rest / self.widths);
            let first = u64::from(chunk) * u64::from(self.push.chunk_items);
            let item = (u64::from(width) * groups.capacity + first) * TILE_WORDS as u64;
            let push = BlocksPush { first_item: item as u32, ..self.block_push };
            let arguments = Workgroups::At(self.control.raw, groups.arguments(group, width as usize, chunk));
            let set = self.block_sets.get(group as usize);
            // SAFETY: the caller's obligations; the set was written for this mesh and crowd; the arguments lie within
            // the buffer, which is one of arguments.
            unsafe { self.blocks.dispatch(cmd, set, width, &push, arguments) };
        }
    }
}

impl Technique for Animated {
    fn plan(&mut self, _instances: &Instances, _id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        let (update, slots) = (self.playbacks.update(&self.clips), u64::from(self.push.slots));
        let (source, destination) = (((update + slots - 1) % slots) as u32, (update % slots) as u32);
        (self.push.now, self.push.source, self.push.destination) = (self.playbacks.now(), source, destination);
        let groups = &self.layout.groups;
        let update = AnimatedUpdate {
            records: !self.playbacks.changed().is_empty(),
            budget: self.budget,
            source,
            destination,
            dispatches: groups.count() * self.widths * groups.chunks,
            texels: self.texels,
        };
        update.fill(steps);
        Ok(UpdateStats { passes: 1, ..UpdateStats::default() })
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, _frame: u64, work: &Work) {
        let (kernel, push, caps) = (&self.kernel, &self.push, &self.device.caps);
        let invocations = u64::from(push.heads) * u64::from(self.layout.target_words());
        let (blocks, what) = (self.layout.blocks().div_ceil(WORKGROUP), AnimatedKernel::ALL[work.kernel as usize]);
        let workgroups = match what {
            AnimatedKernel::Sample | AnimatedKernel::Commit => kernel.groups(invocations),
            AnimatedKernel::Budget => [blocks, push.heads.min(caps.max_workgroups)],
            AnimatedKernel::Arguments => [1, 1],
            // SAFETY: the caller's obligations.
            AnimatedKernel::Records => return unsafe { self.record_records(cmd) },
            // SAFETY: the caller's obligations.
            AnimatedKernel::Blocks => return unsafe { self.record_blocks(cmd, work.items.clone()) },
            AnimatedKernel::Plan => {
                // SAFETY: as below.
                unsafe { kernel.bind(cmd, what) };
                for group in 0..self.layout.groups.count() {
                    let (first_head, group_heads) = self.layout.groups.get(group);
                    let first_counter = group * WIDTHS as u32;
                    let push = AnimationPush { first_head, group_heads, first_counter, ..*push };
                    let tiles = group_heads.div_ceil(caps.tuning.widest_tile);
                    // SAFETY: as below.
                    unsafe { kernel.dispatch(cmd, self.sets.get(group as usize), &push, [blocks, tiles]) };
                }
                return;
            }
        };
        // SAFETY: the caller's obligations; sets and push constants were made for these buffers, and workgroups are no
        // more than the device allows.
        unsafe {
            kernel.bind(cmd, what);
            kernel.dispatch(cmd, self.sets.get(0), push, workgroups);
        }
    }

    fn slots_of(&self, instance: u32) -> Option<(u32, Option<u32>)> {
        let (update, has_past) = self.playbacks.written(instance)?;
        let slots = u64::from(self.push.slots);
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

    fn remove(&mut self, instance: u32) {
        self.playbacks.set_hidden(instance, true);
    }

    /// What the GPU would have changed is unchanged: the CPU's count of updates turns back, and that is all.
    fn discard_from(&mut self, id: UpdateId) {
        self.playbacks.discard_from(id.recorded);
    }

    fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        Some((self.sums.raw, u64::from(instance) * self.pose_bytes))
    }

    #[cfg(any(test, feature = "internals"))]
    fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        super::steps::accesses(works, self.push.heads)
    }
}
