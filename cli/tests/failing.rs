//! The program and the examples with failing Vulkan calls: each call site, with each error that the specification
//! allows there. A run ends with a message that names the call and exit code 1, or its result is that of a run without
//! failures; it never crashes, hangs, leaks or destroys twice.
//!
//! `DELTAMORPH_FAILING=N` takes N failures of each command, spread evenly over its calls; `DELTAMORPH_FAILING=all`
//! takes all of them, an hour on two cores; otherwise there are a few. Defects found earlier are always included.
#![cfg(feature = "viewer")]

#[path = "common/cli.rs"]
mod cli;
#[path = "common/display.rs"]
mod display;

use deltamorph::ash::vk::Result as Vk;
use deltamorph_failing::sweep::{Fault, Run, faults};
use display::Display;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Defects found earlier: the first call of this name in a command.
const FOUND: [(&str, &str, Vk); 4] = [
    // Fell back to the path `cpu`, as if there were no device.
    ("play", "vkCreateDevice", Vk::ERROR_DEVICE_LOST),
    // Reported bad arguments.
    ("play feedback", "vkCreateFence", Vk::ERROR_OUT_OF_HOST_MEMORY),
    // Reported a device without extensions.
    ("devices", "vkEnumerateDeviceExtensionProperties", Vk::ERROR_OUT_OF_HOST_MEMORY),
    // Dropped the mesh during its upload.
    ("minimal.rs", "vkWaitForFences", Vk::ERROR_OUT_OF_HOST_MEMORY),
];

/// A command, run in the folder of its output.
struct Case {
    name: &'static str,
    program: PathBuf,
    args: Vec<String>,
    environment: Vec<(&'static str, String)>,
    /// No path is named, so falling back to the CPU is right without a driver.
    any_path: bool,
    /// Configurations that lack memory during set-up may be skipped, as long as each path ran.
    may_skip: bool,
}

impl Case {
    fn new(name: &'static str, args: &str) -> Self {
        let args = args.split(' ').map(str::to_owned).collect();
        let program = env!("CARGO_BIN_EXE_deltamorph").into();
        Self { name, program, args, environment: vec![], any_path: false, may_skip: false }
    }

    fn command(&self, folder: &Path) -> Command {
        let mut command = Command::new(&self.program);
        command.args(&self.args).current_dir(folder);
        command.envs(self.environment.iter().map(|(name, value)| (name, value)));
        command
    }

