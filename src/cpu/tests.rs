use super::*;
use crate::pack::blocks::{BLOCK_SIZES, BlockDesc};
use crate::pack::{DeltaFormat, PackDesc};
use crate::plan::{Accumulate, BatchSize, UpdateMode, UpdatePath};
use crate::{reference, testing};
use proptest::prelude::*;

/// What the kernel loads and stores for the work list as it stands.
fn metered(mesh: &PackedMesh, planner: &GroupPlan) -> u64 {
    let floats = planner.index.size() * POSE_FLOATS;
    let mut moved = 0u64;
    for (i, item) in planner.list.items.iter().enumerate() {
        let (mut destination, mut sums) = (vec![0.0; floats], vec![0; floats]);
        let source = vec![0.0; floats];
        let separate = item.source.is_some() && item.source != Some(item.destination);
        let block = super::blocks::Block::new(mesh.surface(), planner, i, separate.then_some(&source[..]));
        block.run(&mut destination, &mut sums, &mut |bytes| moved += bytes as u64);
    }
    moved
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(112))]
    /// Any mesh size, format, block size, batch, sums, slots, budget and sequence of weights: the pose is the
    /// reference's within its bounds, the previous pose is kept, and the bytes of plans in blocks are the kernel's.
    #[test]
    fn poses_equal_the_reference(
        (vertices, targets, format, size) in (1usize..700, 0usize..20, 0..DeltaFormat::ALL.len(), 0usize..3),
        chunked in any::<bool>(),
        batch in prop_oneof![(1u32..18).prop_map(BatchSize::Targets), Just(BatchSize::All)],
        exact in any::<bool>(), rebuild in any::<bool>(), budget in any::<bool>(),
        slots in 1u32..5, threads in 1usize..4, seed in any::<u32>(),
    ) {
        let mesh = testing::mesh(vertices, targets);
        let format = DeltaFormat::ALL[format];
        let max_chunk_bytes = if chunked { (64 * 24 * targets.max(1) * 2) as u64 } else { 128 << 20 };
        let blocks = BlockDesc { size: Some(BLOCK_SIZES[size]), ..BlockDesc::default() };
        let pack = PackDesc { blocks, max_chunk_bytes, ..PackDesc::new(format) };
        let packed = Arc::new(PackedMesh::pack(&mesh, &pack).unwrap());
        let scale = f64::from(if mesh.diagonal > 0.0 { mesh.diagonal } else { 1.0 });
        let desc = UpdateDesc {
            mode: if rebuild { UpdateMode::Rebuild } else { UpdateMode::Incremental },
            slots,
            accumulate: match exact && format.has_integers() && format.is_blocks() {
                true => Accumulate::Exact,
                false => Accumulate::Float { tolerance: 1e-4 },
            },
            error_budget: if budget && format.is_blocks() { 0.02 * scale as f32 } else { 0.0 },
            ..UpdateDesc::new(UpdatePath::Cpu, if format.is_blocks() { BatchSize::All } else { batch })
        };
        let mut crowd = CpuCrowd::new(packed.clone(), desc, 2, threads).unwrap();
        let grid = packed.layout().index().ok().and_then(|index| index.exact().ok());
        let grid = grid.filter(|_| desc.accumulate == Accumulate::Exact);
        let mut before: [Option<Vec<f32>>; 2] = [None, None];
        for frame in 0..12u32 {
            for instance in 0..2u32 {
                let weight = |t: usize| {
                    // Every third frame is still.
                    let step = frame - u32::from(frame % 3 == 2);
                    let x = seed ^ (t as u32 * 77 + step / (1 + t as u32 % 4) * 13 + instance);
                    let x = x.wrapping_mul(2_654_435_761) >> 16;
                    if x.is_multiple_of(3) { 0.0 } else { (x % 1000) as f32 / 400.0 - 1.0 }
                };
                crowd.set_weights(instance as usize, &(0..targets).map(weight).collect::<Vec<_>>()).unwrap();
            }
            let stats = crowd.update();
            if let Kind::Blocks(planner) = &crowd.kind {
                let moved = metered(&crowd.mesh, &planner.groups[0]);
                prop_assert_eq!(stats.bytes_moved, moved, "{:?} {:?} frame {}", desc, format, frame);
            }
            for (i, before) in before.iter_mut().enumerate() {
                let weights = crowd.instances.requested().nth(i).flatten().unwrap();
                let weights: Vec<f32> = weights.iter().map(|&w| grid.map_or(w, |grid| grid.round(w))).collect();
                let pose = packed.layout().to_user_order(crowd.pose(i).expect("an instance"));
                let error = reference::compare(&pose, &reference::evaluate(&packed, &weights));
                // A still face has settled.
                let waiting = if frame % 3 == 2 { 0.0 } else { f64::from(desc.error_budget) };
                let most = match (format.is_blocks(), grid) {
                    (false, _) => 3e-6 * scale.max(1.0),
                    (true, None) => waiting + f64::from(stats.bound),
                    (true, Some(_)) => waiting + 2e-7 * scale,
                };
                // The budget is one of positions.
                let normals = waiting > 0.0 || error.normal_degrees < 0.01;
                prop_assert!(error.position <= most && normals && stats.bound <= 1e-4 * scale as f32,
                    "{:?} {:?} frame {}: {:?}, at most {:e}", desc, format, frame, error, most);
                let previous = crowd.previous_pose(i).expect("an instance").map(|p| packed.layout().to_user_order(p));
                match (&previous, &*before) {
                    (Some(previous), Some(before)) => prop_assert_eq!(previous, before),
                    (Some(previous), None) => prop_assert_eq!(previous, &pose),
                    (None, _) => prop_assert_eq!(slots, 1),
                }
                *before = Some(pose);
            }
        }
        if grid.is_some() {
            // After any history, the integers and the pose are those of a full evaluation.
            let mut fresh = CpuCrowd::new(packed.clone(), UpdateDesc { error_budget: 0.0, ..desc }, 2, 1).unwrap();
            for i in 0..2 {
                fresh.set_weights(i, crowd.instances.requested().nth(i).flatten().unwrap()).unwrap();
            }
            fresh.update();
            for i in 0..2 {
                prop_assert_eq!(fresh.sums(i).expect("an instance"), crowd.sums(i).expect("an instance"));
                prop_assert_eq!(fresh.pose(i).expect("an instance"), crowd.pose(i).expect("an instance"));
            }
        }
    }
}

