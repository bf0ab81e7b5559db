//! The decoders of meshopt compression by themselves: data that both they and meshoptimizer accept is decoded equally.
//!
//! An input is mode, filter, size of an element less 1, number of elements in two bytes; then the data.

// The decoder is private to the library: glTF files reach it, but slowly.
#[allow(dead_code)]
#[path = "../../../src/import/gltf/meshopt.rs"]
mod decoder;

use crate::{Memory, Target, bounded};
use meshopt::ffi;

pub const TARGET: Target = Target { name: "meshopt", run, mutate: |_, _| None, seeds };

const MODES: [&str; 3] = ["ATTRIBUTES", "TRIANGLES", "INDICES"];
const FILTERS: [&str; 6] = ["", "NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"];

fn run(data: &[u8]) {
    let Some((&[mode, filter, size, low, high], data)) = data.split_first_chunk() else { return };
    let (mode, filter) = (MODES[usize::from(mode) % 3], FILTERS[usize::from(filter) % 6]);
    let (size, count) = (usize::from(size) + 1, usize::from(u16::from_le_bytes([low, high])));
    // Elements take at most 1024 bytes per byte of data; indices take four bytes before they are narrowed to two.
    let memory = Memory { base: 4096, per_byte: 4 * 1024 };
    let ours = bounded("meshopt::decode", data.len(), memory, || decoder::decode(data, count, size, mode, filter));
    let Ok(ours) = ours else { return };
    assert_eq!(ours.len(), count * size);
    if !matches!(filter, "" | "NONE") {
        return;
    }
    let Some(theirs) = theirs(data, count, size, mode) else { return };
    assert!(ours == theirs, "{count} elements of {size} bytes, {mode}: {ours:?}, but meshoptimizer says {theirs:?}");
}

/// Decodes by meshoptimizer; `None`: refused. Sizes are those that our decoder has accepted.
fn theirs(data: &[u8], count: usize, size: usize, mode: &str) -> Option<Vec<u8>> {
    let mut out = vec![0u8; count * size];
    let (to, from) = (out.as_mut_ptr().cast(), data.as_ptr());
    // SAFETY: there is room for `count` elements, and `data` has the length that is stated.
    let code = unsafe {
        match mode {
            "ATTRIBUTES" => ffi::meshopt_decodeVertexBuffer(to, count, size, from, data.len()),
            "TRIANGLES" => ffi::meshopt_decodeIndexBuffer(to, count, size, from, data.len()),
            _ => ffi::meshopt_decodeIndexSequence(to, count, size, from, data.len()),
        }
    };
    (code == 0).then_some(out)
}

fn seeds() -> Vec<(String, Vec<u8>)> {
    let vertices: Vec<[f32; 3]> = (0..40u8).map(|v| [f32::from(v % 8), f32::from(v / 8), 0.25]).collect();
    let indices: Vec<u32> = (0..30u32).flat_map(|v| [v, v + 1, v + 8]).collect();
    let attributes = meshopt::encode_vertex_buffer(&vertices).expect("it can be encoded");
    let triangles = meshopt::encode_index_buffer(&indices, vertices.len()).expect("it can be encoded");
    // An INDICES header, then differences of one byte each, and the four bytes that end it.
    let sequence = [&[0xD1][..], &[4, 8, 12, 3, 2, 6, 7, 1], &[0; 4]].concat();
    let input = |mode: u8, filter: u8, size: u8, count: u16, data: &[u8]| {
        let name = format!("{}-{}", MODES[usize::from(mode)], FILTERS[usize::from(filter)]).to_lowercase();
        (name, [&[mode, filter, size - 1][..], &count.to_le_bytes(), data].concat())
    };
    vec![
        input(0, 1, 12, 40, &attributes),
        input(0, 2, 4, 120, &attributes),
        input(0, 3, 8, 60, &attributes),
        input(0, 4, 12, 40, &attributes),
        input(0, 5, 4, 120, &attributes),
        input(1, 1, 2, 90, &triangles),
        input(2, 1, 4, 8, &sequence),
    ]
}
