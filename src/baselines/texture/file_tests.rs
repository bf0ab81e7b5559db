use super::*;
use crate::pack::PackDesc;
use crate::testing;

fn written(mesh: &MorphMesh, floats: TextureFloats) -> Vec<u8> {
    let packed = PackedMesh::pack(mesh, &PackDesc::new(DeltaFormat::Float32)).expect("a mesh");
    write_ktx2(&packed, floats).expect("a file")
}

fn read(bytes: &[u8], base: &MorphMesh) -> Vec<MorphTarget> {
    targets(bytes, base).expect("a file of the mesh")
}

/// Six numbers of each vertex in each group and target, as packed.
fn deltas(mesh: &MorphMesh) -> Vec<u32> {
    let packed = PackedMesh::pack(mesh, &PackDesc::new(DeltaFormat::Float32)).expect("a mesh");
    packed.groups().iter().flat_map(|group| group.deltas().to_vec()).collect()
}

#[test]
fn float32_comes_back_bit_for_bit_and_half_floats_within_their_bound() {
    for mesh in [testing::mesh(300, 7), testing::with_streams(testing::mesh(300, 7))] {
        let expected = deltas(&mesh);
        let single = MorphMesh { targets: read(&written(&mesh, TextureFloats::Single), &mesh), ..mesh.clone() };
        assert_eq!(deltas(&single), expected);
        assert!(single.targets.iter().zip(&mesh.targets).all(|(a, b)| a.name == b.name));

        let half = MorphMesh { targets: read(&written(&mesh, TextureFloats::Half), &mesh), ..mesh.clone() };
        let found = deltas(&half);
        assert_ne!(found, expected, "some are rounded");
        for (found, expected) in found.iter().zip(&expected) {
            let [found, expected] = [found, expected].map(|bits| f64::from(f32::from_bits(*bits)));
            let bound = (expected.abs() / 2048.0).max(2f64.powi(-25));
            assert!((found - expected).abs() <= bound, "{found} for {expected}");
        }
    }
}

#[test]
fn the_container_is_as_the_specification_says() {
    for (floats, format, texel) in [(TextureFloats::Single, 109, 16), (TextureFloats::Half, 97, 8)] {
        let file = written(&testing::mesh(50, 4), floats);
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes"));
        assert_eq!(&file[..12], b"\xABKTX 20\xBB\r\n\x1A\n");
        assert_eq!(
            [word(12), word(16), word(28), word(32), word(36), word(40), word(44)],
            [format, texel / 4, 0, 2, 1, 1, 0]
        );
        assert_eq!([word(48), word(52), word(104)], [104, 92, 92], "the data format descriptor");
        assert_eq!(word(56) % 4 + word(80) % texel, 0, "keys and texels are aligned");
        assert_eq!(word(80) + word(88), file.len() as u32);
        assert_eq!(word(88), word(20) * word(24) * 2 * texel);
        let keys = Container::read(&file).expect("a file").values;
        assert!(keys.is_sorted_by(|a, b| a.0 < b.0) && keys[0].1.ends_with(&[0]));
    }
}

/// Headers, descriptors, keys and texels as a reader has them that is not ours.
#[test]
fn others_read_what_is_written() {
    let mesh = testing::with_streams(testing::mesh(300, 7));
    for (floats, format) in [
        (TextureFloats::Single, ktx2::Format::R32G32B32A32_SFLOAT),
        (TextureFloats::Half, ktx2::Format::R16G16B16A16_SFLOAT),
    ] {
        let file = written(&mesh, floats);
        let (ours, reader) =
            (Container::read(&file).expect("a file"), ktx2::Reader::new(&file[..]).expect("a KTX2 file"));
        let (descriptor, type_size) = ktx2::dfd::Basic::from_format(format).expect("a descriptor");
        let header = reader.header();
        assert_eq!((header.format, header.type_size, header.supercompression_scheme), (Some(format), type_size, None));
        assert_eq!(
            [header.pixel_width, header.pixel_height, header.layer_count],
            [ours.size[0], ours.size[1], ours.layers]
        );
        assert_eq!([header.pixel_depth, header.face_count, header.level_count], [0, 1, 1]);
        assert_eq!(reader.basic_dfd(), Some(&descriptor));
        assert!(reader.writer().is_some_and(|writer| writer.starts_with("deltamorph")));
        assert!(reader.key_value_data().eq(ours.values.iter().copied()));
        let levels: Vec<_> = reader.levels().collect();
        assert!(levels.len() == 1 && levels[0].data == ours.texels);
        assert_eq!(levels[0].uncompressed_byte_length, ours.texels.len() as u64);
    }
}

/// A key that states more targets than there may be takes no memory for them.
#[test]
fn names_without_end_are_refused() {
    let mesh = testing::mesh(12, 3);
    let file = written(&mesh, TextureFloats::Single);
    let file = Container::read(&file).expect("a file");
    let names = b"a\0".repeat(70_000);
    let mut texels = file.value(TEXELS).expect("texels").to_vec();
    texels[8..12].copy_from_slice(&70_000u32.to_le_bytes());
    let values = vec![WRITER, (NAMES, &names), (TEXELS, &texels)];
    let (_, what, _) = targets(&Container { values, ..file }.write(), &mesh).expect_err("too many");
    assert_eq!(what, "not one name for each target, or more than 65536");
}

#[test]
fn what_is_cut_or_changed_is_refused_or_read_and_never_panics() {
    let mesh = testing::mesh(12, 3);
    let file = written(&mesh, TextureFloats::Half);
    for length in 0..file.len() {
        assert!(targets(&file[..length], &mesh).is_err(), "cut to {length} bytes");
    }
    let mut refused = 0;
    for at in 0..file.len() {
        for change in [0x01, 0x80, 0xff] {
            let mut changed = file.clone();
            changed[at] ^= change;
            refused += usize::from(targets(&changed, &mesh).is_err());
        }
    }
    assert!(refused > 300, "{refused} of {} changes", 3 * file.len());
}

#[test]
fn errors_name_the_file_the_place_and_the_remedy() {
    let mesh = testing::mesh(12, 3);
    let file = written(&mesh, TextureFloats::Single);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("face.ktx2");
    let refused = |bytes: &[u8], base: &MorphMesh| {
        std::fs::write(&path, bytes).expect("a file");
        read_ktx2(&path, base).expect_err("refused").to_string()
    };
    let text = refused(&file, &testing::mesh(13, 3));
    assert!(text.contains("face.ktx2: key 'deltamorph.texels'") && text.contains("12 vertices"), "{text}");
    let texels = u32::from_le_bytes(file[80..84].try_into().expect("four bytes")) as usize;
    let mut changed = file.clone();
    changed[texels..texels + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let text = refused(&changed, &mesh);
    assert!(text.contains(": texels") && text.contains("NaN") && text.contains("replace"), "{text}");
    let mut changed = file;
    changed[12] = 37;
    let text = refused(&changed, &mesh);
    assert!(text.contains(": header") && text.contains("VkFormat 37") && text.contains("R16G16B16A16"), "{text}");

    let mut large = mesh;
    large.targets[0].positions[0].x = 65505.0;
    let packed = PackedMesh::pack(&large, &PackDesc::new(DeltaFormat::Float32)).expect("a mesh");
    let text = write_ktx2(&packed, TextureFloats::Half).expect_err("too large").to_string();
    assert!(text.contains("65505") && text.contains("32-bit"), "{text}");
}
