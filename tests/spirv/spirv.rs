//! Tests that the SPIR-V modules that are checked in equal their sources, compiled by glslang: those of the library, of
//! the renderer and of the example. `UPDATE_SPIRV=1 cargo test -p deltamorph-spirv` writes them.
#![cfg(test)]

use deltamorph::PoseFormat;
use deltamorph::internals::abi::modules::{COMPILED, MANIFEST, MODULES};
use glslang::include::{IncludeHandler, IncludeResult, IncludeType};
use glslang::{
    Compiler, CompilerOptions, ShaderInput, ShaderSource, ShaderStage, SourceLanguage, SpirvVersion, Target,
    VulkanVersion,
};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const REMEDY: &str = "run UPDATE_SPIRV=1 cargo test -p deltamorph-spirv";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Compares the files of a folder with `expected`, or writes them.
fn compare(folder: &str, expected: &BTreeMap<String, Vec<u8>>) {
    let path = root().join(folder);
    let entries = fs::read_dir(&path).expect("a folder").map(|entry| entry.expect("an entry"));
    let compiled = entries.filter(|entry| expected.contains_key("manifest.txt") || is_module(&entry.path()));
    let names: Vec<String> = compiled.map(|entry| entry.file_name().into_string().expect("a name")).collect();
    if std::env::var_os("UPDATE_SPIRV").is_some_and(|value| value == "1") {
        names.iter().for_each(|name| fs::remove_file(path.join(name)).expect("a file"));
        expected.iter().for_each(|(name, bytes)| fs::write(path.join(name), bytes).expect("a file"));
        return;
    }
    for name in &names {
        assert!(expected.contains_key(name), "{folder}/{name} has no source: {REMEDY}");
    }
    for (name, bytes) in expected {
        let found = fs::read(path.join(name)).unwrap_or_default();
        assert!(found == *bytes, "{folder}/{name} is not what its source compiles to: {REMEDY}");
    }
}

fn is_module(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "spv")
}

#[test]
fn modules_of_the_library_are_what_glsl_compiles_to() {
    let module = |name: String| (fs::read(Path::new(COMPILED).join(&name)).expect("build.rs writes it"), name);
    let modules = MODULES.iter().map(|of| module(format!("{}.spv", of.name))).map(|(bytes, name)| (name, bytes));
    let manifest = ("manifest.txt".to_owned(), MANIFEST.as_bytes().to_vec());
    let expected: BTreeMap<_, _> = modules.chain([manifest]).collect();
    assert_eq!(expected.len(), MODULES.len() + 1, "names are distinct");
    compare("spirv", &expected);
}

/// The folder that files are included from; poses are decoded by the file that hosts get.
struct Includes(PathBuf);
impl IncludeHandler for Includes {
    fn include(&mut self, _: IncludeType, name: &str, _: &str, _: usize) -> Option<IncludeResult> {
        let file = if name == "pose.glsl" { root().join("glsl/host/pose.glsl") } else { self.0.join(name) };
        Some(IncludeResult { name: name.into(), data: fs::read_to_string(file).ok()? })
    }
}

/// Returns the module of a file, whose stage follows from its name.
fn compile(folder: &str, file: &str, defines: &[String]) -> Vec<u8> {
    let options = CompilerOptions {
        source_language: SourceLanguage::GLSL,
        target: Target::Vulkan { version: VulkanVersion::Vulkan1_1, spirv_version: SpirvVersion::SPIRV1_3 },
        ..CompilerOptions::default()
    };
    let stage = if file.ends_with(".vert") { ShaderStage::Vertex } else { ShaderStage::Fragment };
    let defines: Vec<(&str, Option<&str>)> = defines.iter().map(|define| (define.as_str(), None)).collect();
    let text = fs::read_to_string(root().join(folder).join(file)).unwrap_or_else(|e| panic!("{folder}/{file}: {e}"));
    let text = ShaderSource::from(text);
    let mut includes = Includes(root().join(folder));
    let compiler = Compiler::acquire().expect("one compiler at a time");
    let input = ShaderInput::new(&text, stage, &options, Some(&defines[..]), Some(&mut includes));
    let shader = compiler.create_shader(input.unwrap_or_else(|e| panic!("{file}: {e}")));
    let words = shader.unwrap_or_else(|e| panic!("{file}: {e}")).compile().unwrap_or_else(|e| panic!("{file}: {e}"));
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

#[test]
fn modules_of_the_renderer_and_of_the_example_are_what_their_sources_compile_to() {
    let folder = "examples/shaders";
    let module = |file: &str| (format!("{file}.spv"), compile(folder, file, &[]));
    compare(folder, &["head.vert", "head.frag"].map(module).into());

    let folder = "render/glsl";
    let mut expected = BTreeMap::from([("face.frag.spv".to_owned(), compile(folder, "face.frag", &[]))]);
    for (name, file) in [("face", "face"), ("motion", "face"), ("masks", "face"), ("shadow", "shadow")] {
        for pose in PoseFormat::ALL.into_iter().filter(|pose| pose.decoder() == pose.name()) {
            let defines = [name, &format!("POSE_{}", pose.name())].map(str::to_uppercase);
            let module = compile(folder, &format!("{file}.vert"), &defines);
            expected.insert(format!("{name}_{}.vert.spv", pose.name()), module);
        }
    }
    compare("render/spirv", &expected);
}
