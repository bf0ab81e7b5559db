//! The program as a process: what it prints and returns.
#![allow(dead_code)] // each test file uses some of this

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// Run it.
pub fn deltamorph(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_deltamorph")).args(args).output().expect("the program starts")
}

/// What it prints when it succeeds.
pub fn ok(args: &[&str]) -> String {
    let out = deltamorph(args);
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{args:?}: {stderr}");
    String::from_utf8(out.stdout).expect("text")
}

/// The JSON that it prints when it succeeds.
pub fn json(args: &[&str]) -> Value {
    serde_json::from_str(&ok(args)).expect("JSON alone on stdout")
}

/// Exit code and the error line.
pub fn fails(args: &[&str]) -> (i32, String) {
    let out = deltamorph(args);
    assert!(!out.status.success(), "{args:?} succeeded");
    let text = String::from_utf8(out.stderr).expect("text");
    assert!(!text.contains("panicked"), "{text}");
    (out.status.code().expect("no signal"), text)
}

/// It ends with this exit code, and an error that has these words.
pub fn refused(args: &[&str], code: i32, words: &str) {
    let (found, text) = fails(args);
    assert!(found == code && text.contains(words), "{args:?}: {found}, {text}");
}

/// A small built-in head: quick.
pub const HEAD: [&str; 4] = ["--vertices", "1200", "--targets", "12"];

/// The small head as a folder with a clip of 24 frames.
pub fn sample(folder: &Path) -> String {
    let dir = folder.join("head").to_str().expect("UTF-8").to_owned();
    ok(&[&["sample", &dir, "--frames", "24"], &HEAD[..]].concat());
    dir
}

/// The clip of a head that `sample` wrote.
pub fn clip(dir: &str) -> String {
    format!("{dir}/weights/head_30fps.csv")
}

/// Every link of the pages in a folder leads to a file that is there, or to a place on the page.
pub fn links_hold(folder: &Path) {
    let mut links = 0;
    for page in std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        if page.extension().is_none_or(|end| end != "html") {
            continue;
        }
        let text = std::fs::read_to_string(&page).expect("text");
        let after = ["href=\"", " src=\""].iter().flat_map(|attribute| text.split(attribute).skip(1));
        for link in after.map(|rest| rest.split('"').next().expect("a link")) {
            let there = match link.strip_prefix('#') {
                Some(id) => text.contains(&format!("id=\"{id}\"")),
                None => folder.join(link).is_file(),
            };
            assert!(there, "{}: {link}", page.display());
            links += 1;
        }
    }
    assert!(links > 0, "{}: no links", folder.display());
}
