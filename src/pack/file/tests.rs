//! Packed files round-trip.

mod hostile;

use super::*;
use crate::asset::{Corner, Faces};
use crate::pack::blocks::{BLOCK_SIZES, BlockDesc};
use crate::pack::{DeltaFormat, PackDesc};
use crate::testing;
use deltamorph_head::HeadDesc;
use glam::{Vec2, Vec3};

fn mesh(vertices: usize, targets: usize) -> KeptMesh {
    let corner = |position, texcoord| Corner { position, texcoord };
    let corners = [corner(0, Some(1)), corner(1, None), corner(2, Some(0)), corner(2, None)];
    KeptMesh {
        faces: Faces { sizes: vec![4, 3], corners: [&corners[..], &corners[..3]].concat() },
        texcoords: vec![Vec2::new(0.25, 0.5), Vec2::new(-0.0, 1.0)],
        tolerance: Tolerance::default(),
        ..testing::mesh(vertices, targets)
    }
}

fn packed(format: DeltaFormat, size: Option<u32>) -> PackedMesh {
    let blocks = BlockDesc { size, ..BlockDesc::default() };
    PackedMesh::pack(&mesh(70, 4), &PackDesc { blocks, ..PackDesc::new(format) }).unwrap()
}

/// With tangents and texture coordinates, and colours and masks in a third group.
fn with_streams(format: DeltaFormat) -> PackedMesh {
    PackedMesh::pack(&testing::with_streams(mesh(70, 4)), &PackDesc::new(format)).unwrap()
}

/// Reads a file, asserting memory use in a small multiple of its size. Names are the worst case: empty ones take 4
/// bytes.
fn read(bytes: &[u8]) -> Result<PackedMesh> {
    let mut result = None;
    let memory = allocation_counter::measure(|| result = Some(PackedMesh::from_bytes(Path::new("head.dmorph"), bytes)));
    // Some data is per target and group.
    let groups = bytes.get(12).map_or(1, |sections| u64::from(*sections).saturating_sub(8) / 5).clamp(1, 16);
    let most = 16 * 1024 + 24 * groups * bytes.len() as u64;
    assert!(memory.bytes_max <= most, "{} bytes for a file of {}", memory.bytes_max, bytes.len());
    result.expect("measured")
}

fn message(bytes: &[u8]) -> String {
    let text = read(bytes).map(|_| ()).expect_err("refused").to_string();
    assert!(text.starts_with("head.dmorph") && text.contains("; "), "{text}");
    text
}

#[test]
fn a_mesh_that_is_far_is_recentred_in_memory_and_not_in_the_file() {
    let mut far = testing::with_streams(mesh(70, 4));
    far.positions.iter_mut().for_each(|p| *p += Vec3::new(5000.0, 0.1, -900.0));
    let mut near = far.clone();
    near.recentre();
    assert!(near.origin.x > 4000.0 && near.origin.y == 0.0 && near.origin.z < -800.0, "{}", near.origin);
    for format in DeltaFormat::ALL {
        let desc = PackDesc::new(format);
        let mut mesh = PackedMesh::pack(&far, &desc).unwrap();
        mesh.recentre();
        assert_eq!((&mesh, mesh.layout().origin), (&PackedMesh::pack(&near, &desc).unwrap(), near.origin));
        let packed = PackedMesh::pack(&near, &desc).unwrap();
        let Ok(bytes) = packed.to_bytes() else { continue };
        assert_eq!(bytes, PackedMesh::pack(&far, &desc).unwrap().to_bytes().unwrap());
        let mut again = read(&bytes).unwrap();
        assert_eq!((again.layout().origin, &again.unpack().unwrap().positions), (Vec3::ZERO, &far.positions));
        again.recentre();
        assert_eq!(again, packed);
        let decoded = again.unpack().unwrap();
        assert_eq!((decoded.origin, decoded.positions), (near.origin, near.positions.clone()));
    }
    // Near 0 recentring changes nothing.
    let (plain, mut mesh) = (mesh(70, 4), mesh(70, 4));
    mesh.recentre();
    assert_eq!((mesh.origin, mesh.positions), (Vec3::ZERO, plain.positions));
}

#[test]
fn what_was_packed_comes_back() {
    for format in DeltaFormat::BLOCKS {
        let streams = with_streams(format);
        assert_eq!(streams.groups().len(), 3);
        for packed in BLOCK_SIZES.map(|size| packed(format, Some(size))).into_iter().chain([streams]) {
            let bytes = packed.to_bytes().unwrap();
            assert_eq!(read(&bytes).unwrap(), packed, "{format:?}");
            assert_eq!(read(&bytes).unwrap().to_bytes().unwrap(), bytes);
        }
    }
    // Without targets, faces and texture coordinates.
    let plain = KeptMesh { texcoords: vec![], faces: Faces::default(), ..mesh(1, 0) };
    let packed = PackedMesh::pack(&plain, &PackDesc::new(DeltaFormat::Small)).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("plain.dmorph");
    packed.write(&path).unwrap();
    assert_eq!(PackedMesh::read(&path).unwrap(), packed);
    assert!(PackedMesh::read(dir.path().join("none")).unwrap_err().to_string().contains("cannot read"));
}

