//! The programs in C and C++, built against the library as a host builds them, and run as processes: with the
//! validation layer enabled from outside, and under valgrind.

use deltamorph::{DeltaFormat, PackDesc};
use deltamorph_head::{HeadDesc, head};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

const LAYER: &str = "VK_LAYER_KHRONOS_validation";
const STRICT: [&str; 5] = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-g"];
const SONAME: &str =
    concat!("libdeltamorph_c.so.", env!("CARGO_PKG_VERSION_MAJOR"), ".", env!("CARGO_PKG_VERSION_MINOR"));
const DRIVERS: [&str; 2] = ["llvmpipe", "SwiftShader"];

/// Returns those that `DELTAMORPH_TEST_DRIVERS` names, or lavapipe.
fn drivers() -> impl Iterator<Item = &'static str> {
    let asked = std::env::var("DELTAMORPH_TEST_DRIVERS").unwrap_or_else(|_| DRIVERS[0].into());
    DRIVERS.into_iter().filter(move |driver| asked.contains(driver))
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository").to_path_buf()
}

/// Returns the folder of the libraries: built here, since cargo does not build a library that Rust cannot link for a
/// test. No cargo process holds the target folder while tests run.
fn libraries() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let test = std::env::current_exe().expect("a path to this test");
        let folder = test.ancestors().nth(2).expect("target/PROFILE").to_path_buf();
        let profile = match folder.file_name().and_then(OsStr::to_str).expect("a profile") {
            "debug" => "dev",
            other => other,
        };
        let mut cargo = Command::new(env!("CARGO"));
        // With an example, so that other packages have the features which `cargo test` has built them with.
        let features = "deltamorph-c/csv,deltamorph-c/gltf";
        cargo.args(["build", "--lib", "--example", "minimal", "--features", features, "--profile", profile]);
        // target/TRIPLE/PROFILE where another processor is built for.
        let above = 1 + usize::from(std::env::var_os("CARGO_BUILD_TARGET").is_some());
        ran(cargo.arg("--target-dir").arg(folder.ancestors().nth(above).expect("target")).current_dir(root()));
        // As in capi/install: programs look up this name at start.
        ran(Command::new("ln").args(["-sf", "libdeltamorph_c.so"]).arg(folder.join(SONAME)));
        assert!(folder.join("libdeltamorph_c.so").is_file(), "{}: no libdeltamorph_c.so", folder.display());
        folder
    })
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn ran(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}{}", text(&output.stdout), text(&output.stderr));
    output
}

/// A program, and its folder.
struct Program(TempDir, PathBuf);

/// Compiles `source` (a path from the root of the repository) as a host does, with its text changed by `change`.
fn build(source: &str, change: impl FnOnce(String) -> String) -> Program {
    build_with("include", source, change)
}

/// [`build`], with the header of a folder.
fn build_with(headers: &str, source: &str, change: impl FnOnce(String) -> String) -> Program {
    let dir = tempfile::tempdir().expect("a folder");
    let (from, program) = (root().join(source), dir.path().join("program"));
    let copy = dir.path().join(from.file_name().expect("a file"));
    std::fs::write(&copy, change(std::fs::read_to_string(&from).expect("the source"))).expect("a copy");
    let (compiler, standard) = if source.ends_with(".cpp") { ("c++", "-std=c++17") } else { ("cc", "-std=c99") };
    let quoted = format!("-iquote{}", from.parent().expect("a folder").display());
    let mut command = Command::new(compiler);
    command.arg(standard).args(STRICT).arg("-pthread").arg(quoted).arg("-I").arg(root().join(headers)).arg(&copy);
    command.arg("-L").arg(libraries()).args(["-ldeltamorph_c", "-lvulkan", "-lm", "-o"]).arg(&program);
    ran(&mut command);
    Program(dir, program)
}

fn unchanged(text: String) -> String {
    text
}

fn replaced(from: &'static str, to: &'static str) -> impl FnOnce(String) -> String {
    move |text| {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        text.replace(from, to)
    }
}

impl Program {
    fn command(&self) -> Command {
        let mut command = Command::new(&self.1);
        command.env("LD_LIBRARY_PATH", libraries());
        command
    }

