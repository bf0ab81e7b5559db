//! `view` in an X server without a screen, under the validation layers: effects of scripts on the window, its pictures
//! and messages, and constant memory over resizes and frames.
//!
//! `DELTAMORPH_VIEW_SOAK=1` makes it 1,000 resizes and 10,000 frames.
#![cfg(feature = "viewer")]

#[path = "common/cli.rs"]
mod cli;
#[path = "common/display.rs"]
mod display;

use cli::pixels;
use display::Display;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

/// A small head with ARKit's targets.
const MESH: [&str; 4] = ["--vertices", "2500", "--targets", "52"];

impl Display {
    /// Runs the program in a window here, on lavapipe: SwiftShader lacks the surfaces of windows.
    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_deltamorph"));
        command.arg("view").args(args).env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY");
        command
    }

    fn view(&self, args: &[&str]) -> Output {
        self.command(&[&["--device", "llvmpipe", "--validation"], args].concat()).output().expect("it starts")
    }

    /// Runs a script; there must be no messages.
    fn script(&self, folder: &Path, name: &str, args: &[&str], script: &str) -> String {
        let file = folder.join(name);
        std::fs::write(&file, script).expect("a script");
        let out = self.view(&[args, &["--script", file.to_str().expect("UTF-8")]].concat());
        let said = error_lines(&out);
        assert!(out.status.success() && said.is_empty(), "{name}: {said}");
        String::from_utf8(out.stdout).expect("text")
    }
}

/// Returns its messages, without the remark that the driver is slow.
fn error_lines(out: &Output) -> String {
    let said = String::from_utf8_lossy(&out.stderr);
    said.lines().filter(|line| !line.starts_with("warning: ")).collect::<Vec<_>>().join("\n")
}

fn error_of(out: &Output) -> (Option<i32>, String) {
    let said = error_lines(out);
    assert!(!out.status.success() && !said.contains("panicked"), "{said}");
    (out.status.code(), said)
}

/// Returns the fraction of the pixels of two pictures of the same size that differ by more than rounding.
fn differing(a: &Path, b: &Path) -> f64 {
    let ((size, a), (other, b)) = (pixels(a), pixels(b));
    assert_eq!(size, other);
    let far = |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2);
    a.chunks_exact(4).zip(b.chunks_exact(4)).filter(far).count() as f64 / f64::from(size[0] * size[1])
}

#[test]
fn a_script_does_what_a_hand_can_and_the_window_shows_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::new();
    let at = |name: &str| folder.path().join(format!("{name}.png"));
    let clip = folder.path().join("clip.csv");
    let rows: String = (0..24).map(|i| f64::from(i) / 24.0).map(|w| format!("{w},{}\n", 1.0 - w)).collect();
    std::fs::write(&clip, format!("jawOpen,mouthSmileLeft\n{rows}")).expect("a clip");
    let mut script = String::from("panel off\nframes 2\n");
    let mut shot = |steps: &str, name: &str| {
        writeln!(script, "{steps}\nscreenshot {}", at(name).display()).expect("text");
    };
    shot("", "rest");
    shot("set jawOpen 1", "jaw");
    shot("reset", "rest-again");
    shot("pan 0.2,0.1\nzoom 2", "panned");
    shot("home", "home");
    shot(&format!("clip {}\nscrub 11", clip.display()), "clip");
    shot("play\nframes 20\npause", "played");
    shot("play\nframes 30\nshow blocks\nframes 5\npause", "blocks");
    for look in ["wire", "normals", "heat", "motion", "shaded"] {
        shot(&format!("show {look}"), look);
    }
    shot("reset\ncamera 80,10", "side");
    shot("camera 18,4\nresize 560 400", "resized");
    shot("panel on\nframes 3", "panel");
    shot("set jawOpen 0.25\nset jawForward 0.5", "sliders");
    // A weight that poses of integers do not hold closes no window.
    shot("set jawOpen 300\nframes 2", "held");
    display.script(
        folder.path(),
        "script.txt",
        &[&MESH[..], &["--size", "320x240", "--pose", "fixed16"]].concat(),
        &script,
    );

    let differ = |a: &str, b: &str| differing(&at(a), &at(b));
    for (a, b, least) in [
        ("rest", "jaw", 0.005),
        ("rest", "clip", 0.001),
        ("rest", "panned", 0.05),
        ("clip", "played", 0.001),
        ("rest", "side", 0.1),
        ("wire", "normals", 0.05),
        ("normals", "heat", 0.05),
        ("heat", "motion", 0.01),
        ("motion", "shaded", 0.05),
        ("blocks", "shaded", 0.02),
        ("resized", "panel", 0.3),
        ("panel", "sliders", 0.01),
    ] {
        let share = differ(a, b);
        println!("{a} and {b} differ in {share}");
        assert!(share > least, "{a} and {b} differ in {share} of their pixels");
    }
    assert_eq!(differ("rest", "rest-again"), 0.0, "after a reset all is as it was");
    assert_eq!(differ("rest", "home"), 0.0, "the camera is where it was");
    assert_eq!((pixels(&at("rest")).0, pixels(&at("resized")).0), ([320, 240], [560, 400]));
}

