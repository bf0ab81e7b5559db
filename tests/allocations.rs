//! Planning a frame allocates nothing: an engine calls it in its frame loop.

#[path = "../src/testing.rs"]
mod testing;

use deltamorph::mesh::packed::{DeltaFormat, PackDesc, PackedMesh};
use deltamorph::plan::blocks::{BlockState, Scratch, WorkList};
use deltamorph::plan::commands::CommandList;
use deltamorph::plan::{Accumulate, UpdateDesc, UpdatePath, UpdateStats};

#[test]
fn planning_in_blocks_allocates_nothing_after_the_first_frames() {
    let mesh = testing::mesh(5000, 40);
    for format in DeltaFormat::BLOCKS {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap();
        let index = packed.layout().blocks.clone().unwrap();
        for accumulate in [Accumulate::Float { tolerance: 1e-3 }, Accumulate::Exact] {
            for error_budget in [0.0, 0.1] {
                let desc = UpdateDesc { accumulate, error_budget, ..UpdateDesc::blocks() };
                let Ok(mut state) = BlockState::new(desc, packed.layout(), &index) else {
                    assert_eq!((format, accumulate), (DeltaFormat::BlockFloat32, Accumulate::Exact));
                    continue;
                };
                let (mut scratch, mut list) = (Scratch::default(), WorkList::new(&index, 1));
                let mut commands = CommandList::new(UpdatePath::Blocks);
                let mut weights = vec![0.0f32; 40];
                let mut frame = |number: u64, weights: &[f32]| {
                    let mut stats = UpdateStats::default();
                    list.clear();
                    state.plan(&index, 0, weights, number, &mut scratch, &mut list, &mut stats);
                    commands.fill_blocks(&list.items, accumulate == Accumulate::Exact);
                    stats.dirty_blocks
                };
                // The first two frames size what is kept.
                (1..3).for_each(|number| {
                    weights[0] += 0.5;
                    frame(number, &weights);
                });
                let mut dirty = 0;
                let counted = allocation_counter::measure(|| {
                    for number in 3..50u64 {
                        weights[number as usize % 40] = (number % 7) as f32 * 0.25;
                        dirty += frame(number, &weights);
                    }
                });
                assert!(dirty > 0);
                assert_eq!(counted.count_total, 0, "{format:?} {desc:?}");
            }
        }
    }
}