    /// Runs it with the layer enabled from outside, which then prints to stdout. 1.3.239 knows synchronization
    /// validation only by its old name, of which 1.4.363 warns.
    fn validated(&self, args: &[&OsStr]) -> Output {
        let settings = "khronos_validation.debug_action = VK_DBG_LAYER_ACTION_LOG_MSG\n\
                        khronos_validation.report_flags = error,warn,perf\n\
                        khronos_validation.enables = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT\n\
                        khronos_validation.message_id_filter = VALIDATION-SETTINGS\n";
        std::fs::write(self.0.path().join("vk_layer_settings.txt"), settings).expect("a file");
        let mut command = self.command();
        command.args(args).env("VK_INSTANCE_LAYERS", LAYER).env("VK_LAYER_SETTINGS_PATH", self.0.path());
        command.env("VK_LOADER_DEBUG", "layer").output().expect("the program starts")
    }

    /// What it prints when it succeeds: with the layer, which the loader says on stderr, and no message of the layer.
    fn said(&self, args: &[&OsStr]) -> String {
        let output = self.validated(args);
        let [said, stderr] = [&output.stdout, &output.stderr].map(|bytes| text(bytes));
        assert!(output.status.success(), "{args:?}: {said}{stderr}");
        assert_eq!(messages(&output), [""; 0]);
        for level in ["instance", "device"] {
            let layer = format!("{level} layer \"{LAYER}\"");
            let inserted = stderr.lines().any(|line| line.contains("Insert") && line.contains(&layer));
            assert!(inserted, "the loader did not insert the {layer}:\n{stderr}");
        }
        said
    }

    /// Runs it under valgrind, which exits with 9 if it finds an error.
    fn under_valgrind(&self, args: &[&str]) -> Output {
        let suppressions = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/valgrind.supp");
        let mut command = Command::new("valgrind");
        command.env("LD_LIBRARY_PATH", libraries()).args([
            "-q",
            "--error-exitcode=9",
            "--leak-check=full",
            "--num-callers=20",
        ]);
        command.args(["--errors-for-leak-kinds=definite,indirect,possible", "--fair-sched=yes"]);
        command.arg(format!("--suppressions={}", suppressions.display())).arg(&self.1).args(args);
        command.output().expect("valgrind (the package valgrind) starts")
    }
}

/// Returns the layer's messages.
fn messages(output: &Output) -> Vec<String> {
    let marks = ["Validation", "VUID", "SYNC-HAZARD", "UNASSIGNED", "ERROR", "WARNING"];
    let said = text(&output.stdout);
    said.lines().filter(|line| marks.iter().any(|mark| line.contains(mark))).map(str::to_owned).collect()
}

#[test]
fn the_c_program_is_right_and_valid_on_every_driver() {
    let program = build("examples/c/minimal.c", unchanged);
    let lines = std::fs::read_to_string(root().join("examples/c/minimal.c")).expect("the source").lines().count();
    assert!(lines < 200, "{lines} lines, for hosts to copy from");
    let head = head(&HeadDesc { vertices: 900, targets: 7, ..Default::default() });
    let packed = program.0.path().join("head.dmorph");
    head.pack(&PackDesc::new(DeltaFormat::Small)).expect("a mesh").write(&packed).expect("a file");
    let gltf = program.0.path().join("face.glb");
    ran(build("capi/tests/scene.c", unchanged).command().arg(DRIVERS[0]).arg(&gltf));
    for driver in drivers() {
        for (mesh, what) in [
            (Path::new("-"), "5000 vertices and 52 targets"),
            (&packed, "900 vertices and 7 targets"),
            (&gltf, "576 vertices and 6 targets"),
        ] {
            let said = program.said(&[mesh.as_os_str(), driver.as_ref()]);
            assert!(said.starts_with(driver) && said.contains(what) && said.lines().count() == 1, "{said}");
        }
    }
    let refused = program.command().arg("/no/such/mesh").output().expect("the program starts");
    assert!(!refused.status.success() && text(&refused.stderr).contains("cannot read"));
}

/// Programs that were there before this library.
#[test]
fn programs_built_with_the_first_header_of_this_version_run() {
    for (source, args) in [
        ("examples/c/minimal.c", &["-", DRIVERS[0]][..]),
        ("capi/tests/scene.c", &DRIVERS[..1]),
        ("capi/tests/clips.c", &DRIVERS[..1]),
    ] {
        ran(build_with("capi/tests/first", source, unchanged).command().args(args));
    }
}

