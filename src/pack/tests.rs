use super::grid::{DROPPED, HALF, Largest, MeshSums, Reached, Sums};
use super::*;
use crate::asset::streams::{Semantic, TRIPLE};
use crate::cpu::CpuCrowd;
use crate::plan::{BatchSize, UpdateDesc, UpdatePath};
use crate::reference::{compare_group, evaluate_group, evaluate_unpacked_group};
use crate::testing;
use crate::update::crowd::CrowdDesc;

const FIXED: [PoseFormat; 3] = [PoseFormat::Fixed32, PoseFormat::Fixed16, PoseFormat::Rebuilt16];

#[test]
fn too_many_targets_are_refused_with_the_numbers() {
    let error = PackedMesh::pack(&testing::mesh(3, 4), &PackDesc { max_chunk_bytes: 1000, ..PackDesc::default() });
    testing::says(error, &["4 targets", "6144 bytes", "1000"]);
}

#[test]
fn every_group_decodes_to_what_was_packed_within_the_error_measured_in_every_format() {
    let mesh = testing::with_streams(testing::mesh(500, 9));
    let alone = KeptMesh { streams: vec![], ..mesh.clone() };
    for format in DeltaFormat::ALL {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap();
        assert_eq!(packed.groups().len(), 3);
        // Positions and normals are packed as without other streams.
        let surface = PackedMesh::pack(&alone, &PackDesc::new(format)).unwrap();
        assert_eq!(packed.surface().deltas(), surface.surface().deltas());
        let measured = packed.measure_error(&mesh);
        let exact = format == DeltaFormat::Float32;
        assert_eq!(exact, measured.absolute == 0.0 && measured.position == 0.0, "{format:?}: {measured:?}");
        let tangents = measured.tangent_degrees;
        assert!(tangents <= 0.5 && (exact || tangents > 0.0), "{format:?} {measured:?}");
        // A delta of 0.1 in 9 bits has an error of 2e-4.
        assert!(measured.absolute <= 2.5e-4, "{format:?}: {measured:?}");
        // Half a step in each of three components.
        let step = packed.layout().targets.iter().map(|target| target.position_step).fold(0.0, f32::max);
        let is_rounded = measured.position <= 0.51 * 3f64.sqrt() * f64::from(step);
        assert!(format != DeltaFormat::Snorm16 || is_rounded, "{step}: {measured:?}");
        for group in packed.groups() {
            let streams = &group.layout().streams;
            assert_eq!(group.layout().vertex_count, 500);
            for t in 0..mesh.targets.len() {
                let weights: Vec<f32> = (0..mesh.targets.len()).map(|i| f32::from(u8::from(i == t))).collect();
                let pose: Vec<f32> = evaluate_group(group, &weights).into_iter().map(|v| v as f32).collect();
                let error = compare_group(streams, &pose, &evaluate_unpacked_group(&mesh, streams, &weights));
                let rounding = 1e-6;
                assert!(error.within(measured.position + rounding, 0.5 + 1e-3), "{format:?} {streams:?}: {error:?}");
                assert!(error.absolute <= measured.absolute + rounding, "{format:?} {streams:?}: {error:?}");
                // The handedness of tangents comes from the base pose.
                if streams[0].semantic == Semantic::Tangent {
                    assert!((0..500).all(|v| pose[v * POSE_FLOATS + 3] == mesh.streams[0].values[4 * v + 3]));
                }
            }
            if let Some(blocks) = &group.layout().blocks {
                assert_eq!(blocks.order(), packed.layout().blocks.as_ref().unwrap().order());
                // Bounds and budgets apply to lengths.
                let lengths = streams[0].semantic == Semantic::Position;
                assert!(blocks.costs.iter().all(|cost| (cost.reach > 0.0) == lengths));
                assert!(blocks.block_base.iter().all(|base| lengths || *base == 0.0));
                for pose in [PoseFormat::Fixed16, PoseFormat::Rebuilt16] {
                    assert!(group.layout().grid(pose, None).is_ok());
                }
            }
        }
    }
}

#[test]
fn poses_that_are_no_sums_of_these_deltas_are_refused() {
    let mesh = testing::mesh(100, 9);
    for (format, pose) in [
        (DeltaFormat::Float32, PoseFormat::Fixed16),
        (DeltaFormat::Snorm16, PoseFormat::Fixed32),
        (DeltaFormat::Snorm16, PoseFormat::Rebuilt16),
        (DeltaFormat::Small, PoseFormat::Float32),
    ] {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap();
        testing::says(packed.layout().grid(pose, None), &["pack in blocks, as 'fast' or 'small', and use fixed32"]);
    }
    for mesh in testing::degenerate() {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).unwrap();
        assert!(packed.layout().grid(PoseFormat::Fixed16, None).is_ok(), "{}", mesh.name);
    }
}

