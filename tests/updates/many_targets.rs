//! Rigs of hundreds of overlapping targets, with the defaults: poses are near those of the requested weights, and the
//! stated bound holds, although it exceeds the tolerance.

use crate::prelude::*;

const FRAMES: usize = 400;
/// Every weight wanders in [0, 1]; in a frame, one of so many targets moves.
const STILL: usize = 8;

fn walk(mesh: &KeptMesh, format: DeltaFormat) {
    let packed = Arc::new(PackedMesh::pack(mesh, &PackDesc::new(format)).expect("a mesh that packs"));
    let diagonal = f64::from(mesh.diagonal);
    gpu::on_device(&gpu::one(), false, |headless, _| {
        let mut on_device = gpu::crowd(headless, &packed, UpdateDesc::blocks());
        let [mut default, mut wide] =
            [1e-5, 2e-3].map(|tolerance| gpu::cpu_crowd(&packed, UpdateDesc { tolerance, ..UpdateDesc::blocks() }, 1));
        let (mut rng, mut bytes) = (Rng::new(7, 0), [0; 2]);
        let mut weights: Vec<f32> = mesh.targets.iter().map(|_| rng.unit()).collect();
        for frame in 0..FRAMES {
            for weight in weights.iter_mut().skip(frame % STILL).step_by(STILL) {
                *weight = (*weight + rng.range(-0.1, 0.1)).clamp(0.0, 1.0);
            }
            let stats = on_device.step(&[&weights]).expect("a step").update.stats;
            let both = [&mut default, &mut wide].map(|crowd| {
                crowd.set_weights(0, &weights).expect("weights");
                crowd.update()
            });
            both.iter().zip(&mut bytes).for_each(|(stats, bytes)| *bytes += stats.bytes_moved);
            if frame % 50 != 49 {
                continue;
            }
            let exact = evaluate(&packed, &weights);
            let of_cpu = packed.layout().to_user_order(&default.pose(0).expect("a pose"));
            for (pose, bound) in [(on_device.read_pose(0).expect("a pose"), stats.bound), (of_cpu, both[0].bound)] {
                let error = compare(&pose, &exact).position;
                assert!(error <= f64::from(bound) && error < 1e-5 * diagonal, "frame {frame}: {error} of {bound}");
            }
        }
        assert!(bytes[0] * 4 < bytes[1] * 5, "{format:?}: {bytes:?} are moved for tolerances of 1e-5 and 2e-3");
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
