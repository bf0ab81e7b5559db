//! The SPIR-V modules: checked in and compiled are the same, and shader and host agree on every layout.

use deltamorph::gpu::shaders::{
    BlocksPush, DenseListEntry, DenseListPush, DensePush, MANIFEST, MODULES, ReadPush, WORKGROUP, blocks_module,
    feedback_batch_max, feedback_module, feedback_push_bytes,
};
use deltamorph::mesh::packed::blocks::BLOCK_SIZES;
use deltamorph::mesh::packed::{DeltaFormat, POSE_STRIDE};
use deltamorph::plan::blocks::{ELEMENT_BYTES, Element};
use spirq::prelude::*;
use spirq::ty::StructType;
use std::collections::BTreeMap;
use std::mem::offset_of;

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|w| u32::from_le_bytes(w.try_into().unwrap())).collect()
}

/// A literal operand of an execution mode: reflection hands it out as bytes.
fn operand(value: &ConstantValue) -> u32 {
    match value {
        ConstantValue::Typeless(bytes) => u32::from_le_bytes(bytes[..4].try_into().unwrap()),
        ConstantValue::U32(value) => *value,
        other => panic!("{other:?}"),
    }
}

fn reflect(name: &str) -> EntryPoint {
    let (_, bytes) = MODULES.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no module {name}"));
    let mut entries = ReflectConfig::new().spv(words(bytes)).ref_all_rscs(true).reflect().unwrap();
    assert_eq!((entries.len(), entries[0].name.as_str()), (1, "main"), "{name}");
    entries.remove(0)
}

/// Bindings of texel buffers, of 16 bytes and of 4 a texel.
fn texel_buffers(entry: &EntryPoint) -> BTreeMap<u32, DescriptorType> {
    let buffers = entry.vars.iter().filter_map(|var| match var {
        Variable::Descriptor { desc_bind, desc_ty, .. } => {
            let texels =
                matches!(desc_ty, DescriptorType::UniformTexelBuffer() | DescriptorType::StorageTexelBuffer(_));
            texels.then(|| (desc_bind.bind(), desc_ty.clone()))
        }
        _ => None,
    });
    buffers.collect()
}

/// Binding → the structure bound there.
fn storage_buffers(entry: &EntryPoint) -> BTreeMap<u32, StructType> {
    let buffers = entry.vars.iter().filter_map(|var| match var {
        Variable::Descriptor { desc_bind, desc_ty, ty, .. } => {
            use DescriptorType as T;
            assert_eq!(desc_bind.set(), 0);
            if matches!(desc_ty, T::UniformTexelBuffer() | T::StorageTexelBuffer(_)) {
                return None;
            }
            assert!(matches!(desc_ty, T::StorageBuffer(_)), "{var:?}");
            Some((desc_bind.bind(), ty.as_struct().expect("a block").clone()))
        }
        _ => None,
    });
    buffers.collect()
}

/// `(name, offset)` of each member.
fn members(ty: &StructType) -> Vec<(String, usize)> {
    ty.members.iter().map(|m| (m.name.clone().unwrap(), m.offset.unwrap())).collect()
}

fn push_constants(entry: &EntryPoint) -> Option<StructType> {
    entry.vars.iter().find_map(|var| match var {
        Variable::PushConstant { ty, .. } => Some(ty.as_struct().expect("a block").clone()),
        _ => None,
    })
}

/// Specialization constants, ascending.
fn constants(entry: &EntryPoint) -> Vec<u32> {
    let ids = entry.vars.iter().filter_map(|v| match v {
        Variable::SpecConstant { spec_id, .. } => Some(*spec_id),
        _ => None,
    });
    let mut ids: Vec<u32> = ids.collect();
    ids.sort_unstable();
    ids
}

fn bytes(ty: &StructType) -> usize {
    let last = ty.members.last().unwrap();
    last.offset.unwrap() + last.ty.nbyte().unwrap()
}

/// Stride of the runtime array that a buffer consists of.
fn stride(ty: &StructType) -> usize {
    ty.members[0].ty.as_array().expect("a runtime array").stride.unwrap()
}

fn names(expected: &[(&str, usize)]) -> Vec<(String, usize)> {
    expected.iter().map(|(n, o)| ((*n).to_owned(), *o)).collect()
}

