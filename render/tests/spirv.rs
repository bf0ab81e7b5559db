//! Tests that the checked-in modules equal the compiled sources in glsl/. `UPDATE_SPIRV=1 cargo test -p
//! deltamorph-render --test spirv` writes them.

use glslang::include::{IncludeHandler, IncludeResult, IncludeType};
use glslang::{
    Compiler, CompilerOptions, ShaderInput, ShaderSource, ShaderStage, SourceLanguage, SpirvVersion, Target,
    VulkanVersion,
};
use std::ffi::OsString;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

const SOURCES: [&str; 6] = ["face.frag", "face.vert", "heat.glsl", "pose.glsl", "scene.glsl", "shadow.vert"];

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// Reads a source of this folder; poses are decoded by the file that hosts get.
fn source(name: &str) -> String {
    let file = if name == "pose.glsl" { folder("../glsl/host/pose.glsl") } else { folder("glsl").join(name) };
    fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
}

struct Includes;
impl IncludeHandler for Includes {
    fn include(&mut self, _: IncludeType, name: &str, _: &str, _: usize) -> Option<IncludeResult> {
        Some(IncludeResult { name: name.into(), data: source(name) })
    }
}

fn compile(file: &str, stage: ShaderStage, pose: Option<&str>, more: &[&str]) -> Vec<u8> {
    let options = CompilerOptions {
        source_language: SourceLanguage::GLSL,
        target: Target::Vulkan { version: VulkanVersion::Vulkan1_1, spirv_version: SpirvVersion::SPIRV1_3 },
        ..CompilerOptions::default()
    };
    let define = pose.map(|pose| format!("POSE_{}", pose.to_uppercase()));
    let defines = define.as_deref().into_iter().chain(more.iter().copied());
    let defines: Vec<(&str, Option<&str>)> = defines.map(|define| (define, None)).collect();
    let text = ShaderSource::from(source(file));
    let mut includes = Includes;
    let compiler = Compiler::acquire().expect("the only user of glslang in this process");
    let input = ShaderInput::new(&text, stage, &options, Some(&defines[..]), Some(&mut includes));
    let shader = compiler.create_shader(input.unwrap_or_else(|e| panic!("{file}: {e}")));
    let words = shader.unwrap_or_else(|e| panic!("{file}: {e}")).compile().unwrap_or_else(|e| panic!("{file}: {e}"));
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// FNV-1a, 64 bits, as in the engine's manifest.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3))
}

/// Returns names and contents of the modules.
fn modules() -> Vec<(String, Vec<u8>)> {
    let mut modules = vec![("face.frag.spv".to_owned(), compile("face.frag", ShaderStage::Fragment, None, &[]))];
    let variants = [
        ("face", "face.vert", &[][..]),
        ("motion", "face.vert", &["MOTION"]),
        ("masks", "face.vert", &["MASKS"]),
        ("shadow", "shadow.vert", &[]),
    ];
    for (name, file, more) in variants {
        for pose in deltamorph::PoseFormat::ALL.into_iter().filter(|pose| pose.decoder() == pose.name()) {
            let module = compile(file, ShaderStage::Vertex, Some(pose.name()), more);
            modules.push((format!("{name}_{}.vert.spv", pose.name()), module));
        }
    }
    modules
}

#[test]
fn modules_are_what_the_sources_compile_to() {
    let modules = modules();
    let mut manifest = String::new();
    for name in SOURCES {
        writeln!(manifest, "source {name} {:016x}", hash(source(name).as_bytes())).expect("text");
    }
    let generator = u32::from_le_bytes(modules[0].1[8..12].try_into().expect("a header"));
    writeln!(manifest, "glslang generator {generator:#010x}").expect("text");
    let (spirv, remedy) = (folder("spirv"), "run UPDATE_SPIRV=1 cargo test -p deltamorph-render --test spirv");
    if std::env::var_os("UPDATE_SPIRV").is_some_and(|v| v == "1") {
        fs::write(spirv.join("manifest.txt"), &manifest).expect("a file");
        modules.iter().for_each(|(name, bytes)| fs::write(spirv.join(name), bytes).expect("a file"));
    }
    let checked_in = fs::read_to_string(spirv.join("manifest.txt")).unwrap_or_default();
    let sources = |text: &str| text.lines().filter(|line| line.starts_with("source")).collect::<Vec<_>>().join("\n");
    assert_eq!(sources(&checked_in), sources(&manifest), "spirv/ is of other sources: {remedy}");
    let mut names: Vec<_> = fs::read_dir(&spirv).expect("spirv/").map(|e| e.expect("an entry").file_name()).collect();
    names.sort();
    let mut expected: Vec<OsString> = modules.iter().map(|(name, _)| name.into()).collect();
    expected.push("manifest.txt".into());
    expected.sort();
    assert_eq!(names, expected, "{remedy}");
    // Another version of glslang compiles the same sources to other modules.
    if checked_in == manifest {
        for (name, bytes) in modules {
            assert!(fs::read(spirv.join(&name)).expect("a module") == bytes, "{name} is not up to date: {remedy}");
        }
    }
}
