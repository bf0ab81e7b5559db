//! Tiles say what the list says: the same poses and sums, and the bytes that the twin counts.

use super::*;
use crate::abi::kernels::{DeviceClass, DeviceTuning};
use crate::cpu::tile;
use crate::cpu::workers::Workers;
use crate::pack::blocks::BlockDesc;
use crate::pack::{DeltaFormat, PackDesc, PackedMesh};
use crate::plan::instances::Instances;
use crate::plan::{Accumulate, UpdateDesc};
use crate::testing;
use crate::update::blocks::Planner;
use crate::update::blocks::tests::memory;
use proptest::prelude::*;

const TARGETS: usize = 9;

proptest! {
    #[test]
    fn tiles_do_what_the_list_says(
        format in 0..DeltaFormat::BLOCKS.len(), size in prop::sample::select(vec![32u32, 64]), exact in any::<bool>(),
        slots in 1u32..4, instances in 1usize..21, widest in 0usize..WIDTHS,
        frames in prop::collection::vec(prop::collection::vec(prop::option::weighted(0.4, -2i8..5), 20 * TARGETS), 1..6),
    ) {
        let blocks = BlockDesc { size: Some(size), ..BlockDesc::default() };
        let format = DeltaFormat::BLOCKS[format];
        let mesh =
            PackedMesh::pack(&testing::mesh(300, TARGETS), &PackDesc { blocks, ..PackDesc::new(format) }).unwrap();
        let index = mesh.layout().blocks.clone().unwrap();
        let accumulate =
            if exact && format != DeltaFormat::BlockFloat32 { Accumulate::Exact } else { Accumulate::default() };
        let desc = UpdateDesc { slots, accumulate, ..UpdateDesc::blocks() };
        let mut planner = Planner::new(desc, [mesh.layout()], instances).unwrap();
        planner.groups[0].whole_blocks = true;
        let exact = planner.exact();
        let tuning = DeviceTuning { widest_tile: 1 << widest, ..DeviceClass::Desktop.tuning() };
        let mut tiles = Tiles::new(&index, instances, exact.is_none(), tuning);
        let (mut one, mut other) = (memory(&mesh, instances, slots as usize), memory(&mesh, instances, slots as usize));
        let mut heads = Instances::new(instances, TARGETS, slots);
        let mut weights = vec![[0.0; TARGETS]; instances];
        for (update, changes) in frames.iter().enumerate() {
            // Weights are multiples of 1/4: sums are exact in any order.
            for (weight, change) in weights.iter_mut().flatten().zip(changes) {
                *weight = change.map_or(*weight, |w| f32::from(w) * 0.25);
            }
            for (i, weights) in weights.iter().enumerate() {
                heads.set_weights(i as u32, weights).unwrap();
            }
            planner.plan(&mut heads, update as u64 + 1);
            let list = &planner.groups[0].list;
            one.run_list(mesh.surface(), &Workers::new(1).unwrap(), &index, list, exact);
            tiles.clear();
            tiles.fill(&index, list, 0..list.items.len());
            let (mut metered, mut seen) = (0u64, vec![]);
            for (width, tile) in tiles.iter() {
                prop_assert!(width <= widest);
                seen.extend_from_slice(&tile.items[..1 << width]);
                prop_assert!((tile.first as usize).is_multiple_of(ALIGN) && row_words(width) > 1 << width);
                tile::run(mesh.surface(), &index, list, (&tiles, tile, width), exact, &mut other, &mut metered);
            }
            seen.sort_unstable();
            prop_assert!(seen.iter().copied().eq(0..list.items.len() as u32), "every item is in one tile");
            prop_assert_eq!(tiles.bytes(&index, exact.is_some())[0], metered);
            prop_assert!(tiles.rows.len() <= Tiles::words_max(&index, instances));
            prop_assert_eq!(&one.sums, &other.sums);
            let tolerance = 1e-6 * mesh.layout().diagonal;
            for (a, b) in one.poses.iter().flatten().zip(other.poses.iter().flatten()) {
                prop_assert!((a - b).abs() <= tolerance || a.is_nan() && b.is_nan(), "{} {}", a, b);
            }
        }
    }
}

/// Widths of the tiles of eight heads, of which head h has these targets changed.
fn widths_of(tuning: DeviceTuning, changed: impl Fn(usize, usize) -> bool) -> [usize; WIDTHS] {
    let mesh = PackedMesh::pack(&testing::mesh(300, TARGETS), &PackDesc::new(DeltaFormat::Fast)).unwrap();
    let index = mesh.layout().blocks.clone().unwrap();
    let desc = UpdateDesc::blocks();
    let mut planner = Planner::new(desc, [mesh.layout()], TILE).unwrap();
    planner.groups[0].whole_blocks = true;
    let mut tiles = Tiles::new(&index, TILE, true, tuning);
    let mut heads = Instances::new(TILE, TARGETS, desc.slots);
    for update in 1..4 {
        for head in 0..TILE {
            let weight = |t| if changed(head, t) { 0.25 * update as f32 } else { 0.25 };
            heads.set_weights(head as u32, &std::array::from_fn::<f32, TARGETS, _>(weight)).unwrap();
        }
        planner.plan(&mut heads, update);
    }
    let list = &planner.groups[0].list;
    tiles.fill(&index, list, 0..list.items.len());
    std::array::from_fn(|width| tiles.iter().filter(|(w, _)| *w == width).count())
}

#[test]
fn heads_share_a_tile_where_they_share_entries() {
    let desktop = DeviceClass::Desktop.tuning();
    let widths = |changed: &dyn Fn(usize, usize) -> bool| widths_of(desktop, changed);
    let blocks = widths(&|_, _| true)[3];
    assert!(blocks > 1);
    assert_eq!(widths(&|_, _| true), [0, 0, 0, blocks], "all change: one tile of eight a block");
    assert_eq!(widths(&|head, t| t == head)[2..], [0, 0], "heads that have nothing in common share no tile");
    let half = widths(&|head, t| (head + t) % 2 == 0);
    assert!(half[3] > 0 && half[0] == 0, "heads that have half in common do not: {half:?}");
    let most = |head: usize, t: usize| t % 5 != head / 4;
    let cheap = DeviceTuning { load_cost: 0, ..desktop };
    let (shared, alone) = (widths_of(desktop, most)[3], widths_of(cheap, most)[3]);
    assert!(alone < shared, "where loading costs nothing, tiles are halved for less: {alone} of {shared} are whole");
}
