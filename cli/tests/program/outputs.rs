//! Output files: nothing of the user's is lost, whatever fails.

use crate::cli::{Folder, contents, ok, refused, sample};
use std::path::Path;
use std::process::Command;

/// A short bench.
const BENCH: [&str; 9] = ["bench", "--vertices", "100", "--targets", "3", "--frames", "2", "--paths", "cpu"];

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
    // Devices are no files that could be lost.
    ok(&["info", &dir, "--json", "/dev/null"]);
}

#[test]
fn a_report_is_replaced_when_the_new_one_is_complete() {
    let folder = Folder::new();
    let (dir, file) = (&*folder.at("report"), &*folder.at("out.json"));
    let report = Path::new(dir);
    let more = |args: &[&'static str]| [&BENCH[..], args].concat();
    ok(&[&more(&["--formats", "float32", "--changed", "1,2"])[..], &["--report", dir, "--json", file]].concat());
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
    let after = contents(report).into_iter().map(|(path, _)| path);
    assert!(after.eq(["index.html", "report.json", "runs.csv"].map(|name| report.join(name))));
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
