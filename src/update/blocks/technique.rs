//! A crowd on path `blocks`, planned on the CPU.

use super::dispatch::{Dispatches, KERNELS, Tiles};
use super::gpu::{BlocksKernels, Bound, GroupBlocks, LIST_USAGE, set_size};
use super::group::{GroupPlan, Item, WorkList};
use super::plan::Planner;
use crate::abi::worklist::{self, TILE_WORDS};
use crate::error::Result;
use crate::gpu::memory::Ring;
use crate::gpu::pipelines::Workgroups;
use crate::plan::UpdateStats;
use crate::plan::instances::{InstanceState, Instances};
use crate::plan::steps::{Steps, Work};
use crate::update::technique::{Context, Technique, UpdateId};
use ash::vk;

/// A crowd on path `blocks`.
pub struct BlocksTechnique {
    planner: Planner,
    groups: Vec<Group>,
}

struct Group {
    blocks: GroupBlocks,
    dispatches: Dispatches,
    /// Work lists: tiles, then rows. Descriptor sets of `blocks`: `[frame][instances]`.
    ring: Ring,
    sets_of_frame: u32,
    /// First word of the rows.
    rows_at: usize,
}

impl BlocksTechnique {
    pub(crate) fn new(context: Context<'_>) -> Result<Self> {
        let desc = context.desc;
        let layouts = context.groups().map(|group| group.layout());
        let planner = Planner::new(desc.update, layouts, desc.instances as usize)?;
        let groups = (0..).zip(context.groups()).zip(&planner.groups);
        let groups = groups.map(|((number, group), planner)| Group::new(group, number, planner));
        Ok(Self { groups: groups.collect::<Result<_>>()?, planner })
    }

    /// The items of a work of the update planned last.
    pub fn items_of(&self, work: &Work) -> impl Iterator<Item = &Item> {
        let group = work.group as usize;
        self.groups[group].dispatches.items_of(&self.planner.groups[group].list, work)
    }
}

impl Group {
    fn new(context: Context<'_>, number: u32, planner: &GroupPlan) -> Result<Self> {
        let desc = context.desc;
        let instances = desc.instances as usize;
        let reach = set_size(&context, u64::MAX)?;
        let kernels = BlocksKernels::new(&context, desc.instances, reach)?;
        let padding = KERNELS * kernels.how.padding(instances);
        let rows_at = (instances * planner.index.count() + padding) * TILE_WORDS;
        let row_words = Tiles::words_max(&planner.index, instances);
        let part = Ring::part_bytes(4 * (rows_at + row_words) as u64);
        context.check_range(&format!("the work lists of {instances} instances"), part, "make several crowds")?;
        let ring = Ring::new(context.device, "deltamorph work lists", part, desc.frames_in_flight, LIST_USAGE)?;
        let mut bound = vec![];
        for frame in 0..desc.frames_in_flight {
            for first in (0..desc.instances).step_by(reach as usize) {
                let list = ring.range(frame.into());
                let instances = (first, reach.min(desc.instances - first));
                bound.push(Bound { list, instances });
            }
        }
        Ok(Self {
            dispatches: Dispatches::new(kernels.how, number, planner, instances),
            blocks: GroupBlocks::new(&context, kernels, &bound)?,
            ring,
            sets_of_frame: desc.instances.div_ceil(reach),
            rows_at,
        })
    }

    fn write(&mut self, list: &WorkList, frame: u64) -> Result<()> {
        let (items, rest) = self.ring.words(frame)?.split_at_mut(self.rows_at);
        // Pose numbers are relative to the first instance of a set.
        let reach = self.blocks.how.group;
        let slots = self.blocks.poses.slots;
        let poses = |item: &Item| {
            let first = item.instance % reach * slots;
            worklist::poses(first + item.source.unwrap_or(item.destination), first + item.destination)
        };
        let tiles = &self.dispatches.tiles;
        rest[..tiles.rows.len()].copy_from_slice(&tiles.rows);
        for ((width, tile), out) in tiles.iter().zip(items.chunks_exact_mut(TILE_WORDS)) {
            let head = [tile.block, self.rows_at as u32 + tile.first, tile.count, tile.rebuilt];
            let items = tile.members(width).iter().map(|&i| &list.items[i as usize]);
            worklist::write_tile(out, head, items.map(poses));
        }
        Ok(())
    }
}

impl Technique for BlocksTechnique {
    fn state(&mut self) -> &mut dyn InstanceState {
        &mut self.planner
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
        let first_item = (group.dispatches.place(work) * TILE_WORDS) as u32;
        let set = (frame * u64::from(group.sets_of_frame)) as usize + work.instance as usize;
        let workgroups = Workgroups::Of([work.items.len() as u32 / group.blocks.how.items, 1]);
        // SAFETY: the caller's obligations; the list was written for this mesh and crowd.
        unsafe { group.blocks.dispatch(cmd, set, work.kernel as usize, first_item, workgroups) };
    }
}
