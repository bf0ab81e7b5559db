//! What a crowd that is animated on the GPU has of its own: clips, what each head plays, and the lists that the GPU
//! writes. The CPU records the same commands every time.

mod api;
mod layout;
#[cfg(feature = "headless")]
mod readback;

use super::MeshBuffers;
use super::blocks::{LIST_USAGE, asset_bytes, blocks_push, sums_buffer};
use super::crowd::CrowdDesc;
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::{AnimationPush, BlocksPush};
use crate::animation::{Budget, Clips, HeadRecord, Heads};
use crate::error::{Error, Result};
use crate::gpu::animation::{AnimationKernel, Step};
use crate::gpu::barriers;
use crate::gpu::blocks::{BlocksKernel, GroupBuffers};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::memory::{Buffer, BufferDesc, STAGING};
use crate::plan::animated::{AnimatedCommand, AnimatedUpdate};
use crate::plan::blocks::{TILE_WORDS, WIDTHS};
use crate::plan::commands::{Command, CommandList, Hazard};
use crate::plan::{UpdateMode, UpdateStats};
use ash::vk;
use gpu_allocator::MemoryLocation;
use layout::{Groups, state_words, tables};
use std::sync::Arc;

/// Records that one command writes: 65,536 bytes.
const RECORDS_MAX: usize = 2048;

pub(crate) struct Animated {
    kernel: Arc<AnimationKernel>,
    update: Arc<BlocksKernel>,
    pub(super) clips: Clips,
    pub(super) heads: Heads,
    pub(super) list: CommandList,
    state: Buffer,
    // The GPU's alone.
    #[cfg_attr(not(feature = "headless"), expect(dead_code, reason = "kept for the sets that name it"))]
    work: Buffer,
    control: Buffer,
    #[cfg_attr(not(feature = "headless"), expect(dead_code, reason = "kept for the sets that name it"))]
    sums: Buffer,
    tables: Buffer,
    staging: Option<Buffer>,
    sets: Sets,
    block_sets: Sets,
    groups: Groups,
    push: AnimationPush,
    block_push: BlocksPush,
}

