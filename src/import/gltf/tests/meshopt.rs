//! The decoders of KHR_meshopt_compression and EXT_meshopt_compression against the encoders of meshoptimizer.
//! fuzz/src/targets/meshopt.rs compares attributes without a filter with its decoder.

use super::super::meshopt::decode;
use super::written::bytes;
use proptest::prelude::*;

fn encoded<const N: usize>(bytes: &[u8], version: u32) -> Vec<u8>
where
    [u8; N]: bytemuck::Pod,
{
    let elements: &[[u8; N]] = bytemuck::cast_slice(bytes);
    ::meshopt::encode_vertex_buffer_level(elements, 3, Some(version as i32)).unwrap()
}

/// A grid's triangles, some of them left out.
fn grid(edge: u32, skip: usize) -> Vec<u32> {
    let quads = (0..edge * edge).map(|q| q / edge * (edge + 1) + q % edge);
    let triangles = quads.flat_map(|v| [[v, v + 1, v + edge + 1], [v + edge + 1, v + 1, v + edge + 2]]);
    triangles.enumerate().filter(|(i, _)| i % skip != 0).flat_map(|(_, t)| t).collect()
}

fn sorted(triangles: &[u32]) -> Vec<[u32; 3]> {
    // The encoder turns triangles, and keeps their order and orientation.
    let turned = |t: &[u32]| [[t[0], t[1], t[2]], [t[1], t[2], t[0]], [t[2], t[0], t[1]]].into_iter().min().unwrap();
    triangles.chunks_exact(3).map(turned).collect()
}

/// Triangles of what was never in the queues name no vertex: an edge before the last one, and a new vertex.
#[test]
fn queues_are_empty_at_first() {
    let data = [&[0xe1, 0x10][..], &[0; 16]].concat();
    assert_eq!(decode(&data, 3, 4, "TRIANGLES", "").unwrap(), bytes(&[u32::MAX, u32::MAX, 0]));
}

