//! Brings the SPIR-V modules into the build: compiled from glsl/ by glslang (feature `compile-shaders`), or as
//! checked in under spirv/.
//!
//! Either way OUT_DIR gets `manifest.txt` (what the modules were made from) and `modules.rs`, a table of
//! `(name, bytes)` that src/gpu/shaders.rs includes.

use formats::FORMATS;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

#[path = "src/abi/formats.rs"]
mod formats;

/// The largest batch of a feedback module per format: what 32 vertex attributes allow. Read by
/// src/gpu/shaders.rs through the table of modules, not repeated there.
const ATTRIBUTES: u32 = 32;

/// A module: its name, source file, and defines.
#[cfg_attr(not(feature = "compile-shaders"), expect(dead_code, reason = "only the compiler reads source and defines"))]
struct Module {
    name: String,
    source: &'static str,
    defines: Vec<(&'static str, Option<String>)>,
    /// The file under glsl/formats/ that is included as `format.glsl`.
    format: Option<&'static str>,
}

fn modules() -> Vec<Module> {
    let module = |name: &str, source, defines| Module { name: name.into(), source, defines, format: None };
    let mut list = vec![module("consume", "consume.vert", vec![]), module("read", "read.comp", vec![])];
    let animation = ["animate.comp", "budget.comp", "commit.comp", "plan.comp", "arguments.comp"];
    list.extend(animation.map(|source| module(source.trim_end_matches(".comp"), source, vec![])));
    for name in ["scatter", "resolve"] {
        let source = if name == "scatter" { "baselines/scatter.comp" } else { "baselines/resolve.comp" };
        list.push(module(name, source, vec![]));
    }
    for row in FORMATS.iter().filter(|row| !row.blocks) {
        let module = |name: String, source, defines: Vec<(&'static str, Option<String>)>| Module {
            format: Some(row.glsl),
            ..module(&name, source, defines)
        };
        let format = row.module;
        list.push(module(format!("dense_{format}"), "dense.comp", vec![]));
        list.push(module(format!("dense_list_{format}"), "dense_list.comp", vec![]));
        // One module per batch size; batch 0 copies.
        for (name, source) in [
            ("feedback", "feedback.vert"),
            ("vertex_store", "baselines/vertex_store.vert"),
            ("direct_attributes", "baselines/direct_attributes.vert"),
        ] {
            for batch in 0..=(ATTRIBUTES - 2) / row.attributes {
                let name = format!("{name}_{format}_{batch:02}");
                list.push(module(name, source, vec![("BATCH", Some(batch.to_string()))]));
            }
        }
        // The draw, and the same with its result captured, in the two ways that devices have.
        for (end, capture) in [("", None), ("_feedback", Some("FEEDBACK")), ("_store", Some("STORE"))] {
            let defines = capture.into_iter().map(|c| (c, None)).collect();
            list.push(module(format!("direct_{format}{end}"), "baselines/direct.vert", defines));
        }
    }
    for row in FORMATS.iter().filter(|row| row.blocks) {
        for exact in [Some(false), row.integers.then_some(true)].into_iter().flatten() {
            let mut add = |kernel: &str, source, texels: Option<&'static str>| {
                let suffix = [if exact { "_exact" } else { "" }, if texels.is_some() { "_texels" } else { "" }];
                let defines = exact.then_some("EXACT").into_iter().chain(texels);
                let name = format!("{kernel}_{}{}", row.module, suffix.concat());
                let module = module(&name, source, defines.map(|d| (d, None)).collect());
                list.push(Module { format: Some(row.glsl), ..module });
            };
            add("blocks", "blocks.comp", None);
            add("crowd", "crowd.comp", None);
            // For software drivers.
            if row.name == "fast" {
                add("crowd", "crowd.comp", Some("TEXELS"));
            }
        }
    }
    list
}

/// FNV-1a, 64 bits: names sources in the manifest, independent of platform and compiler.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3))
}

/// The files of a folder and of the folders in it.
fn files_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let paths = entries.map(|e| e.expect("a folder entry").path());
    let mut files: Vec<PathBuf> = paths.flat_map(|p| if p.is_dir() { files_in(&p) } else { vec![p] }).collect();
    files.sort();
    files
}

