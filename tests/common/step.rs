//! Barriers around a step after the pose.

use crate::gpu;
use crate::written::barriers_needed;
use deltamorph::PackedMesh;
use deltamorph::internals::plan::hazards::{Event, HazardChecker, Memory};
use deltamorph::internals::plan::schedule::asset_uploaded;
use deltamorph_headless::HeadlessCrowd;
use std::slice::from_mut;

/// Updates a crowd of one five times, and has `set` give it a target before the second one. How many barriers of the updates
/// with the step there are, each of which is needed by it or by who reads the pose and what the step writes.
pub fn barriers_around_step(
    crowd: &mut HeadlessCrowd<'_>,
    packed: &PackedMesh,
    set: impl FnOnce(&mut HeadlessCrowd<'_>),
    written: Memory,
) -> usize {
    let (mut set, mut updates, mut slots) = (Some(set), vec![], vec![]);
    for frame in [0, 0, 1, 2, 3] {
        if updates.len() == 1
            && let Some(set) = set.take()
        {
            set(crowd);
        }
        let weights = gpu::weights(packed, frame, 1);
        // SAFETY: nothing is changed.
        let step = unsafe { HeadlessCrowd::step_tampered(from_mut(crowd), &[&weights], |_| {}) };
        updates.push(step.expect("a step").1);
        slots.push(crowd.crowd().pose(0).expect("a pose").slot);
    }
    let is_right = |updates: &[Vec<Event>]| {
        let mut checker = HazardChecker::default();
        checker.upload(asset_uploaded());
        for (events, slot) in updates.iter().zip(&slots) {
            checker.update(events);
            checker.draw(0, 0, *slot);
            checker.read_after(0, written);
        }
        checker.finish().is_ok()
    };
    barriers_needed(&updates, 1..updates.len(), is_right)
}
