//! The instances of a crowd, planned together, and how a device carries the work list out: in which dispatches.

use super::bound::Scratch;
use super::commit::Frame;
use super::list::WorkList;
use super::state::{BlockPlan, BlockState};
use super::tiles::{Tiles, WIDTHS};
use crate::abi::kernels::DeviceTuning;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::plan::UpdateStats;
#[cfg(any(test, feature = "internals"))]
use crate::plan::hazards::{Accesses, Memory, MemoryUse};
use crate::plan::instances::Instances;
use crate::plan::steps::{Resource, Steps, Use, Work};
use std::ops::Range;
use std::sync::Arc;

/// The instances of a crowd, planned together: what GPU and CPU carry out.
pub(crate) struct Planner {
    pub index: Arc<BlockIndex>,
    states: Vec<BlockState>,
    plans: Vec<BlockPlan>,
    pub list: WorkList,
    scratch: Scratch,
}

impl Planner {
    /// `instances` that are in `state`.
    pub fn new(index: &Arc<BlockIndex>, state: BlockState, instances: usize) -> Self {
        Self {
            index: index.clone(),
            states: vec![state; instances],
            plans: vec![BlockPlan::default(); instances],
            list: WorkList::new(index, instances),
            scratch: Scratch::default(),
        }
    }

    /// The grid of exact sums; the same for all instances.
    pub fn exact(&self) -> Option<ExactGrid> {
        self.states.first().and_then(BlockState::exact)
    }

    /// Plan the update numbered `update` of every instance that is shown.
    pub fn plan(&mut self, instances: &Instances, update: u64) -> UpdateStats {
        let mut stats = UpdateStats::default();
        self.list.clear();
        let states = self.states.iter_mut().zip(instances.requested()).zip(&mut self.plans);
        for (i, ((state, requested), plan)) in states.enumerate() {
            let Some(weights) = requested else { continue };
            let mut frame = Frame::new(&self.index, i, &mut self.scratch, &mut self.list);
            *plan = match state.commit(&mut frame, weights) {
                true => state.emit(&mut frame, update, &mut stats),
                false => state.stay(&mut stats),
            };
        }
        stats.passes = usize::from(!self.list.items.is_empty());
        stats
    }

    /// Slots of the pose and of the previous pose of an instance; `None` while there is no pose.
    pub fn slots_of(&self, instance: usize) -> Option<(u32, Option<u32>)> {
        let plan = self.plans[instance];
        self.states[instance].is_known().then_some((plan.result, plan.previous))
    }

    /// The next pose of an instance has no predecessor.
    pub fn cut(&mut self, instance: usize) {
        self.states[instance].cut();
    }

    /// Nothing is known of an instance any longer.
    pub fn forget(&mut self, instance: usize) {
        self.states[instance].forget();
    }

    /// The update numbered `first` and all later ones will never run.
    pub fn discard_from(&mut self, first: u64) {
        self.states.iter_mut().for_each(|state| state.discard_from(first));
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

/// The dispatches of an update.
pub(crate) struct Dispatches {
    how: Dispatching,
    exact: bool,
    /// For kernels that take several instances at once.
    pub tiles: Option<Tiles>,
    /// First place in the list of a kernel's items.
    firsts: [usize; 2 * WIDTHS + 1],
}

impl Dispatches {
    pub fn new(how: Dispatching, index: &BlockIndex, instances: usize, exact: bool) -> Self {
        // Where rebuilt instances have pipelines of their own.
        let tiles = (how.widths > 0).then(|| Tiles::new(index, instances, !exact, how.tuning));
        Self { how, exact, tiles, firsts: [0; 2 * WIDTHS + 1] }
    }

    /// Append the dispatches of a planned work list to `steps`, and count what tiles load and store, which instances
    /// share.
    pub fn fill(&mut self, index: &BlockIndex, list: &WorkList, steps: &mut Steps, stats: &mut UpdateStats) {
        let Dispatching { group: size, widths, .. } = self.how;
        if let Some(tiles) = &mut self.tiles {
            tiles.clear();
        }
        let mut first = 0;
        for run in list.items.chunk_by(|a, b| a.instance / size == b.instance / size) {
            let (group, items) = (run[0].instance / size, first..first + run.len());
            first = items.end;
            let Some(tiles) = &mut self.tiles else {
                self.dispatch(0, group, items, steps);
                continue;
            };
            let before = tiles.counts();
            tiles.fill(index, list, items);
            let after = tiles.counts();
            for (kernel, (before, after)) in before.into_iter().zip(after).enumerate() {
                // Rebuilt tiles have the kernels behind those of all widths.
                let kernel = kernel / WIDTHS * widths as usize + kernel % WIDTHS;
                self.dispatch(kernel, group, before..after, steps);
            }
        }
        let Some(tiles) = &self.tiles else { return };
        let bytes = tiles.bytes(index, self.exact);
        (stats.bytes_moved, stats.bytes_floor) = (bytes.moved, bytes.floor);
        let mut place = 0;
        for (count, kernel) in tiles.counts().into_iter().zip(0..) {
            self.firsts[kernel / WIDTHS * widths as usize + kernel % WIDTHS] = place;
            place += count;
        }
    }

    fn dispatch(&self, kernel: usize, group: u32, items: Range<usize>, steps: &mut Steps) {
        let (most, end) = (self.how.most as usize, items.end);
        for first in items.step_by(most) {
            if steps.is_empty() || self.how.texels {
                steps.step(if self.exact { EXACT_BLOCKS } else { FLOAT_BLOCKS });
            }
            let items = first as u32..end.min(first + most) as u32;
            steps.push(Work { kernel: kernel as u32, instance: group, items, ..Work::default() });
        }
    }

    /// The place in the list of a work's first item.
    pub fn place(&self, work: &Work) -> usize {
        self.firsts[work.kernel as usize] + work.items.start as usize
    }

    /// What the works of a step read and write: a block of an instance is in one item, so that all are carried out as
    /// one.
    #[cfg(any(test, feature = "internals"))]
    pub fn accesses(&self, list: &WorkList, works: &[Work]) -> Vec<Accesses> {
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
        vec![all]
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
