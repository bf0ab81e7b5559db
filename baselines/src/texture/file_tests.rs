use super::*;
use deltamorph::internals::pack::PackDesc;
use deltamorph::testing;

fn written(mesh: &MorphMesh, floats: TextureFloats) -> Vec<u8> {
    let packed = PackedMesh::pack(mesh, &PackDesc::new(DeltaFormat::Float32)).expect("a mesh");
    write_ktx2(&packed, floats).expect("a file").bytes
}

fn read(bytes: &[u8], base: &MorphMesh) -> Vec<MorphTarget> {
    targets(bytes, base).expect("a file of the mesh")
}

/// The six numbers of each vertex in each group and target, as packed.
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
        assert_eq!(word(56), 104 + 92, "keys follow the descriptor");
        assert_eq!((TEXELS.len() + 1) % 4, 0, "its numbers are aligned");
        let header = [0, 2 | 88 << 16, 0x01_01_01, 0, texel, 0];
        assert_eq!(std::array::from_fn(|i| word(108 + 4 * i)), header, "vendor, size, colours, block, bytes of planes");
        for (sample, channel) in [0, 1, 2, 15].into_iter().enumerate() {
            let at = 108 + 24 + 16 * sample;
            let bits = texel * 2;
            let first = (sample as u32 * bits) | ((bits - 1) << 16) | ((0xc0 | channel) << 24);
            assert_eq!([0, 4, 8, 12].map(|i| word(at + i)), [first, 0, 0xBF80_0000, 0x3F80_0000], "sample {sample}");
        }
        let keys = Container::read(&file).expect("a file").values;
        assert!(keys.is_sorted_by(|a, b| a.0 < b.0) && keys[0].1.ends_with(&[0]));
    }
}

/// Another implementation reads headers, descriptors, keys and texels.
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

#[test]
fn streams_have_the_numbers_that_the_module_states() {
    let streams = [Semantic::Position, Semantic::Normal, Semantic::Tangent, Semantic::Mask];
    assert_eq!(streams.map(kind), [0, 1, 2, 768]);
    assert_eq!([0, 3, 255].map(|set| kind(Semantic::TexCoord(set))), [256, 259, 511]);
    assert_eq!([0, 3, 255].map(|set| kind(Semantic::Color(set))), [512, 515, 767]);
}

#[test]
fn wrinkle_masks_are_a_stream_like_others() {
    let mut mesh = testing::with_streams(testing::mesh(60, 4));
    let at = mesh.streams.iter().position(|s| s.semantic == Semantic::Mask).expect("masks");
    mesh.streams = vec![mesh.streams.swap_remove(at)];
    mesh.targets.iter_mut().for_each(|target| target.streams = vec![target.streams.swap_remove(at)]);
    let found = read(&written(&mesh, TextureFloats::Single), &mesh);
    for (found, expected) in found.iter().zip(&mesh.targets) {
        assert_eq!(found.streams, expected.streams, "{}", expected.name);
    }
    assert!(found.iter().any(|target| !target.streams[0].vertices.is_empty()), "some move them");
    let file = written(&mesh, TextureFloats::Single);
    let words = Container::read(&file).expect("a file").value(TEXELS).expect("the key").to_vec();
    assert!(words.as_chunks().0.contains(&768u32.to_le_bytes()), "as the module says");

    let without = targets(&file, &testing::mesh(60, 4)).expect_err("no such stream");
    assert!(without.1.contains("2 groups"), "{without:?}");
}

/// Returns the file with the values of its two keys changed by `change`.
fn forged(file: &[u8], change: impl FnOnce(&mut Vec<u8>, &mut Vec<u8>)) -> Vec<u8> {
    let mut held = Container::read(file).expect("a file");
    let [mut names, mut words] = [NAMES, TEXELS].map(|key| held.value(key).expect("the key").to_vec());
    change(&mut names, &mut words);
    held.values = vec![(NAMES, &names[..]), (TEXELS, &words[..])];
    held.write()
}

#[test]
fn numbers_that_lie_are_refused_before_memory_is_taken_for_them() {
    let mesh = testing::with_streams(testing::mesh(12, 3));
    let file = written(&mesh, TextureFloats::Half);
    let put = |words: &mut Vec<u8>, at: usize, number: u32| {
        words[4 * at..4 * at + 4].copy_from_slice(&number.to_le_bytes());
    };
    let refused = |file: &[u8]| targets(file, &mesh).expect_err("refused").1;
    // Names are one byte each, as many as stated, but more than a mesh may have: 30 MB of file would make 16 GB of
    // targets.
    let many = 30_000_000;
    let text = refused(&forged(&file, |names, words| {
        *names = vec![0; many];
        put(words, 2, many as u32);
    }));
    assert!(text.contains("30000000 targets") && text.contains("65536"), "{text}");
    let text = refused(&forged(&file, |names, _| *names = vec![0; many]));
    assert!(text.contains("one name for each target"), "{text}");
    // A count without data in the file.
    for count in [u32::MAX, 1 << 16, 4] {
        assert!(targets(&forged(&file, |_, words| put(words, 2, count)), &mesh).is_err(), "{count}");
    }
    // Streams of group 0 take five words after the head, then two for the size; then rectangles by target.
    let text = refused(&forged(&file, |_, words| put(words, 4 + 5 + 2 + 3, u32::MAX)));
    assert!(text.contains("the list ends early"), "{text}");
    let text = refused(&forged(&file, |_, words| {
        put(words, 4 + 5, u32::MAX);
        put(words, 4 + 5 + 2 + 4 + 2, u32::MAX);
    }));
    assert!(text.contains("rectangle 0") && text.contains("outside"), "{text}");
    // The header names more texels than the file has.
    let mut large = file.clone();
    large[20..28].copy_from_slice(&[0xff; 8]);
    assert!(refused(&large).contains("expected"));
    assert!(targets(&forged(&file, |_, _| {}), &mesh).is_ok(), "what is forged is refused for what was changed");
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
    assert!(text.contains("face.ktx2: key 'deltamorph.textures'") && text.contains("12 vertices"), "{text}");
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