proptest! {
    #[test]
    fn indices_are_what_was_encoded(
        edge in 1u32..20, skip in 2usize..9, any in prop::collection::vec(0u32..60_000, 3..300),
        near in prop::collection::vec(0u32..40, 3..600),
    ) {
        for list in [grid(edge, skip), any, near] {
            let list = &list[..list.len() / 3 * 3];
            let vertices = list.iter().max().map_or(0, |v| *v as usize + 1);
            let (triangles, sequence) =
                (::meshopt::encode_index_buffer(list, vertices).unwrap(),
                    ::meshopt::encode_index_sequence(list, vertices).unwrap());
            for (data, mode) in [(&triangles, "TRIANGLES"), (&sequence, "INDICES")] {
                let narrow = decode(data, list.len(), 2, mode, "NONE").unwrap();
                let wide = decode(data, list.len(), 4, mode, "").unwrap();
                let wide: Vec<u32> = wide.chunks_exact(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
                let narrow: Vec<u32> =
                    narrow.chunks_exact(2).map(|b| u16::from_le_bytes(b.try_into().unwrap()).into()).collect();
                prop_assert_eq!(&wide, &narrow);
                match mode {
                    "INDICES" => prop_assert_eq!(&wide, list),
                    _ => prop_assert_eq!(sorted(&wide), sorted(list)),
                }
                let cut = (0..data.len()).step_by(data.len() / 50 + 1);
                prop_assert!(cut.into_iter().all(|n| decode(&data[..n], list.len(), 4, mode, "").is_err()));
            }
        }
    }

    #[test]
    fn filters_give_back_directions_rotations_and_floats(
        vectors in prop::collection::vec(prop::array::uniform4(-1.0f32..1.0), 1..50),
    ) {
        let unit = |v: &[f32; 4]| {
            let length = v.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-3);
            v.map(|x| x / length)
        };
        let short = |b: &[u8]| f32::from(i16::from_le_bytes([b[0], b[1]])) / 32767.0;
        let quaternions: Vec<[f32; 4]> = vectors.iter().map(unit).collect();
        let packed = bytes(::meshopt::encode_filter_quat(&quaternions, 16).as_flattened());
        let decoded = decode(&encoded::<8>(&packed, 0), vectors.len(), 8, "ATTRIBUTES", "QUATERNION").unwrap();
        for (found, expected) in decoded.chunks_exact(8).zip(&quaternions) {
            let dot: f32 = found.chunks_exact(2).zip(expected).map(|(a, b)| short(a) * b).sum();
            prop_assert!((dot.abs() - expected.iter().map(|x| x * x).sum::<f32>()).abs() < 1e-3,
                "{:?} {:?}", found, expected);
        }
        let directions: Vec<[f32; 4]> =
            vectors.iter().map(|&[x, y, z, _]| unit(&[x, y, z.abs().max(0.01).copysign(z), 0.0])).collect();
        let packed = bytes(::meshopt::encode_filter_oct::<i16>(&directions, 16).as_flattened());
        let wide = decode(&encoded::<8>(&packed, 0), vectors.len(), 8, "ATTRIBUTES", "OCTAHEDRAL").unwrap();
        let packed = bytes(::meshopt::encode_filter_oct::<i8>(&directions, 8).as_flattened());
        let narrow = decode(&encoded::<4>(&packed, 0), vectors.len(), 4, "ATTRIBUTES", "OCTAHEDRAL").unwrap();
        for ((wide, narrow), expected) in wide.chunks_exact(8).zip(narrow.chunks_exact(4)).zip(&directions) {
            for c in 0..3 {
                prop_assert!((short(&wide[2 * c..]) - expected[c]).abs() < 2e-4, "{:?}", expected);
                prop_assert!((f32::from(narrow[c] as i8) / 127.0 - expected[c]).abs() < 0.03, "{:?}", expected);
            }
        }
        let floats: Vec<[f32; 1]> = vectors.iter().flatten().map(|x| [x * 100.0]).collect();
        let packed = bytes(::meshopt::encode_filter_exp(&floats, 24, ::meshopt::EncodeExpMode::Separate)
            .as_flattened());
        let decoded = decode(&encoded::<4>(&packed, 0), floats.len(), 4, "ATTRIBUTES", "EXPONENTIAL").unwrap();
        for (found, [expected]) in decoded.chunks_exact(4).zip(&floats) {
            prop_assert!((f32::from_le_bytes(found.try_into().unwrap()) - expected).abs() <= 2e-7 * expected.abs());
        }
    }

    #[test]
    fn the_filter_of_colours_gives_them_back(
        colours in prop::collection::vec(prop::array::uniform4(0.0f32..=1.0), 1..50), bits in 2i32..=16,
    ) {
        let wide = bytes(::meshopt::encode_filter_color::<u16>(&colours, bits).as_flattened());
        let wide = decode(&encoded::<8>(&wide, 1), colours.len(), 8, "ATTRIBUTES", "COLOR").unwrap();
        let narrow = bytes(::meshopt::encode_filter_color::<u8>(&colours, bits.min(8)).as_flattened());
        let narrow = decode(&encoded::<4>(&narrow, 1), colours.len(), 4, "ATTRIBUTES", "COLOR").unwrap();
        // Half a step of the bits there are, in each of three terms; alpha has one bit less.
        let near = |found: f32, expected: f32, bits: i32| (found - expected).abs() <= 2.0 / ((1 << bits) - 1) as f32;
        for ((wide, narrow), expected) in wide.chunks_exact(8).zip(narrow.chunks_exact(4)).zip(&colours) {
            for c in 0..4 {
                let short = f32::from(u16::from_le_bytes([wide[2 * c], wide[2 * c + 1]])) / 65535.0;
                prop_assert!(near(short, expected[c], bits), "{} {:?}", short, expected);
                let byte = f32::from(narrow[c]) / 255.0;
                prop_assert!(near(byte, expected[c], bits.min(8)), "{} {:?}", byte, expected);
            }
        }
    }
}
