//! Rigs of hundreds of overlapping targets, with the defaults: poses are near those of the requested weights, and the
//! stated bound holds, although it exceeds the tolerance.

use crate::{data, gpu};
use deltamorph::reference::{compare, evaluate};
use deltamorph::{CpuCrowd, DeltaFormat, KeptMesh, PackDesc, PackedMesh, Tolerance, UpdateDesc, UpdatePath};
use deltamorph_head::{HeadDesc, Rng, head};
use std::sync::Arc;
use std::time::{Duration, Instant};

const FRAMES: usize = 400;
/// Every weight wanders in [0, 1]; in a frame, one of so many targets moves.
const STILL: usize = 8;

/// One crowd of a tolerance, on the CPU, and what it cost.
struct Played {
    crowd: CpuCrowd,
    bytes: u64,
    time: Duration,
    bound: f32,
}

impl Played {
    fn new(packed: &Arc<PackedMesh>, desc: UpdateDesc) -> Self {
        let crowd = CpuCrowd::new(packed.clone(), UpdateDesc { path: UpdatePath::Cpu, ..desc }, 1, 1).expect("a crowd");
        Self { crowd, bytes: 0, time: Duration::ZERO, bound: 0.0 }
    }

    fn step(&mut self, weights: &[f32]) {
        self.crowd.set_weights(0, weights).expect("weights");
        let start = Instant::now();
        let stats = self.crowd.update();
        self.time += start.elapsed();
        self.bytes += stats.bytes_moved;
        self.bound = stats.bound;
    }
}

fn walk(mesh: &KeptMesh, format: DeltaFormat) {
    let packed = Arc::new(PackedMesh::pack(mesh, &PackDesc::new(format)).expect("a mesh that packs"));
    let diagonal = f64::from(mesh.diagonal);
    gpu::on_device(&gpu::one(), false, |headless, _| {
        let mut on_device = gpu::crowd(headless, &packed, UpdateDesc::blocks());
        let [mut default, mut wide] =
            [1e-5, 2e-3].map(|drift| Played::new(&packed, UpdateDesc { tolerance: drift, ..UpdateDesc::blocks() }));
        let mut rng = Rng::new(7, 0);
        let mut weights: Vec<f32> = mesh.targets.iter().map(|_| rng.unit()).collect();
        let mut worst: f64 = 0.0;
        for frame in 0..FRAMES {
            for weight in weights.iter_mut().skip(frame % STILL).step_by(STILL) {
                *weight = (*weight + rng.range(-0.1, 0.1)).clamp(0.0, 1.0);
            }
            let stats = on_device.step(&[&weights]).expect("a step").update.stats;
            // In turns, since the second finds the deltas in the cache.
            let mut both = [&mut default, &mut wide];
            both.rotate_left(frame % 2);
            both.iter_mut().for_each(|played| played.step(&weights));
            if frame % 50 != 49 {
                continue;
            }
            let exact = evaluate(&packed, &weights);
            let poses = [
                (on_device.read_pose(0).expect("a pose"), stats.bound),
                (packed.layout().to_user_order(&default.crowd.pose(0).expect("a pose")), default.bound),
            ];
            for (pose, bound) in poses {
                let error = compare(&pose, &exact).position;
                assert!(error <= f64::from(bound), "frame {frame}: {error} of {bound}");
                worst = worst.max(error / diagonal);
            }
        }
        let [time, bytes] =
            [default.time.as_secs_f64() / wide.time.as_secs_f64(), default.bytes as f64 / wide.bytes as f64];
        println!(
            "{}, {} targets, {format:?}: {worst:.1e} of the diagonal off, {:.1e} by its bound; of a tolerance of 2e-3: \
             {bytes:.2} times the bytes, {time:.2} the time",
            mesh.name,
            mesh.targets.len(),
            f64::from(default.bound) / diagonal
        );
        assert!(worst < 1e-5 && bytes < 1.25, "{worst} of the diagonal, {bytes} times the bytes");
    });
}

#[test]
fn hundreds_of_overlapping_targets_come_out_as_requested() {
    let head = head(&HeadDesc { vertices: 1500, targets: 600, sparsity: 0.6, seed: 3 });
    let head = head.kept(Tolerance::default()).expect("a mesh");
    for format in DeltaFormat::BLOCKS {
        walk(&head, format);
    }
    if let Some((mesh, _)) = data::face("aura_rebuilt", "compskin_30fps.csv") {
        walk(&mesh, DeltaFormat::Fast);
    }
}
