//! Planted faults, each of which the harness has to detect.

use super::table::{ROWS, Row, for_every_update, variants};
use crate::gpu::{hazards, packed, weights};
use crate::prelude::*;
use deltamorph::DeltaFormat::{Fast, Float32, Small};

#[test]
fn what_is_recorded_has_no_hazard_and_a_dropped_barrier_has_one() {
    let plain = testing::mesh(500, 20);
    for (mesh, with_streams) in [(testing::with_streams(plain.clone()), true), (plain, false)] {
        barriers(&mesh, with_streams);
    }
}

/// Every update of these meshes, or those of techniques that take no others.
fn barriers(mesh: &KeptMesh, with_streams: bool) {
    for_every_update(&[Float32, Fast, Small], mesh, |headless, mesh, desc| {
        let row = Row::of(desc.path);
        if row.streams != with_streams {
            return;
        }
        // Modes and slots of baselines, too; those of the library are in src/update/tests.rs.
        let descs: Vec<_> = if desc.path.is_baseline() { variants(desc).collect() } else { vec![desc] };
        for desc in descs.into_iter().filter(|_| row.records) {
            let mut crowd = gpu::crowd(headless, mesh, desc);
            let lists: Vec<_> = (0..5)
                .map(|frame| {
                    let (.., events) = gpu::recorded(&mut crowd, &[&weights(mesh, frame, 1)]);
                    // Displacement textures have no slots.
                    (events, crowd.crowd().pose(0).map_or(0, |pose| pose.slot))
                })
                .collect();
            assert_eq!(hazards(mesh, &lists), Ok(()), "{desc:?}");
            // All barriers of the fourth update, one at a time; with several passes, since otherwise there are none
            // between passes.
            for at in 0..lists[3].0.len() {
                // With two slots and one pass each, the barrier before is covered by that of the previous frame unless
                // the previous pose is drawn too; that case is in src/plan/tests.rs. Sums and textures are always in
                // use.
                let is_covered =
                    at == 0 && !matches!(desc.path, deltamorph_baselines::SCATTER | deltamorph_baselines::TEXTURE);
                if is_covered || !matches!(lists[3].0[at], Event::Barrier(_)) {
                    continue;
                }
                let mut faulty = lists.clone();
                let dropped = faulty[3].0.remove(at);
                assert!(hazards(mesh, &faulty).is_err(), "{desc:?}: dropped {dropped:?}");
            }
        }
    });
}

/// Synchronization validation detects the same fault in the real command buffer.
#[test]
fn validation_sees_a_dropped_barrier() {
    for row in &ROWS {
        if let Some((dropped, format, batch)) = row.seen {
            let mut barriers = 0..;
            let is_it = |_: &Barrier| barriers.next() == Some(dropped);
            gpu::assert_validation_sees_dropped(row.path.name(), &[&[0.7; 20]], is_it, |headless| {
                let mesh = packed(headless.engine(), &testing::mesh(500, 20), format);
                let mut crowd = gpu::crowd(headless, &mesh, UpdateDesc::new(row.path, batch));
                crowd.step(&[&weights(&mesh, 0, 1)]).expect("a step");
                crowd
            });
        }
    }
}