#[test]
fn a_screen_with_a_scale_shows_as_much() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::new();
    for scale in [1, 2] {
        let at = |name: &str| folder.path().join(format!("{name}{scale}.png"));
        let mut script = String::new();
        for (name, steps) in [("low", ""), ("bare", "panel off"), ("tall", "panel on\nresize 300 500")] {
            writeln!(script, "{steps}\nscreenshot {}", at(name).display()).expect("text");
        }
        let file = folder.path().join("script.txt");
        std::fs::write(&file, &script).expect("a script");
        let args =
            ["--size", "640x400", "--script", file.to_str().expect("UTF-8"), "--device", "llvmpipe", "--validation"];
        let mut command = display.command(&[&MESH[..], &args].concat());
        let out = command.env("WINIT_X11_SCALE_FACTOR", scale.to_string()).output().expect("it starts");
        assert!(out.status.success() && error_lines(&out).is_empty(), "{}", error_lines(&out));
        assert_eq!(pixels(&at("low")).0, [640 * scale, 400 * scale]);
        assert_eq!(pixels(&at("tall")).0, [300 * scale, 500 * scale]);
        // The panel is there at any scale.
        let share = differing(&at("low"), &at("bare"));
        assert!(share > 0.2, "a panel changes {share} of the pixels at scale {scale}");
    }
}

#[test]
fn resizes_and_frames_take_no_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::new();
    let whole = std::env::var_os("DELTAMORPH_VIEW_SOAK").is_some_and(|v| v == "1");
    let (resizes, frames) = if whole { (1_000, 10_000) } else { (40, 300) };
    let file = |name: &str| folder.path().join(format!("{name}.png"));
    let resized = |count: usize| {
        let sizes = [[200, 150], [260, 170], [180, 200], [240, 240]];
        (0..count).map(|i| sizes[i % 4]).map(|[w, h]| format!("resize {w} {h}\nframes 2\n")).collect::<String>()
    };
    let shot = |name: &str| format!("screenshot {}\n", file(name).display());
    // Memory that drivers and allocators keep is allocated by the first ones.
    let script = [
        "play\n".into(),
        resized(24 + resizes / 5),
        format!("frames {}\n", frames / 6),
        shot("begin"),
        resized(resizes),
        shot("resized"),
        format!("frames {frames}\n"),
        shot("end"),
        "frames 1000000\n".into(),
    ];
    let script_file = folder.path().join("script.txt");
    std::fs::write(&script_file, script.concat()).expect("a script");
    let args = [&MESH[..], &["--size", "200x150", "--script", script_file.to_str().expect("UTF-8")]].concat();
    // Without layers: they keep some 10 KiB for each swapchain.
    let args = [&["--device", "llvmpipe"], &args[..]].concat();
    let mut window = display.command(&args).arg("--quiet").spawn().expect("it starts");
    // MiB when the picture of this name is there.
    let mut resident = |name: &str| {
        while !file(name).is_file() {
            assert!(window.try_wait().expect("a process").is_none(), "the window is open until it is killed");
            std::thread::sleep(Duration::from_millis(20));
        }
        let status = std::fs::read_to_string(format!("/proc/{}/status", window.id())).expect("Linux");
        let kib = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix(" kB"));
        kib.expect("a size").parse::<f64>().expect("a number") / 1024.0
    };
    let [begin, resized, end] = ["begin", "resized", "end"].map(&mut resident);
    window.kill().and_then(|()| window.wait()).expect("a process");
    println!("resident: {begin:.1} MiB, {resized:.1} after {resizes} resizes, {end:.1} after {frames} frames");
    assert!(resized - begin < 8.0, "{resizes} resizes took {:.1} MiB", resized - begin);
    assert!(end - resized < 4.0, "{frames} frames took {:.1} MiB", end - resized);
}

#[test]
fn what_validation_layers_say_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::new();
    let shot = folder.path().join("shot.png");
    let args = [&MESH[..], &["--size", "64x64", "--screenshot", shot.to_str().expect("UTF-8")]].concat();
    let args = [&["--device", "llvmpipe", "--validation"], &args[..]].concat();
    // Best-practice messages, which the program does not fully follow.
    let mut command = display.command(&args);
    let out = command.env("VK_LAYER_ENABLES", "VK_VALIDATION_FEATURE_ENABLE_BEST_PRACTICES_EXT").output();
    let (code, said) = error_of(&out.expect("it starts"));
    assert!(code == Some(1) && said.contains("the validation layers reported"), "{said}");
}

#[test]
fn what_cannot_be_is_said_in_a_sentence() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::new();
    let script = folder.path().join("script.txt");
    let of = |text: &str| {
        std::fs::write(&script, text).expect("a script");
        display.view(&[&MESH[..], &["--size", "64x64", "--script", script.to_str().expect("UTF-8")]].concat())
    };
    for (text, code, says) in [
        ("frames 2\n\nset noSuchTarget 1\n", 2, "script.txt, line 3: set noSuchTarget"),
        ("clip nowhere.csv\n", 2, "script.txt, line 1: "),
        ("screenshot script.txt/x.png\nframes 1", 1, "x.png"),
    ] {
        let (found, said) = error_of(&of(text));
        assert!(found == Some(code) && said.contains(says), "{text}: {found:?} {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
    let (_, said) =
        error_of(&display.command(&[&MESH[..], &["--device", "SwiftShader"]].concat()).output().expect("it starts"));
    assert!(
        said.contains("no Vulkan device can present to a window here") && said.contains("deltamorph render"),
        "{said}"
    );
    let mut nowhere = display.command(&MESH);
    let (code, said) = error_of(&nowhere.env_remove("DISPLAY").output().expect("it starts"));
    assert!(code == Some(1) && said.contains("no window can be opened here"), "{said}");
}