#[test]
fn an_instance_of_vulkan_1_0_is_refused() {
    let old =
        build("examples/c/minimal.c", replaced(".apiVersion = VK_API_VERSION_1_1", ".apiVersion = VK_API_VERSION_1_0"));
    let output = old.command().args(["-", DRIVERS[0]]).output().expect("the program starts");
    let said = text(&output.stderr);
    assert!(!output.status.success() && said.contains("version 1.0; create it with apiVersion 1.1"), "{said}");
}

#[test]
fn the_layer_finds_a_missing_barrier() {
    let barrier = build("examples/c/minimal.c", replaced(" | DM_READ_BY_COPIES", ""));
    let output = barrier.validated(&["-".as_ref(), DRIVERS[0].as_ref()]);
    assert!(messages(&output).iter().any(|line| line.contains("SYNC-HAZARD")), "{}", text(&output.stdout));
}

/// A set, the host's own vertices, and all post-morph passes; the face from arrays, and from a .glb.
#[test]
fn a_scene_is_what_c_computes_in_double_precision() {
    let program = build("capi/tests/scene.c", unchanged);
    let gltf = program.0.path().join("face.glb");
    for driver in drivers() {
        for file in [None, Some(gltf.as_os_str())] {
            let args: Vec<&OsStr> = [OsStr::new(driver)].into_iter().chain(file).collect();
            let said = program.said(&args);
            assert!(said.starts_with("morphed: within") && said.lines().count() == 7, "{said}");
        }
    }
}

/// Clips, an added instance, bounds from weights.
#[test]
fn a_head_that_plays_clips_is_what_the_reference_says() {
    let program = build("capi/tests/clips.c", unchanged);
    for driver in drivers() {
        let said = program.said(&[driver.as_ref()]);
        assert!(said.starts_with("14 steps of 2 instances") && said.lines().count() == 1, "{said}");
    }
}

#[test]
fn invalid_use_is_refused_and_leaves_nothing_invalid_behind() {
    let program = build("capi/tests/misuse.c", unchanged);
    ran(program.command().arg("cpu"));
    drivers().for_each(|driver| drop(program.said(&["device".as_ref(), driver.as_ref()])));
}

#[test]
fn valgrind_finds_nothing_without_a_device() {
    let output = build("capi/tests/misuse.c", unchanged).under_valgrind(&["cpu"]);
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
}

#[test]
#[ignore = "minutes, since the driver compiles shaders under valgrind: .ci/deep"]
fn valgrind_finds_nothing_on_a_device() {
    for (source, args) in
        [("misuse.c", vec!["device", DRIVERS[0]]), ("scene.c", vec![DRIVERS[0]]), ("clips.c", vec![DRIVERS[0]])]
    {
        let output = build(&format!("capi/tests/{source}"), unchanged).under_valgrind(&args);
        assert!(output.status.success(), "{source}: {}{}", text(&output.stdout), text(&output.stderr));
    }
}

