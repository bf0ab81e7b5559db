//! The SPIR-V modules are of the sources in glsl/, and need no more than phones promise.

use deltamorph::internals::abi::kernels::{Buffer, Takes};
use deltamorph::internals::abi::modules::{COMPILED, MANIFEST, MODULES, Module};
use deltamorph::internals::abi::numbers::{RECORD_WORDS, WORKGROUP};
use deltamorph::internals::abi::push::attribute_push_bytes;
use deltamorph::internals::update::animated::PlaybackRecord;
use deltamorph::packed::BLOCK_SIZES;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Most bytes of the modules in a library without baselines.
const EMBEDDED_MAX: usize = 80_000;

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|w| u32::from_le_bytes(w.try_into().unwrap())).collect()
}

/// Returns a module as built, with its debug names.
fn spirv(module: &Module) -> Vec<u32> {
    let file = Path::new(COMPILED).join(format!("{}.spv", module.name));
    words(&std::fs::read(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display())))
}

/// Returns the instructions after the header: opcode, operands.
fn instructions(words: &[u32]) -> Vec<(u32, &[u32])> {
    let (mut at, mut instructions) = (5, vec![]);
    while at < words.len() {
        let length = (words[at] >> 16) as usize;
        instructions.push((words[at] & 0xffff, &words[at + 1..at + length]));
        at += length;
    }
    instructions
}

/// Returns the bindings of variables decorated Aliased.
fn aliased(words: &[u32]) -> Vec<u32> {
    let (decorate, aliased, binding) = (71, 20, 33);
    let all = instructions(words);
    let decorated: BTreeSet<u32> =
        all.iter().filter(|(op, o)| *op == decorate && o[1] == aliased).map(|(_, o)| o[0]).collect();
    let bindings = all.iter().filter(|(op, o)| *op == decorate && o[1] == binding && decorated.contains(&o[0]));
    let mut bindings: Vec<u32> = bindings.map(|(_, o)| o[2]).collect();
    bindings.sort_unstable();
    bindings
}

/// Returns whether workgroups share memory.
fn shares_memory(words: &[u32]) -> bool {
    let (variable, workgroup) = (59, 4);
    instructions(words).iter().any(|(op, o)| *op == variable && o[2] == workgroup)
}

#[test]
fn spirv_was_compiled_from_the_sources_in_glsl() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("spirv/manifest.txt");
    let checked_in = std::fs::read_to_string(path).expect("the manifest");
    let sources = |text: &str| text.lines().filter(|line| line.starts_with("source ")).map(str::to_owned).collect();
    let [built, checked_in]: [BTreeSet<String>; 2] = [MANIFEST, &checked_in].map(sources);
    assert!(built.len() > 40 && built == checked_in, "run UPDATE_SPIRV=1 cargo test -p deltamorph-spirv");
}

#[test]
fn what_is_embedded_is_what_was_compiled_without_debug_names() {
    let debug = [2, 3, 4, 5, 6, 7, 8, 317, 330];
    for module in &MODULES {
        let (compiled, embedded) = (spirv(module), module.words());
        let mut expected = instructions(&compiled);
        expected.retain(|(opcode, _)| !debug.contains(opcode));
        assert_eq!(embedded[..5], compiled[..5], "{}", module.name);
        assert_eq!(instructions(&embedded), expected, "{}", module.name);
    }
    let ours = MODULES.iter().filter(|module| !module.kernel.baseline);
    let compressed: BTreeMap<_, _> = ours.map(|module| (module.modules.as_ptr(), module.modules.len())).collect();
    let bytes: usize = compressed.into_values().sum();
    println!("{bytes} bytes of SPIR-V without baselines");
    assert!(bytes <= EMBEDDED_MAX, "{bytes} bytes of SPIR-V without baselines, {EMBEDDED_MAX} allowed");
}

/// Pipelines are compared with modules by the validation layers, and structures by the poses that come out.
#[test]
fn kernels_need_no_more_than_a_phone_promises() {
    for module in &MODULES {
        let (name, kernel, code) = (module.name, module.kernel, spirv(module));
        let is_storage = |(_, buffer): &&(u32, Buffer)| matches!(buffer, Buffer::Storage | Buffer::Dynamic);
        assert!(kernel.bindings.iter().filter(is_storage).count() <= 4, "{name}");
        let bytes = match (kernel.takes, module.format) {
            (Takes::DenseBatches, Some(format)) => attribute_push_bytes(format, module.batch),
            _ => kernel.push_bytes,
        };
        // Modules for more than 16 attributes are for devices with more push constants.
        assert!(bytes <= 128 || module.batch > 25, "{name}: what Vulkan promises");
        // A phone promises 16 KiB; these take less than one.
        let shares = ["animate", "plan_together"].contains(&kernel.name);
        assert_eq!(shares_memory(&code), shares, "{name}");
        assert_eq!(aliased(&code), kernel.aliased, "{name}");
    }
    const { assert!(WORKGROUP <= 128) };
    // The largest block has as many lanes as phones guarantee.
    assert_eq!(BLOCK_SIZES.iter().max(), Some(&128));
    assert_eq!(size_of::<PlaybackRecord>(), 4 * RECORD_WORDS as usize);
}
