//! The `cpu` path on the built-in head of 43,788 vertices and 72 targets; throughput counts the bytes that the
//! update loads and stores.
//!
//! `cargo bench -p deltamorph-benches --bench cpu_path`

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use deltamorph::{BatchSize, CpuCrowd, DeltaFormat, PackDesc, PackedMesh, Tolerance, UpdateDesc, UpdatePath};
use deltamorph_head::{HeadDesc, head};
use std::sync::Arc;

fn cpu_path(c: &mut Criterion) {
    let mesh = head(&HeadDesc::default()).to_mesh(Tolerance::default()).expect("the built-in head");
    let targets = mesh.targets.len();
    let mut group = c.benchmark_group("cpu_path");
    group.sample_size(20);
    for format in DeltaFormat::ALL {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("72 targets fit");
        let packed = Arc::new(packed);
        for changed in [targets, 8] {
            let update = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
            let mut crowd = CpuCrowd::new(packed.clone(), update, 1, 0).expect("threads");
            let mut weights = vec![0.125f32; targets];
            let mut frame = 0;
            let mut step = || {
                frame += 1;
                // Other targets each time: the deltas of the same few would stay in the cache.
                for i in 0..changed {
                    weights[(frame * changed + i) % targets] = 0.25 + (frame % 8) as f32 / 16.0;
                }
                crowd.set_weights(0, &weights).expect("finite weights");
                crowd.update()
            };
            step(); // the first update rebuilds
            let stats = step();
            assert_eq!(stats.coefficients, changed);
            group.throughput(Throughput::Bytes(stats.bytes_moved));
            group.bench_function(BenchmarkId::new(format.name(), format!("{changed} of {targets}")), |b| {
                b.iter(&mut step)
            });
        }
    }
    group.finish();
}

criterion_group!(benches, cpu_path);
criterion_main!(benches);
