//! Output files: nothing of the user's is lost, whatever fails.

use crate::cli::{Folder, fails, json, ok, refused, sample};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A short bench.
const BENCH: [&str; 9] = ["bench", "--vertices", "100", "--targets", "3", "--frames", "2", "--paths", "cpu"];

/// Returns every file below `folder`, with its contents.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = vec![];
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => all.extend(contents(&path)),
            false => all.push((path.clone(), std::fs::read(path).unwrap())),
        }
    }
    all.sort();
    all
}

#[test]
fn nothing_that_is_read_is_written_over() {
    let (home, dir) = sample();
    let at = |name: &str| home.at(name);
    let (packed, clip, own) = (at("a.dmorph"), at("own.csv"), at("head/weights/head_30fps.csv"));
    ok(&["pack", &dir, "-o", &packed]);
    std::fs::copy(&own, &clip).unwrap();
    let link = at("link.json");
    #[cfg(unix)]
    std::os::unix::fs::symlink(&packed, &link).unwrap();
    let before = contents(home.0.path());
    let (neutral, target) = (at("head/neutral.obj"), at("head/targets/eyeBlinkLeft.obj"));
    for args in [
        &["info", &dir, "--json", &neutral][..],
        &["info", &dir, "--json", &target],
        &["info", &packed, "--json", &packed],
        #[cfg(unix)]
        &["info", &packed, "--json", &link],
        &["play", &dir, "--weights", &clip, "--json", &clip],
        &["soak", &dir, "--frames", "2", "--json", &own],
        &["bench", &dir, "--no-report", "--weights", &clip, "--json", &clip],
        &["apply", &dir, "--set", "eyeBlinkLeft=1", "-o", &own],
        &["apply", &dir, "--set", "eyeBlinkLeft=1", "-o", &neutral],
        &["apply", &dir, "--set", "eyeBlinkLeft=1", "-o", &at("new.obj"), "--json", &neutral],
        &["pack", &packed, "-o", &packed],
    ] {
        refused(args, 2, "is an input");
        assert!(contents(home.0.path()) == before, "{args:?}");
    }
}

#[test]
fn no_two_outputs_are_one_file() {
    let (home, dir) = sample();
    let at = |name: &str| home.at(name);
    let (file, other, report) = (at("a.dmorph"), at("head/../a.dmorph"), at("report"));
    let before = contents(home.0.path());
    for args in [
        &["pack", &dir, "-o", &file, "--json", &file][..],
        &["pack", &dir, "-o", &file, "--json", &other],
        &["apply", &dir, "--set", "eyeBlinkLeft=1", "-o", &file, "--json", &other],
        &[&BENCH[..], &["--report", &report, "--json", &at("report/index.html")]].concat(),
        &["sample", &at("new"), "--json", &at("new/neutral.obj")],
    ] {
        refused(args, 2, "would be overwritten; name another file");
        assert!(contents(home.0.path()) == before, "{args:?}");
    }
    // Devices and pipes are not files that could be lost.
    ok(&["info", &dir, "--json", "/dev/null"]);
}

#[test]
fn what_fails_leaves_files_as_they_were() {
    let (home, dir) = sample();
    let bad = home.file("bad.csv", "eyeBlinkLeft\ninf\n");
    let (old, new) = (home.file("old.json", "mine"), home.at("new.json"));
    for json in [&old, &new] {
        let (_, text) = fails(&["play", &dir, "--weights", &bad, "--json", json]);
        assert!(text.contains("bad.csv") && text.contains("not a finite number"), "{text}");
    }
    assert_eq!(std::fs::read_to_string(&old).unwrap(), "mine");
    assert!(!Path::new(&new).exists());

    // A folder that is not a report's, and unwritable JSON, are detected before measuring.
    let foreign = home.at("site");
    std::fs::create_dir(&foreign).unwrap();
    home.file("site/index.html", "mine");
    refused(&[&BENCH[..], &["--report", &foreign]].concat(), 2, "site");
    assert_eq!(contents(Path::new(&foreign)).len(), 1);
    refused(&[&BENCH[..], &["--report", &old]].concat(), 2, "old.json: is not a folder; name another one");
    for folder in [&dir, &old] {
        refused(&["sample", folder], 2, "name a");
    }
    let report = home.at("report");
    let (_, text) = fails(&[&BENCH[..], &["--report", &report, "--json", "/nonexistent/x.json"]].concat());
    assert!(text.contains("/nonexistent/x.json"), "{text}");
}

