use super::*;
use crate::pack::blocks::{BLOCK_SIZES, BlockDesc};
use crate::pack::{DeltaFormat, PackDesc};
use crate::plan::{BatchSize, UpdateMode, UpdatePath};
use crate::update::crowd::CrowdDesc;
use crate::{reference, testing};
use proptest::prelude::*;

/// Bytes that the kernel loads and stores for the work list.
fn metered(mesh: &PackedMesh, planner: &GroupPlan) -> u64 {
    let words = planner.index.size() * planner.pose().stride() / 4;
    let mut moved = 0u64;
    for (i, item) in planner.list.items.iter().enumerate() {
        let (mut destination, source) = (vec![0; words], vec![0; words * planner.index.count()]);
        let base = vec![0; mesh.base().len() * planner.pose().base_stride() / 24];
        let separate = item.source.is_some_and(|slot| slot != item.destination).then_some(&source[..]);
        let run = blocks::Run { items: i..i + 1, source: separate, destination: &mut destination };
        let block = item.block as usize;
        blocks::run_piece((mesh.surface(), &base), planner, block..block + 1, vec![run], &mut |bytes| {
            moved += bytes as u64
        });
    }
    moved
}

fn crowd_of(mesh: &Arc<PackedMesh>, desc: UpdateDesc, instances: u32, threads: usize) -> CpuCrowd {
    CpuCrowd::new(mesh.clone(), &CrowdDesc { instances, ..CrowdDesc::new(desc) }, threads).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(112))]
    /// For any mesh size, format, block size, batch, sums, slots, budget and weights: the pose matches the reference
    /// within its bounds, the previous pose is kept, block plans count the kernel's bytes, and a still face costs
    /// nothing once deferred changes are applied, with its pose as previous pose.
    #[test]
    fn poses_equal_the_reference(
        (vertices, targets, format, size) in (1usize..700, 0usize..20, 0..DeltaFormat::ALL.len(), 0usize..3),
        chunked in any::<bool>(),
        batch in prop_oneof![(1u32..18).prop_map(BatchSize::Targets), Just(BatchSize::All)],
        pose in prop::sample::select(&PoseFormat::ALL), rebuild in any::<bool>(), budget in any::<bool>(),
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
            pose: if pose.takes(format) { pose } else { PoseFormat::Float32 },
            tolerance: 1e-4,
            weight_max: Some(1.5),
            error_budget: if budget && format.is_blocks() { 0.02 * scale as f32 } else { 0.0 },
            ..UpdateDesc::new(UpdatePath::Cpu, if format.is_blocks() { BatchSize::All } else { batch })
        };
        // The largest coordinate of a pose.
        let far = |pose: &[f64]| pose.chunks(6).flat_map(|v| &v[..3]).fold(0.0, |far: f64, x| far.max(x.abs()));
        let base = far(&reference::evaluate(&packed, &[]));
        let mut crowd = crowd_of(&packed, desc, 2, threads);
        let grid = desc.grid(packed.layout()).unwrap();
        let mut before: [Option<Vec<f32>>; 2] = [None, None];
        for frame in 0..12u32 {
            for instance in 0..2 {
                let weight = |t: usize| {
                    // The last two of four frames are still.
                    let step = frame - (frame % 4).saturating_sub(1);
                    let x = seed ^ (t as u32 * 77 + step / (1 + t as u32 % 4) * 13 + instance);
                    let x = x.wrapping_mul(2_654_435_761) >> 16;
                    if x.is_multiple_of(3) { 0.0 } else { (x % 1000) as f32 / 400.0 - 1.0 }
                };
                crowd.set_weights(instance, &(0..targets).map(weight).collect::<Vec<_>>()).unwrap();
            }
            let stats = crowd.update();
            if frame % 4 == 3 {
                let did = (stats.coefficients, stats.passes, stats.dirty_blocks, stats.bytes_moved, stats.bytes_floor);
                prop_assert_eq!(did, (0, 0, 0, 0, 0), "{:?} {:?} frame {}", desc, format, frame);
            }
            if let CpuPlanner::Blocks(planner) = &crowd.planner {
                let moved = metered(&crowd.mesh, &planner.groups[0]);
                prop_assert_eq!(stats.bytes_moved, moved, "{:?} {:?} frame {}", desc, format, frame);
            }
            for (i, before) in (0..).zip(&mut before) {
                let weights = crowd.weights(i).unwrap();
                let weights: Vec<f32> = weights.iter().map(|&w| grid.map_or(w, |grid| grid.round(w))).collect();
                let pose = packed.layout().to_user_order(&crowd.pose(i).expect("an instance"));
                let reference = reference::evaluate(&packed, &weights);
                let error = reference::compare(&pose, &reference);
                // A still face has no deferred changes.
                let waiting = if frame % 4 > 1 { 0.0 } else { f64::from(desc.error_budget) };
                let most = match (format.is_blocks(), grid) {
                    (false, None) => 3e-6 * scale.max(1.0),
                    (true, None) => waiting + f64::from(stats.bound),
                    // Terms are rounded; then displacement and pose are rounded to float32, in three components.
                    (_, Some(_)) => waiting + f64::from(stats.bound) + 3f64.sqrt() * f64::from(f32::EPSILON) / 2.0 * (2.0 * far(&reference) + base),
                };
                // The budget bounds positions. 16-bit normals are rounded by half a unit per active target, or once.
                let active = weights.iter().filter(|weight| **weight != 0.0).count();
                let rounded = grid.filter(|_| desc.pose != PoseFormat::Fixed32);
                let normals = match rounded {
                    None => error.normal_degrees < 0.01,
                    Some(grid) => {
                        let far = |(i, (found, right)): (usize, (&f32, &f64))| match i % 6 {
                            0..3 => 0.0,
                            _ => (f64::from(*found) - right).abs(),
                        };
                        let worst = pose.iter().zip(&reference).enumerate().map(far).fold(0.0, f64::max);
                        let roundings = if grid.rounds_sums { 1 } else { active };
                        worst <= f64::from(grid.units[3]) * (roundings + 1) as f64 / 2.0 + 1e-5
                    }
                };
                let bound = match rounded {
                    None => stats.bound <= 1e-4 * scale as f32,
                    Some(grid) => stats.bound <= grid.position_error(targets),
                };
                prop_assert!(error.position <= most && (normals || waiting > 0.0) && bound,
                    "{:?} {:?} frame {}: {:?}, at most {:e}", desc, format, frame, error, most);
                let previous = crowd.previous_pose(i).expect("an instance").map(|p| packed.layout().to_user_order(&p));
                if frame % 4 == 3 {
                    prop_assert_eq!(before.as_ref(), Some(&pose), "{:?} {:?} frame {}", desc, format, frame);
                }
                match (&previous, &*before) {
                    (Some(previous), Some(before)) => prop_assert_eq!(previous, before),
                    (Some(previous), None) => prop_assert_eq!(previous, &pose),
                    (None, _) => prop_assert_eq!(slots, 1),
                }
                *before = Some(pose);
            }
        }
        if grid.is_some() {
            // The integers equal those of a full evaluation, whatever came before.
            let mut fresh = crowd_of(&packed, UpdateDesc { error_budget: 0.0, ..desc }, 2, 1);
            for i in 0..2 {
                fresh.set_weights(i, crowd.weights(i).unwrap()).unwrap();
            }
            fresh.update();
            for i in 0..2 {
                let [fresh, pose] = [&fresh, &crowd].map(|crowd| crowd.stored_pose(i, 0).expect("an instance"));
                prop_assert_eq!(fresh, pose);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// Shared loads and decoding change no bit: poses of a crowd, with instances hidden for a time, equal those of
    /// crowds of one instance.
    #[test]
    fn a_crowd_has_the_poses_that_each_instance_has_alone(
        (format, size, pose) in (0..DeltaFormat::ALL.len(), 0usize..3, prop::sample::select(&PoseFormat::ALL)),
        instances in 1u32..70, slots in 1u32..4, threads in 1usize..4, together in any::<bool>(), seed in any::<u32>(),
    ) {
        let (format, targets) = (DeltaFormat::ALL[format], 21);
        let blocks = BlockDesc { size: Some(BLOCK_SIZES[size]), ..BlockDesc::default() };
        let mesh = testing::mesh(650, targets);
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(format) }).unwrap());
        let pose = if pose.takes(format) { pose } else { PoseFormat::Float32 };
        let desc = UpdateDesc { slots, pose, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
        let mut crowd = crowd_of(&packed, desc, instances, threads);
        let mut alone: Vec<_> = (0..instances).map(|_| crowd_of(&packed, desc, 1, 1)).collect();
        for frame in 0..5u32 {
            for (instance, alone) in (0..).zip(&mut alone) {
                let weight = |t: u32| {
                    let x = (seed ^ (t * 77 + frame / (1 + t % 4) * 13 + if together { 0 } else { instance * 101 }))
                        .wrapping_mul(2_654_435_761) >> 16;
                    if x.is_multiple_of(3) { 0.0 } else { (x % 1000) as f32 / 1000.0 }
                };
                let weights: Vec<_> = (0..targets as u32).map(weight).collect();
                let hidden = (instance + frame).is_multiple_of(5);
                for (crowd, instance) in [(&mut crowd, instance), (&mut *alone, 0)] {
                    crowd.set_weights(instance, &weights).unwrap();
                    crowd.set_hidden(instance, hidden).unwrap();
                }
                alone.update();
            }
            crowd.update();
            for (instance, alone) in (0..).zip(&alone) {
                prop_assert_eq!(crowd.stored_pose(instance, 0).unwrap(), alone.stored_pose(0, 0).unwrap(), "instance {}", instance);
            }
        }
    }
}

