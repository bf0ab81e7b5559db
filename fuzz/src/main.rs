//! The fuzzing program: libFuzzer, with its options, on the target named by FUZZ_TARGET. See `run`.
#![no_main]

use deltamorph_fuzz::targets::TARGETS;
use deltamorph_fuzz::{Random, Target};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use std::path::Path;
use std::sync::LazyLock;

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = std::env::var("FUZZ_TARGET").expect("FUZZ_TARGET names a target");
    TARGETS.iter().find(|target| target.name == name).expect("FUZZ_TARGET is one of the targets")
});

/// Writes the initial inputs into the folder named by FUZZ_SEEDS.
fn write_seeds() {
    let Some(folder) = std::env::var_os("FUZZ_SEEDS") else { return };
    for (name, seed) in (TARGET.seeds)() {
        std::fs::write(Path::new(&folder).join(format!("seed-{name}")), seed).expect("a file");
    }
}

fuzz_target!(init: write_seeds(), |data: &[u8]| (TARGET.run)(data));

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    // A quarter of the mutations, and all of those of targets without structure, are mutations of bytes.
    let made = if seed.is_multiple_of(4) { None } else { (TARGET.mutate)(&data[..size], &mut Random::new(seed)) };
    match made.filter(|made| made.len() <= max_size) {
        Some(made) => {
            data[..made.len()].copy_from_slice(&made);
            made.len()
        }
        None => fuzzer_mutate(data, size, max_size),
    }
});