/// The built-in head, split at its seam.
fn split_head(format: DeltaFormat) -> (KeptMesh, PackedMesh) {
    let mesh = testing::head(&HeadDesc { vertices: 300, targets: 6, ..Default::default() })
        .split()
        .unwrap()
        .kept(Tolerance::default())
        .unwrap();
    let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap();
    (mesh, packed)
}

#[test]
fn a_packed_mesh_knows_which_vertices_are_doubled() {
    for format in DeltaFormat::BLOCKS {
        let (mesh, packed) = split_head(format);
        let back = read(&packed.to_bytes().unwrap()).unwrap();
        assert!(mesh.welds.len() > 300 && back == packed);
        let decoded = back.unpack().unwrap();
        assert_eq!((&decoded.welds, &decoded.faces), (&mesh.welds, &mesh.faces));
        // Packing it again keeps duplicated vertices in one block.
        let again = PackedMesh::pack(&decoded, &PackDesc::new(format)).unwrap();
        for mesh in [&packed, &again] {
            let index = mesh.layout().index().unwrap();
            let at = index.packed_vertices();
            let block = |v: usize| at[v] as usize / index.size();
            assert!((0..at.len()).all(|v| block(v) == block(decoded.welds[v] as usize)), "{format:?}");
        }
        // `small` orders them by the deltas, which it has rounded.
        assert!(format == DeltaFormat::Small || again.base() == packed.base(), "{format:?}");
    }
}

#[test]
fn the_decoded_mesh_is_in_the_users_order() {
    let exact = mesh(70, 4);
    for format in DeltaFormat::BLOCKS {
        let packed = packed(format, None);
        let decoded = packed.unpack().unwrap();
        assert_eq!((&decoded.positions, &decoded.normals), (&exact.positions, &exact.normals));
        assert_eq!((&decoded.faces, decoded.diagonal), (&exact.faces, exact.diagonal));
        assert_eq!(decoded.tolerance, exact.tolerance);
        for (t, target) in decoded.targets.iter().enumerate() {
            assert!(target.vertices.is_sorted_by(|a, b| a < b));
            assert_eq!(target.vertices, exact.targets[t].vertices);
        }
        // Exactly the packing error.
        assert_eq!(packed.measure_error(&decoded).position, 0.0);
        let packed = with_streams(format);
        let decoded = packed.unpack().unwrap();
        assert_eq!(decoded.streams, testing::with_streams(mesh(70, 4)).streams);
        assert!(decoded.targets.iter().all(|t| t.streams.len() == 4));
        let lost = packed.measure_error(&decoded);
        assert!(lost.position == 0.0 && lost.absolute == 0.0 && lost.within(0.0, 1e-5), "{lost:?}");
    }
}

#[test]
fn what_a_file_cannot_hold_is_refused() {
    for format in DeltaFormat::DENSE {
        let dense = PackedMesh::pack(&mesh(70, 2), &PackDesc::new(format)).unwrap();
        testing::says(dense.to_bytes(), &["has no blocks", "pack it in a block format"]);
    }
    let good = packed(DeltaFormat::Small, None);
    let empty = KeptMesh { faces: Faces::default(), ..mesh(0, 1) };
    let empty = PackedMesh::pack(&empty, &PackDesc::new(DeltaFormat::Fast)).unwrap();
    let faces = Faces { sizes: vec![3], corners: vec![Corner { position: 70, texcoord: None }; 3] };
    for (bad, part) in [
        (PackedMesh { faces, ..good.clone() }, "vertex 70"),
        (PackedMesh { texcoords: vec![], ..good.clone() }, "texture coordinate 1"),
        (PackedMesh { texcoords: vec![Vec2::NAN; 2], ..good.clone() }, "texture coordinate 0"),
        (PackedMesh { welds: vec![0; 69], ..good.clone() }, "69 welds for 70 vertices"),
        (PackedMesh { welds: vec![1; 70], ..good.clone() }, "vertex 0 is welded to vertex 1"),
        (PackedMesh { tolerance: Tolerance { position: -1.0, normal: 0.0 }, ..good.clone() }, "tolerances of -1"),
        (empty, "no vertex"),
    ] {
        testing::says(bad.to_bytes(), &[part]);
    }
}