#[test]
fn what_is_checked_in_is_what_the_sources_compile_to() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("spirv");
    if std::env::var_os("UPDATE_SPIRV").is_some() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            std::fs::remove_file(entry.unwrap().path()).unwrap();
        }
        for (name, bytes) in MODULES {
            std::fs::write(folder.join(format!("{name}.spv")), bytes).unwrap();
        }
        std::fs::write(folder.join("manifest.txt"), MANIFEST).unwrap();
    }
    let how = "regenerate spirv/ with: UPDATE_SPIRV=1 cargo test --test spirv";
    let manifest = std::fs::read_to_string(folder.join("manifest.txt")).unwrap_or_else(|e| panic!("{e}; {how}"));
    let compiler = |text: &str| text.lines().next().unwrap_or_default().to_owned();
    // Another version of glslang writes other bytes for the same source.
    let same_compiler = compiler(&manifest) == compiler(MANIFEST);
    for line in MANIFEST.lines().filter(|l| same_compiler || l.starts_with("source")) {
        assert!(manifest.lines().any(|l| l == line), "spirv/manifest.txt lacks '{line}'; {how}");
    }
    let mut files: Vec<String> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|n| n.ends_with(".spv"))
        .collect();
    files.sort();
    let mut modules: Vec<String> = MODULES.iter().map(|(n, _)| format!("{n}.spv")).collect();
    modules.sort();
    assert_eq!(files, modules, "{how}");
    for (name, bytes) in MODULES {
        let file = std::fs::read(folder.join(format!("{name}.spv"))).unwrap();
        assert!(!same_compiler || file == *bytes, "spirv/{name}.spv differs from its source; {how}");
    }
}

#[test]
fn every_module_keeps_to_what_a_phone_promises() {
    for (name, _) in MODULES {
        let entry = reflect(name);
        assert!(storage_buffers(&entry).len() <= 4, "{name}");
        for mode in &entry.exec_modes {
            if mode.exec_mode == spirq::spirv::ExecutionMode::LocalSize {
                let size: Vec<u32> = mode.operands.iter().map(|c| operand(&c.value)).collect();
                // Kernels of blocks take theirs as a specialization constant.
                let blocks = name.starts_with("blocks") || name.starts_with("crowd");
                assert!(blocks || size == [WORKGROUP, 1, 1], "{name}");
                const { assert!(WORKGROUP <= 128) };
            }
        }
        // Feedback modules for more than 16 attributes are for devices that have more push constants, too.
        let beyond = name.starts_with("feedback") && name[name.len() - 2..].parse::<u32>().unwrap() > 25;
        assert!(beyond || push_constants(&entry).is_none_or(|p| bytes(&p) <= 128), "{name}");
    }
}

#[test]
fn dense_kernels_agree_with_the_host() {
    for format in DeltaFormat::DENSE {
        let element = match format {
            DeltaFormat::Snorm16 => 4, // uint
            _ => 8,                    // vec2
        };
        let dense = reflect(&format!("dense_{}", format.name()));
        let strides: Vec<_> = storage_buffers(&dense).iter().map(|(b, ty)| (*b, stride(ty))).collect();
        assert_eq!(strides, [(0, 8), (1, 8), (2, element)]);
        assert_eq!(POSE_STRIDE, 3 * 8);
        let push = push_constants(&dense).unwrap();
        let expected = names(&[
            ("chunk_vertices", offset_of!(DensePush, chunk_vertices)),
            ("coefficients", offset_of!(DensePush, coefficients)),
            ("targets", offset_of!(DensePush, targets)),
            ("normal_exponents", offset_of!(DensePush, normal_exponents)),
        ]);
        assert_eq!((members(&push), bytes(&push)), (expected, size_of::<DensePush>()));
        assert_eq!(constants(&dense), [0], "the batch size");

        let list = reflect(&format!("dense_list_{}", format.name()));
        let buffers = storage_buffers(&list);
        let strides: Vec<_> = buffers.iter().map(|(b, ty)| (*b, stride(ty))).collect();
        assert_eq!(strides, [(0, 8), (1, 8), (2, element), (3, size_of::<DenseListEntry>())]);
        let array = buffers[&3].members[0].ty.as_array().unwrap().element_ty.clone();
        let expected = names(&[
            ("target", offset_of!(DenseListEntry, target)),
            ("coefficient", offset_of!(DenseListEntry, coefficient)),
            ("normal_coefficient", offset_of!(DenseListEntry, normal_coefficient)),
            ("unused", offset_of!(DenseListEntry, unused)),
        ]);
        assert_eq!(members(array.as_struct().unwrap()), expected);
        let push = push_constants(&list).unwrap();
        let expected = names(&[
            ("chunk_vertices", offset_of!(DenseListPush, chunk_vertices)),
            ("entry_count", offset_of!(DenseListPush, entry_count)),
        ]);
        assert_eq!((members(&push), bytes(&push)), (expected, size_of::<DenseListPush>()));
    }
    let push = push_constants(&reflect("read")).unwrap();
    let expected = names(&[("count", offset_of!(ReadPush, count)), ("stride", offset_of!(ReadPush, stride))]);
    assert_eq!((members(&push), bytes(&push)), (expected, size_of::<ReadPush>()));
}

