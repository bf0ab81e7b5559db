//! What the CPU does for each frame of one head: weights to work lists. No GPU.
//!
//! `cargo bench -p deltamorph-benches --bench planning`; with `DELTAMORPH_DATA`, ict_facekit with its captured clips,
//! too.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use deltamorph::import::{csv, obj};
use deltamorph::internals::plan::instances::Instances;
use deltamorph::internals::update::blocks::Planner;
use deltamorph::{DeltaFormat, KeptMesh, PackDesc, PackedMesh, PoseFormat, Tolerance, UpdateDesc};
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

/// Plan frame after frame of `frames` in blocks; a figure is the mean over the whole clip.
fn plan_blocks(c: &mut Criterion, name: &str, mesh: &KeptMesh, frames: &[Vec<f32>]) {
    let mut group = c.benchmark_group("plan_blocks");
    for (format, pose) in [
        (DeltaFormat::Fast, PoseFormat::Float32),
        (DeltaFormat::Fast, PoseFormat::Fixed32),
        (DeltaFormat::Fast, PoseFormat::Fixed16),
        (DeltaFormat::Small, PoseFormat::Float32),
    ] {
        let packed = PackedMesh::pack(mesh, &PackDesc::new(format)).expect("a mesh that packs");
        let desc = UpdateDesc { pose, ..UpdateDesc::blocks() };
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
    let head = head(&HeadDesc::default()).kept(Tolerance::default()).expect("the built-in head");
    plan_blocks(c, "head, 8 of 72", &head, &clip(72, 8));
    let Some(data) = std::env::var_os("DELTAMORPH_DATA") else { return };
    let folder = std::path::Path::new(&data).join("ict_facekit");
    let Ok(source) = obj::import_folder(&folder) else { return };
    let mesh = source.kept(Tolerance::default()).expect("a mesh");
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

criterion_group!(benches, blocks);
criterion_main!(benches);
