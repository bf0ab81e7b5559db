//! Tests of packing into blocks.

use super::*;
use crate::asset::KeptMesh;
use crate::pack::grid::{DROPPED, HALF};
use crate::pack::{DeltaFormat, PackDesc, PackedMesh, PoseFormat};
use crate::testing;
use glam::Vec3;

fn packed(format: DeltaFormat, size: u32) -> (KeptMesh, PackedMesh) {
    let mesh = testing::mesh(500, 9);
    let blocks = BlockDesc { size: Some(size), ..BlockDesc::default() };
    let packed = PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(format) }).unwrap();
    (mesh, packed)
}

#[test]
fn deltas_come_back_within_the_error_allowed() {
    for (format, size) in DeltaFormat::BLOCKS.into_iter().flat_map(|f| BLOCK_SIZES.map(|s| (f, s))) {
        let (mesh, packed) = packed(format, size);
        let index = packed.layout().index().unwrap();
        let error = index.error();
        assert_eq!(error, packed.measure_error(&mesh));
        assert!(error.within(1e-5 * f64::from(mesh.diagonal), 0.5), "{format:?} {size}: {error:?}");
        // Deltas that are zero decode to zero.
        for (t, target) in mesh.targets.iter().enumerate() {
            packed.for_each_delta(t, |vertex, delta| {
                assert!(delta == [0.0; 6] || target.vertices.contains(&(vertex as u32)), "{format:?}");
            });
        }
        assert_eq!((0..9).map(|t| index.incidence(t).len()).sum::<usize>(), index.entry_count());
    }
}

#[test]
fn large_deltas_shift_where_bits_are_given() {
    let mut mesh = testing::mesh(100, 1);
    mesh.targets[0].positions[0] = Vec3::new(mesh.diagonal, 0.0, 0.0);
    let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).unwrap();
    let found = packed.measure_error(&mesh).position / f64::from(mesh.diagonal);
    assert!(found > 1e-6 && found < 1e-4, "{found}");
}

#[test]
fn a_grid_is_refused_where_sums_could_overflow() {
    let mesh = testing::mesh(100, 3);
    let pack = |position_error| {
        let blocks = BlockDesc { position_error, weight_max: 1e5, ..BlockDesc::default() };
        PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(DeltaFormat::Small) }).unwrap()
    };
    let layout = pack(1e-5).layout().clone();
    let text = layout.grid(PoseFormat::Fixed32, None).unwrap_err().to_string();
    let factor: f32 = text.split("errors ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(text.contains("could overflow"), "{text}");
    // The remedy works.
    let grid = pack(1e-5 * factor).layout().grid(PoseFormat::Fixed32, None).unwrap();
    assert!(grid.weight_bits >= 7 && grid.weight_max == 1e5 && grid.position_error(3) == grid.position_error(0));
    let grid = |pose, weight_max| layout.grid(pose, weight_max);
    for (pose, weight_max) in [
        (PoseFormat::Fixed32, Some(0.0)),
        (PoseFormat::Fixed32, Some(f32::NAN)),
        (PoseFormat::Fixed16, Some(256.0)),
        (PoseFormat::Float32, None),
    ] {
        assert!(grid(pose, weight_max).is_err(), "{pose:?} {weight_max:?}");
    }
    let (_, floats) = packed(DeltaFormat::Float32, 64);
    assert!(floats.layout().grid(PoseFormat::Fixed32, None).is_err());
}

/// Largest weights, with the signs of one component's deltas: the largest possible sum.
#[test]
fn the_largest_sums_fit_the_integers_of_a_pose_and_half_of_them_would_not_be_needed() {
    let (mesh, packed) = packed(DeltaFormat::Small, 64);
    let index = packed.layout().blocks.clone().unwrap();
    for (pose, most) in [
        (PoseFormat::Fixed16, f64::from(i16::MAX)),
        (PoseFormat::Fixed32, f64::from(i32::MAX)),
        (PoseFormat::Rebuilt16, f64::from(i16::MAX)),
    ] {
        for weight_max in [0.3, 1.0, 1.5, 4.0] {
            let grid = packed.layout().grid(pose, Some(weight_max)).unwrap();
            let steps = f64::from(grid.steps(weight_max));
            let unit = if pose == PoseFormat::Fixed32 { 1.0 } else { f64::from(1u32 << DROPPED) };
            let mut largest = [0f64; POSE_FLOATS];
            let base = grid.integers(packed.base(), mesh.vertex_count());
            let places = index.packed_vertices();
            for vertex in 0..mesh.vertex_count() {
                // As far from 0 as the base pose is.
                let base = &base[places[vertex] as usize * POSE_FLOATS..];
                let mut sums: [f64; POSE_FLOATS] = std::array::from_fn(|c| f64::from(base[c]).abs());
                for target in 0..mesh.targets.len() {
                    packed.for_each_delta(target, |v, delta| {
                        for c in (0..POSE_FLOATS).filter(|_| v == vertex) {
                            let raised = f64::from(1u32 << grid.raised[c / TRIPLE]);
                            let product = steps * delta[c].abs() / f64::from(index.steps()[c / TRIPLE]) * raised;
                            sums[c] += if grid.rounds_sums { product } else { (product / unit + 0.5).floor() };
                            assert!(product <= f64::from(i32::MAX - HALF));
                        }
                    });
                }
                for sum in sums.iter_mut().filter(|_| grid.rounds_sums) {
                    assert!(*sum <= f64::from(i32::MAX - HALF));
                    *sum = (*sum / unit + 0.5).floor();
                }
                (0..POSE_FLOATS).for_each(|c| largest[c] = largest[c].max(sums[c]));
            }
            assert!(largest.iter().all(|sum| *sum <= most), "{pose:?} {weight_max}: {largest:?} of {most}");
            // One bit less, and it would overflow, within the hundredth by which a block may reach less than its
            // bounds.
            let least = 0.99 * most / 2.0 - 16.0;
            let fine = |(c, sum): (usize, &f64)| grid.raised[c / TRIPLE] == DROPPED || *sum > least;
            let fine = pose == PoseFormat::Fixed32 || largest.iter().enumerate().all(fine);
            assert!(fine, "{pose:?} {weight_max}: {largest:?} of {most}");
        }
    }
}

#[test]
fn bad_descriptions_are_refused() {
    let mesh = testing::mesh(10, 1);
    for (blocks, part) in [
        (BlockDesc { size: Some(48), ..BlockDesc::default() }, "48 vertices"),
        (BlockDesc { position_error: 0.0, ..BlockDesc::default() }, "above 0"),
        (BlockDesc { normal_error_degrees: f32::NAN, ..BlockDesc::default() }, "above 0"),
    ] {
        let error = PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(DeltaFormat::Fast) });
        assert!(error.unwrap_err().to_string().contains(part));
    }
}

/// The sine of a larger angle than a right one is smaller, and would ask for finer steps.
#[test]
fn the_more_of_a_normal_is_allowed_the_fewer_bytes_there_are() {
    let mesh = testing::mesh(300, 9);
    let bytes = [1.0, 30.0, 90.0, 150.0].map(|normal_error_degrees| {
        let blocks = BlockDesc { normal_error_degrees, ..BlockDesc::default() };
        let packed = PackedMesh::pack(&mesh, &PackDesc { blocks, ..PackDesc::new(DeltaFormat::Small) });
        packed.expect("a mesh that fits").surface().deltas().len()
    });
    assert!(bytes.is_sorted_by(|a, b| a >= b) && bytes[1] < bytes[0] && bytes[3] == bytes[2], "{bytes:?}");
}
