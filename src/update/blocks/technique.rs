//! A crowd on the path `blocks`, planned on the CPU: work lists, integer sums, and what each block holds.

use super::gpu::{BlocksKernel, BlocksKey, GroupBuffers, Workgroups};
use super::list::{ELEMENT_BYTES, ITEM_WORDS, Item};
use super::plan::{Dispatches, Planner};
use super::shared::{LIST_USAGE, asset_range, blocks_push, group_size, sums_buffer};
use super::state::BlockState;
use super::tiles::{TILE_WORDS, Tiles};
use crate::abi::push::BlocksPush;
use crate::abi::worklist;
use crate::error::{Error, Result};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Buffer;
use crate::gpu::ring::Ring;
use crate::pack::POSE_FLOATS;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::plan::instances::Instances;
use crate::plan::steps::{Steps, Work};
use crate::plan::{Accumulate, UpdateStats};
use crate::update::technique::{Context, Poses, Technique, UpdateId};
use ash::vk;
use std::sync::Arc;

/// A crowd whose changed blocks are updated.
pub(crate) struct BlocksTechnique {
    kernel: Arc<BlocksKernel>,
    poses: Poses,
    planner: Planner,
    dispatches: Dispatches,
    /// Work lists: items, then elements; or tiles, then rows.
    ring: Ring,
    /// Index of the first element's or row's first word.
    elements_at: usize,
    #[cfg_attr(not(feature = "headless"), allow(dead_code, reason = "read back by headless alone"))]
    sums: Option<Buffer>,
    /// For each frame in flight, one for each group of instances.
    sets: Sets,
    groups: u32,
    /// Instances of a group.
    group: u32,
    push: BlocksPush,
}

/// Sizes of a work list of items and elements: words before the elements, and bytes in all.
fn item_list_size(index: &BlockIndex, instances: u32) -> (u64, u64) {
    let item = (ITEM_WORDS + POSE_FLOATS * index.mask_words()) as u64;
    let elements = u64::from(instances) * (index.entry_count() * ELEMENT_BYTES) as u64;
    list_size(u64::from(instances) * index.count() as u64 * item, elements)
}

/// Sizes of a work list of tiles and rows.
fn tile_list_size(index: &BlockIndex, instances: u32) -> (u64, u64) {
    let tiles = u64::from(instances) * index.count() as u64;
    list_size(tiles * TILE_WORDS as u64, 4 * Tiles::words_max(index, instances as usize) as u64)
}

fn list_size(item_words: u64, element_bytes: u64) -> (u64, u64) {
    (item_words, Ring::part_bytes(4 * item_words + element_bytes))
}

impl BlocksTechnique {
    pub(crate) fn new(context: Context<'_>) -> Result<Self> {
        let (device, desc, layout, poses) = (context.device, context.desc, context.layout(), context.poses);
        let Some(index) = &layout.blocks else {
            let text = format!("mesh '{}' has no blocks", layout.name);
            return Err(Error::invalid(text, "pack it in a block format, such as 'fast'"));
        };
        let exact = desc.update.accumulate == Accumulate::Exact;
        let kernel = context.kernels.get::<BlocksKernel>(BlocksKey::new(&context, index, exact, desc.instances)?)?;
        let tiled = kernel.dispatching(0).widths > 0;
        let mut state = BlockState::new(desc.update, layout, index)?;
        if tiled {
            state.write_whole_blocks();
        }
        let grid = state.exact();
        let group = group_size(&context, u64::MAX)?;
        let (elements_at, part) = match tiled {
            true => tile_list_size(index, desc.instances),
            false => item_list_size(index, desc.instances),
        };
        context.check_range(&format!("the work lists of {} instances", desc.instances), part, "make several crowds")?;
        let ring = Ring::new(device, "deltamorph work lists", part, desc.frames_in_flight, LIST_USAGE)?;
        let sums = grid.map(|_| sums_buffer(device, poses.bytes * u64::from(desc.instances))).transpose()?;
        let firsts = (0..desc.instances).step_by(group as usize);
        let buffers = |frame: u32, first: u32| {
            let count = group.min(desc.instances - first);
            let of_sums = |buffer: &Buffer| BufferRange {
                buffer: buffer.raw,
                offset: u64::from(first) * poses.bytes,
                size: u64::from(count) * poses.bytes,
            };
            GroupBuffers {
                asset: asset_range(&context),
                list: ring.range(frame.into()),
                poses: poses.range(first, count),
                sums: sums.as_ref().map(of_sums),
            }
        };
        let frames = 0..desc.frames_in_flight;
        let all = frames.flat_map(|frame| firsts.clone().map(move |first| (frame, first)));
        let groups: Vec<GroupBuffers> = all.map(|(frame, first)| buffers(frame, first)).collect();
        let sets = kernel.sets(&groups)?;
        let push = BlocksPush { elements_at: elements_at as u32, ..blocks_push(layout, index, poses.slots, grid) };
        let (how, instances) = (kernel.dispatching(group), desc.instances as usize);
        Ok(Self {
            dispatches: Dispatches::new(how, index, instances, exact),
            kernel,
            poses,
            planner: Planner::new(index, state, instances),
            ring,
            elements_at: elements_at as usize,
            sums,
            sets,
            groups: desc.instances.div_ceil(group),
            group,
            push,
        })
    }

