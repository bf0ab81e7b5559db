//! What the CPU does for each frame of one head: weights to passes or work lists, and to commands. No GPU.
//!
//! `cargo bench -p deltamorph-benches --bench planning`; with `DELTAMORPH_DATA`, ict_facekit with its captured clips, too.

use criterion::{BatchSize as Setup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use deltamorph::import::{csv, obj};
use deltamorph::internals::plan::instances::{History, Instances};
use deltamorph::internals::update::blocks::Planner;
use deltamorph::internals::update::dense::Plan;
use deltamorph::{
    BatchSize, DeltaFormat, MorphMesh, PackDesc, PackedMesh, PoseFormat, Tolerance, UpdateDesc, UpdatePath,
};
use deltamorph_head::{HeadDesc, head};
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
            let desc = UpdateDesc::new(path, batch);
            let (mut plan, mut history) = (Plan::default(), History::new(desc.slots, 1));
            let mut frame = 200;
            // Buffers are kept from frame to frame, as the engine keeps them.
            let mut update = |frame: u64| {
                // To and fro: the same number changes at the turns.
                let step = frame as usize % (2 * FRAMES - 2);
                plan.fill(&desc, &clip[step.min(2 * FRAMES - 2 - step)], &mut history, frame + 1);
                plan.coefficients.len()
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

/// Plan frame after frame of `frames` in blocks; a figure is the mean over the whole clip.
fn plan_blocks(c: &mut Criterion, name: &str, mesh: &MorphMesh, frames: &[Vec<f32>]) {
    let mut group = c.benchmark_group("plan_blocks");
    for (format, pose) in [
        (DeltaFormat::Fast, PoseFormat::Float32),
        (DeltaFormat::Fast, PoseFormat::Fixed32),
        (DeltaFormat::Fast, PoseFormat::Fixed16),
        (DeltaFormat::Small, PoseFormat::Float32),
    ] {
        let packed = PackedMesh::pack(mesh, &PackDesc::new(format)).expect("a mesh that packs");
        let desc = UpdateDesc::blocks().pose(pose);
        let mut planner = Planner::new(desc, [packed.layout()], 1).expect("a description that is right");
        let mut instances = Instances::new(1, mesh.targets.len(), desc.slots, 1);
        let mut number = 0;
        let mut frame = |weights: &[f32]| {
            number += 1;
            instances.set_weights(0, weights).expect("an instance");
            planner.plan(&mut instances, number);
            planner.stats().dirty_blocks
        };
        assert!(frames.iter().map(|w| frame(w)).sum::<usize>() > 0);
        group.throughput(Throughput::Elements(frames.len() as u64));
        group.bench_function(BenchmarkId::new(format!("{} {}", format.name(), pose.name()), name), |b| {
            b.iter(|| frames.iter().map(|w| frame(black_box(w))).sum::<usize>());
        });
    }
    group.finish();
}

fn blocks(c: &mut Criterion) {
    let head = head(&HeadDesc::default()).to_mesh(Tolerance::default()).expect("the built-in head");
    plan_blocks(c, "head, 8 of 72", &head, &clip(72, 8));
    let Some(data) = std::env::var_os("DELTAMORPH_DATA") else { return };
    let folder = std::path::Path::new(&data).join("ict_facekit");
    let Ok(source) = obj::import_folder(&folder) else { return };
    let mesh = source.to_mesh(Tolerance::default()).expect("a mesh");
    for name in ["facecap_30fps", "facegood_2_01_mapped_30fps"] {
        let clip = csv::read(&folder.join(format!("weights/{name}.csv")), None).expect("a clip");
        let targets: Vec<&str> = mesh.targets.iter().map(|t| t.name.as_str()).collect();
        plan_blocks(
            c,
            name,
            &mesh,
            &clip.bind(&targets).expect("columns that name targets").frames().collect::<Vec<_>>(),
        );
    }
}

criterion_group!(benches, planning, blocks);
criterion_main!(benches);
