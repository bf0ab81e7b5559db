//! Packed files round-trip.

mod hostile;

use super::*;
use crate::asset::Corner;
use crate::pack::DeltaFormat;
use crate::pack::blocks::{BLOCK_SIZES, BlockDesc};
use crate::testing;
use deltamorph_head::HeadDesc;
use glam::Vec3;

fn mesh(vertices: usize, targets: usize) -> MorphMesh {
    let corner = |position, texcoord| Corner { position, texcoord };
    let corners = [corner(0, Some(1)), corner(1, None), corner(2, Some(0)), corner(2, None)];
    MorphMesh {
        faces: Faces { sizes: vec![4, 3], corners: [&corners[..], &corners[..3]].concat() },
        texcoords: vec![Vec2::new(0.25, 0.5), Vec2::new(-0.0, 1.0)],
        tolerance: Tolerance::default(),
        ..testing::mesh(vertices, targets)
    }
}

fn asset(format: DeltaFormat, size: Option<u32>) -> Asset {
    let blocks = BlockDesc { size, ..BlockDesc::default() };
    Asset::pack(&mesh(70, 4), &PackDesc { blocks, ..PackDesc::new(format) }).unwrap()
}

/// With tangents and texture coordinates, and colours and masks in a third group.
fn with_streams(format: DeltaFormat) -> Asset {
    Asset::pack(&testing::with_streams(mesh(70, 4)), &PackDesc::new(format)).unwrap()
}

/// Reads a file, asserting memory use in a small multiple of its size. Names are the worst case: empty ones take 4
/// bytes.
fn read(bytes: &[u8]) -> Result<Asset> {
    let mut result = None;
    let memory = allocation_counter::measure(|| result = Some(Asset::from_bytes(Path::new("head.dmorph"), bytes)));
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
        let Ok(asset) = Asset::pack(&near, &desc) else { continue };
        let bytes = asset.to_bytes().unwrap();
        assert_eq!(bytes, Asset::pack(&far, &desc).unwrap().to_bytes().unwrap());
        let mut again = read(&bytes).unwrap();
        assert_eq!((again.mesh.layout().origin, &again.to_mesh().unwrap().positions), (Vec3::ZERO, &far.positions));
        again.mesh.recentre();
        assert_eq!(again, asset);
        let decoded = again.to_mesh().unwrap();
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
        assert_eq!(streams.mesh.groups().len(), 3);
        for asset in BLOCK_SIZES.map(|size| asset(format, Some(size))).into_iter().chain([streams]) {
            let bytes = asset.to_bytes().unwrap();
            assert_eq!(read(&bytes).unwrap(), asset, "{format:?}");
            assert_eq!(read(&bytes).unwrap().to_bytes().unwrap(), bytes);
        }
    }
    // Without targets, faces and texture coordinates.
    let plain = MorphMesh { texcoords: vec![], faces: Faces::default(), ..mesh(1, 0) };
    let asset = Asset::pack(&plain, &PackDesc::new(DeltaFormat::Small)).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("plain.dmorph");
    asset.write(&path).unwrap();
    assert_eq!(Asset::read(&path).unwrap(), asset);
    assert!(Asset::read(&dir.path().join("none")).unwrap_err().to_string().contains("cannot read"));
}

/// The built-in head, split at its seam.
fn split_head(format: DeltaFormat) -> (MorphMesh, Asset) {
    let mesh = testing::head(&HeadDesc { vertices: 300, targets: 6, ..Default::default() })
        .split()
        .unwrap()
        .to_mesh(Tolerance::default())
        .unwrap();
    let asset = Asset::pack(&mesh, &PackDesc::new(format)).unwrap();
    (mesh, asset)
}

