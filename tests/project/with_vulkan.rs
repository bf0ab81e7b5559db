//! The script `with-vulkan`, run on simulated systems: a folder as the root of the file system, and a `PATH` with only
//! the tools that the script may need. Nothing is installed and no driver is loaded.
#![cfg(unix)]

use std::{
    collections::BTreeMap,
    fs,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use tempfile::TempDir;

/// A simulated system. The script looks only into its folder.
struct System {
    dir: TempDir,
}

impl System {
    /// Makes a system with neither loader nor driver nor package manager; its `PATH` has only `tools`.
    fn bare(tools: &[&str]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let system = Self { dir };
        let bin = system.path("bin");
        fs::create_dir_all(&bin).unwrap();
        for tool in tools {
            system.tool(tool, tool);
        }
        system
    }

    /// Adds this machine's `tool` to the system's `PATH` under another name.
    fn tool(&self, tool: &str, name: &str) {
        let real = ["/usr/bin", "/bin", "/usr/local/bin"].map(|dir| Path::new(dir).join(tool));
        let real = real.iter().find(|path| path.exists()).unwrap_or_else(|| panic!("no {tool} on this machine"));
        symlink(real, self.path("bin").join(name)).unwrap();
    }

    /// Makes a system with a loader, lavapipe, the validation layers and a SwiftShader in the cache.
    fn complete() -> Self {
        let system =
            Self::bare(&["bash", "env", "grep", "uname", "mkdir", "mktemp", "chmod", "mv", "cat", "cksum", "tr"]);
        system.file("usr/lib/libvulkan.so.1", "knows VK_ADD_DRIVER_FILES");
        system.file("usr/share/vulkan/icd.d/lvp_icd.json", "{}");
        system.file("usr/share/vulkan/explicit_layer.d/VkLayer_khronos_validation.json", "{}");
        system.file("cache/deltamorph/swiftshader/libvk_swiftshader.so", "");
        system
    }

    fn path(&self, inside: &str) -> PathBuf {
        self.dir.path().join(inside)
    }

    fn file(&self, inside: &str, content: &str) {
        let path = self.path(inside);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// Returns the script's command, without installation.
    fn with_vulkan(&self, args: &[&str]) -> Command {
        let mut command = Command::new("bash");
        command
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("with-vulkan"))
            .args(args)
            .env_clear()
            .env("PATH", self.path("bin"))
            .env("HOME", self.path("home"))
            .env("XDG_CACHE_HOME", self.path("cache"))
            .env("DELTAMORPH_SYSROOT", self.dir.path())
            .env("DELTAMORPH_NO_INSTALL", "1");
        command
    }

    fn run(&self, args: &[&str]) -> Output {
        self.with_vulkan(args).output().unwrap()
    }

    fn lavapipe(&self) -> String {
        self.path("usr/share/vulkan/icd.d/lvp_icd.json").to_str().unwrap().to_owned()
    }

    fn swiftshader(&self) -> String {
        self.path("cache/deltamorph/swiftshader/vk_swiftshader_icd.json").to_str().unwrap().to_owned()
    }
}

fn environment(output: Output) -> BTreeMap<String, String> {
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(stderr(&output), "", "the script is silent where all is there");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(|line| line.split_once('=')).map(|(k, v)| (k.to_owned(), v.to_owned())).collect()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn variable<'a>(environment: &'a BTreeMap<String, String>, name: &str) -> Option<&'a str> {
    environment.get(name).map(String::as_str)
}

#[test]
fn exit_codes_are_those_of_the_command_or_of_wrong_usage() {
    for (args, code, words) in [
        (&["--driver=nouveau", "true"][..], 2, "lavapipe or swiftshader"),
        (&["--driver", "", "true"], 2, "swiftshader"),
        (&[], 2, "Usage: ./with-vulkan"),
        (&["--driver", "lavapipe"], 2, "Usage: ./with-vulkan"),
        (&["--driver"], 2, "Usage: ./with-vulkan"),
        (&["--"], 2, "Usage: ./with-vulkan"),
        (&["--drivers", "lavapipe", "true"], 2, "Usage: ./with-vulkan"),
        (&["--help"], 0, ""),
        (&["bash", "-c", "exit 7"], 7, ""),
        (&["no-such-command"], 127, "no-such-command"),
    ] {
        let output = System::complete().run(args);
        assert_eq!(output.status.code(), Some(code), "{args:?}");
        assert!(stderr(&output).contains(words), "{args:?}: {}", stderr(&output));
        let said = String::from_utf8_lossy(&output.stdout);
        assert_eq!(said.starts_with("Usage: ./with-vulkan"), code == 0, "{args:?}: {said}");
    }
}

