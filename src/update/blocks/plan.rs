//! The instances of a crowd, planned together, and how a device carries the work list out: in which dispatches.

use super::bound::Scratch;
use super::commit::Frame;
use super::list::WorkList;
use super::state::BlockState;
use super::tiles::{Tiles, WIDTHS};
use crate::abi::kernels::DeviceTuning;
use crate::error::Result;
use crate::pack::PackedLayout;
use crate::pack::blocks::{BlockIndex, ExactGrid};
#[cfg(any(test, feature = "internals"))]
use crate::plan::hazards::{Accesses, Memory, MemoryUse};
use crate::plan::instances::Instances;
use crate::plan::steps::{Resource, Steps, Use, Work};
use crate::plan::{UpdateDesc, UpdateStats};
use std::ops::Range;
use std::sync::Arc;

/// The instances of a crowd, planned together: what GPU and CPU carry out.
pub struct Planner {
    /// One for each group of the mesh.
    pub groups: Vec<GroupPlanner>,
}

/// The plan of a group: what blocks hold and which are written is its own; slots turn with those of all groups.
pub struct GroupPlanner {
    /// What the group was packed into.
    pub index: Arc<BlockIndex>,
    /// What the last update writes.
    pub list: WorkList,
    /// Of the last update.
    pub stats: UpdateStats,
    states: Vec<BlockState>,
    scratch: Scratch,
}

impl Planner {
    /// `instances` of a mesh that was packed like this, group by group.
    ///
    /// # Errors
    /// As [`BlockState::new`]; no blocks.
    pub fn new<'a>(
        desc: UpdateDesc,
        groups: impl IntoIterator<Item = &'a PackedLayout>,
        instances: usize,
    ) -> Result<Self> {
        let group = |layout: &PackedLayout| {
            let index = layout.index()?;
            Ok(GroupPlanner {
                states: vec![BlockState::new(desc, layout, index)?; instances],
                list: WorkList::new(index, instances),
                index: index.clone(),
                stats: UpdateStats::default(),
                scratch: Scratch::default(),
            })
        };
        Ok(Self { groups: groups.into_iter().map(group).collect::<Result<_>>()? })
    }

    /// Plan the update numbered `update` of every instance that is shown.
    pub fn plan(&mut self, instances: &mut Instances, update: u64) {
        for group in &mut self.groups {
            group.list.clear();
            group.stats = UpdateStats::default();
        }
        for (i, weights, history) in instances.shown() {
            let known = history.current().is_some();
            let mut changed = false;
            for GroupPlanner { index, list, states, scratch, .. } in &mut self.groups {
                changed |= states[i].commit(&mut Frame::new(index, i, scratch, list), weights, known);
            }
            let slots = [history.after(0), history.after(1)];
            for GroupPlanner { index, list, stats, states, scratch } in &mut self.groups {
                match changed {
                    true => states[i].emit(&mut Frame::new(index, i, scratch, list), slots, known, stats),
                    false => states[i].stay(stats),
                }
            }
            if changed { history.advance(update, [slots[1]]) } else { history.stay() }
        }
    }

    /// Count the last update. The groups add the same coefficients in the same pass.
    pub fn stats(&self) -> UpdateStats {
        let mut sum = UpdateStats::default();
        for group in &self.groups {
            sum += UpdateStats { coefficients: 0, ..group.stats };
            sum.passes = sum.passes.max(usize::from(!group.list.items.is_empty()));
        }
        UpdateStats { coefficients: self.groups.first().map_or(0, |group| group.stats.coefficients), ..sum }
    }

    /// The grid of exact sums of the first group; that of others may have other steps, and the same largest weight.
    pub fn exact(&self) -> Option<ExactGrid> {
        self.groups.first().and_then(GroupPlanner::exact)
    }
}

impl GroupPlanner {
    /// The grid of exact sums; the same for all instances.
    pub fn exact(&self) -> Option<ExactGrid> {
        self.states.first().and_then(BlockState::exact)
    }

    /// Every component of a block that is written, not only those that change.
    pub fn write_whole_blocks(&mut self) {
        self.states.iter_mut().for_each(BlockState::write_whole_blocks);
    }
}

/// How a device carries work lists out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dispatching {
    /// Instances that one descriptor set reaches.
    pub group: u32,
    /// Widths of tiles that kernels take; 0: single items with masks.
    pub widths: u32,
    /// How wide tiles are.
    pub tuning: DeviceTuning,
    /// Workgroups of a dispatch, at most.
    pub most: u32,
    /// Each dispatch is a step. They write different blocks, and a storage buffer in common tells synchronization
    /// validation as much; as texels, poses are loaded through one descriptor and stored through another, for which it
    /// asks for a barrier. Software drivers, the only ones, run one dispatch after the other anyway.
    pub texels: bool,
}

/// What dispatches of blocks use.
pub(crate) const FLOAT_BLOCKS: &[Use] =
    &[Use::read(Resource::Asset), Use::read(Resource::Poses), Use::write(Resource::Poses)];
/// The same with exact sums.
pub(crate) const EXACT_BLOCKS: &[Use] = &[
    Use::read(Resource::Asset),
    Use::read(Resource::Poses),
    Use::write(Resource::Poses),
    Use::read(Resource::Sums),
    Use::write(Resource::Sums),
];

