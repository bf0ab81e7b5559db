//! `include/deltamorph.h` and `tests/layout.c`: generated from this crate, checked in, and compiled by C and C++
//! compilers. `UPDATE_HEADER=1 cargo test -p deltamorph-c header` rewrites them.

use crate::handles::KINDS;
use crate::structs as dm;
use cbindgen::{Builder, Config, DocumentationStyle, ExportConfig, Language, Style};
use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

const CRATE: &str = env!("CARGO_MANIFEST_DIR");
const INCLUDES: [&str; 3] = ["stddef.h", "stdint.h", "vulkan/vulkan_core.h"];
const UPDATE: &str = "UPDATE_HEADER=1 cargo test -p deltamorph-c header";

fn root() -> PathBuf {
    Path::new(CRATE).parent().expect("the repository").to_path_buf()
}

/// A structure as Rust lays it out.
struct Layout {
    name: &'static str,
    size: usize,
    /// Name, offset and size.
    fields: Vec<(&'static str, usize, usize)>,
}

fn size_of_field<S, F>(_: impl Fn(&S) -> &F) -> usize {
    size_of::<F>()
}

macro_rules! layouts {
    ($($name:ident { $($field:ident)* })*) => {
        vec![$(Layout {
            name: stringify!($name),
            size: size_of::<dm::$name>(),
            fields: vec![$((
                stringify!($field),
                std::mem::offset_of!(dm::$name, $field),
                size_of_field(|s: &dm::$name| &s.$field),
            )),*],
        }),*]
    };
}

fn layouts() -> Vec<Layout> {
    layouts! {
        DmEngineDesc {
            struct_size transform_feedback instance physical_device device get_instance_proc_addr get_device_proc_addr
            enabled_features pipeline_cache clamp_to_android_baseline reserved debug_names buffer_device_address
            queue_families queue_family_count allocate_memory free_memory memory_user
        }
        DmEngineInfo {
            struct_size is_software max_storage_range allocated_bytes device_name meshes poses animation lists staging
            readback
        }
        DmMemoryRequest { size alignment type_bits required preferred reserved }
        DmHostMemory { memory offset mapped token }
        DmMemoryUse { bytes allocations }
        DmRequirement { extension feature reason }
        DmMeshDesc {
            struct_size flags engine position_tolerance normal_tolerance delta_format block_size position_error
            normal_error_degrees absolute_error weight_max message message_user
        }
        DmMeshArrays {
            struct_size vertex_count name positions normals tangents texcoords indices targets index_count target_count
            absolute reserved
        }
        DmTargetArrays { struct_size reserved name positions normals tangents }
        DmSampleDesc { struct_size vertices targets sparsity seed }
        DmMeshInfo {
            struct_size vertex_count padded_vertex_count target_count index_count delta_format diagonal reserved
            pose_bytes device_bytes
        }
        DmRenderVertices { struct_size vertex_count index_count reserved pose_vertices texcoords indices }
        DmCrowdDesc {
            struct_size instances path batch mode slots pose_format frames_in_flight consumers tolerance weight_max
            error_budget pose_usage reserved poses queue_family
        }
        DmHostPoses { struct_size stride buffer offset streams stream_count reserved }
        DmStreamPlace { stream offset }
        DmAnimationDesc { struct_size clip_count clips key_bits reserved level }
        DmLevelDesc { struct_size pin_count mesh pins }
        DmPlayback { struct_size clip start speed once reserved }
        DmTicket { crowd number }
        DmUpdate {
            struct_size bound ticket coefficients passes rebuilt dirty_blocks rebuilt_blocks bytes_moved bytes_floor
        }
        DmPoseView {
            struct_size stride buffer offset size format slot units offsets previous_buffer previous_offset
        }
        DmStreamView { struct_size stride buffer offset components format units offsets slot reserved }
        DmNormalsTarget { struct_size stride buffer offset }
        DmSkinDesc { struct_size influences joints weights joint_count reserved }
        DmOutputTarget {
            struct_size stride buffer offset second_buffer second_offset joints joints_bytes joints_offset normals
            method
        }
        DmOutputView { struct_size reserved buffer offset previous_buffer previous_offset }
        DmClipInfo { struct_size frame_count column_count fps }
        DmClipArrays { struct_size frame_count column_count fps name names values }
    }
}

/// A C file that compiles only if structures have the layout that Rust gives them, where pointers have 64 bits.
fn layout_file() -> String {
    let mut text = String::from("/* The layout of structures in the library: written by UPDATE_HEADER=1. */\n");
    text += "#include <deltamorph.h>\n\n";
    for Layout { name, size, fields } in layouts() {
        writeln!(text, "typedef char {name}_sizeof[sizeof({name}) == {size} ? 1 : -1];").unwrap();
        for (field, offset, _) in fields {
            writeln!(text, "typedef char {name}_{field}[offsetof({name}, {field}) == {offset} ? 1 : -1];").unwrap();
        }
    }
    text
}

fn generate() -> String {
    let head = std::fs::read_to_string(Path::new(CRATE).join("header.txt")).expect("capi/header.txt");
    let text = generate_as(Config {
        header: Some(head.trim_end().to_owned()),
        include_guard: Some("DELTAMORPH_H".to_owned()),
        sys_includes: INCLUDES.map(Into::into).into(),
        cpp_compat: true,
        documentation_style: DocumentationStyle::Cxx,
        ..Default::default()
    });
    // Some compilers decode files by their locale.
    let text = text.replace('…', "...").replace('×', "x").replace("/// # Safety\n", "/// Safety:\n");
    // The feature is on by default.
    let text = text.replace("#if defined(DM_SAMPLE)", "#if !defined(DM_NO_SAMPLE)");
    assert!(text.is_ascii(), "{:?}", text.lines().find(|line| !line.is_ascii()));
    text
}

/// The declarations of the header, each in a line, without comments.
fn declarations() -> Vec<String> {
    let text = generate_as(Config { documentation: false, ..Default::default() });
    // Of the built-in head, too.
    let text = text.replace("#if defined(DM_SAMPLE)", "").replace("#endif", "");
    let one_line = |lines: &str| lines.split_whitespace().collect::<Vec<_>>().join(" ");
    text.split("\n\n").map(one_line).filter(|line| !line.is_empty()).collect()
}

fn generate_as(config: Config) -> String {
    let defines = HashMap::from([("feature = sample".to_owned(), "DM_SAMPLE".to_owned())]);
    let names = [
        ("Instance", "VkInstance"),
        ("PhysicalDevice", "VkPhysicalDevice"),
        ("Device", "VkDevice"),
        ("CommandBuffer", "VkCommandBuffer"),
        ("Buffer", "VkBuffer"),
        ("PipelineCache", "VkPipelineCache"),
        ("DeviceMemory", "VkDeviceMemory"),
        ("PhysicalDeviceFeatures", "VkPhysicalDeviceFeatures"),
        ("VertexInputBindingDescription", "VkVertexInputBindingDescription"),
        ("VertexInputAttributeDescription", "VkVertexInputAttributeDescription"),
        ("GetInstanceProcAddr", "PFN_vkGetInstanceProcAddr"),
        ("GetDeviceProcAddr", "PFN_vkGetDeviceProcAddr"),
    ];
    let rename: HashMap<String, String> = names.map(|(from, to)| (from.to_owned(), to.to_owned())).into();
    let config = Config {
        language: Language::C,
        style: Style::Both,
        no_includes: true,
        line_length: 120,
        tab_width: 4,
        usize_is_size_t: true,
        export: ExportConfig { rename, ..Default::default() },
        defines,
        ..config
    };
    let mut builder = Builder::new().with_config(config);
    let files = "result numbers handles structs/device structs/mesh structs/crowd structs/after queries mesh clip \
        sample engine upload crowd weights record views readback after skin bounds lifetime";
    for file in files.split_whitespace() {
        builder = builder.with_src(Path::new(CRATE).join(format!("src/{file}.rs")));
    }
    let mut text = Vec::new();
    builder.generate().expect("a header").write(&mut text);
    String::from_utf8(text).expect("UTF-8")
}

#[test]
fn the_header_is_what_the_crate_says() {
    for (file, fresh) in [("include/deltamorph.h", generate()), ("capi/tests/layout.c", layout_file())] {
        let path = root().join(file);
        if std::env::var_os("UPDATE_HEADER").is_some() {
            std::fs::write(&path, &fresh).expect("the file");
        }
        let there = std::fs::read_to_string(&path).unwrap_or_default();
        let stale = there.lines().zip(fresh.lines()).position(|(a, b)| a != b).map_or(0, |at| at + 1);
        assert!(there == fresh, "{file} is out of date from line {stale} on: {UPDATE}");
    }
}

/// What programs were built against stays within a minor version, as the SONAME says: structures that state their size
/// get fields at their end, everything else is as it was. `tests/programs.rs` runs programs built against that header.
#[test]
fn what_the_first_header_of_this_version_declares_is_still_there() {
    let version = concat!(env!("CARGO_PKG_VERSION_MAJOR"), ".", env!("CARGO_PKG_VERSION_MINOR"));
    let head =
        format!("/* What deltamorph.h of the first {version} declares: UPDATE_FIRST_HEADER=1 before its release. */\n");
    let path = Path::new(CRATE).join("tests/first/deltamorph.h");
    let now = declarations();
    if std::env::var_os("UPDATE_FIRST_HEADER").is_some() {
        let includes = INCLUDES.map(|file| format!("#include <{file}>\n")).concat();
        std::fs::write(&path, format!("{head}#pragma once\n{includes}{}\n", now.join("\n"))).expect("the header");
    }
    let first = std::fs::read_to_string(&path).unwrap_or_default();
    let lines = first.strip_prefix(&head).unwrap_or_else(|| panic!("{} is not of {version}", path.display())).lines();
    let is_there = |line: &str| {
        let grows = line.split_once(" }").filter(|(fields, _)| fields.contains("{ uint32_t struct_size;"));
        now.iter().any(|new| new == line || grows.is_some_and(|(fields, _)| new.starts_with(fields)))
    };
    let declared: Vec<&str> = lines.skip(1 + INCLUDES.len()).collect();
    assert!(declared.len() > 120, "{declared:?}");
    let gone: Vec<&&str> =
        declared.iter().filter(|line| !is_there(line) && !line.contains("_VERSION_PATCH ")).collect();
    assert!(gone.is_empty(), "programs that were built with {version} rely on what is gone or another:\n{gone:#?}");
}

/// Fields that a C compiler would not check, or padding that Rust would copy as uninitialised bytes.
#[test]
fn structures_have_no_padding_and_every_field_is_asserted() {
    let text = generate();
    for Layout { name, size, fields } in layouts() {
        assert_eq!(fields.iter().map(|(_, _, bytes)| bytes).sum::<usize>(), size, "{name} has padding");
        let body = text.split(&format!("typedef struct {name} {{")).nth(1).expect(name).split('}').next().expect(name);
        let declared = body.lines().filter(|line| line.trim_end().ends_with(';')).count();
        assert_eq!(declared, fields.len(), "{name}: fields that are not asserted");
    }
    let structures = text.matches("typedef struct ").count();
    assert_eq!(structures, layouts().len() + KINDS.len() - 1, "structures that are not asserted, but for handles");
}

#[test]
fn compilers_take_the_header_by_itself() {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::write(dir.path().join("deltamorph.h"), generate()).expect("the header");
    let text = format!("{}#include <deltamorph.h>\nint main(void) {{ return 0; }}\n", layout_file());
    for (compiler, file, flags) in [
        ("cc", "header.c", &["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror"][..]),
        ("cc", "header.c", &["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]),
        ("c++", "header.cpp", &["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]),
    ] {
        let source = dir.path().join(file);
        std::fs::write(&source, &text).unwrap();
        let mut run = Command::new(compiler);
        run.args(flags).arg("-I").arg(dir.path()).arg("-c").arg(&source);
        let output = run.arg("-o").arg(dir.path().join("header.o")).output().expect(compiler);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{compiler} {flags:?} (the Vulkan headers are libvulkan-dev):\n{said}");
    }
}

/// Shows only that none was forgotten, not that it is right.
#[test]
fn every_function_is_used_wrongly_by_a_test() {
    let read = |file: &str| std::fs::read_to_string(Path::new(CRATE).join("tests").join(file)).expect(file);
    let text = generate();
    let misuse = read("misuse.c") + &read("misuse_steps.c") + &read("misuse_more.c");
    let declared = text.lines().filter_map(|line| line.strip_prefix("DmResult ")?.split('(').next());
    let functions: Vec<&str> = declared.collect();
    assert!(functions.len() > 50, "{functions:?}");
    let is_refused = |name: &str| {
        let uses = misuse.split(&format!("{name}(")).count() - 1;
        uses > misuse.split(&format!("WORKS({name}(")).count() - 1
    };
    let missing: Vec<&&str> = functions.iter().filter(|name| !is_refused(name)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}