/// Streams of very different ranges, far from the origin or not: all groups have one grid of weights, the finest that
/// each of them can place, and every component of a pose is as near to the exact sum as is stated.
#[test]
fn groups_share_their_weights_and_keep_their_bounds() {
    let (mut taken, mut differing) = (0, vec![]);
    let cases = testing::cases(64);
    for (seed, pose) in (0..cases).flat_map(|seed| FIXED.map(|pose| (seed, pose))) {
        let mut mesh = testing::uneven(seed);
        let far = Vec3::splat([0.0, 0.0, 300.0, 40_000.0][seed as usize % 4]);
        mesh.positions.iter_mut().for_each(|position| *position += far);
        let format = [DeltaFormat::Small, DeltaFormat::Fast][seed as usize / 4 % 2];
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap();
        let grids = packed.groups().iter().map(|group| group.layout().grid(pose, None));
        let grids: Vec<_> = grids.collect();
        let Ok(grid) = grids[0] else {
            assert!(grids.iter().all(Result::is_err));
            continue;
        };
        let grids: Vec<_> = grids.into_iter().map(Result::unwrap).collect();
        assert!(grids.iter().all(|other| other.weight_bits == grid.weight_bits && other.weight_max == grid.weight_max));
        // What each group could place on its own.
        let all = &packed.layout().sums.as_ref().unwrap().all;
        let largest = all.iter().map(|sums| sums.largest).fold(Largest::default(), Largest::max);
        let alone = all.iter().map(|sums| MeshSums::of(Sums { largest, ..sums.clone() }).grid(pose, None).unwrap());
        let alone: Vec<_> = alone.map(|grid| grid.weight_bits).collect();
        assert_eq!(alone.iter().min(), Some(&grid.weight_bits));
        taken += 1;
        differing.extend(alone.iter().any(|bits| *bits != alone[0]).then_some(seed));
        let desc = UpdateDesc { pose, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
        let packed = Arc::new(packed);
        let mut crowd = CpuCrowd::new(packed.clone(), &CrowdDesc::new(desc), 1).unwrap();
        let weight = |t: usize| grid.round(((t as u64 * 7919 + seed * 104_729) % 2001) as f32 / 1000.0 - 1.0);
        let weights: Vec<f32> = (0..mesh.targets.len()).map(weight).collect();
        crowd.set_weights(0, &weights).unwrap();
        let bound = f64::from(crowd.update().bound);
        for (group, grid) in grids.iter().enumerate() {
            let pose = packed.layout().to_user_order(&crowd.group_pose(0, group).unwrap());
            let exact = evaluate_group(&packed.groups()[group], &weights);
            let most = [grid.position_error(weights.len()), grid.normal_error(weights.len())];
            for (i, (got, exact)) in pose.iter().zip(&exact).enumerate() {
                let (off, most) = ((f64::from(*got) - exact).abs(), f64::from(most[i % POSE_FLOATS / TRIPLE]));
                let fits = off <= most && (group > 0 || i % POSE_FLOATS >= TRIPLE || off <= bound);
                assert!(fits, "mesh {seed}, {format:?}: {off:e} of {most:e}, {bound:e} in group {group}, {grid:?}");
            }
        }
    }
    differing.dedup();
    let differing = differing.len() as u64;
    println!("{taken} poses of {cases} meshes; groups of {differing} would have other weights on their own");
    // Few cases, as under an emulator, may have none.
    assert!(cases < 64 || taken > cases && differing * 4 > cases);
}

/// For any number of targets: products with rounding fit 32 bits, and sums of rounded terms fit 16; the same of sums
/// that are rounded once.
#[test]
fn narrow_poses_have_room_for_what_rounding_adds() {
    for (targets, is_taken) in [(1, true), (32_767, true), (32_768, false), (33_000, false), (65_536, false)] {
        for largest in [0.0, 3.0, 5000.0, 65_535.0, 131_067.0, 8_000_000.0] {
            let (steps, all) = ([1.0 / 1024.0; 2], [largest, largest / 3.0, 0.0, largest, 1.0, 2.0]);
            // Far from the origin, products are so much finer than a unit that weights are made coarser.
            let far = if largest == 3.0 { 16.0 } else { 1.0 };
            let base = [9.0, 0.0, 300.0 * far, 1.0, 1.0, 1.0];
            let sums = Sums {
                format: DeltaFormat::Small,
                steps,
                directions: std::iter::once(3..6).collect(),
                reached: vec![Reached { low: base.map(|most| -most), high: base, sums: all }],
                largest: Largest { sum: largest, base: 300.0 * 1024.0 * f64::from(far) },
                targets,
                weight_max: 8.0,
            };
            let sums = MeshSums::of(sums);
            for (pose, is_taken, roundings) in
                [(PoseFormat::Fixed16, is_taken, targets + 1), (PoseFormat::Rebuilt16, true, 1)]
            {
                let grid = sums.grid(pose, None);
                // A mesh with short deltas has more room.
                assert!(!is_taken || grid.is_ok(), "{targets} targets, {largest} steps: {grid:?}");
                let Ok(grid) = grid else { continue };
                assert!(
                    far == 1.0 || (7..10).contains(&grid.weight_bits),
                    "{targets} targets, {largest} steps: {grid:?}"
                );
                for (c, (largest, base)) in all.into_iter().zip(base).enumerate() {
                    let scale = f64::from(1u32 << grid.weight_bits) * f64::from(1u32 << grid.raised[c / TRIPLE]);
                    let (product, base) = (largest * scale, f64::from(base * 1024.0) * scale);
                    let fine = product + if grid.rounds_sums { base } else { 0.0 };
                    assert!(fine <= f64::from(i32::MAX - HALF), "{targets} targets, {largest} steps: {grid:?}");
                    let sum = (product + base) / f64::from(1u32 << DROPPED) + roundings as f64 / 2.0;
                    assert!(sum <= f64::from(i16::MAX), "{targets} targets, {largest} steps: {grid:?}");
                }
            }
        }
    }
}