#[test]
fn a_packed_mesh_knows_which_vertices_are_doubled() {
    for format in DeltaFormat::BLOCKS {
        let (mesh, asset) = split_head(format);
        let back = read(&asset.to_bytes().unwrap()).unwrap();
        assert!(mesh.welds.len() > 300 && back == asset);
        let decoded = back.to_mesh().unwrap();
        assert_eq!((&decoded.welds, &decoded.faces), (&mesh.welds, &mesh.faces));
        // Packing it again keeps duplicated vertices in one block.
        let again = Asset::pack(&decoded, &PackDesc::new(format)).unwrap();
        for mesh in [&asset.mesh, &again.mesh] {
            let index = mesh.layout().index().unwrap();
            let at = index.packed_vertices();
            let block = |v: usize| at[v] as usize / index.size();
            assert!((0..at.len()).all(|v| block(v) == block(decoded.welds[v] as usize)), "{format:?}");
        }
        // `small` orders them by the deltas, which it has rounded.
        assert!(format == DeltaFormat::Small || again.mesh.base() == asset.mesh.base(), "{format:?}");
    }
}

#[test]
fn the_decoded_mesh_is_in_the_users_order() {
    let exact = mesh(70, 4);
    for format in DeltaFormat::BLOCKS {
        let asset = asset(format, None);
        let decoded = asset.to_mesh().unwrap();
        assert_eq!((&decoded.positions, &decoded.normals), (&exact.positions, &exact.normals));
        assert_eq!((&decoded.faces, decoded.diagonal), (&exact.faces, exact.diagonal));
        assert_eq!(decoded.tolerance, exact.tolerance);
        for (t, target) in decoded.targets.iter().enumerate() {
            assert!(target.vertices.is_sorted_by(|a, b| a < b));
            assert_eq!(target.vertices, exact.targets[t].vertices);
        }
        // Exactly the packing error.
        assert_eq!(asset.mesh.measure_error(&decoded).position, 0.0);
        let asset = with_streams(format);
        let decoded = asset.to_mesh().unwrap();
        assert_eq!(decoded.streams, testing::with_streams(mesh(70, 4)).streams);
        assert!(decoded.targets.iter().all(|t| t.streams.len() == 4));
        let lost = asset.mesh.measure_error(&decoded);
        assert!(lost.position == 0.0 && lost.absolute == 0.0 && lost.within(0.0, 1e-5), "{lost:?}");
    }
}

#[test]
fn what_a_file_cannot_hold_is_refused() {
    for format in DeltaFormat::DENSE {
        testing::says(Asset::pack(&mesh(70, 2), &PackDesc::new(format)), &[format.name(), "pack as 'fast' or 'small'"]);
    }
    let welded = MorphMesh { welds: vec![70; 70], ..mesh(70, 2) };
    testing::says(Asset::pack(&welded, &PackDesc::new(DeltaFormat::Small)), &["vertex 0 is welded to vertex 70"]);
    let good = asset(DeltaFormat::Small, None);
    let empty = MorphMesh { faces: Faces::default(), ..mesh(0, 1) };
    let empty = PackedMesh::pack(&empty, &PackDesc::new(DeltaFormat::Fast)).unwrap();
    let faces = Faces { sizes: vec![3], corners: vec![Corner { position: 70, texcoord: None }; 3] };
    for (bad, part) in [
        (Asset { faces, ..good.clone() }, "vertex 70"),
        (Asset { texcoords: vec![], ..good.clone() }, "texture coordinate 1"),
        (Asset { texcoords: vec![Vec2::NAN; 2], ..good.clone() }, "texture coordinate 0"),
        (Asset { welds: vec![0; 69], ..good.clone() }, "69 welds for 70 vertices"),
        (Asset { welds: vec![1; 70], ..good.clone() }, "vertex 0 is welded to vertex 1"),
        (Asset { tolerance: Tolerance { position: -1.0, normal: 0.0 }, ..good.clone() }, "tolerances of -1"),
        (Asset { mesh: empty, ..good.clone() }, "no vertex"),
    ] {
        testing::says(bad.to_bytes(), &[part]);
    }
}
