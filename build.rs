//! Brings the SPIR-V modules into the build: compiled from glsl/ by glslang (feature `compile-shaders`), or as
//! checked in under spirv/.
//!
//! The table of kernels (src/abi/kernels.rs) says which modules there are. OUT_DIR gets
//! - `modules.rs`, which src/abi/modules.rs includes: the modules, without debug names, and a `static` for each kernel;
//! - `manifest.txt`: what the modules were made from;
//! - `*.spv`: the modules as compiled, which `tests/spirv` compares with spirv/.

use formats::{FORMATS, FormatRow, POSE_FORMATS, PoseRow};
use kernels::{KERNELS, KernelRow, Takes, batch_max};
use lzma_rust2::{LzmaOptions, LzmaWriter};
use std::fmt::Write as _;
use std::io::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::{env, fs};

#[allow(dead_code, unused_imports, reason = "the library needs more of it")]
#[path = "src/abi/formats.rs"]
mod formats;
#[allow(dead_code, reason = "the library undoes it")]
#[path = "src/abi/ids.rs"]
mod ids;
#[allow(dead_code, reason = "the library needs more of it")]
#[path = "src/abi/kernels.rs"]
mod kernels;
#[allow(dead_code, reason = "shaders need the list alone")]
#[path = "src/abi/numbers.rs"]
mod numbers;

/// A module: a kernel for a pair of formats and a number of targets.
struct Module {
    name: String,
    #[cfg_attr(not(feature = "compile-shaders"), expect(dead_code, reason = "only the compiler reads it"))]
    kernel: &'static KernelRow,
    format: Option<&'static FormatRow>,
    #[cfg_attr(not(feature = "compile-shaders"), expect(dead_code, reason = "only the compiler reads it"))]
    pose: &'static PoseRow,
    batch: Option<u32>,
}

