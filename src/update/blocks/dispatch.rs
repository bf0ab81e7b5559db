//! How a device carries the work list of a group out: in which dispatches.

use super::list::WorkList;
use super::tiles::Tiles;
#[cfg(any(test, feature = "internals"))]
use super::tiles::{TileItem, WIDTHS};
use crate::abi::kernels::DeviceTuning;
use crate::pack::blocks::BlockIndex;
use crate::plan::UpdateStats;
#[cfg(any(test, feature = "internals"))]
use crate::plan::hazards::{Accesses, Memory};
use crate::plan::steps::{Resource, Steps, Use, Work};
use std::ops::Range;

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

/// What dispatches of blocks use, with exact sums all of it, else the first three.
const USES: &[Use] = &[
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
}

impl Dispatches {
    pub fn new(how: Dispatching, group: u32, index: &BlockIndex, instances: usize, exact: bool) -> Self {
        // Where rebuilt instances have pipelines of their own.
        let tiles = (how.widths > 0).then(|| Tiles::new(index, instances, !exact, how.tuning));
        Self { how, group, works: vec![], exact, tiles }
    }

    /// Make the dispatches of a planned work list, and count what tiles load and store, which instances share. Tells
    /// whether there are any.
    pub fn fill(&mut self, index: &BlockIndex, list: &WorkList, stats: &mut UpdateStats) -> bool {
        self.works.clear();
        if let Some(tiles) = &mut self.tiles {
            tiles.clear();
        }
        let (size, mut first) = (self.how.group, 0);
        for run in list.items.chunk_by(|a, b| a.instance / size == b.instance / size) {
            let (group, items) = (run[0].instance / size, first..first + run.len());
            first = items.end;
            let Some(tiles) = &mut self.tiles else {
                self.dispatch(0, group, items);
                continue;
            };
            let before = tiles.counts();
            tiles.fill(index, list, items);
            for (kernel, (before, after)) in before.into_iter().zip(tiles.counts()).enumerate() {
                self.dispatch(kernel, group, before..after);
            }
        }
        if let Some(tiles) = &self.tiles {
            [stats.bytes_moved, stats.bytes_floor] = tiles.bytes(index, self.exact);
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
            steps.step(if exact { USES } else { &USES[..3] });
            for group in groups.clone() {
                let last = if one_by_one { round + 1 } else { most };
                let works = group.works.iter().take(last).skip(round);
                works.for_each(|work| steps.push(work.clone()));
            }
        }
    }

    /// The place in the list of a work's first item.
    pub fn place(&self, work: &Work) -> usize {
        let before = self.tiles.iter().flat_map(|tiles| &tiles.items[..work.kernel as usize]).map(Vec::len);
        before.sum::<usize>() + work.items.start as usize
    }

    /// What the works of a step read and write: a block of an instance is in one item, so that all are carried out as
    /// one.
    #[cfg(any(test, feature = "internals"))]
    pub fn accesses(&self, list: &WorkList, works: &[Work]) -> Accesses {
        let mut uses = std::collections::HashSet::new();
        for work in works {
            let (places, kernel) = (work.items.start as usize..work.items.end as usize, work.kernel as usize);
            let items: Vec<u32> = match &self.tiles {
                None => work.items.clone().collect(),
                Some(tiles) => {
                    let members = |tile: &TileItem| tile.items.into_iter().take(1 << (kernel % WIDTHS));
                    tiles.items[kernel][places].iter().flat_map(members).collect()
                }
            };
            for item in items.into_iter().map(|i| &list.items[i as usize]) {
                let (instance, pose) = (item.instance, |slot| Memory::Pose { instance: item.instance, slot });
                let base = (self.exact || item.source.is_none()).then_some(Memory::Base);
                let sums = self.exact.then_some(Memory::Sums { instance });
                let reads = [Memory::Deltas].into_iter().chain(base).chain(item.source.map(pose)).chain(sums);
                uses.extend(Accesses::compute(reads, [pose(item.destination)].into_iter().chain(sums)).uses);
            }
        }
        Accesses { group: self.group, in_place: true, uses: uses.into_iter().collect() }
    }
}
