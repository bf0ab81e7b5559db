//! Hostile files: reading any bytes succeeds or returns an error that names the fault; it never panics.

use super::*;
use crate::pack::file::table::*;

/// Byte offset of a section's table row.
fn row(bytes: &[u8], place: (Section, usize)) -> usize {
    let places = places(u32_at(bytes, 8).unwrap(), u32_at(bytes, 12).unwrap() as usize).unwrap();
    16 + 24 * places.iter().position(|p| *p == place).unwrap()
}

/// Byte offset and length of the section whose table row is at `row`.
fn span_at(bytes: &[u8], row: usize) -> (usize, usize) {
    let long = |at: usize| u64::from_le_bytes(bytes[row + at..row + at + 8].try_into().unwrap()) as usize;
    (long(8), long(16))
}

fn span(bytes: &[u8], section: Section) -> (usize, usize) {
    span_at(bytes, row(bytes, (section, 0)))
}

/// Asserts what is said of the file of `packed` with one word of a section replaced and checksums repaired.
fn assert_says(packed: &PackedMesh, place: (Section, usize), word: usize, value: u32, part: &str) {
    let mut bytes = packed.to_bytes().unwrap();
    let at = span_at(&bytes, row(&bytes, place)).0 + 4 * word;
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    repair(&mut bytes);
    let text = message(&bytes);
    assert!(text.contains(part), "{place:?} {word} {value:#x}: {text}");
}

#[test]
fn a_file_that_ends_early_and_every_flipped_bit_are_noticed() {
    let whole = packed(DeltaFormat::Fast, None).to_bytes().unwrap();
    for at in 0..whole.len() {
        let text = message(&whole[..at]);
        assert!(at < 8 || text.contains("damaged"), "{text}");
        let mut flipped = whole.clone();
        flipped[at] ^= 1 << (at % 8);
        message(&flipped);
    }
    assert!(message(&[&whole[..], &[0; 8]].concat()).contains("8 bytes after the last section"));
}

#[test]
fn the_frame_is_checked_under_valid_checksums() {
    let bytes = packed(DeltaFormat::Small, None).to_bytes().unwrap();
    let change = |at: usize, with: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[at..at + with.len()].copy_from_slice(with);
        repair(&mut bytes);
        message(&bytes)
    };
    let row = |section| row(&bytes, (section, 0));
    let (order, length) = span(&bytes, ORDER);
    let (words, _) = span(&bytes, WORDS);
    for (text, parts) in [
        (change(0, b"PK"), ["does not begin", "deltamorph pack"]),
        (change(6, b"\n"), ["does not begin", "deltamorph pack"]),
        (change(8, &[5]), ["version 5", "reads versions 6 and 7"]),
        (change(8, &[7]), ["13 sections", "version 7"]),
        (change(12, &[12]), ["12 sections", "version 6"]),
        (change(12, &[7]), ["7 sections", "version 6"]),
        (change(row(WORDS) + 8, &(words as u64 - 8).to_le_bytes()), ["'words'", "expected"]),
        (change(row(WORDS) + 8, &u64::MAX.to_le_bytes()), ["'words'", "expected"]),
        (change(row(META) + 16, &[45]), ["'meta'", "has 45 bytes, 44 expected"]),
        (change(row(ORDER), &[9]), ["'order'", "with id 9"]),
        (change(row(ORDER) + 16, &[0xff; 8]), ["'order'", "18446744073709551615 bytes"]),
        (change(row(ORDER) + 16, &(length as u64 - 8).to_le_bytes()), ["'face sizes'", "lies at"]),
        (change(row(ORDER) + 16, &(length as u64 - 4).to_le_bytes()), ["'order'", ""]),
    ] {
        assert!(parts.iter().all(|p| text.contains(p)), "{text}");
    }
    // Without repaired checksums.
    for (at, part) in [(order, "'order': the checksum"), (20, "the checksum of its header")] {
        let mut bytes = bytes.clone();
        bytes[at] ^= 1;
        assert!(message(&bytes).contains(part));
    }
}