#[test]
fn a_place_for_results_is_looked_for_before_the_work() {
    let (home, dir) = sample();
    let at = |name: &str| home.at(name);
    home.file("file", "mine");
    // The input is not there either: what is said is known before it is read.
    let gone = at("gone");
    for args in [
        &["apply", &gone, "--set", "a=1", "-o", &at("no/x.obj")][..],
        &["pack", &gone, "-o", &at("no/x.dmorph")],
        &["render", &gone, "--set", "a=1", "-o", &at("no/x.png")],
        &["render", &gone, "--weights", "a.csv", "--clip", &at("no/x.png")],
        &["render", &gone, "--weights", "a.csv", "--clip", &at("file/frames")],
        &["sample", &at("file/head")],
        &["play", &gone, "--json", &at("no/x.json")],
    ] {
        refused(args, 1, ": cannot ");
        assert!(fails(args).1.contains(if args.contains(&at("file/head").as_str()) {
            "file"
        } else {
            args[args.len() - 1]
        }));
    }
    assert_eq!(contents(home.0.path()).len(), contents(Path::new(&dir)).len() + 1);
}

/// Links, pipes, stdout and stdin where the program writes and reads.
#[cfg(unix)]
#[test]
fn links_pipes_and_streams_are_what_they_are_elsewhere() {
    let (home, _) = sample();
    let script = format!(
        "cd {}; exec 2>&1; D={}; apply() {{ $D apply head --path cpu \"$@\"; }}
        ln -s there/x.obj link.obj; ln -s link.obj chain.obj; mkdir there; apply --set eyeBlinkLeft=1 -o chain.obj --quiet
        [ -L link.obj ] && [ -L chain.obj ] && [ -s there/x.obj ] && echo linked
        apply --set eyeBlinkLeft=1 -o /dev/stdout 2>said | grep -v '^\\(v\\|vt\\|vn\\|f\\) '; grep -c 'active of' said
        printf 'eyeBlinkLeft\\n0\\n1\\n' | apply --weights - --frame 1 -o piped.obj --quiet; cmp piped.obj there/x.obj && echo same
        apply --weights <(printf 'eyeBlinkLeft\\n1\\n') --frame 0 -o piped.obj --quiet; cmp piped.obj there/x.obj && echo same
        $D info - <head/neutral.obj; $D info gone 2>/dev/full; echo $?; COLUMNS=0 $D info head | head -1
        $D sample s --vertices 400000 & sleep 0.7; kill -TERM $!; wait $!; echo $?; find s -mindepth 1; $D sample s --vertices 60",
        home.0.path().display(),
        env!("CARGO_BIN_EXE_deltamorph"),
    );
    let said = Command::new("bash").args(["-c", &script]).output().unwrap();
    let said = String::from_utf8(said.stdout).unwrap();
    let expected = "linked\n1\nsame\nsame\nerror: -: only clips can be read from standard input (--weights -); \
                    name a folder or file\n1\nhead (head)\n143\ns: 60 vertices";
    assert!(said.starts_with(expected), "{said}");
}

/// Names in files of strangers do nothing to a terminal.
#[test]
fn control_characters_are_spelled_out() {
    let (home, dir) = sample();
    let weights = home.file("head/weights/clip.csv", "eyeBlinkLeft,\u{1b}[2J\u{9b}31m\n1,0\n");
    std::fs::rename(home.at("head/targets/eyeSquintLeft.obj"), home.at("head/targets/jaw\nOpen\u{1b}[2J.obj")).unwrap();
    for args in [&["info", &dir][..], &["play", &dir, "--path", "cpu", "--weights", &weights]] {
        let run = crate::cli::deltamorph(args);
        let said = String::from_utf8([run.stdout, run.stderr].concat()).unwrap();
        assert!(said.chars().all(|c| c == '\n' || !c.is_control()) && said.contains("\\u{1b}[2J"), "{said}");
        assert!(args[0] == "play" || said.contains("\njaw\\nOpen\\u{1b}[2J "), "{said}");
    }
}