impl Animated {
    /// Make buffers and sets; [`upload`](Self::upload) fills them.
    pub(super) fn new(
        device: &Arc<Device>,
        mesh: &Arc<MeshBuffers>,
        kernels: (Arc<AnimationKernel>, Arc<BlocksKernel>),
        clips: Clips,
        desc: &CrowdDesc,
        poses: &Buffer,
    ) -> Result<Self> {
        let (layout, (kernel, update)) = (&mesh.layout, kernels);
        let Some(index) = &layout.blocks else { unreachable!("Clips::new has looked") };
        let (grid, slots) = (index.exact()?, desc.update.slots);
        let groups = Groups::new(device, layout, index, desc)?;
        let mut push = AnimationPush {
            heads: desc.instances,
            targets: layout.targets.len() as u32,
            words: (layout.targets.len() as u32).div_ceil(32).max(1),
            blocks: index.count() as u32,
            entries: index.entry_count() as u32,
            history_mask: ((1u64 << (slots - 1)) - 1) as u32,
            slots,
            always_rebuild: u32::from(desc.update.mode == UpdateMode::Rebuild),
            capacity: groups.capacity as u32,
            rows_at: ((WIDTHS * TILE_WORDS) as u64 * groups.capacity) as u32,
            counters: groups.counters(),
            chunks: groups.chunks,
            chunk_items: device.caps.max_workgroups,
            ..AnimationPush::default()
        };
        let budget = Budget::new(desc.update.error_budget, index)?;
        let words = tables(&clips, budget.as_ref(), index, &mut push);
        let state_bytes = 4 * state_words(&mut push);
        let control_bytes = groups.arguments(groups.count(), 0, 0);
        let table_bytes = 4 * words.len() as u64; // never 0: there is a first entry
        for (what, bytes, remedy) in [
            ("clips and tables", table_bytes, "use 16-bit keys, fewer frames, or several crowds"),
            ("the weights and histories of all instances", state_bytes, "make several crowds"),
            ("the arguments of all dispatches", control_bytes, "make several crowds"),
        ] {
            let (caps, name) = (&device.caps, &layout.name);
            if bytes > caps.max_storage_range {
                let text = format!(
                    "{what} of mesh '{name}' take {bytes} bytes, {} allows {}",
                    caps.name, caps.max_storage_range
                );
                return Err(Error::invalid(text, remedy));
            }
        }

        use vk::BufferUsageFlags as U;
        let buffer = |name, bytes, usage, location| Buffer::new(device, &BufferDesc { name, bytes, usage, location });
        let on_device = |name, bytes, usage| {
            let usage = usage | U::STORAGE_BUFFER | U::TRANSFER_SRC | U::TRANSFER_DST;
            buffer(name, bytes, usage, MemoryLocation::GpuOnly)
        };
        let pose = layout.pose_bytes();
        let tables = on_device("deltamorph clips", table_bytes, U::empty())?;
        let state = on_device("deltamorph animated weights", state_bytes, U::empty())?;
        let work = on_device("deltamorph planned work", groups.stride * u64::from(groups.count()), LIST_USAGE)?;
        let control = on_device("deltamorph dispatches", control_bytes, U::INDIRECT_BUFFER)?;
        let sums = sums_buffer(device, pose * u64::from(desc.instances))?;
        let mut staging = buffer("deltamorph clip upload", table_bytes, U::TRANSFER_SRC, STAGING)?;
        staging.mapped()?[..table_bytes as usize].copy_from_slice(bytemuck::cast_slice(&words));

        let whole = |buffer: &Buffer, size| BufferRange { buffer: buffer.raw, offset: 0, size };
        let all = |f: &mut dyn FnMut(u32)| (0..groups.count()).for_each(f);
        let (mut plan, mut blocks) = (vec![], vec![]);
        all(&mut |group| {
            let (first, count) = groups.get(group);
            let part = |buffer: &Buffer, first: u32, count: u32, each: u64| BufferRange {
                buffer: buffer.raw,
                offset: u64::from(first) * each,
                size: u64::from(count) * each,
            };
            let list = part(&work, group, 1, groups.stride);
            plan.push([whole(&tables, table_bytes), whole(&state, state_bytes), list, whole(&control, control_bytes)]);
            blocks.push(GroupBuffers {
                asset: whole(&mesh.deltas, asset_bytes(layout)),
                list,
                poses: part(poses, first, count, pose * u64::from(slots)),
                sums: Some(part(&sums, first, count, pose)),
            });
        });
        let block_push = blocks_push(layout, index, slots, Some(grid));
        Ok(Self {
            sets: kernel.sets(&plan)?,
            block_sets: update.sets(&blocks)?,
            heads: Heads::new(desc.instances),
            list: CommandList::new(desc.update.path),
            staging: Some(staging),
            tables,
            kernel,
            update,
            clips,
            state,
            work,
            control,
            sums,
            groups,
            push,
            block_push,
        })
    }