    /// Write items and their elements.
    fn write_items(&mut self, frame: u64) -> Result<()> {
        let (list, mask_words) = (&self.planner.list, POSE_FLOATS * self.planner.index.mask_words());
        let (items, elements) = self.ring.words(frame)?.split_at_mut(self.elements_at);
        let outs = items.chunks_exact_mut(ITEM_WORDS + mask_words);
        for ((item, masks), out) in list.items.iter().zip(list.masks.chunks_exact(mask_words)).zip(outs) {
            let poses = item_poses(item, self.group, self.poses.slots);
            let words = worklist::item(item.block, item.source.is_none(), poses, item.first, item.count);
            out[..ITEM_WORDS].copy_from_slice(&words);
            out[ITEM_WORDS..].copy_from_slice(masks);
            let (first, count) = (2 * item.first as usize, 2 * item.count as usize);
            let listed: &[u32] = bytemuck::cast_slice(list.elements_of(item));
            elements[first..first + count].copy_from_slice(listed);
        }
        Ok(())
    }

    /// Write tiles and their rows.
    fn write_tiles(&mut self, frame: u64) -> Result<()> {
        let (Some(tiles), list) = (&self.dispatches.tiles, &self.planner.list) else { return Ok(()) };
        let (items, rows) = self.ring.words(frame)?.split_at_mut(self.elements_at);
        rows[..tiles.rows.len()].copy_from_slice(&tiles.rows);
        let sized = tiles.items.iter().flat_map(|widths| widths.iter().enumerate());
        let sized = sized.flat_map(|(width, tiles)| tiles.iter().map(move |tile| (width, tile)));
        for ((width, tile), out) in sized.zip(items.chunks_exact_mut(TILE_WORDS)) {
            let head = [tile.block, self.elements_at as u32 + tile.first, tile.count, tile.rebuilt];
            let items = tile.items.iter().take(1 << width).map(|&i| &list.items[i as usize]);
            worklist::write_tile(out, head, items.map(|item| item_poses(item, self.group, self.poses.slots)));
        }
        Ok(())
    }
}

impl Technique for BlocksTechnique {
    fn plan(&mut self, instances: &Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        let mut stats = self.planner.plan(instances, id.update);
        self.dispatches.fill(&self.planner.index, &self.planner.list, steps, &mut stats);
        match self.dispatches.tiles {
            _ if steps.is_empty() => {}
            Some(_) => self.write_tiles(id.frame)?,
            None => self.write_items(id.frame)?,
        }
        Ok(stats)
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work) {
        let item_words = match self.dispatches.tiles {
            Some(_) => TILE_WORDS,
            None => ITEM_WORDS + POSE_FLOATS * self.planner.index.mask_words(),
        };
        let first_item = (self.dispatches.place(work) * item_words) as u32;
        let push = BlocksPush { first_item, ..self.push };
        let set = self.sets.get((frame * u64::from(self.groups)) as usize + work.instance as usize);
        let workgroups = Workgroups::Of(work.items.end - work.items.start);
        // SAFETY: the caller's obligations; set and list were written for this mesh and crowd.
        unsafe { self.kernel.dispatch(cmd, set, work.kernel, &push, workgroups) };
    }

    fn slots_of(&self, instance: u32) -> Option<(u32, Option<u32>)> {
        self.planner.slots_of(instance as usize)
    }

    fn cut(&mut self, instance: u32) {
        self.planner.cut(instance as usize);
    }

    fn add(&mut self, instance: u32) {
        self.planner.forget(instance as usize);
    }

    fn discard_from(&mut self, id: UpdateId) {
        self.planner.discard_from(id.update);
    }

    fn exact(&self) -> Option<ExactGrid> {
        self.planner.exact()
    }

    fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        self.sums.as_ref().map(|sums| (sums.raw, u64::from(instance) * self.poses.bytes))
    }

    #[cfg(any(test, feature = "internals"))]
    fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        self.dispatches.accesses(&self.planner.list, works)
    }
}

/// Source and destination of an item, as numbers of poses in a group of instances.
fn item_poses(item: &Item, group: u32, slots: u32) -> u32 {
    let pose = |slot: u32| item.instance % group * slots + slot;
    worklist::poses(pose(item.source.unwrap_or(item.destination)), pose(item.destination))
}
