//! The example, run as a host would: in a process of its own, under the validation layer.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const LAYER: &str = "VK_LAYER_KHRONOS_validation";

/// Returns the path of the example: `cargo test` builds it next to the tests' folder; with `--test` it does not.
fn example() -> PathBuf {
    let test = std::env::current_exe().expect("a path to this test");
    let path = test.ancestors().nth(2).expect("target/PROFILE").join("examples/minimal");
    let path = path.with_extension(std::env::consts::EXE_EXTENSION);
    let time = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
    let source = time(&Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/minimal.rs"));
    assert!(source.is_some() && time(&path) >= source, "{}: run cargo build --example minimal", path.display());
    path
}

/// Runs the example in a folder, on the device called `name`, with the layer enabled from outside.
fn run(name: &str, folder: &Path) -> Output {
    // Without a messenger the layer prints to stdout, and only errors by default. 1.3.239 knows synchronization
    // validation only by its old name, of which 1.4.363 warns.
    let settings = tempfile::tempdir().expect("a folder");
    let text = "khronos_validation.debug_action = VK_DBG_LAYER_ACTION_LOG_MSG\n\
                khronos_validation.report_flags = error,warn,perf\n\
                khronos_validation.enables = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT\n\
                khronos_validation.message_id_filter = VALIDATION-SETTINGS\n";
    std::fs::write(settings.path().join("vk_layer_settings.txt"), text).expect("a file");
    Command::new(example())
        .arg(name)
        .current_dir(folder)
        .env("VK_INSTANCE_LAYERS", LAYER)
        .env("VK_LAYER_SETTINGS_PATH", settings.path())
        .env("VK_LOADER_DEBUG", "layer")
        .output()
        .expect("the example starts")
}

/// Returns the layer's messages.
fn validation_lines(output: &str) -> Vec<&str> {
    let marks = ["Validation", "VUID", "SYNC-HAZARD", "UNASSIGNED", "ERROR", "WARNING"];
    output.lines().filter(|line| marks.iter().any(|mark| line.contains(mark))).collect()
}

/// Returns the pictures that the example wrote, one below the other.
fn pictures(folder: &Path) -> Vec<Vec<[u8; 3]>> {
    let file = std::fs::read(folder.join("head.ppm")).expect("a file");
    let (pixels, rest) = file.strip_prefix(b"P6 256 1024 255\n").expect("four pictures").as_chunks();
    assert!(pixels.len() == 256 * 1024 && rest.is_empty(), "{} pixels", pixels.len());
    pixels.chunks(256 * 256).map(<[_]>::to_vec).collect()
}

/// Returns how many pixels differ by more than `tolerance` in a component.
fn differing(a: &[[u8; 3]], b: &[[u8; 3]], tolerance: u8) -> usize {
    a.iter().zip(b).filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > tolerance)).count()
}

#[test]
fn the_example_draws_a_moving_face_and_is_valid_on_every_driver() {
    let [drawn, on_another] = ["llvmpipe", "SwiftShader"].map(valid_pictures);
    for (number, picture) in drawn.iter().enumerate() {
        let shown = differing(picture, &vec![picture[0]; picture.len()], 0);
        let (middle, corners) = (picture[128 * 256 + 128], [255, 255 * 256, 256 * 256 - 1].map(|at| picture[at]));
        assert!((10_000..40_000).contains(&shown), "picture {number}: {shown} pixels");
        assert!(middle != picture[0] && corners == [picture[0]; 3], "picture {number}: in its middle");
        let off = differing(picture, &on_another[number], 4);
        assert!(off * 200 < shown, "picture {number}: {off} of {shown} pixels differ between drivers");
    }
    for (number, pair) in drawn.windows(2).enumerate() {
        let moved = differing(&pair[0], &pair[1], 4);
        assert!((100..5_000).contains(&moved), "{moved} pixels between pictures {number} and {}", number + 1);
    }
}

/// Returns the pictures of a run without messages.
fn valid_pictures(name: &str) -> Vec<Vec<[u8; 3]>> {
    let folder = tempfile::tempdir().expect("a folder");
    let output = run(name, folder.path());
    let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{name}: {}\n{stdout}{stderr}\nrun as ./with-vulkan cargo test", output.status);
    assert_eq!(validation_lines(&stdout), <[&str; 0]>::default(), "{name}");
    let mut lines = stdout.lines();
    assert!(lines.next().is_some_and(|l| l.starts_with(name) && l.contains("60 poses")), "{name}: {stdout}");
    assert_eq!(lines.next(), None, "{name}: one line of result");
    // The lack of messages above only counts if the layer was loaded. The loader logs to stderr as well.
    for level in ["instance", "device"] {
        let layer = format!("{level} layer \"{LAYER}\"");
        let inserted = stderr.lines().any(|line| line.contains("Insert") && line.contains(&layer));
        assert!(inserted, "{name}: the loader did not insert the {layer}:\n{stderr}");
    }
    pictures(folder.path())
}

#[test]
fn a_device_that_is_not_there_is_a_failure() {
    let output = run("no such device", &std::env::temp_dir());
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("error: no such Vulkan 1.1 device\n"));
    let alone = Command::new(example())
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .env_remove("VK_ADD_DRIVER_FILES")
        .output()
        .expect("the example starts");
    let said = String::from_utf8_lossy(&alone.stderr);
    let told = "error: Vulkan: vkCreateInstance failed: ERROR_INCOMPATIBLE_DRIVER; check that";
    assert!(!alone.status.success() && said.contains(told), "{said}");
}
