use super::*;
use crate::asset::{MorphTarget, Tolerance};
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
        let (ps, ns) = (packed.layout.targets[t].position_step, packed.layout.targets[t].normal_step());
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
                let (ep, en) = match packed.layout.format {
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
            let largest = packed.layout.chunks().map(|(_, n)| n * 5 * format.stride()).max().unwrap();
            assert!(largest as u64 <= max_chunk_bytes);
            assert_eq!(packed.layout.chunks().map(|(_, n)| n).sum::<usize>(), 256);
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
