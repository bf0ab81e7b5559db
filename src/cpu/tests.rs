use super::*;
use crate::mesh::packed::{DeltaFormat, PackDesc};
use crate::plan::{BatchSize, UpdateMode};
use crate::{reference, testing};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    /// Any mesh size, format, batch, slot count and sequence of weights: the pose is the reference's.
    #[test]
    fn poses_equal_the_reference(
        vertices in 1usize..700, targets in 0usize..20, snorm in any::<bool>(), chunked in any::<bool>(),
        batch in prop_oneof![(1u32..18).prop_map(BatchSize::Targets), Just(BatchSize::All)],
        rebuild in any::<bool>(), slots in 1u32..4, threads in 1usize..4, seed in any::<u32>(),
    ) {
        let mesh = testing::mesh(vertices, targets);
        let format = if snorm { DeltaFormat::Snorm16 } else { DeltaFormat::Float32 };
        let max_chunk_bytes = if chunked { (64 * 24 * targets.max(1) * 2) as u64 } else { 128 << 20 };
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc { format, max_chunk_bytes, ..PackDesc::default() }).unwrap());
        let mode = if rebuild { UpdateMode::Rebuild } else { UpdateMode::Incremental };
        let desc = UpdateDesc { path: UpdatePath::Cpu, batch, mode, slots };
        let mut crowd = CpuCrowd::new(packed.clone(), desc, 2, threads).unwrap();
        let mut before: [Option<Vec<f64>>; 2] = [None, None];
        for frame in 0..6u32 {
            for instance in 0..2u32 {
                let weight = |t: usize| {
                    let x = (seed ^ (t as u32 * 77 + frame / 2 * 13 + instance)).wrapping_mul(2_654_435_761) >> 16;
                    if x.is_multiple_of(3) { 0.0 } else { (x % 1000) as f32 / 400.0 - 1.0 }
                };
                crowd.set_weights(instance as usize, &(0..targets).map(weight).collect::<Vec<_>>()).unwrap();
            }
            crowd.update();
            for (i, before) in before.iter_mut().enumerate() {
                let reference = reference::evaluate(&packed, &crowd.weights[i]);
                let bound = f64::from(mesh.diagonal.max(1.0));
                let error = reference::compare(crowd.pose(i), &reference);
                prop_assert!(error.position <= 3e-6 * bound, "{:?}", error);
                let previous = before.replace(reference);
                if let (Some(got), Some(want)) = (crowd.previous_pose(i), previous) {
                    prop_assert!(reference::compare(got, &want).position <= 3e-6 * bound);
                } else if frame > 0 {
                    prop_assert!(slots == 1);
                }
            }
        }
    }
}

#[test]
fn a_still_face_costs_nothing() {
    let packed = Arc::new(PackedMesh::pack(&testing::mesh(100, 5), &PackDesc::default()).unwrap());
    let mut crowd = CpuCrowd::new(packed, UpdateDesc::new(UpdatePath::Cpu, BatchSize::All), 1, 1).unwrap();
    crowd.set_weights(0, &[0.1, 0.2, 0.3, 0.4, -0.5]).unwrap();
    assert_eq!(crowd.update().passes, 1);
    assert_eq!(crowd.update(), UpdateStats::default());
}

#[test]
fn misuse_is_an_error_that_says_what_to_do() {
    let packed = Arc::new(PackedMesh::pack(&testing::mesh(10, 2), &PackDesc::default()).unwrap());
    let desc = UpdateDesc::new(UpdatePath::Compute, BatchSize::All);
    let text = CpuCrowd::new(packed.clone(), desc, 1, 1).err().unwrap().to_string();
    assert!(text.contains("'compute' for a CpuCrowd"), "{text}");
    let mut crowd = CpuCrowd::new(packed, UpdateDesc { path: UpdatePath::Cpu, ..desc }, 1, 1).unwrap();
    let text = crowd.set_weights(0, &[f32::INFINITY, 0.0]).unwrap_err().to_string();
    assert!(text.contains("'target_0') is inf"), "{text}");
    let text = crowd.set_weights(3, &[0.0, 0.0]).unwrap_err().to_string();
    assert!(text.contains("instance 3 of a crowd of 1"), "{text}");
}