/// The dispatches of an update of a group.
pub(crate) struct Dispatches {
    how: Dispatching,
    /// The number of the group.
    group: u32,
    works: Vec<Work>,
    exact: bool,
    /// For kernels that take several instances at once.
    pub tiles: Option<Tiles>,
    /// First place in the list of a kernel's items.
    firsts: [usize; 2 * WIDTHS + 1],
}

impl Dispatches {
    pub fn new(how: Dispatching, group: u32, index: &BlockIndex, instances: usize, exact: bool) -> Self {
        // Where rebuilt instances have pipelines of their own.
        let tiles = (how.widths > 0).then(|| Tiles::new(index, instances, !exact, how.tuning));
        Self { how, group, works: vec![], exact, tiles, firsts: [0; 2 * WIDTHS + 1] }
    }

    /// Make the dispatches of a planned work list, and count what tiles load and store, which instances share. Tells
    /// whether there are any.
    pub fn fill(&mut self, index: &BlockIndex, list: &WorkList, stats: &mut UpdateStats) -> bool {
        self.works.clear();
        let Dispatching { group: size, widths, .. } = self.how;
        if let Some(tiles) = &mut self.tiles {
            tiles.clear();
        }
        let mut first = 0;
        for run in list.items.chunk_by(|a, b| a.instance / size == b.instance / size) {
            let (group, items) = (run[0].instance / size, first..first + run.len());
            first = items.end;
            let Some(tiles) = &mut self.tiles else {
                self.dispatch(0, group, items);
                continue;
            };
            let before = tiles.counts();
            tiles.fill(index, list, items);
            let after = tiles.counts();
            for (kernel, (before, after)) in before.into_iter().zip(after).enumerate() {
                // Rebuilt tiles have the kernels behind those of all widths.
                let kernel = kernel / WIDTHS * widths as usize + kernel % WIDTHS;
                self.dispatch(kernel, group, before..after);
            }
        }
        let Some(tiles) = &self.tiles else { return !self.works.is_empty() };
        let bytes = tiles.bytes(index, self.exact);
        (stats.bytes_moved, stats.bytes_floor) = (bytes.moved, bytes.floor);
        let mut place = 0;
        for (count, kernel) in tiles.counts().into_iter().zip(0..) {
            self.firsts[kernel / WIDTHS * widths as usize + kernel % WIDTHS] = place;
            place += count;
        }
        !self.works.is_empty()
    }

    fn dispatch(&mut self, kernel: usize, instance: u32, items: Range<usize>) {
        let (most, end, group) = (self.how.most as usize, items.end, self.group);
        for first in items.step_by(most) {
            let items = first as u32..end.min(first + most) as u32;
            self.works.push(Work { kernel: kernel as u32, group, instance, items, ..Work::default() });
        }
    }

    /// Append the dispatches of all groups to `steps`.
    pub fn append<'a>(groups: impl Iterator<Item = &'a Self> + Clone, steps: &mut Steps) {
        // Groups share no memory: their k-th dispatches are one step in any case.
        let one_by_one = groups.clone().any(|group| group.how.texels);
        let most = groups.clone().map(|group| group.works.len()).max().unwrap_or(0);
        for round in 0..if one_by_one { most } else { most.min(1) } {
            let exact = groups.clone().any(|group| group.exact);
            steps.step(if exact { EXACT_BLOCKS } else { FLOAT_BLOCKS });
            for group in groups.clone() {
                let last = if one_by_one { round + 1 } else { most };
                let works = group.works.iter().take(last).skip(round);
                works.for_each(|work| steps.push(work.clone()));
            }
        }
    }

    /// The place in the list of a work's first item.
    pub fn place(&self, work: &Work) -> usize {
        self.firsts[work.kernel as usize] + work.items.start as usize
    }

    /// What the works of a step read and write: a block of an instance is in one item, so that all are carried out as
    /// one.
    #[cfg(any(test, feature = "internals"))]
    pub fn accesses(&self, list: &WorkList, works: &[Work]) -> Accesses {
        let mut all = Accesses { in_place: true, ..Accesses::default() };
        let mut known = std::collections::HashSet::new();
        let mut add = |accesses: Accesses| {
            let mut new = |access: &MemoryUse| known.insert((access.memory, access.access as u8));
            all.reads.extend(accesses.reads.into_iter().filter(&mut new));
            all.writes.extend(accesses.writes.into_iter().filter(&mut new));
        };
        for work in works {
            let places = work.items.start as usize..work.items.end as usize;
            match &self.tiles {
                None => places.for_each(|item| add(self.accesses_of(list, item))),
                Some(tiles) => {
                    let widths = self.how.widths as usize;
                    let (apart, width) = (work.kernel as usize / widths, work.kernel as usize % widths);
                    for tile in &tiles.items[apart][width][places] {
                        tile.items[..1 << width].iter().for_each(|&item| add(self.accesses_of(list, item as usize)));
                    }
                }
            }
        }
        all.of_group(self.group)
    }

    #[cfg(any(test, feature = "internals"))]
    fn accesses_of(&self, list: &WorkList, item: usize) -> Accesses {
        let item = &list.items[item];
        let (instance, pose) = (item.instance, |slot| Memory::Pose { instance: item.instance, slot });
        let base = (self.exact || item.source.is_none()).then_some(Memory::Base);
        let sums = self.exact.then_some(Memory::Sums { instance });
        let reads = [Memory::Deltas].into_iter().chain(base).chain(item.source.map(pose)).chain(sums);
        Accesses::compute(reads, [pose(item.destination)].into_iter().chain(sums))
    }
}
