//! The real data sets, if they are unpacked: `DELTAMORPH_DATA` names the folder.
#![allow(dead_code)] // a program may need no clip

use deltamorph::import::{csv, obj};
use deltamorph::{KeptMesh, Tolerance};
use std::io::Write;
use std::path::PathBuf;

/// Returns the folder of the set `name`. If it is missing, the test is skipped with a message; with
/// `DELTAMORPH_REQUIRE_DATA=1` it fails.
pub fn set(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("DELTAMORPH_DATA").map(|root| PathBuf::from(root).join(name));
    let found = folder.filter(|folder| folder.join("README.txt").is_file());
    if found.is_none() {
        let thread = std::thread::current();
        let test = thread.name().unwrap_or("a test");
        let text = format!("LEFT OUT: {test} needs the data set {name} in the folder that DELTAMORPH_DATA names\n");
        assert!(std::env::var_os("DELTAMORPH_REQUIRE_DATA").is_none_or(|v| v != "1"), "{text}");
        // The macros' output is shown only if a test fails.
        std::io::stderr().write_all(text.as_bytes()).expect("stderr");
    }
    found
}

/// Returns the mesh of a set, and the weights of each frame of a clip of its.
pub fn face(name: &str, clip: &str) -> Option<(KeptMesh, Vec<Vec<f32>>)> {
    let folder = set(name)?;
    let mesh = obj::import_folder(&folder).expect("a folder that imports").kept(Tolerance::default());
    let mesh = mesh.expect("a mesh");
    let clip = csv::read(&folder.join("weights").join(clip), None).expect("a clip");
    let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
    let frames = clip.bind(&names).expect("columns that name targets").frames().collect();
    Some((mesh, frames))
}