/// The variables that the loader reads, by what was asked for and what is there.
#[test]
fn drivers_are_those_asked_for() {
    let system = System::complete();
    let own = "/some/icd.json";
    let (lavapipe, swiftshader) = (system.lavapipe(), system.swiftshader());
    let both = format!("{lavapipe}:{swiftshader}");
    let names = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_ADD_DRIVER_FILES"];
    let (new, old) = ("knows VK_ADD_DRIVER_FILES", "an old one");
    for (args, loader, given, expected) in [
        (&["--driver", "lavapipe"][..], new, None, [Some(&*lavapipe), Some(&*lavapipe), None]),
        (&["--driver", "swiftshader"], new, None, [Some(&*swiftshader), Some(&*swiftshader), None]),
        (&[], new, None, [None, None, Some(&*swiftshader)]),
        (&[], old, None, [Some(&*both), Some(&*both), None]),
        (&[], new, Some(own), [Some(own), None, None]),
    ] {
        system.file("usr/lib/libvulkan.so.1", loader);
        let mut command = system.with_vulkan(args);
        command.arg("env").envs(given.map(|given| ("VK_DRIVER_FILES", given)));
        let environment = environment(command.output().unwrap());
        let found = names.map(|name| variable(&environment, name));
        assert_eq!(found, expected, "{args:?}, {loader}");
        assert!(!args.contains(&"swiftshader") || variable(&environment, "NODEVICE_SELECT") == Some("1"));
    }
    let manifest = fs::read_to_string(swiftshader).unwrap();
    let library = system.path("cache/deltamorph/swiftshader/libvk_swiftshader.so");
    assert!(manifest.contains(&format!("\"library_path\": \"{}\"", library.display())), "{manifest}");
}

/// SwiftShader of one's own, and none.
#[test]
fn a_swiftshader_is_found_or_asked_for() {
    let system = System::complete();
    system.file("my \"own\"/libvk_swiftshader.so", "");
    let own = system.path("my \"own\"/libvk_swiftshader.so");
    let mut command = system.with_vulkan(&["--driver", "swiftshader", "env"]);
    let environment = environment(command.env("DELTAMORPH_SWIFTSHADER", &own).output().unwrap());
    let manifest = fs::read_to_string(variable(&environment, "VK_DRIVER_FILES").unwrap()).unwrap();
    let escaped = own.to_str().unwrap().replace('"', "\\\"");
    assert!(manifest.contains(&escaped), "{manifest}");

    fs::remove_file(system.path("cache/deltamorph/swiftshader/libvk_swiftshader.so")).unwrap();
    for (args, given, code, words) in [
        (&["--driver", "swiftshader", "env"][..], Some("/no/such/file"), 1, "/no/such/file"),
        (&["--driver", "swiftshader", "env"], None, 1, "DELTAMORPH_SWIFTSHADER"),
        (&["env"], None, 0, "going on without SwiftShader"),
    ] {
        let output = system.with_vulkan(args).envs(given.map(|own| ("DELTAMORPH_SWIFTSHADER", own))).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{args:?}");
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
        assert!(!String::from_utf8_lossy(&output.stdout).contains("VK_ADD_DRIVER_FILES"));
    }
}

#[test]
fn on_an_unknown_system_it_says_what_is_needed() {
    let system = System::bare(&["bash", "uname"]);
    let output = system.with_vulkan(&["cargo", "test"]).env_remove("DELTAMORPH_NO_INSTALL").output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let message = stderr(&output);
    for word in ["no package manager", "libvulkan.so.1", "lavapipe", "C++ compiler", "validation layers"] {
        assert!(message.contains(word), "no '{word}' in: {message}");
    }
    // Only tests of the C API and of the window need these.
    let run = stderr(&system.run(&["cargo", "run"]));
    for word in ["Vulkan headers", "valgrind", "pkg-config", "Xvfb", "X libraries"] {
        assert!(message.contains(word) && !run.contains(word), "'{word}' in: {message}\n{run}");
    }
}

#[test]
fn only_what_the_command_cannot_do_without_stops_it() {
    let system = System::complete();
    fs::remove_dir_all(system.path("usr/share/vulkan/explicit_layer.d")).unwrap();
    let output = system.run(&["env"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("validation layers"), "{}", stderr(&output));

    // Any driver will do for a plain run; the tests want lavapipe.
    let system = System::complete();
    fs::remove_file(system.lavapipe()).unwrap();
    system.file("usr/share/vulkan/icd.d/gpu_icd.json", "{}");
    system.tool("true", "cargo");
    // The program links the checked-in modules; the tests compile theirs.
    system.tool("true", "cc");
    assert_eq!(system.run(&["cargo", "run", "--release", "--", "test"]).status.code(), Some(0));
    for args in [&["cargo", "test"][..], &["cargo", "bench"], &["cargo", "clippy", "--all-targets"]] {
        let output = system.run(args);
        assert_eq!(output.status.code(), Some(1), "{args:?}");
        assert!(stderr(&output).contains("a C++ compiler"), "{}", stderr(&output));
    }
    system.tool("true", "c++");
    assert_eq!(system.run(&["cargo", "bench"]).status.code(), Some(0));
    let output = system.run(&["cargo", "test"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("lavapipe"), "{}", stderr(&output));
}
