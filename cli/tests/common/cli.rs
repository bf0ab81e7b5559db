//! The program as a process: output and exit code.
#![allow(dead_code)] // each test file uses some of this

use serde_json::Value;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// Runs the program.
pub fn deltamorph(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_deltamorph")).args(args).output().expect("the program starts")
}

/// Runs the program where there is no Vulkan driver.
pub fn without_drivers(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_deltamorph"))
        .args(args)
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .env_remove("VK_ADD_DRIVER_FILES")
        .output()
        .expect("the program starts")
}

/// Returns its output on success.
pub fn ok(args: &[&str]) -> String {
    let out = deltamorph(args);
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{args:?}: {stderr}");
    String::from_utf8(out.stdout).expect("text")
}

/// Returns its JSON output on success.
pub fn json(args: &[&str]) -> Value {
    serde_json::from_str(&ok(args)).expect("JSON alone on stdout")
}

/// Asserts that JSON has these fields, each at the place of an object; fields may be added, never renamed.
pub fn has(json: &Value, contract: &[(&str, &str)]) {
    for (place, fields) in contract {
        let object = json.pointer(place).unwrap_or_else(|| panic!("{place} in {json}"));
        fields.split_whitespace().for_each(|field| assert!(object.get(field).is_some(), "{place}/{field} in {object}"));
    }
}

/// Returns exit code and error line.
pub fn fails(args: &[&str]) -> (i32, String) {
    let out = deltamorph(args);
    assert!(!out.status.success(), "{args:?} succeeded");
    let text = String::from_utf8(out.stderr).expect("text");
    assert!(!text.contains("panicked"), "{text}");
    (out.status.code().expect("no signal"), text)
}

/// Asserts this exit code, and an error with these words.
pub fn refused(args: &[&str], code: i32, words: &str) {
    let (found, text) = fails(args);
    assert!(found == code && text.contains(words), "{args:?}: {found}, {text}");
}

/// A small built-in head, for speed.
pub const HEAD: [&str; 4] = ["--vertices", "1200", "--targets", "12"];

/// A folder of a test.
pub struct Folder(pub TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    /// Returns a path in it.
    pub fn at(&self, name: &str) -> String {
        self.0.path().join(name).to_str().expect("UTF-8").to_owned()
    }

    /// Writes a file in it, and returns its path.
    pub fn file(&self, name: &str, contents: impl AsRef<[u8]>) -> String {
        let path = self.at(name);
        std::fs::write(&path, contents).expect("a file");
        path
    }
}

/// Returns every file below `folder`, with its contents.
pub fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
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

/// Makes a folder with the small head in it, as a folder with a clip of 24 frames; also returns the head's.
pub fn sample() -> (Folder, String) {
    let folder = Folder::new();
    let dir = folder.at("head");
    ok(&[&["sample", &dir, "--frames", "24"], &HEAD[..]].concat());
    (folder, dir)
}

/// Returns the clip of a head that `sample` wrote.
pub fn clip(dir: &str) -> String {
    format!("{dir}/weights/head_30fps.csv")
}

/// Returns width, height, and four bytes per pixel.
pub fn pixels(path: &Path) -> ([u32; 2], Vec<u8>) {
    let file = File::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size()];
    let info = reader.next_frame(&mut bytes).expect("a picture");
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgba, png::BitDepth::Eight));
    ([info.width, info.height], bytes)
}
