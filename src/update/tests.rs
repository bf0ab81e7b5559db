//! What tests of plans have in common: any history of updates, cuts and discarded updates of one instance.

use crate::plan::instances::Instances;
use crate::plan::tests::{DrawnUpdate, Event, assert_barriers_needed, checker};
use std::fmt::Debug;

/// One instance whose updates are planned, and carried out in memory.
pub(crate) trait Planned {
    /// The memory that updates work on.
    type Memory: Clone;
    /// What a slot holds.
    type Pose: PartialEq + Debug;

    fn parts(&mut self) -> (&mut Instances, &mut Self::Memory);

    /// Plan the update numbered `update`, carry it out, and check the pose. What a device records.
    fn update(&mut self, update: u64) -> Vec<crate::plan::hazards::Event>;

    fn pose(&self, slot: u32) -> Self::Pose;

    /// Whether an update may overwrite the pose that it reads.
    fn overwrites(&self) -> bool;

    /// Update to these weights: what is recorded, and the slots of pose and previous pose.
    fn update_to(&mut self, update: u64, weights: &[f32]) -> DrawnUpdate {
        self.parts().0.set_weights(0, weights).unwrap();
        let recorded = self.update(update);
        let (pose, previous) = self.parts().0.slots_of(0).unwrap();
        (recorded, [Some(pose), previous])
    }

    /// The pose there is.
    fn current(&mut self) -> Option<Self::Pose> {
        self.parts().0.slots_of(0).map(|(slot, _)| self.pose(slot))
    }
}

/// Any sequence of updates, cuts and discarded updates: the previous slot holds the pose before, and no access is
/// unordered.
pub(crate) fn follow<P: Planned>(one: &mut P, events: Vec<Event>) {
    // The updates that ran, each with what memory was before it.
    let mut ran: Vec<(u64, DrawnUpdate, P::Memory)> = vec![];
    let (mut number, mut cut) = (0, false);
    for event in events {
        match event {
            Event::Cut => {
                one.parts().0.cut(0).unwrap();
                cut = true;
            }
            Event::DiscardLast(n) => {
                // They never ran: memory is what it was before the first of them.
                for (number, _, before) in ran.drain(ran.len().saturating_sub(n as usize)..).rev() {
                    let (instances, memory) = one.parts();
                    instances.discard_from(number);
                    *memory = before;
                }
            }
            Event::Update(weights) => {
                let (last, before) = (one.current(), one.parts().1.clone());
                number += 1;
                let (recorded, drawn) = one.update_to(number, &weights);
                let pose = one.current();
                assert!(!recorded.is_empty() || last == pose, "without commands the pose stays");
                match drawn[1] {
                    Some(previous) => assert_eq!(Some(one.pose(previous)), last.filter(|_| !cut).or(pose)),
                    None => assert!(one.overwrites()),
                }
                ran.push((number, (recorded, drawn), before));
                cut = false;
            }
        }
    }
    let mut checker = checker();
    for (_, (recorded, drawn), _) in &ran {
        checker.update(recorded);
        drawn.iter().flatten().for_each(|&slot| checker.draw(0, 0, slot));
    }
    assert_eq!(checker.finish(), Ok(()));
}

/// Take any one of the `count` barriers of an update of a running animation out, and the checker says so.
pub(crate) fn every_barrier_is_needed(one: &mut impl Planned, targets: usize, count: usize, what: &str) {
    // Three frames to bring the slots round, then the one that is tampered with, then one more.
    let frame = |frame: usize| {
        let weight = |t: usize| if t % 3 == frame % 3 { 2.0 + frame as f32 / 4.0 } else { 1.0 };
        one.update_to(frame as u64 + 1, &(0..targets).map(weight).collect::<Vec<f32>>())
    };
    assert_barriers_needed(&(0..5).map(frame).collect::<Vec<_>>(), count, what);
}
