//! The decoders of meshopt compression by themselves: data that both they and meshoptimizer accept is decoded equally.
//!
//! An input is mode, filter, size of an element less 1, number of elements in two bytes; then the data.

// The decoder is private to the library: glTF files reach it, but slowly.
#[allow(dead_code)]
#[path = "../../../src/import/gltf/meshopt.rs"]
mod decoder;

use crate::{Memory, Target, bounded};
use meshopt::ffi;

pub const TARGET: Target = Target { name: "meshopt", run, mutate: |_, _| None, seeds: Vec::new };

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