#[test]
fn a_report_is_replaced_when_the_new_one_is_complete() {
    let folder = Folder::new();
    let (dir, file) = (&*folder.at("report"), &*folder.at("out.json"));
    let report = Path::new(dir);
    let more = |args: &[&'static str]| [&BENCH[..], args].concat();
    ok(&[&more(&["--formats", "float32", "--changed", "1,2"])[..], &["--report", dir, "--json", file]].concat());
    let names = |files: Vec<(PathBuf, Vec<u8>)>| files.into_iter().map(|(path, _)| path).collect::<Vec<_>>();
    let before = contents(folder.0.path());
    // A selection of which nothing can run.
    let none = ["bench", "--vertices", "100", "--targets", "3", "--paths", "direct", "--formats", "fast"];
    refused(
        &[&none[..], &["--report", dir, "--json", file]].concat(),
        1,
        "no configuration could run; direct: supports --formats",
    );
    assert!(contents(folder.0.path()) == before);
    // A run stopped while writing leaves a folder, which does not block the next.
    let left = report.join(".deltamorph-1");
    std::fs::create_dir(&left).unwrap();
    ok(&[&more(&["--formats", "float32", "--changed", "2"])[..], &["--report", dir]].concat());
    let after = names(contents(report));
    assert_eq!(after, ["index.html", "report.json", "runs.csv"].map(|name| report.join(name)));
    assert!(left.exists(), "it may belong to an active run");
}

/// Suites check all their inputs before they measure.
#[test]
fn a_clip_that_cannot_be_read_costs_no_measurement() {
    let (home, dir) = sample();
    home.file("head/weights/bad.csv", "eyeBlinkLeft\ninf\n");
    let run = crate::cli::deltamorph(&["bench", &dir, "--suite", "techniques,clips", "--no-report"]);
    let text = String::from_utf8(run.stderr).unwrap();
    assert!(run.status.code() == Some(1) && text.contains("bad.csv"), "{text}");
    assert!(run.stdout.is_empty());
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_behind_stdout_is_told_and_a_reader_that_leaves_is_not() {
    use std::process::Stdio;
    for args in [&["info", "--vertices", "100", "--targets", "3"][..], &["devices", "--json", "-"]] {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let run = Command::new(env!("CARGO_BIN_EXE_deltamorph")).args(args).stdout(Stdio::from(full)).output().unwrap();
        let text = String::from_utf8(run.stderr).unwrap();
        assert!(run.status.code() == Some(1) && text.contains("stdout: cannot write"), "{args:?}: {text}");
        let mut run = Command::new(env!("CARGO_BIN_EXE_deltamorph")).args(args).stdout(Stdio::piped()).spawn().unwrap();
        drop(run.stdout.take());
        assert!(run.wait().unwrap().success(), "{args:?}");
    }
}

/// The bound on rounding exceeds what is asked for, and says so; the error does not.
#[test]
fn a_mesh_with_a_thousand_targets_runs_as_it_is() {
    let many = ["soak", "--vertices", "300", "--targets", "1000", "--frames", "4", "--path", "cpu", "--json", "-"];
    let found = json(&many);
    let [error, bound] = ["max_error_rel", "bound_rel"].map(|name| found[name].as_f64().unwrap());
    assert!(found["accumulate"] == "float" && error < 1e-6 && bound > 1e-5, "{found}");
}

/// A name that says that a file is something else than what is written is refused.
#[test]
fn files_are_what_their_names_say() {
    let folder = Folder::new();
    refused(&["render", "-o", &folder.at("a.jpg")], 2, "a PNG is written; name it *.png");
    refused(&["apply", "--set", "jawOpen=1", "-o", &folder.at("a.glb")], 2, "an OBJ file is written; name it *.obj");
    assert_eq!(std::fs::read_dir(folder.0.path()).unwrap().count(), 0);
}