#[test]
fn cpp_owners_are_right_and_lose_nothing() {
    let program = build("examples/c/raii.cpp", unchanged);
    assert!(text(&ran(&mut program.command()).stdout).starts_with("59 poses move vertices"));
    let output = program.under_valgrind(&[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

/// The code of README.md, with what it leaves to the reader declared.
#[test]
fn the_code_of_the_readme_compiles() {
    let readme = std::fs::read_to_string(root().join("capi/README.md")).expect("the README");
    let blocks: Vec<&str> = readme.split("```c\n").skip(1).filter_map(|text| text.split("```").next()).collect();
    assert_eq!(blocks.len(), 2);
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("readme.c");
    for block in blocks {
        let code = format!(
            "#include <deltamorph.h>\n#include <vulkan/vulkan.h>\n\
             void code(VkInstance instance, VkPhysicalDevice physical, VkDevice vulkan_device, VkCommandBuffer cmd,\n\
             VkBuffer buffer, const void *vertices, const float **deltas, const uint32_t *indices,\n\
             uint32_t vertex_count, uint32_t index_count, const float *weights, uint32_t target_count,\n\
             DmEngine engine, DmMesh mesh, DmGpuMesh uploaded, DmCrowd crowd, DmPoseView pose) {{\n{block}}}\n"
        );
        std::fs::write(&file, code).expect("a file");
        let mut compiler = Command::new("cc");
        compiler.args(["-std=c99", "-fsyntax-only", "-Wno-unused-parameter"]).args(STRICT);
        ran(compiler.args(["-Wno-unused-parameter", "-I"]).arg(root().join("include")).arg(&file));
    }
}

/// The commands of README.md as printed, in a home folder of their own, produce a program that runs. Only the first is
/// left out, since it takes minutes: its folder exists, with the name used by hosts that build elsewhere.
#[test]
fn the_commands_of_the_readme_end_in_a_program_that_runs() {
    let readme = std::fs::read_to_string(root().join("capi/README.md")).expect("the README");
    let commands = readme.split("```sh\n").nth(1).and_then(|text| text.split("```").next()).expect("commands");
    let (build, rest) = commands.split_once('\n').expect("lines");
    assert!(build.starts_with("cargo build --profile small -p deltamorph-c "), "{build}");
    let home = tempfile::tempdir().expect("a folder");
    let work = home.path().join("repository");
    std::fs::create_dir_all(home.path().join("built")).expect("a folder");
    std::fs::create_dir(&work).expect("a folder");
    let link = |from: &Path, to: &Path| ran(Command::new("ln").arg("-s").arg(from).arg(to));
    link(libraries(), &home.path().join("built/small"));
    ["capi", "examples"].iter().for_each(|name| drop(link(&root().join(name), &work.join(name))));
    let mut shell = Command::new("sh");
    shell.args(["-euc", rest]).current_dir(&work).env_remove("PKG_CONFIG_PATH").env_remove("LD_LIBRARY_PATH");
    let output = ran(shell.env("HOME", home.path()).env("CARGO_TARGET_DIR", home.path().join("built")));
    assert!(text(&output.stdout).contains("5000 vertices and 52 targets"), "{}", text(&output.stdout));
    let program = work.join("minimal");
    let needed = text(&ran(Command::new("ldd").arg(&program).env_remove("LD_LIBRARY_PATH")).stdout);
    assert!(needed.contains(&format!("{SONAME} => {}", home.path().display())), "{needed}");
}

/// Installed as in README.md of this package; pkg-config and CMake then find it.
#[test]
fn an_installed_library_is_found_and_linked_in_both_forms() {
    let dir = tempfile::tempdir().expect("a folder");
    let (prefix, source) = (dir.path().join("prefix"), root().join("examples/c/raii.cpp"));
    ran(Command::new(root().join("capi/install")).arg(&prefix).arg(libraries()));
    let version = concat!("\"version\": \"", env!("CARGO_PKG_VERSION"), "\"");
    assert!(include_str!("../package/vcpkg/vcpkg.json").contains(version), "capi/package/vcpkg/vcpkg.json: {version}");
    let config = prefix.join("lib/pkgconfig");
    // The commands of the README link the shared library, which the linker prefers.
    let mut ask = Command::new("pkg-config");
    ask.args(["--static", "--cflags", "--libs", "deltamorph = 0.1.0"]).env("PKG_CONFIG_PATH", &config);
    let flags = text(&ran(&mut ask).stdout).replace("-ldeltamorph_c", "-l:libdeltamorph_c.a");
    let program = dir.path().join("static");
    ran(Command::new("c++").arg("-std=c++17").arg(&source).args(flags.split_whitespace()).arg("-o").arg(&program));
    ran(&mut Command::new(&program));
    if Command::new("cmake").arg("--version").output().is_err() {
        eprintln!("LEFT OUT: the CMake package, since there is no cmake");
        return;
    }
    let project = "cmake_minimum_required(VERSION 3.13)\nproject(host CXX)\nset(CMAKE_CXX_STANDARD 17)\n\
                   find_package(deltamorph 0.1 REQUIRED)\n\
                   add_executable(a raii.cpp)\ntarget_link_libraries(a deltamorph::deltamorph)\n\
                   add_executable(b raii.cpp)\ntarget_link_libraries(b deltamorph::static)\n";
    std::fs::write(dir.path().join("CMakeLists.txt"), project).expect("a file");
    std::fs::copy(&source, dir.path().join("raii.cpp")).expect("a copy");
    let build = dir.path().join("build");
    let prefix = format!("-DCMAKE_PREFIX_PATH={}", prefix.display());
    ran(Command::new("cmake").arg("-S").arg(dir.path()).arg("-B").arg(&build).arg(prefix));
    ran(Command::new("cmake").arg("--build").arg(&build));
    for program in ["a", "b"] {
        ran(&mut Command::new(build.join(program)));
    }
}
