//! Test programs of several files: cargo only finds `main.rs`, and a file that it does not declare would test nothing.

use std::path::{Path, PathBuf};

fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    entries.map(|entry| entry.expect("an entry").path()).collect()
}

/// Checks that the file `root` declares each file in `folder`, recursively; returns their number.
fn declared(root: &Path, folder: &Path) -> usize {
    let text = std::fs::read_to_string(root).unwrap_or_else(|e| panic!("{}: {e}", root.display()));
    let mut count = 0;
    for path in entries(folder).into_iter().filter(|path| path != root) {
        let module = path.file_stem().and_then(|stem| stem.to_str()).expect("a name");
        if path.is_dir() {
            count += declared(&path.with_extension("rs"), &path);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let is_declared = text.lines().any(|line| line.trim() == format!("mod {module};"));
            assert!(is_declared, "{} is no part of the program {}", path.display(), root.display());
            count += 1;
        }
    }
    count
}

#[test]
fn every_file_of_a_test_program_is_compiled() {
    let mut count = 0;
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let tests = package.join("tests");
    let engine = std::fs::read_to_string(tests.join("engine.rs")).expect("tests/engine.rs");
    for path in entries(&tests) {
        let is_file = path.extension().is_some_and(|extension| extension == "rs") && !path.ends_with("engine.rs");
        let root = path.join("mod.rs");
        if is_file || root.is_file() {
            let module = path.file_stem().and_then(|stem| stem.to_str()).expect("a name");
            assert!(engine.contains(&format!("\nmod {module};\n")), "tests/engine.rs lacks {}", path.display());
        }
        if root.is_file() {
            count += declared(&root, &path);
        }
    }
    for folder in entries(&tests).into_iter().chain(entries(&package.join("cli/tests"))) {
        let main = folder.join("main.rs");
        if main.is_file() {
            count += declared(&main, &folder);
        }
    }
    assert!(count > 50, "{count} files");
}
