//! A crowd on path `blocks`, planned on the CPU.

use super::dispatch::{BlockPart, Dispatches, KERNELS, Tiles};
use super::gpu::{BlocksKernels, Bound, GroupBlocks, LIST_USAGE, set_size};
use super::group::{GroupPlan, Item, PoseSlot, WorkList};
use super::plan::Planner;
use crate::abi::worklist::{self, ELEMENT_BYTES, ITEM_WORDS, TILE_WORDS};
use crate::error::{Error, Result};
use crate::gpu::memory::Ring;
use crate::gpu::pipelines::Workgroups;
use crate::pack::POSE_FLOATS;
use crate::plan::UpdateStats;
use crate::plan::instances::Instances;
use crate::plan::steps::{Steps, Work};
use crate::update::technique::{Context, Technique, UpdateId};
use ash::vk;
use std::ops::Range;

pub(crate) struct BlocksTechnique {
    planner: Planner,
    groups: Vec<Group>,
}

struct Group {
    blocks: GroupBlocks,
    dispatches: Dispatches,
    /// Work lists: items, then elements; or tiles, then rows. Descriptor sets of `blocks`: `[frame][instances][part]`.
    ring: Ring,
    sets_of_frame: u32,
    /// Words per item or tile.
    item_words: usize,
    /// First word of the elements or rows.
    elements_at: usize,
}

impl BlocksTechnique {
    pub(crate) fn new(context: Context<'_>) -> Result<Self> {
        let (desc, layouts) = (context.desc, context.groups().map(|group| group.layout()));
        let mut planner = Planner::new(desc.update, layouts, desc.instances as usize)?;
        let groups = (0..).zip(context.groups()).zip(&mut planner.groups);
        let groups = groups.map(|((number, group), planner)| Group::new(group, number, planner));
        Ok(Self { groups: groups.collect::<Result<_>>()?, planner })
    }
}

impl Group {
    fn new(context: Context<'_>, number: u32, planner: &mut GroupPlan) -> Result<Self> {
        let (desc, index, instances) = (context.desc, &planner.index, context.desc.instances as usize);
        let reach = set_size(&context, u64::MAX)?;
        let parts = context.mesh.parts.iter().map(|part| (part.blocks.clone(), part.entries.clone()));
        let parts: Vec<BlockPart> = parts.collect();
        let kernels = BlocksKernels::new(&context, desc.instances, reach)?;
        planner.whole_blocks |= kernels.how.widths > 0;
        let (item_words, element_words) = match planner.whole_blocks {
            true => (TILE_WORDS, Tiles::words_max(index, instances)),
            false => {
                (ITEM_WORDS + POSE_FLOATS * index.mask_words(), instances * index.entry_count() * ELEMENT_BYTES / 4)
            }
        };
        let padding = KERNELS * kernels.how.padding(instances, parts.len());
        let elements_at = (instances * index.count() + padding) * item_words;
        let part = Ring::part_bytes(4 * (elements_at + element_words) as u64);
        context.check_range(&format!("the work lists of {instances} instances"), part, "make several crowds")?;
        let ring = Ring::new(context.device, "deltamorph work lists", part, desc.frames_in_flight, LIST_USAGE)?;
        let mut bound = vec![];
        for frame in 0..desc.frames_in_flight {
            for first in (0..desc.instances).step_by(reach as usize) {
                let (list, instances) = (ring.range(frame.into()), (first, reach.min(desc.instances - first)));
                bound.extend((0..parts.len()).map(|part| Bound { part, list, instances }));
            }
        }
        Ok(Self {
            dispatches: Dispatches::new(kernels.how, number, planner, instances, parts),
            blocks: GroupBlocks::new(&context, kernels, &bound, elements_at)?,
            ring,
            sets_of_frame: desc.instances.div_ceil(reach),
            item_words,
            elements_at,
        })
    }

    fn write(&mut self, list: &WorkList, frame: u64) -> Result<()> {
        let (items, rest) = self.ring.words(frame)?.split_at_mut(self.elements_at);
        let items = items.chunks_exact_mut(self.item_words);
        // Pose numbers are relative to the first instance of a set.
        let (reach, slots) = (self.blocks.how.group, self.blocks.poses.slots);
        let pose = |PoseSlot { instance, slot }: PoseSlot| instance % reach * slots + slot;
        let poses = |item: &Item| {
            let destination = PoseSlot { instance: item.instance, slot: item.destination };
            worklist::poses(pose(item.source.unwrap_or(destination)), pose(destination))
        };
        if let Some(tiles) = &self.dispatches.tiles {
            rest[..tiles.rows.len()].copy_from_slice(&tiles.rows);
            for ((width, tile), out) in tiles.iter().zip(items) {
                let head = [tile.block, self.elements_at as u32 + tile.first, tile.count, tile.rebuilt];
                let items = tile.members(width).iter().map(|&i| &list.items[i as usize]);
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
    fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()> {
        self.planner.set_error_budget(instance as usize, budget)
    }

    fn set_base(&mut self, instance: u32, base: Option<u32>) -> Result<()> {
        let reach = self.groups.iter().map(|group| group.blocks.how.group).min().unwrap_or(u32::MAX);
        if let Some(base) = base.filter(|base| base / reach != instance / reach) {
            let what = format!("instance {base} as base of instance {instance}, which no kernel reaches together");
            return Err(Error::invalid(what, format!("use two of the same {reach}, counted from 0")));
        }
        self.planner.set_base(instance, base)
    }

    fn add(&mut self, instance: u32) {
        self.planner.add(instance as usize);
    }

    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        self.planner.plan(instances, id.update);
        for (group, planner) in self.groups.iter_mut().zip(&mut self.planner.groups) {
            if group.dispatches.fill(planner) {
                group.write(&planner.list, id.frame)?;
            }
        }
        Dispatches::append(self.groups.iter().map(|group| &group.dispatches), steps);
        Ok(self.planner.stats())
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work) {
        let group = &self.groups[work.group as usize];
        let first_item = (group.dispatches.place(work) * group.item_words) as u32;
        let (part, kernel) = (work.kernel as usize / KERNELS, work.kernel as usize % KERNELS);
        let list = (frame * u64::from(group.sets_of_frame)) as usize + work.instance as usize;
        let workgroups = Workgroups::Of([group.blocks.how.workgroups(&work.items), 1]);
        // SAFETY: the caller's obligations; the list was written for this mesh and crowd.
        unsafe {
            group.blocks.dispatch(cmd, list * group.dispatches.parts.len() + part, kernel, first_item, workgroups)
        };
    }

    fn changed(&self, _instances: &Instances, _id: UpdateId, instance: u32, out: &mut Vec<Range<u32>>) {
        self.planner.groups[0].changed(instance, out);
    }

    fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        let of = |works: &[Work]| {
            let group = works[0].group as usize;
            self.groups[group].dispatches.accesses(&self.planner.groups[group].list, works)
        };
        works.chunk_by(|a, b| a.group == b.group).map(of).collect()
    }
}