/// The modules of a kernel for a pair of formats, or those of a kernel that reads no deltas.
fn modules(kernel: &'static KernelRow, format: Option<&'static FormatRow>, pose: &'static PoseRow) -> Vec<Module> {
    let batches = match (kernel.takes, format) {
        (Takes::DenseBatches, Some(format)) => (0..=batch_max(format)).map(Some).collect(),
        _ => vec![None],
    };
    let module = |batch: Option<u32>| {
        let batch_name = batch.map(|b| format!("{b:02}")).unwrap_or_default();
        let pose_name = if *pose == POSE_FORMATS[0] { "" } else { pose.file };
        let parts = [kernel.name, format.map_or("", |f| f.file), kernel.suffix, pose_name, &batch_name];
        let name = parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("_");
        Module { name, kernel, format, pose, batch }
    };
    batches.into_iter().map(module).collect()
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

/// What shaders include as `abi.glsl`.
fn abi_glsl() -> String {
    numbers::SHARED.iter().fold(String::new(), |text, (name, value)| text + &format!("#define {name} {value}u\n"))
}

/// A line per source file.
fn source_manifest(glsl: &Path) -> String {
    let mut text = format!("source abi.glsl {:016x}\n", hash(abi_glsl().as_bytes()));
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

    /// Files of glsl/; `abi.glsl`; and as `format.glsl` and `pose.glsl` the files of the module's formats.
    struct Includes<'a>(&'a Path, &'a Module);
    impl IncludeHandler for Includes<'_> {
        fn include(&mut self, _: IncludeType, name: &str, _: &str, _: usize) -> Option<IncludeResult> {
            let file = match name {
                "abi.glsl" => return Some(IncludeResult { name: name.into(), data: abi_glsl() }),
                "format.glsl" => format!("formats/{}.glsl", self.1.format?.file),
                "pose.glsl" => format!("poses/{}.glsl", self.1.pose.file),
                _ => name.to_owned(),
            };
            Some(IncludeResult { name: name.into(), data: fs::read_to_string(self.0.join(file)).ok()? })
        }
    }

    let path = glsl.join(module.kernel.source());
    let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let fail = |e: glslang::error::GlslangError| -> ! { panic!("{} (module {}): {e}", path.display(), module.name) };
    let options = CompilerOptions {
        source_language: SourceLanguage::GLSL,
        target: Target::Vulkan { version: VulkanVersion::Vulkan1_1, spirv_version: SpirvVersion::SPIRV1_3 },
        ..CompilerOptions::default()
    };
    let stage = match module.kernel.stage {
        kernels::Stage::Vertex => ShaderStage::Vertex,
        kernels::Stage::Fragment => ShaderStage::Fragment,
        kernels::Stage::Compute | kernels::Stage::ComputeSized => ShaderStage::Compute,
    };
    let batch = module.batch.map(|b| b.to_string());
    // What host/pose.glsl asks for.
    let pose = format!("POSE_{}", module.pose.file.to_uppercase());
    let flags = module.kernel.defines.iter().copied().chain([pose.as_str()]).map(|flag| (flag, None));
    let defines: Vec<(&str, Option<&str>)> = flags.chain(batch.as_deref().map(|b| ("BATCH", Some(b)))).collect();
    let mut includes = Includes(glsl, module);
    let source = ShaderSource::from(text);
    let compiler = Compiler::acquire().expect("the only user of glslang in this process");
    let input =
        ShaderInput::new(&source, stage, &options, Some(&defines[..]), Some(&mut includes)).unwrap_or_else(|e| fail(e));
    let shader = compiler.create_shader(input).unwrap_or_else(|e| fail(e));
    let words = shader.compile().unwrap_or_else(|e| fail(e));
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// A module as it is embedded, before compression: without names and other debug instructions, and with differences
/// between ids.
fn embedded(spirv: &[u8]) -> Vec<u8> {
    /// OpSourceContinued to OpLine, OpNoLine, OpModuleProcessed.
    const DEBUG: [u32; 9] = [2, 3, 4, 5, 6, 7, 8, 317, 330];
    let words: Vec<u32> = spirv.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
    let (mut kept, mut rest) = (words[..5].to_vec(), &words[5..]);
    while let [first, ..] = *rest {
        let (instruction, after) = rest.split_at((first >> 16) as usize);
        if !DEBUG.contains(&(first & 0xffff)) {
            kept.extend_from_slice(instruction);
        }
        rest = after;
    }
    ids::to_differences(&mut kept);
    kept.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// A `.lzma` file of words.
fn compressed(words: &[u8]) -> Vec<u8> {
    // What a byte is likely to be follows from its place in the word (lp, pb), and not from the byte before (lc).
    let dict_size = (words.len() as u32).max(lzma_rust2::DICT_SIZE_MIN);
    let options = LzmaOptions { dict_size, lc: 0, lp: 2, pb: 2, ..LzmaOptions::with_preset(9) };
    let writer = LzmaWriter::new_use_header(vec![], &options, Some(words.len() as u64));
    let mut writer = writer.expect("options that LZMA has");
    writer.write_all(words).and_then(|()| writer.finish()).expect("vectors take what is written")
}

/// The text of `modules.rs`.
#[derive(Default)]
struct Table {
    modules: String,
    count: usize,
    kernels: String,
}

impl Table {
    /// `file` has the modules of the kernel, compressed; this one is `bytes` of what they were.
    fn add_module(&mut self, row: usize, module: &Module, file: &Path, bytes: Range<usize>) {
        let place = |format| FORMATS.iter().position(|f| f == format).expect("a row of the table");
        let format = module.format.map(|format| format!("Some(&FORMATS[{}])", place(format)));
        writeln!(
            self.modules,
            "    Module {{ name: {:?}, kernel: &KERNELS[{row}], format: {}, batch: {}, modules: include_bytes!({file:?}), bytes: {bytes:?} }},",
            module.name,
            format.as_deref().unwrap_or("None"),
            module.batch.unwrap_or(0),
        )
        .unwrap();
        self.count += 1;
    }

    /// `modules`: first and number for each format of poses and of deltas.
    fn add_kernel(&mut self, row: usize, modules: &[[(usize, usize); FORMATS.len()]]) {
        let kernel = &KERNELS[row];
        let source = kernel.source();
        let name = [kernel.name, kernel.suffix].join(if kernel.suffix.is_empty() { "" } else { "_" }).to_uppercase();
        match (kernel.takes, kernel.poses, kernel.baseline) {
            (Takes::NoDeltas, false, false) => {
                writeln!(self.kernels, "/// {source}\npub static {name}: &Module = &MODULES[{}];", modules[0][0].0)
            }
            _ => writeln!(
                self.kernels,
                "/// {source}\npub static {name}: Kernel = Kernel {{ row: &KERNELS[{row}], modules: {modules:?} }};"
            ),
        }
        .unwrap();
    }
}

/// What to do where a module is missing.
const REMEDY: &str = "restore the folder spirv/, compile it anew with `UPDATE_SPIRV=1 cargo test -p deltamorph-spirv`, \
                      or build with the feature 'compile-shaders'";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=glsl");
    println!("cargo::rerun-if-changed=spirv");
    for file in ["formats", "ids", "kernels", "numbers"] {
        println!("cargo::rerun-if-changed=src/abi/{file}.rs");
    }
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("set by cargo"));
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    let (glsl, spirv) = (root.join("glsl"), root.join("spirv"));
    #[cfg_attr(not(feature = "compile-shaders"), expect(unused_mut, reason = "only the compiler adds to it"))]
    let mut manifest = source_manifest(&glsl);
    let mut table = Table::default();
    for (row, kernel) in KERNELS.iter().enumerate() {
        // Modules of a kernel are alike: compressed together, they take a tenth of what they are.
        let (mut embedded_modules, kernel_file) = (vec![], out.join([kernel.name, kernel.suffix].join("_")));
        let mut add = |format, pose| {
            let (first, modules) = (table.count, modules(kernel, format, pose));
            for module in &modules {
                let file = format!("{}.spv", module.name);
                #[cfg(feature = "compile-shaders")]
                let bytes = {
                    let bytes = compile(module, &glsl);
                    let generator = u32::from_le_bytes(bytes[8..12].try_into().expect("a SPIR-V header"));
                    if !manifest.starts_with("glslang") {
                        manifest.insert_str(0, &format!("glslang generator {generator:#010x}\n"));
                    }
                    writeln!(manifest, "module {file} {:016x}", hash(&bytes)).unwrap();
                    bytes
                };
                #[cfg(not(feature = "compile-shaders"))]
                let bytes = fs::read(spirv.join(&file)).unwrap_or_else(|e| panic!("spirv/{file}: {e}; {REMEDY}"));
                fs::write(out.join(&file), &bytes).expect("OUT_DIR can be written");
                let begin = embedded_modules.len();
                embedded_modules.extend(embedded(&bytes));
                table.add_module(row, module, &kernel_file, begin..embedded_modules.len());
            }
            (first, modules.len())
        };
        let linked = !kernel.baseline || cfg!(feature = "baselines");
        let mut places = vec![[(0, 0); FORMATS.len()]; POSE_FORMATS.len()];
        let own = |pose: &PoseRow| linked && pose.modules == pose.file;
        for (pose, places) in POSE_FORMATS.iter().zip(&mut places).filter(|(pose, _)| own(pose)) {
            // A kernel that reads no deltas has the same module for each format.
            if kernel.takes(None, pose) {
                places.fill(add(None, pose));
            }
            for (format, place) in FORMATS.iter().zip(places).filter(|(format, _)| kernel.takes(Some(format), pose)) {
                *place = add(Some(format), pose);
            }
        }
        table.add_kernel(row, &places);
        fs::write(&kernel_file, compressed(&embedded_modules)).expect("OUT_DIR can be written");
    }

    if cfg!(not(feature = "compile-shaders")) {
        let path = spirv.join("manifest.txt");
        let checked_in = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}; {REMEDY}", path.display()));
        if manifest.lines().any(|line| !checked_in.lines().any(|l| l == line)) {
            println!(
                "cargo::warning=glsl/ differs from what spirv/ was compiled from: the modules of spirv/ are linked. \
                 Regenerate with `UPDATE_SPIRV=1 cargo test -p deltamorph-spirv`, or build with the feature 'compile-shaders'."
            );
        }
    }
    let Table { modules, count, kernels } = table;
    let text = format!("/// Every module.\npub static MODULES: [Module; {count}] = [\n{modules}];\n{kernels}");
    fs::write(out.join("manifest.txt"), manifest).expect("OUT_DIR can be written");
    fs::write(out.join("modules.rs"), text).expect("OUT_DIR can be written");
}