#[test]
fn what_exact_sums_cannot_do_is_refused() {
    let mesh = testing::mesh(100, 3);
    let exact = UpdateDesc { accumulate: Accumulate::Exact, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
    let crowd = |format| CpuCrowd::new(Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap()), exact, 1, 1);
    let text = crowd(DeltaFormat::Float32).err().unwrap().to_string();
    assert!(text.contains("exact accumulation with 'float32'") && text.contains("'fast'"), "{text}");
    assert!(crowd(DeltaFormat::BlockFloat32).err().unwrap().to_string().contains("pack as"));
    let mut crowd = crowd(DeltaFormat::Small).unwrap();
    let text = crowd.set_weights(0, &[0.0, 4.5, 0.0]).unwrap_err().to_string();
    assert!(text.contains("'target_1') is 4.5") && text.contains("-4 to 4"), "{text}");
    let float = UpdateDesc { accumulate: Accumulate::Float { tolerance: 1e-9 }, ..exact };
    let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).unwrap());
    let text = CpuCrowd::new(packed, float, 1, 1).err().unwrap().to_string();
    assert!(text.contains("rounding alone"), "{text}");
}

/// Once the deferred changes of a face that stops are applied, an update does nothing, and motion vectors are zero.
#[test]
fn a_face_that_stops_costs_nothing_and_has_its_pose_as_previous_pose() {
    let mesh = testing::mesh(300, 11);
    let float = Accumulate::Float { tolerance: 1e-4 };
    let dense = (DeltaFormat::Float32, float);
    for (format, accumulate) in [dense, (DeltaFormat::Small, float), (DeltaFormat::Small, Accumulate::Exact)] {
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap());
        let budgets = [0.0, 0.05 * mesh.diagonal].into_iter().take(if format.is_blocks() { 2 } else { 1 });
        for (slots, budget) in budgets.flat_map(|budget| (1..4).map(move |slots| (slots, budget))) {
            let desc = UpdateDesc {
                accumulate,
                slots,
                error_budget: budget,
                ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All)
            };
            let mut crowd = CpuCrowd::new(packed.clone(), desc, 1, 1).unwrap();
            let mut weights = [0.0; 11];
            for frame in 0..9 {
                weights.iter_mut().enumerate().for_each(|(t, w)| *w += 0.01 * ((frame + t) % 4) as f32);
                crowd.set_weights(0, &weights).unwrap();
                let stats = crowd.update();
                assert!(format.is_blocks() || stats.passes == 1, "{stats:?}");
            }
            if budget > 0.0 {
                assert!(crowd.update().dirty_blocks > 0, "{desc:?}: nothing was deferred");
            }
            let settled = crowd.pose(0).expect("an instance").to_vec();
            let still = crowd.update();
            let did = (still.coefficients, still.passes, still.dirty_blocks, still.bytes_moved, still.bytes_floor);
            assert_eq!(did, (0, 0, 0, 0, 0), "{desc:?}");
            let bits = |pose: &[f32]| pose.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(crowd.pose(0).expect("an instance")), bits(&settled), "{desc:?}");
            assert_eq!(crowd.previous_pose(0).expect("an instance").map(bits), Some(bits(&settled)), "{desc:?}");
        }
    }
}

#[test]
fn misuse_is_an_error_that_says_what_to_do() {
    let packed = Arc::new(PackedMesh::pack(&testing::mesh(10, 2), &PackDesc::default()).unwrap());
    let desc = UpdateDesc::new(UpdatePath::Compute, BatchSize::All);
    let text = CpuCrowd::new(packed.clone(), desc, 1, 1).err().unwrap().to_string();
    assert!(text.contains("'compute' for a CpuCrowd"), "{text}");
    let desc = UpdateDesc { path: UpdatePath::Cpu, ..desc };
    let mut crowd = CpuCrowd::new(packed.clone(), desc, 1, 1).unwrap();
    let text = crowd.set_weights(0, &[f32::INFINITY, 0.0]).unwrap_err().to_string();
    assert!(text.contains("'target_0') is inf"), "{text}");
    let text = crowd.set_weights(3, &[0.0, 0.0]).unwrap_err().to_string();
    assert!(text.contains("instance 3 of a crowd of 1"), "{text}");
    let crowded = CpuCrowd::new(packed, desc, 1 << 44, 1).err().unwrap().to_string();
    assert!(crowded.contains("more than there is memory; use fewer instances"), "{crowded}");
}
