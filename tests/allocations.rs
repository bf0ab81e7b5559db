//! Planning a frame allocates nothing, since engines do it in their frame loop.

use crate::prelude::*;
use deltamorph::internals::plan::instances::{InstanceState, Instances};
use deltamorph::internals::plan::schedule::Schedule;
use deltamorph::internals::plan::steps::Steps;
use deltamorph::internals::update::animated::{AnimatedUpdate, Playbacks};
use deltamorph::internals::update::blocks::Planner;

#[test]
fn planning_in_blocks_allocates_nothing_after_the_first_frames() {
    let mesh = testing::mesh(5000, 40);
    for format in DeltaFormat::BLOCKS {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap();
        for pose in PoseFormat::ALL {
            for error_budget in [0.0, 0.1] {
                let desc = UpdateDesc { pose, tolerance: 1e-3, error_budget, ..UpdateDesc::blocks() };
                let mut planner = Planner::new(desc, [packed.layout()], 1).unwrap();
                let mut instances = Instances::new(1, 40, desc.slots, 1);
                let mut weights = vec![0.0f32; 40];
                let mut frame = |number: u64, weights: &[f32]| {
                    instances.set_weights(0, weights).unwrap();
                    planner.plan(&mut instances, number);
                    planner.stats().dirty_blocks
                };
                // The first two frames size the retained buffers.
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

#[test]
fn an_update_that_the_gpu_plans_allocates_nothing_after_the_first() {
    let packed = PackedMesh::pack(&testing::mesh(500, 4), &PackDesc::new(DeltaFormat::Small)).unwrap();
    let clips = [gpu::clip(&packed, 30.0, vec![0.5; 40])];
    let grid = packed.layout().grid(PoseFormat::Fixed16, None).unwrap();
    let clips = Clips::new(&AnimationDesc::new(&clips), packed.layout(), grid).unwrap();
    let mut heads = Playbacks::new(100);
    let (mut steps, mut schedule) = (Steps::new(Consumers::default()), Schedule::default());
    let mut sent = 0;
    let mut frame = |number: u32| {
        heads.set_time(f64::from(number) * 1000.0).unwrap();
        for head in (0..100).filter(|head| (head * 7 + number).is_multiple_of(5)) {
            heads.play(head, &Playback { start: f64::from(number) * 1000.0, ..Playback::new(0) }, &clips).unwrap();
            heads.set_hidden((head + 3) % 100, number.is_multiple_of(2));
        }
        let slot = (heads.update(&clips) % 2) as u32;
        let update = AnimatedUpdate {
            records: !heads.changed().is_empty(),
            source: 1 - slot,
            destination: slot,
            groups: 2,
            dispatches: 4,
            texels: false,
        };
        steps.clear();
        update.fill(&mut steps);
        schedule.fill(std::iter::once(&steps));
        sent += heads.changed().len();
    };
    frame(0);
    let counted = allocation_counter::measure(|| (1..50).for_each(&mut frame));
    assert!(sent > 100);
    assert_eq!(counted.count_total, 0);
}

#[test]
fn a_bound_clip_takes_the_memory_of_its_values_however_many_targets_there_are() {
    let clip = WeightClip { names: vec!["t7".into()], fps: 30.0, values: vec![0.5; 1 << 20], ..Default::default() };
    let names: Vec<String> = (0..1000).map(|t| format!("t{t}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut bound = Default::default();
    let took = allocation_counter::measure(|| bound = clip.bind(&names).unwrap());
    assert!(took.bytes_max < 5 << 20, "{} bytes for 4 MiB of weights", took.bytes_max);
    assert_eq!(bound.frame(1 << 19).expect("a frame").iter().sum::<f32>(), 0.5);
}
