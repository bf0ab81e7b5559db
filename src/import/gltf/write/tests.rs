//! What is written is read back, and by the decoders of others.

use super::super::meshopt::decode;
use super::*;
use crate::asset::{Corner, Faces, MorphSource, Tolerance};
use crate::testing::head;
use deltamorph_head::HeadDesc;
use proptest::prelude::*;
use std::path::Path;

proptest! {
    #[test]
    fn encoders_agree_with_the_decoders_of_meshoptimizer(
        steps in prop::collection::vec(prop_oneof![4 => Just(0u8), 3 => 0..3u8, 1 => any::<u8>()], 8..4000),
        corners in prop::collection::vec(0u32..300, 3..900),
        edge in 1u32..20,
    ) {
        let mut bytes = steps[..steps.len() / 8 * 8].to_vec();
        (8..bytes.len()).for_each(|i| bytes[i] = bytes[i].wrapping_add(bytes[i - 8]));
        let data = encode::attributes(&bytes, 8);
        let theirs: Vec<[u8; 8]> = ::meshopt::decode_vertex_buffer(&data, bytes.len() / 8).unwrap();
        prop_assert_eq!(theirs.as_flattened(), &bytes[..]);
        prop_assert_eq!(decode(&data, bytes.len() / 8, 8, "ATTRIBUTES", "").unwrap(), bytes);

        let sorted = |triangles: &[u32]| -> Vec<[u32; 3]> {
            let turned = |t: &[u32; 3]| (0..3).map(|by| [0, 1, 2].map(|i| t[(i + by) % 3])).min().unwrap();
            triangles.as_chunks::<3>().0.iter().map(turned).collect()
        };
        let quads = (0..edge * edge).map(|q| q / edge * (edge + 1) + q % edge);
        let grid = quads.flat_map(|v| [v, v + 1, v + edge + 1, v + edge + 1, v + 1, v + edge + 2]).collect();
        for list in [corners[..corners.len() / 3 * 3].to_vec(), grid] {
            let data = encode::triangles(&list);
            let theirs: Vec<u32> = ::meshopt::decode_index_buffer(&data, list.len()).unwrap();
            prop_assert_eq!(sorted(&theirs), sorted(&list));
            let own = decode(&data, list.len(), 4, "TRIANGLES", "").unwrap();
            prop_assert_eq!(own, theirs.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
            let data = encode::indices(&list);
            let theirs: Vec<u32> = ::meshopt::decode_index_sequence(&data, list.len()).unwrap();
            prop_assert_eq!(theirs, list);
        }
    }
}

/// The file as it is read, in the order of the mesh's own vertices.
fn read(glb: &Glb) -> MorphSource {
    super::super::from_bytes(Path::new("a.glb"), glb.bytes.clone()).unwrap().into_source().unwrap()
}

#[test]
fn a_mesh_is_read_back_within_the_errors_that_are_allowed() {
    let mut source = head(&HeadDesc::default().vertices(3000).targets(20));
    source.targets.push(crate::mesh::SourceTarget { name: "still".into(), ..Default::default() });
    source.positions.iter_mut().for_each(|p| *p += Vec3::new(0.0, 100.0, 0.0));
    let mut mesh = source.to_mesh(Tolerance::ZERO).unwrap();
    mesh.recentre();
    assert!(mesh.origin.y > 90.0);
    let (ulp, diagonal) = (f64::from(f32::EPSILON) * 100.0, f64::from(mesh.diagonal));
    let mut sizes = vec![];
    for encoding in [GlbEncoding::Float, GlbEncoding::Quantized, GlbEncoding::Meshopt] {
        let glb = to_glb(&mesh, &GlbDesc::default().encoding(encoding).position_error(1e-4)).unwrap();
        let found = read(&glb);
        let allowed = if encoding == GlbEncoding::Float { 0.0 } else { 1e-4 * diagonal } + ulp;
        let turns = if encoding == GlbEncoding::Float { 0.001 } else { 0.5 };
        assert_eq!((glb.vertices.len(), glb.notes.len()), (found.positions.len(), 0));
        let normals = found.normals.as_ref().unwrap();
        for (at, &v) in glb.vertices.iter().enumerate() {
            let v = v as usize;
            assert!((found.positions[at] - mesh.positions[v] - mesh.origin).as_dvec3().length() <= allowed);
            assert!(angle_degrees(normals[at].as_dvec3(), mesh.normals[v].as_dvec3()) <= turns);
        }
        for (target, read) in mesh.targets.iter().zip(&found.targets) {
            assert_eq!(target.name, read.name);
            let (mut positions, mut turned) = (vec![Vec3::ZERO; mesh.vertex_count()], vec![Vec3::ZERO; normals.len()]);
            target.vertices.iter().zip(&target.positions).for_each(|(v, d)| positions[*v as usize] = *d);
            read.positions.iter().for_each(|(v, d)| turned[*v as usize] = *d);
            for (at, &v) in glb.vertices.iter().enumerate() {
                assert!((turned[at] - positions[v as usize]).as_dvec3().length() <= allowed, "{}", target.name);
            }
        }
        let corners = |faces: &Faces, of: &dyn Fn(u32) -> u32| {
            let turned = |t: [u32; 3]| (0..3).map(|by| [0, 1, 2].map(|i| of(t[(i + by) % 3]))).min().unwrap();
            let mut all: Vec<_> = faces.triangles().into_iter().map(turned).collect();
            all.sort_unstable();
            all
        };
        assert_eq!(corners(&found.faces, &|v| glb.vertices[v as usize]), corners(&mesh.faces, &|v| v));
        sizes.push(glb.bytes.len());
    }
    assert!(sizes[1] * 3 < sizes[0] * 2 && sizes[2] * 3 < sizes[1] * 2, "{sizes:?}");
}

#[test]
fn seams_double_vertices_and_texture_coordinates_are_turned() {
    let corner = |position, texcoord| Corner { position, texcoord: Some(texcoord) };
    let mesh = MorphMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE],
        normals: vec![Vec3::Z; 4],
        texcoords: vec![Vec2::ZERO, Vec2::X, Vec2::new(0.25, 0.75), Vec2::ONE],
        faces: Faces {
            sizes: vec![3, 3],
            corners: vec![corner(0, 0), corner(1, 1), corner(2, 2), corner(2, 3), corner(1, 1), corner(3, 0)],
        },
        ..MorphMesh::default()
    };
    let glb = to_glb(&mesh, &GlbDesc::default().flip_texcoords(true)).unwrap();
    assert_eq!(glb.vertices, [0, 1, 2, 3, 2]);
    let found = read(&glb);
    assert_eq!(found.texcoords, [Vec2::Y, Vec2::ONE, Vec2::new(0.25, 0.25), Vec2::Y, Vec2::X]);
    assert_eq!(found.faces.triangles(), [[0, 1, 2], [4, 1, 3]]);
}

#[test]
fn what_cannot_be_written_is_refused() {
    let mesh = head(&HeadDesc::default().vertices(500).targets(2)).to_mesh(Tolerance::default()).unwrap();
    let says = |mesh: &MorphMesh, desc: GlbDesc, parts: &[&str]| crate::testing::says(to_glb(mesh, &desc), parts);
    says(&mesh, GlbDesc::default().position_error(0.0), &["a position error of 0", "positive"]);
    says(&mesh, GlbDesc::default().normal_error_degrees(f32::NAN), &["a normal error of NaN", "positive"]);
    let still = MorphMesh { faces: Faces::default(), ..mesh.clone() };
    says(&still, GlbDesc::default(), &["has no faces", "triangles"]);
    says(&MorphMesh { normals: vec![], ..mesh }, GlbDesc::default(), &["0 normals", "MorphSource::to_mesh"]);
}