#[test]
fn misuse_is_an_error_that_says_what_to_do() {
    let mesh = testing::mesh(100, 3);
    let packed = |format| Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap());
    let crowd =
        |format, desc, instances| CpuCrowd::new(packed(format), &CrowdDesc { instances, ..CrowdDesc::new(desc) }, 1);
    let make = |format, desc| crowd(format, desc, 1).map(drop);
    let cpu = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
    let exact = UpdateDesc { pose: PoseFormat::Fixed32, ..cpu };
    let short = UpdateDesc { pose: PoseFormat::Fixed16, ..cpu };
    let set =
        |desc, instance, weights: &[f32]| crowd(DeltaFormat::Small, desc, 1).unwrap().set_weights(instance, weights);
    for (result, words) in [
        (make(DeltaFormat::Float32, exact), &["fixed32 poses of float32 deltas", "pack in blocks"][..]),
        (make(DeltaFormat::Float32, UpdateDesc { path: UpdatePath::Compute, ..cpu }), &["'compute' for a CpuCrowd"]),
        (make(DeltaFormat::Fast, UpdateDesc { weight_max: Some(-1.0), ..exact }), &["weights up to -1", "above 0"]),
        (
            crowd(DeltaFormat::Float32, UpdateDesc { slots: 64, ..cpu }, u32::MAX).map(drop),
            &["more than there is memory; use fewer instances"],
        ),
        (make(DeltaFormat::Fast, UpdateDesc { weight_max: Some(256.0), ..short }), &["256", "fixed32"]),
        (set(exact, 0, &[0.0, 4.5, 0.0]), &["'target_1') is 4.5", "-4 to 4"]),
        (set(short, 0, &[0.0, 1.01, 0.0]), &["from -1 to 1", "larger weight_max"]),
        (set(cpu, 0, &[f32::INFINITY, 0.0, 0.0]), &["'target_0') is inf"]),
        (set(cpu, 3, &[0.0; 3]), &["instance 3 of a crowd of 1"]),
    ] {
        testing::says(result, words);
    }
    for (desc, most) in [(exact, 4.0), (short, 1.0), (UpdateDesc { weight_max: Some(2.5), ..short }, 2.5)] {
        set(desc, 0, &[0.0, most, -most]).expect("the largest weights");
    }
}

/// An instance that reuses a place has the crowd's error budget, not its predecessor's.
#[test]
fn a_head_that_is_added_has_the_crowds_error_budget() {
    let packed = Arc::new(PackedMesh::pack(&testing::mesh(100, 4), &PackDesc::new(DeltaFormat::Fast)).unwrap());
    let desc = UpdateDesc { path: UpdatePath::Cpu, error_budget: 0.5, ..UpdateDesc::blocks() };
    let mut crowd = CpuCrowd::new(packed, &CrowdDesc::new(desc), 1).unwrap();
    crowd.set_error_budget(0, 0.0).unwrap();
    crowd.remove(0).unwrap();
    assert_eq!(crowd.add().unwrap(), 0);
    crowd.update();
    crowd.set_weights(0, &[1e-3; 4]).unwrap();
    assert_eq!(crowd.update().dirty_blocks, 0, "a change within the budget is deferred");
}