    /// Record the upload of clips and tables, and fill what kernels keep with zeros.
    ///
    /// # Safety
    /// As [`super::MorphEngine::create_animated_crowd`].
    pub(super) unsafe fn upload(&self, device: &Device, cmd: vk::CommandBuffer) {
        let Some(staging) = &self.staging else { return };
        let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: self.table_bytes() }];
        // SAFETY: the caller's obligations; the region lies within both buffers, and fills cover whole buffers.
        unsafe {
            device.raw.cmd_copy_buffer(cmd, staging.raw, self.tables.raw, &region);
            for buffer in [&self.state, &self.control] {
                device.raw.cmd_fill_buffer(cmd, buffer.raw, 0, vk::WHOLE_SIZE, 0);
            }
            barriers::record(&device.raw, cmd, Hazard::TransferWriteToComputeUpdate);
        }
    }

    /// Plan what the CPU plans: slots, and which records are sent.
    pub(super) fn plan(&mut self) -> UpdateStats {
        let (update, slots) = (self.heads.update(&self.clips), u64::from(self.push.slots));
        self.push.now = self.heads.now();
        self.push.source = ((update + slots - 1) % slots) as u32;
        self.push.destination = (update % slots) as u32;
        self.list.fill_animated(AnimatedUpdate {
            records: !self.heads.changed().is_empty(),
            budget: self.push.budget_at != 0,
            instances: self.groups.instances,
            source: self.push.source,
            destination: self.push.destination,
        });
        UpdateStats { passes: 1, ..UpdateStats::default() }
    }

    /// Write the planned commands.
    ///
    /// # Safety
    /// As [`super::MorphEngine::record_update`].
    pub(super) unsafe fn record(&self, device: &Device, cmd: vk::CommandBuffer) {
        for command in &self.list.commands {
            // SAFETY: the caller's obligations.
            unsafe {
                match command {
                    Command::Barrier(hazard) => barriers::record(&device.raw, cmd, *hazard),
                    Command::Animated(step) => self.step(device, cmd, *step),
                    Command::Pass(_) | Command::Blocks(_) | Command::Scatter(_) => {}
                }
            }
        }
    }

    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn step(&self, device: &Device, cmd: vk::CommandBuffer, step: AnimatedCommand) {
        let (kernel, first) = (&self.kernel, self.sets.get(0));
        let words = u64::from(self.push.heads) * u64::from(self.push.words);
        let blocks = self.push.blocks.div_ceil(WORKGROUP);
        // SAFETY: the caller's obligations; sets and push constants were made for these buffers, updates of records lie
        // within the state and are no larger than Vulkan allows, and workgroups no more than the device does.
        unsafe {
            match step {
                AnimatedCommand::Records => {
                    for run in self.heads.changed() {
                        let mut at = run.start as usize;
                        for records in self.heads.records()[at..run.end as usize].chunks(RECORDS_MAX) {
                            let (offset, data) = (at * size_of::<HeadRecord>(), bytemuck::cast_slice(records));
                            device.raw.cmd_update_buffer(cmd, self.state.raw, offset as u64, data);
                            at += records.len();
                        }
                    }
                }
                AnimatedCommand::Sample => {
                    kernel.bind(cmd, Step::Sample);
                    kernel.dispatch(cmd, first, &self.push, kernel.groups(words));
                }
                AnimatedCommand::Budget => {
                    kernel.bind(cmd, Step::Budget);
                    let heads = self.push.heads.min(device.caps.max_workgroups);
                    kernel.dispatch(cmd, first, &self.push, [blocks, heads]);
                }
                AnimatedCommand::Commit => {
                    kernel.bind(cmd, Step::Commit);
                    kernel.dispatch(cmd, first, &self.push, kernel.groups(words));
                }
                AnimatedCommand::Plan => {
                    kernel.bind(cmd, Step::Plan);
                    for group in 0..self.groups.count() {
                        let (first_head, group_heads) = self.groups.get(group);
                        let first_counter = group * WIDTHS as u32;
                        let push = AnimationPush { first_head, group_heads, first_counter, ..self.push };
                        let tiles = group_heads.div_ceil(device.caps.tuning.widest_tile);
                        kernel.dispatch(cmd, self.sets.get(group as usize), &push, [blocks, tiles]);
                    }
                }
                AnimatedCommand::Arguments => {
                    kernel.bind(cmd, Step::Arguments);
                    kernel.dispatch(cmd, first, &self.push, [1, 1]);
                }
                AnimatedCommand::Blocks { .. } => self.update_blocks(cmd),
            }
        }
    }

    /// Dispatch the work list: as many workgroups as the GPU has planned.
    ///
    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn update_blocks(&self, cmd: vk::CommandBuffer) {
        for group in 0..self.groups.count() {
            let set = self.block_sets.get(group as usize);
            // SAFETY: the caller's obligations; the set was written for this mesh and crowd.
            unsafe { self.update.bind_indirect(cmd, set) };
            for width in 0..self.update.widths() {
                for chunk in 0..self.groups.chunks {
                    let first = u64::from(chunk) * u64::from(self.push.chunk_items);
                    let item = (width as u64 * self.groups.capacity + first) * TILE_WORDS as u64;
                    let push = BlocksPush { first_item: item as u32, ..self.block_push };
                    let offset = self.groups.arguments(group, width, chunk);
                    // SAFETY: as above; the arguments lie within the buffer, which is one of arguments.
                    unsafe { self.update.dispatch_indirect(cmd, width, push, self.control.raw, offset) };
                }
            }
        }
    }

    fn table_bytes(&self) -> u64 {
        4 * u64::from(self.push.entries_at) + 8 * u64::from(self.push.entries)
    }

    /// The slots of an instance's pose and of the one before; `None` while it has none.
    pub(super) fn slots_of(&self, instance: u32) -> Option<(u32, Option<u32>)> {
        let (update, has_past) = self.heads.written(instance)?;
        let slots = u64::from(self.push.slots);
        let slot = (update % slots) as u32;
        let before = ((update + slots - 1) % slots) as u32;
        Some((slot, if !has_past { Some(slot) } else { (slots > 1).then_some(before) }))
    }
}