#[test]
fn blocks_kernels_agree_with_the_host() {
    let mut seen = 0;
    for (format, exact) in DeltaFormat::BLOCKS.into_iter().flat_map(|f| [(f, false), (f, true)]) {
        if exact && format == DeltaFormat::BlockFloat32 {
            continue;
        }
        // Storage buffers in common: asset, work list. With texels, poses and sums are texel buffers.
        let kernels = [("blocks", false), ("crowd", false), ("crowd", true)];
        for (kernel, texels) in kernels.into_iter().filter(|(_, t)| !t || format == DeltaFormat::Fast) {
            let name = blocks_module(kernel, format, exact, texels);
            let blocks = reflect(&name);
            let strides: Vec<_> = storage_buffers(&blocks).iter().map(|(b, ty)| (*b, stride(ty))).collect();
            // Words, words, floats, and integers where sums are exact.
            let buffers = match (texels, exact) {
                (true, _) => 2,
                (false, true) => 4,
                (false, false) => 3,
            };
            assert_eq!(strides, (0..buffers).map(|b| (b, 4)).collect::<Vec<_>>(), "{name}");
            // Poses, the asset twice, sums.
            use DescriptorType as T;
            let poses = |ty: &T| matches!(ty, T::StorageTexelBuffer(_));
            let views: Vec<(u32, bool)> = texel_buffers(&blocks).iter().map(|(b, ty)| (*b, poses(ty))).collect();
            let expected = [(2, true), (3, false), (4, false), (5, true)];
            assert_eq!(
                views,
                expected[..if !texels {
                    0
                } else if exact {
                    4
                } else {
                    3
                }],
                "{name}"
            );
            let push = push_constants(&blocks).unwrap();
            let expected = names(&[
                ("first_item", offset_of!(BlocksPush, first_item)),
                ("elements_at", offset_of!(BlocksPush, elements_at)),
                ("deltas_at", offset_of!(BlocksPush, deltas_at)),
                ("base_at", offset_of!(BlocksPush, base_at)),
                ("pose_floats", offset_of!(BlocksPush, pose_floats)),
                ("slots", offset_of!(BlocksPush, slots)),
                ("position_unit", offset_of!(BlocksPush, position_unit)),
                ("normal_unit", offset_of!(BlocksPush, normal_unit)),
            ]);
            assert_eq!((members(&push), bytes(&push)), (expected, size_of::<BlocksPush>()), "{name}");
            // Lanes, vertices of a block; instances of a tile; whether they start from base, where that takes a
            // pipeline of its own.
            let expected = match (kernel == "crowd", exact) {
                (false, _) => &[0, 1][..],
                (true, true) => &[0, 1, 2],
                (true, false) => &[0, 1, 2, 3],
            };
            assert_eq!(constants(&blocks), expected, "{name}");
            seen += 1;
        }
    }
    let modules = MODULES.iter().filter(|(n, _)| n.starts_with("blocks_") || n.starts_with("crowd_")).count();
    assert_eq!(seen, modules);
    assert_eq!(size_of::<Element>(), ELEMENT_BYTES);
    // The largest block has as many lanes as a phone promises.
    assert_eq!(BLOCK_SIZES.iter().max(), Some(&128));
}

/// Values of a decoration of a module's variables, from the words: reflection does not know those of capture.
fn decorations(name: &str, decoration: u32) -> Vec<u32> {
    let (_, bytes) = MODULES.iter().find(|(n, _)| *n == name).unwrap();
    let words = words(bytes);
    let (mut at, mut values) = (5, vec![]);
    while at < words.len() {
        let (length, opcode) = (words[at] >> 16, words[at] & 0xffff);
        if opcode == 71 && words[at + 2] == decoration {
            values.push(words[at + 3]);
        }
        at += length as usize;
    }
    values
}

#[test]
fn feedback_modules_agree_with_the_host() {
    let (offset, buffer, stride) = (35, 36, 37);
    for format in DeltaFormat::DENSE {
        let most = feedback_batch_max(format);
        assert_eq!(most as usize, 30 / format.attributes(), "32 attributes − 2 for the pose");
        for batch in 0..=most {
            let name = feedback_module(format, batch);
            let entry = reflect(&name);
            let mut inputs: Vec<(u32, usize)> = entry
                .vars
                .iter()
                .filter_map(|v| match v {
                    Variable::Input { location, ty, .. } => {
                        Some((location.loc(), ty.as_array().map_or(1, |a| a.nelement.unwrap() as usize)))
                    }
                    _ => None,
                })
                .collect();
            inputs.sort_unstable();
            let deltas = (batch > 0).then_some((2, batch as usize * format.attributes()));
            assert_eq!(inputs, [(0, 1), (1, 1)].into_iter().chain(deltas).collect::<Vec<_>>(), "{name}");
            let push = push_constants(&entry).map_or(0, |p| bytes(&p));
            assert_eq!(push, feedback_push_bytes(format, batch) as usize, "{name}");
            assert!(storage_buffers(&entry).is_empty());
            let captured = |what| decorations(&name, what);
            assert!(captured(buffer).iter().all(|b| *b == 0) && captured(buffer).len() == 2, "{name}");
            assert!(captured(stride).iter().all(|s| *s == POSE_STRIDE as u32), "{name}");
            let mut offsets = captured(offset);
            offsets.sort_unstable();
            assert!(offsets.ends_with(&[12]) && offsets.starts_with(&[0]), "{name}: {offsets:?}");
        }
    }
}
