//! `include/deltamorph.h`: generated from this crate, checked in, and compiled by C and C++ compilers.
//! `UPDATE_HEADER=1 cargo test -p deltamorph-c header` rewrites it.

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

macro_rules! sizes {
    ($($name:ident)*) => {
        vec![$((stringify!($name), size_of::<dm::$name>())),*]
    };
}

/// The structures, with their sizes in Rust where pointers have 64 bits.
fn sizes() -> Vec<(&'static str, usize)> {
    sizes! {
        DmEngineDesc DmEngineInfo DmMemoryRequest DmHostMemory DmMemoryUse DmRequirement DmMeshDesc DmMeshArrays
        DmTargetArrays DmSampleDesc DmMeshInfo DmRenderVertices DmCrowdDesc DmAnimationDesc
        DmLevelDesc DmPlayback DmTicket DmUpdate DmPoseView DmStreamView DmSkinDesc DmOutputStream DmOutputTarget
        DmOutputView DmClipInfo DmClipArrays
    }
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
        ("QueryPool", "VkQueryPool"),
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
    let (path, fresh) = (root().join("include/deltamorph.h"), generate());
    if std::env::var_os("UPDATE_HEADER").is_some() {
        std::fs::write(&path, &fresh).expect("the file");
    }
    let there = std::fs::read_to_string(&path).unwrap_or_default();
    let stale = there.lines().zip(fresh.lines()).position(|(a, b)| a != b).map_or(0, |at| at + 1);
    assert!(there == fresh, "{} is out of date from line {stale} on: {UPDATE}", path.display());
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

/// Structures have the size that Rust gives them, and no padding, which Rust would copy as uninitialised bytes: their
/// fields are where Rust has them.
#[test]
fn compilers_take_the_header_by_itself() {
    let dir = tempfile::tempdir().expect("a folder");
    let header = generate();
    std::fs::write(dir.path().join("deltamorph.h"), &header).expect("the header");
    let mut text = String::from("#include <deltamorph.h>\nint main(void) { return 0; }\n");
    for (name, size) in sizes() {
        writeln!(text, "typedef char {name}_size[sizeof({name}) == {size} ? 1 : -1];").unwrap();
    }
    let structures = header.matches("typedef struct ").count();
    assert_eq!(structures, sizes().len() + KINDS.len() - 1, "structures that are not asserted, but for handles");
    for (compiler, file, flags) in [
        ("cc", "header.c", &["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wpadded", "-Werror"][..]),
        ("cc", "header.c", &["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Wpadded", "-Werror"]),
        ("c++", "header.cpp", &["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Wpadded", "-Werror"]),
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
