use super::*;
use crate::asset::streams::Semantic;
use crate::asset::{MorphTarget, Tolerance};
use crate::reference::{compare_group, evaluate_group, evaluate_unpacked_group};
use crate::testing;
use glam::Vec3;

fn mesh(vertices: usize, targets: usize) -> MorphMesh {
    let value = |i: usize| ((i * 2_654_435_761 % 1000) as f32 / 500.0) - 1.0;
    let vec = |i: usize| Vec3::new(value(3 * i), value(3 * i + 1), value(3 * i + 2));
    MorphMesh {
        name: "m".into(),
        positions: (0..vertices).map(vec).collect(),
        normals: vec![Vec3::Z; vertices],
        targets: (0..targets)
            .map(|t| MorphTarget {
                name: format!("t{t}"),
                vertices: (0..vertices as u32).filter(|v| !(*v as usize + t).is_multiple_of(3)).collect(),
                positions: (0..vertices).filter(|v| !(v + t).is_multiple_of(3)).map(|v| vec(v + t) * 0.01).collect(),
                normals: (0..vertices).filter(|v| !(v + t).is_multiple_of(3)).map(|v| vec(v * 7 + t)).collect(),
                streams: vec![],
            })
            .collect(),
        diagonal: 3.0,
        tolerance: Tolerance::ZERO,
        ..MorphMesh::default()
    }
}

fn assert_decodes(packed: &PackedMesh, mesh: &MorphMesh) {
    for (t, target) in mesh.targets.iter().enumerate() {
        let mut decoded = vec![[0.0; POSE_FLOATS]; mesh.vertex_count()];
        packed.for_each_delta(t, |v, d| decoded[v] = d);
        let (ps, ns) = (packed.layout().targets[t].position_step, packed.layout().targets[t].normal_step());
        let mut kept = target.vertices.iter().peekable();
        let mut k = 0;
        for (v, d) in decoded.iter().enumerate() {
            let (p, n) = if kept.next_if_eq(&&(v as u32)).is_some() {
                k += 1;
                (target.positions[k - 1], target.normals[k - 1])
            } else {
                (Vec3::ZERO, Vec3::ZERO)
            };
            for i in 0..3 {
                let (ep, en) = match packed.layout().format {
                    DeltaFormat::Snorm16 => (f64::from(ps) * 0.5001, f64::from(ns) * 0.5001),
                    _ => (0.0, 0.0),
                };
                assert!((d[i] - f64::from(p[i])).abs() <= ep, "target {t} vertex {v}");
                assert!((d[3 + i] - f64::from(n[i])).abs() <= en, "target {t} vertex {v}");
            }
        }
    }
}

#[test]
fn decodes_to_what_was_packed_whole_and_in_chunks() {
    let mesh = mesh(200, 5);
    for format in DeltaFormat::DENSE {
        for max_chunk_bytes in [128 << 20, 5 * 64 * 24 + 1] {
            let packed = PackedMesh::pack(&mesh, &PackDesc { format, max_chunk_bytes, ..PackDesc::default() }).unwrap();
            let largest = packed.layout().chunks().map(|(_, n)| n * 5 * format.stride()).max().unwrap();
            assert!(largest as u64 <= max_chunk_bytes);
            assert_eq!(packed.layout().chunks().map(|(_, n)| n).sum::<usize>(), 256);
            assert_decodes(&packed, &mesh);
        }
    }
}

#[test]
fn too_many_targets_are_refused_with_the_numbers() {
    let error = PackedMesh::pack(&mesh(3, 4), &PackDesc { max_chunk_bytes: 1000, ..PackDesc::default() });
    let text = error.unwrap_err().to_string();
    assert!(text.contains("4 targets") && text.contains("6144 bytes") && text.contains("1000"), "{text}");
}

#[test]
fn the_normal_step_covers_the_largest_normal() {
    let mesh = mesh(64, 1);
    let packed = PackedMesh::pack(&mesh, &PackDesc { format: DeltaFormat::Snorm16, ..PackDesc::default() }).unwrap();
    let largest = mesh.targets[0].normals.iter().map(|n| n.abs().max_element()).fold(0.0, f32::max);
    let step = packed.layout().targets[0].normal_step();
    assert!(step * 32767.0 >= largest && step * 32767.0 <= 2.001 * largest);
}

#[test]
fn every_group_decodes_to_what_was_packed_within_the_error_measured_in_every_format() {
    let mesh = testing::with_streams(testing::mesh(500, 9));
    let alone = MorphMesh { streams: vec![], ..mesh.clone() };
    for format in DeltaFormat::ALL {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap();
        assert_eq!(packed.groups().len(), 3);
        // Deltas of positions and normals are packed as they are without other streams.
        assert_eq!(packed.deltas(), PackedMesh::pack(&alone, &PackDesc::new(format)).unwrap().deltas());
        let measured = packed.measure_error(&mesh);
        let exact = matches!(format, DeltaFormat::Float32 | DeltaFormat::BlockFloat32);
        assert_eq!(exact, measured.absolute == 0.0 && measured.position == 0.0, "{format:?}: {measured:?}");
        assert!(
            measured.tangent_degrees <= 0.5 && (exact || measured.tangent_degrees > 0.0),
            "{format:?} {measured:?}"
        );
        // A delta of 0.1 in 9 bits is off by 2e-4, in 8 bits by twice as much.
        let most = if format == DeltaFormat::Pair { 5e-4 } else { 2.5e-4 };
        assert!(measured.absolute <= most, "{format:?}: {measured:?}");
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
                // The handedness of tangents is the base pose's.
                if streams[0].semantic == Semantic::Tangent {
                    assert!((0..500).all(|v| pose[v * POSE_FLOATS + 3] == mesh.streams[0].values[4 * v + 3]));
                }
            }
            if let Some(blocks) = &group.layout().blocks {
                assert_eq!(blocks.order(), packed.layout().blocks.as_ref().unwrap().order());
                // Bounds and budgets speak of lengths.
                let lengths = streams[0].semantic == Semantic::Position;
                assert!(blocks.costs().iter().all(|cost| (cost.reach > 0.0) == lengths));
                assert!(blocks.block_base().iter().all(|base| lengths || *base == 0.0));
                assert_eq!(blocks.exact().is_ok(), format.has_integers());
            }
        }
    }
}

#[test]
fn streams_that_do_not_fit_are_refused() {
    let mesh = testing::with_streams(testing::mesh(50, 3));
    let change = |f: &dyn Fn(&mut MorphMesh)| {
        let mut mesh = mesh.clone();
        f(&mut mesh);
        PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).unwrap_err().to_string()
    };
    for (text, part) in [
        (change(&|m| m.streams[0].values.truncate(199)), "stream 'tangent' has 199 numbers; 50 vertices take 200"),
        (change(&|m| m.streams[1].semantic = Semantic::Tangent), "two streams 'tangent'"),
        (change(&|m| m.streams[1].semantic = Semantic::Normal), "two streams 'normal'"),
        (change(&|m| m.targets[1].streams[2].vertices.truncate(3)), "stream 'color 0' in target 'target_1'"),
        (change(&|m| m.targets[1].streams[0].vertices[3] = 50), "stream 'tangent' in target 'target_1'"),
    ] {
        assert!(text.contains(part), "{text}");
    }
}
