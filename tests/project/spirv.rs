//! The SPIR-V modules match the table of kernels and the host's structures.

use deltamorph::internals::abi::formats::{FORMATS, POSE_FORMATS};
use deltamorph::internals::abi::kernels::{Buffer, OFFSETS, Stage, Takes};
use deltamorph::internals::abi::modules::{COMPILED, CROWD_TEXELS, MANIFEST, MODULES, Module};
use deltamorph::internals::abi::numbers::{RECORD_WORDS, WORKGROUP};
use deltamorph::internals::abi::push::{DenseListEntry, PUSH_CONSTANTS, attribute_push_bytes};
use deltamorph::internals::abi::worklist::TILE;
use deltamorph::internals::gpu::tuning::DeviceClass;
use deltamorph::internals::update::animated::PlaybackRecord;
use deltamorph::packed::BLOCK_SIZES;
use deltamorph::{DeltaFormat, PoseFormat};
use spirq::prelude::*;
use spirq::ty::StructType;
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

/// Returns a literal operand of an execution mode, which reflection returns as bytes.
fn operand(value: &ConstantValue) -> u32 {
    match value {
        ConstantValue::Typeless(bytes) => u32::from_le_bytes(bytes[..4].try_into().unwrap()),
        ConstantValue::U32(value) => *value,
        other => panic!("{other:?}"),
    }
}

fn reflect(module: &Module) -> EntryPoint {
    let mut entries = ReflectConfig::new().spv(spirv(module)).ref_all_rscs(true).reflect().unwrap();
    assert_eq!((entries.len(), entries[0].name.as_str()), (1, "main"), "{}", module.name);
    entries.remove(0)
}

/// A binding in set 0, as far as it follows from a module: offsets depend on how a set is bound.
#[derive(Debug, PartialEq)]
enum Bound {
    /// Elements of this many bytes.
    Elements(usize),
    Texels {
        stored: bool,
    },
    Image,
}

fn bound(entry: &EntryPoint) -> BTreeMap<u32, Bound> {
    let descriptors = entry.vars.iter().filter_map(|var| match var {
        Variable::Descriptor { desc_bind, desc_ty, ty, .. } => {
            assert_eq!(desc_bind.set(), 0);
            let bound = match desc_ty {
                DescriptorType::UniformTexelBuffer() => Bound::Texels { stored: false },
                DescriptorType::StorageTexelBuffer(_) => Bound::Texels { stored: true },
                DescriptorType::SampledImage() => Bound::Image,
                DescriptorType::StorageBuffer(_) => {
                    let member = &ty.as_struct().expect("a block").members[0].ty;
                    // For an array the element's size, otherwise the whole size.
                    let bytes = member.as_array().map_or_else(|| member.nbyte(), |array| array.stride);
                    Bound::Elements(bytes.unwrap())
                }
                _ => panic!("{var:?}"),
            };
            Some((desc_bind.bind(), bound))
        }
        _ => None,
    });
    descriptors.collect()
}

fn push_constants(entry: &EntryPoint) -> Option<StructType> {
    entry.vars.iter().find_map(|var| match var {
        Variable::PushConstant { ty, .. } => Some(ty.as_struct().expect("a block").clone()),
        _ => None,
    })
}

/// Returns `(name, offset)` of each member, and the total bytes.
fn members(ty: &StructType) -> (Vec<(&str, usize)>, usize) {
    let members: Vec<_> = ty.members.iter().map(|m| (m.name.as_deref().unwrap(), m.offset.unwrap())).collect();
    let last = ty.members.last().unwrap();
    (members, last.offset.unwrap() + last.ty.nbyte().unwrap())
}

/// Returns the specialization constants, ascending.
fn constants(entry: &EntryPoint) -> Vec<u32> {
    let ids = entry.vars.iter().filter_map(|v| match v {
        Variable::SpecConstant { spec_id, .. } => Some(*spec_id),
        _ => None,
    });
    let mut ids: Vec<u32> = ids.collect();
    ids.sort_unstable();
    ids
}

