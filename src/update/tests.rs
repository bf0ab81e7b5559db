//! Helpers for tests of plans: any history of updates, cuts and discards of one instance.

use crate::plan::UpdateDesc;
use crate::plan::hazards::{Event as Recorded, Memory};
use crate::plan::instances::Instances;
use crate::plan::tests::{DrawnUpdate, Event, assert_barriers_needed, checker};
use std::fmt::Debug;

/// Plans updates of one instance.
pub(crate) trait Planned: Sized {
    /// The memory that updates work on.
    type Memory: Clone;
    /// The contents of a slot.
    type Pose: PartialEq + Debug;

    /// Plans the next update, executes it, and checks the pose. Returns what a device records.
    fn update(one: &mut One<Self>) -> Vec<Recorded>;

    fn pose(one: &One<Self>, slot: u32) -> Self::Pose;
}

/// Updates that may be in flight.
const UNFINISHED: usize = 3;

/// A crowd of one instance.
pub(crate) struct One<P: Planned> {
    pub(crate) desc: UpdateDesc,
    pub(crate) planner: P,
    pub(crate) instances: Instances,
    pub(crate) memory: P::Memory,
    /// The number of the last update.
    pub(crate) update: u64,
}

impl<P: Planned> One<P> {
    pub(crate) fn new(desc: UpdateDesc, targets: usize, planner: P, memory: P::Memory) -> Self {
        Self { desc, planner, instances: Instances::new(1, targets, desc.slots, UNFINISHED as u32), memory, update: 0 }
    }

    /// Updates to these weights; returns what is recorded, and the slots of pose and previous pose.
    pub(crate) fn update_to(&mut self, weights: &[f32]) -> DrawnUpdate {
        self.instances.set_weights(0, weights).unwrap();
        self.update += 1;
        let recorded = P::update(self);
        let (pose, previous) = self.instances.slots_of(0).unwrap();
        (recorded, [Some(pose), previous])
    }

    /// The current pose.
    fn current(&self) -> Option<P::Pose> {
        self.instances.slots_of(0).map(|(slot, _)| P::pose(self, slot))
    }
}

/// The slots that an update writes.
fn written(recorded: &[Recorded]) -> Vec<u32> {
    let works = recorded.iter().flat_map(|event| match event {
        Recorded::Step { works, .. } => &works[..],
        Recorded::Barrier(_) => &[],
    });
    let uses = works.flat_map(|work| &work.uses).filter(|used| used.access.writes());
    uses.filter_map(|used| if let Memory::Pose { slot, .. } = used.memory { Some(slot) } else { None }).collect()
}

/// The rule of `MorphEngine` for several queues: how many frames back draws may still run, with and without reading the
/// previous pose. The update writes none of their slots.
fn assert_waits_for_enough(desc: UpdateDesc, drawn: impl Iterator<Item = [Option<u32>; 2]>, written: &[u32]) {
    let slots = desc.slots as usize;
    let [beside, with_previous] = match desc.path.works_in_place() {
        true => [slots - 1, slots.saturating_sub(2)],
        false => [(slots - 1) / 2, slots.saturating_sub(3) / 2],
    };
    for (back, [pose, previous]) in drawn.take(beside).enumerate() {
        let previous = previous.filter(|_| back < with_previous);
        let read = [pose, previous].into_iter().flatten().find(|slot| written.contains(slot));
        assert_eq!(read, None, "{desc:?}: the update writes {written:?}, the draw of {} frames before reads", back + 1);
    }
}

/// For any sequence of updates, cuts and discards: the previous slot holds the previous pose, every access is ordered,
/// and slots are those that a host counting frames expects.
pub(crate) fn follow<P: Planned>(mut one: One<P>, events: Vec<Event>) {
    // Executed updates, each with the memory before it, and whether it followed a cut.
    let mut ran: Vec<(u64, DrawnUpdate, P::Memory, bool)> = vec![];
    let (mut cut, in_place, mut finished) = (false, one.desc.path.works_in_place(), 0);
    for event in events {
        match event {
            Event::Cut => {
                one.instances.reset_history(0).unwrap();
                cut = true;
            }
            Event::DiscardLast(n) => {
                let first = ran.len() - (n as usize).min(ran.len() - finished);
                // Discarded updates never ran: restore the memory before the first of them.
                for (i, (number, _, before, was_cut)) in ran.drain(first..).enumerate() {
                    if i == 0 {
                        one.instances.discard_from(number);
                        one.memory = before;
                    }
                    cut |= was_cut;
                }
            }
            Event::Update(weights) => {
                let weights = weights.unwrap_or_else(|| one.instances.requested().next().flatten().unwrap().to_vec());
                let (last, before) = (one.current(), one.memory.clone());
                let (recorded, drawn) = one.update_to(&weights);
                let pose = one.current();
                assert!(!recorded.is_empty() || last == pose, "without commands the pose stays");
                match drawn[1] {
                    Some(previous) => assert_eq!(Some(P::pose(&one, previous)), last.filter(|_| !cut).or(pose)),
                    // The update had to overwrite the pose that it read.
                    None => assert!(one.desc.slots == 1 || one.desc.slots == 2 && !in_place),
                }
                assert_waits_for_enough(
                    one.desc,
                    ran.iter().rev().map(|(_, (_, drawn), ..)| *drawn),
                    &written(&recorded),
                );
                ran.push((one.update, (recorded, drawn), before, std::mem::take(&mut cut)));
                finished = finished.max(ran.len().saturating_sub(UNFINISHED));
            }
        }
    }
    let mut checker = checker();
    for (_, (recorded, drawn), ..) in &ran {
        checker.update(recorded);
        drawn.iter().flatten().for_each(|&slot| checker.draw(0, 0, slot));
    }
    assert_eq!(checker.finish(), Ok(()));
}

/// Removing any one of the `count` barriers of an update of a running animation makes the checker fail.
pub(crate) fn every_barrier_is_needed<P: Planned>(mut one: One<P>, targets: usize, count: usize, what: &str) {
    // Three frames to fill the slots, the frame under test, and one more.
    let frame = |frame: usize| {
        let weight = |t: usize| if t % 3 == frame % 3 { 2.0 + frame as f32 / 4.0 } else { 1.0 };
        one.update_to(&(0..targets).map(weight).collect::<Vec<f32>>())
    };
    assert_barriers_needed(&(0..5).map(frame).collect::<Vec<_>>(), count, what);
}
