//! The real data sets, if they are unpacked: `DELTAMORPH_DATA` names the folder.

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