#[test]
fn contents_are_checked_under_valid_checksums() {
    let [small, fast] = [DeltaFormat::Small, DeltaFormat::Fast].map(|format| packed(format, None));
    let (nan, inf) = (f32::NAN.to_bits(), f32::INFINITY.to_bits());
    let giant = u32::MAX;
    let entries = small.layout().blocks.as_ref().unwrap().entry_count();
    let headers = entries * 3; // words of small headers
    for (packed, section, word, value, part) in [
        (&small, META, 0, 7, "'meta': names a format 7 that"),
        (&small, META, 1, 48, "a block size of 48"),
        (&small, META, 1, 64, "blocks"),
        (&small, META, 2, giant, "'order': has 280 bytes; 4294967295 vertices take 17179869180"),
        (&small, META, 3, giant, "'meta': names 4294967295 targets"),
        (&small, META, 3, 60_000, "'names': ends within a number, at the name of target"),
        (&small, META, 3, 3, "bytes after the last name"),
        (&small, META, 4, giant, "'face sizes': has"),
        (&small, META, 5, giant, "'face corners': has"),
        (&small, META, 6, giant, "'texcoords': has"),
        (&small, META, 7, nan, "a diagonal of NaN"),
        (&small, META, 7, (-1f32).to_bits(), "a diagonal of -1"),
        (&small, META, 8, inf, "weights up to inf"),
        (&small, META, 9, nan, "tolerances of NaN"),
        (&small, GROUP, 0, giant, "'group': has 56 bytes, 68719476744 expected"),
        (&small, GROUP, 0, 1, "'group': has 56 bytes, 40 expected"),
        (&small, GROUP, 1, giant, "'first entries': has"),
        (&small, GROUP, 2, giant, "'entry targets': has"),
        (&small, GROUP, 3, giant, "'words': has"),
        (&small, GROUP, 4, nan, "a step of NaN"),
        (&small, GROUP, 5, 3f32.to_bits(), "a step of 3"),
        (&small, GROUP, 5, f32::MIN_POSITIVE.to_bits() >> 1, "no power of two"),
        (&small, GROUP, 5, 2f32.powi(127).to_bits(), "entry 0 has numbers up to"),
        (&small, GROUP, 4, 2f32.powi(120).to_bits(), "too large for single precision"),
        (&small, GROUP, 6, 7, "'group': names a stream 0x7"),
        (&small, GROUP, 6, 0x106, "'group': names a stream 0x106"),
        (&small, GROUP, 6, 6, "'group': holds other streams"),
        (&small, GROUP, 6, 0x101, "'group': names a stream 0x101"),
        (&small, GROUP, 6, 0x1_0004, "'group': names a stream 0x10004"),
        (&small, GROUP, 6, 2, "'group': holds other streams"),
        (&small, GROUP, 10, 0x104, "'group': holds other streams"),
        (&small, GROUP, 7, 1, "'group': names a stream"),
        (&small, GROUP, 9, giant, "'group': names an error of NaN"),
        (&small, NAMES, 0, giant, "'names': ends within a name of 4294967295 bytes, at the name of the mesh"),
        (&small, NAMES, 1, giant, "'names': has a name that is not UTF-8, at the name of the mesh"),
        (&small, BASE, 7, nan, "the base pose of packed vertex 1 is NaN"),
        (&small, BASE, 3, inf, "the base pose of packed vertex 0 is inf"),
        (&small, ORDER, 5, 70, "vertex 70 comes twice in the order, or is not there"),
        (&small, FIRST_ENTRIES, 0, 1, "the entries of blocks overlap or leave gaps"),
        (&small, FIRST_ENTRIES, 1, giant, "the entries of blocks overlap or leave gaps"),
        (&small, ENTRY_TARGETS, 0, 65_535, "the targets of block 0"),
        (&small, ENTRY_TARGETS, 1, 0, "the targets of block 0"),
        (&small, WORDS, 0, giant, "the deltas of entry 0"),
        (&small, WORDS, 3, 0, "the deltas of entry 1"),
        (&small, WORDS, 1, giant, "entry 0 has components of [31"),
        (&small, WORDS, 1, 1 << 30, "entry 0 has components of [0"),
        (&small, WORDS, 2, 1 << 31, "entry 0 has components of ["),
        (&small, WORDS, 2, 15 | 15 << 10, "entry 0 has components of ["),
        (&small, WORDS, headers - 2, 0, "words where the entries take"),
        (&fast, WORDS, 0, 18, "entry 0 has shifts of 0x12"),
        (&fast, WORDS, 0, 24 << 8, "entry 0 has shifts of 0x1800"),
        (&fast, WORDS, 0, 1 << 16, "entry 0 has shifts of 0x10000"),
        (&fast, WORDS, 1, 17 << 16, "entry 1 has shifts"),
        (&fast, FACES, 0, 3, "the faces have 6 corners, the corner list has 7"),
        (&fast, FACES, 0, giant, "corners, the corner list has 7"),
        (&fast, CORNERS, 0, 70, "vertex 70, there are 70"),
        (&fast, CORNER_TEXCOORDS, 0, 2, "texture coordinate 2, there are 2"),
        (&fast, TEXCOORDS, 3, inf, "texture coordinate 1 is"),
    ] {
        assert_says(packed, (section, 0), word, value, part);
    }
    // A mask with more vertices than records, or fewer.
    let words = small.surface().deltas();
    let masked = (0..entries - 1).find(|entry| words[3 * entry + 1] >> 31 == 1).expect("an entry with a mask");
    let mask = headers.next_multiple_of(4) + words[3 * masked] as usize;
    for value in [0, giant] {
        let part = format!("the deltas of entry {} are not where they belong", masked + 1);
        assert_says(&small, (WORDS, 0), mask, value, &part);
    }
    // Deltas of vertices that do not exist: the second block of 64 has 6.
    let last_entry = span(&fast.to_bytes().unwrap(), WORDS).1 / 4 - 64 * 9 / 4;
    let part = "block 1 moves vertices that the mesh does not have";
    assert_says(&fast, (WORDS, 0), last_entry + 60, 1, part);
    let streams = with_streams(DeltaFormat::Fast);
    for (place, word, value, part) in [
        ((GROUP, 1), 0, 3, "'group' of group 1: has"),
        ((GROUP, 1), 6, 4, "'group' of group 1: holds other streams"),
        ((GROUP, 2), 6, 4, "holds other streams"),
        ((GROUP, 2), 9, giant, "'group' of group 2: names an error"),
        ((BASE, 1), 3, nan, "the blocks of group 1 do not fit together: the base pose"),
        ((WORDS, 2), 0, 24 << 8, "the blocks of group 2 do not fit together: entry 0 has shifts"),
        ((GROUP, 1), 4, 2f32.powi(120).to_bits(), "entry 0 has numbers up to"),
        ((ENTRY_TARGETS, 2), 0, 65_535, "the blocks of group 2 do not fit together: the targets of block 0"),
    ] {
        assert_says(&streams, place, word, value, part);
    }
    // Numbers that are all 0, shifted.
    let mut still = mesh(70, 4);
    still.targets.iter_mut().for_each(|target| target.normals.fill(Vec3::ZERO));
    let still = PackedMesh::pack(&still, &PackDesc::new(DeltaFormat::Fast)).unwrap();
    assert_says(&still, (WORDS, 0), 0, 1 << 8, "entry 0 shifts numbers that are all 0");
    // Welds to a later vertex, to a welded one, out of range; too few of them.
    let (mesh, split) = split_head(DeltaFormat::Fast);
    let (doubled, of) = (mesh.welds.len() - 1, mesh.welds[mesh.welds.len() - 1]);
    for (vertex, value, to) in [(0, of, of), (of as usize, 0, of), (5, giant, giant), (doubled, 300, 300)] {
        let part = format!("is welded to vertex {to}, which is not the first at its position");
        assert_says(&split, (WELDS, 0), vertex, value, &part);
    }
    assert_says(&split, (META, 0), 2, 300, "300 vertices take");
    // Two targets of one name.
    let mut bytes = small.to_bytes().unwrap();
    let (at, length) = span(&bytes, NAMES);
    let end = at + length;
    assert_eq!(&bytes[end - 8..end], b"target_3");
    bytes[end - 1] = b'2';
    repair(&mut bytes);
    assert!(message(&bytes).contains("two targets are called 'target_2'"));
}
