//! What the CPU does for each frame of one head: weights to passes, passes to commands. No GPU, no deltas.
//!
//! `cargo bench --bench planning`

use criterion::{BatchSize as Setup, BenchmarkId, Criterion, criterion_group, criterion_main};
use deltamorph::plan::commands::CommandList;
use deltamorph::plan::{BatchSize, Plan, PoseState, UpdateDesc, UpdatePath};
use std::hint::black_box;

const FRAMES: usize = 64;

/// Weights of a clip in which `changed` of `targets` change from frame to frame, all of them active.
fn clip(targets: usize, changed: usize) -> Vec<Vec<f32>> {
    let mut weights = vec![0.125f32; targets];
    let mut at = 0;
    let mut frames = vec![weights.clone()];
    for frame in 1..FRAMES {
        // A stride without a common factor spreads what changes over the targets.
        for _ in 0..changed {
            at = (at + 7) % targets;
            weights[at] = 0.25 + (frame % 8) as f32 / 16.0;
        }
        frames.push(weights.clone());
    }
    frames
}

fn planning(c: &mut Criterion) {
    let mut group = c.benchmark_group("plan_and_fill");
    for (targets, changed) in [(57, 19), (169, 17), (300, 300)] {
        let clip = clip(targets, changed);
        let id = |name| BenchmarkId::new(name, format!("{changed} of {targets}"));
        for (name, path, batch) in [
            ("feedback, batch 7", UpdatePath::Feedback, BatchSize::Targets(7)),
            ("compute, batch 16", UpdatePath::Compute, BatchSize::Targets(16)),
        ] {
            let mut state = PoseState::new(UpdateDesc::new(path, batch)).expect("a description that is right");
            let (mut plan, mut list) = (Plan::default(), CommandList::new(path));
            let mut frame = 200;
            // Buffers are kept from frame to frame, as the engine keeps them.
            let mut update = |frame: u64| {
                // To and fro: the same number changes at the turns.
                let step = frame as usize % (2 * FRAMES - 2);
                state.plan(&clip[step.min(2 * FRAMES - 2 - step)], frame, &mut plan);
                list.fill(std::slice::from_ref(&plan));
                list.coefficients.len()
            };
            update(0);
            assert!((1..200).all(|frame| update(frame) == changed));
            group.bench_function(id(name), |b| {
                b.iter_batched(
                    || {
                        frame += 1;
                        frame
                    },
                    |frame| black_box(update(black_box(frame))),
                    Setup::SmallInput,
                );
            });
        }
    }
    group.finish();
}

criterion_group!(benches, planning);
criterion_main!(benches);
