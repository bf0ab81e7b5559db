//! A crowd on the path `blocks`, planned on the CPU: work lists, integer sums, and what each block holds.

use super::dispatch::Dispatches;
use super::gpu::{BlocksKernels, Workgroups};
use super::group::GroupPlan;
use super::list::{ELEMENT_BYTES, ITEM_WORDS, Item, WorkList};
use super::plan::Planner;
use super::shared::{LIST_USAGE, blocks_push, group_size, sums_buffer};
use super::tiles::{TILE_WORDS, Tiles};
use crate::abi::push::BlocksPush;
use crate::abi::worklist;
use crate::error::Result;
use crate::gpu::descriptors::Sets;
use crate::gpu::memory::Buffer;
use crate::gpu::ring::Ring;
use crate::pack::POSE_FLOATS;
use crate::pack::blocks::ExactGrid;
use crate::plan::UpdateStats;
use crate::plan::instances::Instances;
use crate::plan::steps::{Steps, Work};
use crate::update::technique::{Context, Poses, Technique, UpdateId};
use ash::vk;

/// A crowd whose changed blocks are updated.
pub(crate) struct BlocksTechnique {
    planner: Planner,
    groups: Vec<GroupBlocks>,
}

/// What the blocks of a group take.
struct GroupBlocks {
    kernels: BlocksKernels,
    poses: Poses,
    dispatches: Dispatches,
    /// Work lists: items, then elements; or tiles, then rows.
    ring: Ring,
    /// Words of an item or tile.
    item_words: usize,
    /// Index of the first element's or row's first word.
    elements_at: usize,
    #[cfg_attr(not(feature = "headless"), allow(dead_code, reason = "read back by headless alone"))]
    sums: Option<Buffer>,
    /// For each frame in flight, one for each set of instances.
    sets: Sets,
    sets_of_frame: u32,
    /// Instances that a set reaches.
    reach: u32,
    push: BlocksPush,
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
    fn new(context: Context<'_>, number: u32, planner: &mut GroupPlan) -> Result<Self> {
        let (device, desc, layout, poses) = (context.device, context.desc, context.layout(), context.poses);
        let (index, grid, instances) = (&planner.index, planner.exact(), desc.instances as usize);
        let exact = grid.is_some();
        let kernels = BlocksKernels::new(&context, index, exact, desc.instances)?;
        let reach = group_size(&context, u64::MAX)?;
        let how = kernels.dispatching(reach);
        planner.whole_blocks = how.widths > 0;
        let (item_words, element_words) = match planner.whole_blocks {
            true => (TILE_WORDS, Tiles::words_max(index, instances)),
            false => {
                (ITEM_WORDS + POSE_FLOATS * index.mask_words(), instances * index.entry_count() * ELEMENT_BYTES / 4)
            }
        };
        let elements_at = instances * index.count() * item_words;
        let part = Ring::part_bytes(4 * (elements_at + element_words) as u64);
        context.check_range(&format!("the work lists of {instances} instances"), part, "make several crowds")?;
        let ring = Ring::new(device, "deltamorph work lists", part, desc.frames_in_flight, LIST_USAGE)?;
        let sums = grid.map(|_| sums_buffer(device, &poses, desc.instances)).transpose()?;
        let lists = (0..desc.frames_in_flight).flat_map(|frame| {
            let list = ring.range(frame.into());
            (0..desc.instances)
                .step_by(reach as usize)
                .map(move |first| (list, first, reach.min(desc.instances - first)))
        });
        let sets = kernels.sets(&context, sums.as_ref(), &lists.collect::<Vec<_>>())?;
        let push = BlocksPush { elements_at: elements_at as u32, ..blocks_push(layout, index, poses.slots, grid) };
        Ok(Self {
            dispatches: Dispatches::new(how, number, index, instances, exact),
            kernels,
            poses,
            ring,
            item_words,
            elements_at,
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
        // Source and destination of an item, as numbers of poses in a set of instances.
        let (reach, slots) = (self.reach, self.poses.slots);
        let pose = |item: &Item, slot: u32| item.instance % reach * slots + slot;
        let poses = |item: &Item| {
            worklist::poses(pose(item, item.source.unwrap_or(item.destination)), pose(item, item.destination))
        };
        if let Some(tiles) = &self.dispatches.tiles {
            rest[..tiles.rows.len()].copy_from_slice(&tiles.rows);
            for ((width, tile), out) in tiles.iter().zip(items) {
                let head = [tile.block, self.elements_at as u32 + tile.first, tile.count, tile.rebuilt];
                let items = tile.items.iter().take(1 << width).map(|&i| &list.items[i as usize]);
                worklist::write_tile(out, head, items.map(poses));
            }
            return Ok(());
        }
        for ((item, masks), out) in
            list.items.iter().zip(list.masks.chunks_exact(self.item_words - ITEM_WORDS)).zip(items)
        {
            let words = worklist::item(item.block, item.source.is_none(), poses(item), item.first, item.count);
            out[..ITEM_WORDS].copy_from_slice(&words);
            out[ITEM_WORDS..].copy_from_slice(masks);
            let (first, count) = (2 * item.first as usize, 2 * item.count as usize);
            rest[first..first + count].copy_from_slice(bytemuck::cast_slice(list.elements_of(item)));
        }
        Ok(())
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
        unsafe { group.kernels.dispatch(cmd, set, work.kernel, &push, workgroups) };
    }

    fn exact(&self) -> Option<ExactGrid> {
        self.planner.exact()
    }

    fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        let GroupBlocks { sums, poses, .. } = &self.groups[0];
        sums.as_ref().map(|sums| (sums.raw, poses.sums(sums.raw).offset(instance, 0)))
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
