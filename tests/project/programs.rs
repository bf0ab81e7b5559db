//! Test programs of several files: a file that no other declares would test nothing.

use std::path::{Path, PathBuf};

/// Collects the sources below a folder that no package of its own has.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = entry.expect("an entry").path();
        if path.is_dir() && !path.join("Cargo.toml").is_file() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn every_file_of_a_test_program_is_compiled() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = vec![];
    ["tests", "cli/tests"].iter().for_each(|folder| sources(&root.join(folder), &mut found));
    let text = |path: &PathBuf| std::fs::read_to_string(path).expect("a source");
    for path in &found {
        let (name, folder) = (path.file_name().expect("a name"), path.parent().expect("a folder"));
        let module = if name == "mod.rs" { folder } else { path }.file_stem().expect("a name").to_string_lossy();
        let (line, by_path) = (format!("\nmod {module};"), format!("/{module}.rs\"]"));
        let is_near = |other: &Path| other.parent() == Some(folder) || other.parent() == folder.parent();
        let declares =
            |other: &PathBuf| is_near(other) && text(other).contains(&line) || text(other).contains(&by_path);
        let is_root = name == "engine.rs" || name == "main.rs" || folder.ends_with("cli/tests");
        assert!(is_root || found.iter().any(declares), "{}: no part of any program", path.display());
    }
    assert!(found.len() > 50, "{} files", found.len());
}