/// A line per source file.
fn source_manifest(glsl: &Path) -> String {
    let mut text = String::new();
    for file in files_in(glsl) {
        let bytes = fs::read(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let parts = file.strip_prefix(glsl).expect("a file of this folder").components();
        let name: Vec<_> = parts.map(|part| part.as_os_str().to_string_lossy()).collect();
        writeln!(text, "source {} {:016x}", name.join("/"), hash(&bytes)).unwrap();
    }
    text
}

#[cfg(feature = "compile-shaders")]
fn compile(module: &Module, glsl: &Path) -> Vec<u8> {
    use glslang::include::{IncludeHandler, IncludeResult, IncludeType};
    use glslang::{
        Compiler, CompilerOptions, ShaderInput, ShaderSource, ShaderStage, SourceLanguage, SpirvVersion, Target,
        VulkanVersion,
    };

    /// Files of glsl/, and as `format.glsl` the file of the module's format.
    struct Includes<'a>(&'a Path, Option<&'static str>);
    impl IncludeHandler for Includes<'_> {
        fn include(&mut self, _: IncludeType, name: &str, _: &str, _: usize) -> Option<IncludeResult> {
            let path = match (name, self.1) {
                ("format.glsl", Some(format)) => self.0.join("formats").join(format),
                _ => self.0.join(name),
            };
            let data = fs::read_to_string(path).ok()?;
            Some(IncludeResult { name: name.into(), data })
        }
    }

    let path = glsl.join(module.source);
    let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let fail = |e: glslang::error::GlslangError| -> ! { panic!("{} (module {}): {e}", path.display(), module.name) };
    let options = CompilerOptions {
        source_language: SourceLanguage::GLSL,
        target: Target::Vulkan { version: VulkanVersion::Vulkan1_1, spirv_version: SpirvVersion::SPIRV1_3 },
        ..CompilerOptions::default()
    };
    let stage = if module.source.ends_with(".vert") { ShaderStage::Vertex } else { ShaderStage::Compute };
    let defines: Vec<(&str, Option<&str>)> = module.defines.iter().map(|(k, v)| (*k, v.as_deref())).collect();
    let mut includes = Includes(glsl, module.format);
    let source = ShaderSource::from(text);
    let compiler = Compiler::acquire().expect("the only user of glslang in this process");
    let input =
        ShaderInput::new(&source, stage, &options, Some(&defines[..]), Some(&mut includes)).unwrap_or_else(|e| fail(e));
    let shader = compiler.create_shader(input).unwrap_or_else(|e| fail(e));
    let words = shader.compile().unwrap_or_else(|e| fail(e));
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=glsl");
    println!("cargo::rerun-if-changed=src/abi/formats.rs");
    println!("cargo::rerun-if-changed=spirv");
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("set by cargo"));
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    let (glsl, spirv) = (root.join("glsl"), root.join("spirv"));
    let mut manifest = source_manifest(&glsl);
    let mut table = String::from("[\n");

    for module in &modules() {
        let file = format!("{}.spv", module.name);
        #[cfg(feature = "compile-shaders")]
        let path = {
            let bytes = compile(module, &glsl);
            let generator = u32::from_le_bytes(bytes[8..12].try_into().expect("a SPIR-V header"));
            if !manifest.starts_with("glslang") {
                manifest.insert_str(0, &format!("glslang generator {generator:#010x}\n"));
            }
            writeln!(manifest, "module {file} {:016x}", hash(&bytes)).unwrap();
            fs::write(out.join(&file), bytes).expect("OUT_DIR can be written");
            out.join(&file)
        };
        #[cfg(not(feature = "compile-shaders"))]
        let path = spirv.join(&file);
        writeln!(table, "    ({:?}, include_bytes!({path:?}) as &[u8]),", module.name).unwrap();
    }
    table.push(']');

    if cfg!(not(feature = "compile-shaders")) {
        let path = spirv.join("manifest.txt");
        let checked_in = fs::read_to_string(&path).unwrap_or_else(|e| {
            panic!("{}: {e}; restore the folder spirv/, or build with the feature 'compile-shaders'", path.display())
        });
        if manifest.lines().any(|line| !checked_in.lines().any(|l| l == line)) {
            println!(
                "cargo::warning=glsl/ differs from what spirv/ was compiled from: the modules of spirv/ are linked. \
                 Regenerate with `UPDATE_SPIRV=1 cargo test --test spirv`, or build with the feature 'compile-shaders'."
            );
        }
        manifest = checked_in;
    }
    fs::write(out.join("manifest.txt"), manifest).expect("OUT_DIR can be written");
    fs::write(out.join("modules.rs"), table).expect("OUT_DIR can be written");
}