/// Returns `(location, elements)` of a vertex module's inputs.
fn inputs(entry: &EntryPoint) -> Vec<(u32, usize)> {
    let inputs = entry.vars.iter().filter_map(|v| match v {
        Variable::Input { location, ty, .. } => {
            Some((location.loc(), ty.as_array().map_or(1, |a| a.nelement.unwrap() as usize)))
        }
        _ => None,
    });
    let mut inputs: Vec<(u32, usize)> = inputs.collect();
    inputs.sort_unstable();
    inputs
}

/// Returns the values of a decoration of a module's variables: reflection does not know those of capture.
fn decorations(words: &[u32], decoration: u32) -> Vec<u32> {
    let decorate = 71;
    let all = instructions(words).into_iter().filter(|(op, o)| *op == decorate && o[1] == decoration);
    let mut values: Vec<u32> = all.map(|(_, operands)| operands.get(2).copied().unwrap_or(operands[0])).collect();
    values.sort_unstable();
    values
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

#[test]
fn modules_declare_what_the_table_says() {
    for module in &MODULES {
        let (name, kernel, entry, code) = (module.name, module.kernel, reflect(module), spirv(module));
        let format = module.format;
        let expected = kernel.bindings.iter().map(|(binding, buffer)| {
            let bound = match buffer {
                Buffer::Storage(bytes) | Buffer::Dynamic(bytes) => Bound::Elements(*bytes as usize),
                Buffer::Poses if name.contains("fixed") => Bound::Elements(4), // int, uint
                Buffer::Poses => Bound::Elements(8),                           // vec2
                Buffer::DynamicDeltas => match format {
                    Some(format) if format.exponents => Bound::Elements(4), // uint
                    _ => Bound::Elements(8),                                // vec2
                },
                Buffer::UniformTexels(_) => Bound::Texels { stored: false },
                Buffer::StorageTexels(_) => Bound::Texels { stored: true },
                Buffer::Image => Bound::Image,
            };
            (*binding, bound)
        });
        let bound = bound(&entry);
        assert_eq!(bound, expected.collect(), "{name}");
        let storage_buffers = bound.values().filter(|b| matches!(b, Bound::Elements(_))).count();
        assert!(storage_buffers <= 4, "{name}: what a phone promises");
        // A phone promises 16 KiB; these take less than one.
        let shares = ["animate", "plan_together"].contains(&kernel.name);
        assert_eq!(shares_memory(&code), shares, "{name}");
        assert_eq!(aliased(&code), kernel.aliased, "{name}");

        let push = push_constants(&entry);
        let (declared, bytes) = push.as_ref().map_or((vec![], 0), members);
        match (kernel.takes, format) {
            (Takes::DenseBatches, Some(format)) => {
                assert_eq!(bytes, attribute_push_bytes(format, module.batch) as usize, "{name}");
            }
            _ if kernel.push_bytes > 0 => {
                let mut structures = PUSH_CONSTANTS.iter().chain(deltamorph_baselines::PUSH_CONSTANTS);
                let (_, layout) = structures.find(|row| row.0 == kernel.name).expect("a structure");
                assert_eq!((declared.as_slice(), bytes), *layout, "{name}");
                assert_eq!(bytes, kernel.push_bytes as usize, "{name}");
            }
            _ => assert!(push.is_none(), "{name}"),
        }
        // Modules for more than 16 attributes are for devices with more push constants.
        assert!(bytes <= 128 || module.batch > 25, "{name}: what Vulkan promises");
        let expected = kernel.constants + if kernel.offsets { OFFSETS as u32 } else { 0 };
        assert_eq!(constants(&entry), (0..expected).collect::<Vec<_>>(), "{name}");

        let sizes = entry.exec_modes.iter().filter(|mode| mode.exec_mode == spirq::spirv::ExecutionMode::LocalSize);
        let sizes: Vec<Vec<u32>> =
            sizes.map(|mode| mode.operands.iter().map(|c| operand(&c.value)).collect()).collect();
        match kernel.stage {
            Stage::Vertex => {
                assert!(sizes.is_empty(), "{name}");
                let deltas = module.batch as usize * format.map_or(0, |format| format.attributes.len());
                let of_pose = match kernel.name {
                    // From a buffer.
                    "rectangles" => 0,
                    "consume_position" => 1,
                    _ => 2,
                };
                let pose = [(0, 1), (1, 1)].into_iter().take(of_pose);
                let behind = (deltas > 0).then_some((2, deltas));
                assert_eq!(inputs(&entry), pose.chain(behind).collect::<Vec<_>>(), "{name}");
            }
            // A rectangle.
            Stage::Fragment => assert_eq!((sizes.len(), inputs(&entry)), (0, vec![(0, 1)]), "{name}"),
            Stage::Compute => assert_eq!(sizes, [[WORKGROUP, 1, 1]], "{name}"),
            // Constant 0 is the workgroup size in x, regardless of the source.
            Stage::ComputeSized => {
                let (builtin, workgroup_size) = (11, 25);
                assert!(decorations(&code, builtin).contains(&workgroup_size), "{name}");
                assert!(sizes.iter().all(|size| size[1..] == [1, 1]), "{name}");
            }
        }
    }
    const { assert!(WORKGROUP <= 128) };
    // The largest block has as many lanes as phones guarantee.
    assert_eq!(BLOCK_SIZES.iter().max(), Some(&128));
}

#[test]
fn vertex_modules_capture_what_a_pose_has_and_draws_do_nothing_else() {
    let (offset, buffer, stride, non_writable) = (35, 36, 37, 24);
    for module in MODULES.iter().filter(|module| module.kernel.stage == Stage::Vertex) {
        let (name, kernel, code) = (module.name, module.kernel, spirv(module));
        let captures = kernel.name == "feedback" || kernel.suffix == "feedback";
        let stores = kernel.name == "vertex_store" || kernel.suffix == "store";
        let captured = |what| decorations(&code, what);
        if captures {
            assert_eq!(captured(buffer).iter().filter(|b| **b == 0).count(), captured(buffer).len(), "{name}");
            assert_eq!(captured(buffer).len(), 2, "{name}");
            assert!(captured(stride).iter().all(|s| *s as usize == PoseFormat::Float32.stride()), "{name}");
            let offsets = captured(offset);
            assert!(offsets.ends_with(&[12]) && offsets.starts_with(&[0]), "{name}: {offsets:?}");
        } else {
            assert!(captured(buffer).is_empty(), "{name}");
        }
        let member_decorate = 72;
        let read_only =
            instructions(&code).iter().filter(|(op, o)| *op == member_decorate && o[2] == non_writable).count();
        let buffers = kernel.bindings.iter().filter(|(_, buffer)| *buffer != Buffer::Image).count();
        assert_eq!(read_only + usize::from(stores), buffers, "{name}");
    }
}

#[test]
fn structures_in_buffers_are_the_hosts() {
    let lists = MODULES.iter().filter(|module| module.kernel.name == "dense_list");
    let mut seen = 0;
    for module in lists {
        let entry = reflect(module);
        let list = entry.vars.iter().find_map(|var| match var {
            Variable::Descriptor { desc_bind, ty, .. } if desc_bind.bind() == 3 => ty.as_struct(),
            _ => None,
        });
        let element = list.unwrap().members[0].ty.as_array().unwrap().element_ty.clone();
        let expected = (DenseListEntry::LAYOUT.0.to_vec(), DenseListEntry::LAYOUT.1);
        assert_eq!(members(element.as_struct().unwrap()), expected, "{}", module.name);
        seen += 1;
    }
    assert_eq!(seen, DeltaFormat::DENSE.len());
    assert_eq!(size_of::<PlaybackRecord>(), 4 * RECORD_WORDS as usize);
}

#[test]
fn every_device_class_has_tiles_that_kernels_take() {
    for class in [DeviceClass::Software, DeviceClass::Phone, DeviceClass::Desktop] {
        let tuning = class.tuning();
        assert!(tuning.widest_tile.is_power_of_two() && tuning.widest_tile <= TILE as u32, "{tuning:?}");
    }
    let texels = FORMATS.iter().filter(|format| !CROWD_TEXELS.modules(format, &POSE_FORMATS[0]).is_empty());
    assert_eq!(texels.map(|format| format.name).collect::<Vec<_>>(), ["fast", "small"]);
}