    fn run(&self, fault: Option<&Fault>) -> Run {
        let folder = tempfile::tempdir().expect("a folder");
        Run::new(folder.path(), |own| self.command(own), fault)
    }
}

/// Returns the folder of the profile, with examples and libraries.
fn built() -> PathBuf {
    let test = std::env::current_exe().expect("a path to this test");
    test.ancestors().nth(2).expect("target/PROFILE").to_path_buf()
}

fn cases(folder: &Path, display: &Display) -> Vec<Case> {
    let (head, script) = (folder.join("head"), folder.join("script"));
    let head = head.to_str().expect("UTF-8");
    cli::ok(&["sample", head, "--vertices", "300", "--targets", "8", "--frames", "3", "--quiet"]);
    // The panel's plots show how many frames a resize took, which must not be in the compared picture.
    let text = "set eyeBlinkLeft 1\nframes 2\nresize 200 150\nframes 2\npanel off\nscreenshot a.png\n";
    std::fs::write(&script, text).expect("a script");
    let (clip, on) = (cli::clip(head), "--device llvmpipe --quiet");
    let play = |name, rest: &str| {
        Case::new(name, format!("play {head} --weights {clip} --json a.json {on} {rest}").trim_end())
    };
    let all = vec![
        Case { any_path: true, ..Case::new("devices", "devices --json a.json") },
        Case::new("apply", &format!("apply {head} --set eyeBlinkLeft=1 -o a.obj --path blocks {on}")),
        Case { any_path: true, ..play("play", "") },
        play("play compute", "--path compute --format snorm16"),
        play("play feedback", "--path feedback --format float32"),
        play("play animated", "--path blocks --animated --pose fixed16"),
        Case::new("soak", &format!("soak {head} --frames 3 --path blocks --json a.json {on}")),
        Case::new("render", &format!("render {head} --set eyeBlinkLeft=1 --path blocks -o a.png --size 64x64 {on}")),
        Case::new(
            "render clip",
            &format!("render {head} --weights {clip} --path blocks --clip a.png --size 64x64 {on}"),
        ),
        Case {
            may_skip: true,
            ..Case::new(
                "bench",
                &format!(
                    "bench --vertices 300 --targets 8 --frames 3 --paths blocks,compute,feedback,cpu --changed 2 \
                     --batch-sizes max --no-report --json a.json {on}"
                ),
            )
        },
        Case {
            environment: vec![("DISPLAY", display.name.clone()), ("WAYLAND_DISPLAY", String::new())],
            ..Case::new("view", &format!("view {head} --script {} --device llvmpipe", script.display()))
        },
        Case { program: built().join("examples/minimal"), ..Case::new("minimal.rs", "llvmpipe") },
    ];
    assert!(all[11].program.is_file(), "cargo build --example minimal");
    all
}

/// Returns the reproducible output of a run: from JSON only the paths that ran, and their device.
fn result(run: &Run) -> BTreeMap<&str, BTreeSet<&[u8]>> {
    fn is_kept(line: &&[u8]) -> bool {
        let kept = ["\"path\"", "\"device\"", "\"driver\"", "\"name\"", "\"transform_feedback\""];
        kept.iter().any(|key| line.windows(key.len()).any(|part| part == key.as_bytes()))
    }
    let mut result = BTreeMap::new();
    for (name, bytes) in &run.files {
        let parts = match name.ends_with(".json") {
            true => bytes.split(|byte| *byte == b'\n').filter(is_kept).collect(),
            false => BTreeSet::from([&bytes[..]]),
        };
        result.insert(name.as_str(), parts);
    }
    result
}

/// Returns whether a run may tolerate a failure, with the same result.
fn may_be_absorbed(Fault { call, error, .. }: &Fault) -> bool {
    match call.as_str() {
        // Another way to wait, or to the same memory.
        "vkWaitForFences" | "vkQueueWaitIdle" => *error != Vk::ERROR_DEVICE_LOST,
        "vkAllocateMemory" | "vkMapMemory" => true,
        // Unknown times; the last wait, after all work.
        "vkGetQueryPoolResults" | "vkDeviceWaitIdle" => true,
        // The next frame has a new swapchain; another format.
        "vkAcquireNextImageKHR" | "vkQueuePresentKHR" => *error == Vk::ERROR_OUT_OF_DATE_KHR,
        "vkGetPhysicalDeviceImageFormatProperties" => *error == Vk::ERROR_FORMAT_NOT_SUPPORTED,
        _ => false,
    }
}

/// Returns the outcome, if it is right: `e` an error, `p` an error of the panel, `=` the same result, `-` the call was
/// not made.
fn judge(case: &Case, clean: &Run, run: &Run, fault: &Fault) -> Result<char, String> {
    let said = run.said.trim_end();
    let last = said.lines().rfind(|line| !line.starts_with("warning")).unwrap_or("nothing");
    // A crate draws the window's panel; its errors name no call, and it leaks unfinished objects.
    let of_panel = case.name == "view" && said.contains("the panel cannot be drawn: A Vulkan error");
    if let Some(defect) = run.defect().filter(|defect| !(of_panel && *defect == "leaks")) {
        return Err(format!("{defect}: {last}"));
    }
    if !run.failed() {
        return Ok('-');
    }
    let no_driver = fault.error == Vk::ERROR_INCOMPATIBLE_DRIVER;
    match run.status.and_then(|status| status.code()) {
        Some(0) if no_driver && case.any_path => Ok('='),
        Some(0) if !(may_be_absorbed(fault) || case.may_skip && fault.error != Vk::ERROR_DEVICE_LOST) => {
            Err(format!("exit 0: {last}"))
        }
        Some(0) if result(run) != result(clean) => Err(format!("exit 0, with another result: {last}")),
        Some(0 | 1) if run.left() > 0 => Err(format!("does not destroy its device: {last}")),
        Some(0) => Ok('='),
        Some(1) if of_panel => Ok('p'),
        Some(1) => {
            let memory = ["vkAllocateMemory", "vkMapMemory"].contains(&fault.call.as_str());
            let lost = fault.error == Vk::ERROR_DEVICE_LOST;
            // If one call's failure is tolerated, the next reports a lost device.
            let next = lost && may_be_absorbed(fault) && said.contains("failed: ERROR_DEVICE_LOST");
            // The loader also queries extensions when it makes a device.
            let makes = said.contains("vkCreateDevice failed");
            let asks = fault.call == "vkEnumerateDeviceExtensionProperties" && makes;
            let names = said.contains(&fault.call) || next || asks || memory && said.contains("no memory for '");
            match () {
                () if !names && !no_driver => Err(format!("does not name the call: {last}")),
                () if lost && (last.contains("fewer") || last.contains("close other")) => {
                    Err(format!("remedy: {last}"))
                }
                () => Ok('e'),
            }
        }
        code => Err(format!("exit {code:?}: {last}")),
    }
}

/// Returns `most` of them, as evenly spread as possible.
fn spread(all: Vec<Fault>, most: usize) -> Vec<Fault> {
    let (count, most) = (all.len(), most.min(all.len()));
    (0..most).map(|i| all[(2 * i + 1) * count / (2 * most)].clone()).collect()
}

#[test]
fn a_call_that_fails_is_an_error_that_names_it() {
    let asked = std::env::var("DELTAMORPH_FAILING").ok();
    let most = match asked.as_deref() {
        None => 8,
        Some("all") => usize::MAX,
        Some(number) => number.parse().expect("DELTAMORPH_FAILING=all, or a number"),
    };
    let (folder, display) = (tempfile::tempdir().expect("a folder"), Display::new());
    let cases = cases(folder.path(), &display);
    let clean: Vec<Run> = cases.iter().map(|case| case.run(None)).collect();
    let (mut jobs, mut possible, mut found) = (vec![], 0, 0);
    for (case, clean) in cases.iter().zip(&clean) {
        let right = clean.status.is_some_and(|status| status.success()) && clean.defect().is_none();
        assert!(right && clean.left() == 0, "{}: {:?} {:?} {}", case.name, clean.status, clean.defect(), clean.said);
        let all = faults(&clean.places());
        possible += all.len();
        let is_found = |f: &Fault| f.at == 1 && FOUND.contains(&(case.name, f.call.as_str(), f.error));
        let (always, others): (Vec<_>, Vec<_>) = all.into_iter().partition(is_found);
        found += always.len();
        jobs.extend(always.into_iter().chain(spread(others, most)).map(|fault| (case, clean, fault)));
    }
    assert_eq!(found, FOUND.len(), "calls that are always tried");
    let (next, done) = (AtomicUsize::new(0), Mutex::new(vec![]));
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some((case, clean, fault)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let outcome = judge(case, clean, &case.run(Some(fault)), fault);
                    done.lock().expect("no panic").push((case.name, fault, outcome));
                }
            });
        }
    });
    let done = done.into_inner().expect("no panic");
    let mut wrong: Vec<String> = vec![];
    for (case, Fault { call, at, error }, outcome) in &done {
        if let Err(problem) = outcome {
            wrong.push(format!("{case}, {call}:{at}:{error:?}: {problem}"));
        }
    }
    wrong.sort_unstable();
    println!("{} of {possible} failures, {} wrong", done.len(), wrong.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
