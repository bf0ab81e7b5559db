//! The SPIR-V modules: checked in and compiled are the same, and shader and host agree on every layout.

use deltamorph::animation::HeadRecord;
use deltamorph::gpu::shaders::{
    AnimationPush, BlocksPush, DenseListEntry, DenseListPush, DensePush, DirectPush, MANIFEST, MODULES, ReadPush,
    ResolvePush, ScatterPush, WORKGROUP, blocks_module, direct_attributes_module, feedback_batch_max, feedback_module,
    feedback_push_bytes, vertex_store_module,
};
use deltamorph::pack::blocks::BLOCK_SIZES;
use deltamorph::pack::{DeltaFormat, POSE_STRIDE};
use deltamorph::plan::blocks::{ELEMENT_BYTES, Element, ROWS, TILE, TILE_WORDS, WIDTHS};
use spirq::prelude::*;
use spirq::ty::StructType;
use std::collections::{BTreeMap, BTreeSet};
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

/// Bindings of texel buffers, in order, and whether they may be stored to.
fn texel_buffers(entry: &EntryPoint) -> Vec<(u32, bool)> {
    let buffers = entry.vars.iter().filter_map(|var| match var {
        Variable::Descriptor { desc_bind, desc_ty, .. } => match desc_ty {
            DescriptorType::UniformTexelBuffer() => Some((desc_bind.bind(), false)),
            DescriptorType::StorageTexelBuffer(_) => Some((desc_bind.bind(), true)),
            _ => None,
        },
        _ => None,
    });
    buffers.collect::<BTreeSet<_>>().into_iter().collect()
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
        // Modules for more than 16 attributes are for devices that have more push constants, too.
        let attributes = ["feedback", "vertex_store", "direct_attributes"].iter().any(|path| name.starts_with(path));
        let beyond = attributes && name[name.len() - 2..].parse::<u32>().unwrap() > 25;
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
        let kernels = [("blocks", false), ("crowd", false), ("crowd", true)];
        for (kernel, texels) in kernels.into_iter().filter(|(_, t)| !t || format == DeltaFormat::Fast) {
            let name = blocks_module(kernel, format, exact, texels);
            let blocks = reflect(&name);
            let strides: Vec<_> = storage_buffers(&blocks).iter().map(|(b, ty)| (*b, stride(ty))).collect();
            // Asset, work list, poses, and integers where sums are exact. With texels, asset and list are texel buffers, and
            // poses and integers are bound as pairs of words, and as texels behind them.
            let (buffers, views): (&[_], &[_]) = match (texels, exact) {
                (false, false) => (&[(0, 4), (1, 4), (2, 4)], &[]),
                (false, true) => (&[(0, 4), (1, 4), (2, 4), (3, 4)], &[]),
                (true, false) => (&[(2, 8)], &[(0, false), (1, false), (3, true)]),
                (true, true) => (&[(2, 8), (4, 8)], &[(0, false), (1, false), (3, true), (5, true)]),
            };
            assert_eq!((strides.as_slice(), texel_buffers(&blocks).as_slice()), (buffers, views), "{name}");
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
            // Lanes, vertices of a block; instances and rows of a tile; whether they start from base, where that takes a
            // pipeline of its own.
            let expected = match (kernel == "crowd", exact) {
                (false, _) => &[0, 1][..],
                (true, true) => &[0, 1, 2, 3],
                (true, false) => &[0, 1, 2, 3, 4],
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

#[test]
fn animation_kernels_agree_with_the_host() {
    for name in ["animate", "budget", "commit", "plan", "arguments"] {
        let entry = reflect(name);
        // Words: tables, state, work list, control.
        let strides: Vec<_> = storage_buffers(&entry).iter().map(|(b, ty)| (*b, stride(ty))).collect();
        assert_eq!(strides, [(0, 4), (1, 4), (2, 4), (3, 4)], "{name}");
        let push = push_constants(&entry).unwrap();
        macro_rules! offsets {
            ($($field:ident)*) => { names(&[$((stringify!($field), offset_of!(AnimationPush, $field))),*]) };
        }
        let expected = offsets!(now heads targets words blocks entries block_targets_at first_entry_at entries_at phases_at
            weights_at deltas_at bits_at history_at history_mask slots source destination always_rebuild
            first_head group_heads first_counter capacity rows_at counters chunks chunk_items budget_at requested_at);
        assert_eq!((members(&push), bytes(&push)), (expected, size_of::<AnimationPush>()), "{name}");
        assert!(constants(&entry).is_empty(), "{name}");
    }
    assert_eq!(size_of::<HeadRecord>(), 4 * 8);
    assert_eq!((TILE, TILE_WORDS, WIDTHS, ROWS), (8, 12, 4, 2), "as in animation.glsl and tiles.glsl");
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

/// `(location, elements)` of a vertex module's inputs.
fn inputs(entry: &EntryPoint) -> Vec<(u32, usize)> {
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
    inputs
}

/// Whether a vertex module is fit for any device: it captures nothing, and writes no storage buffer.
fn only_draws(name: &str) -> bool {
    let (xfb_buffer, non_writable) = (36, 24);
    let buffers = storage_buffers(&reflect(name)).len();
    decorations(name, xfb_buffer).is_empty() && member_decorations(name, non_writable) == buffers
}

/// How many members of a module's structures have a decoration.
fn member_decorations(name: &str, decoration: u32) -> usize {
    let (_, bytes) = MODULES.iter().find(|(n, _)| *n == name).unwrap();
    let words = words(bytes);
    let (mut at, mut count) = (5, 0);
    while at < words.len() {
        let (length, opcode) = (words[at] >> 16, words[at] & 0xffff);
        count += usize::from(opcode == 72 && words[at + 3] == decoration);
        at += length as usize;
    }
    count
}

#[test]
fn baselines_agree_with_the_host() {
    for format in DeltaFormat::DENSE {
        for batch in 0..=feedback_batch_max(format) {
            let (store, draw) = (vertex_store_module(format, batch), direct_attributes_module(format, batch));
            for (name, buffers) in [(&store, &[(0, 8)][..]), (&draw, &[])] {
                let entry = reflect(name);
                let deltas = (batch > 0).then_some((2, batch as usize * format.attributes()));
                assert_eq!(inputs(&entry), [(0, 1), (1, 1)].into_iter().chain(deltas).collect::<Vec<_>>(), "{name}");
                let push = push_constants(&entry).map_or(0, |p| bytes(&p));
                assert_eq!(push, feedback_push_bytes(format, batch) as usize, "{name}");
                let strides: Vec<_> = storage_buffers(&entry).iter().map(|(b, ty)| (*b, stride(ty))).collect();
                assert_eq!(strides, buffers, "{name}");
            }
            assert!(only_draws(&draw) && !only_draws(&store));
        }
        let element = if format == DeltaFormat::Snorm16 { 4 } else { 8 };
        for (end, buffers) in [("", 2), ("_feedback", 2), ("_store", 3)] {
            let name = format!("direct_{}{end}", format.name());
            let entry = reflect(&name);
            let strides: Vec<_> = storage_buffers(&entry).iter().map(|(b, ty)| (*b, stride(ty))).collect();
            assert_eq!(strides, [(0, element), (1, 8), (2, 8)][..buffers], "{name}");
            assert_eq!(inputs(&entry), [(0, 1), (1, 1)], "{name}");
            let push = push_constants(&entry).unwrap();
            let expected = names(&[
                ("chunk_vertices", offset_of!(DirectPush, chunk_vertices)),
                ("target_count", offset_of!(DirectPush, target_count)),
                ("active_targets", offset_of!(DirectPush, active_targets)),
                ("first_vertex", offset_of!(DirectPush, first_vertex)),
            ]);
            assert_eq!((members(&push), bytes(&push)), (expected, size_of::<DirectPush>()), "{name}");
            assert_eq!(only_draws(&name), end.is_empty(), "{name}");
        }
        let (offset, stride) = (35, 37);
        let captured = format!("direct_{}_feedback", format.name());
        assert!(decorations(&captured, stride).iter().all(|s| *s == POSE_STRIDE as u32));
        let mut offsets = decorations(&captured, offset);
        offsets.sort_unstable();
        assert!(offsets.ends_with(&[12]) && offsets.starts_with(&[0]), "{offsets:?}");
    }

    let scatter = reflect("scatter");
    let strides: Vec<_> = storage_buffers(&scatter).iter().map(|(b, ty)| (*b, stride(ty))).collect();
    assert_eq!(strides, [(0, 16), (1, 4)], "a record; integers");
    let push = push_constants(&scatter).unwrap();
    let expected = names(&[
        ("first", offset_of!(ScatterPush, first)),
        ("count", offset_of!(ScatterPush, count)),
        ("weight", offset_of!(ScatterPush, weight)),
    ]);
    assert_eq!((members(&push), bytes(&push)), (expected, size_of::<ScatterPush>()));
    let resolve = reflect("resolve");
    let strides: Vec<_> = storage_buffers(&resolve).iter().map(|(b, ty)| (*b, stride(ty))).collect();
    assert_eq!(strides, [(1, 4), (2, 8), (3, 8)]);
    let push = push_constants(&resolve).unwrap();
    let expected = names(&[
        ("first_vertex", offset_of!(ResolvePush, first_vertex)),
        ("position_unit", offset_of!(ResolvePush, position_unit)),
        ("normal_unit", offset_of!(ResolvePush, normal_unit)),
    ]);
    assert_eq!((members(&push), bytes(&push)), (expected, size_of::<ResolvePush>()));
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
            let deltas = (batch > 0).then_some((2, batch as usize * format.attributes()));
            assert_eq!(inputs(&entry), [(0, 1), (1, 1)].into_iter().chain(deltas).collect::<Vec<_>>(), "{name}");
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
