//! A crowd on the path `blocks`, planned on the CPU: work lists, integer sums, and what each block holds.

use super::gpu::{BlocksKernel, BlocksKey, GroupBuffers, Workgroups};
use super::list::{ELEMENT_BYTES, ITEM_WORDS, Item, WorkList};
use super::plan::{Dispatches, GroupPlanner, Planner};
use super::shared::{LIST_USAGE, asset_range, blocks_push, group_size, sums_buffer};
use super::tiles::{TILE_WORDS, Tiles};
use crate::abi::push::BlocksPush;
use crate::abi::worklist;
use crate::error::Result;
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
use std::slice::ChunksExactMut;
use std::sync::Arc;

/// A crowd whose changed blocks are updated.
pub(crate) struct BlocksTechnique {
    planner: Planner,
    groups: Vec<GroupBlocks>,
}

/// What the blocks of a group take.
struct GroupBlocks {
    kernel: Arc<BlocksKernel>,
    poses: Poses,
    dispatches: Dispatches,
    /// Work lists: items, then elements; or tiles, then rows.
    ring: Ring,
    /// Index of the first element's or row's first word.
    elements_at: usize,
    item_words: usize,
    #[cfg_attr(not(feature = "headless"), allow(dead_code, reason = "read back by headless alone"))]
    sums: Option<Buffer>,
    /// For each frame in flight, one for each set of instances.
    sets: Sets,
    sets_of_frame: u32,
    /// Instances that a set reaches.
    reach: u32,
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
        let (desc, layouts) = (context.desc, context.groups().map(|group| group.layout()));
        let mut planner = Planner::new(desc.update, layouts, desc.instances as usize)?;
        let groups = (0..).zip(context.groups()).zip(&mut planner.groups);
        let groups = groups.map(|((number, group), planner)| GroupBlocks::new(group, number, planner));
        Ok(Self { groups: groups.collect::<Result<_>>()?, planner })
    }
}

