//! Copies sources of the project, with shuttle's locks and threads instead of the standard library's.

use std::path::Path;

const SOURCES: [(&str, &str); 2] =
    [("turn.rs", "../../headless/src/turn.rs"), ("handles.rs", "../../capi/src/handles.rs")];

fn main() {
    let out = std::env::var_os("OUT_DIR").expect("cargo sets it");
    for (name, path) in SOURCES {
        println!("cargo::rerun-if-changed={path}");
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{path}: {e}"));
        let text = text.split("#[cfg(test)]").next().expect("what is before the tests");
        // Module documentation cannot be included in another module.
        let lines = text.lines().filter(|line| !line.starts_with("//!"));
        let text: String = lines.flat_map(|line| [line, "\n"]).collect();
        let modelled = text.replace("std::sync::", "shuttle::sync::").replace("std::thread::", "shuttle::thread::");
        assert_ne!(modelled, text, "{path} has no locks");
        std::fs::write(Path::new(&out).join(name), modelled).expect("the folder is writable");
    }
}