impl GroupBlocks {
    fn new(context: Context<'_>, number: u32, planner: &mut GroupPlanner) -> Result<Self> {
        let (device, desc, layout, poses) = (context.device, context.desc, context.layout(), context.poses);
        let (index, grid) = (&planner.index.clone(), planner.exact());
        let exact = desc.update.accumulate == Accumulate::Exact;
        let kernel = context.kernels.get::<BlocksKernel>(BlocksKey::new(&context, index, exact, desc.instances)?)?;
        let tiled = kernel.dispatching(0).widths > 0;
        if tiled {
            planner.write_whole_blocks();
        }
        let reach = group_size(&context, u64::MAX)?;
        let (elements_at, part) = match tiled {
            true => tile_list_size(index, desc.instances),
            false => item_list_size(index, desc.instances),
        };
        context.check_range(&format!("the work lists of {} instances", desc.instances), part, "make several crowds")?;
        let ring = Ring::new(device, "deltamorph work lists", part, desc.frames_in_flight, LIST_USAGE)?;
        let sums = grid.map(|_| sums_buffer(device, poses.bytes * u64::from(desc.instances))).transpose()?;
        let firsts = (0..desc.instances).step_by(reach as usize);
        let buffers = |frame: u32, first: u32| {
            let count = reach.min(desc.instances - first);
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
        let all: Vec<GroupBuffers> = all.map(|(frame, first)| buffers(frame, first)).collect();
        let sets = kernel.sets(&all)?;
        let push = BlocksPush { elements_at: elements_at as u32, ..blocks_push(layout, index, poses.slots, grid) };
        let (how, instances) = (kernel.dispatching(reach), desc.instances as usize);
        Ok(Self {
            dispatches: Dispatches::new(how, number, index, instances, exact),
            kernel,
            poses,
            ring,
            elements_at: elements_at as usize,
            item_words: if tiled { TILE_WORDS } else { ITEM_WORDS + POSE_FLOATS * index.mask_words() },
            sums,
            sets,
            sets_of_frame: desc.instances.div_ceil(reach),
            reach,
            push,
        })
    }

    /// Write the lists of what was planned.
    fn write(&mut self, list: &WorkList, frame: u64) -> Result<()> {
        let (items, rest) = self.ring.words(frame)?.split_at_mut(self.elements_at);
        let items = items.chunks_exact_mut(self.item_words);
        let poses = |item: &Item| item_poses(item, self.reach, self.poses.slots);
        match &self.dispatches.tiles {
            Some(tiles) => write_tiles(tiles, list, poses, (items, self.elements_at, rest)),
            None => write_items(list, poses, (items, rest)),
        }
        Ok(())
    }
}

/// Write items and their elements.
fn write_items(
    list: &WorkList,
    poses: impl Fn(&Item) -> u32,
    (items, elements): (ChunksExactMut<'_, u32>, &mut [u32]),
) {
    let mask_words = list.masks.len() / list.items.len().max(1);
    for ((item, masks), out) in list.items.iter().zip(list.masks.chunks_exact(mask_words)).zip(items) {
        let words = worklist::item(item.block, item.source.is_none(), poses(item), item.first, item.count);
        out[..ITEM_WORDS].copy_from_slice(&words);
        out[ITEM_WORDS..].copy_from_slice(masks);
        let (first, count) = (2 * item.first as usize, 2 * item.count as usize);
        let listed: &[u32] = bytemuck::cast_slice(list.elements_of(item));
        elements[first..first + count].copy_from_slice(listed);
    }
}

/// Write tiles and their rows, which begin at a word of the list.
fn write_tiles(
    tiles: &Tiles,
    list: &WorkList,
    poses: impl Fn(&Item) -> u32,
    (items, rows_at, rows): (ChunksExactMut<'_, u32>, usize, &mut [u32]),
) {
    rows[..tiles.rows.len()].copy_from_slice(&tiles.rows);
    let sized = tiles.items.iter().flat_map(|widths| widths.iter().enumerate());
    let sized = sized.flat_map(|(width, tiles)| tiles.iter().map(move |tile| (width, tile)));
    for ((width, tile), out) in sized.zip(items) {
        let head = [tile.block, rows_at as u32 + tile.first, tile.count, tile.rebuilt];
        let items = tile.items.iter().take(1 << width).map(|&i| &list.items[i as usize]);
        worklist::write_tile(out, head, items.map(&poses));
    }
}

impl Technique for BlocksTechnique {
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        self.planner.plan(instances, id.update);
        for (group, planner) in self.groups.iter_mut().zip(&mut self.planner.groups) {
            if group.dispatches.fill(&planner.index, &planner.list, &mut planner.stats) {
                group.write(&planner.list, id.frame)?;
            }
        }
        Dispatches::append(self.groups.iter().map(|group| &group.dispatches), steps);
        Ok(self.planner.stats())
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work) {
        let group = &self.groups[work.group as usize];
        let first_item = (group.dispatches.place(work) * group.item_words) as u32;
        let push = BlocksPush { first_item, ..group.push };
        let set = group.sets.get((frame * u64::from(group.sets_of_frame)) as usize + work.instance as usize);
        let workgroups = Workgroups::Of(work.items.end - work.items.start);
        // SAFETY: the caller's obligations; set and list were written for this mesh and crowd.
        unsafe { group.kernel.dispatch(cmd, set, work.kernel, &push, workgroups) };
    }

    fn exact(&self) -> Option<ExactGrid> {
        self.planner.exact()
    }

    fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        let GroupBlocks { sums, poses, .. } = &self.groups[0];
        sums.as_ref().map(|sums| (sums.raw, u64::from(instance) * poses.bytes))
    }

    #[cfg(any(test, feature = "internals"))]
    fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        let of = |works: &[Work]| {
            let group = works[0].group as usize;
            self.groups[group].dispatches.accesses(&self.planner.groups[group].list, works)
        };
        works.chunk_by(|a, b| a.group == b.group).map(of).collect()
    }
}

/// Source and destination of an item, as numbers of poses in a set of instances.
fn item_poses(item: &Item, reach: u32, slots: u32) -> u32 {
    let pose = |slot: u32| item.instance % reach * slots + slot;
    worklist::poses(pose(item.source.unwrap_or(item.destination)), pose(item.destination))
}
